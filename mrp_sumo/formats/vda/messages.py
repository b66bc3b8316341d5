"""Messages of VDA 5050, versions 2.1 and 3.0: what they are called, and how their parts are put together.

Written against the text and schemas of github.com/VDA5050/VDA5050, tags 2.1.0 and 3.0.0. Both versions say the same with other words:
those who make messages say things once, and a `Dialect` knows the words.
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.names import distinct

Json = dict[str, Any]

VERSIONS = ("2.1", "3.0")
AS_2_1 = "2.0"  # which lacks a few optional members of 2.1, and is taken for it under its own number
KINDS = ("connection", "factsheet", "instantActions", "order", "state", "visualization")
MANUFACTURER = "mrp_sumo"
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)  # of simulated time
SERIAL = re.compile(r"[A-Za-z0-9_.:-]+")  # section 6.1.2 of 2.1, and as it says, names of folders besides
STANDING_MPS = 0.01


@dataclass(frozen=True)
class Dialect:
    """The words of a version."""

    version: str  # '2.1' or '3.0'; '2.0' is the first under another number

    def __post_init__(self) -> None:
        if self.version not in (*VERSIONS, AS_2_1):
            raise MrpSumoError(f"VDA 5050 {self.version}: expected {AS_2_1}, {' or '.join(VERSIONS)}")

    @property
    def is_new(self) -> bool:
        return self.version == "3.0"

    def topic(self, serial: str, kind: str, manufacturer: str = MANUFACTURER) -> str:
        head = "vda5050/v3" if self.is_new else "uagv/v2"
        return f"{head}/{manufacturer}/{serial}/{kind}"

    def place(self, x_m: float, y_m: float, yaw_rad: float, map_id: str, *, known: bool = True) -> Json:
        """Position of a vehicle, and whether it knows that itself."""
        return {
            **{"x": _short(x_m), "y": _short(y_m), "theta": _angle(yaw_rad), "mapId": map_id},
            "localized" if self.is_new else "positionInitialized": known,
        }

    @property
    def place_key(self) -> str:
        return "mobileRobotPosition" if self.is_new else "agvPosition"

    def power(self, percent: float, charging: bool) -> tuple[str, Json]:
        """State of charge, and the name it goes by."""
        if self.is_new:
            return "powerSupply", {"stateOfCharge": _short(percent), "charging": charging}
        return "batteryState", {"batteryCharge": _short(percent), "charging": charging}

    def safety(self, stopped: bool, violated: bool) -> Json:
        """The safety state of a vehicle; an emergency stop has to be acknowledged at it."""
        return {"activeEmergencyStop" if self.is_new else "eStop": "MANUAL" if stopped else "NONE", "fieldViolation": violated}

    def edge(self, sequence: int, released: bool, ends: tuple[str, str], length_m: float, limit_mps: float, backward: bool = False) -> Json:
        """An edge of an order, between two nodes, by which it is named."""
        document: Json = {"edgeId": f"{ends[0]}->{ends[1]}", "sequenceId": sequence, "released": released}
        if not self.is_new:
            document |= {"startNodeId": ends[0], "endNodeId": ends[1]}
        if math.isfinite(limit_mps):
            document["maximumSpeed" if self.is_new else "maxSpeed"] = _short(limit_mps)
        if backward:
            document |= {"orientation": 3.14159265, "orientationType": "TANGENTIAL"}
        return document | {"length": _short(length_m), "actions": []}


@dataclass
class Sender:
    """Gives messages of one vehicle their headers, which count for each topic."""

    dialect: Dialect
    serial: str
    manufacturer: str = MANUFACTURER
    epoch_s: float = 0.0  # when time 0 is, in s since 1970
    count: dict[str, int] = field(default_factory=dict)  # messages of each kind

    def message(self, kind: str, t_s: float, content: Mapping[str, Any]) -> Json:
        """A payload of a kind at a time."""
        number = self.count.get(kind, 0)
        self.count[kind] = number + 1
        return {
            "headerId": number,
            "timestamp": timestamp(self.epoch_s + t_s),
            "version": f"{self.dialect.version}.0",
            "manufacturer": self.manufacturer,
            "serialNumber": self.serial,
            **content,
        }


def timestamp(t_s: float) -> str:
    """A time as ISO 8601 in UTC, with milliseconds."""
    at = EPOCH + timedelta(milliseconds=round(t_s * 1000))
    return at.strftime("%Y-%m-%dT%H:%M:%S.") + f"{at.microsecond // 1000:03d}Z"


def node(
    name: str, sequence: int, released: bool, xy: Sequence[float], map_id: str, actions: Sequence[Json] = (), yaw_rad: float = math.nan
) -> Json:
    """A node of an order; `yaw_rad` is how a vehicle has to face there, NaN: in any way."""
    heading = {} if math.isnan(yaw_rad) else {"theta": _angle(yaw_rad)}
    position = {"x": _short(xy[0]), "y": _short(xy[1]), **heading, "mapId": map_id}
    return {"nodeId": name, "sequenceId": sequence, "released": released, "nodePosition": position, "actions": list(actions)}


def action(kind: str, name: str, blocking: str = "NONE", **parameters: Any) -> Json:
    """An action; blocking NONE, SOFT or HARD."""
    document: Json = {"actionType": kind, "actionId": name, "blockingType": blocking}
    if parameters:
        document["actionParameters"] = [{"key": key, "value": value} for key, value in parameters.items()]
    return document


@dataclass(frozen=True)
class StateContent:
    """The state that a vehicle reports."""

    order: tuple[str, int]  # its identifier and that of the update
    last: tuple[str, int]  # name and sequence number of the last node
    nodes: list[Json]  # what is left of the order (`states_of`)
    edges: list[Json]
    place: Json  # `Dialect.place`; empty where that is not known
    velocity: Json
    driving: bool
    away_m: float  # from the last node
    actions: list[Json]  # states of the order's actions
    instants: list[Json]  # and of instant ones
    power: tuple[float, bool]  # per cent of the battery, and whether it charges
    errors: list[Json]
    paused: bool = False
    stopped: bool = False  # by an emergency stop
    violated: bool = False  # something is in a protective field
    loads: list[Json] | None = None  # None: the vehicle does not know


def state(dialect: Dialect, of: StateContent) -> Json:
    """The payload of a state, without its header."""
    supply, level = dialect.power(*of.power)
    return {
        "orderId": of.order[0],
        "orderUpdateId": of.order[1],
        "lastNodeId": of.last[0],
        "lastNodeSequenceId": of.last[1],
        "nodeStates": of.nodes,
        "edgeStates": of.edges,
        **({dialect.place_key: of.place} if of.place else {}),
        "velocity": of.velocity,
        **({} if of.loads is None else {"loads": of.loads}),
        "driving": of.driving,
        "paused": of.paused,
        "newBaseRequest": bool(of.nodes) and not of.nodes[0]["released"],
        "distanceSinceLastNode": round(of.away_m, 6),
        **(
            {"actionStates": of.actions, "instantActionStates": of.instants}
            if dialect.is_new
            else {"actionStates": [*of.instants, *of.actions]}
        ),
        supply: level,
        "operatingMode": "AUTOMATIC",
        "errors": of.errors,
        "safetyState": dialect.safety(of.stopped, of.violated),
    }


def states_of(order: Mapping[str, Any], passed: int) -> tuple[list[Json], list[Json]]:
    """Members of a state about the nodes and edges of an order that come after a sequence number."""
    members = ("nodeId", "sequenceId", "released", "nodePosition")
    nodes = [{key: n[key] for key in members if key in n} for n in order["nodes"] if n["sequenceId"] > passed]
    edges = [{key: e[key] for key in ("edgeId", "sequenceId", "released")} for e in order["edges"] if e["sequenceId"] > passed]
    for n in nodes:  # positions of states have no more than these
        if "nodePosition" in n:
            n["nodePosition"] = {key: n["nodePosition"][key] for key in ("x", "y", "theta", "mapId") if key in n["nodePosition"]}
    return nodes, edges


@dataclass(frozen=True)
class VehicleLimits:
    """Of what a vehicle takes; 0: none."""

    payload: int = 0  # bytes
    identifier: int = 0  # characters
    nodes: int = 0
    actions: int = 0  # of a node, an edge, or a message of instant actions


def serials_of(names: Sequence[str]) -> list[str]:
    """Serial numbers for names, of the characters that topics may have; each another, and none with a meaning as a path."""
    return distinct(re.sub(r"[^A-Za-z0-9_.:-]", "_", name)[:60].lstrip(".") or "robot" for name in names)


def line_of(t_s: float, topic: str, payload: Mapping[str, Any]) -> str:
    """A message as a line of a log."""
    return json.dumps({"t_s": t_s, "topic": topic, "payload": payload}, separators=(",", ":"), allow_nan=False) + "\n"


def _short(value: float) -> float:
    return round(float(value), 6)


def _angle(rad: float) -> float:
    """-pi to pi, and within it when rounded."""
    return max(-3.141592, min(3.141592, round(math.remainder(rad, 2 * math.pi), 6)))
