"""Guides by traffic: flow against others, and where time was lost."""

import numpy as np
import pytest
from worlds import graph_of, on_a_circle, problem_on, random_grid

from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.search.distance import UNREACHABLE
from mrp_sumo.traffic.draw import uniform_draw
from mrp_sumo.traffic.referee import judge
from planners.configuration import _flow
from planners.configuration.lacam import Lacam
from planners.configuration.pibt import Pibt
from planners.configuration.search_start import search_start
from planners.world import build_world


@pytest.fixture(scope="module", autouse=True)
def compiled():
    Pibt().prepare()
    Lacam().prepare()


def test_guide_leads_round_lanes_that_others_come_along():
    """Two robots at opposite points of a ring change places: both ways are as long, and they go the same way round."""
    ring = on_a_circle([lane for i in range(10) for lane in ((i, (i + 1) % 10), ((i + 1) % 10, i))], 10)
    for seed in range(4):
        problem = problem_on(ring, [0, 5], [5, 0], seed)
        opening = search_start(problem, np.inf, 0, ways=0, flow=1, following=False, rotations=True, packed=False)
        guide = opening.guided.guide
        assert guide[[0, 1], [5, 0]].tolist() == [0, 0]
        assert (guide[0, 1] < guide[0, 9]) == (guide[1, 6] < guide[1, 4])
        assert opening.world.table[0, 0] == 5


def test_costs_left_are_those_of_the_cheapest_way():
    problem = random_grid(9, 3, 1)
    opening = search_start(problem, np.inf, 0, ways=0, flow=0, following=False, rotations=True, packed=False)
    assert not opening.guided.guided
    guide = search_start(problem, np.inf, 0, ways=0, flow=2, following=False, rotations=True, packed=False).guided.guide
    graph, steps = problem.graph, opening.world.table
    assert (guide >= _flow.STEP * steps).all()
    for robot in range(3):
        left = guide[robot, graph.head] - guide[robot, graph.tail]
        assert (np.abs(left) <= _flow.MOST).all()
        best = np.full(graph.num_vertices, _flow.FAR)
        np.minimum.at(best, graph.tail, left)
        onward = (steps[robot] > 0) & (steps[robot] < UNREACHABLE)
        assert onward.any()
        assert (best[onward] <= -_flow.STEP).all()  # from everywhere some lane leads on


@pytest.mark.kernel
def test_a_lane_costs_what_robots_took_to_get_over_it():
    line = graph_of([[0, 0], [1, 0], [2, 0], [3, 0]], [(0, 1), (1, 2), (2, 3)])
    problem = problem_on(line, [1], [3])
    world = build_world(problem, np.inf, packed=False)[0]
    traffic, toll = _flow.TrafficMap(np.zeros(6, np.int64), np.zeros(6, np.int64)), np.empty(6, np.int64)
    _flow.observe(world, traffic, np.array([[1], [1], [0], [1], [2], [3], [3]], np.int32))  # waits once, and is pushed aside by two steps
    cost = {(int(a), int(b)): k for k, (a, b) in enumerate(zip(line.tail, line.head, strict=True))}
    _flow.write_tolls(traffic, toll)
    assert toll[cost[1, 2]] == min(_flow.STEP + _flow.STEP * 3 // 2, _flow.MOST)
    assert toll.sum() == toll[cost[1, 2]] + 5 * _flow.STEP


def rooms_with_two_doors(seed):
    """Two rooms of 8 x 16 cells, and 60 robots."""
    free = np.ones((16, 17), bool)
    free[:, 8] = False
    free[[3, 12], 8] = True
    graph = grid_graph(free, 1.0, (0.0, 0.0))
    return problem_on(graph, *uniform_draw(graph, 60, seed), seed)


def test_to_search_again_is_never_dearer_and_mostly_cheaper():
    cheaper = 0
    for seed in range(5):
        problem = rooms_with_two_doors(seed)
        once, again = (Lacam(ways=0, flow=0, traffic=n, polish=0).plan(problem, 20.0) for n in (0, 1))
        assert judge(problem, again.plan).valid
        assert again.stats["cost"] <= once.stats["cost"] == once.stats["first_solution_cost"] == again.stats["first_solution_cost"]
        cheaper += again.stats["cost"] < once.stats["cost"]
    assert cheaper >= 3
