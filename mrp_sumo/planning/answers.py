"""Answers that all planners share: goals out of reach, goals held twice and robots that cannot pass each other, before the
search; memory that runs out, during it.

Refuses nothing: what cannot be solved is an INFEASIBLE result that names robot and goal.
"""

from time import perf_counter

import numpy as np

from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.protocol import Planner
from mrp_sumo.search.distance import UNREACHABLE, distances
from mrp_sumo.search.solvable import order_broken


def impossible(problem: Problem) -> PlanResult | None:
    """INFEASIBLE for an assigned problem that needs no search to see that; None for others.

    Parameters
    ----------
    problem
        With an assignment, or robots that stay where they are.
    """
    if clash := goals_clash(problem):
        return clash
    label, name, target = problem.graph.label, problem.fleet.robot_name, problem.target
    steps = distances(problem.graph).to_all(target)[np.arange(len(target)), problem.start]
    if (steps >= UNREACHABLE).any():
        robot = int(np.flatnonzero(steps >= UNREACHABLE)[0])
        return PlanResult(
            Status.INFEASIBLE,
            message=f"{name[robot]} cannot reach its goal '{label(target[robot])}' from '{label(problem.start[robot])}'",
        )
    return order_clash(problem)


def order_clash(problem: Problem) -> PlanResult | None:
    """INFEASIBLE where two robots of an assigned problem would have to pass each other on a line or ring; None otherwise."""
    broken = order_broken(problem)
    if broken is None:
        return None
    a, b = (problem.fleet.robot_name[robot] for robot in broken)
    return PlanResult(Status.INFEASIBLE, message=f"{a} and {b} would have to pass each other where there is no room")


def goals_clash(problem: Problem) -> PlanResult | None:
    """INFEASIBLE where two robots have to end at one vertex, whoever is assigned what; None otherwise."""
    label, name = problem.graph.label, problem.fleet.robot_name
    if not problem.is_assigned:
        values, count = np.unique(problem.goal, return_counts=True)
        if len(values) >= min(problem.num_robots, len(problem.goal)):
            return None
        a, b = np.flatnonzero(problem.goal == values[count > 1][0])[:2]
        return PlanResult(Status.INFEASIBLE, message=f"goals {a} and {b} are both '{label(int(problem.goal[a]))}'")
    values, count = np.unique(problem.target, return_counts=True)
    if not (count > 1).any():
        return None
    vertex = int(values[count > 1][0])
    a, b = np.flatnonzero(problem.target == vertex)[:2]
    return PlanResult(Status.INFEASIBLE, message=f"{name[a]} and {name[b]} both have to end at '{label(vertex)}'")


def answer_of(chosen: Planner, problem: Problem, time_limit_s: float) -> PlanResult:
    """The result of a planner; GAVE_UP where it runs out of memory.

    Parameters
    ----------
    chosen, problem, time_limit_s
        As `Planner.plan` takes them.
    """
    began = perf_counter()
    try:
        return chosen.plan(problem, time_limit_s)
    except MemoryError:
        time_s = perf_counter() - began
        return PlanResult(Status.GAVE_UP, planning_time_s=time_s, message=f"no memory left after {time_s:.3g} s")


def require_limit(time_limit_s: float) -> None:
    """Refuse a time limit that is not above 0.

    Raises
    ------
    PlanError
        When it is not above 0, or NaN.
    """
    if not time_limit_s > 0:
        raise PlanError(f"the time limit is {time_limit_s} s, expected a number above 0")
