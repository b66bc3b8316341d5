"""A virtual fleet: every robot of a scenario is a vehicle of VDA 5050 that drives what its master releases.

What is released becomes visits in a ledger like that of a run, and a controller grants them. So a vehicle that is released into another
one waits before it, as one with a scanner does, and reports that it is blocked: bodies never overlap, however bad the master. Simulated
time goes on by a step each time `step` is called; the caller keeps the pace.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.disturbances import NONE
from mrp_sumo.core.graph import BoolArray, PlanGraph, frozen
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.batteries import Batteries
from mrp_sumo.drive.controller import Controller
from mrp_sumo.drive.cycle import DriveCycle
from mrp_sumo.drive.facilities import facilities_of
from mrp_sumo.drive.fit import check_groups, check_room
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.policy import policy_of
from mrp_sumo.drive.reroute import Replan, Reroute
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.world import World
from mrp_sumo.engines.kinematic.engine import KinematicEngine
from mrp_sumo.engines.protocol import Engine
from mrp_sumo.engines.sumo.engine import sumo_engine
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.staging.set_up import SetUp
from mrp_sumo.formats.vda.abilities import ABILITIES, FAULTS, LIMITS
from mrp_sumo.formats.vda.factsheet import factsheet
from mrp_sumo.formats.vda.inbox import receive
from mrp_sumo.formats.vda.messages import MANUFACTURER, Dialect, Json, Sender, serials_of
from mrp_sumo.formats.vda.order import Edge, Node
from mrp_sumo.formats.vda.report import state_of, view_of
from mrp_sumo.formats.vda.vehicle import FACES_RAD, Body, Vehicle
from mrp_sumo.maps.levels import shifts_of
from mrp_sumo.search.route import shortest_route
from mrp_sumo.traffic.resources import resources_of
from mrp_sumo.wire.link import Link, Received
from mrp_sumo.wire.mqtt import encoded

DETOUR = 1.5  # an edge of an order may follow lanes of so many times the straight distance, and
DETOUR_M = 1.0  # this more
SPIN_RAD = 1e-3  # a body that turns by less in a step does not turn


class InjectedFault(NamedTuple):
    """A fault that is asked for: of a vehicle, from when, until when."""

    robot: int
    kind: str
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class Reporting:
    """Periods of vehicles' reports, in simulated time."""

    state_s: float = 1.0  # besides what happens; the standard has 30 s at most
    view_s: float = 1.0  # visualization; 0: none
    manufacturer: str = MANUFACTURER
    epoch_s: float = 0.0  # the time of day at which simulated time begins, in s since 1970


class GraphSite:
    """The map of a run as its vehicles know it. See `formats.vda.abilities.Site`."""

    def __init__(self, graph: PlanGraph, shift_m: Mapping[str, tuple[float, float]]) -> None:
        self._graph = graph
        self.shift_m = shifts_of(graph.level_names, shift_m)
        self.maps = graph.level_names
        self._vertex = {graph.label(v): v for v in range(graph.num_vertices)}
        self._open = frozen(np.ones(graph.num_lanes, np.bool_))
        self._routes: dict[tuple[str, str], tuple[int, ...] | None] = {}

    def place(self, node: str) -> tuple[float, float, str] | None:
        """See Site."""
        v = self._vertex.get(node)
        if v is None:
            return None
        level = int(self._graph.level[v])
        x, y = (self._graph.xy[v] - self.shift_m[level]).tolist()
        return x, y, self._graph.level_names[level]

    def is_joined(self, tail: str, head: str) -> bool:
        """See Site. Nodes of an order may lie farther apart than vertices do, as long as lanes lead there without a detour."""
        return self.route(tail, head) is not None

    def arrival_rad(self, tail: str, head: str) -> float:
        """See Site."""
        route = self.route(tail, head)
        if not route:
            return math.nan
        before = route[-2] if len(route) > 1 else self._vertex[tail]
        return float(self._graph.heading_rad[self._graph.lane_between(before, route[-1])])

    def route(self, tail: str, head: str) -> tuple[int, ...] | None:
        """Vertices after one node up to another; None where no lanes lead there."""
        if tail == head:
            return ()
        a, b = self._vertex[tail], self._vertex[head]
        if self._graph.lane_between(a, b) >= 0:
            return (b,)
        if (tail, head) not in self._routes:
            self._routes[tail, head] = self._longer_route(a, b)
        return self._routes[tail, head]

    def _longer_route(self, a: int, b: int) -> tuple[int, ...] | None:
        graph = self._graph
        route = shortest_route(graph, self._open, a, b)
        if route is None:
            return None
        lanes = [graph.lane_between(tail, head) for tail, head in pairwise(route)]
        straight_m = float(np.hypot(*(graph.xy[b] - graph.xy[a])))
        within = float(graph.length_m[lanes].sum()) <= DETOUR * straight_m + DETOUR_M or bool(graph.is_ride[lanes].any())
        return tuple(route[1:]) if within else None


