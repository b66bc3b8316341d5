"""Reading the logs that calibration takes: VDA 5050 messages, bags, CSV of poses, run folders, archives.

Foreign logs say less than ours: what is missing is left out, not refused, as long as it is said where vehicles are and when.
"""

import csv
import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.calibration.archive import is_archive, read_archive
from mrp_sumo.calibration.log import ActionTime, Charge, MotionLog
from mrp_sumo.calibration.orders import orders_of_run, orders_of_visits
from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.grouping import grouped
from mrp_sumo.core.robot_states import IDLE
from mrp_sumo.errors import MrpSumoError, duration, nearest
from mrp_sumo.files.folders import RESULT
from mrp_sumo.files.names import fault_of
from mrp_sumo.files.reading import json_value, require_regular, shortened
from mrp_sumo.formats.vda.check import seconds_of
from mrp_sumo.maps.catalogue import bundled_folder

LARGEST = 2**40  # bytes of a log that is read line by line
LONGEST_LINE = 8 * 2**20
LARGEST_NUMBER = 1e15
LATEST_S = 1e11  # beyond it, three thousand years from now, times are not in seconds
NO_SECONDS = "seconds; a column of milliseconds is called t_ms, of nanoseconds t_ns"
FARTHEST_M = 1e7
MAX_ROWS = 20_000_000
DAY_S = 86_400.0  # beyond which a recorder's times are no clock, but say for how long it has recorded
ON_TIME_S = 0.5  # that messages may take to come, and clocks be off
DECIMAL_COMMA, CAMEL = re.compile(r"^(-?\d+),(\d+)$"), re.compile(r"(?<=[a-z])(?=[A-Z])")
BAGS = (".mcap", ".db3", ".bag")
COLUMNS = {  # of a CSV: name -> other names, units of suffixes in SI
    "t_s": (("t", "time", "timestamp", "stamp"), {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}),
    "x_m": (("x", "pos_x", "posx", "position_x"), {"m": 1.0, "cm": 0.01, "mm": 0.001}),
    "y_m": (("y", "pos_y", "posy", "position_y"), {"m": 1.0, "cm": 0.01, "mm": 0.001}),
    "yaw_rad": (("yaw", "theta", "heading"), {"rad": 1.0, "deg": math.pi / 180}),
    "robot": (("vehicle", "agv", "amr", "serial", "robot_id", "vehicle_id", "id", "name"), {}),
    "level": (("map", "map_id", "floor"), {}),
    "action": ((), {}),
    "station": ((), {}),
    "battery": (("battery_share", "state_of_charge", "soc"), {"percent": 0.01}),
    "charging": ((), {}),
}
NEEDED = ("t_s", "x_m", "y_m")
NOT_AT_STOPS = (
    "factsheetRequest",
    "stateRequest",
    "logReport",
    "initPosition",
    "startPause",
    "stopPause",
    "cancelOrder",
    "finePositioning",
)


def read_fleet(path: Path) -> MotionLog:
    """The log at a path, by what it is. Raises MrpSumoError for what cannot be read, in one line."""
    if not path.exists() and (bundled := bundled_folder("logs") / f"{path}.zip").is_file():
        path = bundled
    if is_archive(path):
        return read_archive(path)
    if (path / RESULT).is_file():
        return _run(path)
    if path.is_dir():
        messages = [folder / "messages.jsonl" for folder in (path, path / "vda5050") if (folder / "messages.jsonl").is_file()]
        if not messages and not any(each.suffix in BAGS or each.name == "metadata.yaml" for each in path.iterdir()):
            within = "result.json of a run, manifest.json of an archive, metadata.yaml of a bag, or messages.jsonl of VDA 5050"
            raise MrpSumoError(f"{shortened(path)}: a folder without a log, expected in it {within}")
        return _vda(messages[0]) if messages else _bag(path)
    if not path.exists():
        raise MrpSumoError(f"{shortened(path)}: no such log")
    if path.suffix.lower() in BAGS:
        return _bag(path)
    if path.suffix.lower() in (".jsonl", ".json", ".ndjson"):
        return _vda(path)
    if path.suffix.lower() in (".csv", ".txt", ".tsv"):
        return _csv(path)
    known = ".jsonl (VDA 5050), .csv (poses), a bag, a run folder, or an archive (.zip)"
    raise MrpSumoError(f"{shortened(path)}: found '{path.suffix or path.name}', expected {known}")


