"""The fleet log archive: a folder, or the same as a ZIP, of `manifest.json` and three tables; docs/archive.md has the format.

    manifest.json    format and version, map, types of robots, units, time base, licence, rows and SHA-256 of the tables
    states.parquet   t_ms, vehicle, x_mm, y_mm, yaw_mrad, level, waits, battery_percent, charging: a row a pose
    orders.parquet   order, stops, release_ms, assigned_ms, done_ms, ended_ms, vehicle, asks: a row an order
    events.parquet   vehicle, action, station, begin_ms, end_ms, told_ms, order, stop: a row for what a vehicle did at a stop

Whole milliseconds, millimetres and milliradians; null where the log does not say it. Refuses files that are larger than a log of its rows
would be, members of a ZIP that are none of these, and manifests of another format.
"""

import hashlib
import json
import math
import re
import shutil
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from mrp_sumo.calibration.log import ActionTime, Charge, LoggedOrder, MotionLog, require_different
from mrp_sumo.core.graph import BoolArray, FloatArray
from mrp_sumo.errors import MrpSumoError, nearest
from mrp_sumo.files.names import fault_of
from mrp_sumo.files.reading import json_value, read_json, require_regular, shortened
from mrp_sumo.files.writing import writing_to, written_whole
from mrp_sumo.io.arrow import dictionary, numbers, texts, write_table
from mrp_sumo.io.tables import Table, read_table

FORMAT, VERSION = "mrp_sumo fleet log", 1
MANIFEST, STATES, ORDERS, EVENTS = "manifest.json", "states.parquet", "orders.parquet", "events.parquet"
OTHER_PACKS = (".tar", ".gz", ".tgz", ".bz2", ".xz", ".zst", ".7z", ".rar")  # names of which nobody expects a folder
TABLES = (STATES, ORDERS, EVENTS)
UNITS = {"t_ms": "milliseconds", "x_mm": "millimetres", "y_mm": "millimetres", "yaw_mrad": "milliradians, counter-clockwise from x"}
NEEDED: Mapping[str, type] = {
    **{"format": str, "version": int, "licence": str, "anonymised": bool},
    **dict.fromkeys(("map", "robot_types", "vehicles", "units", "time", "tables"), dict),
}
ASKED = {"priority": int, "robot_type": str, "load_kg": int | float, "due_s": int | float, "robot": str}
CLOCKS_S = 60.0  # by which the clock of a vehicle, and so its services, may differ from that of orders
LARGEST = 2**32  # bytes of a member
LONGEST = 2**20  # of the manifest
FASTEST_MPS = 20.0
LISTED = 20  # faults of a kind
ALIKE = 0.5  # share of the poses of a vehicle by which two logs are one
DECIMALS = 1e3  # of seconds, metres and radians in the tables


@dataclass(frozen=True)
class ArchiveHead:
    """A manifest's part that the tables do not hold."""

    name: str
    licence: str = ""
    who: str = ""
    where: str = ""
    map_file: str = ""  # within the archive
    map_name: str = ""  # of a bundled one
    levels: tuple[str, ...] = ()
    is_laid_out: bool = False
    types: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  # sizes and more, by name of the type
    time_base: str = "of the log"  # or 'seconds since 1970'
    is_anonymised: bool = False
    truth: Mapping[str, Any] = field(default_factory=dict)  # of a log that was made


def is_archive(path: Path) -> bool:
    """True for a folder with a manifest, and a ZIP."""
    return (path / MANIFEST).is_file() or (path.suffix.lower() == ".zip" and path.is_file())


