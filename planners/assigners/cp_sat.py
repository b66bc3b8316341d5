"""Assignment as a constraint program, solved by OR-Tools' CP-SAT. Optimal.

One Boolean a pair; each robot, or each goal where they are fewer, in exactly one. One worker and a fixed seed: the same answer every time.
"""

from dataclasses import dataclass

import numpy as np
from ortools.sat.python import cp_model

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.matching import Objective, candidates


@dataclass(frozen=True)
class CpSat:
    """The general solver of the paper; slower than the special ones."""

    objective: Objective = "sum"

    def assign(self, cost: FloatArray, time_limit_s: float) -> IntArray:
        """See `Assigner`; a good assignment that is not proven best is used at the time limit."""
        robot, goal, whole = candidates(cost, self.objective)
        num_robots, num_goals = cost.shape
        goal_of = np.full(num_robots, -1, np.int64)
        if not min(num_robots, num_goals):
            return goal_of
        model = cp_model.CpModel()
        pair = [model.new_bool_var("") for _ in robot]
        for index, count, all_of in ((robot, num_robots, num_robots <= num_goals), (goal, num_goals, num_goals <= num_robots)):
            groups: list[list[cp_model.IntVar]] = [[] for _ in range(count)]
            for k, variable in zip(index.tolist(), pair):
                groups[k].append(variable)
            for group in groups:
                (model.add_exactly_one if all_of else model.add_at_most_one)(group)
        model.minimize(cp_model.LinearExpr.weighted_sum(pair, whole.tolist()))
        solver = cp_model.CpSolver()
        solver.parameters.max_time_in_seconds = time_limit_s
        solver.parameters.num_workers = 1
        solver.parameters.random_seed = 0
        if solver.solve(model) not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
            raise PlanError(f"cp_sat found no assignment of {num_robots} robots to {num_goals} goals within {time_limit_s:g} s")
        used = np.array([bool(solver.value(variable)) for variable in pair])
        goal_of[robot[used]] = goal[used]
        return goal_of
