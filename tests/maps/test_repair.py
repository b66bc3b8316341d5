"""Repairs: what they change, and what they leave alone."""

import pytest
from golden import MRP_BENCH

from mrp_sumo.core.graph import nav_graph
from mrp_sumo.errors import MapError
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.repair import join_short, largest_component, repair, snap, split_crossings

WAREHOUSE = MRP_BENCH / "warehouse.building.yaml"


def both_ways(*pairs):
    return [lane for a, b in pairs for lane in ((a, b), (b, a))]


def pairs(graph):
    return sorted({tuple(sorted(p)) for p in zip(graph.tail.tolist(), graph.head.tolist())})


@pytest.mark.parametrize(("within_m", "edges", "components"), [(0.10, 56, 4), (0.14, 59, 1), (0.15, 60, 1), (0.5, 60, 1)])
def test_snapping_joins_the_warehouse(within_m, edges, components):
    result, changes = repair(load_map(WAREHOUSE), snap_m=within_m)
    assert (result.nav.num_vertices, result.nav.num_edges, result.nav.num_components) == (54, edges, components)
    assert len(changes) == edges - 40  # a split adds one edge
    assert result.changes == changes
    if components == 1 and edges == 60:
        assert {f.kind for f in result.findings} == {"robot_vertex_off_lanes"}


def test_a_lane_is_led_through_vertices_beside_it_in_their_order():
    xy = [[0, 0], [10, 0], [7, 0.1], [7, 3], [3, -0.1], [3, -3]]
    options = [{"door_name": "gate", "dock_name": "east"}, {"undock_name": "east"}, {}, {}, {}, {}]
    graph, changes = snap(nav_graph(name="comb", xy=xy, lanes=both_ways((0, 1), (2, 3), (4, 5)), lane_options=options), 0.2)
    assert pairs(graph) == [(0, 4), (1, 2), (2, 3), (2, 4), (4, 5)]
    assert graph.num_components == 1
    assert len(changes) == 2
    assert "lane v0 - v1 goes through v2 now, 0.100 m beside it" in changes
    last, middle = (graph.lane_options[graph.lane_between(*lane)] for lane in ((2, 1), (4, 2)))
    assert last == {"door_name": "gate", "dock_name": "east"}
    assert middle == {"door_name": "gate"}


def test_ends_that_missed_each_other_become_one_vertex():
    xy = [[0, 0], [5, 0], [5.05, 0], [9, 0]]
    graph, changes = snap(nav_graph(name="gap", xy=xy, lanes=both_ways((0, 1), (2, 3)), vertex_name=["a", "", "b", "c"]), 0.1)
    assert graph.vertex_name == ("a", "b", "c")
    assert pairs(graph) == [(0, 1), (1, 2)]
    assert graph.length_m.tolist() == [5, 5, 4, 4]
    assert changes == ["vertex b merged into v1, 0.050 m away"]


def test_one_way_lanes_stay_one_way():
    graph, _ = snap(nav_graph(name="t", xy=[[0, 0], [4, 0], [2, 0.1], [2, 3]], lanes=[(0, 1), (2, 3)]), 0.2)
    assert sorted(zip(graph.tail.tolist(), graph.head.tolist())) == [(0, 2), (2, 1), (2, 3)]


def test_crossings_get_one_vertex_for_all_lanes_through_it():
    xy = [[-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [1, 1]]
    graph, changes = split_crossings(nav_graph(name="star", xy=xy, lanes=both_ways((0, 1), (2, 3), (4, 5))))
    assert pairs(graph) == [(k, 6) for k in range(6)]
    assert len(changes) == 1


def test_the_largest_piece_stays():
    nav = nav_graph(
        name="two", xy=[[0, 0], [1, 0], [5, 0], [6, 0], [7, 0]], lanes=both_ways((0, 1), (2, 3), (3, 4)), vertex_name=["a", "", "", "", "e"]
    )
    graph, changes = largest_component(nav)
    assert graph.vertex_name == ("", "", "e")
    assert pairs(graph) == [(0, 1), (1, 2)]
    assert changes == ["1 smaller piece with 2 vertices dropped, among them a"]


def test_sound_graphs_are_left_alone():
    nav = nav_graph(name="line", xy=[[0, 0], [1, 0]], lanes=both_ways((0, 1)))
    assert snap(nav, 0.5) == (nav, [])
    assert split_crossings(nav) == (nav, [])
    assert largest_component(nav) == (nav, [])


def test_distances_that_make_no_sense_are_refused():
    with pytest.raises(MapError, match="expected a number above 0"):
        snap(nav_graph(name="line", xy=[[0, 0], [1, 0]], lanes=[(0, 1)]), 0)


def test_a_short_lane_is_joined_at_the_end_that_is_nothing_but_a_bend():
    xy = [[0, 0], [0.2, 0], [0.2, 3], [2, 3]]
    nav = nav_graph(name="bend", xy=xy, lanes=both_ways((0, 1), (1, 2), (2, 3)), vertex_name=["dock", "", "", "end"])
    graph, changes = join_short(nav, 0.34)
    assert (graph.vertex_name, pairs(graph)) == (("dock", "", "end"), [(0, 1), (1, 2)])
    assert graph.length_m.tolist() == pytest.approx([9.04**0.5, 9.04**0.5, 1.8, 1.8])
    assert changes == ["lane dock - v1, 0.200 m long, joined in dock"]


def test_short_lanes_are_joined_until_none_is_left_and_a_junction_keeps_its_lanes():
    xy = [[0, 0], [0.1, 0], [0.2, 0], [0.2, 3], [3, 0], [-3, 0]]  # two short lanes in a row, the last at a junction
    nav = nav_graph(name="row", xy=xy, lanes=both_ways((0, 1), (1, 2), (2, 3), (2, 4), (5, 0)))
    graph, changes = join_short(nav, 0.34)
    assert len(changes) == 2
    assert graph.xy.tolist() == [[0.2, 0], [0.2, 3], [3, 0], [-3, 0]]
    assert pairs(graph) == [(0, 1), (0, 2), (0, 3)]


@pytest.mark.parametrize(
    "rest",
    [
        {"vertex_name": ["a", "b", "c"]},
        {"vertex_options": [{"is_charger": True}, {"mutex": "bay"}, {}]},
        {"lane_options": [{"door_name": "gate"}, {}, {}, {}]},
    ],
)
def test_a_short_lane_with_something_at_both_ends_or_on_it_is_not_joined(rest):
    nav = nav_graph(name="kept", xy=[[0, 0], [0.2, 0], [3, 0]], lanes=both_ways((0, 1), (1, 2)), **rest)
    assert join_short(nav, 0.34) == (nav, [])


def test_one_way_lanes_stay_one_way_when_a_short_one_is_joined():
    nav = nav_graph(name="way", xy=[[0, 0], [3, 0], [3.2, 0], [6, 0]], lanes=[(0, 1), (1, 2), (2, 3)], vertex_name=["a", "", "b", "c"])
    graph, _ = join_short(nav, 0.34)
    assert sorted(zip(graph.tail.tolist(), graph.head.tolist())) == [(0, 1), (1, 2)]


@pytest.mark.parametrize("length_m", [0.0, -1.0, float("nan"), float("inf")])
def test_a_length_that_joins_nothing_or_everything_is_refused(length_m):
    with pytest.raises(MapError, match="expected a number above 0"):
        join_short(nav_graph(name="one", xy=[[0, 0], [1, 0]], lanes=[(0, 1)]), length_m)
