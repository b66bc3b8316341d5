"""All metrics of a run, flat: those of the registry, then those that the user brings."""

from collections.abc import Mapping, Sequence
from typing import Any

from mrp_sumo.core.execution import let_go_of_samples
from mrp_sumo.metrics.metric import Evidence, Metric
from mrp_sumo.metrics.registry import METRICS

Metrics = dict[str, Any]


def succeeded(status: str, metrics: Mapping[str, Any]) -> bool:
    """True for a run with a plan, driven or not, that is a success: a valid plan and, where it was driven, all robots at their goals, or at
    work until the end, without an overlap.
    """
    arrived = status == "completed" and bool(metrics.get("all_goals_reached") or metrics.get("tasks_done") is not None)
    return (arrived or status == "planned") and bool(metrics.get("plan_valid"))


def evaluate(run: Evidence, metrics: Sequence[Metric] = METRICS) -> Metrics:
    """The metrics of a run by name; all of the registry by default.

    A value that does not exist (no plan, not executed, one robot alone) is None.
    """
    values = {}
    for metric in metrics:
        values[metric.name] = metric(run)
        if run.execution is not None:
            let_go_of_samples(run.execution)
    return values
