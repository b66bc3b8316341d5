"""All metrics of a run, flat: those of the registry, then those that the user brings."""

from collections.abc import Mapping, Sequence
from typing import Any

from mrp_sumo.core.execution import Execution, let_go_of_samples
from mrp_sumo.core.plan import PlanResult
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.zone_log import ZoneLog
from mrp_sumo.metrics import mrp_bench
from mrp_sumo.metrics.metric import Evidence, Metric
from mrp_sumo.metrics.registry import METRICS
from mrp_sumo.traffic.referee import Verdict

Metrics = dict[str, Any]


def succeeded(status: str, metrics: Mapping[str, Any]) -> bool:
    """True for a run with a plan, driven or not, that is a success: a valid plan and, where it was driven, all robots at their goals, or at
    work until the end, without an overlap.
    """
    arrived = status == "completed" and bool(metrics.get("all_goals_reached") or metrics.get("tasks_done") is not None)
    return (arrived or status == "planned") and bool(metrics.get("plan_valid"))


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
    zones: ZoneLog | None = None,
    metrics: Sequence[Metric] = METRICS,
) -> Metrics:
    """The metrics of a run by name. A value that does not exist (no plan, not executed, one robot alone) is None.

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
        How near its goal a robot has reached it: MRP-Bench's location tolerance.
    time_limit_s
        MRP-Bench's recording timeout.
    zones
        How occupied zones were, of a run with tasks.
    metrics
        Which; all of the registry by default.
    """
    evidence = Evidence(
        problem=problem,
        result=result,
        verdict=verdict,
        execution=execution,
        audit=audit,
        assignment_time_s=assignment_time_s,
        cell_m=problem.graph.cell_m if cell_m is None else cell_m,
        tolerance_m=tolerance_m,
        time_limit_s=time_limit_s,
        zones=zones,
    )
    values = {}
    for metric in metrics:
        values[metric.name] = metric(evidence)
        if execution is not None:
            let_go_of_samples(execution)
    return values
