"""Robots at rest within the tolerance of their goals at the end have reached them."""

import numpy as np
import pytest
from worlds import line

from mrp_sumo.core.execution import Execution, Outcome
from mrp_sumo.drive.arrivals import with_goals_within

T = np.arange(0.0, 5.0)


def ended(x, speed=0.0, goal_s=np.nan):
    """One robot on a corridor from x = 0 to x = 4, and where it is second by second."""
    graph = line(5, 1.0)
    along = np.array(x, np.float64)[:, None]
    still = np.zeros_like(along)
    moving = np.full_like(along, speed)
    run = Execution(T, along, still, still, moving, np.zeros(0), np.array([goal_s]), Outcome.TIME_LIMIT, "adg", 4.0, 0.0, 0.0)
    return with_goals_within(run, graph.xy, np.array([4]), 0.7)


def test_robot_that_comes_to_rest_within_the_tolerance_has_reached_its_goal_since_then():
    result = ended([0, 2, 3.5, 3.5, 3.5])
    assert result.goal_s.tolist() == [2.0]
    assert [(event.t_s, event.kind, event.vertex) for event in result.events] == [(2.0, "goal", 4)]


@pytest.mark.parametrize(("x", "speed"), [([0, 1, 2, 3, 3], 0.0), ([3.5] * 5, 0.2), ([3.5, 3.5, 3.5, 2, 2], 0.0)])
def test_robot_that_is_farther_or_moves_or_left_again_has_not(x, speed):
    result = ended(x, speed)
    assert np.isnan(result.goal_s).all() and not result.events


def test_robot_that_arrived_keeps_its_time():
    assert ended([0, 2, 4, 4, 4], goal_s=1.5).goal_s.tolist() == [1.5]
