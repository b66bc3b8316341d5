"""Who has reached its goal: those that arrived at it, and those that stand within the scenario's tolerance of it when the run ends.

The execution itself drives robots to their goals and stops nobody short of one, however wide the tolerance.
"""

from dataclasses import replace

import numpy as np

from mrp_sumo.core.execution import Event, Execution
from mrp_sumo.core.graph import frozen
from mrp_sumo.core.problem import Problem

AT_REST_MPS = 1e-6


def with_goals_within(execution: Execution, problem: Problem, tolerance_m: float) -> Execution:
    """The execution in which robots at rest within the tolerance of their goals at the end have reached them, since they stand there.

    Parameters
    ----------
    execution
        Of R robots.
    problem
        With their goals.
    tolerance_m
        `execution.goal_tolerance_m` of the scenario.
    """
    if execution.all_at_goal or not len(execution.t_s):
        return execution
    goal_m = problem.graph.xy[problem.target]
    away_m = np.hypot(execution.x_m - goal_m[:, 0], execution.y_m - goal_m[:, 1])
    there = (away_m < tolerance_m) & (np.abs(execution.speed_mps) <= AT_REST_MPS)  # [T, R]
    goal_s, events = execution.goal_s.copy(), list(execution.events)
    for robot in np.flatnonzero(np.isnan(goal_s) & there[-1]).tolist():
        elsewhere = np.flatnonzero(~there[:, robot])
        goal_s[robot] = execution.t_s[elsewhere[-1] + 1 if len(elsewhere) else 0]
        events.append(Event(float(goal_s[robot]), "goal", robot, int(problem.target[robot]), text="within the tolerance of its goal"))
    events.sort(key=lambda event: (event.t_s, event.robot, event.kind))
    return replace(execution, goal_s=frozen(goal_s), events=tuple(events))
