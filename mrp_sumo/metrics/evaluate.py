"""All metrics of a run, flat, one documented formula each (the table in `docs/metrics.md`).

Pure functions of problem, plan and execution. A value that does not exist (no plan, not executed, one
robot alone) is None. MRP-Bench's metrics come from what MRP-Bench would have recorded: positions at 2 Hz,
in float32.
"""

from typing import Any

import numpy as np

from mrp_sumo.core.execution import Execution, positions_at
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.plan import Plan, PlanResult, paths_of_plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.metrics import mrp_bench
from mrp_sumo.traffic.referee import Verdict

MACHINE_DEPENDENT = (  # differ from run to run; all others are the same for the same scenario and seed
    "planning_time_s",
    "prepare_time_s",
    "assignment_time_s",
    "wall_time_s",
    "cpu_time_s",
    "real_time_factor",
    "robot_seconds_per_cpu_second",
)

Metrics = dict[str, Any]


def evaluate(
    problem: Problem,
    result: PlanResult,
    verdict: Verdict | None,
    execution: Execution | None,
    audit: dict[str, Any] | None = None,
    *,
    assignment_time_s: float | None = None,
    cell_m: float | None = None,
    tolerance_m: float = mrp_bench.TOLERANCE_M,
    time_limit_s: float = mrp_bench.RECORDING_TIMEOUT_S,
) -> Metrics:
    """The metrics of a run.

    Parameters
    ----------
    problem
        As it was executed, with the assignment.
    result
        Of the planner.
    verdict
        Of the referee on the plan; None without a plan.
    execution
        None when nothing was executed.
    audit
        Of the execution, as `metrics.audit.audit` gives it.
    assignment_time_s
        Wall time of the assignment, None when there was nothing to assign.
    cell_m
        MRP-Bench's cell size; that of the problem's graph by default.
    tolerance_m
        MRP-Bench's location tolerance.
    time_limit_s
        MRP-Bench's recording timeout.
    """
    metrics: Metrics = {"num_robots": problem.num_robots}
    metrics |= _planning(problem, result, verdict)
    metrics["assignment_time_s"] = assignment_time_s
    metrics |= _execution(
        problem,
        execution,
        cell_m=problem.graph.cell_m if cell_m is None else cell_m,
        tolerance_m=tolerance_m,
        recording_timeout_s=time_limit_s,
    )
    metrics |= _lateness(result.plan, execution)
    metrics["min_clearance_m"] = audit["min_clearance_m"] if audit else None
    metrics["num_overlaps"] = audit["num_overlaps"] if audit else None
    return metrics | _clocks(problem, execution)


