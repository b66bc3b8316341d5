"""Curves as straight pieces, and steps cut along them."""

import numpy as np
import pytest

from mrp_sumo.core.graph import nav_graph
from mrp_sumo.maps.chains import chains_of
from mrp_sumo.maps.curves import bezier_knots, fault_of_curve, flattened
from mrp_sumo.maps.roadmap import cut_lanes

HALF = np.sqrt(0.5)
QUARTER = [(2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]  # with the middle weight cos(45 deg): a quarter circle of 2 m


def test_a_rational_curve_is_a_circle_within_a_centimetre():
    line = flattened(2, bezier_knots(2), np.array(QUARTER), np.array([1.0, HALF, 1.0]))
    assert np.hypot(*line.T) == pytest.approx(2.0, abs=1e-9)  # its corners lie on it
    middle = (line[1:] + line[:-1]) / 2
    assert 2.0 - np.hypot(*middle.T).min() <= 0.01
    assert line[[0, -1]].ravel() == pytest.approx([2, 0, 0, 2])


def test_several_bezier_curves_go_through_what_joins_them():
    points = np.array([(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (3, 2), (3, 3)], float)
    line = flattened(3, bezier_knots(3, 2), points)
    assert np.abs(line - (3, 0)).sum(1).min() == pytest.approx(0, abs=1e-9)
    assert line[-1].tolist() == [3, 3]


@pytest.mark.parametrize(
    ("degree", "knots", "num_points", "words"),
    [
        (3, [0, 1, 2], 2, "2 control points, expected at least 4"),
        (1, [0, 0, 1], 2, "3 knots, expected 4"),
        (1, [0, 1, 0, 1], 2, "descend"),
        (1, [0, 0, 0, 0], 2, "without any length"),
        (2.5, [], 9, "degree 2.5"),
    ],
)
def test_what_is_no_curve_is_said_in_words(degree, knots, num_points, words):
    assert words in fault_of_curve(degree, knots, num_points)


def bent(lanes):
    """Ends 0 and 1, and two bends, 2 and 3, of a way of 6 m between them."""
    bend = {"is_bend": True}
    return nav_graph(name="bent", xy=[(0, 0), (2, 0), (0, 2), (2, 2)], lanes=lanes, vertex_options=[{}, {}, bend, bend])


def test_a_curve_is_cut_as_one_lane_and_its_cuts_lie_on_it():
    graph = cut_lanes(bent([(0, 2), (2, 3), (3, 1)]), 1.5)
    assert graph.length_m.tolist() == [1.5] * 4
    assert graph.xy[4:].tolist() == [[0, 1.5], [1, 2], [2, 1.5]]
    assert (graph.nav_lane[4:].tolist(), graph.offset_m[4:].tolist()) == ([0, 1, 2], [1.5, 1.0, 0.5])
    assert graph.vertex_of_station.tolist() == [0, 1, 2, 3]


def test_a_curve_both_ways_is_one_track():
    graph = cut_lanes(bent([(0, 2), (2, 3), (3, 1), (1, 3), (3, 2), (2, 0)]), 1.5)
    assert graph.num_vertices == 7
    assert (graph.reverse >= 0).all()


def test_a_curve_beside_a_straight_lane_keeps_a_vertex_of_its_own():
    nav = bent([(0, 2), (2, 3), (3, 1), (0, 1), (1, 0)])
    graph = cut_lanes(nav, 10.0)  # each lane is one step
    assert sorted(zip(graph.tail.tolist(), graph.head.tolist())) == [(0, 1), (0, 2), (1, 0), (2, 1)]
    chains = chains_of(nav)
    assert chains.nav.length_m.sum() == nav.length_m.sum()