def write_archive(log: MotionLog, about: ArchiveHead, out: Path, map_: Path | None = None) -> Path:
    """Write an archive: a ZIP where the name ends so, else a folder. Raises MrpSumoError where something is there already."""
    if out.exists():
        raise MrpSumoError(f"{shortened(out)}: is there already, expected a name of a new archive")
    if not out.absolute().parent.is_dir():
        raise MrpSumoError(f"{shortened(out.parent)}: no such folder")
    if out.suffix.lower() in OTHER_PACKS:
        raise MrpSumoError(f"{shortened(out)}: found {out.suffix}, expected a name that ends in .zip, or the name of a folder")
    if log.is_commanded:
        raise MrpSumoError(f"{log.source}: found commanded speeds alone, expected poses: an archive says where vehicles were")
    with writing_to(out), TemporaryDirectory(dir=out.absolute().parent, prefix=f".{out.name}-") as scratch:
        folder = Path(scratch) / "archive"
        folder.mkdir()
        write_table(folder / STATES, _states(log))
        write_table(folder / ORDERS, _orders(log.orders))
        write_table(folder / EVENTS, _events(log))
        if map_ is not None:
            shutil.copyfile(map_, folder / map_.name)
        text = json.dumps(_manifest(log, about, folder), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        (folder / MANIFEST).write_text(text, encoding="utf-8")
        if out.suffix.lower() != ".zip":
            folder.rename(out)
            return out
        with written_whole(out) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as pack:
            for path in sorted(folder.iterdir()):
                pack.writestr(zipfile.ZipInfo(path.name, (1980, 1, 1, 0, 0, 0)), path.read_bytes(), zipfile.ZIP_DEFLATED)
    return out


def _manifest(log: MotionLog, about: ArchiveHead, folder: Path) -> dict[str, Any]:
    times = [row[0] for rows in log.poses.values() for row in rows]
    rows = {STATES: len(times), ORDERS: len(log.orders), EVENTS: len(list(_rows_of(log)))}
    names = sorted({*log.poses, *(v.vehicle for v in log.visits), *(o.vehicle for o in log.orders if o.vehicle)})
    types = {name: log.types.get(name, "") for name in names}
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": about.name,
        "map": {
            "file": about.map_file or None,
            "bundled": about.map_name or None,
            "levels": list(about.levels),
            "levels_side_by_side": about.is_laid_out,
        },
        "robot_types": {name: dict(about.types.get(name, {})) for name in sorted(set(types.values()) - {""})} | (
            {"": dict(log.body)} if log.body and "" in types.values() else {}
        ),
        "vehicles": types,
        "units": UNITS,
        "time": {"base": about.time_base, "begin_ms": round(1e3 * min(times)), "end_ms": round(1e3 * max(times))},
        "licence": about.licence,
        "origin": {"who": about.who or None, "where": about.where or None, "kind": log.kind},
        "anonymised": about.is_anonymised,
        "notes": list(log.notes),
        "tables": {
            name: {"rows": rows[name], "sha256": hashlib.sha256((folder / name).read_bytes()).hexdigest()} for name in TABLES
        },
        **({"truth": dict(about.truth)} if about.truth else {}),
    }  # fmt: skip


def _whole(values: Sequence[float] | FloatArray) -> Any:
    """A column of whole thousandths, null where nothing is said."""
    array = np.asarray(values, np.float64).reshape(-1)
    there = np.isfinite(array)
    return numbers(np.rint(np.where(there, array, 0.0) * DECIMALS).astype(np.int64), there)