def _run(folder: Path) -> MotionLog:
    """A run folder: what robots report of where they are, their services, waits and batteries."""
    from mrp_sumo.io.run_reader import load_run

    run = load_run(folder)
    record = run.record
    execution, names, log = record.execution, record.fleet.robot_name, MotionLog(folder.name, "run folder", is_laid_out=True)
    log.types, log.levels = dict(zip(names, record.fleet.type_name)), dict(enumerate(record.graph.level_names))
    x, y, yaw = (execution.x_m, execution.y_m, execution.yaw_rad) if execution.believed is None else execution.believed
    for r, name in enumerate(names):
        waits = _waits(execution, r)
        level = np.zeros(len(waits)) if execution.level is None else execution.level[:, r]
        table = np.column_stack((execution.t_s, x[:, r], y[:, r], yaw[:, r], waits, level))
        log.poses[name] = [tuple(row) for row in table[np.isfinite(x[:, r] + y[:, r])].tolist()]
    if execution.stops is not None and execution.tasks is not None:
        stops = execution.stops
        last = {int(task): k for k, task in enumerate(stops.task)}
        first: set[int] = set()
        for k, (task, r, station) in enumerate(zip(stops.task.tolist(), stops.robot.tolist(), stops.station)):
            kind = "pick" if task not in first else "drop" if last[task] == k else "service"
            if not bool(execution.tasks.is_order[task]):
                kind = "startCharging"
            first.add(task)
            begin_s, end_s = float(stops.begin_s[k]), float(stops.end_s[k])
            if begin_s < end_s <= execution.t_s[-1]:
                log.visits.append(ActionTime(names[r], kind, station, begin_s, end_s))
    log.orders = orders_of_run(run)
    if execution.batteries is not None:
        charging = grouped((v.vehicle, (v.begin_s, v.end_s)) for v in log.visits if v.action == "startCharging")
        for r, name in enumerate(names):
            spans = charging.get(name, ())
            for t, share in zip(execution.batteries.t_s.tolist(), execution.batteries.level[:, r].tolist()):
                log.charges.append(Charge(name, t, share, any(a <= t < b for a, b in spans)))
    return log


def _waits(execution: Execution, robot: int) -> FloatArray:
    """[T] 1 where a robot has no way ahead that it may drive: it waits, or nobody sends it anywhere."""
    waits = np.zeros(len(execution.t_s))
    waited = [each for each in execution.events if each.robot == robot and each.kind in ("waited", "blocked")]
    spans = [(each.t_s, each.t_s + each.duration_s) for each in waited]
    if (states := execution.robot_states) is not None:
        idle = (states.robot == robot) & (states.state == IDLE)
        spans += zip(states.begin_s[idle].tolist(), states.end_s[idle].tolist())
    for begin_s, end_s in spans:
        begin, end = np.searchsorted(execution.t_s, (begin_s - 1e-6, end_s + 1e-6))
        waits[begin:end] = 1.0
    return waits


def _bag(path: Path) -> MotionLog:
    from mrp_sumo.bags.poses import COMMANDED, read_poses

    read, log = read_poses(path), MotionLog(path.name or str(path.resolve().name), "bag")
    log.is_commanded, levels, poses = read.kind == COMMANDED, read.levels, read.poses
    number = {level: log.number_of(level) for level in sorted({level for on in levels.values() for level in on})}
    for name, rows in poses.items():
        there = [math.isfinite(t + x + y + yaw) and max(abs(x), abs(y)) < FARTHEST_M for t, x, y, yaw in rows]
        if any(there):
            log.poses[name] = [(*row, math.nan, number[level]) for row, level, is_there in zip(rows, levels[name], there) if is_there]
    if not log.poses:
        raise MrpSumoError(f"{shortened(path)}: {read.kind}: no pose is one of a floor: found no numbers, or more than {FARTHEST_M:g} m")
    log.charges = [Charge(*charge) for charge in read.charges]
    log.notes.append(f"poses are those of {read.kind}" + (f"; {', '.join(read.others)} left out" if read.others else ""))
    return log


