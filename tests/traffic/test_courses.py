"""Lanes that are drawn as curves, as vehicles follow them: held against circles and the curvature of Bezier curves."""

from dataclasses import replace
from math import hypot, pi, sqrt

import numpy as np
import pytest

from mrp_sumo.core.bodies import axle_of
from mrp_sumo.core.execution import Outcome
from mrp_sumo.core.graph import relaid
from mrp_sumo.core.plan import plan_of_paths
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.metrics.audit import audit
from mrp_sumo.traffic.courses import curve_radius_m
from mrp_sumo.traffic.turns import BACKWARD, FORWARD, NEVER, obstacle_to, turns_of
from tests.vehicles import CAR, TRICYCLE, TUGGER, along, curve, quarter, straight, vehicles_on

RADIUS_M = 5.0
S_BEND = [(4.0, 0.0), (8.0, 0.0), (6.0, 4.0), (10.0, 4.0)]


def bend(radius_m=RADIUS_M, **more):
    """0 - 1 east, 1 - 2 round a quarter of a circle, 2 - 3 north."""
    end = (4.0 + radius_m, radius_m)
    return along(straight((0, 0), (4, 0)), quarter(radius_m, (4.0, 0.0)), straight(end, (end[0], end[1] + 4)), **more)


def whole(graph, a, b):
    """The path of vertices from one of the drawing to another, along lanes that lead on."""
    path, before = [a], -1
    while path[-1] != b:
        onward = [int(v) for v in graph.head[graph.tail == path[-1]] if v != before]
        ahead = min(onward, key=lambda v: np.hypot(*(graph.xy[v] - graph.xy[b])))
        before = path[-1]
        path.append(ahead)
    return path


def driven(tmp_path, graph, path, vehicle, engine="kinematic"):
    problem = vehicles_on(graph, [path[0]], [path[-1]], vehicle)
    settings = ExecutionSettings(engine=engine, time_limit_s=300.0)
    plan = retime(problem, plan_of_paths([path], problem.step_s), settings)
    network = build_network(graph, tmp_path / "world.net.xml") if engine == "sumo" else tmp_path
    run = simulate(problem, plan, settings, network)
    verdict = audit(run, problem.fleet)
    assert verdict["passed"], verdict["violations"]
    assert run.arrived_s == pytest.approx(plan.arrive_s, abs=1e-6)
    return run, np.stack(axle_of(run.x_m[:, 0], run.y_m[:, 0], run.yaw_rad[:, 0], vehicle.kinematics.ahead_m), 1)


@pytest.mark.parametrize("engine", ["kinematic", "sumo"])
@pytest.mark.parametrize("cell_m", [3.0, 9.0])
@pytest.mark.parametrize("vehicle", [TRICYCLE, CAR, TUGGER], ids=lambda each: each.name)
def test_the_axle_is_on_the_circle_that_is_drawn_and_faces_along_it(tmp_path, vehicle, cell_m, engine):
    graph = bend(cell_m=cell_m)
    run, axle = driven(tmp_path, graph, whole(graph, 0, 3), vehicle, engine)
    off = axle - (4.0, RADIUS_M)
    on = (off[:, 0] > 0) & (off[:, 1] < 0)
    assert on.sum() > 20
    assert np.hypot(*off[on].T) == pytest.approx(RADIUS_M, abs=1e-3)
    assert run.yaw_rad[on, 0] == pytest.approx(np.arctan2(off[on, 1], off[on, 0]) + pi / 2, abs=1e-3)


def test_a_curve_is_driven_backward_on_the_same_track(tmp_path):
    graph = bend(cell_m=2.0)
    path = whole(graph, 0, 3)
    _, axle = driven(tmp_path, graph, path + path[-2::-1], TRICYCLE)
    off = axle - (4.0, RADIUS_M)
    assert np.hypot(*off[(off[:, 0] > 0) & (off[:, 1] < 0)].T) == pytest.approx(RADIUS_M, abs=1e-3)


