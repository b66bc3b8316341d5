"""Areas that vehicles sweep at corners, by closed forms, beside walls that leave a centimetre more or less."""

from dataclasses import replace
from itertools import pairwise
from math import hypot, pi, sqrt, tan

import numpy as np
import pytest
import shapely
from vehicles import CAR, TRICYCLE, TUGGER, corner, roads

from mrp_sumo.core.robot_type import Loaded, Trailer
from mrp_sumo.traffic.sweeps import MovingBody, rectangle_distances, swept_at_corner, touches
from mrp_sumo.traffic.turns import BACKWARD, FORWARD, NEVER, narrow_turns, obstacle_to, turns_of

ONE_GEAR = replace(TRICYCLE, kinematics=replace(TRICYCLE.kinematics, reverse=False))
FRONT_AXLE = replace(CAR, kinematics=replace(CAR.kinematics, fixed_axle="front"))
LEAST_M, FRONT_M = TRICYCLE.kinematics.least_radius_m, TRICYCLE.length_m / 2 + TRICYCLE.kinematics.ahead_m
WIDEST_M = ONE_GEAR.corner_m / (sqrt(2) - 1)  # on lanes of 4 m
OUTSIDE_M = hypot(WIDEST_M + 0.3, FRONT_M) - WIDEST_M  # that its front needs beyond a right angle


def wall(*ends):
    return np.array(ends, float).reshape(-1, 2, 2)


def post(away_m, at=(4.0, 0.0)):
    """A wall that begins inside a corner, so far from it, and leads away from it."""
    along = np.array([-1.0, 1.0]) / sqrt(2)
    return wall(at + away_m * along, at + (away_m + 0.5) * along)


def beside(graph, walls):
    return replace(graph, walls=walls)


def turn(graph, vehicle, a, b, c):
    turns = turns_of(graph, vehicle)
    return turns, turns.between(graph.lane_between(a, b), graph.lane_between(b, c))


def shape(bodies):
    """The area that bodies sweep: hulls from each of many poses to the next."""
    parts = []
    for body in bodies:
        known = np.arange(len(body.poses))
        fine = np.linspace(0, known[-1], 10 * len(known) + 1)
        x, y, yaw = (np.interp(fine, known, column) for column in body.poses.T)
        along, left = np.stack([np.cos(yaw), np.sin(yaw)], -1), np.stack([-np.sin(yaw), np.cos(yaw)], -1)
        at = np.stack([x, y], -1)
        corners = np.stack([at + f * body.length_m / 2 * along + g * body.width_m / 2 * left for f in (1, -1) for g in (1, -1)], 1)
        parts += [shapely.MultiPoint(np.concatenate(pair)).convex_hull for pair in pairwise(corners)]
    return shapely.union_all(parts)


@pytest.mark.parametrize("vehicle", [TRICYCLE, CAR, FRONT_AXLE], ids=lambda each: f"{each.name}, {each.kinematics.fixed_axle}")
@pytest.mark.parametrize("radius_m", [1.5, 2.5])
def test_a_swept_band_is_that_of_the_closed_form(vehicle, radius_m):
    """Round the middle of the arc, from where the body is not in line with the lanes any more."""
    area = shape(swept_at_corner(vehicle, pi / 2, (FORWARD, FORWARD), radius_m, 9.0))
    centre = shapely.Point(-radius_m, radius_m)
    front_m = vehicle.length_m / 2 + abs(vehicle.kinematics.ahead_m)
    assert area.distance(centre) == pytest.approx(radius_m - vehicle.width_m / 2, abs=0.001)
    assert area.hausdorff_distance(centre) == pytest.approx(hypot(radius_m + vehicle.width_m / 2, front_m), abs=0.001)


def test_distances_of_rectangles_from_walls_are_those_of_shapely():
    rng = np.random.default_rng(4)
    poses, walls = rng.uniform(-2, 2, (300, 3)), rng.uniform(-3, 3, (300, 2, 2))
    walls[:20, 1, 0] = walls[:20, 0, 0]
    poses[:40, 2] = 0.0
    expected = [
        shape([MovingBody(np.stack([pose, pose]), 1.2, 0.6)]).distance(shapely.LineString(ends)) for pose, ends in zip(poses, walls)
    ]
    assert rectangle_distances(poses, 0.6, 0.3, walls) == pytest.approx(expected, abs=1e-9)
    assert 50 < np.count_nonzero(np.array(expected) == 0) < 250


