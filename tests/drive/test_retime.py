"""What is planned is what is driven: the times of a retimed plan are those that SUMO needs, to one step."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import BURGER, CART, cross, graph_of, kinds, least_distance_m, line, problem_of, random_grid, square_grid

from mrp_sumo.core.disturbances import Breakdown, Disturbances
from mrp_sumo.core.execution import BOOKINGS
from mrp_sumo.core.plan import Plan, paths_of_plan
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.referee import judge

STEP_S = ExecutionSettings().step_length_s
CROSSING = [[3, 2, 1, 0, 7, 8, 9], [6, 5, 4, 0, 10, 11, 12]]  # from the east to the west, from the north to the south, at once
FAST = RobotType("fast", 0.6, 0.6, 2.0, 0.5, 0.5, 1.57, 0.1)  # brakes for 4 s, over 4 m
LATER = [[3, 2, 1, 0, 7, 8, 9], [6, 5, 4, 4, 0, 10, 11, 12]]


def driven_and_planned(tmp_path, graph, paths, robot=BURGER, **settings):
    """The retimed plan, and the execution of it in SUMO."""
    problem, plan = problem_of(graph, paths, robot)
    how = ExecutionSettings(**{"time_limit_s": 300.0, **settings})
    planned = retime(problem, plan, how)
    return planned, simulate(problem, planned, how, build_network(graph, tmp_path / "world.net.xml"))


def test_a_run_alone_takes_its_trapezoid_and_a_bend_its_turn(tmp_path):
    cell, robot = 2.0, CART
    graph = graph_of([(0, 0), (cell, 0), (2 * cell, 0), (2 * cell, cell)], [(0, 1), (1, 2), (2, 3)], cell)
    problem, plan = problem_of(graph, [[0, 1, 2, 3]], robot)
    arrive = retime(problem, plan, ExecutionSettings()).arrive_s
    v, a = robot.max_speed_mps, robot.accel_mps2
    straight_s = 2 * v / a + (2 * cell - v * v / a) / v  # from rest to rest over two lanes
    turn_s = np.pi / 2 / robot.turn_rate_rad_s
    assert arrive[1] == pytest.approx(v / a + (cell - v * v / a / 2) / v, abs=STEP_S)  # driven through
    assert arrive[2] == pytest.approx(straight_s, abs=2 * STEP_S)
    assert arrive[3] - arrive[2] == pytest.approx(turn_s + 2 * v / a + (cell - v * v / a) / v, abs=3 * STEP_S)


@pytest.mark.parametrize("robot", [BURGER, CART], ids=lambda robot: robot.name)
@pytest.mark.parametrize("paths", [CROSSING[:1], LATER, [LATER[1], [*LATER[0][:1], *LATER[0]]]])
def test_sumo_drives_every_visit_when_it_is_planned(tmp_path, paths, robot):
    planned, run = driven_and_planned(tmp_path, cross(3, 1.0), paths, robot)
    assert np.abs(run.arrived_s - planned.arrive_s).max() <= STEP_S + 1e-9


@pytest.mark.parametrize("policy", ["adg", "adg_timed"])
def test_policies_that_keep_the_order_keep_the_times(tmp_path, policy):
    planned, run = driven_and_planned(tmp_path, square_grid(3), [[0, 1, 2, 5], [6, 3, 4, 4, 1], [8, 7, 6]], policy=policy)
    assert np.abs(run.arrived_s - planned.arrive_s).max() <= STEP_S + 1e-9


def test_engines_agree(tmp_path):
    graph, paths = cross(3, 1.0), LATER
    _, sumo = driven_and_planned(tmp_path, graph, paths, CART)
    _, own = driven_and_planned(tmp_path, graph, paths, CART, engine="kinematic")
    assert own.arrived_s == pytest.approx(sumo.arrived_s, abs=1e-6)
    assert own.x_m == pytest.approx(sumo.x_m, abs=1e-6) and own.y_m == pytest.approx(sumo.y_m, abs=1e-6)
    assert own.sumo_xy_m == pytest.approx(np.stack([own.x_m, own.y_m], -1)[np.isin(own.t_s, own.sumo_t_s)], abs=1e-6)
    assert [(e.kind, e.robot, e.vertex) for e in own.events] == [(e.kind, e.robot, e.vertex) for e in sumo.events]


def test_limits_of_lanes_are_kept_and_approached(tmp_path):
    graph = line(6, 2.0)
    limited = replace(graph, speed_mps=np.where(np.minimum(graph.tail, graph.head) == 2, 0.4, np.inf))
    planned, run = driven_and_planned(tmp_path, limited, [[0, 1, 2, 3, 4, 5]], CART)
    assert np.abs(run.arrived_s - planned.arrive_s).max() <= STEP_S + 1e-9
    assert planned.arrive_s[3] - planned.arrive_s[2] == pytest.approx(2.0 / 0.4, abs=2 * STEP_S)


def test_robots_that_wait_behind_each_other_on_a_lane_keep_apart_in_both_engines(tmp_path):
    graph = graph_of([(0, 0), (4, 0), (8, 0), (8, 4), (4, 4)], [(0, 1), (1, 2), (2, 3), (4, 1)], 4.0)
    paths = [[1, 2, 2, 2, 2, 3], [0, 0, 1, 1, 1, 2], [4, 4, 4, 1, 1, 1]]  # they come after each other to where the first stands
    for engine in ("sumo", "kinematic"):
        planned, run = driven_and_planned(tmp_path, graph, paths[:2], CART, engine=engine)
        assert np.abs(run.arrived_s - planned.arrive_s).max() <= STEP_S + 1e-9
        assert least_distance_m(run) >= 0.82


@pytest.mark.parametrize("seed", [0, 3])
def test_engines_keep_the_same_distance_where_robots_wait_on_lanes(tmp_path, seed):
    problem = random_grid(6, 6, seed)
    method = planner("lacam", {"rotations": False})
    method.prepare()
    plan = method.plan(problem, 20.0).plan
    network = build_network(problem.graph, tmp_path / "world.net.xml")
    runs = [simulate(problem, plan, ExecutionSettings(engine=engine, time_limit_s=200.0), network) for engine in ("sumo", "kinematic")]
    assert runs[1].arrived_s == pytest.approx(runs[0].arrived_s, abs=1e-6)
    assert min(map(least_distance_m, runs)) >= problem.fleet.separation_m - 0.004


def test_a_robot_departs_when_it_sets_out_and_at_once_where_it_drives_through():
    problem, plan = problem_of(line(4), [[0, 1, 1, 2, 3]])
    retimed = retime(problem, plan, ExecutionSettings())
    assert retimed.depart_s[0] == 0.0 and retimed.depart_s[-1] == np.inf
    assert retimed.depart_s[1:3] == pytest.approx(retimed.arrive_s[1:3])  # nothing is in its way, so it does not wait
    problem, plan = problem_of(cross(2), [[2, 1, 0, 5], [4, 3, 3, 0, 7]])
    second = slice(int(plan.first[1]), int(plan.first[2]))
    retimed = retime(problem, plan, ExecutionSettings())
    assert retimed.depart_s[second][1] > retimed.arrive_s[second][1] + 0.5  # it lets the other pass


def test_the_plan_in_steps_stays_beside_it():
    problem, plan = problem_of(cross(3, 1.0), LATER)
    retimed = retime(problem, plan, ExecutionSettings())
    assert retimed.in_steps is plan and judge(problem, retimed).valid
    assert [path.tolist() for path in paths_of_plan(retimed, problem.step_s)] == LATER


def test_departures_of_a_plan_in_seconds_are_kept_by_a_policy_with_a_clock():
    problem, plan = problem_of(line(4), [[0, 1, 2, 3]])
    plan = retime(problem, plan, ExecutionSettings())
    later = replace(plan, depart_s=plan.depart_s + np.array([4.0, 0, 0, 0]), in_steps=None)
    rest = retime(problem, later, ExecutionSettings(policy="adg_timed"))
    assert rest.depart_s[0] == pytest.approx(4.0) and rest.arrive_s[1:] == pytest.approx(plan.arrive_s[1:] + 4.0)
    assert retime(problem, later, ExecutionSettings(policy="adg")).depart_s[0] == 0.0  # that policy has no clock


def test_a_margin_lets_the_second_wait_longer():
    problem, plan = problem_of(cross(3, 1.0), LATER, CART)
    first, second = slice(0, int(plan.first[1])), slice(int(plan.first[1]), None)
    without, with_margin = (retime(problem, plan, ExecutionSettings(), margin_s=margin) for margin in (0.0, 1.5))
    assert with_margin.arrive_s[first] == pytest.approx(without.arrive_s[first])
    assert with_margin.end_s[1] - without.end_s[1] == pytest.approx(1.5, abs=2 * STEP_S)
    assert (with_margin.arrive_s[second] >= without.arrive_s[second] - 1e-9).all()


def test_slack_by_the_spread_of_delays_grows_with_the_visits_and_keeps_the_second_on_time():
    problem, plan = problem_of(cross(3, 1.0), LATER, CART)
    timed = ExecutionSettings(policy="adg_timed", engine="kinematic")
    without, with_slack = (retime(problem, plan, timed, spread_s=spread) for spread in (0.0, 0.5))
    crossed = LATER[0].index(0)  # visits that the first one has made when it frees the crossing
    assert with_slack.end_s[1] == pytest.approx(retime(problem, plan, timed, margin_s=2 * 0.5 * np.sqrt(crossed)).end_s[1], abs=STEP_S)
    late = replace(timed, disturbances=Disturbances(breakdowns=(Breakdown(0, 0.0, 1.0),)))
    second = slice(int(plan.first[1]), None)
    lateness = [float((simulate(problem, p, late, None).arrived_s - p.arrive_s)[second].max()) for p in (without, with_slack)]
    assert lateness[0] > 0.5 and lateness[1] <= STEP_S + 1e-6


def test_a_wait_is_no_blocking_until_the_plan_has_it_over():
    graph = cross(4, 1.0)
    first, second = [4, 3, 2, 1, 0, 9], [5, 5, 5, 5, 5, 5, 0, 13]  # the second stands before the crossing until the first has passed
    problem, plan = problem_of(graph, [first, second])
    how = ExecutionSettings(engine="kinematic", time_limit_s=300.0)
    planned = retime(problem, plan, how)
    waits_s = planned.arrive_s[planned.first[1] + 1]
    assert waits_s > 2 * how.blocking_window_s
    assert "blocked" not in kinds(simulate(problem, planned, how, None))
    held = Disturbances(breakdowns=(Breakdown(0, 1.0, 40.0),))
    run = simulate(problem, planned, replace(how, disturbances=held), None)
    late = [event for event in run.events if event.kind == "blocked" and event.robot == 1]
    assert [event.t_s for event in late] == pytest.approx([waits_s], abs=5.0)  # it counts from the last whole cell


def test_a_plan_whose_order_nobody_can_keep_is_refused():
    problem, plan = problem_of(square_grid(2), [[0, 1], [1, 3], [3, 2], [2, 0]])
    with pytest.raises(PlanError, match="cyclic"):
        retime(problem, plan, ExecutionSettings())


def test_who_passes_first_is_read_from_who_sets_out_first():
    """A robot on a long lane holds what it needs there from when it enters it, though another one arrives earlier elsewhere."""
    graph = graph_of([(0, 0), (6, 0), (5.8, 1), (5.8, -1), (0, 1)], [(0, 1), (2, 3), (4, 2)], 1.0)
    problem, plan = problem_of(graph, [[0, 1], [2, 2, 2, 3]], CART)
    retimed = retime(problem, plan, ExecutionSettings())
    again = retime(problem, Plan(retimed.first, retimed.vertex, retimed.arrive_s, retimed.depart_s), ExecutionSettings())
    assert again.arrive_s == pytest.approx(retimed.arrive_s)


def test_robots_that_brake_for_seconds_stop_where_they_are_planned_to():
    problem, plan = problem_of(line(12, 1.0), [list(range(12))], FAST)
    plan = retime(problem, plan, ExecutionSettings())
    later = np.where(np.arange(12) > 5, 6.0, 0.0)  # it stops halfway, for less than it takes to brake
    stays = replace(plan, arrive_s=plan.arrive_s + later, depart_s=plan.depart_s + np.append(later[1:], 0.0), in_steps=None)
    timed = ExecutionSettings(policy="adg_timed", engine="kinematic")
    planned = retime(problem, stays, timed)
    assert planned.depart_s[5] == pytest.approx(stays.depart_s[5], abs=STEP_S) and planned.depart_s[5] > planned.arrive_s[5]
    assert np.abs(simulate(problem, planned, timed, None).arrived_s - planned.arrive_s).max() <= STEP_S + 1e-6


@pytest.mark.parametrize("engine", ["sumo", "kinematic"])
def test_a_robot_that_faces_the_wrong_way_starts_half_a_turn_later_and_turns_before_it_has_arrived(tmp_path, engine):
    robot = replace(CART, turn_rate_rad_s=np.pi / 4)
    problem, plan = problem_of(line(4, 1.0), [[0, 1, 2]], robot)
    how = ExecutionSettings(engine=engine, time_limit_s=60.0)
    network = build_network(problem.graph, tmp_path / "world.net.xml")
    alone = simulate(problem, retime(problem, plan, how), how, network)
    problem = replace(problem, start_heading_rad=np.array([np.pi]), goal_heading_rad=np.array([-np.pi / 2]))
    planned = retime(problem, plan, how)
    run = simulate(problem, planned, how, network)
    assert planned.depart_s[0] == pytest.approx(4.0)
    assert run.arrived_s[1:] == pytest.approx(alone.arrived_s[1:] + 4.0) and planned.arrive_s == pytest.approx(run.arrived_s)
    came = np.ceil(run.arrived_s[2] / STEP_S) * STEP_S
    assert run.goal_s[0] == pytest.approx(came + 2.0) and planned.end_s == pytest.approx(run.goal_s)
    assert run.yaw_rad[[0, -1], 0] % (2 * np.pi) == pytest.approx([np.pi, 1.5 * np.pi])
    assert run.booked_s[0, BOOKINGS.index("turning")] == pytest.approx(6.0)


def test_a_robot_backs_out_of_its_dock_without_turning():
    def time_of(options):
        graph = graph_of([(0, 0), (2, 0)], [(0, 1)], 2.0)
        graph = replace(graph, lane_options=({}, options))
        problem, plan = problem_of(graph, [[0, 1, 0]], step_s=20.0)
        return retime(problem, plan, ExecutionSettings(policy="adg")).end_s[0]

    turn_s = np.pi / BURGER.turn_rate_rad_s
    assert time_of({}) - time_of({"orientation_constraint": "backward"}) == pytest.approx(turn_s, abs=0.11)
