"""Slow truth: the least sum of costs by searching all joint states, and small random questions to ask."""

from dataclasses import replace
from functools import cache
from heapq import heappop, heappush
from itertools import product

import numpy as np
from worlds import on_a_circle

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.traffic.resources import resources_of

ROBOT = RobotType("square", 0.3, 0.3, 1.0, 1.0, 1.0, 1.0)


def least_cost(problem, *, following=False, on_map=None):
    """The least sum of costs, None when there is no plan. A joint state says where all are and who has stopped for good.

    `on_map` is the problem on the map, where `problem` is that on the graph of the moves of its vehicles.
    """
    graph, target = problem.graph, problem.target.tolist()
    count = problem.num_robots
    rules = Rules(on_map or problem) if problem.drivable else None
    place = (np.arange(graph.num_vertices) if on_map is None else graph.place).tolist()
    moves = [[*graph.head[graph.first[v] : graph.first[v + 1]].tolist(), v] for v in range(graph.num_vertices)]
    begin = (tuple(problem.start.tolist()), (False,) * count)
    best = {begin: 0}
    queue = [(0, begin)]
    while queue:
        cost, state = heappop(queue)
        if cost > best[state]:
            continue
        at, stopped = state
        if all(stopped):
            return cost
        for robot in range(count):  # stopping takes no time
            if not stopped[robot] and at[robot] == target[robot]:
                after = (at, (*stopped[:robot], True, *stopped[robot + 1 :]))
                if cost < best.get(after, np.inf):
                    best[after] = cost
                    heappush(queue, (cost, after))
        for there in product(*([at[r]] if stopped[r] else moves[at[r]] for r in range(count))):
            here, onward = [place[v] for v in at], [place[v] for v in there]
            if len(set(onward)) < count or _collide(here, onward, following) or (rules and not rules.allow(here, onward)):
                continue
            after = (there, stopped)
            new = cost + count - sum(stopped)
            if new < best.get(after, np.inf):
                best[after] = new
                heappush(queue, (new, after))
    return None


def _collide(at, there, following):
    for i in range(len(at)):
        for j in range(len(at)):
            if i != j and at[i] == there[j] and (following or at[j] == there[i]):
                return True
    return False


def random_problem(seed, *, directed=None, most_robots=3, side=4):
    """A small grid with obstacles, or a small graph of directed lanes."""
    rng = np.random.default_rng([seed, 77])
    if directed is None:
        directed = bool(rng.random() < 0.3)
    if directed:
        size = int(rng.integers(4, 8))
        ring = rng.permutation(size)
        pairs = {(int(a), int(b)) for a, b in zip(ring, np.roll(ring, 1))}
        for _ in range(int(rng.integers(1, 2 * size))):
            a, b = rng.choice(size, 2, replace=False).tolist()
            pairs |= {(a, b)} if rng.random() < 0.5 else {(a, b), (b, a)}
        graph = on_a_circle(sorted(pairs), size)
    else:
        height, width = rng.integers(2, side + 1, 2).tolist()
        free = rng.random((height, width)) > 0.25
        free[0, :2] = True
        graph = grid_graph(free, 1.0, (0.0, 0.0))
    num_robots = int(min(rng.integers(1, most_robots + 1), graph.num_vertices - 1))
    return Problem(
        graph=graph,
        fleet=fleet_of(ROBOT, num_robots),
        start=rng.permutation(graph.num_vertices)[:num_robots],
        goal=rng.permutation(graph.num_vertices)[:num_robots],
        goal_of=np.arange(num_robots),
        step_s=1.0,
        seed=seed,
    )


class Rules:
    """What robots may do in one step where plans are to be driven in their order, straight from the resources."""

    def __init__(self, problem):
        graph = problem.graph
        self.graph, self.found = graph, resources_of(graph, problem.fleet.separation_m)
        self.clash = cache(self._clash)

    def held(self, u, v):
        """(resource, place) of the zones and groups that a robot holds while it goes from u to v, or waits."""
        result = self.found
        places = {u, v} | ({self.graph.num_vertices + int(result.track[self.graph.lane_between(u, v)])} if u != v else set())
        return {(int(q), p) for p in places for q in result.zones_at(p, 0)}

    def _clash(self, one, other):
        """Whether two moves (u, v) need places of one zone, or one group."""
        zones = len(self.found.zone)
        return any(q == r and (a != b or q >= zones) for q, a in self.held(*one) for r, b in self.held(*other))

    def allow(self, at, there):
        """Whether all robots may go from `at` to `there` at once."""
        moves = list(zip(at, there))
        if len(set(there)) < len(there) or _collide(at, there, False) or rotates(at, there):
            return False
        return not any(self.clash(moves[i], moves[j]) for i in range(len(moves)) for j in range(i))


def rotates(at, there):
    """Whether robots in a ring each go to where the next one was."""
    onward = {u: v for u, v in zip(at, there) if u != v}
    for start in onward:
        v = onward[start]
        for _ in onward:
            if v == start:
                return True
            v = onward.get(v, -1)
    return False


def crowded_problem(seed, most_robots=3, num_vertices=7):
    """A small roadmap in which places that do not meet are too close, some of them in a mutex group; to be driven in its order."""
    rng = np.random.default_rng([seed, 78])
    xy = rng.uniform(0, 1.7, (num_vertices, 2))
    length = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    pairs = [(i, j) for i in range(num_vertices) for j in range(i) if length[i, j] >= 0.5 and rng.random() < 0.45]
    lanes = [lane for a, b in pairs for lane in (((a, b), (b, a)) if rng.random() < 0.9 else ((a, b),))]
    nav = nav_graph(name="crowded", xy=xy, lanes=lanes)
    grouped = [{"mutex": "narrow"} if rng.random() < 0.15 else {} for _ in range(nav.num_lanes + num_vertices)]
    if rng.random() < 0.5:
        nav = replace(nav, lane_options=tuple(grouped[: nav.num_lanes]), vertex_options=tuple(grouped[nav.num_lanes :]))
    graph = plan_graph(nav, kind="roadmap", cell_m=0.5)
    fleet = fleet_of(RobotType("disc", 0.3, 0.2, 1.0, 1.0, 1.0, 1.0), most_robots)
    rules = Rules(Problem(graph, fleet, np.arange(most_robots), np.arange(most_robots), np.arange(most_robots), 1.0))

    def placed():
        chosen = []
        for v in rng.permutation(num_vertices).tolist():
            if len(chosen) < most_robots and not any(rules.clash((v, v), (w, w)) for w in chosen):
                chosen.append(v)
        return chosen

    start, goal = placed(), placed()
    count = min(len(start), len(goal))
    fleet = fleet_of(RobotType("disc", 0.3, 0.2, 1.0, 1.0, 1.0, 1.0), count)
    return Problem(graph, fleet, np.array(start[:count]), np.array(goal[:count]), np.arange(count), 1.0, drivable=True)
