"""SUMO as an engine: robots on routes of a few edges ahead, renewed as they advance.

SUMO looks along the remaining route of every vehicle, so long routes are a large cost. A route
reaches one edge beyond the last vertex the robot may enter, since SUMO removes a vehicle at its route's end.
Where no lane leads on from a robot's last vertex, the route ends in an endless stop.

Robots that stand at the end of their ways are taken out of SUMO after a few steps, and put back where they stood when they are sent on.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, PlanGraph
from mrp_sumo.core.visits import Visits
from mrp_sumo.engines.protocol import WHOLE_WAY, has_limits
from mrp_sumo.engines.sumo.network import NO_LIMIT_MPS, SHORTEST_M, edge_name, excerpt, lane_ends
from mrp_sumo.engines.sumo.session import Sumo, running_sumo, type_of
from mrp_sumo.errors import ExecutionError
from mrp_sumo.search._bodies import lane_limits

AHEAD = 6  # edges in a renewed route beyond the last visit that the robot has been granted
REST_STEPS = 5  # a robot that has stood at the end of its way for so many is taken out
PLAN_STEPS = 10  # at most, for which one look ahead of a vehicle holds


class SumoEngine:
    """See `engines.protocol.Engine`. Made by `sumo_engine`."""

    def __init__(
        self, graph: PlanGraph, fleet: Fleet, sumo: Sumo, step_length_s: float, only: IntArray | None = None, *, rests: bool = True
    ) -> None:
        """Of a running SUMO that has loaded the lanes `only`, or all. `rests`: take robots out that stand at the end of their ways."""
        self.driven_m = np.zeros(fleet.num_robots)
        self.routed = np.zeros(fleet.num_robots, np.int64)
        self._graph, self._fleet, self._sumo, self._only, self._rests = graph, fleet, sumo, only, rests
        self._has_limits, self._dt = has_limits(graph, fleet), step_length_s
        self._wanted_mps, self._sent_mps, self._cap_mps, self._speed_mps = np.zeros((4, fleet.num_robots))
        self._edge = [edge_name(a, b) for a, b in zip(graph.tail.tolist(), graph.head.tolist())]  # [L]
        self._rested = np.zeros(fleet.num_robots, np.int64)  # steps for which each robot has stood

    def place(self, visits: Visits) -> None:
        """Check the network, put robots on it, and let SUMO take the step in which they appear.

        The controller keeps robots apart, and the engine keeps the limits of lanes. SUMO checks both at once; left to do it too, it would
        brake for robots whose way is clear.
        """
        self._check_network(visits)
        self._raise_limits(float(self._fleet.max_speed_mps.max()))
        self._visits = visits
        self._insert_all(visits, type_of(self._fleet))
        self._sumo.begin()

    def command(self, robots: Sequence[int], speed_mps: FloatArray) -> None:
        """See Engine."""
        if self._has_limits:
            self._wanted_mps[robots] = speed_mps[robots]  # sent with the limits of the step
        else:
            self._send(robots, speed_mps)

    def lengthen(self, robots: Sequence[int], visits: Visits) -> None:
        """See Engine."""
        self._visits = visits
        for robot in robots:
            here, reached = self._sumo.edge(robot), visits.reached.item(robot)
            visit = visits.next.item(reached)
            if visit < 0 or self._edge[visits.lane.item(visit)] != here:
                visit = reached  # it has not left the edge to the vertex behind it, or the one it was inserted on
            ahead, stops = self._ahead(robot, visit, visits)
            if not ahead:  # it stays where it is
                ahead = self._exit(self._graph.lane_between(*lane_ends(here)))
                stops = not ahead
            self._sumo.set_route(robot, [here, *ahead], stops, self.driven_m.item(robot))

    def divert(self, robots: Sequence[int], visits: Visits) -> None:
        """Routes are renewed before the next step."""
        self._visits = visits
        for robot in robots:
            self.routed[robot] = visits.rank[visits.granted[robot]]

    def turn_back(self, robot: int, visits: Visits) -> None:
        """See Engine."""
        if robot in self._sumo.out:
            self.lengthen([robot], visits)
        visit = int(visits.next[visits.reached[robot]])
        ahead, stops = self._ahead(robot, visit, visits)
        self._sumo.turn_back(robot, self._edge[visits.lane[visit]], ahead, stops, float(self.driven_m[robot]))

    def load(self, fleet: Fleet) -> None:
        """See Engine."""
        was, kinds, self._fleet = type_of(self._fleet), type_of(fleet), fleet
        for robot in np.flatnonzero(np.not_equal(was, kinds)).tolist():
            self._sumo.change(robot, kinds[robot])

    def step(self, moving: BoolArray) -> list[str]:
        """See Engine."""
        if self._has_limits:
            self._keep_limits()
            before_m = self.driven_m.copy()
        self._sumo.step()
        self._sumo.read_driven(self.driven_m, moving)
        if self._has_limits:
            np.divide(self.driven_m - before_m, self._dt, out=self._speed_mps)
        if self._rests:
            self._rest(moving)
        return [f"SUMO reports a {kind} of {one} and {two}" for one, two, kind in self._sumo.collisions()]

    def positions(self) -> FloatArray:
        """See Engine."""
        return self._sumo.positions()

    def _send(self, robots: Sequence[int], speed_mps: FloatArray) -> None:
        set_speed, names, out = self._sumo.set_speed, self._sumo.names, self._sumo.out
        for r in robots:
            if r not in out:  # who is out stands
                set_speed(names[r], speed_mps[r])

    def _keep_limits(self) -> None:
        """Send speeds no higher than the lanes that robots are on, and those ahead, allow in the next step."""
        lane_limits(self._dt, self._fleet.decel_mps2, self._visits, self._speed_mps, self.driven_m, self._cap_mps)
        speed_mps = np.minimum(self._wanted_mps, self._cap_mps)
        self._send(np.flatnonzero(speed_mps != self._sent_mps).tolist(), speed_mps)
        self._sent_mps = speed_mps

    def _rest(self, moving: BoolArray) -> None:
        if moving.all():
            self._rested[:] = 0
            return
        self._rested += 1
        self._rested[moving] = 0
        rested = np.flatnonzero(self._rested == REST_STEPS)
        if len(rested):
            visits = self._visits
            for robot in rested[visits.next[visits.reached[rested]] < 0].tolist():
                self._sumo.take_out(robot)

    def show_people(self, xy: FloatArray, radius_m: float) -> None:
        """Draw people at these places [N, 2] until the next call, for sumo-gui."""
        self._sumo.show_people(xy, radius_m)

    def _check_network(self, visits: Visits) -> None:
        """Refuse a network whose edges for the lanes of these visits are not those of the graph."""
        for lane in np.unique(visits.lane[visits.lane >= 0]).tolist():
            made_m, expected = self._sumo.lane_length_m(self._edge[lane]), max(float(self._graph.length_m[lane]), SHORTEST_M)
            if abs(made_m - expected) > 1e-5:
                raise ExecutionError(
                    f"edge '{self._edge[lane]}' of the network is {made_m:g} m long, expected {expected:g} m: it was not made of this graph"
                )

    def _raise_limits(self, speed_mps: float) -> None:
        """The network's limits, and its stand-in for none, must not cap what robots are commanded."""
        low = np.flatnonzero(np.where(np.isfinite(self._graph.speed_mps), self._graph.speed_mps, NO_LIMIT_MPS) < speed_mps)
        for lane in (low if self._only is None else np.intersect1d(low, self._only)).tolist():
            self._sumo.raise_limit(self._edge[lane], speed_mps)

    def _insert_all(self, visits: Visits, kinds: Sequence[int]) -> None:
        """Put every robot on its first vertex: at the end of the incoming edge most in line with its first move."""
        graph = self._graph
        into, heading = _incoming(graph), graph.heading_rad
        for robot, begin in enumerate(visits.first.tolist()):
            vertex = int(visits.vertex[begin])
            onward = visits.heading_rad[begin if visits.next[begin] < 0 else visits.next[begin]]
            incoming = into(vertex)
            ahead, stops = self._ahead(robot, begin, visits)
            if len(incoming):
                away = np.abs((heading[incoming] - onward + np.pi) % (2 * np.pi) - np.pi)
                lane = int(incoming[np.argmin(np.round(away, 6))])
                if not ahead:  # it stays: the route leads on to anywhere
                    ahead = self._exit(lane)
                    stops = not ahead
                self._sumo.insert(robot, kinds[robot], [self._edge[lane], *ahead], True, stops)
            else:
                if not ahead:
                    lane = int(graph.first[vertex])
                    ahead = [self._edge[lane], *self._exit(lane)]
                self._sumo.insert(robot, kinds[robot], ahead, False, stops)

    def _ahead(self, robot: int, visit: int, visits: Visits) -> tuple[list[str], bool]:
        """The edges after a visit's, and whether the route has to end in a stop."""
        edges: list[str] = []
        following, lane = visits.next.item, visits.lane.item
        ahead = following(visit)
        most = visits.rank.item(visits.granted.item(robot)) + AHEAD
        while ahead >= 0 and visits.rank.item(visit) < most:
            visit = ahead
            edges.append(self._edge[lane(visit)])
            ahead = following(visit)
        if ahead >= 0:
            self.routed[robot] = visits.rank[visit]
            return edges, False
        self.routed[robot] = WHOLE_WAY
        if visits.lane[visit] < 0:
            return edges, False
        beyond = self._exit(int(visits.lane[visit]))
        return edges + beyond, not beyond

    def _exit(self, lane: int) -> list[str]:
        """An edge that leads on from a lane's end."""
        onward = _exit(self._graph, lane)
        return [self._edge[onward]] if onward >= 0 else []


