"""The tree of conflict-based search over any motion: nodes forbid robots actions, and each takes its earliest way that is allowed."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from heapq import heappop, heappush
from time import process_time
from typing import Any, Protocol

import numpy as np

from mrp_sumo.core.plan import Plan

EPS = 1e-6  # s that are no more than nothing

Both = tuple[Any, Any]  # constraints of two robots
Split = tuple[Both, Both]  # where the first gives way, and where the second does


@dataclass(eq=False)
class TimedConflict:
    """Two robots that cannot both drive their ways."""

    robot: int
    other: int
    path: int
    other_path: int
    what: tuple[int, ...]  # in the motion's terms
    sides: "tuple[Side, Side] | None" = None  # how either gives way, once that has been looked for


@dataclass(frozen=True, eq=False)
class Side:
    """One robot of a conflict that gives way, and the other that keeps its path."""

    robot: int
    keeper: int
    forbidden: Any
    keepers: Any  # constraints of the other
    path: int | None  # of the one that gives way, None: there is none
    more_s: float  # than it costs now


class LowLevel(Protocol):
    """Motion of robots. It keeps the paths that it finds, by number."""

    nothing: Any  # what robots are forbidden at first

    def clash(self) -> str:
        """Why no two ways could do, such as goals that are too close; '' for no such reason."""

    def search(self, robot: int, forbidden: Any) -> int | None:
        """The earliest way of a robot."""

    def cost_s(self, path: int) -> float:
        """Time at which the robot is at its goal to stay."""

    def conflicts(self, robot: int, path: int, others: Sequence[int], their_paths: Sequence[int]) -> list[TimedConflict]:
        """A robot's conflicts with others."""

    def splits(self, conflict: TimedConflict, ours: Any, theirs: Any) -> list[Split]:
        """Constraints of both robots where either gives way, in one or more manners: each solution obeys those of one or the other."""

    def least_cost_s(self, robot: int, other: int, ours: Any, theirs: Any) -> float:
        """Least cost of two robots that are forbidden this and must not conflict."""

    def some_paths(self, rng: np.random.Generator, enough_s: float, deadline_s: float) -> list[int] | None:
        """Ways of all robots without conflicts, not the best, if they are found; a cost of `enough_s` will do."""

    def plan(self, their_paths: Sequence[int]) -> Plan:
        """The robots' ways as a plan."""


@dataclass(eq=False)
class TimedNode:
    """Constraints of robots, their paths under them, and their conflicts."""

    forbidden: list[Any]
    paths: list[int]
    cost_s: float
    bound_s: float  # on the costs of all below
    conflicts: list[TimedConflict]
    estimated: bool = False  # whether the bound has the heuristic in it
    closed: bool = False


class OutOfTime(Exception):
    """The time limit is over."""


