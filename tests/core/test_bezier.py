"""Bezier curves between two courses."""

from math import pi

import numpy as np
import pytest

from mrp_sumo.core.bezier import bezier_between

ENDS = np.array([(0.0, 0.0), (4.0, 0.4)])


@pytest.mark.parametrize(("begin_rad", "turned_rad"), [(0.0, 0.0), (0.3, 0.0), (0.0, 0.2), (0.2, -0.4)])
def test_places_are_so_near_that_courses_between_them_are_those_of_the_curve(begin_rad, turned_rad):
    """The first is an S: it does not turn from end to end, but on the way."""
    at_m, x, y, course = bezier_between(ENDS, begin_rad, turned_rad).T
    chords = np.arctan2(np.diff(y), np.diff(x))
    assert np.abs(np.diff(course)).max() < 0.05
    assert chords == pytest.approx((course[1:] + course[:-1]) / 2, abs=1e-3)
    assert np.diff(at_m) == pytest.approx(np.hypot(np.diff(x), np.diff(y)))
    assert (course[0], course[-1]) == (pytest.approx(begin_rad), pytest.approx(begin_rad + turned_rad))


def test_between_places_of_a_circle_it_is_the_circle():
    places = bezier_between(np.array([(2.0, 0.0), (0.0, 2.0)]), pi / 2, pi / 2)
    assert np.hypot(places[:, 1], places[:, 2]) == pytest.approx(2.0, rel=3e-4)
