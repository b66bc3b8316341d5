"""SUMO as an engine: robots on routes of a few edges ahead, renewed as they advance.

SUMO looks along the remaining route of every vehicle, so long routes are a large cost. A route
reaches one edge beyond the last vertex the robot may enter, since SUMO removes a vehicle at its route's end.
Where no lane leads on from a robot's last vertex, the route ends in an endless stop.

Robots that stand at the end of their ways are taken out of SUMO after a few steps, and put back where they stood when they are sent on.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, PlanGraph
from mrp_sumo.core.visits import Visits
from mrp_sumo.engines.protocol import WHOLE_WAY
from mrp_sumo.engines.sumo.network import NO_LIMIT_MPS, SHORTEST_M, edge_name, lane_ends
from mrp_sumo.engines.sumo.session import Sumo, running_sumo, type_of
from mrp_sumo.errors import ExecutionError

AHEAD = 6  # edges in a renewed route beyond the last visit that the robot has been granted
REST_STEPS = 5  # a robot that has stood at the end of its way for so many is taken out
PLAN_STEPS = 10  # at most, for which vehicles that others keep apart follow one look ahead
MOST_OF = 0.7  # of a graph's vertices, from which on it is quicker to load the whole network


class SumoEngine:
    """See `engines.protocol.Engine`. Made by `sumo_engine`."""

    def __init__(self, graph: PlanGraph, fleet: Fleet, sumo: Sumo, only: IntArray | None = None, *, rests: bool = True) -> None:
        """`rests`: take robots out that stand at the end of their ways."""
        self.driven_m = np.zeros(fleet.num_robots)
        self.routed = np.zeros(fleet.num_robots, np.int64)
        self._graph, self._fleet, self._sumo, self._only, self._rests = graph, fleet, sumo, only, rests
        self._edge = [edge_name(a, b) for a, b in zip(graph.tail.tolist(), graph.head.tolist())]  # [L]
        self._rested = np.zeros(fleet.num_robots, np.int64)  # steps for which each robot has stood

    def place(self, visits: Visits) -> None:
        """Check the network, put robots on it, and let SUMO take the step in which they appear.

        The controller keeps robots apart. SUMO, left to do it too, would brake for some whose way is clear, who are late then; it has
        to where lanes have limits, since it brakes for these in the same check.
        """
        self._check_network(visits)
        self._raise_limits(float(self._fleet.max_speed_mps.max()))
        self._visits = visits
        self._insert_all(visits, type_of(self._fleet))
        self._sumo.begin(free=_is_free(self._graph))

    def command(self, robots: Sequence[int], speed_mps: FloatArray) -> None:
        """See Engine."""
        set_speed, names, out = self._sumo.set_speed, self._sumo.names, self._sumo.out
        for r in robots:
            if r not in out:  # who is out stands
                set_speed(names[r], speed_mps[r])

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

    def step(self, moving: BoolArray) -> list[str]:
        """See Engine."""
        self._sumo.step()
        self._sumo.read_driven(self.driven_m, moving)
        if self._rests:
            self._rest(moving)
        return [f"SUMO reports a {kind} of {one} and {two}" for one, two, kind in self._sumo.collisions()]

    def positions(self) -> FloatArray:
        """See Engine."""
        return self._sumo.positions()

    def _rest(self, moving: BoolArray) -> None:
        """Take out who has come to the end of its way."""
        self._rested += 1
        self._rested[moving] = 0
        rested = np.flatnonzero(self._rested == REST_STEPS)
        if len(rested):
            visits = self._visits
            for robot in rested[visits.next[visits.reached[rested]] < 0].tolist():
                self._sumo.take_out(robot)

    def _check_network(self, visits: Visits) -> None:
        """Refuse a network whose edges for the lanes of these visits are not those of the graph."""
        for lane in np.unique(visits.lane[visits.lane >= 0]).tolist():
            found, expected = self._sumo.lane_length_m(self._edge[lane]), max(float(self._graph.length_m[lane]), SHORTEST_M)
            if abs(found - expected) > 1e-5:
                raise ExecutionError(
                    f"edge '{self._edge[lane]}' of the network is {found:g} m long, expected {expected:g} m: it was not made of this graph"
                )

    def _raise_limits(self, speed_mps: float) -> None:
        """The network's stand-in for no limit must not cap fast robots."""
        if speed_mps > NO_LIMIT_MPS:
            unlimited = ~np.isfinite(self._graph.speed_mps)
            if self._only is not None:
                unlimited &= np.isin(self._graph.tail, self._only) & np.isin(self._graph.head, self._only)
            for lane in np.flatnonzero(unlimited).tolist():
                self._sumo.raise_limit(self._edge[lane], speed_mps)

    def _insert_all(self, visits: Visits, kinds: Sequence[int]) -> None:
        """Put every robot on its first vertex: at the end of the incoming edge most in line with its first move."""
        graph = self._graph
        by_head = np.argsort(graph.head, kind="stable")
        into = np.searchsorted(graph.head[by_head], np.arange(graph.num_vertices + 1))
        heading = graph.heading_rad
        for robot, begin in enumerate(visits.first.tolist()):
            vertex = int(visits.vertex[begin])
            onward = visits.heading_rad[begin if visits.next[begin] < 0 else visits.next[begin]]
            incoming = by_head[into[vertex] : into[vertex + 1]]
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
        """An edge that leads on from a lane's end, back if possible."""
        graph = self._graph
        if graph.reverse[lane] >= 0:
            return [self._edge[int(graph.reverse[lane])]]
        head = int(graph.head[lane])
        onward = range(int(graph.first[head]), int(graph.first[head + 1]))
        return [self._edge[onward[0]]] if onward else []


