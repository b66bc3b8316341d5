"""Poses of vehicles along their ways: closed forms, and slow integrators of these tests' own."""

from dataclasses import replace
from math import atan, cos, hypot, pi, sin, sqrt, tan

import numpy as np
import pytest

from mrp_sumo.core.bodies import axle_of, bodies_of
from mrp_sumo.core.disturbances import Breakdown, Disturbances
from mrp_sumo.core.plan import plan_of_paths
from mrp_sumo.core.robot_type import Wheels
from mrp_sumo.drive._towed import follow
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.metrics.audit import audit
from mrp_sumo.traffic.turns import gears_of, idle_docking, obstacle_to, turns_of, with_swings
from tests.vehicles import CAR, TRICYCLE, TUGGER, corner, roads, vehicles_on


def driven(tmp_path, graph, paths, types, engine="kinematic", **more):
    """The problem, its retimed plan, and what was driven."""
    problem = vehicles_on(graph, [path[0] for path in paths], [path[-1] for path in paths], types, **more)
    settings = ExecutionSettings(engine=engine, time_limit_s=300.0)
    plan = retime(problem, plan_of_paths(paths, problem.step_s), settings)
    network = build_network(graph, tmp_path / "world.net.xml") if engine == "sumo" else tmp_path
    return problem, plan, simulate(problem, plan, settings, network)


def corners_of(x, y, yaw, length_m, width_m):
    """[T, 4, 2] corners of a rectangle."""
    along, left = np.stack([np.cos(yaw), np.sin(yaw)], -1), np.stack([-np.sin(yaw), np.cos(yaw)], -1)
    middle = np.stack([x, y], -1)
    return np.stack([middle + f * length_m / 2 * along + g * width_m / 2 * left for f in (1, -1) for g in (1, -1)], 1)


@pytest.mark.parametrize("vehicle", [TRICYCLE, CAR, replace(CAR, kinematics=replace(CAR.kinematics, fixed_axle="front"))], ids=str)
def test_what_a_turn_sweeps_is_that_of_the_closed_form(tmp_path, vehicle):
    graph = corner()
    _, _, run = driven(tmp_path, graph, [[0, 1, 2]], vehicle)
    turns = turns_of(graph, vehicle)
    radius_m = turns.radius_m[turns.between(graph.lane_between(0, 1), graph.lane_between(1, 2)), 0]
    yaw = np.unwrap(run.yaw_rad[:, 0])
    on_arc = (yaw > 0.05) & (yaw < pi / 2 - 0.05)
    centre = np.array([4.0 - radius_m, radius_m])
    away = np.hypot(
        *np.moveaxis(corners_of(run.x_m[:, 0], run.y_m[:, 0], run.yaw_rad[:, 0], vehicle.length_m, vehicle.width_m) - centre, -1, 0)
    )
    front_m = vehicle.length_m / 2 + abs(vehicle.kinematics.ahead_m)
    assert away[on_arc].max() == pytest.approx(hypot(radius_m + vehicle.width_m / 2, front_m), abs=0.01)
    assert away[on_arc].min() >= radius_m - vehicle.width_m / 2 - 0.01
    x, y = axle_of(run.x_m, run.y_m, run.yaw_rad, vehicle.kinematics.ahead_m)
    assert np.hypot(x[on_arc, 0] - centre[0], y[on_arc, 0] - centre[1]) == pytest.approx(radius_m, abs=1e-4)


def test_an_arc_is_what_a_bicycle_drives_with_its_wheel_turned(tmp_path):
    graph = corner()
    _, _, run = driven(tmp_path, graph, [[0, 1, 2]], CAR)
    turns = turns_of(graph, CAR)
    k = turns.between(graph.lane_between(0, 1), graph.lane_between(1, 2))
    radius_m, tangent_m, wheelbase_m = turns.radius_m[k, 0], turns.tangent_m[k, 0], CAR.kinematics.wheelbase_m
    steering, x, y, yaw, places = atan(wheelbase_m / radius_m), 4.0 - tangent_m, 0.0, 0.0, []
    while yaw < pi / 2:  # x' = v cos(yaw), yaw' = v / L tan(steering), in steps of 0.1 mm
        x, y, yaw = x + 1e-4 * cos(yaw), y + 1e-4 * sin(yaw), yaw + 1e-4 / wheelbase_m * tan(steering)
        places.append((x, y, yaw))
    expected = np.array(places)
    turned = np.unwrap(run.yaw_rad[:, 0])
    on_arc = (turned > 0.01) & (turned < pi / 2 - 0.01)
    axle = axle_of(run.x_m, run.y_m, run.yaw_rad, CAR.kinematics.ahead_m)
    for column, values in enumerate(axle):
        assert values[on_arc, 0] == pytest.approx(np.interp(turned[on_arc], expected[:, 2], expected[:, column]), abs=0.01)


