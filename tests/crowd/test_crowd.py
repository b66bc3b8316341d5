"""Floors of people, and where these may appear, by hand."""

import numpy as np
import pytest

from mrp_sumo.crowd import _floor
from mrp_sumo.crowd.crowd import Crowd
from mrp_sumo.crowd.floor import Floor
from mrp_sumo.crowd.model import People
from mrp_sumo.crowd.state import BODY_M, CELL_M


def strip(columns, rows, *blocked):
    """A floor without walls, free but for some columns."""
    free = np.ones((rows, columns), np.bool_)
    free[:, list(blocked)] = False
    cells = columns * rows
    none = np.zeros(0, np.int64)
    return Floor((-1.0, 2.0), columns, rows, np.zeros((0, 4)), np.zeros(cells + 1, np.int64), none, np.full(cells, np.inf), free.ravel())


def test_a_point_is_in_the_cell_whose_centre_is_nearest_or_in_none():
    floor = strip(4, 3)
    assert floor.cell_of(floor.centre_of(np.arange(12))).tolist() == list(range(12))
    assert floor.centre_of(np.array(0)) == pytest.approx([-1.0 + CELL_M / 2, 2.0 + CELL_M / 2])
    beyond = [(-1.01, 2.1), (-0.9, 1.99), (-0.19, 2.1), (-0.9, 2.61)]
    assert floor.cell_of(np.array(beyond)).tolist() == [-1] * 4


def test_back_to_where_there_is_room_leads_to_the_nearest_such_cell_and_from_there_nowhere():
    back = strip(5, 1, 0, 3, 4).back
    east, west = 0, _floor.NUM_ANGLES // 2
    assert back.tolist() == [east, _floor.NO_WAY, _floor.NO_WAY, west, west]


@pytest.mark.parametrize(("away_m", "has_room"), [(0.69, False), (0.71, True)])
def test_people_appear_with_room_between_them(away_m, has_room):
    """Two bodies of a quarter of a metre, and 0.2 m."""
    crowd = Crowd(People(strip(20, 20), np.array([0, 399]), count=1), *np.zeros((2, 0)))
    crowd._add(np.array([0.0, 3.0]), (0, 1))
    assert crowd._has_room(np.array([away_m, 3.0])) == has_room


@pytest.mark.parametrize(("speed_mps", "away_m", "has_room"), [(0, 1.29, False), (0, 1.31, True), (-1, 2.79, False), (-1, 2.81, True)])
def test_people_appear_farther_from_robots_the_faster_these_drive(speed_mps, away_m, has_room):
    """0.8 m from a body that reaches 0.5 m from its middle, and what it drives in a second and a half, whichever way."""
    crowd = Crowd(People(strip(20, 20), np.array([0, 399]), count=1), np.array([0.4]), np.array([0.3]))
    crowd.robots.x_m[0], crowd.robots.y_m[0], crowd.robots.along_mps[0] = 0.0, 3.0, speed_mps
    assert crowd._has_room(np.array([away_m, 3.0])) == has_room


def test_people_who_are_there_from_the_start_are_clear_of_each_other():
    crowd = Crowd(People(strip(30, 30), np.array([0, 899]), count=12), *np.zeros((2, 0)))
    crowd.begin()
    x_m, y_m = crowd.walkers.x_m[: crowd.count], crowd.walkers.y_m[: crowd.count]
    apart_m = np.hypot(x_m[:, None] - x_m, y_m[:, None] - y_m) + np.diag(np.full(crowd.count, np.inf))
    assert crowd.count > 6 and apart_m.min() >= 2 * BODY_M + 0.2