def _states(log: MotionLog) -> dict[str, Any]:
    """Poses by vehicle and time, each with the latest battery."""
    of = {name: np.array(rows, np.float64).reshape(-1, 6) for name, rows in sorted(log.poses.items())}
    table, count = np.concatenate(list(of.values())), [len(rows) for rows in of.values()]
    begin = dict(zip(of, np.cumsum([0, *count]).tolist()))
    share, plugged = np.full(len(table), np.nan), np.zeros(len(table), np.bool_)
    for charge in sorted((charge for charge in log.charges if charge.vehicle in of), key=lambda charge: charge.t_s):
        k = int(np.searchsorted(of[charge.vehicle][:, 0], charge.t_s))
        if k < len(of[charge.vehicle]):
            share[begin[charge.vehicle] + k], plugged[begin[charge.vehicle] + k] = charge.share, charge.charging
    said = np.isfinite(table[:, 4])
    return {
        "t_ms": _whole(table[:, 0]),
        "vehicle": dictionary(np.repeat(list(of), count).tolist()),
        "x_mm": _whole(table[:, 1]),
        "y_mm": _whole(table[:, 2]),
        "yaw_mrad": _whole(table[:, 3]),
        "level": dictionary([log.levels.get(number, "") for number in table[:, 5].tolist()]),
        "waits": numbers((table[:, 4] > 0.5).astype(np.int8), said),
        "battery_percent": numbers(np.nan_to_num(100 * share).round(2), np.isfinite(share)),
        "charging": numbers(plugged.astype(np.int8), np.isfinite(share)),
    }


def _orders(orders: Sequence[LoggedOrder]) -> dict[str, Any]:
    return {
        "order": texts([order.name for order in orders]),
        "stops": texts([json.dumps(list(order.stops), ensure_ascii=False) for order in orders]),
        **{f"{name}_ms": _whole([getattr(order, f"{name}_s") for order in orders]) for name in ("release", "assigned", "done", "ended")},
        "vehicle": texts([order.vehicle for order in orders]),
        "asks": texts([json.dumps(dict(order.asks), ensure_ascii=False) if order.asks else "" for order in orders]),
    }


def _rows_of(log: MotionLog) -> Iterator[tuple[str, str, str, float, float, float, str, int]]:
    """Services of orders, then what else vehicles did at stops."""
    visits = {(visit.vehicle, round(visit.begin_s, 3)): visit for visit in log.visits}
    of_orders = set()
    for order in log.orders:
        for k, (begin_s, end_s) in enumerate(order.services):
            key = (order.vehicle, round(begin_s, 3))
            visit = visits.get(key)
            of_orders.add(key)
            action, spoken_s = ("", math.nan) if visit is None else (visit.action, visit.told_s)
            yield order.vehicle, action, order.stops[k], begin_s, end_s, spoken_s, order.name, k
    for key, visit in visits.items():
        if key not in of_orders:
            yield visit.vehicle, visit.action, visit.station, visit.begin_s, visit.end_s, visit.told_s, "", -1


def _events(log: MotionLog) -> dict[str, Any]:
    rows = sorted(_rows_of(log), key=lambda row: (row[3], row[0]))
    vehicle, action, station, begin, end, spoken, order, stop = zip(*rows) if rows else ((),) * 8
    stops = np.array(stop, np.int64)
    return {
        "vehicle": dictionary(list(vehicle)),
        "action": dictionary(list(action)),
        "station": dictionary(list(station)),
        "begin_ms": _whole(begin),
        "end_ms": _whole(end),
        "told_ms": _whole(spoken),
        "order": texts(order),
        "stop": numbers(stops, stops >= 0),
    }


@contextmanager
def _opened(path: Path) -> Iterator[Path]:
    """The folder of an archive. Raises MrpSumoError for a ZIP with members that no archive has, or that are too large."""
    if path.is_dir():
        yield path
        return
    require_regular(path, 2**40)
    with TemporaryDirectory(prefix="mrp_sumo_archive_") as scratch:
        try:
            with zipfile.ZipFile(path) as pack:
                for member in pack.infolist():
                    name = PurePosixPath(member.filename)
                    if member.is_dir() or len(name.parts) != 1 or fault_of(name.name) or member.file_size > LARGEST:
                        raise MrpSumoError(f"{shortened(path)}: '{member.filename[:60]}' is no file of an archive")
                    if member.file_size > 2**20 and member.file_size > 200 * max(member.compress_size, 1):
                        raise MrpSumoError(f"{shortened(path)}: '{name}' would take {member.file_size / 2**20:.0f} MB, which is not read")
                    with pack.open(member) as source, (Path(scratch) / name.name).open("wb") as target:
                        shutil.copyfileobj(source, target)
        except (zipfile.BadZipFile, zipfile.LargeZipFile, NotImplementedError, RuntimeError, EOFError, OSError) as error:
            raise MrpSumoError(f"{shortened(path)}: not a readable ZIP: {str(error)[:80]}") from None
        yield Path(scratch)