def test_trailers_come_to_the_radii_of_the_closed_form():
    angle = np.linspace(0, 12 * pi, 6001)
    node = np.stack([3 * np.cos(angle), 3 * np.sin(angle), angle + pi / 2], 1)
    hitch, length = np.array([0.5, 0.3, 0.0]), np.array([1.2, 0.9, 1.0])
    towed = follow(node, hitch, length, np.full(3, pi / 2))
    place, heading, radius_m = node[-1, :2], node[-1, 2], 3.0
    for n in range(3):
        place = place - hitch[n] * np.array([cos(heading), sin(heading)])
        heading = towed[-1, n]
        place = place - length[n] * np.array([cos(heading), sin(heading)])
        radius_m = sqrt(radius_m**2 + hitch[n] ** 2 - length[n] ** 2)
        assert np.hypot(*place) == pytest.approx(radius_m, abs=1e-3)


def test_trailers_follow_a_corner_as_a_slow_integrator_has_them(tmp_path):
    graph = roads([(-4.0, 0.0), (0.0, 0.0), (4.0, 0.0), (4.0, 4.0)], one_way=[(0, 1), (1, 2), (2, 3)])
    problem, _, run = driven(tmp_path, graph, [[1, 2, 3]], TUGGER)
    yaw = np.unwrap(run.yaw_rad[:, 0])
    x, y = axle_of(run.x_m[:, 0], run.y_m[:, 0], yaw, TUGGER.kinematics.ahead_m)
    theta = np.zeros((len(yaw), 3))
    theta[:, 0] = yaw
    now = np.zeros(3)
    for t in range(1, len(yaw)):
        ds, dyaw = np.hypot(x[t] - x[t - 1], y[t] - y[t - 1]) / 400, (yaw[t] - yaw[t - 1]) / 400
        for i in range(400):
            now[0], v, rate = yaw[t - 1] + i * dyaw, ds, dyaw
            for n, trailer in enumerate(TUGGER.trailers):
                off = now[n] - now[n + 1]
                mine = (v * sin(off) - trailer.hitch_m * rate * cos(off)) / trailer.length_m
                v, rate = v * cos(off) + trailer.hitch_m * rate * sin(off), mine
                now[n + 1] += mine
        theta[t] = now
        theta[t, 0] = yaw[t]
    for n in range(2):
        assert run.hitch_rad[f"hitch_{n + 1}_rad"][:, 0] == pytest.approx(theta[:, n + 1] - theta[:, n], abs=0.01)
    bodies = bodies_of(run, problem.fleet)
    assert bodies.name == ("robot_0", "robot_0, trailer 1", "robot_0, trailer 2")
    assert (bodies.x_m[0, 1] < bodies.x_m[0, 0]) and (bodies.x_m[0, 2] < bodies.x_m[0, 1])


@pytest.mark.parametrize("engine", ["kinematic", "sumo"])
def test_planned_is_driven_there_and_back_with_the_changes_of_gear(tmp_path, engine):
    problem, plan, run = driven(tmp_path, corner(), [[0, 1, 2, 1, 0]], TRICYCLE, engine)
    assert run.arrived_s == pytest.approx(plan.arrive_s, abs=1e-6)
    assert audit(run, problem.fleet)["passed"]
    yaw = np.unwrap(run.yaw_rad[:, 0])
    assert yaw[[0, -1]] == pytest.approx([0.0, pi], abs=1e-6)  # out of the dead end backward, and home forward


