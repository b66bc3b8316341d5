"""A vehicle as VDA 5050 sees it: orders are given to it, it drives them, and does their actions.

It is a state machine without clock, network and body. Its owner hands it what comes in (`inbox`) and where the body is, drives
the body along `new_way`, holds it where `holds` says so, and sends its state (`report`) when it `has_changed`. Rules are those of sections
6.6 of version 2.1 and 6.1 of version 3.0; an order that is refused changes nothing but `refused`.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from mrp_sumo.formats.vda.abilities import BREAKDOWN, FAULTS, LOST, VehicleMap, check_order, duration_s
from mrp_sumo.formats.vda.errors import Reason, RefusalError
from mrp_sumo.formats.vda.messages import STANDING_MPS, Dialect, Json, Sender
from mrp_sumo.formats.vda.order import Action, Edge, Node, Order, check_sequence

FACES_RAD = 0.02  # from the heading of a node, where that allows no deviation
NEAR_M = 0.1  # of a node at which a vehicle stands, besides the deviation that an order allows
WAITING, RUNNING, FINISHED, FAILED = "WAITING", "RUNNING", "FINISHED", "FAILED"


@dataclass(frozen=True)
class Body:
    """Pose and motion of a vehicle."""

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
class ActionProgress:
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
    site: VehicleMap
    at: str  # name of the node of the map at which it stands, or which it passed last
    body: Body
    percent: float = 100.0  # of the battery
    order: Order | None = None  # the last that was accepted, or the last update of it
    nodes: list[Node] = field(default_factory=list)  # still to be passed: base, then horizon
    edges: list[Edge] = field(default_factory=list)
    base_end: Node | None = None  # last node of the base, passed or not
    last_node: str = ""  # as the order calls it
    passed: int = 0  # its sequence number
    last_sent: int = 0  # sequence number of the last node that the body has been sent to
    doings: dict[str, ActionProgress] = field(default_factory=dict)  # actions of the order, in its order
    instants: dict[str, ActionProgress] = field(default_factory=dict)
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
    has_changed: bool = True  # whether a state is to be sent
    _said: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        self.last_node = self.last_node or self.at

    @property
    def dialect(self) -> Dialect:
        return self.sender.dialect

    @property
    def is_busy(self) -> bool:
        """True while there is an order that is not done."""
        return bool(self.nodes or self.cancels) or any(not doing.is_over for doing in self.doings.values())

    @property
    def holds(self) -> bool:
        """True while the body has to stand still."""
        return self.paused or self.is_empty or any(kind in self.faults for kind in FAULTS)

    def new_way(self) -> list[tuple[Node, Edge]]:
        """Nodes that the body may drive to now and has not been sent to yet, with the edges to them.

        They end at the first node at which it has to stand for an action or to turn, and at the end of the base.
        """
        if self.cancels or any(doing.is_due and doing.action.stops and not doing.is_over for doing in self.doings.values()):
            return []
        path, before = [], self.at
        for node, edge, after in self._ahead():
            if not node.released:
                break
            if node.sequence > self.last_sent:
                path.append((node, edge))
            came_rad = self.site.arrival_rad(before, node.name)
            if self._stands_at(node, after) or not node.is_faced(self.body.yaw_rad if math.isnan(came_rad) else came_rad, FACES_RAD):
                break
            before = node.name
        return path

    def sent(self, path: Sequence[tuple[Node, Edge]]) -> None:
        """The body has been sent along some of `new_way`."""
        self.last_sent = path[-1][0].sequence
        self.charging = False

    def reach(self, sequence: int, now_s: float) -> None:
        """The body has come to the nodes up to a sequence number, and faces as the last of them says."""
        while self.nodes and self.nodes[0].sequence <= sequence:
            node, edge = self.nodes.pop(0), self.edges.pop(0)
            for action in edge.actions:  # what was done on the edge is over at its end
                if not self.doings[action.name].is_over:
                    self.doings[action.name].end(FINISHED)
            self._pass(node)
        self.has_changed = True
        self.advance(now_s)

    def stand(self, at: str) -> None:
        """The body stands while the order is being cancelled, at a node of the map which need not be one of the order."""
        if self.cancels:
            self.instants[self.cancels].end(FINISHED)
            self.cancels, self.is_cancelled, self.at = "", True, at
            self.nodes, self.edges, self.last_sent = [], [], self.passed
            self.has_changed = True

    def advance(self, now_s: float) -> None:
        """Let time pass: actions begin and end, faults end."""
        for kind, until_s in list(self.faults.items()):
            if until_s <= now_s:
                del self.faults[kind]
                self.has_changed = True
        for doing in self.doings.values():
            if doing.status == RUNNING and doing.until_s <= now_s:
                self._finish(doing)
        if not self.holds:
            self._begin(now_s)
        for doing in self.instants.values():
            if doing.status == RUNNING and doing.action.kind == "startPause" and not self.body.moves:
                doing.end(FINISHED)
                self.has_changed = True
        said = (self.body.moves, self.blocked_by, self.is_empty, self.charging, self.paused)
        self.has_changed |= said != self._said
        self._said = said

    def fail(self, kind: str, until_s: float = math.inf) -> None:
        """Have a fault begin: 'breakdown', 'emergencyStop', 'localizationLost' or 'fieldViolation'."""
        self.faults[kind] = until_s
        self.has_changed = True

    def take(self, order: Order, now_s: float) -> None:
        """Take an order, or an update of one. Raises RefusalError when it cannot be followed; the vehicle goes on with what it has."""
        check_sequence(order)
        current = self.order
        if current is not None and order.name == current.name:
            if order.update < current.update:
                raise RefusalError(Reason.OUTDATED, f"orderUpdateId is {order.update}, after {current.update}", order.references)
            if order.update == current.update:
                if (order.nodes, order.edges) != (current.nodes, current.edges):
                    raise RefusalError(Reason.SAME_UPDATE, f"update {order.update} was another before", order.references)
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
            raise RefusalError(Reason.AFTER_CANCEL, f"'{order.name}' is cancelled", order.references)
        end, first = self.base_end, order.nodes[0]
        if end is None or (first.name, first.sequence) != (end.name, end.sequence):
            expected = f"'{end.name}' with sequenceId {end.sequence}" if end else "none"
            text = f"nodes[0] is '{first.name}' with sequenceId {first.sequence}, expected the end of the base, {expected}"
            raise RefusalError(Reason.NOT_CONTINUED, text, order.references)
        is_ahead = self.nodes and self.nodes[0].sequence <= end.sequence
        known = end.name if is_ahead and self.site.place(end.name) is not None else self.at
        done = {action.name for action in first.actions}
        used = {name for name in self.doings if self._is_base(name)} - done
        check_order(order, self.site, known, used)
        ahead = (end.sequence - self.passed) // 2  # nodes of the base that are still ahead
        horizon: list[Node | Edge] = [*self.nodes[ahead:], *self.edges[ahead:]]
        names = {action.name for one in horizon for action in one.actions}
        self.doings = {name: doing for name, doing in self.doings.items() if name not in names}  # of the old horizon
        self.nodes, self.edges = [*self.nodes[:ahead], *order.nodes[1:]], [*self.edges[:ahead], *order.edges]
        self._note(order, order.nodes[1:])
        if not ahead and self.edges and self.edges[0].released:  # it stands before the edge already
            self._make_due(*self.edges[0].actions)

    def _take_order(self, order: Order) -> None:
        if self.is_busy:
            active = self.order.name if self.order else ""
            raise RefusalError(Reason.OTHER_ACTIVE, f"'{active}' is not done", order.references)
        if BREAKDOWN in self.faults or LOST in self.faults or self.is_empty:  # of level FATAL: no new order is taken
            raise RefusalError(Reason.NOT_AVAILABLE, "a fault has to be mended before", order.references)
        if self.dialect.is_new and order.update:
            raise RefusalError(Reason.MALFORMED, f"orderUpdateId is {order.update} of a new order, expected 0", order.references)
        first = order.nodes[0]
        if not self._stands_near(first):
            text = f"nodes[0]: '{first.name}' is not where the vehicle stands, at '{self.at}'"
            raise RefusalError(Reason.START, text, {**order.references, "nodeId": first.name})
        check_order(order, self.site, self.at, set())
        self.doings, self.is_cancelled = {}, False
        self.instants = {name: doing for name, doing in self.instants.items() if not doing.is_over}
        self.nodes, self.edges = list(order.nodes[1:]), list(order.edges)
        self._note(order, order.nodes)
        self.last_sent = first.sequence
        here = self.at
        self._pass(first)
        self.at = here  # a first node may be a temporary one

    def _note(self, order: Order, nodes: Sequence[Node]) -> None:
        """Actions wait from now on; the base ends elsewhere."""
        both: list[Node | Edge] = [*nodes, *order.edges]
        by_place = sorted(both, key=lambda one: one.sequence)
        for action in (action for one in by_place for action in one.actions):
            self.doings.setdefault(action.name, ActionProgress(action))
        self.base_end = [node for node in order.nodes if node.released][-1]

    def _is_base(self, name: str) -> bool:
        """True if an action of the order is in its base, or done."""
        both: list[Node | Edge] = [*self.nodes, *self.edges]
        return not any(action.name == name for one in both if not one.released for action in one.actions)

    def _stands_near(self, node: Node) -> bool:
        """True if a vehicle that has nothing to do is within the deviation of the first node of an order."""
        if node.name == self.at:
            return True
        where = self.site.place(node.name)
        x, y, map_id = (node.position["x"], node.position["y"], node.position["mapId"]) if node.position else where or (math.inf, 0.0, "")
        off_m = math.hypot(x - self.body.x_m, y - self.body.y_m)
        return map_id == self.body.map_id and off_m <= max(NEAR_M, node.deviation_m)

    def _ahead(self) -> Iterator[tuple[Node, Edge, Edge | None]]:
        """Nodes that are still to be passed, with the edges to and after them."""
        return zip(self.nodes, self.edges, [*self.edges[1:], None])

    def _stands_at(self, node: Node, after: Edge | None) -> bool:
        """True if the vehicle has to stand at a node before it goes on."""
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
            doing.status, doing.until_s = RUNNING, now_s + duration_s(doing.action)
            self.has_changed = True
            if doing.until_s <= now_s:
                self._finish(doing)

    def _finish(self, doing: ActionProgress) -> None:
        doing.end(FINISHED)
        self.has_changed = True
        kind, parameters = doing.action.kind, doing.action.parameters
        if kind == "pick":
            self.load = {key: str(parameters[key])[:60] for key in ("loadId", "loadType") if key in parameters} or {"loadId": ""}
        elif kind == "drop":
            self.load = None
        elif kind in ("startCharging", "stopCharging"):
            self.charging = kind == "startCharging"
