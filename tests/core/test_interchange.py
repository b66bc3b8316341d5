"""Nav graphs as networkx graphs, and back."""

import networkx as nx
import numpy as np
import pytest

from mrp_sumo.core.graph import NavGraph, nav_graph
from mrp_sumo.errors import MapError


def site():
    """Two rooms on two levels, a one-way lane with a limit, and a lift."""
    return nav_graph(
        name="site",
        xy=[(0, 0), (3, 0), (3, 4), (20, 0)],
        lanes=[(0, 1), (1, 0), (1, 2), (2, 3), (3, 2)],
        level_names=("L1", "L2"),
        level=[0, 0, 0, 1],
        vertex_name=("dock", "", "lift_1", "lift_2"),
        vertex_options=({"is_charger": True}, {}, {"lift": "A"}, {"lift": "A"}),
        length_m=[3, 3, 4, 2.5, 2.5],
        speed_mps=[np.inf, np.inf, 0.5, np.inf, np.inf],
        lane_options=({}, {}, {"mutex": "narrow"}, {"lift": "A"}, {"lift": "A"}),
    )


def test_nav_graph_comes_back_as_it_was():
    before = site()
    after = NavGraph.from_networkx(before.to_networkx())
    for key in ("name", "level_names", "vertex_name", "vertex_options", "lane_options"):
        assert getattr(after, key) == getattr(before, key), key
    for key in ("xy", "level", "tail", "head", "length_m", "speed_mps", "reverse"):
        np.testing.assert_array_equal(getattr(after, key), getattr(before, key))


def test_routes_of_networkx_are_routes_on_lanes():
    graph = site().to_networkx()
    assert nx.shortest_path(graph, 0, 3, weight="length_m") == [0, 1, 2, 3]
    assert not nx.has_path(graph, 2, 1)
    assert graph.nodes[0] == {"name": "dock", "x_m": 0.0, "y_m": 0.0, "level": "L1", "is_charger": True}
    assert graph.edges[1, 2] == {"length_m": 4.0, "speed_mps": 0.5, "mutex": "narrow"}


def test_undirected_grid_is_a_map_driven_both_ways():
    nav = NavGraph.from_networkx(nx.grid_2d_graph(2, 3), "grid")
    assert (nav.name, nav.num_vertices, nav.num_edges, nav.num_components) == ("grid", 6, 7, 1)
    assert (nav.reverse >= 0).all() and (nav.length_m == 1).all() and nav.xy.tolist()[1] == [0, 1]


def test_names_and_places_of_nodes_are_taken():
    graph = nx.Graph()
    graph.add_node("dock", pos=(1, 2))
    graph.add_node("desk", x_m=1.0, y_m=5.0)
    graph.add_edge("dock", "desk", weight=9)
    nav = NavGraph.from_networkx(graph)
    assert nav.vertex_name == ("dock", "desk") and nav.length_m.tolist() == [3, 3] and nav.name == "graph"


def test_node_without_a_place_is_refused():
    graph = nx.path_graph(3)
    with pytest.raises(MapError, match=r"^node 0 has no place: give it x_m and y_m in m, or pos$"):
        NavGraph.from_networkx(graph)


def test_unknown_level_is_refused():
    graph = nx.Graph(level_names=["L1"])
    graph.add_node(0, pos=(0, 0), level="L7")
    with pytest.raises(MapError, match="level 'L7'"):
        NavGraph.from_networkx(graph)
