"""Assignment as a min-cost flow by OR-Tools: source -> robots -> goals -> sink, one unit each. Optimal.

Source: Goldberg, "An efficient implementation of a scaling minimum-cost flow algorithm", J. Algorithms 22, 1997.
"""

from dataclasses import dataclass

import numpy as np
from ortools.graph.python.min_cost_flow import SimpleMinCostFlow

from mrp_sumo.core.graph import BoolArray, IntArray
from mrp_sumo.planning.matching import ExactAssigner


@dataclass(frozen=True)
class MinCostFlowAssigner(ExactAssigner):
    """Polynomial time, and rectangular matrices as they are."""

    def used(self, robot: IntArray, goal: IntArray, cost: IntArray, shape: tuple[int, int], time_limit_s: float) -> BoolArray | None:
        """See `ExactAssigner`. The time limit is not needed: a matrix of 1000 x 1000 takes seconds at most."""
        (num_robots, num_goals), wanted = shape, min(shape)
        source, sink = num_robots + num_goals, num_robots + num_goals + 1
        robots, goals = np.arange(num_robots), np.arange(num_goals)
        tail = np.concatenate([robot, np.full(num_robots, source), num_robots + goals])
        head = np.concatenate([num_robots + goal, robots, np.full(num_goals, sink)])
        price = np.concatenate([cost, np.zeros(num_robots + num_goals, np.int64)])
        solver = SimpleMinCostFlow()
        arcs = solver.add_arcs_with_capacity_and_unit_cost(tail, head, np.ones(len(tail), np.int64), price)
        solver.set_nodes_supplies(np.array([source, sink]), np.array([wanted, -wanted]))
        if solver.solve() != solver.OPTIMAL:
            return None
        return np.array(solver.flows(arcs))[: len(robot)] > 0
