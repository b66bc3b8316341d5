"""Places without a name of their own are told by the nearest one that has one."""

from mrp_sumo.core.graph import nav_graph
from mrp_sumo.core.places import BETWEEN, beside

XY = [(0, 0), (10, 0), (14, 0), (14, 3)]
NAV = nav_graph(name="aisle", xy=XY, lanes=[(0, 1), (1, 2), (2, 3)], vertex_name=("Storage 01", "", "", "dock"))
UNNAMED = nav_graph(name="bare", xy=XY, lanes=[(0, 1), (1, 2), (2, 3)], vertex_name=("", "", "", ""))


def test_crossing_and_aisle_without_names_are_told_by_the_nearest_name():
    assert beside(NAV, "v2") == "3.0 m from dock"
    assert beside(NAV, "v1") == "5.0 m from dock"
    assert beside(NAV, f"v1{BETWEEN}v2") == "3.6 m from dock"


def test_places_with_a_name_and_maps_without_any_are_told_by_nothing_else():
    assert beside(NAV, "dock") == beside(NAV, f"Storage 01{BETWEEN}v1") == beside(NAV, "x 0 to 5 m, y 0 to 5 m") == ""
    assert beside(UNNAMED, "v2") == ""
