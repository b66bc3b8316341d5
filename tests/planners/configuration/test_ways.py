"""Shortest ways that meet few others, and who is guided by them."""

from itertools import pairwise

import numpy as np
import pytest
from worlds import on_a_circle, problem_on, random_grid

from mrp_sumo.core.plan import paths_of_plan
from mrp_sumo.traffic.referee import judge
from planners.configuration.guides import are_thin, own_ways
from planners.configuration.lacam import Lacam
from planners.configuration.pibt import Pibt
from planners.world import ByConfigurations, build_world, search_start, small_problem

pytestmark = pytest.mark.kernel


def ways_of(problem, rounds=2, packed=False):
    world, steps = build_world(problem, np.inf, packed=packed)
    return own_ways(problem, rounds, world, np.inf, np.random.default_rng(1)), world.table, steps


def meetings(ways, steps):
    """Pairs and steps at which two are at one vertex, or change places, while both are on their ways."""
    count = 0
    for i in range(len(ways)):
        for j in range(i):
            both = min(steps[i], steps[j])
            a, b = ways[i, : both + 1], ways[j, : both + 1]
            count += int((a == b).sum()) + int(((a[1:] == b[:-1]) & (a[:-1] == b[1:])).sum())
    return count


def test_ways_are_shortest_ways_along_lanes():
    problem = random_grid(9, 8, 3)
    ways, table, steps = ways_of(problem)
    for robot, route in enumerate(ways.tolist()):
        route = route[: steps[robot] + 1]
        assert (route[0], route[-1]) == (problem.start[robot], problem.target[robot])
        assert [int(table[robot, v]) for v in route] == list(range(int(steps[robot]), -1, -1))
        assert all(problem.graph.lane_between(u, v) >= 0 for u, v in pairwise(route))
    assert (ways_of(problem, packed=True)[0] == ways).all()


def test_ways_meet_fewer_than_ways_by_chance():
    ours = chance = 0
    for seed in range(5):
        problem = random_grid(12, 20, seed, 0.1)
        ways, _, steps = ways_of(problem)
        alone, *_ = ways_of(problem, rounds=1)
        ours += meetings(ways, steps)
        blind = np.stack([ways_of(problem_on(problem.graph, [s], [g]))[0][0].tolist() + [-1] * (alone.shape[1] - 1 - steps[r])
                          for r, (s, g) in enumerate(zip(problem.start.tolist(), problem.target.tolist()))])  # fmt: skip
        chance += meetings(blind, steps)
    assert ours < chance / 3


def test_two_that_change_places_on_a_ring_go_the_same_way_round():
    ring = on_a_circle([lane for i in range(10) for lane in ((i, (i + 1) % 10), ((i + 1) % 10, i))], 10)
    ways, *_ = ways_of(problem_on(ring, [0, 5], [5, 0]))
    assert (ways[0, 1] - ways[0, 0]) % 10 == (ways[1, 1] - ways[1, 0]) % 10
    for planner in (Pibt(), Lacam(polish=0)):
        planner.prepare()
        result = planner.plan(problem_on(ring, [0, 5], [5, 0]), 10.0)
        assert judge(problem_on(ring, [0, 5], [5, 0]), result.plan).valid
        assert [len(path) - 1 for path in paths_of_plan(result.plan, 1.0)] == [5, 5]


def test_crowds_are_guided_by_the_flow():
    ring = on_a_circle([lane for i in range(10) for lane in ((i, (i + 1) % 10), ((i + 1) % 10, i))], 10)
    crowd = problem_on(ring, list(range(10)), [(i + 5) % 10 for i in range(10)])  # 50 moves for 20 lanes
    assert not are_thin(crowd, np.full(10, 5))
    opening = search_start(ByConfigurations(), crowd, np.inf, 0, False)
    assert not len(opening.guided.path) and opening.guided.guided
    assert are_thin(small_problem(), np.array([2, 2]))  # so that both are compiled ahead
