"""Metrics of runs that have ended: of one run from its folder, or of all runs of a batch from their traces."""

from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import BatchError, MrpSumoError
from mrp_sumo.experiments.batch import is_under_way
from mrp_sumo.io.results import drop_tables, read_plan, read_record, record_path, write_record, write_tables
from mrp_sumo.io.run_folder import plain
from mrp_sumo.io.run_reader import RunFolder, damage_in, load_run
from mrp_sumo.io.trace import read_trace, trace_path
from mrp_sumo.metrics.evaluate import Metrics, evaluate
from mrp_sumo.metrics.metric import Evidence, Metric
from mrp_sumo.metrics.zones import occupancy
from mrp_sumo.traffic.referee import judge


def measure_run(run: RunFolder, metrics: Sequence[Metric]) -> Metrics:
    """Metrics of a run folder, by name. Without a plan there is nothing to measure: all are None.

    Raises MrpSumoError when a file is missing or damaged.
    """
    with damage_in(run.folder):  # metrics that anybody wrote are guarded: it is the folder that contradicts itself
        return _measured(run, metrics)


def _measured(run: RunFolder, metrics: Sequence[Metric]) -> Metrics:
    plan, recorded, scenario = run.plan, run.metrics, run.result["scenario"]
    if plan is None:
        return {metric.name: recorded.get(metric.name) for metric in metrics}
    execution = run.execution if run.executed else None
    target = run.record.target if run.executed else plan.last_vertex
    if not len(target):  # tasks came instead
        target = plan.last_vertex
    problem = Problem(
        graph=run.graph,
        fleet=run.fleet,
        start=plan.vertex[plan.first[:-1]],
        goal=target,
        goal_of=np.arange(plan.num_robots),
        step_s=run.result["plan"]["step_s"],
        seed=run.result["seed"],
    )
    result = PlanResult(
        Status(run.result["plan"]["status"]),
        plan=plan,
        planning_time_s=recorded["planning_time_s"],
        planning_cpu_s=recorded.get("planning_cpu_s"),
        retime_time_s=recorded.get("retime_time_s"),
        prepare_time_s=recorded["prepare_time_s"],
        lower_bound_steps=recorded["lower_bound_steps"],
        message=run.result["plan"]["message"],
        stats=run.result["plan"]["stats"],
    )
    evidence = Evidence(
        problem,
        result,
        judge(problem, plan),
        execution,
        run.audit,
        assignment_time_s=recorded["assignment_time_s"],
        tolerance_m=scenario["execution"]["goal_tolerance_m"],
        time_limit_s=recorded.get("execution_time_limit_s") or scenario["execution"]["time_limit_s"] or 0.0,
        zones=occupancy(execution, run.graph, run.nav) if execution and execution.tasks and run.nav else None,
    )
    return evaluate(evidence, metrics)


def measure_batch(folder: Path, metrics: Sequence[Metric], report: Callable[[str], None]) -> tuple[int, int]:
    """Add metrics to the results of a batch that is not under way, from the traces of its runs; runs without a trace have none.

    Returns the number of runs for which any of the metrics has a value, and of all that have ended; `report` gets a line about each trace
    that cannot be read. Raises BatchError when it is no batch, under way, or no run has a trace.
    """
    planned = read_plan(folder)["keys"]
    keys = [key for key in planned if record_path(folder, key).is_file()]
    if is_under_way(folder):
        raise BatchError(f"{folder}: a batch is under way there")
    metrics_of: dict[str, Metrics] = {}
    fault = ""
    for key in keys:
        if trace_path(folder, key).is_file():
            try:
                with TemporaryDirectory(prefix="mrp_sumo_trace_") as place:
                    read_trace(folder, key, Path(place))
                    metrics_of[key] = plain(measure_run(load_run(place), metrics))
            except MrpSumoError as error:
                report(f"{error}; left out")
                fault = fault or str(error)
    if not metrics_of:
        if fault:
            raise BatchError(f"{folder}: no trace of a run can be read: {fault}")
        raise BatchError(f"{folder}: no run has a trace: no run came to a plan, or another version made the batch")
    drop_tables(folder)
    for key, values in metrics_of.items():
        record = read_record(record_path(folder, key))
        write_record(folder, {**record, "metrics": {**record["metrics"], **values}})
    if len(keys) == len(planned):  # tables are there only where they hold every run
        write_tables(folder, (read_record(record_path(folder, key)) for key in keys))
    return sum(any(value is not None for value in values.values()) for values in metrics_of.values()), len(keys)