def fleet_states(execution: Execution) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Stamps [K] in ns from 0, x, y and yaw [K, R] as MRP-Bench records them: 2 Hz, rounded to float32."""
    period_ns = round(1e9 / mrp_bench.RATE_HZ)
    t_ns = np.arange(0, round(float(execution.t_s[-1]) * 1e9) + 1, period_ns, dtype=np.int64)
    x, y, yaw = (a.astype(np.float32).astype(np.float64) for a in positions_at(execution, t_ns / 1e9))
    return t_ns, x, y, yaw


def _planning(problem: Problem, result: PlanResult, verdict: Verdict | None) -> Metrics:
    plan = result.plan
    metrics: Metrics = {
        "plan_success": plan is not None,
        "plan_valid": verdict.valid if verdict is not None and plan is not None else None,
        "num_vertex_conflicts": None,
        "num_edge_conflicts": None,
        "num_following_conflicts": None,
        "planning_time_s": result.planning_time_s,
        "prepare_time_s": result.prepare_time_s,
        "makespan_steps": None,
        "cost_steps": None,
        "soc_steps": None,
        "lower_bound_steps": _count(result.lower_bound_steps),
        "makespan_smoothed_steps": None,
        "cost_smoothed_steps": None,
        "makespan_s": None,
    }
    if verdict is not None and plan is not None:
        metrics |= {f"num_{kind}_conflicts": verdict.count(kind) for kind in ("vertex", "edge", "following")}
    if plan is None or not plan.num_robots:
        return metrics
    steps = plan.end_s / problem.step_s  # [R] steps until each robot is at its goal to stay
    metrics |= {
        "makespan_steps": _count(steps.max() + 1),
        "cost_steps": _count(steps.sum() + len(steps)),
        "soc_steps": _count(steps.sum()),
        "makespan_s": float(plan.end_s.max()),
    }
    if problem.graph.kind == "grid":
        try:
            paths = [path.tolist() for path in paths_of_plan(plan, problem.step_s)]
        except PlanError:  # a plan in continuous time has no list of cells to smooth
            return metrics
        xy = problem.graph.xy
        cell = np.rint((xy - xy.min(0)) / problem.graph.cell_m).astype(np.int64)
        metrics["makespan_smoothed_steps"], metrics["cost_smoothed_steps"] = mrp_bench.smoothed_counts(paths, cell)
    return metrics


def _execution(problem: Problem, execution: Execution | None, **constants: float) -> Metrics:
    """MRP-Bench's execution metrics under our names, and how many robots really ended at their goals."""
    names = (
        "goals_reached",
        "all_goals_reached",
        "robots_at_goal",
        "execution_time_s",
        "execution_timed_out",
        "min_distance_m",
        "min_distance_at_start_m",
        "min_distance_delta_m",
        "time_blocked_total_s",
        "time_blocked_s",
        "run_invalid",
    )
    if execution is None:
        return dict.fromkeys(names)
    t_ns, x, y, _ = fleet_states(execution)
    xy = problem.graph.xy
    found = mrp_bench.execution_metrics(t_ns, x, y, xy[problem.start], xy[problem.target], **constants)  # type: ignore[arg-type]
    blocked = found["timeBlockedPerAgent"]
    met = found["minDistanceBetweenTwoAgents"] != mrp_bench.NO_PAIR_M
    values = (
        found["goalsReached"],
        found["allGoalReached"],
        int(np.isfinite(execution.goal_s).sum()),
        found["totalTimeForScheduleExecution"],
        found["executionTimeoutReached"],
        found["minDistanceBetweenTwoAgents"] if met else None,
        found["minDistanceBetweenTwoAgentsAtStart"] if met else None,
        found["minDistanceBetweenTwoAgentsDelta"] if met else None,
        found["timeBlockedTotal"],
        [blocked.get(robot, 0.0) for robot in range(problem.num_robots)],
        found["invalidRun"],
    )
    return dict(zip(names, values, strict=True))


def _lateness(plan: Plan | None, execution: Execution | None) -> Metrics:
    """Of all visits that were reached, the starts left out."""
    names = ("lateness_mean_s", "lateness_p95_s", "lateness_max_s")
    if plan is None or execution is None or len(execution.arrived_s) != plan.num_visits:
        return dict.fromkeys(names)
    driven = np.ones(plan.num_visits, np.bool_)
    driven[plan.first[:-1]] = False
    late = (execution.arrived_s - plan.arrive_s)[driven & np.isfinite(execution.arrived_s)]
    if not len(late):
        return dict.fromkeys(names)
    return dict(zip(names, (float(late.mean()), float(np.quantile(late, 0.95)), float(late.max())), strict=True))


def _clocks(problem: Problem, execution: Execution | None) -> Metrics:
    names = ("sim_time_s", "wall_time_s", "cpu_time_s", "real_time_factor", "robot_seconds_per_cpu_second")
    if execution is None:
        return dict.fromkeys(names)
    sim, wall, cpu = execution.sim_time_s, execution.wall_time_s, execution.cpu_time_s
    return dict(
        zip(names, (sim, wall, cpu, sim / wall if wall > 0 else None, problem.num_robots * sim / cpu if cpu > 0 else None), strict=True)
    )


def _count(steps: float) -> float | int:
    """A number of steps; an int where it is whole."""
    whole = round(float(steps))
    return whole if abs(steps - whole) < 1e-6 * max(1.0, abs(steps)) else float(steps)