@dataclass
class OrderRoute:
    """The route of a body: nodes of its order, with the numbers of their visits along its whole way."""

    rank: list[int] = field(default_factory=list)
    sequence: list[int] = field(default_factory=list)
    limit_mps: list[float] = field(default_factory=list)  # on the edge to each
    node: list[Node] = field(default_factory=list)

    def turns_to(self, yaw_rad: float) -> float:
        """The heading of a body that stands at the end; the one that it has where the last node says nothing, or there is none."""
        theta_rad = self.node[-1].theta_rad if self.node else math.nan
        return yaw_rad if math.isnan(theta_rad) else theta_rad


class VirtualFleet:
    """R vehicles and their bodies. A context: the engine ends with it."""

    def __init__(
        self, setup: SetUp, network: Path, link: Link, dialect: Dialect, reporting: Reporting, faults: Sequence[InjectedFault] = ()
    ) -> None:
        """Put the robots of a scenario at their starts, with nothing to do.

        Raises ExecutionError when they do not fit where they stand, and MrpSumoError for a fault of a vehicle that is not there.
        """
        problem, settings = setup.problem, setup.settings
        self.settings: ExecutionSettings = replace(settings, disturbances=NONE, closed_lanes=(), people=None)
        self.link, self.dialect, self.reporting = link, dialect, reporting
        self.site = GraphSite(problem.graph, setup.map.level_shift_m)
        check_room(problem)
        resources = resources_of(problem.graph, problem.fleet.apart_m)
        check_groups(problem, resources)
        self.ledger = Ledger(problem, resources)
        facilities = facilities_of(problem.graph, resources)
        self.world = World(problem, self.settings, facilities)
        self.policy = policy_of("open_loop")
        self.controller = Controller(self.ledger, self.policy, self.settings, paced=False)
        self.batteries: Batteries | None = None
        if problem.fleet.batteries:
            self.batteries = Batteries(problem.fleet, settings.start_level, settings.seed, settings.step_length_s)
        self.serials = serials_of(problem.fleet.robot_name)
        self.robot_of = {serial: r for r, serial in enumerate(self.serials)}
        self.faults = sorted(faults, key=lambda fault: fault.begin_s)
        for fault in self.faults:
            if fault.kind not in FAULTS:
                raise MrpSumoError(f"fault '{fault.kind}': expected one of {', '.join(FAULTS)}")
        self._cycle: DriveCycle | None = None
        self.sent = 0
        self._ways = [OrderRoute() for _ in self.serials]
        self._to_send = np.zeros(problem.num_robots)  # when each is to report at the latest
        self._to_show = 0.0
        self._yaw = np.zeros(problem.num_robots)
        self._engine_context = _engine(problem, self.settings, network)
        at = [problem.graph.label(int(v)) for v in problem.start]
        self.vehicles = [
            Vehicle(Sender(dialect, serial, reporting.manufacturer, epoch_s=reporting.epoch_s), self.site, place, self._body_at(place))
            for serial, place in zip(self.serials, at)
        ]

    @property
    def problem(self) -> Problem:
        return self.ledger.problem

    def __enter__(self) -> "VirtualFleet":
        self.bodies: Engine = self._engine_context.__enter__()
        self._cycle = DriveCycle(self.world, self.controller, self.bodies)
        robots = range(self.problem.num_robots)
        self._append({r: _way_along((), 0.0) for r in robots})
        self.bodies.place(self.ledger.visits)
        for vehicle in self.vehicles:
            self._publish(vehicle, "factsheet", self._factsheet(vehicle))
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._engine_context.__exit__(kind, error, trace)

    def greet(self) -> None:
        """Say that the vehicles are there; with MQTT the connections do that."""
        for vehicle in self.vehicles:
            self._publish(vehicle, "connection", self.connection(vehicle, "ONLINE"))

    def leave(self) -> None:
        """Say that the vehicles go, as they mean to."""
        for vehicle in self.vehicles:
            self._publish(vehicle, "connection", self.connection(vehicle, "OFFLINE"))

    def connection(self, vehicle: Vehicle, said: str) -> Json:
        """A payload of the topic connection."""
        return vehicle.sender.message("connection", self.now_s, {"connectionState": said})

    def last_will(self, vehicle: Vehicle) -> Json:
        """The message that the broker sends when a connection breaks; it does not count as sent."""
        said = self.connection(vehicle, "CONNECTION_BROKEN" if self.dialect.is_new else "CONNECTIONBROKEN")
        vehicle.sender.count["connection"] -= 1
        return said

    def step(self, messages: Sequence[Received]) -> None:
        """Take messages, report, and let a step of time pass."""
        for serial, kind, payload in messages:
            receive(self.vehicles[self.robot_of[serial]], kind, payload, self.now_s)
        cycle = self._cycle
        assert cycle is not None, "vehicles stand on the map"
        cycle.look()
        self._observe()
        self._report()
        cycle.go(sent=self._send_on())
        self._hold()
        if self.ledger.is_full:
            self.ledger.entries = self.ledger.entries[-1:]
            cycle.forget(self.ledger.visits.reached.copy())

    @property
    def now_s(self) -> float:
        """Simulated time; 0 before vehicles stand on the map."""
        return self._cycle.now_s if self._cycle else 0.0

    def _observe(self) -> None:
        """Tell the vehicles what has become of their bodies, and what time does."""
        state, visits, now_s = self.ledger.state, self.ledger.visits, self.now_s
        graph, motion = self.problem.graph, state.motion
        level = graph.level[visits.vertex[visits.reached]]
        xy = (self.bodies.positions() - self.site.shift_m[level]).tolist()
        turned = ((motion.yaw_rad - self._yaw + np.pi) % (2 * np.pi) - np.pi) / self.settings.step_length_s
        self._yaw = motion.yaw_rad.copy()
        if self.batteries is not None:
            charging = np.array([vehicle.charging for vehicle in self.vehicles])
            self.batteries.add(motion.yaw_rad[None], motion.speed_mps[None])
            for robot in self.batteries.observe(now_s, charging):
                self.vehicles[robot].is_empty = True
        rank = visits.rank[visits.reached].tolist()
        ends = (visits.reached == visits.granted) & (motion.speed_mps == 0) & ~state.grants.on_lane
        speed, yaw, levels = motion.speed_mps.tolist(), motion.yaw_rad.tolist(), level.tolist()
        stuck, other = state.waits.stuck.tolist(), state.grants.other.tolist()
        for r, vehicle in enumerate(self.vehicles):
            spin = float(turned[r]) if abs(turned[r]) > SPIN_RAD else 0.0
            vehicle.body = Body(xy[r][0], xy[r][1], yaw[r], graph.level_names[levels[r]], speed[r], spin)
            if self.batteries is not None:
                vehicle.percent = float(100 * self.batteries.level[r])
            path = self._ways[r]
            passed = 0
            while passed < len(path.rank) and path.rank[passed] <= rank[r]:
                if passed == len(path.rank) - 1 and not path.node[passed].is_faced(yaw[r], FACES_RAD):
                    break
                passed += 1
            if passed:
                vehicle.reach(path.sequence[passed - 1], now_s)
                del path.rank[:passed], path.sequence[:passed], path.limit_mps[:passed], path.node[:passed]
            reason = f"waits for {self.serials[other[r]]}" if other[r] >= 0 else "the way is not free"
            vehicle.blocked_by = reason if stuck[r] and path.rank and not vehicle.holds else ""
            if vehicle.cancels and ends[r] and visits.next[visits.granted[r]] < 0:
                vehicle.stand(graph.label(int(visits.vertex[visits.reached[r]])))
                self._ways[r] = OrderRoute()
            vehicle.advance(now_s)
        while self.faults and self.faults[0].begin_s <= now_s + 1e-9:
            fault = self.faults.pop(0)
            self.vehicles[fault.robot].fail(fault.kind, fault.end_s)

    def _send_on(self) -> bool:
        """Send bodies along what has been released since, and those whose orders are cancelled no farther. Returns whether any were."""
        ways: dict[int, Reroute] = {}
        for r, vehicle in enumerate(self.vehicles):
            if vehicle.cancels:
                if (cut := self._cut(r)) is not None:
                    ways[r] = cut
            elif new := vehicle.new_way():
                ways[r] = self._longer(r, vehicle, new)
                vehicle.sent(new)
        if ways:
            self._append(ways)
            self.controller.divert(sorted(ways), [], self.bodies)
        return bool(ways)

    def _longer(self, robot: int, vehicle: Vehicle, new: Sequence[tuple[Node, Edge]]) -> Reroute:
        """A robot's way beyond what it has been granted, with more nodes at its end."""
        visits, path = self.ledger.visits, self._ways[robot]
        granted = int(visits.granted[robot])
        vertices = self.ledger.visits.vertex[self.ledger.ids(robot, granted)[1:]].tolist()
        rank, at = int(visits.rank[granted]) + len(vertices), int(visits.vertex[visits.last[robot]])
        label = self.problem.graph.label
        for node, edge in new:
            route = self.site.route(label(at), node.name)
            assert route is not None, "the vehicle has checked that"
            vertices += route
            rank += len(route)
            at = route[-1] if route else at
            path.rank.append(rank)
            path.sequence.append(node.sequence)
            path.limit_mps.append(edge.limit_mps)
            path.node.append(node)
        return _way_along(vertices, self.now_s)

    def _cut(self, robot: int) -> Reroute | None:
        """A robot's way no farther than it has been granted, or to the end of the lane that it is on; None where that is so already."""
        visits, grants = self.ledger.visits, self.ledger.state.grants
        granted = int(visits.granted[robot])
        ahead = self.ledger.ids(robot, granted)[1:]
        base = ahead[: int(grants.on_lane[robot])]
        return None if len(base) == len(ahead) else _way_along(self.ledger.visits.vertex[base].tolist(), self.now_s)

    def _append(self, ways: Mapping[int, Reroute]) -> None:
        at = self.ledger.visits.vertex[self.ledger.visits.granted]
        ends = {r: int(path.vertex[-1] if len(path.vertex) else at[r]) for r, path in ways.items()}
        self.ledger.append(Replan(ways, "replan", ends=ends), self.policy, self.now_s)

    def _hold(self) -> None:
        """Bodies stand still where their vehicles have them, keep the limits of their edges, and face as the nodes say where they end."""
        state, top = self.ledger.state, self.controller.kinematics.speed_mps
        for r, vehicle in enumerate(self.vehicles):
            self.world.hold(r, math.inf if vehicle.holds else 0.0)
            yaw_rad = float(state.motion.yaw_rad[r])
            self.ledger.stay_facing(r, yaw_rad if vehicle.holds else self._ways[r].turns_to(yaw_rad))
            limit = self._ways[r].limit_mps
            self.world.slow(r, min(1.0, limit[0] / top[r]) if limit else 1.0)

    def _report(self) -> None:
        shows = self.reporting.view_s > 0 and self.now_s >= self._to_show - 1e-9
        due: BoolArray = self.now_s >= self._to_send - 1e-9
        for r, vehicle in enumerate(self.vehicles):
            if vehicle.has_changed or due[r]:
                self._publish(vehicle, "state", state_of(vehicle, self.now_s))
                self._to_send[r] = self.now_s + self.reporting.state_s
            if vehicle.asked_for_factsheet:
                vehicle.asked_for_factsheet = False
                self._publish(vehicle, "factsheet", self._factsheet(vehicle))
            if shows:
                self._publish(vehicle, "visualization", view_of(vehicle, self.now_s))
        if shows:
            self._to_show = max(self._to_show + self.reporting.view_s, self.now_s)

    def _publish(self, vehicle: Vehicle, kind: str, payload: Json) -> None:
        self.link.publish(vehicle.sender.serial, kind, encoded(payload))
        self.sent += 1

    def _factsheet(self, vehicle: Vehicle) -> Json:
        fleet, robot = self.problem.fleet, self.robot_of[vehicle.sender.serial]
        said = factsheet(self.dialect, fleet.types[fleet.kind[robot]], actions=ABILITIES, limits=LIMITS)
        return vehicle.sender.message("factsheet", self.now_s, said)

    def _body_at(self, node: str) -> Body:
        place = self.site.place(node)
        assert place is not None
        return Body(place[0], place[1], 0.0, place[2])


def _engine(problem: Problem, settings: ExecutionSettings, network: Path) -> AbstractContextManager[Engine]:
    if settings.engine == "kinematic":
        return nullcontext(KinematicEngine(problem.graph, problem.fleet, settings.step_length_s))
    return sumo_engine(problem.graph, problem.fleet, network, settings.step_length_s, settings.seed)


def _way_along(vertices: Sequence[int], now_s: float) -> Reroute:
    """A way whose times mean nothing: nobody keeps an order."""
    count = len(vertices)
    depart_s = np.full(count, now_s)
    depart_s[-1:] = np.inf
    return Reroute(np.array(vertices, np.int64), np.full(count, now_s), depart_s, leave_s=now_s if count else math.inf)
