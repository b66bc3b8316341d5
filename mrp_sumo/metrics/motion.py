"""Metrics of the drive: how long it took, on the simulation's clock and on the machine's, and who stood."""

import math

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.metrics.metric import Evidence, metric


@metric("s", "less", "simulated time at the end")
def sim_time_s(run: Evidence) -> float | None:
    return None if run.execution is None else run.execution.sim_time_s


@metric("s", "less", "time at which the last robot came to its goal to stay; null where not all did", one_goal=True)
def driven_makespan_s(run: Evidence) -> float | None:
    goal_s = run.once(_goal_times)
    return None if goal_s is None else float(goal_s.max())


@metric("s", "less", "sum over robots of the time at which each came to its goal to stay; null where not all did", one_goal=True)
def driven_flowtime_s(run: Evidence) -> float | None:
    goal_s = run.once(_goal_times)
    return None if goal_s is None else float(goal_s.sum())


@metric("s", "less", "wall time of the simulation loop", of_machine=True)
def wall_time_s(run: Evidence) -> float | None:
    return None if run.execution is None else run.execution.wall_time_s


@metric("s", "less", "CPU time of the simulation loop", of_machine=True)
def cpu_time_s(run: Evidence) -> float | None:
    return None if run.execution is None else run.execution.cpu_time_s


@metric("", "more", "`sim_time_s / wall_time_s`", of_machine=True)
def real_time_factor(run: Evidence) -> float | None:
    done = run.execution
    return done.sim_time_s / done.wall_time_s if done is not None and done.wall_time_s > 0 else None


@metric("", "more", "`n * sim_time_s / cpu_time_s`", of_machine=True)
def robot_seconds_per_cpu_second(run: Evidence) -> float | None:
    done = run.execution
    return run.problem.num_robots * done.sim_time_s / done.cpu_time_s if done is not None and done.cpu_time_s > 0 else None


@metric(
    "s",
    "less",
    "sum of the durations of all `blocked` events: of robots that made no progress by a cell along their path within "
    "`execution.blocking_window_s`, waits that the plan or a disturbance asks for left out",
)
def blocked_s(run: Evidence) -> float | None:
    if run.execution is None:
        return None
    total = math.fsum(event.duration_s for event in run.execution.events if event.kind == "blocked")
    return round(total, 6)  # steps of 0.1 s have no exact sum


@metric(
    "s", "none", "simulated time that the execution was given: `execution.time_limit_s`, or what follows from the plan where that is null"
)
def execution_time_limit_s(run: Evidence) -> float | None:
    return None if run.execution is None else run.time_limit_s


def _goal_times(run: Evidence) -> FloatArray | None:
    """[R] when each robot came to its goal; None where not all did."""
    goal_s = None if run.execution is None else run.execution.goal_s
    return goal_s if goal_s is not None and len(goal_s) and bool(np.isfinite(goal_s).all()) else None
