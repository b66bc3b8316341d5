"""Graphs: order of lanes, opposites, components, and what is refused."""

import numpy as np
import pytest

from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.errors import MapError

SQUARE = [(0, 0), (2, 0), (2, 1), (0, 1)]


def test_lanes_are_sorted_and_know_their_opposite():
    graph = nav_graph(name="t", xy=SQUARE, lanes=[(2, 1), (1, 0), (0, 1)], lane_options=[{"mutex": "a"}, {}, {"mutex": "c"}])
    assert list(zip(graph.tail, graph.head)) == [(0, 1), (1, 0), (2, 1)]
    assert graph.reverse.tolist() == [1, 0, -1]
    assert graph.length_m.tolist() == [2, 2, 1]
    assert [o.get("mutex") for o in graph.lane_options] == ["c", None, "a"]
    assert graph.source_lane.tolist() == [2, 1, 0]
    assert graph.first.tolist() == [0, 1, 2, 3, 3]
    assert graph.num_edges == 2


def test_lane_between_finds_lanes_and_only_lanes():
    graph = nav_graph(name="t", xy=SQUARE, lanes=[(0, 1), (0, 3), (3, 0)])
    assert [graph.lane_between(0, 1), graph.lane_between(0, 3), graph.lane_between(3, 0)] == [0, 1, 2]
    assert [graph.lane_between(1, 0), graph.lane_between(0, 2), graph.lane_between(2, 3)] == [-1, -1, -1]


def test_components_are_numbered_from_the_largest():
    graph = nav_graph(name="t", xy=[(i, 0) for i in range(6)], lanes=[(0, 1), (2, 3), (4, 3)])
    assert graph.component.tolist() == [1, 1, 0, 0, 0, 2]
    assert graph.num_components == 3


def test_vertices_of_one_lift_are_one_component():
    options = [{}, {"lift": "north"}, {"lift": "north"}, {}]
    graph = nav_graph(name="t", xy=SQUARE, lanes=[(0, 1), (2, 3)], vertex_options=options)
    assert graph.num_components == 1


def test_names_and_places_without_names():
    graph = nav_graph(name="t", xy=SQUARE, lanes=[], vertex_name=["dock", "", "dock", ""])
    assert (graph.label(0), graph.label(1)) == ("dock", "v1")
    assert (graph.vertex_of_name["dock"], graph.vertex_of_name["v2"]) == (0, 2)


def test_arrays_cannot_be_written():
    graph = nav_graph(name="t", xy=SQUARE, lanes=[(0, 1)])
    with pytest.raises(ValueError, match="read-only"):
        graph.xy[0, 0] = 1
    with pytest.raises(ValueError, match="read-only"):
        graph.tail[0] = 1


@pytest.mark.parametrize(
    ("xy", "lanes", "words"),
    [
        (SQUARE, [(0, 4)], r"lane 0 joins vertices \[0, 4\], but there are 4"),
        (SQUARE, [(0, 1), (-1, 2)], "lane 1 joins"),
        (SQUARE, [(1, 1)], "lane 0 from vertex 1 to 1 has no length"),
        ([(0, 0), (0, 0)], [(0, 1)], "has no length"),
        (SQUARE, [(0, 1), (0, 1)], "two lanes lead from vertex 0 to vertex 1"),
        ([(0, 0), (np.nan, 0)], [], "vertex 1 has coordinates that are not finite"),
    ],
)
def test_flawed_graph_is_refused(xy, lanes, words):
    with pytest.raises(MapError, match=words):
        nav_graph(name="t", xy=xy, lanes=lanes)


def test_plan_graph_is_made_of_a_graph_whose_lanes_were_looked_up():
    nav = nav_graph(name="lane", xy=[(0, 0), (1, 0)], lanes=[(0, 1), (1, 0)])
    assert nav.first.tolist() == [0, 1, 2]
    graph = plan_graph(nav, kind="roadmap", cell_m=1.0)
    assert (graph.head is nav.head, graph.vertex_of_station.tolist(), graph.nav_lane.tolist()) == (True, [0, 1], [-1, -1])


def test_robots_face_away_from_where_they_go_on_lanes_that_they_drive_backwards():
    options = [{}, {"orientation_constraint": "backward"}]
    graph = nav_graph(name="dock", xy=[(0, 0), (2, 0)], lanes=[(0, 1), (1, 0)], lane_options=options)
    assert graph.is_backward.tolist() == [False, True] and np.cos(graph.heading_rad) == pytest.approx([1.0, 1.0])


def test_robots_face_the_lane_at_the_end_of_a_ride_and_anywhere_where_rides_go_round():
    ring, ride = [(0, 1), (1, 2), (2, 0)], {"lift": "north"}
    xy = [(0, 0), (1, 0), (0, 1), (0, 5)]
    closed = nav_graph(name="x", xy=xy, lanes=ring, lane_options=[ride] * 3)
    assert closed.heading_rad.tolist() == [0.0] * 3
    left = nav_graph(name="x", xy=xy, lanes=[*ring, (2, 3)], lane_options=[ride] * 3 + [{}])
    assert left.heading_rad == pytest.approx([np.pi / 2] * 4)


def test_people_know_a_vertex_by_the_first_station_that_is_found_there():
    """Two points serve `Storage 01`: it is found at the first, so the second goes by its own name."""
    options = [{"station": "Storage 01; Storage 02"}, {"station": "Storage 01"}, {"station": "P4"}, {}, {}]
    graph = nav_graph(
        name="hall",
        xy=[(k, 0) for k in range(5)],
        lanes=[(k, k + 1) for k in range(4)],
        vertex_name=("P1", "P2", "P3", "P4", ""),
        vertex_options=options,
    )
    assert [graph.known_as(v) for v in range(5)] == ["Storage 01", "P2", "P3", "P4", "v4"]
    assert [graph.vertex_of_name[graph.known_as(v)] for v in range(5)] == [0, 1, 2, 3, 4]
