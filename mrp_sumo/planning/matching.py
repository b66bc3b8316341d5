"""The work of every assigner before and after its solver: check the costs, reduce a bottleneck to a sum, read pairs.

Refuses costs that are NaN or -inf, and matrices in which min(R, G) goals cannot be served at all.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray
from mrp_sumo.core.options import meaning
from mrp_sumo.errors import PlanError

Objective = Literal["sum", "bottleneck"]

LARGEST = 1 << 52  # of the sum of whole costs: exact in a float, far from the end of an int64


@dataclass(frozen=True)
class ExactAssigner(ABC):
    """An assigner whose solver takes pairs with whole costs."""

    objective: Objective = field(default="sum", metadata=meaning("`sum` of all robots' costs, or the worst robot's: `bottleneck`"))

    def assign(self, cost: FloatArray, time_limit_s: float) -> IntArray:
        """See `Assigner`."""
        robot, goal, whole = candidates(cost, self.objective)
        num_robots, num_goals = cost.shape
        goal_of = np.full(num_robots, -1, np.int64)
        if min(cost.shape):
            used = self.used(robot, goal, whole, (num_robots, num_goals), time_limit_s)
            if used is None:
                limit = f" within {time_limit_s:g} s" if np.isfinite(time_limit_s) else ""
                raise PlanError(f"no assignment of {num_robots} robots to {num_goals} goals was found{limit}")
            goal_of[robot[used]] = goal[used]
        return goal_of

    @abstractmethod
    def used(self, robot: IntArray, goal: IntArray, cost: IntArray, shape: tuple[int, int], time_limit_s: float) -> BoolArray | None:
        """[N] which pairs of a robot and a goal are in the cheapest assignment of as many as there can be; None: none is found."""


def candidates(cost: FloatArray, objective: Objective) -> tuple[IntArray, IntArray, IntArray]:
    """The pairs that a solver may choose from: robots, goals and integer costs [N], which keep six decimals, or as many as fit.

    `cost` is [R, G], inf where a robot cannot reach a goal. A bottleneck is the least threshold under which all can be served; among the
    assignments within it the one of least sum is wanted, so the solver minimises a sum either way. Raises PlanError for NaN and -inf, and
    when min(R, G) goals cannot be served.
    """
    cost = np.asarray(cost, np.float64)
    if np.isnan(cost).any() or np.isneginf(cost).any():
        robot, goal = np.argwhere(np.isnan(cost) | np.isneginf(cost))[0]
        raise PlanError(f"the cost of robot {robot} for goal {goal} is {cost[robot, goal]}, expected a number or inf")
    finite = np.isfinite(cost)
    wanted = min(cost.shape)
    if wanted and _served(finite) < wanted:
        lonely = np.flatnonzero(~finite.any(1))
        reason = (
            f"robot {lonely[0]} can reach none of them" if len(lonely) and len(cost) <= cost.shape[1] else "too many compete for too few"
        )
        raise PlanError(f"no assignment of {cost.shape[0]} robots serves {wanted} of {cost.shape[1]} goals: {reason}")
    if objective == "bottleneck" and wanted:
        values = np.unique(cost[finite])
        low, high = 0, len(values) - 1
        while low < high:
            middle = (low + high) // 2
            low, high = (low, middle) if _served(cost <= values[middle]) == wanted else (middle + 1, high)
        finite = cost <= values[low]
    robot, goal = np.nonzero(finite)
    chosen = cost[finite]
    total = float(np.abs(chosen).max(initial=0)) * max(wanted, 1) ** 2
    scale = 1.0 if (chosen == np.rint(chosen)).all() else min(1e6, LARGEST / max(total, 1.0))
    return robot.astype(np.int64), goal.astype(np.int64), np.rint(chosen * scale).astype(np.int64)


def _served(allowed: np.ndarray) -> int:
    """How many goals can be served at all."""
    if allowed.all():
        return int(min(allowed.shape))
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import maximum_bipartite_matching

    return int((maximum_bipartite_matching(csr_array(allowed), perm_type="column") >= 0).sum())