@pytest.mark.parametrize("engine", ["kinematic", "sumo"])
def test_a_forklift_backs_out_of_a_station_and_goes_on_forward(tmp_path, engine):
    """0 is a station beside the road 2 - 1 - 3; out of it and west, the vehicle swings to the east first."""
    graph = roads([(0.0, 4.0), (0.0, 0.0), (4.0, 0.0), (-4.0, 0.0)], [(0, 1), (1, 2), (1, 3)])
    problem, plan, run = driven(tmp_path, graph, [[2, 1, 0, 1, 3]], TRICYCLE, engine)
    assert run.arrived_s == pytest.approx(plan.arrive_s, abs=1e-6)
    result = audit(run, problem.fleet)
    assert result["passed"], result["violations"]
    yaw = np.unwrap(run.yaw_rad[:, 0])
    assert yaw[0] == pytest.approx(-pi)
    assert yaw.min() == pytest.approx(-3 * pi / 2, abs=1e-6)  # into the station
    assert (run.x_m[-1, 0], run.y_m[-1, 0], yaw[-1]) == pytest.approx((-4.0, 0.0, -pi), abs=0.01)  # and out of it, facing west again
    x, y = axle_of(run.x_m[:, 0], run.y_m[:, 0], yaw, TRICYCLE.kinematics.ahead_m)
    after = np.arange(len(yaw)) > y.argmax()
    assert x[after].max() == pytest.approx(TRICYCLE.kinematics.least_radius_m, abs=0.01)  # past the corner, the other way


@pytest.mark.parametrize("engine", ["kinematic", "sumo"])
def test_a_truck_backs_into_a_dead_end_with_its_forks_first_and_leaves_forward(tmp_path, engine):
    """0 is at the end of a spur of two steps beside the road 2 - 1 - 3; coming from the west it swings to the south first."""
    graph = roads(
        [(0.0, 8.0), (0.0, 0.0), (4.0, 0.0), (-4.0, 0.0), (8.0, 0.0), (-8.0, 0.0)], [(0, 1), (1, 2), (1, 3), (2, 4), (3, 5), (4, 5)]
    )
    spur = int(graph.head[graph.tail == 0][0])
    forks = replace(TRICYCLE, kinematics=replace(TRICYCLE.kinematics, docking="forks_first"))
    problem, plan, run = driven(tmp_path, graph, [[3, 1, spur, 0, spur, 1, 2]], forks, engine)
    assert run.arrived_s == pytest.approx(plan.arrive_s, abs=1e-6)
    result = audit(run, problem.fleet)
    assert result["passed"], result["violations"]
    there = int(run.y_m[:, 0].argmax())
    assert (run.y_m[there, 0], run.yaw_rad[there, 0]) == (pytest.approx(8.0, abs=0.01), pytest.approx(-pi / 2))
    assert obstacle_to(graph, forks, [3, 1, spur, 0]) == ""
    only = replace(forks, kinematics=replace(forks.kinematics, fixed_axle="front"))
    _, _, run = driven(tmp_path, graph, [[3, 1, spur, 0, spur, 1, 2]], only, engine)
    there = int(run.y_m[:, 0].argmax())
    assert run.yaw_rad[there, 0] == pytest.approx(pi / 2)  # whose forks are in front


def test_the_map_says_how_a_dead_end_is_driven_where_it_does():
    graph = roads([(0.0, 4.0), (0.0, 0.0), (4.0, 0.0), (-4.0, 0.0)], [(0, 1), (1, 2), (1, 3)])
    forks = replace(TRICYCLE, kinematics=replace(TRICYCLE.kinematics, docking="forks_first"))
    into, out = graph.lane_between(1, 0), graph.lane_between(0, 1)
    assert gears_of(graph, forks)[into].tolist() == [0, 1]
    options = [{"orientation_constraint": "backward"} if lane == out else {} for lane in range(graph.num_lanes)]
    assert gears_of(replace(graph, lane_options=tuple(options)), forks)[into].tolist() == [1, 1]


def test_docking_that_changes_nothing_is_told():
    ends, ring = roads([(0.0, 0.0), (4.0, 0.0)], [(0, 1)]), roads([(0.0, 0.0), (4.0, 0.0), (0.0, 4.0)], [(0, 1), (1, 2), (2, 0)])
    forks = replace(TRICYCLE, kinematics=replace(TRICYCLE.kinematics, docking="forks_first"))
    said = replace(ends, lane_options=({"orientation_constraint": "backward"}, {}))
    assert [idle_docking(graph, forks).partition(", as ")[2] for graph in (ends, said, ring)] == [
        "", "the map says in which gear its dead ends are driven", "no place is at a dead end",
    ]  # fmt: skip
    assert idle_docking(ring, TRICYCLE) == ""


