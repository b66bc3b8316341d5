"""Curves as straight pieces, and steps cut along them."""

import numpy as np
import pytest

from mrp_sumo.core.graph import nav_graph
from mrp_sumo.maps.chains import chains_of
from mrp_sumo.maps.curves import bezier_knots, fault_of_curve, flattened, nurbs_of, traced
from mrp_sumo.maps.roadmap import cut_lanes

HALF = np.sqrt(0.5)
QUARTER = [(2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]  # with the middle weight cos(45 deg): a quarter circle of 2 m


def test_a_rational_curve_is_a_circle_within_a_centimetre():
    line = flattened(2, bezier_knots(2), np.array(QUARTER), np.array([1.0, HALF, 1.0])).xy
    assert np.hypot(*line.T) == pytest.approx(2.0, abs=1e-9)  # its corners lie on it
    middle = (line[1:] + line[:-1]) / 2
    assert 2.0 - np.hypot(*middle.T).min() <= 0.01
    assert line[[0, -1]].ravel() == pytest.approx([2, 0, 0, 2])


@pytest.mark.parametrize("back", [False, True])
def test_a_curve_between_its_bends_is_the_circle_that_was_drawn(back):
    line = flattened(2, bezier_knots(2), np.array(QUARTER), np.array([1.0, HALF, 1.0]))
    places = traced(*drawn(line, back))
    assert np.hypot(*places[:, 1:3].T) == pytest.approx(2.0, abs=1e-5)
    along = places[:, 1:3][:, ::-1] / 2.0 * ([1, -1] if back else [-1, 1])
    assert np.stack([np.cos(places[:, 3]), np.sin(places[:, 3])], 1) == pytest.approx(along, abs=1e-5)
    assert (np.diff(places[:, 0]) > 0).all()


def test_a_polyline_has_no_courses_and_a_curve_has_those_of_its_formula():
    assert traced(*drawn(flattened(1, [0, 0, 0.5, 1, 1], np.array([(0, 0), (1, 0), (1, 1)], float)))) is None
    points = np.array([(0, 0), (2, 0), (3, 1), (3, 3)], float)
    places = traced(*drawn(flattened(3, bezier_knots(3), points)))
    assert places[[0, -1], 3] == pytest.approx([0.0, np.pi / 2], abs=1e-9)


def test_a_curve_is_written_as_one_that_is_the_same():
    line = flattened(2, bezier_knots(2), np.array(QUARTER), np.array([1.0, HALF, 1.0]))
    nav, chain = drawn(line)
    degree, knots, points = nurbs_of(nav, chain, nav.xy)
    assert not fault_of_curve(degree, knots, len(points))
    again = flattened(degree, knots, points)
    assert np.hypot(*again.xy.T) == pytest.approx(2.0, abs=1e-5)


def drawn(line, back=False):
    """A graph of one line, and the lanes along it."""
    count = len(line.xy)
    options = [{}, *({"is_bend": True, **line.courses_at(k)} for k in range(1, count - 1)), {}]
    lanes = [(k, k + 1) for k in range(count - 1)]
    nav = nav_graph(name="line", xy=line.xy, lanes=[(b, a) for a, b in lanes] if back else lanes, vertex_options=options)
    pairs = [(b, a) for a, b in reversed(lanes)] if back else lanes
    return nav, [nav.lane_between(a, b) for a, b in pairs]


def test_several_bezier_curves_go_through_what_joins_them():
    points = np.array([(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (3, 2), (3, 3)], float)
    line = flattened(3, bezier_knots(3, 2), points).xy
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
