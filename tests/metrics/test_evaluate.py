"""Metrics of a run, on a corridor where every number is known by hand."""

from dataclasses import replace

import numpy as np
import pytest

from mrp_sumo.core.execution import Event, Execution, Outcome, PlannerCalls
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.metrics.audit import audit
from mrp_sumo.metrics.evaluate import evaluate
from mrp_sumo.metrics.metric import Evidence
from mrp_sumo.metrics.registry import MACHINE_DEPENDENT, METRICS
from mrp_sumo.traffic.referee import judge

NAMES = [
    "plan_success",
    "plan_valid",
    "planning_time_s",
    "planning_cpu_s",
    "assignment_time_s",
    "makespan_steps",
    "cost_steps",
    "soc_steps",
    "lower_bound_steps",
    "num_robots",
    "goals_reached",
    "all_goals_reached",
    "execution_time_s",
    "execution_timed_out",
    "min_distance_m",
    "min_distance_at_start_m",
    "min_distance_delta_m",
    "time_blocked_total_s",
    "time_blocked_s",
    "min_clearance_m",
    "num_overlaps",
    "lateness_mean_s",
    "lateness_p95_s",
    "lateness_max_s",
    "sim_time_s",
    "wall_time_s",
    "cpu_time_s",
    "real_time_factor",
    "robot_seconds_per_cpu_second",
]
CART = RobotType("cart", 0.2, 0.2, max_speed_mps=1.0, accel_mps2=1.0, decel_mps2=1.0, turn_rate_rad_s=1.0)


def corridors():
    """Two corridors of six cells, 1 m apart, robots driving along both from x = 0 to x = 5."""
    xy = [(x, y) for y in (0.0, 1.0) for x in range(6)]
    pairs = [(6 * row + i, 6 * row + i + 1) for row in range(2) for i in range(5)]
    nav = nav_graph(name="two", xy=xy, lanes=pairs + [(b, a) for a, b in pairs])
    graph = plan_graph(nav, kind="grid", cell_m=1.0)
    start, goal = np.array([0, 6]), np.array([5, 11])
    return Problem(graph=graph, fleet=fleet_of(CART, 2), start=start, goal=goal, goal_of=np.array([0, 1]), step_s=1.0)


def planned():
    """The second robot waits a step at its start."""
    plan = plan_of_paths([[0, 1, 2, 3, 4, 5], [6, 6, 7, 8, 9, 10, 11]], 1.0)
    return PlanResult(Status.SOLVED, plan=plan, planning_time_s=0.25, lower_bound_steps=10)


def driven(problem, plan, late_s):
    """Both at 1 m/s as planned, the second `late_s` behind its plan."""
    t = np.arange(0, 12.05, 0.1)
    x = np.stack((np.clip(t, 0, 5), np.clip(t - 1 - late_s, 0, 5)), 1)
    y = np.broadcast_to([0.0, 1.0], x.shape)
    arrived = plan.arrive_s + np.where(plan.robot == 1, late_s, 0.0)
    arrived[plan.first[:-1]] = 0
    still = np.zeros(x.shape)
    return Execution(t, x, y, still, still, arrived, np.array([5.0, 6.0 + late_s]), Outcome.COMPLETED, "adg", 12.0, 0.5, 0.25)


def test_every_metric_is_there_and_right():
    problem, result = corridors(), planned()
    execution = driven(problem, result.plan, late_s=2.0)
    judged = judge(problem, result.plan), execution, audit(execution, problem.fleet)
    outcome = evaluate(Evidence(problem, result, *judged, assignment_time_s=0.1, time_limit_s=300))
    assert set(NAMES) <= set(outcome)
    clocks = {
        f"{of}_s" for of in ("planning_time", "planning_cpu", "prepare_time", "retime_time", "assignment_time", "wall_time", "cpu_time")
    }
    assert set(MACHINE_DEPENDENT) == clocks | {"real_time_factor", "robot_seconds_per_cpu_second"}
    expected = {
        "plan_success": True,
        "plan_valid": True,
        "planning_time_s": 0.25,
        "assignment_time_s": 0.1,
        "makespan_steps": 7,  # the longer list has seven cells
        "cost_steps": 13,
        "soc_steps": 11,
        "lower_bound_steps": 10,
        "makespan_smoothed_steps": 7,  # no corners, and a wait goes only where it is two steps long
        "makespan_s": 6.0,
        "num_robots": 2,
        "goals_reached": 2,
        "robots_at_goal": 2,
        "all_goals_reached": True,
        # the first robot is 0.7 m from its start at 1.0 s, the second 0.7 m from its goal at 7.3 s, seen at 7.5 s
        "execution_time_s": 6.5,
        "execution_timed_out": False,
        "min_distance_m": 1.0,
        "min_distance_at_start_m": 1.0,
        "min_distance_delta_m": 0.0,
        "time_blocked_total_s": 0.0,
        "time_blocked_s": [0.0, 0.0],
        "num_overlaps": 0,
        "min_clearance_m": pytest.approx(0.8),
        "lateness_mean_s": 1.0,
        "lateness_max_s": 2.0,
        "lateness_p95_s": 2.0,
        "driven_makespan_s": 8.0,
        "driven_flowtime_s": 13.0,
        "execution_time_limit_s": 300,
        "sim_time_s": 12.0,
        "real_time_factor": 24.0,
        "robot_seconds_per_cpu_second": 96.0,
    }
    assert {key: outcome[key] for key in expected} == expected


