"""Rides: how long they take, and how a plan graph has them."""

import numpy as np
import pytest
from worlds import two_levels

from mrp_sumo.maps.lifts import door_s, ride_of, travel_s


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