def _csv(path: Path) -> MotionLog:
    """A row for each pose; `COLUMNS` has what is read of it."""
    require_regular(path, LARGEST)
    log, name = MotionLog(path.name, "CSV"), shortened(path)
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        head = file.readline(LONGEST_LINE)
        if "\0" in head or "\ufffd" in head:
            raise MrpSumoError(f"{name}: not text in UTF-8, expected a CSV")
        said = head.lower().startswith("sep=")  # as spreadsheets write it
        head = file.readline(LONGEST_LINE) if said else head
        cut = max(",;\t", key=head.count)
        titles = next(csv.reader(io.StringIO(head), delimiter=cut), [])
        place, scale = _columns(titles, name)
        doing: dict[str, ActionTime] = {}
        for number, row in enumerate(csv.reader(file, delimiter=cut), 3 if said else 2):
            if number > MAX_ROWS:
                raise MrpSumoError(f"{name}: more than {MAX_ROWS} rows, cut it")
            if row and any(row):
                if any(row[len(titles) :]):
                    what = f"found {len(row)} cells, expected {len(titles)}, as in the first line"
                    raise MrpSumoError(f"{name}:{number}: {what}; decimal commas need semicolons between columns")
                row = row if cut == "," else [DECIMAL_COMMA.sub(r"\1.\2", cell) for cell in row]
                _csv_row(log, row, place, scale, doing, f"{name}:{number}")
    if not log.poses:
        raise MrpSumoError(f"{name}: no row says where a vehicle is")
    log.orders = orders_of_visits(log.visits, log.poses)
    return log


def _columns(head: list[str], name: str) -> tuple[dict[str, int], dict[str, float]]:
    """Of each column that is known its place and its unit in SI."""
    place: dict[str, int] = {}
    scale: dict[str, float] = {}
    for k, title in enumerate(head):
        word = re.sub(r"[^a-z0-9]+", "_", CAMEL.sub("_", title.strip()).lower()).strip("_")
        for column, (others, units) in COLUMNS.items():
            stem = column.rpartition("_")[0] if units and column not in ("battery",) else column
            for base in {stem, *others}:
                unit = word.removeprefix(base).removeprefix("_") if word.startswith(base) else None
                if unit is not None and column not in place and (unit == "" or unit in units):
                    place[column], scale[column] = k, units.get(unit, 1.0)
    for column in NEEDED:
        if column not in place:
            raise MrpSumoError(f"{name}:1: no column '{column}'{nearest(column, [title.strip() for title in head])}")
    return place, scale


def _csv_row(
    log: MotionLog, row: list[str], place: dict[str, int], scale: dict[str, float], doing: dict[str, ActionTime], where: str
) -> None:
    def text(column: str) -> str:
        k = place.get(column, -1)
        return row[k].strip() if 0 <= k < len(row) else ""

    def number(column: str) -> float:
        word = text(column)
        if not word or word.lower() in ("nan", "null", "none"):
            return math.nan
        try:
            value = _seconds(word) if column == "t_s" and "-" in word[1:] and ":" in word else float(word) * scale[column]
        except ValueError:
            expected = "seconds, or a date such as 2026-01-31T08:00:00Z" if column == "t_s" else "a number"
            raise MrpSumoError(f"{where}: {column}: found '{word[:40]}', expected {expected}") from None
        most, expected = (LATEST_S, NO_SECONDS) if column == "t_s" else (LARGEST_NUMBER, f"less than {LARGEST_NUMBER:g}")
        if abs(value) > most:
            raise MrpSumoError(f"{where}: {column}: found {word[:40]}, expected {expected}")
        return value

    vehicle, t_s = text("robot") or "robot", number("t_s")
    if fault := fault_of(vehicle):
        raise MrpSumoError(f"{where}: robot: {fault}")
    x_m, y_m = number("x_m"), number("y_m")
    if math.isfinite(t_s + x_m + y_m):
        if max(abs(x_m), abs(y_m)) > FARTHEST_M:
            raise MrpSumoError(f"{where}: x_m, y_m: found {x_m:g}, {y_m:g}, expected metres of a floor")
        log.poses.setdefault(vehicle, []).append((t_s, x_m, y_m, number("yaw_rad"), math.nan, log.number_of(text("level"))))
    action, now = text("action"), doing.get(vehicle)
    if now is not None and action != now.action:  # it lasts from its first row to the first without it
        log.visits.append(replace(doing.pop(vehicle), end_s=t_s))
        now = None
    if action and now is None and math.isfinite(t_s):
        doing[vehicle] = ActionTime(vehicle, action, text("station"), t_s, t_s)
    share = number("battery")
    if math.isfinite(share + t_s):
        share = share / 100 if share > 1.5 else share
        log.charges.append(Charge(vehicle, t_s, share, text("charging").lower() in ("1", "true", "yes")))


