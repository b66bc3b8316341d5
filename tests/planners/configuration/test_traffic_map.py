"""Traffic maps: where time was lost, lanes are dear."""

import numpy as np
import pytest
from worlds import graph_of, problem_on

from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.traffic.draw import uniform_draw
from mrp_sumo.traffic.referee import judge
from planners.configuration._flow import MOST, STEP, TrafficMap, observe, write_tolls
from planners.configuration.lacam import Lacam
from planners.world import build_world


@pytest.fixture(scope="module", autouse=True)
def compiled():
    Lacam().prepare()


@pytest.mark.kernel
def test_a_lane_costs_what_robots_took_to_get_over_it():
    line = graph_of([[0, 0], [1, 0], [2, 0], [3, 0]], [(0, 1), (1, 2), (2, 3)])
    problem = problem_on(line, [1], [3])
    world = build_world(problem, np.inf, packed=False)[0]
    traffic, toll = TrafficMap(np.zeros(6, np.int64), np.zeros(6, np.int64)), np.empty(6, np.int64)
    observe(world, traffic, np.array([[1], [1], [0], [1], [2], [3], [3]], np.int32))  # waits once, and is pushed aside by two steps
    cost = {(int(a), int(b)): k for k, (a, b) in enumerate(zip(line.tail, line.head, strict=True))}
    write_tolls(traffic, toll)
    assert toll[cost[1, 2]] == min(STEP + STEP * 3 // 2, MOST)
    assert toll.sum() == toll[cost[1, 2]] + 5 * STEP


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
