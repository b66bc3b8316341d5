"""Streams of VDA 5050 messages that were recorded at a broker: who drove where, when.

A log is a JSON object a line, `{"t_s": ..., "topic": ..., "payload": {...}}`, in any order of time. Read are states, visualizations, orders
(where their nodes are) and factsheets, of 2.x and 3.x; other kinds are left out. Times are the vehicles' own timestamps. What is not as
the standard has it is refused with line and JSON path: `mrp-sumo validate --vda5050` lists all there is.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.reading import json_value, require_regular, shortened
from mrp_sumo.formats.vda.check import FLAG, INT, LARGEST_NUMBER, LONGEST_LINE, NUMBER, OBJECT, TEXT, WORDS, members, seconds_of
from mrp_sumo.formats.vda.factsheet import BODY, FIGURES, word

LARGEST_LOG = 2**40  # bytes; a line is read at a time
READ = ("state", "visualization", "order", "factsheet")
LARGEST_M = 1e7


@dataclass
class Recorded:
    """Messages of one vehicle in a log, by time."""

    serial: str
    t_s: list[float] = field(default_factory=list)  # of poses, in s since 1970
    x_m: list[float] = field(default_factory=list)
    y_m: list[float] = field(default_factory=list)
    yaw_rad: list[float] = field(default_factory=list)
    speed_mps: list[float] = field(default_factory=list)  # NaN: not said
    map_id: list[str] = field(default_factory=list)
    passed: list[tuple[float, str, str, int]] = field(default_factory=list)  # time, node, order and sequence number of each new last node
    errors: dict[tuple[str, str], list[tuple[float, float]]] = field(default_factory=dict)  # type and text -> from, until
    percent: list[tuple[float, float]] = field(default_factory=list)  # time, state of charge
    body: dict[str, float] = field(default_factory=dict)  # of the factsheet: length_m, width_m, max_speed_mps, ...


@dataclass
class RecordedLog:
    """A log as a whole."""

    vehicles: dict[str, Recorded] = field(default_factory=dict)  # by manufacturer/serial number
    nodes: dict[str, tuple[float, float, str]] = field(default_factory=dict)  # where orders have them
    edges: set[tuple[str, str]] = field(default_factory=set)


def read_log(path: Path) -> RecordedLog:
    """Read a log.

    Raises MrpSumoError for a line that is no such message, with its number; for a log without a vehicle that says where it is.
    """
    require_regular(path, LARGEST_LOG)
    log, name = RecordedLog(), shortened(path)
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE + 1), ""), 1):
            if line.strip():
                _read_line(log, line, f"{name}:{number}")
    log.vehicles = {key: vehicle for key, vehicle in sorted(log.vehicles.items()) if vehicle.t_s}
    if not log.vehicles:
        raise MrpSumoError(f"{name}: no state or visualization says where a vehicle is")
    return log


def _read_line(log: RecordedLog, line: str, where: str) -> None:
    try:
        document = json_value(line, largest=LARGEST_NUMBER)
    except (ValueError, RecursionError):
        raise MrpSumoError(f"{where}: not JSON" + (", or longer than is read" if len(line) > LONGEST_LINE else "")) from None
    _require(document, {"topic": TEXT, "payload": OBJECT}, "", where)
    parts, payload = document["topic"].split("/"), document["payload"]
    if len(parts) < 3 or parts[-1] not in READ:
        return
    is_new = any(part.startswith("v3") for part in parts[:-3])
    vehicle = log.vehicles.setdefault("/".join(parts[-3:-1]), Recorded(parts[-2]))
    if parts[-1] == "order":
        _read_order(log, payload, where)
    elif parts[-1] == "factsheet":
        _read_factsheet(vehicle, payload, is_new)
    else:
        now_s = seconds_of(payload.get("timestamp"))
        if now_s is None:
            raise MrpSumoError(f"{where}: payload.timestamp: expected YYYY-MM-DDTHH:mm:ss.fffZ")
        _read_pose(vehicle, payload, now_s, is_new, where)
        if parts[-1] == "state":
            _read_state(vehicle, payload, now_s, is_new, where)


def _read_pose(vehicle: Recorded, payload: Mapping[str, Any], now_s: float, is_new: bool, where: str) -> None:
    key = "mobileRobotPosition" if is_new else "agvPosition"
    place = payload.get(key)
    if place is None or (vehicle.t_s and now_s < vehicle.t_s[-1]):  # not said, or overtaken on the way
        return
    _require(place, {"x": NUMBER, "y": NUMBER, "theta": NUMBER, "mapId": TEXT}, f"payload.{key}", where)
    if not (abs(place["x"]) < LARGEST_M and abs(place["y"]) < LARGEST_M and abs(place["theta"]) < LARGEST_M):
        raise MrpSumoError(f"{where}: payload.{key} is beyond {LARGEST_M:g} m")
    velocity = payload.get("velocity")
    vx, vy = (velocity.get(k, math.nan) for k in ("vx", "vy")) if isinstance(velocity, dict) else (math.nan, math.nan)
    speed = math.hypot(vx, vy) if all(type(v) in (int, float) and abs(v) < LARGEST_M for v in (vx, vy)) else math.nan
    if vehicle.t_s and now_s == vehicle.t_s[-1]:
        return  # a state and a visualization of one moment
    vehicle.t_s.append(now_s)
    vehicle.x_m.append(float(place["x"]))
    vehicle.y_m.append(float(place["y"]))
    vehicle.yaw_rad.append(float(place["theta"]))
    vehicle.speed_mps.append(speed)
    vehicle.map_id.append(place["mapId"])


def _read_state(vehicle: Recorded, payload: Mapping[str, Any], now_s: float, is_new: bool, where: str) -> None:
    _require(payload, {"lastNodeId": TEXT, "lastNodeSequenceId": INT, "orderId": TEXT}, "payload", where)
    passed = (payload["lastNodeId"], payload["orderId"], payload["lastNodeSequenceId"])
    if passed[0] and (not vehicle.passed or vehicle.passed[-1][1:] != passed):
        vehicle.passed.append((now_s, *passed))
    listed = payload.get("errors")
    named = {
        (error["errorType"][:WORDS], str(error.get("errorDescription", ""))[:200])
        for error in (listed if isinstance(listed, list) else ())
        if isinstance(error, dict) and isinstance(error.get("errorType"), str)
    }
    for key in sorted(named):
        spans = vehicle.errors.setdefault(key, [])
        if not spans or spans[-1][1] < math.inf:
            spans.append((now_s, math.inf))
    for key, spans in vehicle.errors.items():
        if key not in named and spans[-1][1] == math.inf:
            spans[-1] = (spans[-1][0], now_s)
    power = payload.get("powerSupply" if is_new else "batteryState")
    level: Any = power.get("stateOfCharge" if is_new else "batteryCharge") if isinstance(power, dict) else None
    if type(level) in (int, float) and 0 <= level <= 100:
        vehicle.percent.append((now_s, float(level)))


def _read_order(log: RecordedLog, payload: Mapping[str, Any], where: str) -> None:
    _require(payload, {"nodes": list}, "payload", where)
    names = []
    for i, node in enumerate(payload["nodes"]):
        at = f"payload.nodes[{i}]"
        _require(node, {"nodeId": TEXT, "released": FLAG}, at, where)
        names.append(node["nodeId"])
        place = node.get("nodePosition")
        if place is not None:
            _require(place, {"x": NUMBER, "y": NUMBER, "mapId": TEXT}, f"{at}.nodePosition", where)
            if abs(place["x"]) < LARGEST_M and abs(place["y"]) < LARGEST_M:
                log.nodes.setdefault(node["nodeId"], (float(place["x"]), float(place["y"]), place["mapId"]))
    log.edges |= set(itertools.pairwise(names))


def _read_factsheet(vehicle: Recorded, payload: Mapping[str, Any], is_new: bool) -> None:
    about = payload.get(BODY)
    for name, member in FIGURES.items():
        value: Any = about.get(word(BODY, member, is_new)) if isinstance(about, dict) else None
        if type(value) in (int, float) and 0 < value < 1e3:
            vehicle.body[name] = float(value)


def _require(document: Any, needed: Mapping[str, Any], at: str, where: str) -> None:
    for text in members(document, needed, at):
        raise MrpSumoError(f"{where}: {text}")
