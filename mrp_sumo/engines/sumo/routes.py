"""The edges SUMO is told of: a few ahead of each robot, renewed as it advances.

SUMO looks along the whole remaining route in every step, so long routes are its largest cost. A route
reaches one edge beyond the last vertex the robot may enter, since SUMO removes a vehicle at its route's end.
Where no lane leads on from a robot's last vertex, the route ends in an endless stop.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mrp_sumo.core.graph import NavGraph
from mrp_sumo.engines.sumo.network import NO_LIMIT_MPS, SHORTEST_M, edge_name, lane_ends
from mrp_sumo.engines.sumo.session import Sumo
from mrp_sumo.errors import ExecutionError

AHEAD = 5  # edges in a renewed route


@dataclass
class Routes:
    """Routes of R robots in a running SUMO."""

    graph: NavGraph
    path: Any
    sumo: Sumo
    state: Any
    edge: list[str] = field(init=False)  # [L]

    def __post_init__(self) -> None:
        self.edge = [edge_name(a, b) for a, b in zip(self.graph.tail.tolist(), self.graph.head.tolist())]
        self._lanes: list[int] = self.path.lane.tolist()

    def begin(self, kinds: list[int], fastest_mps: float) -> None:
        """Check the network, put robots of these types [R] on it, and let SUMO take the step in which they appear."""
        self._check()
        self._raise_limits(fastest_mps)
        self._insert_all(kinds)
        self.sumo.begin()

    def change(self, path: Any, state: Any) -> None:
        """Go on along other paths. Routes are made when they are due."""
        self.path, self.state = path, state
        self._lanes = path.lane.tolist()

    def turn_back(self, robot: int) -> None:
        """A robot that stands on a lane now stands on the lane back, the first of its path."""
        visit = int(self.path.first[robot]) + 1
        ahead, stops = self._ahead(robot, visit)
        self.sumo.turn_back(robot, self.edge[self._lanes[visit]], ahead, stops, float(self.state.s[robot]))

    def _check(self) -> None:
        """Refuse a network whose lanes on the robots' paths are not those of the graph."""
        for lane in np.unique(self.path.lane[self.path.lane >= 0]).tolist():
            found, expected = self.sumo.lane_length_m(self.edge[lane]), max(float(self.graph.length_m[lane]), SHORTEST_M)
            if abs(found - expected) > 1e-5:
                raise ExecutionError(
                    f"edge '{self.edge[lane]}' of the network is {found:g} m long, expected {expected:g} m: it was not made of this graph"
                )

    def _raise_limits(self, speed_mps: float) -> None:
        """The network's stand-in for no limit must not cap fast robots."""
        if speed_mps > NO_LIMIT_MPS:
            for lane in np.flatnonzero(~np.isfinite(self.graph.speed_mps)).tolist():
                self.sumo.raise_limit(self.edge[lane], speed_mps)

    def _insert_all(self, kinds: list[int]) -> None:
        """Put every robot on its first vertex: at the end of the incoming edge most in line with its first move."""
        graph, path = self.graph, self.path
        by_head = np.argsort(graph.head, kind="stable")
        into = np.searchsorted(graph.head[by_head], np.arange(graph.num_vertices + 1))
        along = graph.xy[graph.head] - graph.xy[graph.tail]
        heading = np.arctan2(along[:, 1], along[:, 0])
        for robot in range(len(path.first) - 1):
            begin = int(path.first[robot])
            vertex = int(path.vertex[begin])
            incoming = by_head[into[vertex] : into[vertex + 1]]
            ahead, stops = self._ahead(robot, begin)
            if len(incoming):
                away = np.abs((heading[incoming] - path.heading[begin] + np.pi) % (2 * np.pi) - np.pi)
                lane = int(incoming[np.argmin(np.round(away, 6))])
                if not ahead:  # it stays: the route leads on to anywhere
                    ahead = self._exit(lane)
                    stops = not ahead
                self.sumo.insert(robot, kinds[robot], [self.edge[lane], *ahead], True, stops)
            else:
                if not ahead:
                    lane = int(graph.first[vertex])
                    ahead = [self.edge[lane], *self._exit(lane)]
                self.sumo.insert(robot, kinds[robot], ahead, False, stops)

    def renew(self, robots: list[int]) -> None:
        """Lengthen the routes of robots that may soon drive on their last edge."""
        for robot in robots:
            here = self.sumo.edge(robot)
            visit = int(self.state.nx[robot])
            if visit == self.path.first[robot + 1] or self.edge[self._lanes[visit]] != here:
                visit -= 1  # it has not left the edge to the vertex behind it, or the one it was inserted on
            ahead, stops = self._ahead(robot, visit)
            if not ahead:  # a new plan in which it stays where it is
                ahead = self._exit(self.graph.lane_between(*lane_ends(here)))
                stops = not ahead
            self.sumo.set_route(robot, [here, *ahead], stops)

    def _ahead(self, robot: int, visit: int) -> tuple[list[str], bool]:
        """The edges after a visit's, and whether the route has to end in a stop."""
        end = int(self.path.first[robot + 1])
        until = min(visit + AHEAD, end - 1)
        edges = [self.edge[lane] for lane in self._lanes[visit + 1 : until + 1]]
        self.state.routed[robot] = until
        if until < end - 1:
            return edges, False
        self.state.routed[robot] = end
        if self._lanes[until] < 0:
            return edges, False
        beyond = self._exit(self._lanes[until])
        return edges + beyond, not beyond

    def _exit(self, lane: int) -> list[str]:
        """An edge that leads on from a lane's end, back if possible."""
        if self.graph.reverse[lane] >= 0:
            return [self.edge[int(self.graph.reverse[lane])]]
        head = int(self.graph.head[lane])
        onward = range(int(self.graph.first[head]), int(self.graph.first[head + 1]))
        return [self.edge[onward[0]]] if onward else []
