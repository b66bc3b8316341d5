"""Turns of vehicles that cannot turn in place."""

from contextlib import nullcontext
from dataclasses import replace
from math import cos, pi, tan

import numpy as np
import pytest

from mrp_sumo.core.robot_type import Wheels
from mrp_sumo.errors import OptionError
from mrp_sumo.traffic.turns import BACKWARD, FORWARD, NEVER, obstacle_to, turns_of, with_swings
from tests.vehicles import CAR, TRICYCLE, TUGGER, corner, roads

ONE_GEAR = replace(TRICYCLE, kinematics=replace(TRICYCLE.kinematics, reverse=False))


def turn(graph, vehicle, a, b, c):
    """The turns of a type on a graph, and the one from the lane a - b to the lane b - c."""
    turns = turns_of(graph, vehicle)
    return turns, turns.between(graph.lane_between(a, b), graph.lane_between(b, c))


def test_an_arc_is_as_large_as_its_corner_allows():
    turns, k = turn(corner(), ONE_GEAR, 0, 1, 2)
    assert turns.room_m[k] == 2.0
    assert turns.radius_m[k, FORWARD] * (1 / cos(pi / 4) - 1) == pytest.approx(ONE_GEAR.corner_m)
    assert turns.tangent_m[k] == pytest.approx(turns.radius_m[k] * tan(pi / 4))


@pytest.mark.parametrize("vehicle", [ONE_GEAR, CAR], ids=lambda each: each.name)
@pytest.mark.parametrize(("spare", "expected"), [(1.001, FORWARD), (0.999, NEVER)])
def test_the_least_radius_has_to_fit_half_of_either_lane(vehicle, spare, expected):
    least_m = vehicle.kinematics.wheelbase_m / tan(vehicle.kinematics.steering_max_rad)
    graph = corner(2 * least_m * spare)
    turns, k = turn(graph, vehicle, 0, 1, 2)
    assert turns.next_gear[k, FORWARD] == expected
    needs_m, has_m = ("1.069", "1.067") if vehicle is CAR else ("0.39", "0.38")  # as many digits as tell them apart
    needs = f"{vehicle.name} needs {needs_m} m to turn from 'v0' over 'v1' to 'v2' and has {has_m} m"
    assert obstacle_to(graph, vehicle, [0, 1, 2]) == ("" if expected == FORWARD else needs)


def test_who_may_reverse_goes_back_and_nobody_else():
    graph = corner()
    turns, k = turn(graph, TRICYCLE, 0, 1, 0)
    assert turns.next_gear[k].tolist() == [BACKWARD, FORWARD]
    assert turns.may_stand[k].tolist() == [BACKWARD, FORWARD]
    turns, k = turn(graph, CAR, 0, 1, 0)
    assert turns.next_gear[k].tolist() == [NEVER, NEVER]
    assert "kinematics.reverse: true would do" in obstacle_to(graph, CAR, [0, 1, 0])
    assert "a way round, or a type without trailers, would do" in obstacle_to(graph, TUGGER, [0, 1, 0])


def test_who_comes_backward_to_a_corner_leaves_forward_and_who_comes_forward_stays_so():
    turns, k = turn(corner(), TRICYCLE, 0, 1, 2)
    assert turns.next_gear[k].tolist() == [FORWARD, FORWARD]
    assert turns.swings[k].tolist() == [False, True]
    assert turns.may_stand[k].tolist() == [NEVER, NEVER]  # from the corner itself there is no arc


def test_straight_on_is_no_turn_and_keeps_the_gear():
    turns, k = turn(roads([(0.0, 0.0), (4.0, 0.0), (8.0, 0.0)], [(0, 1), (1, 2)]), TRICYCLE, 0, 1, 2)
    assert turns.next_gear[k].tolist() == [FORWARD, BACKWARD]
    assert np.isinf(turns.radius_m[k]).all() and (turns.tangent_m[k] == 0.0).all()


