"""Turns of vehicles that cannot turn in place."""

from math import cos, pi, tan

import numpy as np
import pytest

from mrp_sumo.traffic.turns import ARC, BACK, IMPOSSIBLE, STRAIGHT, obstacle_to, turns_of
from tests.vehicles import CAR, TRICYCLE, corner, roads


def turn(graph, vehicle, a, b, c):
    """The turn from the lane a - b to the lane b - c."""
    turns = turns_of(graph, vehicle)
    k = turns.between(graph.lane_between(a, b), graph.lane_between(b, c))
    return turns.kind[k], turns.radius_m[k], turns.tangent_m[k], turns.room_m[k]


def test_an_arc_is_as_large_as_its_corner_allows():
    kind, radius_m, tangent_m, room_m = turn(corner(), TRICYCLE, 0, 1, 2)
    assert (kind, room_m) == (ARC, 2.0)
    assert radius_m * (1 / cos(pi / 4) - 1) == pytest.approx(TRICYCLE.corner_m)
    assert tangent_m == pytest.approx(radius_m * tan(pi / 4))


@pytest.mark.parametrize("vehicle", [TRICYCLE, CAR], ids=lambda each: each.name)
@pytest.mark.parametrize(("spare", "expected"), [(1.001, ARC), (0.999, IMPOSSIBLE)])
def test_the_least_radius_has_to_fit_half_of_either_lane(vehicle, spare, expected):
    least_m = vehicle.kinematics.wheelbase_m / tan(vehicle.kinematics.steering_max_rad)
    graph = corner(2 * least_m * spare)
    assert turn(graph, vehicle, 0, 1, 2)[0] == expected
    text = obstacle_to(graph, vehicle, [0, 1, 2])
    assert text == (
        ""
        if expected == ARC
        else f"{vehicle.name} needs {least_m:.2f} m to turn from 'v0' over 'v1' to 'v2' and has {least_m * spare:.2f} m"
    )


def test_who_may_reverse_goes_back_and_nobody_else():
    graph = corner()
    assert turn(graph, TRICYCLE, 0, 1, 0)[0] == BACK
    assert turn(graph, CAR, 0, 1, 0)[0] == IMPOSSIBLE
    assert "kinematics.reverse: true would do" in obstacle_to(graph, CAR, [0, 1, 0])


def test_straight_on_is_no_turn():
    graph = roads([(0.0, 0.0), (4.0, 0.0), (8.0, 0.0)], [(0, 1), (1, 2)])
    assert turn(graph, CAR, 0, 1, 2)[:3] == (STRAIGHT, np.inf, 0.0)
