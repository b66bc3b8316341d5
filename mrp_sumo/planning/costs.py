"""The cost of each robot for each goal: the matrix that assigners minimise over.

A goal that a robot cannot reach costs inf, whatever the kind of cost.
"""

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph, frozen
from mrp_sumo.errors import ScenarioError, nearest
from mrp_sumo.search.distance import UNREACHABLE, distances

CostKind = Literal["euclidean", "manhattan", "path"]
GOALS_AT_ONCE = 8  # between checks of the clock


def cost_matrix(graph: NavGraph, start: IntArray, goal: IntArray, kind: str, check_clock: Callable[[], None] = lambda: None) -> FloatArray:
    """Costs of every robot for every goal.

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

    Raises
    ------
    ScenarioError
        For another kind.
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