def manifest_of(folder: Path, name: str) -> dict[str, Any]:
    """The manifest in a folder. Raises MrpSumoError for one of another format or version."""
    if not (folder / MANIFEST).is_file():
        raise MrpSumoError(f"{name}: no {MANIFEST}, expected a fleet log archive")
    document = read_json(folder / MANIFEST, LONGEST)
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise MrpSumoError(f"{name}: {MANIFEST}: format: expected '{FORMAT}'")
    for key, kind in NEEDED.items():
        if key not in document:
            raise MrpSumoError(f"{name}: {MANIFEST}: no '{key}'{nearest(key, [str(k) for k in document])}")
        if type(document[key]) is not kind:
            raise MrpSumoError(f"{name}: {MANIFEST}: {key}: found {type(document[key]).__name__}, expected {kind.__name__}")
    if document["version"] != VERSION:
        raise MrpSumoError(f"{name}: {MANIFEST}: version {document['version']}, expected {VERSION}")
    return document


def manifest_in(path: Path) -> dict[str, Any]:
    """The manifest of an archive. Raises MrpSumoError."""
    with _opened(path) as folder:
        return manifest_of(folder, str(shortened(path)))


def read_archive(path: Path) -> MotionLog:
    """The log in an archive. Raises MrpSumoError: one line."""
    with _opened(path) as folder:
        return _read(folder, manifest_of(folder, str(shortened(path))), path)


def _read(folder: Path, document: Mapping[str, Any], path: Path) -> MotionLog:
    place = document["map"]
    log = MotionLog(path.name or path.resolve().name, "fleet log archive", is_laid_out=bool(place.get("levels_side_by_side")))
    _read_states(log, read_table(folder / STATES))
    if not log.poses:
        raise MrpSumoError(f"{shortened(path)}: {STATES}: no row says where a vehicle is")
    log.types = {str(vehicle): str(kind) for vehicle, kind in document["vehicles"].items() if kind}
    log.body = {key: float(value) for key, value in document["robot_types"].get("", {}).items() if isinstance(value, int | float)}
    orders, events = read_table(folder / ORDERS), read_table(folder / EVENTS)
    services = _read_events(log, events)
    released, assigned, done, ended = (_seconds(orders, f"{name}_ms").tolist() for name in ("release", "assigned", "done", "ended"))
    vehicle, stops, asks = (orders.texts(name) for name in ("vehicle", "stops", "asks"))
    for k, name in enumerate(orders.texts("order")):
        names, made = _listed(orders, stops[k], k), services.get(name, {})
        times = tuple(made[n] for n in range(len(names)) if n in made)
        more = _mapping(orders, asks[k], k)
        log.orders.append(LoggedOrder(name, names, released[k], assigned[k], vehicle[k], times, done[k], ended[k], more))
    log.orders.sort(key=lambda order: order.release_s)
    return log


def _seconds(table: Table, name: str) -> FloatArray:
    return table.numbers(name, missing=np.nan) / DECIMALS


def _read_states(log: MotionLog, table: Table) -> None:
    t_s, x_m, y_m, yaw = (_seconds(table, name) for name in ("t_ms", "x_mm", "y_mm", "yaw_mrad"))
    vehicle, level = table.texts("vehicle"), table.texts("level")
    waits, charging = (table.numbers(name, missing=np.nan) for name in ("waits", "charging"))
    share = table.numbers("battery_percent", missing=np.nan) / 100
    number = {name: float(k) for k, name in enumerate(sorted(set(level)))}
    log.levels = {k: name for name, k in number.items()}
    there = np.isfinite(t_s + x_m + y_m)
    for k in np.flatnonzero(there).tolist():
        row = (float(t_s[k]), float(x_m[k]), float(y_m[k]), float(yaw[k]), float(waits[k]), number[level[k]])
        log.poses.setdefault(vehicle[k], []).append(row)
        if 0 <= share[k] <= 1:
            log.charges.append(Charge(vehicle[k], float(t_s[k]), float(share[k]), charging[k] > 0))


