"""Metres off lanes and against one-ways, on trajectories made by hand."""

import numpy as np
import pytest

from mrp_sumo.core.execution import Execution, Outcome
from mrp_sumo.core.graph import nav_graph
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.metrics.lane_keeping import lane_keeping, on_lane_m

EAST = nav_graph(name="east", xy=[(0, 0), (10, 0)], lanes=[(0, 1)])  # one-way
BOTH = nav_graph(name="both", xy=[(0, 0), (10, 0)], lanes=[(0, 1), (1, 0)])


def driven(*robots, level=None):
    """An execution of robots that are at these places one after the other, NaN for one that is not there."""
    xy = np.array(robots, float)  # [R, T, 2]
    x, y = xy[..., 0].T.copy(), xy[..., 1].T.copy()
    still, none = np.zeros_like(x), np.zeros(0)
    return Execution(
        np.arange(len(x)) * 1.0, x, y, still, still, none, np.zeros(x.shape[1]), Outcome.COMPLETED, "", 1.0, 0.0, 0.0, level=level
    )


@pytest.mark.parametrize(
    ("nav", "route", "off_m", "against_m"),
    [
        (EAST, [(0, 0), (10, 0)], 0, 0),
        (EAST, [(10, 0), (0, 0)], 0, 10),
        (BOTH, [(10, 0), (0, 0)], 0, 0),
        (EAST, [(10, 0.29), (0, 0.29)], 0, 10),
        (EAST, [(10, 0.31), (0, 0.31)], 10, 0),  # off the lane it cannot go against it
        (EAST, [(5, 0), (5, -0.3), (5, -4)], 3.7, 0),  # across
        (EAST, [(0, 0), (4, 0), (3, 0), (10, 0)], 0, 1),
        (EAST, [(0, 0), (0, 0), (np.nan, np.nan), (0, 5), (0, 6)], 1, 0),  # it was away
    ],
)
def test_metres_are_those_of_the_hand(nav, route, off_m, against_m):
    counts = lane_keeping(driven(route), nav)
    assert (counts["off_m"], counts["against_one_way_m"]) == (pytest.approx(off_m), pytest.approx(against_m))


def test_of_two_one_ways_side_by_side_the_nearer_one_counts():
    pair = nav_graph(name="pair", xy=[(0, 0), (10, 0), (10, 0.2), (0, 0.2)], lanes=[(0, 1), (2, 3)])
    assert lane_keeping(driven([(10, 0.15), (0, 0.15)]), pair)["against_one_way_m"] == 0
    assert lane_keeping(driven([(10, 0.05), (0, 0.05)]), pair)["against_one_way_m"] == 10


@pytest.mark.parametrize(("turned_deg", "against_m"), [(110, 0), (134, 0), (136, 4)])
def test_who_crosses_a_one_way_at_an_obtuse_angle_does_not_drive_against_it(turned_deg, against_m):
    route = [5 + 2 * np.cos(np.radians(turned_deg)), 2 * np.sin(np.radians(turned_deg))]
    back = [10 - route[0], -route[1]]
    assert lane_keeping(driven([back, route]), EAST, on_lane_m=2)["against_one_way_m"] == pytest.approx(against_m)


def test_robots_add_up_and_rides_do_not_count():
    counts = lane_keeping(driven([(0, 0), (10, 0)], [(10, 0), (0, 0)]), EAST)
    assert counts == {"driven_m": 20, "off_m": 0, "against_one_way_m": 10}
    level = np.array([[0], [1], [1]])
    assert lane_keeping(driven([(0, 0), (50, 0), (50, 1)], level=level), EAST) == {"driven_m": 1, "off_m": 1, "against_one_way_m": 0}


def test_many_samples_count_as_few():
    x = np.linspace(10, 0, 300_001)
    counts = lane_keeping(driven(np.stack([x, np.zeros_like(x)], axis=1)), EAST)
    assert counts["against_one_way_m"] == pytest.approx(10, abs=2e-3) and counts["off_m"] == 0


def test_maps_without_lanes_have_none_to_leave():
    grid = grid_graph(np.ones((2, 2), bool), 1.0, (0, 0))
    assert lane_keeping(driven([(0, 0), (1, 0)]), grid) is None


def test_two_tracks_are_as_wide_as_they_are_apart():
    assert on_lane_m(0.4) == 0.3
    assert on_lane_m(2.0) == pytest.approx(1.001)
