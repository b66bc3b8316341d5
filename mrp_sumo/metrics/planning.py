"""Metrics of the plan: is it valid, what does it cost, how long did it take."""

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.plan import as_planned_in_steps
from mrp_sumo.metrics.metric import LESS, MORE, YES_NO, Evidence, Function, Metric, count_of, of
from mrp_sumo.traffic.referee import Verdict


def _planning_time_s(run: Evidence) -> float:
    calls = run.execution.calls if run.execution else None
    return run.result.planning_time_s + (calls.wall_time_s if calls else 0.0)


def _planning_cpu_s(run: Evidence) -> float | None:
    first_s, calls = run.result.planning_cpu_s, run.execution.calls if run.execution else None
    return first_s if calls is None or calls.cpu_time_s is None else (first_s or 0.0) + calls.cpu_time_s


def _end_s(run: Evidence) -> FloatArray | None:
    """[R] planned times at which robots are at their goals to stay."""
    return run.plan.end_s if run.plan is not None and run.plan.num_robots else None


def steps_to_goal(run: Evidence) -> FloatArray | None:
    """[R] planned steps until each robot is at its goal to stay; None without a plan in steps."""
    if run.plan is None or not run.plan.num_robots:
        return None
    in_steps = as_planned_in_steps(run.plan, run.problem.step_s)
    return None if in_steps is None else in_steps.end_s / run.problem.step_s


def _verdict(run: Evidence) -> Verdict | None:
    return None if run.plan is None else run.verdict


def _conflicts(kind: str) -> Function:
    return of(_verdict, lambda verdict: verdict.count(kind))


# fmt: off
METRICS = (
    Metric("plan_valid", YES_NO, MORE, "the referee finds no fault, vertex conflict or edge conflict in the plan",
           of(_verdict, lambda verdict: verdict.valid)),
    Metric("num_vertex_conflicts", "", LESS, "two robots at one vertex at one time, counted by the referee",
           _conflicts("vertex"), one_goal=True),
    Metric("num_edge_conflicts", "", LESS, "two robots that change places, counted by the referee", _conflicts("edge"),
           one_goal=True),
    Metric("num_following_conflicts", "", LESS,
           "a robot enters a vertex in the step in which another leaves it, counted by the referee; no fault of a plan",
           _conflicts("following"), one_goal=True),
    Metric("planning_time_s", "s", LESS, "wall time of the solver, compiled code loaded; in runs with orders of all its answers",
           _planning_time_s, of_machine=True),
    Metric("planning_cpu_s", "s", LESS,
           "CPU time of all threads and programs of the solver, in runs with orders for all its answers; null where it was killed, "
           "and with orders for a planner from outside", _planning_cpu_s, of_machine=True),
    Metric("prepare_time_s", "s", LESS, "loading or compiling that code", lambda run: run.result.prepare_time_s, of_machine=True),
    Metric("assignment_time_s", "s", LESS, "cost matrix and assignment", lambda run: run.assignment_time_s, of_machine=True, one_goal=True),
    Metric("soc_steps", "steps", LESS,
           "sum of costs: the sum over robots of the step at which each is at its goal to stay; `cost_steps - n`",
           of(steps_to_goal, lambda steps: count_of(steps.sum())), one_goal=True),
    Metric("lower_bound_steps", "steps", MORE, "what the planner proved about `soc_steps` of any plan; 0 where it proves nothing",
           lambda run: count_of(run.result.lower_bound_steps), one_goal=True),
    Metric("makespan_s", "s", LESS, "planned time of the last arrival", of(_end_s, lambda end_s: float(end_s.max())), one_goal=True),
    Metric("flowtime_s", "s", LESS, "sum over robots of the planned time at which each is at its goal to stay",
           of(_end_s, lambda end_s: float(end_s.sum())), one_goal=True),
    Metric("retime_time_s", "s", LESS, "wall time of working out the plan's times with real motion; null where that was not asked for",
           lambda run: run.result.retime_time_s, of_machine=True),
)
