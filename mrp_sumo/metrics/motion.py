"""Metrics of the drive: what was delivered and how late, how long it took, who stood, how near robots came to each other and to walls."""

import math

import numpy as np

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import FloatArray
from mrp_sumo.metrics.metric import LESS, MORE, NONE, Evidence, Metric, of_audit, of_execution, quantile, statistic


def _lateness(run: Evidence) -> FloatArray:
    """[K] of all visits that were reached, the starts left out."""
    plan, execution = run.plan, run.execution
    if plan is None or execution is None or len(execution.arrived_s) != plan.num_visits:
        return np.zeros(0)
    driven = np.ones(plan.num_visits, np.bool_)
    driven[plan.first[:-1]] = False
    late: FloatArray = (execution.arrived_s - plan.arrive_s)[driven & np.isfinite(execution.arrived_s)]
    return late


def _goal_times(run: Evidence) -> FloatArray:
    """[R] when each robot came to its goal; none where not all did."""
    goal_s = None if run.execution is None else run.execution.goal_s
    return goal_s if goal_s is not None and len(goal_s) and bool(np.isfinite(goal_s).all()) else np.zeros(0)


def _blocked_s(execution: Execution) -> float:
    total = math.fsum(event.duration_s for event in execution.events if event.kind == "blocked")
    return round(total, 6)  # steps of 0.1 s have no exact sum


# fmt: off
SERVICE = (
    Metric("num_robots", "", NONE, "n", lambda run: run.problem.num_robots),
    Metric("robots_at_goal", "", MORE,
           "robots that stand at their goals at the end: arrived there, or at rest within `tol`; stricter than `goals_reached`",
           of_execution(lambda execution: int(np.isfinite(execution.goal_s).sum())), one_goal=True),
    Metric("lateness_mean_s", "s", LESS,
           "mean over all visits reached, starts left out, of time reached minus time planned; negative: early",
           statistic(_lateness, np.mean), one_goal=True),
    Metric("lateness_p95_s", "s", LESS, "95th percentile of the same", quantile(_lateness, 0.95), one_goal=True),
    Metric("lateness_max_s", "s", LESS, "maximum of the same", statistic(_lateness, np.max), one_goal=True),
)
MOTION = (
    Metric("driven_makespan_s", "s", LESS, "time at which the last robot came to its goal to stay; null where not all did",
           statistic(_goal_times, np.max), one_goal=True),
    Metric("driven_flowtime_s", "s", LESS, "sum over robots of the time at which each came to its goal to stay; null where not all did",
           statistic(_goal_times, np.sum), one_goal=True),
    Metric("sim_time_s", "s", LESS, "simulated time at the end", of_execution(lambda execution: execution.sim_time_s)),
    Metric("wall_time_s", "s", LESS, "wall time of the simulation loop", of_execution(lambda execution: execution.wall_time_s),
           of_machine=True),
    Metric("cpu_time_s", "s", LESS, "CPU time of the simulation loop", of_execution(lambda execution: execution.cpu_time_s),
           of_machine=True),
    Metric("real_time_factor", "", MORE, "`sim_time_s / wall_time_s`",
           of_execution(lambda done: done.sim_time_s / done.wall_time_s if done.wall_time_s else None), of_machine=True),
    Metric("robot_seconds_per_cpu_second", "", MORE, "`n * sim_time_s / cpu_time_s`",
           of_execution(lambda done: done.num_robots * done.sim_time_s / done.cpu_time_s if done.cpu_time_s else None),
           of_machine=True),
    Metric("blocked_s", "s", LESS,
           "sum of the durations of all `blocked` events, each of a robot that did not advance by a cell within "
           "`execution.blocking_window_s`; waits of the plan and of disturbances left out", of_execution(_blocked_s)),
    Metric("execution_time_limit_s", "s", NONE,
           "`execution.time_limit_s`, or what follows from the plan where that is null",
           lambda run: None if run.execution is None else run.time_limit_s),
)
SAFETY = (
    Metric("min_clearance_m", "m", MORE,
           "least distance of two footprints (rectangles with heading) at any time, also between samples; 0 when they overlap",
           of_audit("min_clearance_m")),
    Metric("num_overlaps", "", LESS, "pairs of robots whose footprints ever overlap", of_audit("num_overlaps")),
    Metric("min_wall_clearance_m", "m", MORE, "least distance of a footprint from a wall of the drawing at any time; 0 when one touches it",
           of_audit("min_wall_clearance_m")),
    Metric("num_wall_contacts", "", LESS,
           "pairs of a robot and a wall that its footprint ever touches; a wall is open where a door is drawn on it",
           of_audit("num_wall_contacts")),
)