def test_speed_on_a_curve_is_what_its_radius_allows_and_does_not_fall_at_its_pieces(tmp_path):
    slow = replace(TRICYCLE, kinematics=replace(TRICYCLE.kinematics, lateral_mps2=0.1))
    graph = bend(cell_m=2.0)
    run, axle = driven(tmp_path, graph, whole(graph, 0, 3), slow)
    on = (axle[:, 0] > 4.2) & (axle[:, 1] < RADIUS_M - 0.2)
    assert run.speed_mps[on, 0] == pytest.approx(sqrt(0.1 * RADIUS_M), abs=0.01)
    assert run.speed_mps.max() > 0.7


def test_a_wide_curve_is_driven_at_full_speed(tmp_path):
    graph = bend(cell_m=2.0)
    run, axle = driven(tmp_path, graph, whole(graph, 0, 3), TRICYCLE)
    assert run.speed_mps[(axle[:, 0] > 4.2) & (axle[:, 1] < RADIUS_M - 0.2), 0] == pytest.approx(1.0, abs=1e-6)


def test_the_tightest_place_of_a_bezier_curve_is_that_of_its_formula():
    graph = along(straight((0, 0), (4, 0)), curve(3, S_BEND), straight((10, 4), (14, 4)), cell_m=20.0)
    t, points = np.linspace(0, 1, 100001)[:, None], np.array(S_BEND)
    first = 3 * np.hstack([(1 - t) ** 2, 2 * t * (1 - t), t**2]) @ np.diff(points, axis=0)
    second = 6 * np.hstack([1 - t, t]) @ np.diff(points, 2, axis=0)
    bends = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / np.hypot(*first.T) ** 3
    assert curve_radius_m(graph)[graph.lane_between(1, 2)] == pytest.approx(1 / bends.max(), rel=0.01)


def test_an_s_bend_is_driven_within_a_few_millimetres_of_it(tmp_path):
    graph = along(straight((0, 0), (4, 0)), curve(3, S_BEND), straight((10, 4), (14, 4)), cell_m=2.0)
    _, axle = driven(tmp_path, graph, whole(graph, 0, 3), TRICYCLE)
    t, points = np.linspace(0, 1, 20001)[:, None], np.array(S_BEND)
    true = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3]) @ points
    on = axle[(axle[:, 0] > 4.1) & (axle[:, 0] < 9.9)]
    assert max(np.hypot(*(true - place).T).min() for place in on) < 0.004


@pytest.mark.parametrize(("spare", "drives"), [(1.0, True), (0.98, False)])
def test_a_curve_has_to_be_as_wide_as_the_least_radius(spare, drives):
    least_m = CAR.kinematics.least_radius_m
    graph = bend(least_m * spare, cell_m=9.0)
    lane = graph.lane_between(1, 2)
    assert turns_of(graph, CAR).gears[lane].tolist() == [drives, False]
    words = f"car needs {least_m:.2f} m to drive the curve 'v1 -> v2' and it has {least_m * spare:.2f} m"
    assert obstacle_to(graph, CAR, [0, 1, 2, 3]) == ("" if drives else words)


@pytest.mark.parametrize(("beyond_m", "drives"), [(0.01, True), (-0.01, False)])
@pytest.mark.parametrize("inside", [True, False])
def test_a_wall_beside_a_curve_is_held_against_the_closed_form(beyond_m, drives, inside):
    front_m = CAR.length_m / 2 + CAR.kinematics.ahead_m
    outer_m = hypot(RADIUS_M + CAR.width_m / 2, front_m) + 0.005
    inner_m = RADIUS_M - CAR.width_m / 2 - 0.005
    away_m = inner_m - beyond_m if inside else outer_m + beyond_m
    centre, ray = np.array([4.0, RADIUS_M]), np.array([1.0, -1.0]) / sqrt(2)
    ends = [centre + away_m * ray, centre + (away_m - 0.3 if inside else away_m + 0.3) * ray]
    graph = replace(bend(cell_m=9.0), walls=np.array([ends]))
    assert turns_of(graph, CAR).gears[graph.lane_between(1, 2), FORWARD] == drives
    assert obstacle_to(graph, CAR, [0, 1, 2, 3]) == ("" if drives else "car touches a wall on the curve 'v1 -> v2'")


def test_a_wall_beside_the_chord_of_a_curve_bars_nobody():
    graph = bend(cell_m=9.0)
    chord = graph.xy[[1, 2]].mean(0)
    near = np.array([[chord, chord - 0.1]])
    assert turns_of(replace(graph, walls=near), CAR).gears[graph.lane_between(1, 2), FORWARD]


