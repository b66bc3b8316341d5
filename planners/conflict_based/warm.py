"""Puts questions to the constraint tree that are small enough to cost nothing and call every kernel, so that all are compiled or loaded."""

import math

import numpy as np

from mrp_sumo.planning.protocol import Planner
from mrp_sumo.search.solvable import unsolvable
from planners.conflict_based._cover import cover
from planners.conflict_based.tree import Tree, limits
from planners.world import small_problem


def warm(planner: Planner) -> None:
    """Plan a swap beside a siding, and take every step of a tree on it."""
    problem = small_problem()
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
