"""Puts questions to the constraint tree that are small enough to cost nothing and call every kernel, so that all are compiled or loaded."""

import math

import numpy as np

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.protocol import Planner
from mrp_sumo.search.solvable import unsolvable
from planners.conflict_based._cover import cover
from planners.conflict_based.tree import Tree, limits


def warm(planner: Planner) -> None:
    """Plan a swap on a line with a bay, and take every step of a tree on it."""
    problem = _swap_at_a_bay()
    planner.plan(problem, math.inf)
    tree = Tree(problem, limits(math.inf, 1000))
    root = tree.root()
    assert root is not None
    tree.heuristic(root)
    chosen = tree.choose(root)
    children = tree.split(root, chosen)
    tree.split(root, chosen, disjoint=True)
    tree.adopt(root, children[0])
    cover(3, np.array([0, 2, 4]), np.array([0, 1, 1, 2]), np.array([1, 1]))
    unsolvable(problem, tree.instance.clashes)


def _swap_at_a_bay() -> Problem:
    edges = [(0, 1), (1, 2), (2, 3), (3, 4), (2, 5)]
    xy = np.array([(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (2, 1)], np.float64)
    nav = nav_graph(name="bay", xy=xy, lanes=[*edges, *((b, a) for a, b in edges)])
    graph = plan_graph(nav, kind="grid", cell_m=1.0)
    fleet = fleet_of(RobotType("dot", 0.1, 0.1, 1.0, 1.0, 1.0, 1.0), 2)
    return Problem(graph=graph, fleet=fleet, start=np.array([0, 4]), goal=np.array([4, 0]), goal_of=np.arange(2), step_s=1.0)