@contextmanager
def sumo_engine(
    graph: PlanGraph,
    fleet: Fleet,
    network: Path,
    step_length_s: float,
    seed: int,
    gui: bool = False,
    *,
    ways: IntArray | None = None,
) -> Iterator[SumoEngine]:
    """Start SUMO (sumo-gui with `gui`) on the network of a graph, and close it whatever happens.

    With `ways`, all vertices that robots will ever come to, SUMO loads these and their neighbours only: they need not go elsewhere,
    and on large maps the network is most of what a run of few robots loads.

    Raises
    ------
    ExecutionError
        For a network that SUMO does not load or that is another graph's, and for every error of SUMO inside the block.
    """
    only = None if ways is None or gui else _with_neighbours(graph, ways)
    if only is not None and len(only) > MOST_OF * graph.num_vertices:
        only = None
    steps = _plan_steps(graph, fleet, step_length_s) if _is_free(graph) else 1
    plan_every_s = round(steps * step_length_s, 9) if steps > 1 else None
    with running_sumo(network, fleet, step_length_s, seed, gui, only=only, plan_every_s=plan_every_s) as sumo:
        yield SumoEngine(graph, fleet, sumo, only, rests=not gui)


def _is_free(graph: PlanGraph) -> bool:
    """Whether robots do as they are commanded, whatever is ahead. SUMO has to look out where lanes have limits."""
    return not np.isfinite(graph.speed_mps).any()


def _plan_steps(graph: PlanGraph, fleet: Fleet, step_length_s: float) -> int:
    """For how many steps one look ahead is enough: robots come to the end of one lane at most in that time, and know what follows it."""
    shortest_m = max(float(graph.length_m.min(initial=np.inf)), SHORTEST_M)
    fastest_mps = float(fleet.max_speed_mps.max())
    return int(min(max(0.999 * shortest_m / (fastest_mps * step_length_s), 1.0), PLAN_STEPS))


def _with_neighbours(graph: PlanGraph, vertices: IntArray) -> IntArray:
    """Ascending; robots are put on lanes to their first vertices, and routes lead on beyond the last ones."""
    is_in = np.zeros(graph.num_vertices, np.bool_)
    is_in[vertices] = True
    near = is_in.copy()
    near[graph.tail[is_in[graph.head]]] = True
    near[graph.head[is_in[graph.tail]]] = True
    return np.flatnonzero(near)
