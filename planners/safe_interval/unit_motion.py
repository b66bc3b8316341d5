"""The literature's motion: discs of one radius that drive at one speed and turn at once."""

from collections.abc import Sequence
from time import process_time
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, PlanGraph
from mrp_sumo.core.plan import Plan, plan_of_visits
from mrp_sumo.core.problem import Problem
from planners.safe_interval import _corridors, _disc_pairs, _discs
from planners.safe_interval.conflict_tree import Split, TimedConflict

MOST = 1024  # conflicts of one way
ORDERS = 60  # of robots that are tried
NEIGHBOURHOOD, NEIGHBOURHOODS = 9, 1000  # most robots in one, and how many are tried
ANY = 0.2  # that a neighbourhood is any robots
WORSE = 0.005  # of the cost: the mean by which ways may be worse that are kept, at first
MOST_NODES = 400  # of a tree over two robots
ROOM = 1 << 15  # for moves of their ways, and for rules
PER_PAIR = 4  # with each other, the first ones


class UnitMotion:
    """A problem in the literature's motion, with the ways that have been found in it."""

    def __init__(self, problem: Problem, radius_m: float, speed_mps: float) -> None:
        graph = problem.graph
        self.problem = problem
        self._start, self._goal = problem.start.tolist(), problem.target.tolist()
        self.nothing = _discs.new_rules(0)
        duration_s = graph.length_m / speed_mps
        self._lanes = lanes_of(graph, duration_s, 2 * radius_m)
        self._left_s = seconds_left(graph, duration_s, problem.target)
        self._scratch = _discs.new_scratch(graph.num_vertices, graph.num_lanes, 1 << 13)
        self._paths = _discs.new_ways(64)
        self._num_ways = 0
        self._arrival: list[float] = []  # of each way
        self._starts, self._goals = problem.start, problem.target
        self._room = 1 << 12
        self._forbidden: dict[int, tuple[FloatArray, FloatArray]] = {}  # by the ways at hand, to others
        self._pair = _disc_pairs.new_pair(MOST_NODES, ROOM)
        self._rules = [_discs.new_rules(ROOM // 8) for _ in range(3)]
        self._rows = np.zeros(1 << 8, _discs.RULE)
        self._found, self._of = np.zeros((MOST, 3), np.int64), np.zeros(MOST, np.int64)

    def clash(self) -> str:
        """Robots whose starts or goals are too close to each other."""
        problem, xy = self.problem, self._lanes.xy
        for what, place in (("start", problem.start), ("have to end", problem.target)):
            for robot in range(1, problem.num_robots):
                near = np.flatnonzero(np.hypot(*(xy[place[:robot]] - xy[place[robot]]).T) < self._lanes.reach - 1e-9)
                if len(near):
                    names, label = problem.fleet.robot_name, problem.graph.label
                    both = f"'{label(int(place[near[0]]))}' and '{label(int(place[robot]))}'"
                    return f"{names[near[0]]} and {names[robot]} {what} at {both}, which are too close to each other"
        return ""

    def cost_s(self, path: int) -> float:
        return self._arrival[path]

    def search(self, robot: int, forbidden: _discs.DiscConstraints) -> int | None:
        start = self._start[robot]
        trip = self._left_s[robot], start, self._goal[robot]
        while (entry := _discs.find(self._lanes, trip, forbidden, self._scratch, True, -1)) == -2:
            self._scratch = _discs.new_scratch(len(self._lanes.first) - 1, len(self._lanes.tail), 4 * len(self._scratch.heap))
        return None if entry < 0 else self._kept(start, entry)

    def _kept(self, start: int, entry: int) -> int:
        path, paths = self._num_ways, self._paths
        while not _discs.write_way(entry, self._scratch, start, path, paths):
            paths = self._paths = _discs.DiscPaths(*(np.concatenate([column, np.zeros_like(column)]) for column in paths))
        self._num_ways += 1
        self._arrival.append(float(self._scratch.arrived[entry]))
        return path

    def conflicts(self, robot: int, path: int, others: Sequence[int], their_paths: Sequence[int]) -> list[TimedConflict]:
        num = _discs.conflicts_with_all(self._lanes, self._paths, path, np.array(their_paths, np.int64), PER_PAIR, self._found, self._of)
        return [
            TimedConflict(robot, others[k], path, their_paths[k], what)
            for k, what in zip(self._of[:num].tolist(), map(tuple, self._found[:num].tolist()))
        ]

    def splits(self, conflict: TimedConflict, ours: _discs.DiscConstraints, theirs: _discs.DiscConstraints) -> list[Split]:
        """See `_corridors.rules_of`."""
        kind, part, other_part = conflict.what
        met = _discs.DiscConflict(kind, part, other_part, conflict.path, conflict.other_path)
        outcome = []
        for keeper in range(2):
            while True:
                num, others = _corridors.rules_of(self._lanes, self._paths, met, (ours, theirs), self._scratch, keeper, self._rows)
                if num + others <= len(self._rows):
                    break
                self._rows = np.zeros(2 * (num + others), _discs.RULE)
            if num:
                outcome.append((self._with(ours, theirs, 0, num), self._with(ours, theirs, num, num + others)))
            if num + others == 2:
                break
        return outcome

    def _with(self, ours: _discs.DiscConstraints, theirs: _discs.DiscConstraints, begin: int, end: int) -> tuple[Any, Any]:
        """Constraints of both robots and the rows from `begin` to `end`; the same objects where there are none for a robot."""
        robots = set(self._rows["robot"][begin:end].tolist())
        return (
            _discs.with_rules(ours, self._rows, 0, begin, end) if 0 in robots else ours,
            _discs.with_rules(theirs, self._rows, 1, begin, end) if 1 in robots else theirs,
        )

    def least_cost_s(self, robot: int, other: int, ours: _discs.DiscConstraints, theirs: _discs.DiscConstraints) -> float:
        """Least cost of two robots that are forbidden this."""
        both = [robot, other]
        ends = self._left_s[both], self._starts[both], self._goals[both]
        most = max(ours.count.max(), theirs.count.max())
        if 2 * most > self._rules[0].place.shape[1]:
            self._rules = [_discs.new_rules(4 * most) for _ in range(3)]
        one, two, more = self._rules
        task = _disc_pairs.PairTask(self._lanes, *ends, (ours, theirs), (one, two), more, self._scratch)
        return float(_disc_pairs.least_cost(task, self._pair))

    def some_paths(self, rng: np.random.Generator, enough_s: float, deadline_s: float) -> list[int] | None:
        """Ways without conflicts, not the best: prioritised planning, then neighbourhoods planned again, annealed."""
        num_robots = len(self._start)
        order = np.argsort([-self._left_s[r, v] for r, v in enumerate(self._start)], kind="stable").tolist()
        for k in range(ORDERS):
            path_of, failed = self._in_order(order, {})
            if failed is None:
                break
            if process_time() > deadline_s:
                return None
            order = rng.permutation(num_robots).tolist() if k % 8 == 7 else [failed, *(r for r in order if r != failed)]
        else:
            return None
        ideal = [path for robot in range(num_robots) if (path := self.search(robot, self.nothing)) is not None]
        best, cost_s = path_of, sum(map(self.cost_s, path_of.values()))
        best_s = cost_s
        for k in range(NEIGHBOURHOODS):
            if best_s <= enough_s or process_time() > deadline_s:
                break
            robots = self._neighbourhood(path_of, ideal, rng)
            other, failed = self._in_order(robots, {r: path for r, path in path_of.items() if r not in robots})
            other_s = sum(map(self.cost_s, other.values()))
            if failed is None and other_s < cost_s + rng.exponential(WORSE * cost_s * (1 - k / NEIGHBOURHOODS)):
                path_of, cost_s = other, other_s
            if cost_s < best_s:
                best, best_s = path_of, cost_s
            self._forbidden = {path: self._forbidden[path] for path in path_of.values() if path in self._forbidden}
        return [best[robot] for robot in range(num_robots)]

    def _neighbourhood(self, paths: dict[int, int], ideal: list[int], rng: np.random.Generator) -> list[int]:
        """Robots to be planned again, in this order: a late one and some of those in its ideal way, or any."""
        num_robots = len(paths)
        if rng.random() < ANY:
            return list(map(int, rng.permutation(num_robots)[: rng.integers(2, NEIGHBOURHOOD + 1)]))
        late = np.array([self.cost_s(paths[robot]) - self._left_s[robot, v] for robot, v in enumerate(self._start)]) + 1e-6
        robot = int(rng.choice(num_robots, p=late / late.sum()))
        others = [r for r in range(num_robots) if r != robot]
        blockers = {c.other for c in self.conflicts(robot, ideal[robot], others, [paths[r] for r in others])}
        chosen = rng.permutation(sorted(blockers) or others)[: rng.integers(1, NEIGHBOURHOOD)]
        return list(map(int, rng.permutation([robot, *chosen])))

    def _in_order(self, robots: list[int], paths: dict[int, int]) -> tuple[dict[int, int], int | None]:
        """The ways, and those of more robots, each around all before it; and the robot that has found none."""
        paths = dict(paths)
        for robot in robots:
            path = self.search(robot, self._around(list(paths.values())))
            if path is None:
                return paths, robot
            paths[robot] = path
        return paths, None

    def _around(self, paths: list[int]) -> _discs.DiscConstraints:
        """What a robot may not do among others on these ways."""
        rows = [self._forbidden_by(path) for path in paths]
        moves, stays = (np.hstack([np.zeros((3, 0)), *(row[kind] for row in rows)]) for kind in range(2))
        rules: _discs.DiscConstraints = _discs.new_rules(max(moves.shape[1], stays.shape[1]))
        _discs.sort_rules(moves, len(self._lanes.tail), 0, rules)
        _discs.sort_rules(stays, len(self._lanes.first) - 1, 1, rules)
        return rules

    def _forbidden_by(self, path: int) -> tuple[FloatArray, FloatArray]:
        """[3, K] departures and [3, M] stays, see `_discs.forbidden_by`."""
        if path not in self._forbidden:
            while True:
                rows, num_moves, num_stays = _discs.forbidden_by(self._lanes, self._paths, path, self._room)
                if num_moves >= 0:
                    break
                self._room *= 4
            self._forbidden[path] = rows[0, :, :num_moves].copy(), rows[1, :, :num_stays].copy()
        return self._forbidden[path]

    def plan(self, their_paths: Sequence[int]) -> Plan:
        paths, visits = self._paths, []
        for path in their_paths:
            moves = slice(int(paths.first[path]), int(paths.first[path + 1]))
            lane, left = paths.lane[moves], paths.left[moves]
            vertex = np.append(paths.start[path], self._lanes.head[lane])
            arrive = np.append(0.0, left + self._lanes.duration[lane])
            visits.append((vertex, arrive, np.append(left, np.inf)))
        return plan_of_visits(visits)


def lanes_of(graph: PlanGraph, duration_s: FloatArray, reach_m: float) -> _discs.Lanes:
    """The graph as arrays, for discs that keep `reach_m` from each other."""
    num_vertices = graph.num_vertices
    vertex, neighbour = np.append(graph.tail, graph.head), np.append(graph.head, graph.tail)
    least, most = np.full(num_vertices, num_vertices), np.full(num_vertices, -1)
    np.minimum.at(least, vertex, neighbour)
    np.maximum.at(most, vertex, neighbour)
    inner = least < most
    inner[vertex[(neighbour != least[vertex]) & (neighbour != most[vertex])]] = False
    speed_mps = (np.hypot(*(graph.xy[graph.head] - graph.xy[graph.tail]).T) / duration_s).max(initial=0.0)
    return _discs.Lanes(
        graph.first, graph.tail, graph.head, graph.xy, duration_s, reach_m,
        reverse=graph.reverse,
        inner=inner,
        clear=reach_m / speed_mps if speed_mps > 0 else 0.0,
        zero=np.zeros(num_vertices),
    )  # fmt: skip


def seconds_left(graph: PlanGraph, duration_s: FloatArray, goal: IntArray) -> FloatArray:
    """[G, V] from everywhere to each goal without others, inf where there is no way."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    backwards = csr_array((duration_s, (graph.head, graph.tail)), shape=(graph.num_vertices,) * 2)
    left_s: FloatArray = dijkstra(backwards, indices=goal)
    return left_s
