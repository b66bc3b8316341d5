"""Checks what a planner or assigner from outside answers, before anything is done with it.

Only the form is looked at: types, lengths, ranges. Whether a plan is good is for the referee to say.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, frozen
from mrp_sumo.core.plan import Plan, PlanResult, Status
from mrp_sumo.core.problem import Problem


class WrongAnswer(Exception):
    """Fault of an answer, as the end of a sentence: 'returned None, expected a PlanResult'."""


def checked_result(answer: Any, problem: Problem, time_s: float, cpu_s: float, *, assigns: bool) -> PlanResult:
    """A planner's answer, its arrays as the types that they have to be, with the times that were measured.

    Raises WrongAnswer for anything but a PlanResult of the right form.
    """
    if not isinstance(answer, PlanResult):
        raise WrongAnswer(f"returned {_kind(answer)}, expected a PlanResult")
    try:
        status = Status(answer.status)
    except ValueError:
        raise WrongAnswer(
            f"returned the status {answer.status!r}, expected one of {', '.join(f'Status.{s.name}' for s in Status)}"
        ) from None
    if status is Status.SOLVED and answer.plan is None:
        raise WrongAnswer("returned the status 'solved' without a plan")
    plan = None if answer.plan is None else _plan(answer.plan, problem)
    bound = answer.lower_bound_steps
    if not _is_number(bound) or math.isnan(bound):
        raise WrongAnswer(f"returned the lower bound {bound!r}, expected a number of steps")
    stats = answer.stats
    if not isinstance(stats, Mapping) or not all(isinstance(key, str) and _is_number(value) for key, value in stats.items()):
        raise WrongAnswer(f"returned the stats {stats!r:.80}, expected numbers by name")
    return PlanResult(
        status,
        plan,
        _goal_of(answer.goal_of, problem, assigns=assigns) if plan is not None else None,
        planning_time_s=time_s,
        planning_cpu_s=cpu_s,
        lower_bound_steps=float(bound),
        stats={str(key): float(value) for key, value in stats.items()},
        message=" ".join(str(answer.message).split()),
    )


def checked_assignment(answer: Any, cost: FloatArray) -> IntArray:
    """An assigner's answer for [R, G] costs: [R] goals.

    Raises WrongAnswer for another length, goals that are not there or held twice, pairs of infinite cost, and goals or robots left out.
    """
    num_robots, num_goals = cost.shape
    goal_of = _integers("an assignment", answer, num_robots, "robots")
    _require_goals(goal_of, num_goals)
    assigned = np.flatnonzero(goal_of >= 0)
    if len(assigned) < min(num_robots, num_goals):
        raise WrongAnswer(f"returned goals for {len(assigned)} robots, expected {min(num_robots, num_goals)}")
    unreachable = assigned[np.isinf(cost[assigned, goal_of[assigned]])]
    if len(unreachable):
        raise WrongAnswer(f"returned goal {goal_of[unreachable[0]]} for robot {unreachable[0]}, which cannot reach it")
    return goal_of


def _plan(plan: Any, problem: Problem) -> Plan:
    if not isinstance(plan, Plan):
        raise WrongAnswer(f"returned {_kind(plan)} as plan, expected a Plan (see plan_of_paths)")
    first = _integers("plan.first", plan.first, problem.num_robots + 1, "robots and one")
    vertex = _integers("plan.vertex", plan.vertex)
    if first[0] != 0 or first[-1] != len(vertex) or (np.diff(first) < 0).any():
        raise WrongAnswer(f"returned a plan.first from {first[0]} to {first[-1]}, expected to rise from 0 to the {len(vertex)} visits")
    empty = np.flatnonzero(np.diff(first) == 0)
    if len(empty):
        raise WrongAnswer(f"returned a plan without a visit of {problem.fleet.robot_name[empty[0]]}")
    outside = np.flatnonzero((vertex < 0) | (vertex >= problem.graph.num_vertices))
    if len(outside):
        robot = problem.fleet.robot_name[int(np.searchsorted(first, outside[0], "right")) - 1]
        raise WrongAnswer(f"returned vertex {vertex[outside[0]]} for {robot}, but there are {problem.graph.num_vertices} vertices")
    arrive_s = _numbers("plan.arrive_s", plan.arrive_s, len(vertex))
    depart_s = _numbers("plan.depart_s", plan.depart_s, len(vertex))
    if not np.isfinite(arrive_s).all() or np.isnan(depart_s).any():
        raise WrongAnswer("returned times that are not finite")
    return Plan(first, vertex, arrive_s, depart_s)


def _goal_of(goal_of: Any, problem: Problem, *, assigns: bool) -> IntArray | None:
    if goal_of is None:
        if assigns and not problem.is_assigned:
            raise WrongAnswer("returned no goal_of, expected the assignment that the plan is for (it says that it assigns)")
        return None
    goals = _integers("goal_of", goal_of, problem.num_robots, "robots")
    _require_goals(goals, len(problem.goal))
    if not assigns and (goals != problem.goal_of).any():
        raise WrongAnswer("returned another goal_of than that of the problem, though it says that it does not assign")
    return goals


def _require_goals(goal_of: IntArray, num_goals: int) -> None:
    """Refuse goals that are not there, and goals held twice."""
    outside = goal_of[(goal_of < -1) | (goal_of >= num_goals)]
    if len(outside):
        raise WrongAnswer(f"returned goal {outside[0]}, but there are {num_goals} goals")
    values, count = np.unique(goal_of[goal_of >= 0], return_counts=True)
    if (count > 1).any():
        raise WrongAnswer(f"returned goal {values[count > 1][0]} for two robots")


def _integers(what: str, value: Any, length: int | None = None, of: str = "") -> IntArray:
    return frozen(_array(what, value, length, of, ("iu", "whole numbers")).astype(np.int64))


def _numbers(what: str, value: Any, length: int) -> FloatArray:
    return frozen(_array(what, value, length, "visits", ("iuf", "numbers")).astype(np.float64))


def _array(what: str, value: Any, length: int | None, of: str, kinds: tuple[str, str]) -> np.ndarray:
    """An array of one dimension, of some kinds of elements, and of a length if there is one."""
    try:
        array = np.asarray(value)
    except ValueError:  # lists of different lengths
        raise WrongAnswer(f"returned {_kind(value)} as {what}, expected an array") from None
    if array.ndim != 1:
        raise WrongAnswer(f"returned {_kind(value)} as {what}, expected an array of one dimension")
    if array.dtype.kind not in kinds[0] and array.size:
        raise WrongAnswer(f"returned {what} of {array.dtype}, expected {kinds[1]}")
    if length is not None and len(array) != length:
        raise WrongAnswer(f"returned {what} of length {len(array)}, expected {length}, the number of {of}")
    return array


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def _kind(value: Any) -> str:
    if value is None:
        return "None"
    kind = type(value).__name__
    return f"a{'n' if kind[:1] in 'aeiouAEIOU' else ''} {kind}"
