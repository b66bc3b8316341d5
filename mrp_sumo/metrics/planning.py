"""Metrics of the plan: is it valid, what does it cost, how long did it take."""

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.plan import as_planned_in_steps
from mrp_sumo.metrics.metric import YES_NO, Evidence, count_of, metric


@metric(YES_NO, "more", "the referee finds no fault, vertex conflict or edge conflict in the plan")
def plan_valid(run: Evidence) -> bool | None:
    return run.verdict.valid if run.verdict is not None and run.plan is not None else None


@metric("", "less", "vertex conflicts that the referee finds: two robots at one vertex at one time", one_goal=True)
def num_vertex_conflicts(run: Evidence) -> int | None:
    return _conflicts(run, "vertex")


@metric("", "less", "edge conflicts that the referee finds: two robots change places", one_goal=True)
def num_edge_conflicts(run: Evidence) -> int | None:
    return _conflicts(run, "edge")


@metric(
    "",
    "less",
    "following conflicts that the referee finds: a robot enters a vertex in the step in which another leaves it; no fault of a plan",
    one_goal=True,
)
def num_following_conflicts(run: Evidence) -> int | None:
    return _conflicts(run, "following")


@metric("s", "less", "wall time of the solver, compiled code loaded; in runs with tasks of all its answers", of_machine=True)
def planning_time_s(run: Evidence) -> float:
    calls = run.execution.calls if run.execution else None
    return run.result.planning_time_s + (calls.wall_time_s if calls else 0.0)


@metric(
    "s",
    "less",
    "CPU time of all threads and programs of the solver, in runs with tasks for all its answers; null where it was killed, and with "
    "tasks for a planner from outside",
    of_machine=True,
)
def planning_cpu_s(run: Evidence) -> float | None:
    first_s, calls = run.result.planning_cpu_s, run.execution.calls if run.execution else None
    return first_s if calls is None or calls.cpu_time_s is None else (first_s or 0.0) + calls.cpu_time_s


@metric("s", "less", "loading or compiling that code", of_machine=True)
def prepare_time_s(run: Evidence) -> float:
    return run.result.prepare_time_s


@metric("s", "less", "cost matrix and assignment", of_machine=True, one_goal=True)
def assignment_time_s(run: Evidence) -> float | None:
    return run.assignment_time_s


@metric(
    "steps",
    "less",
    "standard sum of costs: the sum over robots of the step at which each is at its goal to stay; `cost_steps - n`",
    one_goal=True,
)
def soc_steps(run: Evidence) -> float | None:
    steps = run.once(steps_to_goal)
    return None if steps is None else count_of(steps.sum())


@metric("steps", "more", "what the planner proved about `soc_steps` of any plan; 0 where it proves nothing", one_goal=True)
def lower_bound_steps(run: Evidence) -> float | None:
    return count_of(run.result.lower_bound_steps)


@metric("s", "less", "planned time of the last arrival", one_goal=True)
def makespan_s(run: Evidence) -> float | None:
    return float(run.plan.end_s.max()) if run.plan is not None and run.plan.num_robots else None


@metric("s", "less", "sum over robots of the planned time at which each is at its goal to stay", one_goal=True)
def flowtime_s(run: Evidence) -> float | None:
    return float(run.plan.end_s.sum()) if run.plan is not None and run.plan.num_robots else None


@metric("s", "less", "wall time of working out the plan's times with real motion; null where that was not asked for", of_machine=True)
def retime_time_s(run: Evidence) -> float | None:
    return run.result.retime_time_s


def steps_to_goal(run: Evidence) -> FloatArray | None:
    """[R] planned steps until each robot is at its goal to stay; None without a plan in steps."""
    if run.plan is None or not run.plan.num_robots:
        return None
    in_steps = as_planned_in_steps(run.plan, run.problem.step_s)
    return None if in_steps is None else in_steps.end_s / run.problem.step_s


def _conflicts(run: Evidence, kind: str) -> int | None:
    return run.verdict.count(kind) if run.verdict is not None and run.plan is not None else None
