"""A vehicle as VDA 5050 sees it: orders and instant actions go in, states come out.

It is a state machine without clock, network and body. Whoever has these hands it what comes in and where the body is, drives the body
along `new_way`, holds it where `holds` says so, and sends `state` when there is `news`. Rules are those of sections 6.6 of version
2.1 and 6.1 of version 3.0; a message that is refused changes nothing but `errors`.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from mrp_sumo.formats.vda import errors
from mrp_sumo.formats.vda.errors import RefusalError, error, error_of
from mrp_sumo.formats.vda.messages import STANDING_MPS, Dialect, Json, Limits, Sender, state, states_of
from mrp_sumo.formats.vda.order import (
    LONGEST_ID,
    LONGEST_PAYLOAD,
    MOST_ACTIONS,
    MOST_NODES,
    Action,
    Edge,
    Node,
    Order,
    check_header,
    check_sequence,
    read_actions,
    read_document,
    read_order,
)

AT_NODES = ("pick", "drop", "service", "startCharging", "stopCharging", "finePositioning", "detectObject")
ON_EDGES = ("finePositioning", "detectObject")
INSTANT = (
    *("startPause", "stopPause", "cancelOrder", "stateRequest", "factsheetRequest", "initPosition", "startCharging", "stopCharging"),
    *("simulateFault", "clearFault"),  # of our own
)
ABILITIES = {  # action -> where it may be asked for
    kind: [scope for scope, kinds in (("NODE", AT_NODES), ("EDGE", ON_EDGES), ("INSTANT", INSTANT)) if kind in kinds]
    for kind in dict.fromkeys((*AT_NODES, *ON_EDGES, *INSTANT))
}
LIMITS = Limits(LONGEST_PAYLOAD, LONGEST_ID, MOST_NODES, MOST_ACTIONS)
ACTION_S = {  # how long actions take that do not say it
    **dict.fromkeys(("pick", "drop", "service"), 5.0),
    **dict.fromkeys(("startCharging", "stopCharging", "detectObject"), 1.0),
    "finePositioning": 2.0,
}
LONGEST_ACTION_S = 86_400.0
FACES_RAD = 0.02  # from the heading of a node, where that allows no deviation
NEAR_M = 0.1  # of a node at which a vehicle stands, besides the deviation that an order allows
SAME_PLACE_M = 0.5  # a node that an order places farther from where the map has it is another
SAME_POSE_M, SAME_POSE_RAD = 1.0, 0.8  # an initial position farther off is refused
MOST_INSTANT = 100  # instant actions that are over and still reported
WAITING, RUNNING, FINISHED, FAILED = "WAITING", "RUNNING", "FINISHED", "FAILED"
BREAKDOWN, EMERGENCY_STOP, LOST, FIELD = "breakdown", "emergencyStop", "localizationLost", "fieldViolation"
FAULTS = (BREAKDOWN, EMERGENCY_STOP, LOST, FIELD)


class Site(Protocol):
    """The map that a vehicle has."""

    @property
    def maps(self) -> Sequence[str]:
        """The names of its maps."""

    def place(self, node: str) -> tuple[float, float, str] | None:
        """Where a node is, in m, and on which map; None for one that is unknown."""

    def is_joined(self, tail: str, head: str) -> bool:
        """Whether a vehicle can drive from a known node to another without passing a third that has a name."""

    def arrival_rad(self, tail: str, head: str) -> float:
        """How a vehicle faces that comes from a known node to another that is joined to it; NaN where these are one."""


@dataclass(frozen=True)
class Body:
    """Where a vehicle is and how it moves."""

    x_m: float
    y_m: float
    yaw_rad: float
    map_id: str
    speed_mps: float = 0.0
    turn_rad_s: float = 0.0

    @property
    def moves(self) -> bool:
        return abs(self.speed_mps) >= STANDING_MPS


@dataclass
class Doing:
    """An action and what has become of it."""

    action: Action
    status: str = WAITING
    is_due: bool = False  # the vehicle has come to where it is to be done
    until_s: float = math.inf
    result: str = ""

    @property
    def is_over(self) -> bool:
        return self.status in (FINISHED, FAILED)

    def end(self, status: str, result: str = "") -> None:
        self.status, self.result = status, result


@dataclass
class Vehicle:
    """One vehicle."""

    sender: Sender
    site: Site
    at: str  # name of the node of the map at which it stands, or which it passed last
    body: Body
    percent: float = 100.0  # of the battery
    order: Order | None = None  # the last that was accepted, or the last update of it
    nodes: list[Node] = field(default_factory=list)  # still to be passed: base, then horizon
    edges: list[Edge] = field(default_factory=list)
    base_end: Node | None = None  # last node of the base, passed or not
    last_node: str = ""  # as the order calls it
    passed: int = 0  # its sequence number
    given: int = 0  # sequence number of the last node that the body has been sent to
    doings: dict[str, Doing] = field(default_factory=dict)  # actions of the order, in its order
    instants: dict[str, Doing] = field(default_factory=dict)
    refused: dict[str, Json] = field(default_factory=dict)  # errors until an order, or an instant action, is accepted
    faults: dict[str, float] = field(default_factory=dict)  # kind -> until when
    blocked_by: str = ""  # what the body waits for, for people
    is_empty: bool = False  # the battery
    paused: bool = False
    charging: bool = False
    load: Json | None = None
    cancels: str = ""  # the action that cancels the order, while it does
    is_cancelled: bool = False
    asked_for_factsheet: bool = False
    news: bool = True  # whether a state is to be sent
    _said: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        self.last_node = self.last_node or self.at

    @property
    def dialect(self) -> Dialect:
        return self.sender.dialect

    @property
    def is_busy(self) -> bool:
        """Whether there is an order that is not done."""
        return bool(self.nodes or self.cancels) or any(not doing.is_over for doing in self.doings.values())

    @property
    def holds(self) -> bool:
        """Whether the body has to stand still."""
        return self.paused or self.is_empty or any(kind in self.faults for kind in FAULTS)

    def receive(self, kind: str, payload: bytes, now_s: float) -> None:
        """Take a message of the topics order or instantActions. What is wrong with it is in the next state."""
        self.news = True
        try:
            document = read_document(payload)
            check_header(document, self.dialect, self.sender.manufacturer, self.sender.serial)
            if kind == "order":
                self._receive_order(read_order(document, self.dialect), now_s)
            else:
                for action in read_actions(document, self.dialect):
                    self._receive_instant(action, now_s)
        except RefusalError as refusal:
            refusal.references = {"topic": kind, **refusal.references}
            self.refused[kind] = error_of(self.dialect.is_new, refusal)

    def new_way(self) -> list[tuple[Node, Edge]]:
        """Nodes that the body may drive to now and has not been sent to yet, with the edges to them.

        They end at the first node at which it has to stand for an action or to turn, and at the end of the base.
        """
        if self.cancels or any(doing.is_due and doing.action.stops and not doing.is_over for doing in self.doings.values()):
            return []
        found, before = [], self.at
        for node, edge, after in self._ahead():
            if not node.released:
                break
            if node.sequence > self.given:
                found.append((node, edge))
            came_rad = self.site.arrival_rad(before, node.name)
            if self._stands_at(node, after) or not node.is_faced(self.body.yaw_rad if math.isnan(came_rad) else came_rad, FACES_RAD):
                break
            before = node.name
        return found

    def sent(self, way: Sequence[tuple[Node, Edge]]) -> None:
        """The body has been sent along some of `new_way`."""
        self.given = way[-1][0].sequence
        self.charging = False

    def reach(self, sequence: int, now_s: float) -> None:
        """The body has come to the nodes up to a sequence number, and faces as the last of them says."""
        while self.nodes and self.nodes[0].sequence <= sequence:
            node, edge = self.nodes.pop(0), self.edges.pop(0)
            for action in edge.actions:  # what was done on the edge is over at its end
                if not self.doings[action.name].is_over:
                    self.doings[action.name].end(FINISHED)
            self._pass(node)
        self.news = True
        self.advance(now_s)

    def stand(self, at: str) -> None:
        """The body stands while the order is being cancelled, at a node of the map which need not be one of the order."""
        if self.cancels:
            self.instants[self.cancels].end(FINISHED)
            self.cancels, self.is_cancelled, self.at = "", True, at
            self.nodes, self.edges, self.given = [], [], self.passed
            self.news = True

    def advance(self, now_s: float) -> None:
        """Let time pass: actions begin and end, faults end."""
        for kind, until_s in list(self.faults.items()):
            if until_s <= now_s:
                del self.faults[kind]
                self.news = True
        for doing in self.doings.values():
            if doing.status == RUNNING and doing.until_s <= now_s:
                self._finish(doing)
        if not self.holds:
            self._begin(now_s)
        for doing in self.instants.values():
            if doing.status == RUNNING and doing.action.kind == "startPause" and not self.body.moves:
                doing.end(FINISHED)
                self.news = True
        said = (self.body.moves, self.blocked_by, self.is_empty, self.charging, self.paused)
        self.news |= said != self._said
        self._said = said

    def fail(self, kind: str, until_s: float = math.inf) -> None:
        """Have a fault begin: 'breakdown', 'emergencyStop', 'localizationLost' or 'fieldViolation'."""
        self.faults[kind] = until_s
        self.news = True

    def state(self, now_s: float) -> Json:
        """The payload of a state. There is no news afterwards."""
        self.news = False
        body, own = self.body, self.site.place(self.at)
        document = {"nodes": [self._said_node(n) for n in self.nodes], "edges": [self._said_edge(e) for e in self.edges]}
        nodes, edges = states_of(document, self.passed)
        place = self.dialect.place(body.x_m, body.y_m, body.yaw_rad, body.map_id, known=LOST not in self.faults)
        return self.sender.message(
            "state",
            now_s,
            state(
                self.dialect,
                order=(self.order.name, self.order.update) if self.order else ("", 0),
                last=(self.last_node, self.passed),
                nodes=nodes,
                edges=edges,
                place=place,
                velocity={"vx": round(body.speed_mps, 6), "vy": 0.0, "omega": round(body.turn_rad_s, 6)},
                driving=body.moves,
                paused=self.paused,
                away_m=math.hypot(body.x_m - own[0], body.y_m - own[1]) if own else 0.0,
                actions=[self._said_doing(doing) for doing in self.doings.values()],
                instants=[self._said_doing(doing) for doing in self.instants.values()],
                power=(self.percent, self.charging),
                errors=list(self._errors()),
                stopped=EMERGENCY_STOP in self.faults,
                violated=FIELD in self.faults or bool(self.blocked_by),
                loads=[self.load] if self.load else [],
            ),
        )

    def view(self, now_s: float) -> Json:
        """The payload of a visualization."""
        body = self.body
        reference = {"referenceStateHeaderId": max(0, self.sender.count.get("state", 0) - 1)} if self.dialect.is_new else {}
        place = self.dialect.place(body.x_m, body.y_m, body.yaw_rad, body.map_id, known=LOST not in self.faults)
        velocity = {"vx": round(body.speed_mps, 6), "vy": 0.0, "omega": round(body.turn_rad_s, 6)}
        return self.sender.message("visualization", now_s, {**reference, self.dialect.place_key: place, "velocity": velocity})

    def _receive_order(self, order: Order, now_s: float) -> None:
        check_sequence(order)
        current = self.order
        if current is not None and order.name == current.name:
            if order.update < current.update:
                raise RefusalError(errors.OUTDATED, f"orderUpdateId is {order.update}, after {current.update}", order.references)
            if order.update == current.update:
                if (order.nodes, order.edges) != (current.nodes, current.edges):
                    raise RefusalError(errors.SAME_UPDATE, f"update {order.update} was another before", order.references)
                return
            self._take_update(order)
        else:
            self._take_order(order)
        self.order = order
        self.refused.pop("order", None)
        self.refused.pop("cancelOrder", None)
        self.advance(now_s)

    def _take_update(self, order: Order) -> None:
        if self.cancels or self.is_cancelled:
            raise RefusalError(errors.AFTER_CANCEL, f"'{order.name}' is cancelled", order.references)
        end, first = self.base_end, order.nodes[0]
        if end is None or (first.name, first.sequence) != (end.name, end.sequence):
            expected = f"'{end.name}' with sequenceId {end.sequence}" if end else "none"
            text = f"nodes[0] is '{first.name}' with sequenceId {first.sequence}, expected the end of the base, {expected}"
            raise RefusalError(errors.NOT_CONTINUED, text, order.references)
        known = self._name_on_map(end) if self.nodes and self.nodes[0].sequence <= end.sequence else self.at
        done = {action.name for action in first.actions}
        self._check(order, known, done)
        kept = (end.sequence - self.passed) // 2  # nodes of the base that are still ahead
        horizon: list[Node | Edge] = [*self.nodes[kept:], *self.edges[kept:]]
        names = {action.name for one in horizon for action in one.actions}
        self.doings = {name: doing for name, doing in self.doings.items() if name not in names}  # of the old horizon
        self.nodes, self.edges = [*self.nodes[:kept], *order.nodes[1:]], [*self.edges[:kept], *order.edges]
        self._note(order, order.nodes[1:])
        if not kept and self.edges and self.edges[0].released:  # it stands before the edge already
            self._make_due(*self.edges[0].actions)

    def _take_order(self, order: Order) -> None:
        if self.is_busy:
            active = self.order.name if self.order else ""
            raise RefusalError(errors.OTHER_ACTIVE, f"'{active}' is not done", order.references)
        if BREAKDOWN in self.faults or LOST in self.faults or self.is_empty:  # of level FATAL: no new order is taken
            raise RefusalError(errors.NOT_AVAILABLE, "a fault has to be mended before", order.references)
        if self.dialect.is_new and order.update:
            raise RefusalError(errors.MALFORMED, f"orderUpdateId is {order.update} of a new order, expected 0", order.references)
        first = order.nodes[0]
        if not self._stands_near(first):
            text = f"nodes[0]: '{first.name}' is not where the vehicle stands, at '{self.at}'"
            raise RefusalError(errors.START, text, {**order.references, "nodeId": first.name})
        self._check(order, self.at, set())
        self.doings, self.is_cancelled = {}, False
        self.instants = {name: doing for name, doing in self.instants.items() if not doing.is_over}
        self.nodes, self.edges = list(order.nodes[1:]), list(order.edges)
        self._note(order, order.nodes)
        self.given = first.sequence
        here = self.at
        self._pass(first)
        self.at = here  # a first node may be a temporary one

    def _note(self, order: Order, nodes: Sequence[Node]) -> None:
        """Actions wait from now on; the base ends elsewhere."""
        both: list[Node | Edge] = [*nodes, *order.edges]
        by_place = sorted(both, key=lambda one: one.sequence)
        for action in (action for one in by_place for action in one.actions):
            self.doings.setdefault(action.name, Doing(action))
        self.base_end = [node for node in order.nodes if node.released][-1]

    def _check(self, order: Order, start: str, done: set[str]) -> None:
        """Refuse an order that leads from a node where the vehicle cannot go, or has actions that it does not know."""
        references = order.references
        if order.zone_set:
            raise RefusalError(errors.UNSUPPORTED, "zoneSetId: this vehicle knows no zones", {**references, "zoneSetId": order.zone_set})
        before = start
        for i, node in enumerate(order.nodes):
            place = self.site.place(node.name)
            if node.position is not None and node.position["mapId"] not in self.site.maps:
                raise RefusalError(errors.MAP, f"nodes[{i}].nodePosition.mapId '{node.position['mapId'][:60]}' is unknown", references)
            if i == 0:
                continue
            if place is None:
                text = f"nodes[{i}].nodeId '{node.name[:60]}' is no node of the map"
                raise RefusalError(errors.ROUTE, text, {**references, "nodeId": node.name})
            if node.position is not None:
                off_m = math.hypot(node.position["x"] - place[0], node.position["y"] - place[1])
                if off_m > SAME_PLACE_M + node.deviation_m or node.position["mapId"] != place[2]:
                    text = f"nodes[{i}].nodePosition is {off_m:.2f} m from where the map has '{node.name[:60]}'"
                    raise RefusalError(errors.ROUTE, text, {**references, "nodeId": node.name})
            if node.name != before and not self.site.is_joined(before, node.name):
                text = f"edges[{i - 1}]: no lane leads from '{before[:60]}' to '{node.name[:60]}'"
                raise RefusalError(errors.ROUTE, text, {**references, "edgeId": order.edges[i - 1].name})
            before = node.name
        for i, edge in enumerate(order.edges):
            if edge.has_trajectory:
                text = f"edges[{i}].trajectory: this vehicle keeps to the lanes of its map"
                raise RefusalError(errors.UNSUPPORTED, text, {**references, "edgeId": edge.name, "trajectory": ""})
        places: list[tuple[str, Sequence[Node | Edge], Sequence[str]]] = [
            ("nodes", order.nodes, AT_NODES),
            ("edges", order.edges, ON_EDGES),
        ]
        for kind, ones, known in places:
            for i, one in enumerate(ones):
                for k, action in enumerate(one.actions):
                    at, to = f"{kind}[{i}].actions[{k}]", {**references, "actionId": action.name}
                    if action.kind not in known:
                        text = f"{at}.actionType '{action.kind[:60]}' is not known here"
                        raise RefusalError(errors.ORDER_ACTION, text, {**to, "actionType": action.kind})
                    if wrong := _duration_fault(action):
                        raise RefusalError(errors.ORDER_ACTION, f"{at}.{wrong}", {**to, "duration": ""})
                    if order.update and action.name in self.doings and self._is_base(action.name) and action.name not in done:
                        raise RefusalError(errors.ORDER_ACTION, f"{at}.actionId '{action.name[:60]}' was used before", to)

    def _is_base(self, name: str) -> bool:
        """Whether an action of the order is in its base, or done."""
        both: list[Node | Edge] = [*self.nodes, *self.edges]
        return not any(action.name == name for one in both if not one.released for action in one.actions)

    def _stands_near(self, node: Node) -> bool:
        """Whether a vehicle that has nothing to do is within the deviation of the first node of an order."""
        if node.name == self.at:
            return True
        where = self.site.place(node.name)
        x, y, map_id = (node.position["x"], node.position["y"], node.position["mapId"]) if node.position else where or (math.inf, 0.0, "")
        off_m = math.hypot(x - self.body.x_m, y - self.body.y_m)
        return map_id == self.body.map_id and off_m <= max(NEAR_M, node.deviation_m)

    def _name_on_map(self, node: Node) -> str:
        return node.name if self.site.place(node.name) is not None else self.at

    def _ahead(self) -> Iterator[tuple[Node, Edge, Edge | None]]:
        """Nodes that are still to be passed, with the edges to and after them."""
        return zip(self.nodes, self.edges, [*self.edges[1:], None])

    def _stands_at(self, node: Node, after: Edge | None) -> bool:
        """Whether the vehicle has to stand at a node before it goes on."""
        actions = (*node.actions, *(after.actions if after and after.released else ()))
        return any(action.stops and not self.doings[action.name].is_over for action in actions)

    def _pass(self, node: Node) -> None:
        """A node has been passed: what is to be done there, and on the edge after it, is due."""
        self.passed, self.last_node = node.sequence, node.name
        if self.site.place(node.name) is not None:
            self.at = node.name
        after = self.edges[0].actions if self.edges and self.edges[0].released and not self.cancels else ()
        self._make_due(*node.actions, *after)

    def _make_due(self, *actions: Action) -> None:
        for action in actions:
            self.doings[action.name].is_due = not self.cancels

    def _begin(self, now_s: float) -> None:
        """Begin the actions that are due, as far as those that run allow it."""
        for doing in self.doings.values():
            if doing.status != WAITING or not doing.is_due:
                continue
            running = [other.action for other in self.doings.values() if other.status == RUNNING]
            if any(other.blocking in ("HARD", "SINGLE") for other in running):
                return
            if doing.action.blocking in ("HARD", "SINGLE") and running:
                return
            if doing.action.stops and self.body.moves:
                return
            doing.status, doing.until_s = RUNNING, now_s + _duration_s(doing.action)
            self.news = True
            if doing.until_s <= now_s:
                self._finish(doing)

    def _finish(self, doing: Doing) -> None:
        doing.end(FINISHED)
        self.news = True
        kind, parameters = doing.action.kind, doing.action.parameters
        if kind == "pick":
            self.load = {key: str(parameters[key])[:60] for key in ("loadId", "loadType") if key in parameters} or {"loadId": ""}
        elif kind == "drop":
            self.load = None
        elif kind in ("startCharging", "stopCharging"):
            self.charging = kind == "startCharging"

    def _receive_instant(self, action: Action, now_s: float) -> None:
        """Do one instant action. An identifier that is known already is a message that was sent again."""
        if action.name in self.instants:
            return
        over = [name for name, doing in self.instants.items() if doing.is_over]
        for name in over[: max(0, len(self.instants) + 1 - MOST_INSTANT)]:
            del self.instants[name]
        doing = self.instants[action.name] = Doing(action, RUNNING)
        references = {"actionId": action.name, "actionType": action.kind}
        try:
            if action.kind not in INSTANT:
                raise RefusalError(errors.INSTANT_ACTION, f"instant action '{action.kind[:60]}' is not known here", references)
            getattr(self, f"_do_{action.kind}")(doing, now_s)
        except RefusalError as refusal:
            doing.end(FAILED, refusal.text[: errors.LONGEST_TEXT])
            refusal.references = {"topic": "instantActions", **references, **refusal.references}
            self.refused["cancelOrder" if refusal.reason == errors.NO_ORDER else "instantActions"] = error_of(self.dialect.is_new, refusal)
        else:
            self.refused.pop("instantActions", None)

    def _do_startPause(self, doing: Doing, now_s: float) -> None:
        self.paused = True
        if not self.body.moves:
            doing.end(FINISHED)

    def _do_stopPause(self, doing: Doing, now_s: float) -> None:
        self.paused = False
        doing.end(FINISHED)

    def _do_stateRequest(self, doing: Doing, now_s: float) -> None:
        doing.end(FINISHED)

    def _do_factsheetRequest(self, doing: Doing, now_s: float) -> None:
        self.asked_for_factsheet = True
        doing.end(FINISHED)

    def _do_startCharging(self, doing: Doing, now_s: float) -> None:
        if self.body.moves:
            raise RefusalError(errors.INSTANT_ACTION, "the vehicle drives")
        self.charging = True
        doing.end(FINISHED)

    def _do_stopCharging(self, doing: Doing, now_s: float) -> None:
        self.charging = False
        doing.end(FINISHED)

    def _do_cancelOrder(self, doing: Doing, now_s: float) -> None:
        wanted = doing.action.parameters.get("orderId")
        if not self.is_busy or self.cancels or (wanted is not None and self.order and wanted != self.order.name):
            raise RefusalError(errors.NO_ORDER, "there is no such order to cancel")
        self.cancels = doing.action.name
        for other in self.doings.values():
            if not other.is_over:
                other.end(FAILED, "the order is cancelled")

    def _do_initPosition(self, doing: Doing, now_s: float) -> None:
        """A simulated vehicle is where it is: a position that says so has it localized again, another is refused."""
        given, body = doing.action.parameters, self.body
        numbers: list[Any] = [given.get(key) for key in ("x", "y", "theta")]
        if not all(type(value) in (int, float) and abs(value) < 1e9 for value in numbers):
            raise RefusalError(errors.INSTANT_ACTION, "expected the numbers x, y and theta")
        x, y, theta = numbers
        off_m, off_rad = math.hypot(x - body.x_m, y - body.y_m), abs(math.remainder(theta - body.yaw_rad, 2 * math.pi))
        if off_m > SAME_POSE_M or off_rad > SAME_POSE_RAD or given.get("mapId", body.map_id) != body.map_id:
            raise RefusalError(errors.INSTANT_ACTION, f"that is {off_m:.2f} m and {off_rad:.2f} rad from where the vehicle is")
        self.faults.pop(LOST, None)
        doing.end(FINISHED)

    def _do_simulateFault(self, doing: Doing, now_s: float) -> None:
        kind, lasts_s = self._fault(doing.action), doing.action.parameters.get("duration", math.inf)
        if type(lasts_s) not in (int, float) or not lasts_s > 0:
            raise RefusalError(errors.INSTANT_ACTION, "duration: expected seconds above 0")
        self.fail(kind, now_s + float(min(lasts_s, 1e9)) if lasts_s < math.inf else math.inf)
        doing.end(FINISHED)

    def _do_clearFault(self, doing: Doing, now_s: float) -> None:
        self.faults.pop(self._fault(doing.action), None)
        doing.end(FINISHED)

    def _fault(self, action: Action) -> str:
        found = action.parameters.get("fault")
        if found not in FAULTS:
            raise RefusalError(errors.INSTANT_ACTION, f"fault: expected one of {', '.join(FAULTS)}")
        return str(found)

    def _errors(self) -> Iterator[Json]:
        yield from self.refused.values()
        if LOST in self.faults:
            lost = RefusalError(errors.LOCALIZATION, "the vehicle does not know where it is: initPosition says it")
            yield error_of(self.dialect.is_new, lost)
        if BREAKDOWN in self.faults:
            yield error(BREAKDOWN, errors.FATAL, "the vehicle is broken down", {})
        if self.is_empty:
            yield error("batteryEmpty", errors.FATAL, "the battery is empty", {})
        if self.blocked_by:
            yield error("blocked", errors.WARNING, self.blocked_by, {"orderId": self.order.name} if self.order else {})

    def _said_doing(self, doing: Doing) -> Json:
        said = {"actionId": doing.action.name, "actionType": doing.action.kind, "actionStatus": doing.status}
        return said | ({"actionResult" if self.dialect.is_new else "resultDescription": doing.result} if doing.result else {})

    @staticmethod
    def _said_node(node: Node) -> Json:
        said: Json = {"nodeId": node.name, "sequenceId": node.sequence, "released": node.released}
        return said | ({"nodePosition": node.position} if node.position is not None else {})

    @staticmethod
    def _said_edge(edge: Edge) -> Json:
        return {"edgeId": edge.name, "sequenceId": edge.sequence, "released": edge.released}


def _duration_s(action: Action) -> float:
    """How long an action takes: as its parameter `duration` says, which may be a number or text."""
    found = action.parameters.get("duration")
    return ACTION_S[action.kind] if found is None else float(found)


def _duration_fault(action: Action) -> str:
    found: Any = action.parameters.get("duration", 0.0)
    try:
        value = float(found) if isinstance(found, str | int | float) and not isinstance(found, bool) else math.nan
    except (ValueError, OverflowError):
        value = math.nan
    return "" if 0 <= value <= LONGEST_ACTION_S else f"actionParameters: duration, expected 0 to {LONGEST_ACTION_S:g} s"