def _read_events(log: MotionLog, table: Table) -> dict[str, dict[int, tuple[float, float]]]:
    """Fill in what vehicles did; services of orders by name and number of the stop."""
    begin, end, spoken = (_seconds(table, f"{name}_ms") for name in ("begin", "end", "told"))
    vehicle, action, station, order = (table.texts(name) for name in ("vehicle", "action", "station", "order"))
    stop = table.numbers("stop", missing=-1)
    services: dict[str, dict[int, tuple[float, float]]] = {}
    for k in range(table.num_rows):
        if action[k] and math.isfinite(begin[k] + end[k]):
            log.visits.append(ActionTime(vehicle[k], action[k], station[k], float(begin[k]), float(end[k]), float(spoken[k])))
        if order[k] and stop[k] >= 0:
            services.setdefault(order[k], {})[int(stop[k])] = (float(begin[k]), float(end[k]))
    return services


def _listed(table: Table, text: str, row: int) -> tuple[str, ...]:
    value = _json(text)
    if not isinstance(value, list) or not value or not all(isinstance(one, str) for one in value):
        raise table.fault(f"column 'stops', row {row}: expected a JSON list of names")
    return tuple(value)


def _mapping(table: Table, text: str, row: int) -> dict[str, Any]:
    value = _json(text or "{}")
    if not isinstance(value, dict) or not all(isinstance(value.get(key), kind | None) for key, kind in ASKED.items()):
        raise table.fault(f"column 'asks', row {row}: expected a JSON object with {', '.join(ASKED)}")
    if odd := sorted(set(value) - set(ASKED)):
        raise table.fault(f"column 'asks', row {row}: found '{odd[0][:40]}', expected {', '.join(ASKED)}")
    return value


def _json(text: str) -> Any:
    try:
        return json_value(text)
    except (ValueError, RecursionError):
        return None


def faults_of(path: Path) -> list[str]:
    """Faults of an archive, a line each: its manifest, sums, rows, and what no fleet does. Raises MrpSumoError for what is none at all."""
    name = str(shortened(path))
    with _opened(path) as folder:
        document = manifest_of(folder, name)
        faults = [f"{MANIFEST}: licence: nothing, expected under which it may be used"] if not document["licence"].strip() else []
        for each in TABLES:
            if not (folder / each).is_file():
                raise MrpSumoError(f"{name}: no {each}")
            about = document["tables"].get(each)
            if not isinstance(about, dict) or about.get("sha256") != hashlib.sha256((folder / each).read_bytes()).hexdigest():
                faults.append(f"{each}: its SHA-256 is not that of {MANIFEST}")
            elif about.get("rows") != read_table(folder / each).num_rows:
                faults.append(f"{each}: {read_table(folder / each).num_rows} rows, but {about.get('rows')} in {MANIFEST}")
        if (file := document["map"].get("file")) and not (folder / str(file)).is_file():
            faults.append(f"{MANIFEST}: map: file: no '{file}' in the archive")
        log = _read(folder, document, path)
    return [*faults, *_faults_of_log(log, document)]


