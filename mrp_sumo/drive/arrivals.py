"""Robots at their goals: those that arrived there, and those that stand within the scenario's tolerance of it when the run ends.

The execution itself drives robots to their goals and stops nobody short of one, however wide the tolerance.
"""

from dataclasses import replace

import numpy as np

from mrp_sumo.core.execution import Event, Execution
from mrp_sumo.core.graph import FloatArray, IntArray, frozen
from mrp_sumo.drive._causes import ARRIVED_M

AT_REST_MPS = 1e-6


def with_goals_within(execution: Execution, xy_m: FloatArray, end: IntArray, tolerance_m: float) -> Execution:
    """The execution in which robots at rest within the tolerance of their goals at the end have reached them, since they stand there.

    `end` [R] are the vertices, at `xy_m` [V, 2], where their tasks end. `ARRIVED_M` is always near enough: a recovery may send a robot away
    that never leaves.
    """
    if execution.all_at_goal or not len(execution.t_s):
        return execution
    goal_m = xy_m[end]
    away_m = np.hypot(execution.x_m - goal_m[:, 0], execution.y_m - goal_m[:, 1])
    there = (away_m < max(tolerance_m, ARRIVED_M)) & (np.abs(execution.speed_mps) <= AT_REST_MPS)  # [T, R]
    goal_s, events = execution.goal_s.copy(), list(execution.events)
    for robot in np.flatnonzero(np.isnan(goal_s) & there[-1]).tolist():
        elsewhere = np.flatnonzero(~there[:, robot])
        goal_s[robot] = execution.t_s[elsewhere[-1] + 1 if len(elsewhere) else 0]
        events.append(Event(float(goal_s[robot]), "goal", robot, int(end[robot]), text="within the tolerance of its goal"))
    events.sort(key=lambda event: (event.t_s, event.robot, event.kind))
    return replace(execution, goal_s=frozen(goal_s), events=tuple(events))
