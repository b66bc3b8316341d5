"""Slow truth: the least sum of costs by searching all joint states, and small random questions to ask."""

from heapq import heappop, heappush
from itertools import product

import numpy as np
from worlds import on_a_circle

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.problem import Problem
from mrp_sumo.maps.grid import grid_graph

ROBOT = RobotType("square", 0.3, 0.3, 1.0, 1.0, 1.0, 1.0)


def least_cost(problem, *, following=False):
    """The least sum of costs, None when there is no plan. A joint state says where all are and who has stopped for good."""
    graph, target = problem.graph, problem.target.tolist()
    count = problem.num_robots
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
            if len(set(there)) < count or _collide(at, there, following):
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