def test_a_corner_beside_a_curve_is_cut_by_a_curve(tmp_path):
    """The curve leads on to the north, the lane behind it to the north-east."""
    graph = along(straight((0, 0), (4, 0)), quarter(RADIUS_M, (4, 0)), straight((4 + RADIUS_M, RADIUS_M), (12.0, RADIUS_M + 3)), cell_m=9.0)
    turns = turns_of(graph, TRICYCLE)
    turn = turns.between(graph.lane_between(1, 2), graph.lane_between(2, 3))
    assert turns.bend_rad[turn] == pytest.approx(-pi / 4)
    assert TRICYCLE.kinematics.least_radius_m <= turns.radius_m[turn, FORWARD] < np.inf
    driven(tmp_path, graph, [0, 1, 2, 3], TRICYCLE)


def test_a_corner_that_no_curve_cuts_is_named():
    graph = along(straight((0, 0), (4, 0)), quarter(RADIUS_M, (4, 0)), straight((4 + RADIUS_M, RADIUS_M), (4.0, RADIUS_M - 1)), cell_m=9.0)
    assert obstacle_to(graph, CAR, [0, 1, 2, 3]) == "car turns by 100 degrees at most, and it is 101 from 'v1' over 'v2' to 'v3'"


@pytest.mark.parametrize(("vehicle", "line"), [(TRICYCLE, ""), (CAR, "car needs a radius of 1.07 m to turn from 'v1' over 'v2' to 'v3'")])
def test_a_corner_beside_a_curve_that_is_too_tight_is_named_with_the_radius(vehicle, line):
    """A curve ends at v2, from which a lane leads back at a right angle."""
    graph = along(straight((-6.0, 0.0), (0.0, 0.0)), quarter(5.0), straight((5.0, 5.0), (1.0, 5.0)), cell_m=9.0, both_ways=False)
    output = obstacle_to(graph, vehicle, [0, 1, 2, 3])
    assert output.startswith(line) and ("where the widest curve has 0." in output) == bool(line)


def test_a_vehicle_waits_for_one_on_a_curve_that_comes_near_its_own_lane(tmp_path):
    """A quarter of a circle of 8 m in one step, and a lane 2.8 m beside its chord: 0.46 m from where the circle is nearest."""
    roads = along(straight((-9, 0), (0, 0)), quarter(8.0), straight((8, 8), (8, 17)), cell_m=14.0)
    out, on = np.array([1, -1]) / sqrt(2), np.array([1, 1]) / sqrt(2)
    middle = np.array([4.0, 4.0]) + 2.8 * out
    beside = relaid(
        roads,
        xy=np.vstack([roads.xy, middle - 15.3 * on, middle + 9 * on]),
        level=np.zeros(roads.num_vertices + 2, np.int64),
        vertex_options=[*roads.vertex_options, {}, {}],
        lanes=[*zip(roads.tail.tolist(), roads.head.tolist()), (roads.num_vertices, roads.num_vertices + 1)],
        length_m=[*roads.length_m, 24.3],
    )
    ends = [0, roads.num_vertices], [3, roads.num_vertices + 1]
    problem = vehicles_on(beside, *ends, CAR)
    settings = ExecutionSettings(engine="kinematic", time_limit_s=300.0)
    plan = retime(problem, plan_of_paths([[0, 1, 2, 3], [ends[0][1], ends[1][1]]], problem.step_s), settings)
    run = simulate(problem, plan, settings, tmp_path)
    assert run.outcome is Outcome.COMPLETED and audit(run, problem.fleet)["passed"]
    assert np.hypot(*(np.diff(run.x_m, axis=1), np.diff(run.y_m, axis=1))).min() >= CAR.length_m


def test_who_may_reverse_goes_back_along_a_curve_and_does_not_swing_beside_it():
    graph = bend(cell_m=9.0)
    turns = turns_of(graph, TRICYCLE)
    there, back = graph.lane_between(1, 2), graph.lane_between(2, 1)
    assert turns.next_gear[turns.between(there, back)].tolist() == [BACKWARD, FORWARD]
    only = turns_of(graph, CAR)
    assert (only.next_gear[only.between(there, back)] == NEVER).all() and np.isnan(only.radius_m[only.between(there, back)]).all()
