"""Checks of a log of VDA 5050 messages against the standard: what the official schemas cannot say, since they are open and see one message.

A log is JSON, a message a line: `{"t_s": ..., "topic": ..., "payload": {...}}`, in time order. Checked are headers (counters, time, who
sent it), names and types of members, orders (sequence numbers, the released prefix, updates that begin with the stitching node,
actions), and states (of which order, what is left of it, where the vehicle is). Logs of 2.0 are checked by the rules of 2.1.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from mrp_sumo.errors import listed, nearest
from mrp_sumo.files.reading import json_value

LARGEST_NUMBER = 1e15  # number that can be computed with
NUMBER, INT, TEXT, FLAG, LIST, OBJECT = (int, float), int, str, bool, list, dict
HEADER = {"headerId": int, "timestamp": TEXT, "version": TEXT, "manufacturer": TEXT, "serialNumber": TEXT}
NODE = {"nodeId": TEXT, "sequenceId": int, "released": FLAG, "actions": LIST}
EDGE = {"edgeId": TEXT, "sequenceId": int, "released": FLAG, "actions": LIST}
ENDS = {"startNodeId": TEXT, "endNodeId": TEXT}  # of edges of 2.x
ACTION = {"actionType": TEXT, "actionId": TEXT, "blockingType": TEXT}
STATE = {
    **{"orderId": TEXT, "orderUpdateId": int, "lastNodeId": TEXT, "lastNodeSequenceId": int, "nodeStates": LIST, "edgeStates": LIST},
    **{"driving": FLAG, "actionStates": LIST, "operatingMode": TEXT, "errors": LIST, "safetyState": OBJECT},
}
OF_BOTH: dict[str, dict[str, Any]] = {  # members that must be there, by kind
    "order": {"orderId": TEXT, "orderUpdateId": int, "nodes": LIST, "edges": LIST},
    "state": STATE,
    "instantActions": {"actions": LIST},
    "connection": {"connectionState": TEXT},
    "visualization": {},
    "factsheet": {"typeSpecification": OBJECT, "physicalParameters": OBJECT},
}
NEEDED: dict[str, dict[str, dict[str, Any]]] = {  # by version, too
    "2": {**OF_BOTH, "state": {**STATE, "batteryState": OBJECT}},
    "3": {
        **OF_BOTH,
        "state": {**STATE, "powerSupply": OBJECT, "instantActionStates": LIST},
        "visualization": {"referenceStateHeaderId": int},
    },
}
ALLOWED: dict[str, dict[str, tuple[str, ...]]] = {  # and those that may be, where a misspelt one would pass unnoticed
    "2": {
        "order": ("zoneSetId",),
        "node": ("nodeDescription", "nodePosition"),
        "edge": (
            *("edgeDescription", "startNodeId", "endNodeId", "maxSpeed", "maxHeight", "minHeight", "orientation", "orientationType"),
            *("direction", "rotationAllowed", "maxRotationSpeed", "length", "trajectory", "corridor"),
        ),
        "state": (
            *("maps", "zoneSetId", "paused", "newBaseRequest", "distanceSinceLastNode", "agvPosition", "velocity", "loads", "information"),
        ),
        "visualization": ("agvPosition", "velocity"),
    },
    "3": {
        "order": ("orderDescription", "orderDescriptor"),
        "node": ("nodeDescriptor", "nodePosition"),
        "edge": (
            *("edgeDescriptor", "maximumSpeed", "maximumMobileRobotHeight", "minimumLoadHandlingDeviceHeight", "orientation"),
            *("orientationType", "direction", "reachOrientationBeforeEntering", "maximumRotationSpeed", "maxRotationSpeed", "length"),
            *("trajectory", "corridor"),
        ),
        "state": (
            *("maps", "zoneSets", "plannedPath", "intermediatePath", "mobileRobotPosition", "velocity", "loads", "paused"),
            *("newBaseRequest", "zoneRequests", "edgeRequests", "distanceSinceLastNode", "zoneActionStates", "information"),
        ),
        "visualization": ("plannedPath", "intermediatePath", "mobileRobotPosition", "velocity"),
    },
}
CONNECTIONS = {
    "2": ("ONLINE", "OFFLINE", "CONNECTIONBROKEN"),
    "3": ("ONLINE", "OFFLINE", "HIBERNATING", "CONNECTION_BROKEN"),
}
STATUS = ("WAITING", "INITIALIZING", "RUNNING", "PAUSED", "RETRIABLE", "FINISHED", "FAILED")
OVER = ("FINISHED", "FAILED")
STAMP = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{1,9})?Z")
OFF_ROUTE_M = 0.5  # from the straight line between the nodes around a vehicle, besides a share of its length
OFF_RAD = 0.1  # from the heading of a node, besides the deviation that it allows
STILL_THERE_M = 0.1  # of a node
OFF_SHARE = 0.25
MOST_SILENT_S = 31.0  # between states
MOST_LATE_S = 2.0  # that a vehicle still speaks of the order before
SPARE = 1.5  # of the speed that a factsheet names
LONGEST_LINE = 8 * 2**20
WORDS = 60  # of what a message shows


@dataclass(frozen=True)
class MessageFault:
    """A fault of a message and its place: the number of the line, the topic, and the path within the payload."""

    line: int
    topic: str
    text: str

    def __str__(self) -> str:
        return f"line {self.line}: {self.topic}: {self.text}"


@dataclass
class _Vehicle:
    """What a log has said of one vehicle so far."""

    header: dict[str, tuple[int, str]] = field(default_factory=dict)  # last headerId and timestamp of each kind
    order_id: str = ""
    update: int = -1
    base: dict[int, Any] = field(default_factory=dict)  # released nodes and edges by sequence number
    ahead: dict[int, Any] = field(default_factory=dict)  # those that are not
    before: tuple[str, int, dict[int, Any], dict[int, Any]] = ("", 0, {}, {})  # the same of the order or update before
    ordered_s: float = -math.inf  # when the last came
    old_orders: set[str] = field(default_factory=set)
    actions: dict[str, Any] = field(default_factory=dict)  # by identifier: where it is to be done
    instant: set[str] = field(default_factory=set)
    status: dict[str, str] = field(default_factory=dict)
    state_header: int | None = None
    state_s: float | None = None
    passed: int = -1  # sequence number of the last node
    online: bool = False
    top_mps: float = math.inf
    seen: tuple[float, float, float, object] | None = None  # time, place and map


def check(lines: Iterable[str]) -> Iterator[MessageFault]:
    """Faults of a log, in its order."""
    vehicles: dict[tuple[str, str], _Vehicle] = {}
    last_s = -math.inf
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        entry = _read(line)
        if isinstance(entry, str):
            yield MessageFault(number, "?", entry)
            continue
        t_s, topic, payload = entry
        if t_s < last_s:
            yield MessageFault(number, topic, f"t_s {t_s:g} comes after {last_s:g}")
        last_s = max(last_s, t_s)
        parts = topic.split("/")
        if len(parts) != 5 or not re.fullmatch(r"v\d+", parts[1]):
            yield MessageFault(number, topic[:WORDS], "expected a topic INTERFACE/vN/MANUFACTURER/SERIAL/KIND")
            continue
        rules = "3" if parts[1] == "v3" else "2"
        if parts[4] not in NEEDED[rules]:
            if parts[4] not in ("zoneSet", "responses"):
                yield MessageFault(number, topic, f"'{parts[4][:WORDS]}' is no kind of message{nearest(parts[4][:WORDS], NEEDED[rules])}")
            continue
        vehicle = vehicles.setdefault((parts[2], parts[3]), _Vehicle())
        for text in _Message(rules, parts, t_s, payload, vehicle).faults():
            yield MessageFault(number, topic, text)


def _read(line: str) -> tuple[float, str, Mapping[str, Any]] | str:
    if len(line) > LONGEST_LINE:
        return f"a line of {len(line)} characters; more than {LONGEST_LINE} are not read"
    try:
        document = json_value(line, largest=LARGEST_NUMBER)
    except (ValueError, RecursionError):
        return f"not JSON with numbers up to {LARGEST_NUMBER:g}"
    if not isinstance(document, dict):
        return "expected an object with t_s, topic and payload"
    t_s, topic, payload = (document.get(key) for key in ("t_s", "topic", "payload"))
    if type(t_s) not in NUMBER or not isinstance(topic, str) or not isinstance(payload, dict):
        return "expected a number t_s, text topic and an object payload"
    return float(t_s or 0), topic, payload


@dataclass
class _Message:
    """A message, and what came before."""

    rules: str
    parts: list[str]
    t_s: float
    payload: Mapping[str, Any]
    vehicle: _Vehicle

    @property
    def kind(self) -> str:
        return self.parts[4]

    @property
    def place(self) -> Any:
        """Position of the vehicle, as it is said."""
        return self.payload.get("mobileRobotPosition" if self.rules == "3" else "agvPosition")

    def faults(self) -> Iterator[str]:
        needed = HEADER | NEEDED[self.rules][self.kind]
        if self.rules == "2" and self.kind in ("visualization", "factsheet"):  # whose headers may lack these
            needed = {key: kind for key, kind in needed.items() if key in self.payload or key not in ("headerId", "timestamp")}
        wrong = list(members(self.payload, needed, "", ALLOWED[self.rules].get(self.kind)))
        yield from wrong
        yield from self._header()
        if not wrong and (judge := getattr(self, f"_{self.kind}", None)):
            yield from judge()

    def _header(self) -> Iterator[str]:
        payload, vehicle = self.payload, self.vehicle
        for key, part in (("manufacturer", 2), ("serialNumber", 3)):
            if isinstance(payload.get(key), str) and payload[key] != self.parts[part]:
                yield f"{key} '{payload[key][:WORDS]}', but the topic says '{self.parts[part][:WORDS]}'"
        version = payload.get("version")
        if isinstance(version, str) and not version.startswith(f"{self.parts[1][1:]}."):
            yield f"version '{version[:WORDS]}', but the topic says {self.parts[1]}"
        number, stamp = payload.get("headerId"), payload.get("timestamp")
        if isinstance(stamp, str) and not STAMP.fullmatch(stamp):
            yield f"timestamp '{stamp[:WORDS]}', expected YYYY-MM-DDTHH:mm:ss.fffZ"
            stamp = None
        if type(number) is not int or not isinstance(stamp, str):
            return
        if self.kind in vehicle.header:
            before, when = vehicle.header[self.kind]
            if number != before + 1:
                yield f"headerId {number} follows {before}, expected {before + 1}"
            if stamp[:-1] < when[:-1]:  # without the Z, which comes behind digits
                yield f"timestamp {stamp} is before {when}, that of the message before"
        vehicle.header[self.kind] = number, stamp

    def _connection(self) -> Iterator[str]:
        said = self.payload["connectionState"]
        if said not in CONNECTIONS[self.rules]:
            yield f"connectionState '{said[:WORDS]}'{nearest(said[:WORDS], CONNECTIONS[self.rules])}"
        self.vehicle.online = said == "ONLINE"

    def _factsheet(self) -> Iterator[str]:
        about = self.payload["physicalParameters"]
        top = about.get("maximumSpeed" if self.rules == "3" else "speedMax")
        if type(top) in NUMBER and top > 0:
            self.vehicle.top_mps = float(top)
        return iter(())

    def _instantActions(self) -> Iterator[str]:
        for i, action in enumerate(self.payload["actions"]):
            wrong = list(members(action, ACTION, f"actions[{i}]"))
            yield from wrong
            if not wrong:
                if action["actionId"] in self.vehicle.instant:
                    yield f"actions[{i}].actionId '{action['actionId'][:WORDS]}' was used before"
                self.vehicle.instant.add(action["actionId"])

    def _order(self) -> Iterator[str]:
        nodes, edges = self.payload["nodes"], self.payload["edges"]
        ends = ENDS if self.rules == "2" else {}
        wrong = [
            text
            for what, items, needed in (("node", nodes, NODE), ("edge", edges, EDGE | ends))
            for i, one in enumerate(items)
            for text in members(one, needed, f"{what}s[{i}]", ALLOWED[self.rules][what])
        ]
        yield from wrong
        if not wrong:
            yield from disorder(nodes, edges, has_ends=self.rules == "2")
        if wrong or len(edges) != len(nodes) - 1:
            return
        yield from self._succession(nodes)
        yield from self._kept(nodes, edges)

    def _succession(self, nodes: list[Any]) -> Iterator[str]:
        """How an order follows the one before."""
        payload, vehicle = self.payload, self.vehicle
        first = nodes[0]
        if payload["orderId"] != vehicle.order_id:
            if payload["orderId"] in vehicle.old_orders:
                yield f"orderId '{payload['orderId'][:WORDS]}' was used before"
            if vehicle.order_id and (vehicle.ahead or vehicle.passed < max(vehicle.base, default=0)):
                yield f"a new order, though '{vehicle.order_id[:WORDS]}' is not done"
            if payload["orderUpdateId"] != 0:
                yield f"orderUpdateId is {payload['orderUpdateId']} of a new order, expected 0"
            return
        if payload["orderUpdateId"] != vehicle.update + 1:
            yield f"orderUpdateId {payload['orderUpdateId']} follows {vehicle.update}, expected {vehicle.update + 1}"
        stitch = max((s for s in vehicle.base if s % 2 == 0), default=0)
        if first["sequenceId"] != stitch:
            yield f"nodes[0].sequenceId is {first['sequenceId']}, expected {stitch}, the end of the base"
        elif _plain(first) != _plain(vehicle.base.get(stitch, first)):
            yield f"nodes[0] is another than the node that ends the base, '{vehicle.base[stitch].get('nodeId')}'"

    def _kept(self, nodes: list[Any], edges: list[Any]) -> Iterator[str]:
        """Note the order; actions have identifiers of their own."""
        payload, vehicle = self.payload, self.vehicle
        vehicle.before, vehicle.ordered_s = (vehicle.order_id, vehicle.update, dict(vehicle.base), vehicle.ahead), self.t_s
        if payload["orderId"] != vehicle.order_id:
            vehicle.old_orders.add(vehicle.order_id)
            vehicle.base, vehicle.passed = {}, nodes[0]["sequenceId"]
        vehicle.order_id, vehicle.update = payload["orderId"], payload["orderUpdateId"]
        both = [*nodes, *edges]
        vehicle.base |= {one["sequenceId"]: one for one in both if one["released"]}
        vehicle.ahead = {one["sequenceId"]: one for one in both if not one["released"]}
        for one in both:
            place = (vehicle.order_id, one["sequenceId"])
            for action in one["actions"]:
                wrong = list(members(action, ACTION, "actions"))
                yield from wrong
                if not wrong and vehicle.actions.setdefault(action["actionId"], place) != place:
                    yield f"actionId '{action['actionId'][:WORDS]}' was used before"

    def _state(self) -> Iterator[str]:
        payload, vehicle = self.payload, self.vehicle
        if not vehicle.online:
            yield "a state of a vehicle that is not online"
        if vehicle.state_s is not None and self.t_s - vehicle.state_s > MOST_SILENT_S:
            yield f"{self.t_s - vehicle.state_s:.1f} s after the state before, expected 30 s at most"
        vehicle.state_s, vehicle.state_header = self.t_s, payload["headerId"]
        if vehicle.header.get("order") is not None:  # a log may begin in the midst of an order
            yield from self._progress()
        yield from self._action_states()
        if _is_at(self.place, "xy"):
            if payload["orderId"] == vehicle.order_id:
                yield from self._whereabouts(float(self.place["x"]), float(self.place["y"]))
            yield from self._motion(self.place)

    def _progress(self) -> Iterator[str]:
        payload, vehicle = self.payload, self.vehicle
        order_id, update, base, ahead = vehicle.order_id, vehicle.update, vehicle.base, vehicle.ahead
        if self._crosses_order():
            order_id, update, base, ahead = vehicle.before
            if not order_id:
                return
        if payload["orderId"] != order_id:
            yield f"orderId '{payload['orderId'][:WORDS]}', but the order is '{order_id[:WORDS]}'"
            return
        if payload["orderUpdateId"] != update:
            yield f"orderUpdateId {payload['orderUpdateId']}, but the update is {update}"
            return
        last = payload["lastNodeSequenceId"]
        if last not in base or last % 2:
            yield f"lastNodeSequenceId is {last}, which is no node of the base: it was not released"
            return
        if base[last].get("nodeId") != payload["lastNodeId"]:
            yield f"lastNodeId '{payload['lastNodeId'][:WORDS]}', but node {last} is '{base[last].get('nodeId')}'"
        if order_id == vehicle.order_id:
            if last < vehicle.passed:
                yield f"lastNodeSequenceId {last} follows {vehicle.passed}"
            elif last > vehicle.passed:
                yield from self._heading(base[last])
            vehicle.passed = max(vehicle.passed, last)
        whole = {**base, **ahead}
        for key, parity in (("nodeStates", 0), ("edgeStates", 1)):
            name = "nodeId" if parity == 0 else "edgeId"
            left = [(s, whole[s].get(name), whole[s]["released"]) for s in sorted(whole) if s > last and s % 2 == parity]
            said = [(one.get("sequenceId"), one.get(name), one.get("released")) for one in payload[key] if isinstance(one, Mapping)]
            if said != left:
                yield f"{key} are {_listed(said)}, but of the order are left {_listed(left)}"

    def _crosses_order(self) -> bool:
        """True if a state may have been sent before the vehicle had the last order: it is of the one before, which was a moment ago."""
        payload, vehicle = self.payload, self.vehicle
        said = payload["orderId"], payload["orderUpdateId"]
        is_new = self.t_s - vehicle.ordered_s > MOST_LATE_S
        return (
            not is_new and said != (vehicle.order_id, vehicle.update) and (said == vehicle.before[:2] or said[0] == "" == vehicle.before[0])
        )

    def _action_states(self) -> Iterator[str]:
        vehicle = self.vehicle
        for key in ("actionStates", "instantActionStates"):
            for i, one in enumerate(self.payload.get(key) or ()):
                wrong = list(members(one, {"actionId": TEXT, "actionStatus": TEXT}, f"{key}[{i}]"))
                yield from wrong
                if wrong:
                    continue
                name, status = one["actionId"], one["actionStatus"]
                if name not in vehicle.actions and name not in vehicle.instant and "order" in vehicle.header:
                    yield f"{key}[{i}].actionId '{name[:WORDS]}' is none that was sent"
                if status not in STATUS:
                    yield f"{key}[{i}].actionStatus '{status[:WORDS]}'{nearest(status[:WORDS], STATUS)}"
                elif vehicle.status.get(name) in OVER and status != vehicle.status[name]:
                    yield f"{key}[{i}]: '{name[:WORDS]}' is {status} after {vehicle.status[name]}"
                vehicle.status[name] = status

    def _heading(self, node: Mapping[str, Any]) -> Iterator[str]:
        """A vehicle faces as a node says before it has passed it; one that is on already when it says so may have turned since."""
        wanted: Any = node.get("nodePosition")
        place = self.place
        if not (_is_at(wanted, ("x", "y", "theta")) and _is_at(place, ("x", "y", "theta"))):
            return
        allowed = wanted.get("allowedDeviationTheta", 0.0)
        off = abs(math.remainder(place["theta"] - wanted["theta"], 2 * math.pi))
        is_there = math.hypot(place["x"] - wanted["x"], place["y"] - wanted["y"]) < STILL_THERE_M
        if is_there and off > OFF_RAD + (abs(allowed) if type(allowed) in NUMBER else 0.0):
            yield f"theta is {place['theta']:g} at '{str(node.get('nodeId'))[:WORDS]}', whose theta is {wanted['theta']:g}"

    def _whereabouts(self, x: float, y: float) -> Iterator[str]:
        """A vehicle is at its last node, or on the way from there to the next."""
        vehicle = self.vehicle
        if vehicle.passed not in vehicle.base:
            return
        ends = [vehicle.base[s].get("nodePosition") for s in (vehicle.passed, vehicle.passed + 2) if s in vehicle.base]
        places = [(float(p["x"]), float(p["y"])) for p in ends if _is_at(p, "xy")]
        if len(places) != len(ends):
            return
        (ax, ay), (bx, by) = places[0], places[-1]
        long = math.hypot(bx - ax, by - ay)
        share = max(0.0, min(1.0, ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / long**2)) if long > 0 else 0.0
        off = math.hypot(x - ax - share * (bx - ax), y - ay - share * (by - ay))
        if off > OFF_ROUTE_M + OFF_SHARE * long:
            yield f"at ({x:g}, {y:g}), {off:.2f} m off the way from '{self.payload['lastNodeId'][:WORDS]}'"

    def _motion(self, place: Mapping[str, Any]) -> Iterator[str]:
        """No vehicle is faster than its factsheet says, unless a lift takes it to another map."""
        x, y, vehicle = float(place["x"]), float(place["y"]), self.vehicle
        now_s = seconds_of(self.payload.get("timestamp"))  # as the vehicle says: messages may be late
        if now_s is None:
            return
        if vehicle.seen is not None and vehicle.seen[3] == place.get("mapId"):
            since_s = now_s - vehicle.seen[0]
            far = math.hypot(x - vehicle.seen[1], y - vehicle.seen[2])
            if far > SPARE * vehicle.top_mps * since_s + 0.2:
                yield f"{far:.2f} m from where it was {since_s:.2f} s before, faster than {vehicle.top_mps:g} m/s"
        vehicle.seen = now_s, x, y, place.get("mapId")

    def _visualization(self) -> Iterator[str]:
        payload, vehicle = self.payload, self.vehicle
        if self.rules == "3" and vehicle.state_header is not None and payload["referenceStateHeaderId"] != vehicle.state_header:
            yield f"referenceStateHeaderId is {payload['referenceStateHeaderId']}, but the last state is {vehicle.state_header}"
        if _is_at(self.place, "xy"):
            yield from self._motion(self.place)


def _is_at(place: Any, keys: Sequence[str]) -> bool:
    """True for a position with numbers under these keys."""
    return isinstance(place, Mapping) and all(type(place.get(key)) in NUMBER for key in keys)


def seconds_of(stamp: object) -> float | None:
    """A timestamp in s since 1970; None for what is none."""
    if not isinstance(stamp, str) or not STAMP.fullmatch(stamp):
        return None
    try:
        return datetime.fromisoformat(stamp).timestamp()
    except ValueError:
        return None


def disorder(nodes: list[Any], edges: list[Any], *, has_ends: bool) -> Iterator[str]:
    """Faults in how nodes and edges of an order follow each other, and in its base; `has_ends` where edges name their nodes."""
    if not nodes:
        yield "nodes: an order has one at least"
        return
    if len(edges) != len(nodes) - 1:
        yield f"{len(edges)} edges, expected {len(nodes) - 1} for {len(nodes)} nodes"
        return
    first, released = nodes[0]["sequenceId"], [node["released"] for node in nodes]
    if first % 2:
        yield f"nodes[0].sequenceId is {first}, expected an even number"
    for what, items, begin in (("nodes", nodes, first), ("edges", edges, first + 1)):
        for i, one in enumerate(items):
            if one["sequenceId"] != begin + 2 * i:
                yield f"{what}[{i}].sequenceId is {one['sequenceId']}, expected {begin + 2 * i}"
                break
    if not released[0]:
        yield "nodes[0].released is false: an order begins in its base"
    behind = [i for i in range(1, len(nodes)) if released[i] and not released[i - 1]]
    if behind:
        yield f"nodes[{behind[0]}].released is true behind one that is not: the base is what comes first"
    yield from _disorder_of_edges(nodes, edges, released, has_ends)


def _disorder_of_edges(nodes: list[Any], edges: list[Any], released: list[bool], has_ends: bool) -> Iterator[str]:
    for i, edge in enumerate(edges):
        if edge["released"] != (released[i] and released[i + 1]):
            yield f"edges[{i}].released is {str(edge['released']).lower()}, though its nodes say otherwise"
            break
    for i, edge in enumerate(edges if has_ends else ()):
        for key, node in (("startNodeId", nodes[i]), ("endNodeId", nodes[i + 1])):
            if edge[key] != node["nodeId"]:
                yield f"edges[{i}].{key} is '{edge[key][:WORDS]}', but the node there is '{node['nodeId'][:WORDS]}'"


def members(document: Any, needed: Mapping[str, Any], at: str, allowed: tuple[str, ...] | None = None) -> Iterator[str]:
    """Faults of the members of an object; with `allowed`, also those of an unknown name."""
    if not isinstance(document, Mapping):
        yield f"{at}: expected an object".removeprefix(": ")
        return
    inside = f"{at}." if at else ""
    for key, kind in needed.items():
        if key not in document:
            yield f"{inside}{key} is missing"
            continue
        value = document[key]
        right = type(value) is int if kind is int else isinstance(value, kind) and not (kind == NUMBER and isinstance(value, bool))
        if not right:
            yield f"{inside}{key} is {str(value)[:WORDS]}, expected {_NAMES[kind]}"
        elif kind is int and value < 0:
            yield f"{inside}{key} is {value}, expected 0 or more"
    for key in document if allowed is not None else ():
        if key not in needed and key not in (*HEADER, *(allowed or ())):
            yield f"{inside}{str(key)[:WORDS]} is unknown{nearest(str(key)[:WORDS], [*needed, *(allowed or ())])}"


_NAMES: dict[Any, str] = {
    int: "a whole number",
    TEXT: "text",
    FLAG: "true or false",
    LIST: "an array",
    OBJECT: "an object",
    NUMBER: "a number",
}


def _plain(one: Mapping[str, Any]) -> Any:
    """What may not change of a node that was released."""
    return {key: value for key, value in one.items() if key not in ("nodeDescriptor", "nodeDescription")}


def _listed(items: list[Any]) -> str:
    return listed([f"{sequence} {str(name)[:20]}{'' if released else ' (horizon)'}" for sequence, name, released in items], 3) or "none"
