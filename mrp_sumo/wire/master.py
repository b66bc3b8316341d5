"""A master of VDA 5050: vehicles of others as the bodies of a run, driven by our planners and dispatchers.

To a run it is an engine (`engines.protocol`) like any other. What the controller grants a robot is released to its vehicle as the base
of its order, what comes after is the horizon; where vehicles say that they are is how far the bodies have driven. Nothing is released
that the ledger has not granted, so that vehicles that keep to their orders keep clear of each other, however late they are.
"""

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.visits import Visits
from mrp_sumo.drive._causes import MARGIN_M
from mrp_sumo.engines.kinematic.engine import KinematicEngine
from mrp_sumo.errors import ExecutionError
from mrp_sumo.formats.vda.errors import Reason, RefusalError
from mrp_sumo.formats.vda.messages import MANUFACTURER, Dialect, Json, Sender, action, node, serials_of
from mrp_sumo.formats.vda.order import read_document
from mrp_sumo.formats.vda.orders import VehicleOrders, edge_of
from mrp_sumo.search._motion import stop_speed
from mrp_sumo.wire.fleet import GraphSite
from mrp_sumo.wire.link import Link, Received
from mrp_sumo.wire.mqtt import encoded
from mrp_sumo.wire.pace import Pace

HORIZON = 20  # nodes at most
AT_START_M = 0.5  # a vehicle farther from its start is elsewhere
PATIENCE_S = 15.0  # of wall time, for the first state of each vehicle
AT_LEAST_LEFT_M = 0.01  # to a node that a vehicle has not said it passed
ASK_EVERY_S = 2.0  # for states, meanwhile


@dataclass
class Driven:
    """A vehicle as its master knows it."""

    sender: Sender
    orders: VehicleOrders
    route: list[int] = field(default_factory=list)  # vertices of all its visits
    reached: int = 0  # number of the visit that it passed last
    beyond_m: float = 0.0  # since then
    state: Json | None = None
    is_online: bool = False


