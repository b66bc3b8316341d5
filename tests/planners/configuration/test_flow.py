"""Guides by traffic flow."""

import numpy as np
import pytest
from worlds import on_a_circle, problem_on, random_grid

from mrp_sumo.search.distance import UNREACHABLE
from planners.configuration import _flow
from planners.configuration.pibt import Pibt
from planners.world import ByConfigurations, search_start


@pytest.fixture(scope="module", autouse=True)
def compiled():
    Pibt().prepare()


def test_guide_leads_round_lanes_that_others_come_along():
    """Two robots at opposite points of a ring change places: both ways are as long, and they go the same way round."""
    ring = on_a_circle([lane for i in range(10) for lane in ((i, (i + 1) % 10), ((i + 1) % 10, i))], 10)
    for seed in range(4):
        problem = problem_on(ring, [0, 5], [5, 0], seed)
        opening = search_start(ByConfigurations(ways=0, flow=1), problem, np.inf, 0, False)
        guide = opening.guided.guide
        assert guide[[0, 1], [5, 0]].tolist() == [0, 0]
        assert (guide[0, 1] < guide[0, 9]) == (guide[1, 6] < guide[1, 4])
        assert opening.world.table[0, 0] == 5


def test_costs_left_are_those_of_the_cheapest_way():
    problem = random_grid(9, 3, 1)
    opening = search_start(ByConfigurations(ways=0, flow=0), problem, np.inf, 0, False)
    assert not opening.guided.guided
    guide = search_start(ByConfigurations(ways=0, flow=2), problem, np.inf, 0, False).guided.guide
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
