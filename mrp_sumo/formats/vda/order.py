"""Orders and instant actions of VDA 5050 as a vehicle receives them: from bytes that may be anything to checked values, or a refusal.

Nothing is taken on trust: sizes are bounded, every member that is used has its type and range, and what is wrong is named by its JSON path.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from mrp_sumo.files.reading import json_value
from mrp_sumo.formats.vda.check import (
    ACTION,
    EDGE,
    ENDS,
    FLAG,
    HEADER,
    LARGEST_NUMBER,
    LIST,
    NODE,
    NUMBER,
    OBJECT,
    STAMP,
    TEXT,
    WORDS,
    disorder,
    members,
)
from mrp_sumo.formats.vda.errors import Reason, RefusalError
from mrp_sumo.formats.vda.messages import Dialect, Json

LONGEST_PAYLOAD = 2**20  # bytes
LONGEST_ID = 200  # characters
MOST_NODES = 1000
MOST_ACTIONS = 100  # of a node, an edge, or a message of instant actions
MOST_PARAMETERS = 50
LARGEST = 2**32  # of numbers
BLOCKING = (("NONE", "SOFT", "HARD"), ("NONE", "SINGLE", "SOFT", "HARD"))  # in 2.x, and in 3.0
OPTIONAL: dict[str, dict[str, Any]] = {  # members that may be there, with their types
    "node": {"nodePosition": OBJECT, "nodeDescription": TEXT, "nodeDescriptor": TEXT},
    "edge": {
        **dict.fromkeys(("maxSpeed", "maximumSpeed", "maxRotationSpeed", "maximumRotationSpeed", "length", "orientation"), NUMBER),
        **dict.fromkeys(("maxHeight", "minHeight", "maximumMobileRobotHeight", "minimumLoadHandlingDeviceHeight"), NUMBER),
        **dict.fromkeys(("orientationType", "direction", "edgeDescription", "edgeDescriptor"), TEXT),
        **{"rotationAllowed": FLAG, "reachOrientationBeforeEntering": FLAG, "trajectory": OBJECT, "corridor": OBJECT},
    },
    "position": {"theta": NUMBER, "allowedDeviationTheta": NUMBER, "mapDescription": TEXT, "mapDescriptor": TEXT},
    "action": {"actionParameters": LIST, "actionDescription": TEXT, "actionDescriptor": TEXT, "retriable": FLAG},
    "corridor": {"corridorRefPoint": TEXT, "corridorReferencePoint": TEXT, "releaseLossBehavior": TEXT, "releaseRequired": FLAG},
    "order": {"zoneSetId": TEXT, "orderDescription": TEXT, "orderDescriptor": TEXT},
}
PI = 3.14159265359  # as the schemas have it
WORDS_FOR: tuple[dict[str, tuple[str, ...]], ...] = (  # what members may say, where the schemas list it; in 2.x, and in 3.0
    {"corridorRefPoint": ("KINEMATICCENTER", "CONTOUR")},
    {
        "orientationType": ("GLOBAL", "TANGENTIAL"),
        "corridorReferencePoint": ("KINEMATIC_CENTER", "CONTOUR"),
        "releaseLossBehavior": ("STOP", "RETURN"),
    },
)


@dataclass(frozen=True)
class Action:
    """Something to do at a node, on an edge, or at once."""

    kind: str
    name: str
    blocking: str
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def stops(self) -> bool:
        """True where the vehicle stands while it is done."""
        return self.blocking in ("SOFT", "HARD")


@dataclass(frozen=True)
class Node:
    """A node of an order."""

    name: str
    sequence: int
    released: bool
    actions: tuple[Action, ...]
    position: Mapping[str, Any] | None  # x, y, theta and mapId, as sent
    deviation_m: float  # from the position that still counts as being there
    deviation_rad: float  # and from theta

    @property
    def theta_rad(self) -> float:
        """Heading that the vehicle has to have there, NaN: in any way."""
        return math.nan if self.position is None else float(self.position.get("theta", math.nan))

    def is_faced(self, yaw_rad: float, least_rad: float) -> bool:
        """True where a vehicle that faces so does as the node says, within the deviation that it allows, or `least_rad` at least."""
        off_rad = abs(math.remainder(yaw_rad - self.theta_rad, 2 * math.pi))
        return not off_rad > max(least_rad, self.deviation_rad)


@dataclass(frozen=True)
class Edge:
    """An edge of an order."""

    name: str
    sequence: int
    released: bool
    actions: tuple[Action, ...]
    limit_mps: float  # inf: none
    length_m: float  # NaN: not said
    ends: tuple[str, str] | None  # names of its nodes, which 2.1 says
    has_trajectory: bool


@dataclass(frozen=True)
class Order:
    """An order, or an update of one."""

    name: str
    update: int
    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]
    zone_set: str
    document: Json  # as it was sent

    @property
    def references(self) -> dict[str, object]:
        return {"orderId": self.name, "orderUpdateId": self.update}


def read_document(payload: bytes) -> Json:
    """The object that a message is. Raises RefusalError for what is too large, not JSON, or no object."""
    if len(payload) > LONGEST_PAYLOAD:
        raise RefusalError(Reason.TOO_LARGE, f"a payload of {len(payload)} bytes; more than {LONGEST_PAYLOAD} are not read")
    try:
        document = json_value(payload, largest=LARGEST_NUMBER)
    except (ValueError, RecursionError):
        raise RefusalError(Reason.MALFORMED, f"not JSON with numbers up to {LARGEST_NUMBER:g}") from None
    if not isinstance(document, dict):
        raise RefusalError(Reason.MALFORMED, "expected an object")
    return document


def check_header(document: Json, dialect: Dialect, manufacturer: str, serial: str) -> None:
    """Refuse messages of another version, for another vehicle, or of no time."""
    _require(document, HEADER, "")
    for key, expected in (("manufacturer", manufacturer), ("serialNumber", serial)):
        if document[key] != expected:
            raise RefusalError(
                Reason.MALFORMED, f"{key} is '{document[key][:WORDS]}', expected '{expected}'", {"headerId": document["headerId"]}
            )
    if not STAMP.fullmatch(document["timestamp"]):
        raise RefusalError(Reason.MALFORMED, f"timestamp is '{document['timestamp'][:WORDS]}', expected YYYY-MM-DDTHH:mm:ss.fffZ")
    major = dialect.version.partition(".")[0]
    if document["version"].partition(".")[0] != major:
        raise RefusalError(Reason.MALFORMED, f"version is '{document['version'][:WORDS]}', expected {major}.x")


def read_order(document: Json, dialect: Dialect) -> Order:
    """An order by its members, each by itself; `check_sequence` sees how they fit.

    Raises RefusalError for the first that is missing or of another type, with its JSON path.
    """
    _require(document, {"orderId": TEXT, "orderUpdateId": int, "nodes": LIST, "edges": LIST}, "", OPTIONAL["order"])
    references = {"orderId": document["orderId"][:LONGEST_ID], "orderUpdateId": document["orderUpdateId"]}
    try:
        _require_id(document["orderId"], "orderId")
        for key in ("nodes", "edges"):
            if len(document[key]) > MOST_NODES:
                raise RefusalError(Reason.TOO_LARGE, f"{key}: {len(document[key])}, expected {MOST_NODES} at most")
        return Order(
            document["orderId"],
            document["orderUpdateId"],
            tuple(_node(one, f"nodes[{i}]", dialect) for i, one in enumerate(document["nodes"])),
            tuple(_edge(one, f"edges[{i}]", dialect) for i, one in enumerate(document["edges"])),
            document.get("zoneSetId", ""),
            document,
        )
    except RefusalError as refusal:
        refusal.references = {**references, **refusal.references}
        raise


def check_sequence(order: Order) -> None:
    """Refuse an order whose nodes and edges do not follow each other, or whose base is not what comes first.

    Raises RefusalError with the JSON path.
    """
    has_ends = any(edge.ends for edge in order.edges)
    for text in disorder(order.document["nodes"], order.document["edges"], has_ends=has_ends):
        raise RefusalError(Reason.MALFORMED, text, order.references)
    both: list[Node | Edge] = [*order.nodes, *order.edges]
    names = [action.name for one in both for action in one.actions]
    if len(set(names)) != len(names):
        twice = next(name for k, name in enumerate(names) if name in names[:k])
        raise RefusalError(Reason.MALFORMED, f"actionId '{twice[:WORDS]}' is there twice", order.references)


def read_actions(document: Json, dialect: Dialect) -> list[Action]:
    """The actions of a message of instant actions. Raises RefusalError for the first that is wrong; none is taken then."""
    _require(document, {"actions": LIST}, "")
    return list(_actions(document["actions"], "actions", dialect))


def _node(one: Any, at: str, dialect: Dialect) -> Node:
    _require(one, NODE, at, OPTIONAL["node"])
    _require_id(one["nodeId"], f"{at}.nodeId")
    position, deviation_m, deviation_rad = one.get("nodePosition"), 0.0, 0.0
    if position is not None:
        inside = f"{at}.nodePosition"
        _require(position, {"x": NUMBER, "y": NUMBER, "mapId": TEXT}, inside, OPTIONAL["position"])
        _require_id(position["mapId"], f"{inside}.mapId")
        _within(position, {"theta": (-PI, PI), "allowedDeviationTheta": (0.0 if dialect.is_new else -PI, PI)}, inside)
        deviation_m, deviation_rad = _deviation(position, inside, dialect), abs(float(position.get("allowedDeviationTheta", 0.0)))
        position = {key: position[key] for key in ("x", "y", "theta", "mapId") if key in position}
    actions = tuple(_actions(one["actions"], f"{at}.actions", dialect))
    return Node(one["nodeId"], one["sequenceId"], one["released"], actions, position, deviation_m, deviation_rad)


def _deviation(position: Json, at: str, dialect: Dialect) -> float:
    """A radius in 2.1; of the ellipse of 3.0 its shorter half axis."""
    key = "allowedDeviationXY"
    if key not in position:
        return 0.0
    if dialect.is_new:
        _require(position, {key: OBJECT}, at)
        _require(position[key], {"a": NUMBER, "b": NUMBER, "theta": NUMBER}, f"{at}.{key}")
        _within(position[key], {"a": (0.0, math.inf), "b": (0.0, math.inf), "theta": (-PI / 2, PI / 2)}, f"{at}.{key}")
        return float(min(position[key]["a"], position[key]["b"]))
    _require(position, {key: NUMBER}, at)
    _within(position, {key: (0.0, math.inf)}, at)
    return float(position[key])


def _edge(one: Any, at: str, dialect: Dialect) -> Edge:
    _require(one, EDGE if dialect.is_new else EDGE | ENDS, at, OPTIONAL["edge"])
    _require_id(one["edgeId"], f"{at}.edgeId")
    _within(one, {"orientation": (-PI, PI)}, at)
    _says(one, at, dialect)
    if "corridor" in one:
        inside = f"{at}.corridor"
        _require(one["corridor"], {"leftWidth": NUMBER, "rightWidth": NUMBER}, inside, OPTIONAL["corridor"])
        _within(one["corridor"], {"leftWidth": (0.0, math.inf), "rightWidth": (0.0, math.inf)}, inside)
        _says(one["corridor"], inside, dialect)
    limit_mps = float(one.get("maximumSpeed" if dialect.is_new else "maxSpeed", math.inf))
    if limit_mps <= 0:
        raise RefusalError(Reason.MALFORMED, f"{at}: a highest speed of {limit_mps:g} m/s, expected more than 0")
    return Edge(
        one["edgeId"],
        one["sequenceId"],
        one["released"],
        tuple(_actions(one["actions"], f"{at}.actions", dialect)),
        limit_mps,
        float(one.get("length", math.nan)),
        None if dialect.is_new else (one["startNodeId"], one["endNodeId"]),
        one.get("trajectory") is not None,
    )


def _actions(documents: list[Any], at: str, dialect: Dialect) -> Iterator[Action]:
    if len(documents) > MOST_ACTIONS:
        raise RefusalError(Reason.TOO_LARGE, f"{at}: {len(documents)}, expected {MOST_ACTIONS} at most")
    for i, one in enumerate(documents):
        _require(one, ACTION, f"{at}[{i}]", OPTIONAL["action"])
        for key in ("actionId", "actionType"):
            _require_id(one[key], f"{at}[{i}].{key}")
        if one["blockingType"] not in BLOCKING[dialect.is_new]:
            kinds = ", ".join(BLOCKING[dialect.is_new])
            raise RefusalError(Reason.MALFORMED, f"{at}[{i}].blockingType is '{one['blockingType'][:WORDS]}', expected one of {kinds}")
        parameters: dict[str, Any] = {}
        listed = one.get("actionParameters", [])
        if len(listed) > MOST_PARAMETERS:
            raise RefusalError(Reason.TOO_LARGE, f"{at}[{i}].actionParameters: {len(listed)}, expected {MOST_PARAMETERS} at most")
        for k, pair in enumerate(listed):
            _require(pair, {"key": TEXT}, f"{at}[{i}].actionParameters[{k}]")
            if pair.get("value") is None:
                raise RefusalError(Reason.MALFORMED, f"{at}[{i}].actionParameters[{k}].value is missing")
            parameters[pair["key"]] = pair["value"]
        yield Action(one["actionType"], one["actionId"], one["blockingType"], parameters)


def _require(document: Any, needed: Mapping[str, Any], at: str, optional: Mapping[str, Any] | None = None) -> None:
    """Refuse an object that lacks a member, has one of another type, or a number without end."""
    present = {key: kind for key, kind in (optional or {}).items() if isinstance(document, dict) and key in document}
    for text in members(document, {**needed, **present}, at):
        raise RefusalError(Reason.MALFORMED, text)
    for key, kind in {**needed, **present}.items():
        value = document[key]
        if kind in (int, NUMBER) and not abs(value) <= LARGEST:
            raise RefusalError(Reason.MALFORMED, f"{at}{'.' if at else ''}{key} is {str(value)[:WORDS]}, expected at most {LARGEST}")


def _within(document: Json, ranges: Mapping[str, tuple[float, float]], at: str) -> None:
    """Refuse numbers beyond what they may be."""
    for key, (least, most) in ranges.items():
        if key in document and not least <= document[key] <= most:
            expected = f"{least:g} to {most:g}" if most < math.inf else f"{least:g} or more"
            hint = ": radians" if PI in (most, 2 * most) else ""
            raise RefusalError(Reason.MALFORMED, f"{at}.{key} is {document[key]:g}, expected {expected}{hint}")


def _says(document: Json, at: str, dialect: Dialect) -> None:
    """Refuse words that are none of those that are listed."""
    for key, words in WORDS_FOR[dialect.is_new].items():
        if key in document and document[key] not in words:
            raise RefusalError(Reason.MALFORMED, f"{at}.{key} is '{document[key][:WORDS]}', expected one of {', '.join(words)}")


def _require_id(text: str, at: str) -> None:
    if not text or len(text) > LONGEST_ID:
        raise RefusalError(Reason.MALFORMED, f"{at} has {len(text)} characters, expected 1 to {LONGEST_ID}")
