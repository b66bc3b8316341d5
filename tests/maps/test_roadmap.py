"""Lanes cut into steps."""

import numpy as np
import pytest

from mrp_sumo.core.graph import nav_graph
from mrp_sumo.errors import MapError
from mrp_sumo.maps.roadmap import cell_that_fits, cut_lanes


def test_a_lane_and_its_reverse_share_their_cuts():
    nav = nav_graph(name="line", xy=[[0, 0], [1.3, 0]], lanes=[[0, 1], [1, 0]], vertex_name=["a", "b"])
    graph = cut_lanes(nav, 0.4)  # 1.3 / 0.4 = 3.25: three steps
    assert graph.num_vertices == 4
    assert graph.xy[2:, 0].tolist() == pytest.approx([1.3 / 3, 2.6 / 3])
    assert sorted(zip(graph.tail.tolist(), graph.head.tolist())) == [(0, 2), (1, 3), (2, 0), (2, 3), (3, 1), (3, 2)]
    assert graph.length_m.tolist() == pytest.approx([1.3 / 3] * 6)
    assert graph.nav_lane.tolist() == [-1, -1, 0, 0]
    assert graph.offset_m.tolist() == pytest.approx([0, 0, 1.3 / 3, 2.6 / 3])
    assert graph.kind == "roadmap"


def test_two_way_lanes_are_two_tracks_that_keep_right():
    nav = nav_graph(name="line", xy=[[0, 0], [1.2, 0]], lanes=[[0, 1], [1, 0]])
    graph = cut_lanes(nav, 0.4, two_way=True)
    assert sorted(zip(graph.tail.tolist(), graph.head.tolist())) == [(0, 2), (1, 4), (2, 3), (3, 1), (4, 5), (5, 0)]
    assert graph.xy[2:].ravel().tolist() == pytest.approx([0.4, -0.2, 0.8, -0.2, 0.8, 0.2, 0.4, 0.2])
    assert (graph.reverse == -1).all()
    straight = np.hypot(*(graph.xy[graph.head] - graph.xy[graph.tail]).T)
    assert graph.length_m.tolist() == pytest.approx(straight.tolist())


def test_some_lanes_alone_become_two_tracks():
    nav = nav_graph(name="line", xy=[[0, 0], [1.2, 0], [2.4, 0]], lanes=[[0, 1], [1, 0], [1, 2], [2, 1]])
    (first,) = (k for k in range(4) if (nav.tail[k], nav.head[k]) == (1, 0))
    graph = cut_lanes(nav, 0.4, two_way={first})
    assert sorted(graph.xy[3:, 1].tolist()) == pytest.approx([-0.2, -0.2, 0, 0, 0.2, 0.2])
    assert (graph.reverse >= 0).sum() == 6  # of the three steps that stay single


def test_two_way_leaves_one_way_lanes_lanes_of_one_step_and_lifts_as_they_are():
    xy, lanes = [[0, 0], [2, 0], [2.4, 0], [9, 0]], [[0, 1], [1, 2], [2, 1], [2, 3], [3, 2]]
    nav = nav_graph(name="mixed", xy=xy, lanes=lanes, lane_options=[{}] * 3 + [{"lift": "goods"}] * 2)
    one, two = cut_lanes(nav, 0.4), cut_lanes(nav, 0.4, two_way=True)
    assert one.xy.tolist() == two.xy.tolist()
    assert one.tail.tolist() == two.tail.tolist()


def test_one_way_lanes_stay_one_way_and_keep_speed_and_options():
    nav = nav_graph(name="line", xy=[[0, 0], [0.8, 0]], lanes=[[1, 0]], speed_mps=[0.5], lane_options=[{"door_name": "gate"}])
    graph = cut_lanes(nav, 0.4)
    assert sorted(zip(graph.tail.tolist(), graph.head.tolist())) == [(1, 2), (2, 0)]
    assert graph.speed_mps.tolist() == [0.5, 0.5]
    assert {options["door_name"] for options in graph.lane_options} == {"gate"}


def test_short_lanes_stay_whole():
    nav = nav_graph(name="short", xy=[[0, 0], [0.1, 0]], lanes=[[0, 1], [1, 0]])
    assert cut_lanes(nav, 0.4).num_vertices == 2


def test_a_vertex_without_lanes_stands_for_its_twin():
    nav = nav_graph(name="twins", xy=[[0, 0], [1, 0], [0, 0]], lanes=[[1, 2], [2, 1]])
    assert cut_lanes(nav, 0.5).vertex_of_station.tolist() == [2, 1, 2]


def test_a_plan_graph_comes_through_unchanged():
    graph = cut_lanes(nav_graph(name="line", xy=[[0, 0], [1, 0]], lanes=[[0, 1]]), 0.4)
    assert cut_lanes(graph, 0.2) is graph


@pytest.mark.parametrize("cell_m", [0.0, -1.0, float("nan")])
def test_cells_of_no_length_are_refused(cell_m):
    with pytest.raises(MapError, match="expected at least"):
        cut_lanes(nav_graph(name="line", xy=[[0, 0], [1, 0]], lanes=[[0, 1]]), cell_m)


@pytest.mark.parametrize("length_m", [[1.0], [0.34, 5.0], [0.9, 1.3, 2.2], [0.33, 0.66, 0.99]])
def test_cell_that_fits_leaves_no_step_shorter_than_asked(length_m):
    lanes, cell_m = np.array(length_m), cell_that_fits(np.array(length_m), 0.33)
    assert (lanes / np.maximum(np.rint(lanes / cell_m), 1) >= 0.33 - 1e-9).all()


def test_cell_of_a_grid_that_fits_is_the_next_centimetre():
    assert cell_that_fits(np.array([np.inf]), 0.331) == 0.34


def test_lanes_of_a_map_in_the_wrong_scale_are_not_cut_into_millions_of_pieces():
    far = nav_graph(name="far", xy=[(0, 0), (3e6, 0)], lanes=[(0, 1), (1, 0)])
    with pytest.raises(MapError, match="would cut the 3000 km of lanes of 'far' into more than 2,000,000 pieces: is the map's scale right"):
        cut_lanes(far, 0.4)
