"""What can be seen to have no solution."""

import numpy as np
import pytest

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.graph import nav_graph
from mrp_sumo.core.problem import Problem
from mrp_sumo.maps.roadmap import cut_lanes
from mrp_sumo.search.solvable import order_broken, unsolvable

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
    asked = problem(edges, start, goal)
    assert (order_broken(asked) is not None) == broken
    assert unsolvable(asked) == broken


def test_two_robots_can_swap_on_a_star_and_three_cannot_move_round():
    assert not unsolvable(problem(STAR, [1, 2], [2, 1], 4))
    assert unsolvable(problem(STAR, [0, 1, 2], [0, 2, 1], 4))


def test_full_ring_turns_unless_following_is_forbidden():
    full = problem(RING, [0, 1, 2, 3, 4], [1, 2, 3, 4, 0])
    assert not unsolvable(full)
    assert unsolvable(full, following=True)


def test_large_problem_is_left_to_the_planner():
    line = [(k, k + 1) for k in range(600)]
    assert not unsolvable(problem(line, list(range(500)), list(range(499, -1, -1)), 601))
