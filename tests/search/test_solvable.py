"""What can be seen to have no solution."""

from dataclasses import replace

import numpy as np
import pytest
from truth import crowded_problem, least_cost

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.maps.roadmap import cut_lanes
from mrp_sumo.search.solvable import order_broken, unsolvable
from mrp_sumo.traffic.clashes import clashes_of

pytestmark = pytest.mark.kernel

LINE = [(0, 1), (1, 2), (2, 3), (3, 4)]
RING = [*LINE, (4, 0)]
STAR = [(0, 1), (0, 2), (0, 3)]


def problem(edges, start, goal, num_vertices=5):
    turn = np.arange(num_vertices) * 2 * np.pi / num_vertices
    nav = nav_graph(
        name="small",
        xy=np.column_stack([np.cos(turn), np.sin(turn)]),
        lanes=[*edges, *((b, a) for a, b in edges)],
        length_m=np.ones(2 * len(edges)),
    )
    fleet = fleet_of(RobotType("dot", 0.1, 0.1, 1.0, 1.0, 1.0, 1.0), len(start))
    return Problem(
        graph=cut_lanes(nav, 1.0), fleet=fleet, start=np.array(start), goal=np.array(goal), goal_of=np.arange(len(start)), step_s=1.0
    )


@pytest.mark.parametrize(
    ("edges", "start", "goal", "broken"),
    [
        (LINE, [0, 1], [1, 0], True),
        (LINE, [0, 1, 4], [2, 3, 4], False),
        (LINE, [0, 4, 2], [0, 2, 3], True),
        (RING, [0, 1, 2], [1, 2, 0], False),
        (RING, [0, 1, 2], [1, 0, 2], True),
        (RING, [0, 1], [1, 0], False),
    ],
)
def test_robots_keep_their_order_on_lines_and_rings(edges, start, goal, broken):
    request = problem(edges, start, goal)
    assert (order_broken(request) is not None) == broken
    assert unsolvable(request, *clashes_of(request)) == broken


def test_two_robots_can_swap_on_a_star_and_three_cannot_move_round():
    two, three = problem(STAR, [1, 2], [2, 1], 4), problem(STAR, [0, 1, 2], [0, 2, 1], 4)
    assert not unsolvable(two, *clashes_of(two))
    assert unsolvable(three, *clashes_of(three))


def test_full_ring_turns_unless_following_is_forbidden():
    full = problem(RING, [0, 1, 2, 3, 4], [1, 2, 3, 4, 0])
    assert not unsolvable(full, *clashes_of(full))
    assert unsolvable(full, *clashes_of(full), following=True)
    in_order = replace(full, drivable=True)
    assert unsolvable(in_order, *clashes_of(in_order))


def test_large_problem_is_left_to_the_planner():
    line = [(k, k + 1) for k in range(600)]
    large = problem(line, list(range(500)), list(range(499, -1, -1)), 601)
    assert not unsolvable(large, *clashes_of(large))


@pytest.mark.parametrize("seed", range(30))
def test_what_cannot_be_driven_is_what_the_slow_search_does_not_find(seed):
    request = crowded_problem(seed, num_vertices=6)
    assert unsolvable(request, *clashes_of(request)) == (least_cost(request) is None)
