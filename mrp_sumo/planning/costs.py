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
GOALS_AT_ONCE = 8  # between checks of the clock


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
    """Costs of every robot for every goal. Raises ScenarioError for another kind.

    Parameters
    ----------
    graph
        Where they drive.
    start
        [R] vertices.
    goal
        [G] vertices.
    kind
        'euclidean' or 'manhattan' distance in m, or 'path': steps along the lanes.
    check_clock
        Called before every few goals; may raise to give up.

    Returns
    -------
    cost
        [R, G], inf where the goal cannot be reached.
    """
    if kind not in get_args(CostKind):
        raise ScenarioError(f"unknown cost '{kind}'{nearest(kind, get_args(CostKind))}")
    tables = distances(graph)
    steps = np.empty((len(start), len(goal)), np.int32)
    for k in range(0, len(goal), GOALS_AT_ONCE):
        check_clock()
        steps[:, k : k + GOALS_AT_ONCE] = tables.to_all(goal[k : k + GOALS_AT_ONCE])[:, start].T
    if kind == "path":
        cost = steps.astype(np.float64)
    else:
        apart = np.abs(graph.xy[start][:, None, :] - graph.xy[goal][None, :, :])  # [R, G, 2]
        cost = np.hypot(apart[..., 0], apart[..., 1]) if kind == "euclidean" else apart.sum(-1)
    return frozen(np.where(steps >= UNREACHABLE, np.inf, cost))
