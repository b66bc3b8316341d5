"""Assignment by OR-Tools' linear sum assignment (cost scaling push-relabel). Optimal.

Source: Goldberg, Kennedy, "An efficient cost scaling algorithm for the assignment problem", Mathematical
Programming 71, 1995. Rectangular matrices are filled up to a square with partners that cost nothing.
"""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.matching import Objective, candidates


@dataclass(frozen=True)
class LinearSumAssignment:
    """The fastest of the assigners; polynomial time."""

    objective: Objective = "sum"

    def assign(self, cost: FloatArray, time_limit_s: float) -> IntArray:
        """See `Assigner`. The time limit is not needed: a matrix of 1000 x 1000 takes a fraction of a second."""
        from ortools.graph.python.linear_sum_assignment import SimpleLinearSumAssignment

        robot, goal, whole = candidates(cost, self.objective)
        num_robots, num_goals = cost.shape
        size = max(num_robots, num_goals)
        if not min(num_robots, num_goals):
            return np.full(num_robots, -1, np.int64)
        spare_robot, spare_goal = np.arange(num_robots, size), np.arange(num_goals, size)
        left = np.concatenate([robot, np.repeat(spare_robot, size), np.repeat(np.arange(num_robots), len(spare_goal))])
        right = np.concatenate([goal, np.tile(np.arange(size), len(spare_robot)), np.tile(spare_goal, num_robots)])
        solver = SimpleLinearSumAssignment()
        solver.add_arcs_with_cost(left, right, np.concatenate([whole, np.zeros(len(left) - len(whole), np.int64)]))
        if solver.solve() != solver.OPTIMAL:
            raise PlanError(f"linear_sum_assignment found no assignment of {num_robots} robots to {num_goals} goals")
        chosen = np.array([solver.right_mate(i) for i in range(num_robots)], np.int64)
        return np.where(chosen < num_goals, chosen, -1)
