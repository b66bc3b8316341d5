"""Rides: how long they take, and how a plan graph has them."""

import numpy as np
import pytest
from worlds import two_levels

from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.maps.building import Building, Lift
from mrp_sumo.maps.lifts import cabins_of, door_s, ride_of, travel_s, with_rides


def test_doors_and_cabins_move_as_in_open_rmf():
    # 0.3 m/s and 0.2 m/s2 over half a door; 2 m/s and 1.2 m/s2 over the height
    assert door_s(1.7) == pytest.approx(0.85 / 0.3 + 0.3 / 0.2)
    assert door_s(0.4) == pytest.approx(2 * np.sqrt(0.2 / 0.2))
    assert travel_s(10.0) == pytest.approx(10 / 2 + 2 / 1.2)
    assert ride_of("a", None, ("L1", "L2"), 10.0)["ride_s"] == pytest.approx(2 * door_s(1.0) + travel_s(10.0))


def test_a_ride_takes_as_many_planned_steps_as_it_lasts():
    graph = two_levels(ride_s=10.0, step_s=3.0)
    inside = [v for v, options in enumerate(graph.vertex_options) if options.get("in_lift") == "goods"]
    assert len(inside) == 2 + 3  # both stops, and the shaft between four steps
    rides = np.flatnonzero(graph.is_ride)
    assert len(rides) == 8
    assert (graph.length_m[rides] / graph.speed_mps[rides]).sum() == pytest.approx(20.0)
    assert sorted(graph.level[inside].tolist()) == [0, 0, 1, 1, 1]


def test_robots_in_a_lift_face_the_way_that_they_leave_it():
    graph = two_levels(ride_s=10.0, step_s=3.0)
    up = graph.is_ride & (graph.level[graph.head] >= graph.level[graph.tail])
    out = graph.heading_rad[graph.lane_between(4, 5)]
    assert out in graph.heading_rad[up]
    assert set(graph.heading_rad[graph.is_ride].tolist()) == {out, graph.heading_rad[graph.lane_between(3, 2)]}


def two_cells(cabin_x_m):
    """Cells of 2 m at (0, 0) on two levels, whose ride belongs to a cabin of 1 m x 1 m, and what `with_rides` makes of them."""
    lanes = [(0, 1), (1, 0)]
    options = [ride_of("goods", None, ("L1", "L2"), 4.0)] * 2
    graph = nav_graph(
        name="g", xy=[(0.0, 0.0), (0.0, 0.0)], lanes=lanes, level_names=("L1", "L2"), level=[0, 1], length_m=[0.1] * 2, lane_options=options
    )
    lift = Lift(name="goods", x_m=cabin_x_m, y_m=0.0, yaw_rad=0.0, width_m=1.0, depth_m=1.0)
    building = Building(name="b", path=None, coordinate_system="", levels={}, lifts={"goods": lift})
    return with_rides(plan_graph(graph, kind="grid", cell_m=2.0), 5.0, 0.3, building, {}), building


def test_a_cell_beside_its_cabin_gets_a_vertex_inside():
    graph, building = two_cells(1.4)
    rides = np.flatnonzero(graph.is_ride)
    ends = {int(v) for k in rides for v in (graph.tail[k], graph.head[k])}
    assert all(abs(graph.xy[v, 0] - 1.4) < 0.5 and abs(graph.xy[v, 1]) < 0.5 for v in ends)
    assert {0, 1}.isdisjoint(ends)  # the cells
    for cell, inside in ((0, 2), (1, 3)):
        assert graph.length_m[graph.lane_between(cell, inside)] == pytest.approx(1.4)
        assert graph.length_m[graph.lane_between(inside, cell)] == pytest.approx(1.4)
    assert cabins_of(building, ("L1", "L2"), {"L2": (50.0, 0.0)}).tolist() == [[0, 1.4, 0, 0, 1, 1], [1, 51.4, 0, 0, 1, 1]]


@pytest.mark.parametrize(("cabin_x_m", "rides_there"), [(0.24, True), (0.26, False)])  # 0.5 m less that leave a robot of 0.3 m, and 0.05
def test_a_cell_where_the_body_is_inside_the_cabin_is_where_robots_ride(cabin_x_m, rides_there):
    graph, _ = two_cells(cabin_x_m)
    ends = {int(v) for k in np.flatnonzero(graph.is_ride) for v in (graph.tail[k], graph.head[k])}
    assert ({0, 1} <= ends, graph.is_ride.all()) == (rides_there, rides_there)