@contextmanager
def sumo_engine(
    graph: PlanGraph,
    fleet: Fleet,
    network: Path,
    step_length_s: float,
    seed: int,
    gui: bool = False,
    *,
    ways: tuple[IntArray, IntArray] | None = None,
) -> Iterator[SumoEngine]:
    """Start SUMO (sumo-gui with `gui`) on the network of a graph, and close it whatever happens.

    With `ways`, all that robots will ever drive, SUMO loads nothing else: they need not go elsewhere, and on large maps the network is most
    of what a run of few robots loads. These are the vertices of robot after robot, and the lanes by which they come to them, -1 for the
    first of each. Raises ExecutionError for a network that SUMO does not load or that is another graph's, and for every error of SUMO
    inside the block.
    """
    lanes, shorten = None, None
    if ways is not None and not gui:
        lanes, onward = _driven_on(graph, *ways)
        shorten = partial(excerpt, graph=graph, lanes=lanes, onward=onward)
    steps = _plan_steps(graph, fleet, step_length_s)
    plan_every_s = round(steps * step_length_s, 9) if steps > 1 else None
    with running_sumo(network, fleet, step_length_s, seed, gui, shorten=shorten, plan_every_s=plan_every_s) as sumo:
        yield SumoEngine(graph, fleet, sumo, step_length_s, lanes, rests=not gui)


