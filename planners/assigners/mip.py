"""Assignment as a mixed-integer program, solved by SCIP through OR-Tools. Optimal.

One binary variable a pair, each robot and goal at most once, as many pairs as there can be.
"""

from dataclasses import dataclass

import numpy as np
from ortools.linear_solver import pywraplp

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.matching import Objective, candidates


@dataclass(frozen=True)
class Mip:
    """The general solver of the paper; slower than the special ones."""

    objective: Objective = "sum"

    def assign(self, cost: FloatArray, time_limit_s: float) -> IntArray:
        """See `Assigner`; a good assignment that is not proven best is used at the time limit."""
        robot, goal, whole = candidates(cost, self.objective)
        num_robots, num_goals = cost.shape
        goal_of = np.full(num_robots, -1, np.int64)
        if not min(num_robots, num_goals):
            return goal_of
        solver = pywraplp.Solver.CreateSolver("SCIP")
        solver.SetTimeLimit(max(1, int(1000 * time_limit_s)))
        pair = [solver.BoolVar("") for _ in robot]
        for index, count, all_of in ((robot, num_robots, num_robots <= num_goals), (goal, num_goals, num_goals <= num_robots)):
            rows = [solver.RowConstraint(1.0 if all_of else 0.0, 1.0, "") for _ in range(count)]
            for k, variable in zip(index.tolist(), pair):
                rows[k].SetCoefficient(variable, 1.0)
        objective = solver.Objective()
        for variable, price in zip(pair, whole.tolist()):
            objective.SetCoefficient(variable, price)
        objective.SetMinimization()
        if solver.Solve() not in (pywraplp.Solver.OPTIMAL, pywraplp.Solver.FEASIBLE):
            raise PlanError(f"mip found no assignment of {num_robots} robots to {num_goals} goals within {time_limit_s:g} s")
        used = np.array([variable.solution_value() > 0.5 for variable in pair])
        goal_of[robot[used]] = goal[used]
        return goal_of