def test_what_touches_a_wall_is_what_shapely_says():
    rng = np.random.default_rng(5)
    bodies = swept_at_corner(CAR, 1.2, (FORWARD, FORWARD), 1.0, 4.0)
    area, count = shape(bodies), 0
    for ends in rng.uniform(-3, 3, (400, 2, 2)):
        away_m = area.distance(shapely.LineString(ends))
        if abs(away_m - 0.005) > 0.001:
            assert touches(bodies, ends[None]) == (away_m < 0.005)
            count += away_m < 0.005
    assert 50 < count < 350


@pytest.mark.parametrize(("spare_m", "expected"), [(0.01, FORWARD), (-0.01, NEVER)])
def test_a_wall_outside_a_corner_leaves_room_or_a_centimetre_less(spare_m, expected):
    graph = beside(corner(), wall((4.0 + OUTSIDE_M + spare_m, -3.0), (4.0 + OUTSIDE_M + spare_m, 6.0)))
    turns, k = turn(graph, ONE_GEAR, 0, 1, 2)
    assert turns.next_gear[k, FORWARD] == expected
    line = f"tricycle needs 0.61 m beside 'v1' to turn from 'v0' over 'v1' to 'v2' and has {OUTSIDE_M - 0.01:.2f} m to a wall"
    assert obstacle_to(graph, ONE_GEAR, [0, 1, 2]) == ("" if expected == FORWARD else line)
    assert narrow_turns(graph, ONE_GEAR) == (() if expected == FORWARD else (line,))


def test_of_narrow_turns_at_a_place_the_sharpest_is_named():
    """Lanes meet at v1 at 90 and 60 degrees, and a wall stands across the place."""
    xy = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (6.0, 3.46)]
    graph = beside(roads(xy, one_way=[(0, 1), (1, 2), (1, 3)]), wall((4.2, -0.1), (4.2, 0.1)))
    (line,) = narrow_turns(graph, ONE_GEAR)
    assert "from 'v0' over 'v1' to 'v2'" in line and line.endswith("(nor has it room for 1 more turn there)")


@pytest.mark.parametrize(("away_m", "radius_m"), [(0.56, WIDEST_M), (0.54, (0.535 - 0.3) / (sqrt(2) - 1)), (0.50, 0.195 / (sqrt(2) - 1))])
def test_a_wall_inside_a_corner_leaves_smaller_arcs(away_m, radius_m):
    """Half way round, the side of the body comes as near to the corner's inside as the arc leaves it, and half a width."""
    turns, k = turn(beside(corner(), post(away_m)), ONE_GEAR, 0, 1, 2)
    assert turns.radius_m[k, FORWARD] == pytest.approx(radius_m, abs=0.005)
    assert turns.tangent_m[k, FORWARD] == pytest.approx(turns.radius_m[k, FORWARD] * tan(pi / 4))


@pytest.mark.parametrize(("spare_m", "expected"), [(0.01, FORWARD), (-0.01, NEVER)])
def test_the_least_radius_has_to_have_room_inside(spare_m, expected):
    needs_m = LEAST_M * (sqrt(2) - 1) + 0.3
    turns, k = turn(beside(corner(), post(needs_m + 0.005 + spare_m)), ONE_GEAR, 0, 1, 2)
    assert turns.next_gear[k, FORWARD] == expected


def test_the_load_is_held_against_walls_too():
    graph = beside(corner(), wall((4.0 + OUTSIDE_M + 0.01, -3.0), (4.0 + OUTSIDE_M + 0.01, 6.0)))
    turns, k = turn(graph, replace(ONE_GEAR, loaded=Loaded(length_m=1.1)), 0, 1, 2)
    assert turns.next_gear[k, FORWARD] == NEVER