def test_metrics_of_one_plan_to_one_goal_each_are_none_in_runs_with_orders():
    ends = {"makespan", "flowtime", "driven_makespan", "driven_flowtime", "execution_time", "time_blocked", "time_blocked_total"}
    steps = {"soc", "cost", "makespan", "lower_bound", "cost_smoothed", "makespan_smoothed"}
    counts = {f"num_{kind}_conflicts" for kind in ("vertex", "edge", "following")} | {"goals_reached", "robots_at_goal", "run_invalid"}
    late = {f"lateness_{of}_s" for of in ("mean", "p95", "max")} | {"execution_timed_out", "all_goals_reached", "assignment_time_s"}
    names = {f"{name}_s" for name in ends} | {f"{name}_steps" for name in steps} | counts | late
    assert {metric.name for metric in METRICS if metric.one_goal} == names


def test_without_a_plan_there_is_nothing_to_measure_and_names_stay():
    problem = corridors()
    outcome = evaluate(Evidence(problem, PlanResult(Status.TIMED_OUT, planning_time_s=60.0), None, None))
    assert set(NAMES) <= set(outcome)
    assert outcome["plan_success"] is False
    assert {k for k, v in outcome.items() if v is not None} == {
        "num_robots", "plan_success", "planning_time_s", "prepare_time_s", "lower_bound_steps",
    }  # fmt: skip


def test_a_robot_that_stands_short_of_its_goal_is_blocked_and_times_out():
    problem, result = corridors(), planned()
    execution = driven(problem, result.plan, late_s=0.0)
    x = np.minimum(execution.x_m, [5.0, 3.0])  # the second stops two cells early
    execution = Execution(**{**vars(execution), "x_m": x, "goal_s": np.array([5.0, np.nan])})
    outcome = evaluate(Evidence(problem, result, judge(problem, result.plan), execution, time_limit_s=300))
    assert outcome["goals_reached"] == outcome["robots_at_goal"] == 1
    assert outcome["driven_makespan_s"] is outcome["driven_flowtime_s"] is None
    assert outcome["execution_timed_out"] and outcome["execution_time_s"] == 300
    assert outcome["time_blocked_s"][0] == 0 < outcome["time_blocked_s"][1] == outcome["time_blocked_total_s"]


def test_seconds_blocked_add_up_without_a_trace_of_binary_fractions():
    problem, result = corridors(), planned()
    events = [Event(0.0, "blocked", robot, duration_s=duration_s) for robot, duration_s in ((0, 0.1), (1, 0.2), (0, 4 - 0.1))]
    events += [Event(0.0, kind, 0, duration_s=7.0) for kind in ("arrived", "waited")]
    execution = Execution(**{**vars(driven(problem, result.plan, late_s=0.0)), "events": events})
    assert repr(evaluate(Evidence(problem, result, None, execution))["blocked_s"]) == "4.2"


def test_positions_are_those_of_float32_messages():
    problem, result = corridors(), planned()
    execution = driven(problem, result.plan, late_s=0.0)
    moved = Execution(**{**vars(execution), "y_m": np.add(execution.y_m, [0.0, 1e-9])})  # float32 does not see a nanometre
    assert evaluate(Evidence(problem, result, None, moved))["min_distance_m"] == 1.0


def test_lateness_is_of_visits_that_were_reached():
    """Of eleven the second robot came to two, 2 s late; without its starts, which are never late."""
    problem, result = corridors(), planned()
    arrived_s = driven(problem, result.plan, late_s=2.0).arrived_s
    arrived_s[[0, 6]] = 99.0
    arrived_s[9:] = np.nan
    for times_s, late_s in ((arrived_s, (4 / 7, 2.0)), (arrived_s[:-1], (None, None))):
        execution = Execution(**{**vars(driven(problem, result.plan, 0.0)), "arrived_s": times_s, "wall_time_s": 0.0, "cpu_time_s": 0.0})
        shown = evaluate(Evidence(problem, result, None, execution))
        assert (shown["lateness_mean_s"], shown["lateness_max_s"]) == pytest.approx(late_s)
        assert shown["real_time_factor"] is shown["robot_seconds_per_cpu_second"] is None
    without = evaluate(Evidence(problem, PlanResult(Status.TIMED_OUT), None, driven(problem, result.plan, 0.0)))
    assert without["lateness_mean_s"] is None and without["driven_makespan_s"] == 6.0


@pytest.mark.parametrize(
    ("first_s", "calls", "expected"),
    [
        (0.5, None, (0.25, 0.5)),
        (0.5, PlannerCalls(wall_time_s=2.0, cpu_time_s=3.0), (2.25, 3.5)),
        (None, PlannerCalls(wall_time_s=2.0, cpu_time_s=3.0), (2.25, 3.0)),
        (0.5, PlannerCalls(wall_time_s=2.0), (2.25, 0.5)),  # of a planner from outside
    ],
)
def test_planning_takes_what_all_answers_took(first_s, calls, expected):
    problem, result = corridors(), replace(planned(), planning_cpu_s=first_s)
    execution = Execution(**{**vars(driven(problem, result.plan, late_s=0.0)), "calls": calls})
    shown = evaluate(Evidence(problem, result, None, execution))
    assert (shown["planning_time_s"], shown["planning_cpu_s"]) == expected
    assert (shown["makespan_s"], shown["flowtime_s"]) == (6.0, 11.0)
