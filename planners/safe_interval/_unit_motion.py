"""The literature's motion: discs of one radius that drive at one speed and turn at once."""

from collections.abc import Sequence
from heapq import heappop, heappush
from time import perf_counter

import numpy as np

from mrp_sumo.core.graph import FloatArray, PlanGraph
from mrp_sumo.core.plan import Plan, plan_of_visits
from mrp_sumo.core.problem import Problem
from planners.safe_interval import _disc_pairs, _disc_ways, _discs
from planners.safe_interval._conflict_tree import Conflict

MOST = 1024  # conflicts of one way
ORDERS = 60  # of robots that are tried
NEIGHBOURHOOD, NEIGHBOURHOODS = 6, 500  # most robots in one, and how many are tried
MOST_NODES = 400  # of a tree over two robots
MOST_RULES = 128  # a robot gets in a tree of two
PER_PAIR = 4  # with each other, the first ones


class UnitMotion:
    """A problem in the literature's motion, with the ways that have been found in it."""

    def __init__(self, problem: Problem, radius_m: float, speed_mps: float) -> None:
        graph = problem.graph
        self.problem = problem
        self.reach_m, self._start, self._goal = 2 * radius_m, problem.start.tolist(), problem.target.tolist()
        self.nothing = _discs.new_rules(0, 0)
        duration_s = graph.length_m / speed_mps
        self._lanes = _discs.Lanes(graph.first, graph.tail, graph.head, graph.xy, duration_s)
        self._left_s = np.stack([seconds_left(graph, duration_s, goal) for goal in self._goal])
        self._scratch = _discs.new_scratch(graph.num_vertices, graph.num_lanes, 1 << 13)
        self._ways = _discs.new_ways(64)
        self._num_ways = 0
        self._arrival: list[float] = []  # of each way
        self._starts, self._goals = problem.start, problem.target
        self._rules = _discs.new_rules(MOST_RULES, MOST_RULES)
        self._room = 1 << 14
        self._pair = _disc_pairs.new_pair(MOST_NODES, 64 * MOST_NODES)
        self._found, self._of = np.zeros((MOST, 3), np.int64), np.zeros(MOST, np.int64)

    def clash(self) -> str:
        """Whose starts or goals are too close to each other."""
        problem, xy = self.problem, self._lanes.xy
        for what, place in (("start", problem.start), ("have to end", problem.target)):
            for robot in range(1, problem.num_robots):
                near = np.flatnonzero(np.hypot(*(xy[place[:robot]] - xy[place[robot]]).T) < self.reach_m - 1e-9)
                if len(near):
                    names, label = problem.fleet.robot_name, problem.graph.label
                    both = f"'{label(int(place[near[0]]))}' and '{label(int(place[robot]))}'"
                    return f"{names[near[0]]} and {names[robot]} {what} at {both}, which are too close to each other"
        return ""

    def cost_s(self, way: int) -> float:
        return self._arrival[way]

    def search(self, robot: int, forbidden: _discs.Rules) -> int | None:
        start = self._start[robot]
        while True:
            entry = _discs.find(self._lanes, self._left_s[robot], start, self._goal[robot], forbidden, self._scratch)
            if entry != -2:
                break
            self._scratch = _discs.new_scratch(len(self._lanes.first) - 1, len(self._lanes.tail), 4 * len(self._scratch.heap))
        return None if entry < 0 else self._kept(start, entry)

    def _kept(self, start: int, entry: int) -> int:
        way, ways = self._num_ways, self._ways
        while True:
            if _discs.write_way(entry, self._scratch, start, way, ways):
                break
            ways = self._ways = _discs.Ways(*(np.concatenate([column, np.zeros_like(column)]) for column in ways))
        self._num_ways += 1
        self._arrival.append(float(self._scratch.arrived[entry]))
        return way

    def conflicts(self, robot: int, way: int, others: Sequence[int], their_ways: Sequence[int]) -> list[Conflict]:
        num = _discs.conflicts_with_all(
            self._lanes, self._ways, way, np.array(their_ways, np.int64), self.reach_m, PER_PAIR, self._found, self._of
        )
        return [
            Conflict(robot, others[k], way, their_ways[k], found)
            for k, found in zip(self._of[:num].tolist(), map(tuple, self._found[:num].tolist()))
        ]

    def split(self, conflict: Conflict, ours: _discs.Rules, theirs: _discs.Rules) -> tuple[_discs.Rules, _discs.Rules]:
        """What to forbid either robot: see `_discs.rule_against`."""
        kind, i, j = conflict.what
        given = self._lanes, self._ways, kind, conflict.way, i, conflict.other_way, j, self.reach_m
        return _discs.with_rule(ours, *_discs.rule_against(*given, False)), _discs.with_rule(theirs, *_discs.rule_against(*given, True))

    def least_cost_s(self, robot: int, other: int, ours: _discs.Rules, theirs: _discs.Rules) -> float:
        """What two robots cost at least that are forbidden this."""
        both = [robot, other]
        room = max(ours.count.max(), theirs.count.max()) + MOST_RULES
        if len(self._rules.lane) < room:
            self._rules = _discs.new_rules(2 * room, 2 * room)
        given = self._left_s[both], self._starts[both], self._goals[both], (ours, theirs), self.reach_m
        return float(_disc_pairs.least_cost(self._lanes, *given, self._pair, self._rules, self._scratch))

    def some_ways(self, rng: np.random.Generator, enough_s: float, deadline_s: float) -> list[int] | None:
        """Ways without conflicts, not the best: prioritised planning, then neighbourhoods planned again, the better ones kept."""
        num_robots = len(self._start)
        order = np.argsort([-self._left_s[r, v] for r, v in enumerate(self._start)], kind="stable").tolist()
        for k in range(ORDERS):
            found, failed = self._in_order(order, {})
            if failed is None:
                break
            if perf_counter() > deadline_s:
                return None
            order = rng.permutation(num_robots).tolist() if k % 8 == 7 else [failed, *(r for r in order if r != failed)]
        else:
            return None
        ideal = [self.search(robot, self.nothing) for robot in range(num_robots)]
        for _ in range(NEIGHBOURHOODS):
            cost_s = sum(map(self.cost_s, found.values()))
            if cost_s <= enough_s or perf_counter() > deadline_s:
                break
            late = np.array([self.cost_s(found[robot]) - self._left_s[robot, v] for robot, v in enumerate(self._start)]) + 1e-6
            robot = int(rng.choice(num_robots, p=late / late.sum()))
            others = [r for r in range(num_robots) if r != robot]
            blockers = {c.other for c in self.conflicts(robot, ideal[robot] or 0, others, [found[r] for r in others])}
            chosen = [robot, *rng.permutation(sorted(blockers) or others)[: rng.integers(1, NEIGHBOURHOOD)].tolist()]
            rest = {r: way for r, way in found.items() if r not in chosen}
            other, failed = self._in_order(rng.permutation(chosen).tolist(), rest)
            if failed is None and sum(map(self.cost_s, other.values())) < cost_s:
                found = other
        return [found[robot] for robot in range(num_robots)]

    def _in_order(self, robots: list[int], ways: dict[int, int]) -> tuple[dict[int, int], int | None]:
        """The ways, and those of more robots, each around all before it; and the robot that has found none."""
        ways = dict(ways)
        for robot in robots:
            while True:
                rules = _disc_ways.rules_around(self._lanes, self._ways, np.array(list(ways.values()), np.int64), self.reach_m, self._room)
                if rules.count[0] >= 0:
                    break
                self._room *= 4
            way = self.search(robot, rules)
            if way is None:
                return ways, robot
            ways[robot] = way
        return ways, None

    def plan(self, their_ways: Sequence[int]) -> Plan:
        ways, visits = self._ways, []
        for way in their_ways:
            moves = slice(int(ways.first[way]), int(ways.first[way + 1]))
            lane, left = ways.lane[moves], ways.left[moves]
            vertex = np.append(ways.start[way], self._lanes.head[lane])
            arrive = np.append(0.0, left + self._lanes.duration[lane])
            visits.append((vertex, arrive, np.append(left, np.inf)))
        return plan_of_visits(visits)


def seconds_left(graph: PlanGraph, duration_s: FloatArray, goal: int) -> FloatArray:
    """[V] to a goal without others."""
    left_s = np.full(graph.num_vertices, np.inf)
    left_s[goal] = 0.0
    by_head = np.argsort(graph.head, kind="stable")
    into = np.searchsorted(graph.head[by_head], np.arange(graph.num_vertices + 1))
    heap = [(0.0, goal)]
    while heap:
        t, v = heappop(heap)
        if t > left_s[v]:
            continue
        for e in by_head[into[v] : into[v + 1]].tolist():
            u = int(graph.tail[e])
            if t + duration_s[e] < left_s[u]:
                left_s[u] = t + duration_s[e]
                heappush(heap, (float(left_s[u]), u))
    return left_s
