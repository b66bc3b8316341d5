"""Metrics of what was delivered: robots at their goals, and how late."""

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.metrics.metric import Evidence, metric


@metric("", "none", "n")
def num_robots(run: Evidence) -> int:
    return run.problem.num_robots


@metric(
    "",
    "more",
    "robots that stand at their goals at the end: arrived there, or at rest within `tol`; stricter than `goals_reached`",
    one_goal=True,
)
def robots_at_goal(run: Evidence) -> int | None:
    return None if run.execution is None else int(np.isfinite(run.execution.goal_s).sum())


@metric("s", "less", "mean over all visits reached, starts left out, of time reached minus time planned; negative: early", one_goal=True)
def lateness_mean_s(run: Evidence) -> float | None:
    late = run.once(_lateness)
    return float(late.mean()) if len(late) else None


@metric("s", "less", "95th percentile of the same", one_goal=True)
def lateness_p95_s(run: Evidence) -> float | None:
    late = run.once(_lateness)
    return float(np.quantile(late, 0.95)) if len(late) else None


@metric("s", "less", "maximum of the same", one_goal=True)
def lateness_max_s(run: Evidence) -> float | None:
    late = run.once(_lateness)
    return float(late.max()) if len(late) else None


def _lateness(run: Evidence) -> FloatArray:
    """[K] of all visits that were reached, the starts left out."""
    plan, execution = run.plan, run.execution
    if plan is None or execution is None or len(execution.arrived_s) != plan.num_visits:
        return np.zeros(0)
    driven = np.ones(plan.num_visits, np.bool_)
    driven[plan.first[:-1]] = False
    late: FloatArray = (execution.arrived_s - plan.arrive_s)[driven & np.isfinite(execution.arrived_s)]
    return late
