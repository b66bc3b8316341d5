"""The cost of each robot for each goal: the matrix that assigners minimise over.

A goal that a robot cannot reach costs inf, whatever the kind of cost.
"""

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph, frozen
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import ScenarioError, nearest
from mrp_sumo.search.distance import UNREACHABLE, distances

CostKind = Literal["euclidean", "manhattan", "path"]


def costs_of(problem: Problem, kind: str, check_clock: Callable[[], None] = lambda: None) -> FloatArray:
    """[R, G] as `cost_matrix`, each robot on the lanes of its type; inf for goals that are for robots of another type."""
    robot_kind = problem.fleet.kind
    if problem.barred is None:
        cost = cost_matrix(problem.graph, problem.start, problem.goal, kind, check_clock)
    else:
        cost = np.empty((problem.num_robots, len(problem.goal)))
        for k in np.unique(robot_kind).tolist():
            mine = np.flatnonzero(robot_kind == k)
            cost[mine] = cost_matrix(problem.graph_of_kind[k], problem.start[mine], problem.goal, kind, check_clock)
    if problem.goal_kind is not None:
        cost = np.where(robot_kind[:, None] == problem.goal_kind, cost, np.inf)
    return frozen(cost)


def cost_matrix(graph: NavGraph, start: IntArray, goal: IntArray, kind: str, check_clock: Callable[[], None] = lambda: None) -> FloatArray:
    """[R, G] costs of robots at start vertices [R] for goal vertices [G], inf where the goal cannot be reached.

    The kind is 'euclidean' or 'manhattan' distance in m, or 'path', steps along the lanes; raises ScenarioError for another. `check_clock`
    is called before every few goals; it may raise to give up.
    """
    if kind not in get_args(CostKind):
        raise ScenarioError(f"unknown cost '{kind}'{nearest(kind, get_args(CostKind))}")
    steps = distances(graph).to_all(goal, check_clock)[:, start].T
    if kind == "path":
        cost = steps.astype(np.float64)
    else:
        apart = np.abs(graph.xy[start][:, None, :] - graph.xy[goal][None, :, :])  # [R, G, 2]
        cost = np.hypot(apart[..., 0], apart[..., 1]) if kind == "euclidean" else apart.sum(-1)
    return frozen(np.where(steps >= UNREACHABLE, np.inf, cost))
