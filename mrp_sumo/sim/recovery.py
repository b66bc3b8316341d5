"""Gets a fleet out of a deadlock: everybody stops at the next vertex, a planner plans anew from there, all go on.

Any registered planner will do. A robot that is broken for good keeps its place in the new problem, and one
whose goal it stands on stays where it is. Gives up, saying why, when a robot stands between two vertices, when there
is no plan, or when the plan's order cannot be kept.
"""

from dataclasses import replace

import numpy as np

from mrp_sumo.core.graph import BoolArray, IntArray, frozen
from mrp_sumo.core.plan import Plan, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import MrpSumoError, PlanError

PLANNING_LIMIT_S = 10.0  # of wall time


def plan_from(problem: Problem, standing: IntArray, broken: BoolArray, planner: str) -> tuple[Problem, Plan]:
    """A new problem for robots on these vertices [R], with the old goals, and a plan for it.

    Raises
    ------
    PlanError
        When there is none.
    """
    from mrp_sumo.planning.registry import planner as make

    goal = np.where(broken, standing, problem.target)
    # two with one goal: the broken robot keeps it, the other stays, and so on for those that wanted the other's place
    while True:
        values, count = np.unique(goal, return_counts=True)
        contested = np.isin(goal, values[count > 1]) & (goal != standing)
        if not contested.any():
            break
        goal[contested] = standing[contested]
    anew = replace(problem, start=frozen(standing), goal=frozen(goal), goal_of=frozen(np.arange(problem.num_robots)))
    try:
        method = make(planner, {})
        method.prepare()
        result = method.plan(anew, PLANNING_LIMIT_S)
    except MrpSumoError as error:
        raise PlanError(f"{planner}: {error}") from error
    if result.plan is None or result.status not in (Status.SOLVED, Status.TIMED_OUT):
        raise PlanError(f"{planner} found no plan{': ' + result.message if result.message else ''}")
    return anew, result.plan