@pytest.mark.parametrize(("ahead_m", "stands"), [(0.51, True), (0.49, False)])
def test_at_the_end_of_a_lane_the_body_needs_half_its_length(ahead_m, stands):
    graph = beside(roads([(0.0, 0.0), (4.0, 0.0)], [(0, 1)]), wall((4.0 + ahead_m, -1.0), (4.0 + ahead_m, 1.0)))
    turns, there = turns_of(graph, TRICYCLE), graph.lane_between(0, 1)
    assert turns.stands[there].tolist() == [True, stands]
    assert turns.gears[there].tolist() == [stands, stands]
    line = "tricycle needs 0.50 m beside 'v1' to stand there, coming from 'v0', and has 0.49 m to a wall"
    assert obstacle_to(graph, TRICYCLE, [0, 1]) == ("" if stands else line)


def test_who_cannot_stand_in_line_at_a_corner_stops_on_the_arc():
    """The wall before the corner is nearer than half a length, and far enough for the arc that begins before it."""
    long = replace(ONE_GEAR, length_m=1.3)
    radius_m = WIDEST_M
    needs_m = hypot(radius_m + 0.3, 0.65 + 0.3) - radius_m
    assert needs_m > 0.65  # so it never is, for this vehicle: the wall leaves the turn only where it leaves room to stand
    turns, k = turn(beside(corner(), wall((4.66, -3.0), (4.66, 6.0))), long, 0, 1, 2)
    assert turns.stands[k, 1] and turns.next_gear[k, FORWARD] == NEVER


@pytest.mark.parametrize(("spare_m", "expected"), [(0.01, True), (-0.01, False)])
def test_a_swing_needs_room_beyond_the_corner(spare_m, expected):
    """Backward out of 0 to 1 and forward to 2: the body ends in line with the lane to 2, behind the corner."""
    graph = corner()
    reach_m = LEAST_M + TRICYCLE.length_m / 2 - TRICYCLE.kinematics.ahead_m  # of its back below the corner, when it has stopped
    below = beside(graph, wall((0.0, -reach_m - 0.005 - spare_m), (8.0, -reach_m - 0.005 - spare_m)))
    turns, k = turn(below, TRICYCLE, 0, 1, 2)
    assert bool(turns.swings[k, BACKWARD]) == expected


@pytest.mark.parametrize("room_m", [1.7, 1.7327241062247132])  # of which the latter is rounded down on the way
def test_a_swing_ends_where_the_vehicle_stops(room_m):
    """A long one backs round the corner, and on until its middle is there."""
    truck = replace(TRICYCLE, length_m=2.0, kinematics=replace(TRICYCLE.kinematics, wheelbase_m=1.4, axle_m=0.75, steering_max_rad=1.2))
    (body,) = swept_at_corner(truck, -1.8883782533170237, (BACKWARD, FORWARD), room_m, 0.0)
    assert body.poses[-1, :2] == pytest.approx([0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("spare_m", [0.01, -0.01])
def test_trailers_are_held_against_walls_inside_corners(spare_m):
    """By the steady radius of the last trailer, on a bend that is long enough to come to it."""
    train = replace(TUGGER, trailers=(Trailer(length_m=0.7, hitch_m=0.4),))
    radius_m = 4.0
    towed_m = sqrt(radius_m**2 + 0.4**2 - 0.7**2)
    bodies = swept_at_corner(train, pi / 2, (FORWARD, FORWARD), radius_m, 9.0)
    assert [body.length_m for body in bodies] == [1.0, 0.7]
    inside = radius_m * sqrt(2) - (towed_m - 0.3)  # from the corner to the side of the trailer
    assert touches(bodies, post(inside + 0.005 + spare_m, at=(0.0, 0.0))) == (spare_m < 0)


def test_where_there_are_no_walls_lanes_alone_decide():
    turns, k = turn(corner(), ONE_GEAR, 0, 1, 2)
    assert turns.stands.all() and turns.radius_m[k] == pytest.approx(WIDEST_M)


@pytest.mark.parametrize("lane_m", [0.2, 4.0])
def test_who_stood_at_a_small_bend_comes_round_however_short_the_lane_is(lane_m):
    """The axle is 0.3 m behind the middle: on a lane of 0.2 m the body is past its end before it faces along it."""
    (body,) = swept_at_corner(TRICYCLE, 0.005, (FORWARD, FORWARD), 0.0, lane_m)
    assert body.poses[0, 2] == 0.0 and body.poses[-1, 2] == pytest.approx(0.005)
    assert abs(body.poses[-1, 0]) == pytest.approx(0.3 + lane_m / 2, abs=1e-4)