def _faults_of_log(log: MotionLog, document: Mapping[str, Any]) -> Iterator[str]:
    odd = sorted(set(log.poses) - set(document["vehicles"]))
    yield from (f"{MANIFEST}: vehicles: no '{name}', which {STATES} has" for name in odd[:LISTED])
    unseen = sorted(set(document["vehicles"]) - set(log.poses))
    yield from (f"{STATES}: no pose of '{name}', which {MANIFEST} has" for name in unseen[:LISTED])
    seconds = [row[0] for rows in log.poses.values() for row in rows]
    if [document["time"].get(f"{end}_ms") for end in ("begin", "end")] != [round(DECIMALS * end(seconds)) for end in (min, max)]:
        yield f"{MANIFEST}: time: begin_ms, end_ms: not the first and the last of {STATES}"
    types = set(document["robot_types"])
    missing = sorted({str(kind) for kind in document["vehicles"].values() if kind} - types)
    yield from (f"{MANIFEST}: robot_types: no '{name}'" for name in missing[:LISTED])
    for name, rows in sorted(log.poses.items()):
        table = np.array(rows, np.float64)
        dt = np.diff(table[:, 0])
        if (dt < 0).any():
            yield f"{STATES}: the clock of '{name}' jumps back at {table[int(np.argmax(dt < 0)), 0]:.3f} s"
        far = np.hypot(*np.diff(table[:, 1:3], axis=0).T) > FASTEST_MPS * np.maximum(dt, 0.1) + 1.0
        same: BoolArray = np.diff(table[:, 5]) == 0
        if (far & same).any():
            yield f"{STATES}: '{name}' is at two places at once at {table[int(np.argmax(far & same)), 0]:.3f} s"
    try:
        require_different(log)
    except MrpSumoError as error:
        yield f"{STATES}{str(error).removeprefix(log.source)}"
    names = [order.name for order in log.orders]
    yield from (f"{ORDERS}: two orders '{name}'" for name in sorted({name for name in names if names.count(name) > 1})[:LISTED])
    for order in log.orders:
        asked_s, served_s = (order.release_s, order.assigned_s), [t for span in order.services for t in span]
        times = [([*asked_s, order.done_s], 1e-3), (served_s, 1e-3), ([*asked_s, *served_s, order.done_s], CLOCKS_S)]
        if any(b < a - off_s for said, off_s in times for a, b in pairwise(filter(math.isfinite, said))):
            yield f"{ORDERS}: '{order.name}': its times do not follow each other"
            break


REMAINS = (
    "what remains: when vehicles drive within the log and how, the shape of their ways, how often each place is served and for how long, "
    "how many vehicles and orders there are; who knows the site may know it again"
)


def anonymised(log: MotionLog, about: ArchiveHead, *, moved: bool) -> tuple[MotionLog, ArchiveHead]:
    """The log without names, dates and map, and what its manifest says; moved, its origin is at the least x and y, too."""
    first_s = min(row[0] for rows in log.poses.values() for row in rows)
    places = np.array([row[1:3] for rows in log.poses.values() for row in rows])
    off = np.floor(places.min(0)) if moved else np.zeros(2)
    vehicle = _renamed([*log.poses, *(v.vehicle for v in log.visits), *(o.vehicle for o in log.orders)], "vehicle")
    station = _renamed([*(v.station for v in log.visits), *(s for o in log.orders for s in o.stops)], "station")
    types = _renamed(log.types.values(), "type")
    levels = {number: f"level_{k + 1}" if name else "" for k, (number, name) in enumerate(sorted(log.levels.items()))}
    order = {each.name: f"order_{k + 1}" for k, each in enumerate(log.orders)}

    def asks(of: LoggedOrder) -> dict[str, Any]:
        changed: dict[str, Any] = {key: names.get(str(of.asks.get(key)), "") for key, names in (("robot_type", types), ("robot", vehicle))}
        changed |= {"due_s": of.asks["due_s"] - first_s} if "due_s" in of.asks else {}
        return {key: changed.get(key, value) for key, value in of.asks.items()}

    def visit(of: ActionTime) -> ActionTime:
        times = {key: getattr(of, key) - first_s for key in ("begin_s", "end_s", "told_s")}
        return replace(of, vehicle=vehicle[of.vehicle], station=station.get(of.station, ""), **times)

    def known(of: LoggedOrder) -> LoggedOrder:
        times: dict[str, Any] = {f"{key}_s": getattr(of, f"{key}_s") - first_s for key in ("release", "assigned", "done", "ended")}
        times["services"] = tuple((begin_s - first_s, end_s - first_s) for begin_s, end_s in of.services)
        stops = tuple(station.get(name, "") for name in of.stops)
        return replace(of, name=order[of.name], stops=stops, vehicle=vehicle.get(of.vehicle, ""), asks=asks(of), **times)

    def poses(rows: Sequence[tuple[float, ...]]) -> list[tuple[float, ...]]:
        return [(row[0] - first_s, row[1] - off[0], row[2] - off[1], *row[3:]) for row in rows]

    made = replace(
        log,
        source="log",
        poses={vehicle[name]: poses(rows) for name, rows in log.poses.items()},
        visits=[visit(each) for each in log.visits],
        orders=[known(each) for each in log.orders],
        charges=[replace(each, vehicle=vehicle[each.vehicle], t_s=each.t_s - first_s) for each in log.charges if each.vehicle in vehicle],
        types={vehicle[name]: types[kind] for name, kind in log.types.items() if name in vehicle},
        levels=levels,
        notes=[],
    )
    said = replace(
        about,
        name="log",
        who="",
        where="",
        map_file="",
        map_name="",
        levels=tuple(levels.values()),
        types={types[name]: figures for name, figures in about.types.items() if name in types},
        time_base="seconds from the first pose",
        is_anonymised=True,
    )
    return made, said