@dataclass(eq=False)
class TimedTree:
    """Nodes over some robots."""

    motion: LowLevel
    robots: Sequence[int]
    deadline_s: float  # on the clock of process_time
    pairs: bool = True  # whether the heuristic knows what two robots cost together
    nodes: int = 0  # that have been expanded
    bound_s: float = 0.0  # on the cost of any plan
    _together: dict[tuple[int, int, int, int], float] = field(default_factory=dict)
    _alive: list[Any] = field(default_factory=list)  # objects whose identities are keys
    _serial: int = 0

    def best_first(self, forbidden: list[Any], max_nodes: int) -> list[int] | None:
        """The ways of least cost. Without one, the bound is infinite where there is none."""
        node = self._root(forbidden)
        heap = [] if node is None else [(node.bound_s, len(node.conflicts), 0, node)]
        while heap:
            self.bound_s, _, _, node = heappop(heap)
            if not node.conflicts:
                return node.paths
            if not node.estimated:
                self._estimate(node)
                if node.bound_s > self.bound_s + EPS:
                    heappush(heap, (node.bound_s, len(node.conflicts), self._next(), node))
                    continue
            if self.nodes >= max_nodes:
                return None
            for child in self._children(node):
                heappush(heap, (child.bound_s, len(child.conflicts), self._next(), child))
        self.bound_s = np.inf
        return None

    def focal(self, forbidden: list[Any], w: float, max_nodes: int, rng: np.random.Generator) -> list[int] | None:
        """Ways that cost at most w times the least: in turns, the node with the fewest conflicts of those within that is next, or the one
        with the least bound. Ways found otherwise will do as soon as the bound says so.
        """
        node, known = self._root(forbidden), None
        if node is not None:
            self._estimate(node)
            known = self.motion.some_paths(rng, w * node.bound_s, (process_time() + self.deadline_s) / 2)
        known_s = np.inf if known is None else sum(map(self.motion.cost_s, known))
        least = [] if node is None else [(node.bound_s, 0, node)]
        beyond = [] if node is None else [(node.cost_s, 0, node)]
        near: list[tuple[int, float, int, TimedNode]] = []
        while True:
            while least and (least[0][2].closed or not least[0][2].estimated):
                _, serial, node = heappop(least)
                if not node.closed:
                    self._estimate(node)
                    heappush(least, (node.bound_s, serial, node))
            if not least or least[0][0] == np.inf:
                self.bound_s = np.inf
                return None
            self.bound_s = least[0][0]
            if known_s <= w * self.bound_s + EPS:
                return known
            while beyond and beyond[0][0] <= w * self.bound_s + EPS:
                cost_s, serial, node = heappop(beyond)
                heappush(near, (len(node.conflicts), cost_s, serial, node))
            while near and near[0][3].closed:
                heappop(near)
            node = least[0][2] if self.nodes % 2 or not near else heappop(near)[3]
            if not node.conflicts:
                return node.paths
            if self.nodes >= max_nodes:
                return None
            node.closed = True
            for child in self._children(node):
                serial = self._next()
                heappush(least, (child.bound_s, serial, child))
                heappush(beyond, (child.cost_s, serial, child))

    def _next(self) -> int:
        self._serial += 1
        return self._serial

    def _root(self, forbidden: list[Any]) -> TimedNode | None:
        paths: list[int] = []
        conflicts: list[TimedConflict] = []
        for k, (robot, its) in enumerate(zip(self.robots, forbidden)):
            path = self.motion.search(robot, its)
            if path is None:
                return None
            conflicts += self.motion.conflicts(k, path, range(k), paths)
            paths.append(path)
        cost_s = sum(map(self.motion.cost_s, paths))
        return TimedNode(forbidden, paths, cost_s, cost_s, conflicts)

    def _children(self, node: TimedNode) -> list[TimedNode]:
        self.nodes += 1
        return [child for side in self._sides(node, self._chosen(node)) if (child := self._child(node, side))]

    def _chosen(self, node: TimedNode) -> TimedConflict:
        """That conflict of which the cheaper child costs most: a cardinal one, if there is any."""

        return max(node.conflicts, key=lambda conflict: least_more_s(self._sides(node, conflict)))

    def _sides(self, node: TimedNode, conflict: TimedConflict) -> tuple[Side, Side]:
        if conflict.sides is None:
            if process_time() > self.deadline_s:
                raise OutOfTime
            k, m = conflict.robot, conflict.other
            splits = self.motion.splits(conflict, node.forbidden[k], node.forbidden[m])
            sides = [(self._side(node, k, m, *one), self._side(node, m, k, *two[::-1])) for one, two in splits]
            conflict.sides = max(sides, key=least_more_s)
        return conflict.sides

    def _side(self, node: TimedNode, k: int, m: int, forbidden: Any, keepers: Any) -> Side:
        path = self.motion.search(self.robots[k], forbidden)
        more_s = np.inf if path is None else self.motion.cost_s(path) - self.motion.cost_s(node.paths[k])
        return Side(k, m, forbidden, keepers, path, more_s)

    def _child(self, node: TimedNode, side: Side) -> TimedNode | None:
        if side.path is None:
            return None
        k, m, forbidden, paths = side.robot, side.keeper, list(node.forbidden), list(node.paths)
        changed = side.keepers is not forbidden[m]
        forbidden[k], forbidden[m], paths[k] = side.forbidden, side.keepers, side.path
        others = [other for other in range(len(paths)) if other != k]
        conflicts = [conflict for conflict in node.conflicts if k not in (conflict.robot, conflict.other)]
        if changed:
            conflicts = [replace(conflict, sides=None) if m in (conflict.robot, conflict.other) else conflict for conflict in conflicts]
        conflicts += self.motion.conflicts(k, side.path, others, [paths[other] for other in others])
        cost_s = node.cost_s + side.more_s
        return TimedNode(forbidden, paths, cost_s, max(cost_s, node.bound_s), conflicts)

    def _estimate(self, node: TimedNode) -> None:
        node.estimated = True
        node.bound_s = max(node.bound_s, node.cost_s + self._heuristic_s(node))

    def _heuristic_s(self, node: TimedNode) -> float:
        """What all solutions below cost more at least (WDG)."""
        more: dict[tuple[int, int], float] = {}
        for conflict in node.conflicts:
            one, other = self._sides(node, conflict)
            pair = min(one.robot, other.robot), max(one.robot, other.robot)
            more[pair] = max(more.get(pair, 0.0), min(one.more_s, other.more_s))
        if self.pairs:
            more = {pair: max(more_s, self._more_together_s(node, *pair)) for pair, more_s in more.items()}
        return cover_s({pair: more_s for pair, more_s in more.items() if more_s > EPS})

    def _more_together_s(self, node: TimedNode, k: int, m: int) -> float:
        ours, theirs = node.forbidden[k], node.forbidden[m]
        key = k, m, id(ours), id(theirs)
        if key not in self._together:
            if process_time() > self.deadline_s:
                raise OutOfTime
            self._alive += [ours, theirs]
            self._together[key] = self.motion.least_cost_s(self.robots[k], self.robots[m], ours, theirs)
        return self._together[key] - self.motion.cost_s(node.paths[k]) - self.motion.cost_s(node.paths[m])


def least_more_s(sides: tuple[Side, Side]) -> tuple[float, float]:
    """Seconds by which the cheaper of two sides costs more than now, then the other."""
    one, other = sides[0].more_s, sides[1].more_s
    return min(one, other), max(one, other)


def cover_s(more: dict[tuple[int, int], float]) -> float:
    """The least sum of costs x_k >= 0 of robots with x_k + x_m >= `more` for each pair.

    It is half the weight of the heaviest matching in the graph's bipartite double cover, by duality.
    """
    if not more:
        return 0.0
    if np.inf in more.values():
        return np.inf
    from scipy.optimize import linear_sum_assignment

    robots = sorted({k for pair in more for k in pair})
    weight = np.zeros((len(robots), len(robots)))
    for (k, m), more_s in more.items():
        i, j = robots.index(k), robots.index(m)
        weight[i, j] = weight[j, i] = more_s
    return float(weight[linear_sum_assignment(weight, maximize=True)].sum() / 2)