def _plan_steps(graph: PlanGraph, fleet: Fleet, step_length_s: float) -> int:
    """For how many steps one look ahead is enough: robots come to the end of one lane at most in that time, and know what follows it."""
    shortest_m = max(float(graph.length_m.min(initial=np.inf)), SHORTEST_M)
    fastest_mps = float(fleet.max_speed_mps.max())
    return int(min(max(0.999 * shortest_m / (fastest_mps * step_length_s), 1.0), PLAN_STEPS))


def _driven_on(graph: PlanGraph, vertex: IntArray, lane: IntArray) -> tuple[IntArray, IntArray]:
    """Lanes of these ways, by which robots may be put on them, and by which routes lead on beyond; and [K, 2] which follow which."""
    begin = np.flatnonzero(lane < 0)
    end = np.append(begin[1:], len(lane)) - 1
    follows = np.flatnonzero((lane[:-1] >= 0) & (lane[1:] >= 0))
    onward = np.stack([lane[follows], lane[follows + 1]], 1).tolist()
    onward += [[last, _exit(graph, last)] for last in np.unique(lane[end]).tolist() if last >= 0]
    into = _incoming(graph)
    for first, last in zip(begin.tolist(), end.tolist()):
        start = int(vertex[first])
        before = into(start).tolist()
        if first < last:
            onward += [[one, int(lane[first + 1])] for one in before]
        else:  # it stays there
            before = before or [int(graph.first[start])]
            onward += [[one, _exit(graph, one)] for one in before]
    pairs = np.array(onward, np.int64).reshape(-1, 2)
    lanes = np.unique(np.concatenate([lane, pairs.ravel()]))
    return lanes[lanes >= 0], pairs[pairs[:, 1] >= 0]


def _incoming(graph: PlanGraph) -> Callable[[int], IntArray]:
    """What gives the lanes that lead to a vertex."""
    by_head = np.argsort(graph.head, kind="stable")
    first = np.searchsorted(graph.head[by_head], np.arange(graph.num_vertices + 1))
    return lambda vertex: by_head[first[vertex] : first[vertex + 1]]


def _exit(graph: PlanGraph, lane: int) -> int:
    """A lane that leads on from a lane's end, back if possible; -1 where none does."""
    if graph.reverse[lane] >= 0:
        return int(graph.reverse[lane])
    head = int(graph.head[lane])
    return int(graph.first[head]) if graph.first[head] < graph.first[head + 1] else -1