def _renamed(names: Any, word: str) -> dict[str, str]:
    """New names by old ones, in an order that says nothing of them: by first appearance."""
    return {name: f"{word}_{k + 1}" for k, name in enumerate(dict.fromkeys(name for name in names if name))}


def merged(logs: Sequence[MotionLog]) -> MotionLog:
    """Several logs of one fleet as one: later files go on, or have other vehicles. Raises MrpSumoError for two of different frames."""
    first = logs[0]
    if len(logs) == 1:
        return first
    if len({log.is_laid_out for log in logs}) > 1:
        raise MrpSumoError(f"{logs[1].source}: its levels lie otherwise than those of {first.source}: import one kind of log at a time")
    for one, other in combinations(logs, 2):
        for name in sorted(set(one.poses) & set(other.poses)):
            both = [{row[:3] for row in log.poses[name]} for log in (one, other)]
            if len(both[0] & both[1]) > ALIKE * min(map(len, both)):
                raise MrpSumoError(f"{other.source}: poses of '{name}' are those of {one.source}: the same log twice")
    together = MotionLog(first.source, first.kind if len({log.kind for log in logs}) == 1 else "logs", is_laid_out=first.is_laid_out)
    together.is_commanded = any(log.is_commanded for log in logs)
    number: dict[str, float] = {}
    for log in logs:
        for name, rows in log.poses.items():
            on = {k: number.setdefault(log.levels.get(k, ""), float(len(number))) for k in {row[5] for row in rows}}
            together.poses.setdefault(name, []).extend((*row[:5], on[row[5]]) for row in rows)
        together.visits += log.visits
        together.orders += log.orders
        together.charges += log.charges
        together.body |= log.body
        together.types |= log.types
        together.notes += [note for note in log.notes if note not in together.notes]
    together.levels = {k: name for name, k in number.items()}
    for rows in together.poses.values():
        rows.sort(key=lambda row: row[0])
    counts: dict[str, int] = {}
    for k, order in enumerate(together.orders):
        counts[order.name] = counts.get(order.name, 0) + 1
        if counts[order.name] > 1:
            together.orders[k] = replace(order, name=f"{order.name}_{counts[order.name]}")
    together.orders.sort(key=lambda order: order.release_s)
    return together


def safe_name(name: str) -> str:
    """A name that a file may have."""
    return re.sub(r"[^\w.-]+", "_", name)[:60].strip("._") or "log"