class DrivenVehicles(KinematicEngine):
    """See `engines.protocol.Engine`. The bodies of the run follow what vehicles report, with the limits of their type: reports come now and
    then, and a body that jumped from one to the next would say nothing of speeds. So they are never ahead of the vehicles.
    """

    def __init__(
        self, problem: Problem, site: GraphSite, link: Link, dialect: Dialect, step_length_s: float, speed: float, manufacturer: str
    ) -> None:
        super().__init__(problem.graph, problem.fleet, step_length_s)
        self._problem, self._site, self._link, self._dialect = problem, site, link, dialect
        serials = serials_of(problem.fleet.robot_name)
        epoch_s = time.time()
        self.vehicles = {serial: Driven(Sender(dialect, serial, manufacturer, epoch_s), VehicleOrders(serial)) for serial in serials}
        headings = np.full(len(problem.goal), np.nan) if problem.goal_heading_rad is None else problem.goal_heading_rad
        self._facing_rad = dict(zip(problem.goal.tolist(), headings.tolist()))  # of goals, NaN: any way
        self._speed, self._steps, self._changed = speed, 0, set(range(len(serials)))
        self._refusals = {name for reason in Reason for name, _ in reason.value}
        self._pace: Pace | None = None
        self._known_m = np.zeros(len(serials))  # how far the vehicles say they have come

    @property
    def now_s(self) -> float:
        return self._steps * self._dt

    def greet(self) -> None:
        """Wait until all vehicles are there, each at its start, without an order. Raises ExecutionError for the first that is not."""
        until, asked_s = time.monotonic() + PATIENCE_S, -math.inf
        while any(vehicle.state is None for vehicle in self.vehicles.values()) and time.monotonic() < until:
            if time.monotonic() >= asked_s + ASK_EVERY_S:
                asked_s = time.monotonic()
                for serial, vehicle in self.vehicles.items():
                    if vehicle.state is None:
                        self._send(serial, "instantActions", {"actions": [action("stateRequest", f"{serial}-{asked_s:.3f}")]})
            self._take(self._link.receive(0.1))
        for r, (serial, vehicle) in enumerate(self.vehicles.items()):
            if vehicle.state is None:
                topic = self._dialect.topic(serial, "state", vehicle.sender.manufacturer)
                raise ExecutionError(f"no state of '{serial}' within {PATIENCE_S:g} s, expected one on {topic}")
            self._check_start(serial, vehicle.state, self._problem.graph.label(int(self._problem.start[r])))

    def place(self, visits: Visits) -> None:
        """See Engine."""
        super().place(visits)
        self._pace = Pace(self._speed)
        self._note_ways(range(len(self.vehicles)))

    def command(self, robots: Sequence[int], speed_mps: FloatArray) -> None:
        """See Engine. How fast vehicles drive what is released is their own affair."""

    def divert(self, robots: Sequence[int], visits: Visits) -> None:
        """See Engine."""
        super().divert(robots, visits)
        self._note_ways(robots)

    def turn_back(self, robot: int, visits: Visits) -> None:
        """See Engine."""
        raise ExecutionError(f"{self._problem.fleet.robot_name[robot]} would have to turn round on a lane, which no order can say")

    def step(self, moving: BoolArray) -> list[str]:
        """See Engine."""
        self._release()
        self._steps += 1
        assert self._pace is not None
        self._take(self._pace.wait(self.now_s, self._link.receive))
        decel = self._fleet.decel_mps2
        for r, vehicle in enumerate(self.vehicles.values()):
            self._known_m[r] = max(self._known_m[r], self._driven_m(r, vehicle, self._visits))
            left_m = float(self._known_m[r] - self.driven_m[r]) - MARGIN_M
            self._wanted_mps[r] = min(float(self._fleet.max_speed_mps[r]), stop_speed(left_m, float(decel[r]), self._dt))
        return super().step(moving)

    def _note_ways(self, robots: Sequence[int] | range) -> None:
        """Read the ways of some robots from their last granted visits on."""
        visits = self._visits
        for r, vehicle in enumerate(self.vehicles.values()):
            if r not in robots:
                continue
            visit = int(visits.granted[r])
            del vehicle.route[int(visits.rank[visit]) :]
            while visit >= 0:
                vehicle.route.append(int(visits.vertex[visit]))
                visit = int(visits.next[visit])
            self._changed.add(r)

    def _release(self) -> None:
        """Send orders and updates for what has been granted since."""
        visits = self._visits
        granted = visits.rank[visits.granted].tolist()
        for r, (serial, vehicle) in enumerate(self.vehicles.items()):
            if r not in self._changed and granted[r] == vehicle.orders.last_base:
                continue
            self._changed.discard(r)
            orders, done = vehicle.orders, vehicle.orders.is_driven(vehicle.reached) and self._is_over(vehicle)
            if orders.is_driven(vehicle.reached) and not done:
                self._changed.add(r)  # the vehicle has not said yet that it is done
                continue
            length = min(len(vehicle.route), granted[r] + 1 + HORIZON)
            made = partial(self._node, vehicle), partial(self._edge, vehicle)
            order = orders.next(length, granted[r], vehicle.reached, done, *made)
            if order is not None:
                self._send(serial, "order", order)

    def _is_over(self, vehicle: Driven) -> bool:
        """True if the vehicle says that its order is done."""
        said = vehicle.state or {}
        return said.get("orderId") == vehicle.orders.name and not said.get("nodeStates")

    def _node(self, vehicle: Driven, k: int, sequence: int, released: bool) -> Json:
        name = self._problem.graph.label(vehicle.route[k])
        place = self._site.place(name)
        assert place is not None
        is_last = k == len(vehicle.route) - 1  # it faces as robots are to stay there, where that is a goal
        yaw_rad = self._facing_rad.get(vehicle.route[k], math.nan) if is_last else math.nan
        return node(name, sequence, released, place[:2], place[2], yaw_rad=yaw_rad)

    def _edge(self, vehicle: Driven, k: int, sequence: int, released: bool) -> Json:
        return edge_of(self._dialect, self._problem.graph, vehicle.route[k], vehicle.route[k + 1], sequence, released)

    def _driven_m(self, robot: int, vehicle: Driven, visits: Visits) -> float:
        """How far a vehicle has come on its way, as it says; no farther than it may be."""
        visit, granted = int(visits.reached[robot]), int(visits.granted[robot])
        while visits.rank[visit] < vehicle.reached and visit != granted:
            visit = int(visits.next[visit])
        here, ahead = float(visits.at_m[visit]), int(visits.next[visit])
        if ahead < 0 or visit == granted:
            return here
        return min(here + vehicle.beyond_m, float(visits.at_m[ahead]) - AT_LEAST_LEFT_M)

    def _send(self, serial: str, kind: str, content: Json) -> None:
        self._link.publish(serial, kind, encoded(self.vehicles[serial].sender.message(kind, self.now_s, content)))

    def _take(self, messages: Sequence[Received]) -> None:
        """Believe what vehicles say; what is no message of VDA 5050 is left out."""
        for serial, kind, payload in messages:
            vehicle = self.vehicles[serial]
            try:
                said = read_document(payload)
            except RefusalError:
                continue
            if kind == "connection":
                vehicle.is_online = said.get("connectionState") == "ONLINE"
            elif kind == "state":
                self._take_state(serial, vehicle, said)

    def _take_state(self, serial: str, vehicle: Driven, said: Json) -> None:
        vehicle.state = said
        for error in _objects(said.get("errors")):
            if str(error.get("errorType")) in self._refusals and _is_about(error, vehicle.orders):
                raise ExecutionError(f"'{serial}' refuses an order: {error['errorType']}: {str(error.get('errorDescription', ''))[:200]}")
        sequence, beyond = said.get("lastNodeSequenceId"), said.get("distanceSinceLastNode", 0.0)
        if said.get("orderId") != vehicle.orders.name or type(sequence) is not int or sequence % 2:
            return
        reached = vehicle.orders.begin + sequence // 2
        if vehicle.reached <= reached <= vehicle.orders.last_base:
            vehicle.reached = reached
            vehicle.beyond_m = float(beyond) if type(beyond) in (int, float) and 0 <= beyond < 1e9 else 0.0

    def _check_start(self, serial: str, said: Json, start: str) -> None:
        place = said.get(self._dialect.place_key)
        expected = self._site.place(start)
        assert expected is not None
        if said.get("nodeStates"):
            raise ExecutionError(f"'{serial}' has an order already: cancel it first")
        if isinstance(place, dict) and all(type(place.get(key)) in (int, float) for key in "xy"):
            off_m = math.hypot(place["x"] - expected[0], place["y"] - expected[1])
            if off_m > AT_START_M:
                raise ExecutionError(f"'{serial}' is {off_m:.2f} m from '{start}', where its way begins")
        elif said.get("lastNodeId") != start:
            raise ExecutionError(f"'{serial}' is at '{str(said.get('lastNodeId'))[:60]}', expected '{start}', where its way begins")


def _is_about(error: Json, orders: VehicleOrders) -> bool:
    """True if an error is about the last order that was sent, if there was one."""
    named = {str(one.get("referenceKey")): one.get("referenceValue") for one in _objects(error.get("errorReferences"))}
    same_update = named.get("orderUpdateId", str(orders.update)) == str(orders.update)
    return bool(orders.name) and named.get("orderId") == orders.name and same_update


def _objects(value: object) -> list[Json]:
    """The objects of an array that may be anything."""
    return [one for one in value if isinstance(one, dict)] if isinstance(value, list) else []


@contextmanager
def driven_vehicles(
    problem: Problem,
    site: GraphSite,
    link: Link,
    dialect: Dialect,
    step_length_s: float,
    *,
    speed: float = 1.0,
    manufacturer: str = MANUFACTURER,
) -> Iterator[DrivenVehicles]:
    """The vehicles at a link as an engine, once all of them are there. Raises ExecutionError."""
    vehicles = DrivenVehicles(problem, site, link, dialect, step_length_s, speed, manufacturer)
    vehicles.greet()
    yield vehicles