def _seconds(stamp: str) -> float:
    """Seconds since 1970 of a date and time of ISO 8601, in UTC where no zone is said."""
    at = datetime.fromisoformat(stamp)
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()


def _vda(path: Path) -> MotionLog:
    """States of VDA 5050, of any version, as `{"t_s":, "topic":, "payload": {}}` or alone, a JSON object a line."""
    require_regular(path, LARGEST)
    name, messages = shortened(path), _Messages(MotionLog(path.name, "VDA 5050"))
    log = messages.log
    for number, document in _lines(path, name, log.notes):
        messages.read(document, f"{name}:{number}")
    if not log.poses:
        raise MrpSumoError(f"{name}: no state says where a vehicle is (agvPosition or mobileRobotPosition)")
    for vehicle, rows in log.poses.items():
        if not any(row[4] == 0 for row in rows):  # nodes are never released: so they say nothing of waits
            log.poses[vehicle] = [(*row[:4], math.nan, row[5]) for row in rows]
    messages.set_clocks()
    log.orders = orders_of_visits(log.visits, log.poses, messages.sent)
    return log


def _payload(document: dict[str, Any]) -> dict[str, Any]:
    """The payload of a message, also where a recorder has it as text; else the document itself."""
    payload = document.get("payload")
    if isinstance(payload, str):
        try:
            payload = json_value(payload, largest=LARGEST_NUMBER)
        except (ValueError, RecursionError):
            payload = None
    return payload if isinstance(payload, dict) else document


def _lines(path: Path, name: str, notes: list[str]) -> Iterator[tuple[int, dict[str, Any]]]:
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE + 1), ""), 1):
            if not line.strip():
                continue
            try:
                document = json_value(line, largest=LARGEST_NUMBER)
            except (ValueError, RecursionError):
                if number > 1 and not line.endswith("\n") and len(line) <= LONGEST_LINE:  # its writer was stopped
                    notes.append(f"line {number}, the last, is cut off: left out")
                    return
                raise MrpSumoError(f"{name}:{number}: not JSON, expected an object a line") from None
            if not isinstance(document, dict):
                raise MrpSumoError(f"{name}:{number}: found {type(document).__name__}, expected a JSON object a line")
            yield number, document