@pytest.mark.parametrize(
    ("wheels", "words"),
    [
        ({"kind": "differential"}, "docking: forks_first with kind differential, expected kind tricycle or ackermann"),
        ({"kind": "ackermann", "wheelbase_m": 1.0, "steering_max_rad": 1.0}, "docking: forks_first without reverse: true, expected both"),
    ],
)
def test_forks_first_needs_a_vehicle_that_can_come_so(wheels, words):
    with pytest.raises(OptionError, match=words):
        Wheels(**wheels, docking="forks_first")


@pytest.mark.parametrize(
    ("wheels", "words"),
    [
        ({"axle_m": 0.5, "wheelbase_m": 0.6}, None),
        ({"axle_m": 0.51, "wheelbase_m": 0.6}, "axle_m is 0.51: the fixed axle is 0.51"),
        ({"wheelbase_m": 1.02}, "wheelbase_m is 1.02: the fixed axle is 0.51"),
    ],
)
def test_the_fixed_axle_is_within_the_body(wheels, words):
    with nullcontext() if words is None else pytest.raises(OptionError, match=words):
        replace(ONE_GEAR, kinematics=replace(ONE_GEAR.kinematics, **wheels))


def test_room_beyond_its_radius_is_that_of_the_closed_form_where_a_vehicle_changes_gear():
    """It stops past the corner with its axle a tangent away, and its middle beyond that."""
    forks = replace(TRICYCLE, kinematics=replace(TRICYCLE.kinematics, docking="forks_first"))
    graph = roads([(0.0, 8.0), (0.0, 0.0), (8.0, 0.0), (-8.0, 0.0)], [(0, 1), (1, 2), (1, 3)], cell_m=8.0)
    radius_m, ahead_m = forks.kinematics.least_radius_m, forks.kinematics.ahead_m
    assert with_swings(graph, [forks]).swing_m[1] == pytest.approx(radius_m + ahead_m - forks.aside_m, abs=1e-6)
    assert not with_swings(graph, [CAR]).swing_m.any()


@pytest.mark.parametrize(("lane_m", "has_m"), [(1.01, ""), (0.99, "0.39")])
def test_the_axle_leaves_a_corner_before_the_middle_comes_to_the_next(lane_m, has_m):
    """It is 0.6 m behind the middle, and its least arc begins 0.4 m from a right angle."""
    wheels = replace(ONE_GEAR.kinematics, axle_m=0.6, wheelbase_m=0.4 * tan(1.0), steering_max_rad=1.0)
    graph = roads([(0.0, 0.0), (4.0, 0.0), (4.0, lane_m), (8.0, lane_m)], [(0, 1), (1, 2), (2, 3)])
    obstacle = f"tricycle needs 0.40 m to turn from 'v0' over 'v1' to 'v2' and has {has_m} m" if has_m else ""
    assert obstacle_to(graph, replace(ONE_GEAR, length_m=1.2, kinematics=wheels), [0, 1, 2, 3]) == obstacle


def test_a_corner_that_is_too_sharp_is_named_with_its_angle():
    graph = roads([(0.0, 0.0), (8.0, 0.0), (2.0, 6.0)], [(0, 1), (1, 2)], cell_m=8.0)
    assert obstacle_to(graph, ONE_GEAR, [0, 1, 2]) == "tricycle turns by 105 degrees at most, and it is 135 from 'v0' over 'v1' to 'v2'"


@pytest.mark.filterwarnings("error")
def test_a_lane_as_short_as_from_axle_to_middle_is_driven_straight_on():
    graph = roads([(0.0, 0.0), (4.0, 0.0), (4.0 + TRICYCLE.kinematics.ahead_m, 0.0), (8.0, 0.0)], [(0, 1), (1, 2), (2, 3)])
    graph = replace(graph, length_m=np.where(graph.length_m < 1, TRICYCLE.kinematics.ahead_m, graph.length_m))
    assert obstacle_to(graph, TRICYCLE, [0, 1, 2, 3]) == ""
