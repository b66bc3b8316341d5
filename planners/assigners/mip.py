"""Assignment as a mixed-integer program, through OR-Tools: by SCIP, or by CP-SAT as a constraint program. Optimal.

One binary variable a pair, each robot and goal at most once, as many pairs as there can be. CP-SAT has one worker and a fixed seed, and
the same answer every time.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from ortools.linear_solver import pywraplp

from mrp_sumo.core.graph import BoolArray, IntArray
from mrp_sumo.planning.matching import ExactAssigner


@dataclass(frozen=True)
class Mip(ExactAssigner):
    """The general solver of the paper; slower than the special ones."""

    solver: ClassVar[tuple[str, str]] = "SCIP", ""  # with its parameters

    def used(self, robot: IntArray, goal: IntArray, cost: IntArray, shape: tuple[int, int], time_limit_s: float) -> BoolArray | None:
        """See `ExactAssigner`; a good assignment that is not proven best is used at the time limit."""
        name, parameters = self.solver
        solver = pywraplp.Solver.CreateSolver(name)
        solver.SetTimeLimit(max(1, int(1000 * time_limit_s)))
        solver.SetSolverSpecificParametersAsString(parameters)
        pair = [solver.BoolVar("") for _ in robot]
        for index, count in zip((robot, goal), shape):
            rows = [solver.RowConstraint(1.0 if count == min(shape) else 0.0, 1.0, "") for _ in range(count)]
            for k, variable in zip(index.tolist(), pair):
                rows[k].SetCoefficient(variable, 1.0)
        objective = solver.Objective()
        for variable, price in zip(pair, cost.tolist()):
            objective.SetCoefficient(variable, price)
        objective.SetMinimization()
        if solver.Solve() not in (pywraplp.Solver.OPTIMAL, pywraplp.Solver.FEASIBLE):
            return None
        return np.array([variable.solution_value() > 0.5 for variable in pair])


@dataclass(frozen=True)
class CpSat(Mip):
    """The general solver of the paper; slower than the special ones."""

    solver: ClassVar[tuple[str, str]] = "SAT", "num_workers: 1, random_seed: 0"