@dataclass
class _Messages:
    """Messages of VDA 5050 on their way into a log."""

    log: MotionLog
    doing: dict[tuple[str, str], tuple[str, str, float]] = field(default_factory=dict)  # by vehicle and action: kind, node, begin
    waits: dict[str, float] = field(default_factory=dict)  # by vehicle
    ordered_s: dict[str, float] = field(default_factory=dict)  # when each action was first asked for, by its id, unique among all
    sent: dict[str, list[tuple[float, str]]] = field(default_factory=dict)  # by vehicle: when, and to which node
    late_s: dict[str, list[float]] = field(default_factory=dict)  # by sender: from when it says that it sent a message to when it came

    def read(self, document: dict[str, Any], where: str) -> None:
        """Take what a message says; those of other kinds are left out."""
        payload = _payload(document)
        topic = str(document.get("topic") or "")
        kind, parts = topic.rpartition("/")[2], topic.split("/")
        vehicle = str(payload.get("serialNumber") or (parts[-2] if len(parts) > 2 else "")) or "vehicle"
        if kind == "factsheet" or "physicalParameters" in payload:
            _factsheet(self.log, payload)
        elif kind == "order" and isinstance(payload.get("nodes"), list):
            self._order(vehicle, self._time_of("", document, payload, where), payload)
        elif kind in ("state", "visualization", "") and ("agvPosition" in payload or "mobileRobotPosition" in payload):
            if fault := fault_of(vehicle):
                raise MrpSumoError(f"{where}: serialNumber: {fault}")
            self._state(vehicle, self._time_of(vehicle, document, payload, where), payload)

    def _time_of(self, sender: str, document: dict[str, Any], payload: dict[str, Any], where: str) -> float:
        """When a message was sent, by its own clock where it says it."""
        came_s, sent_s = document.get("t_s"), seconds_of(payload.get("timestamp"))
        t_s = came_s if sent_s is None else sent_s
        if not isinstance(t_s, int | float) or isinstance(t_s, bool):
            raise MrpSumoError(f"{where}: timestamp: found {str(payload.get('timestamp'))[:40]!r}, expected YYYY-MM-DDTHH:mm:ss.fffZ")
        if abs(t_s) > LATEST_S:
            raise MrpSumoError(f"{where}: t_s: found {t_s:g}, expected seconds")
        if sent_s is not None and abs(late_s := _number(came_s) - sent_s) < DAY_S:
            self.late_s.setdefault(sender, []).append(late_s)
        return float(t_s)

    def set_clocks(self) -> None:
        """Set clocks of vehicles by that of who sends orders, else by each other's, as far as the recorder says when messages came."""
        usual_s = {sender: float(np.median(late_s)) for sender, late_s in self.late_s.items()}
        right_s = usual_s.get("", float(np.median([*usual_s.values()] or 0.0)))
        for vehicle in self.log.poses:
            off_s = usual_s.get(vehicle, right_s) - right_s
            if abs(off_s) > ON_TIME_S:
                self.log.set_clock(vehicle, off_s)
                off = f"{duration(abs(off_s))} {'slow' if off_s > 0 else 'fast'}"
                self.log.notes.append(f"the clock of {vehicle} is {off}, by when its messages came: set right")

    def _order(self, vehicle: str, t_s: float, payload: dict[str, Any]) -> None:
        nodes = _objects(payload["nodes"])
        for each in (each for node in nodes for each in _objects(node.get("actions"))):
            self.ordered_s.setdefault(str(each.get("actionId")), t_s)
        self.sent.setdefault(vehicle, []).append((t_s, str(nodes[-1].get("nodeId", "")) if nodes else ""))

    def _state(self, vehicle: str, t_s: float, payload: dict[str, Any]) -> None:
        log = self.log
        if "nodeStates" in payload:
            is_free = any(node.get("released") for node in _objects(payload["nodeStates"]))
            self.waits[vehicle] = 0.0 if is_free and not payload.get("paused") else 1.0
        place = payload.get("mobileRobotPosition", payload.get("agvPosition"))
        if isinstance(place, dict) and place.get("positionInitialized", True):
            x, y, theta = (_number(place.get(key)) for key in ("x", "y", "theta"))
            if math.isfinite(x + y) and max(abs(x), abs(y)) < FARTHEST_M:
                level = log.number_of(str(place.get("mapId", "")))
                log.poses.setdefault(vehicle, []).append((t_s, x, y, theta, self.waits.get(vehicle, math.nan), level))
        for each in _objects(payload.get("actionStates")):
            self._action(vehicle, t_s, each, str(payload.get("lastNodeId", "")))
        power = payload.get("powerSupply", payload.get("batteryState"))
        if isinstance(power, dict):
            share = _number(power.get("stateOfCharge", power.get("batteryCharge"))) / 100
            if 0 <= share <= 1:
                log.charges.append(Charge(vehicle, t_s, share, bool(power.get("charging"))))

    def _action(self, vehicle: str, t_s: float, state: dict[str, Any], node: str) -> None:
        """An action lasts from the first state in which it runs to the first in which it has ended."""
        key, kind = (vehicle, str(state.get("actionId"))), str(state.get("actionType", "action"))
        if kind in NOT_AT_STOPS or fault_of(kind):
            return
        if state.get("actionStatus") in ("RUNNING", "INITIALIZING"):
            self.doing.setdefault(key, (kind, node, t_s))
        elif state.get("actionStatus") == "FINISHED" and key in self.doing:
            action, at, begin_s = self.doing.pop(key)
            if t_s > begin_s:
                self.log.visits.append(ActionTime(vehicle, action, at, begin_s, t_s, self.ordered_s.get(key[1], math.nan)))


def _factsheet(log: MotionLog, payload: dict[str, Any]) -> None:
    about = payload.get("physicalParameters")
    for key, name in (("length", "length_m"), ("width", "width_m")):
        size = _number(about.get(key)) if isinstance(about, dict) else math.nan
        if 0 < size < 100:
            log.body[name] = max(size, log.body.get(name, 0.0))


def _objects(value: Any) -> list[dict[str, Any]]:
    return [each for each in value if isinstance(each, dict)] if isinstance(value, list) else []


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
