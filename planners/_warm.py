"""Calls a planner on a question small enough to cost nothing, so that its kernels are compiled or loaded."""

from functools import cache

import numpy as np

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.graph import PlanGraph, frozen, nav_graph
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.protocol import Planner


def warm(planner: Planner) -> None:
    """Plan crossings in an open square, that end in conflicts of every sort."""
    for problem in _questions():
        planner.plan(problem, 600.0)


@cache
def _questions() -> tuple[Problem, ...]:
    side = 4
    cells = [(x, y) for y in range(side) for x in range(side)]
    number = {cell: k for k, cell in enumerate(cells)}
    lanes = [
        (number[x, y], number[x + a, y + b]) for x, y in cells for a, b in ((1, 0), (0, 1), (-1, 0), (0, -1)) if (x + a, y + b) in number
    ]
    nav = nav_graph(name="square", xy=np.array(cells, float), lanes=lanes)
    graph = PlanGraph(**{**nav.__dict__, "kind": "grid", "cell_m": 1.0, "vertex_of_station": frozen(np.arange(side * side))})
    fleet = fleet_of(RobotType("dot", 0.1, 0.1, 1.0, 1.0, 1.0, 1.0), 3)
    start = np.array([number[0, 1], number[1, 0], number[3, 3]])
    goal = np.array([number[3, 2], number[2, 3], number[0, 0]])
    return (Problem(graph=graph, fleet=fleet, start=start, goal=goal, goal_of=np.arange(3), step_s=1.0),)