@pytest.mark.parametrize(("wall_m", "faces"), [(0.45, pi), (0.9, 0.0)])  # behind the axle it reaches 0.2 m, before it 0.8 m
def test_who_can_only_turn_backward_at_a_wall_sets_out_backward(tmp_path, wall_m, faces):
    """It was planned backward and driven forward, into the wall beyond the corner."""
    graph = replace(corner(), walls=np.array([[(4.0 + wall_m, -9.0), (4.0 + wall_m, 9.0)]]))
    _, _, run = driven(tmp_path, graph, [[0, 1, 2]], TRICYCLE)
    assert cos(float(run.yaw_rad[0, 0]) - faces) == pytest.approx(1.0)
    assert corners_of(run.x_m[:, 0], run.y_m[:, 0], run.yaw_rad[:, 0], 1.0, 0.6)[..., 0].max() < 4.0 + wall_m


def test_a_swing_begins_where_the_axle_has_left_the_arc_before_it(tmp_path):
    """From 0 round the corner 1 to 2, where the way to 3 leads back, but for 2 degrees; lanes have room for either turn in their halves."""
    slant = np.array([cos(pi / 4), sin(pi / 4)])
    back = np.array([cos(pi / 4 + 0.03), sin(pi / 4 + 0.03)])
    corner_xy, end_xy = np.array([2.0, 0.0]), np.array([2.0, 0.0]) + 2 * slant
    graph = roads([(0.0, 0.0), corner_xy, end_xy, end_xy - 2 * back], one_way=[(0, 1), (1, 2), (2, 3)], cell_m=2.0)
    problem, plan, run = driven(tmp_path, graph, [[0, 1, 2, 3]], replace(TRICYCLE, length_m=1.1))
    assert run.arrived_s == pytest.approx(plan.arrive_s, abs=1e-6)
    result = audit(run, problem.fleet)
    assert result["passed"], result["violations"]


def test_arcs_are_driven_no_faster_than_the_sideways_acceleration_allows(tmp_path):
    slow = replace(TRICYCLE, kinematics=replace(TRICYCLE.kinematics, lateral_mps2=0.1))
    graph = corner()
    _, _, run = driven(tmp_path, graph, [[0, 1, 2]], slow)
    yaw = np.unwrap(run.yaw_rad[:, 0])
    rate = np.diff(yaw) / 0.1
    turns = turns_of(graph, slow)
    radius_m = turns.radius_m[turns.between(graph.lane_between(0, 1), graph.lane_between(1, 2)), 0]
    assert rate.max() * radius_m <= sqrt(0.1 * radius_m) + 1e-6
    assert run.speed_mps.max() > sqrt(0.1 * radius_m) + 0.1  # and faster elsewhere


def test_who_waits_across_a_corner_is_clear_of_a_truck_that_swings_past_it(tmp_path):
    """0 is at a dead end north of the crossing 1, 2 and 3 are west and east of it. One that backs into 0 swings to the south, where
    another stands at 4 until it is mended.
    """
    wheels = Wheels(kind="tricycle", wheelbase_m=1.4, steering_max_rad=1.2, reverse=True, docking="forks_first")
    truck = replace(TRICYCLE, length_m=1.9, kinematics=wheels)
    long_m = 2 * truck.radius_m + truck.gap_m + 0.01
    xy = [(0.0, 8.0), (0.0, 0.0), (-8.0, 0.0), (8.0, 0.0), (0.0, -long_m), (0.0, -8.0)]
    graph = roads(xy, [(0, 1), (1, 2), (1, 3), (1, 4), (4, 5)], cell_m=8.0)
    graph = with_swings(replace(graph, cell_m=long_m), [truck])
    problem = vehicles_on(graph, [2, 4], [0, 5], truck)
    broken = Disturbances(breakdowns=(Breakdown(robot=1, begin_s=0.0, duration_s=60.0),))
    settings = ExecutionSettings(engine="kinematic", time_limit_s=300.0, disturbances=broken)
    plan = plan_of_paths([[2, 2, 1, 0], [4, 5, 5, 5]], problem.step_s)
    run = simulate(problem, plan, settings, tmp_path)
    result = audit(run, problem.fleet)
    assert result["passed"], result["violations"]
    assert np.isfinite(run.goal_s).all() and np.nanmin(run.y_m[:, 0]) < -truck.kinematics.least_radius_m


@pytest.mark.parametrize("axle", ["rear", "front"])
def test_a_vehicle_that_never_moves_stands_with_its_middle_at_its_place(tmp_path, axle):
    vehicle = replace(CAR, kinematics=replace(CAR.kinematics, fixed_axle=axle))
    run = driven(tmp_path, corner(), [[0, 1], [2]], vehicle)[2]
    assert (run.x_m[:, 1], run.y_m[:, 1]) == (pytest.approx(4.0), pytest.approx(4.0))
