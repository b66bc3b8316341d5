"""A way out for a crowd that stands still: a plan of all robots' cells by LaCAM, which is complete, carried out cell by cell.

Robots that turn take several steps for one of the plan: first all turn to where they go next, then all move at once.
"""

import math

import numpy as np

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import IntArray, nav_graph, plan_graph
from mrp_sumo.core.plan import paths_of_plan, side_by_side
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.core.step_wise import FORWARD, LEFT, NOTHING, RIGHT, WAIT, ActionArray
from mrp_sumo.planning.registry import planner
from planners.step_wise.ground import FAR, FreeCells

LEAST_LABELS, LABELS = 200_000, 1000  # of the search: in all, and for each robot more
TURNS = np.array([WAIT, RIGHT, RIGHT, LEFT], np.int8)  # by how many quarters to the right a heading is away


class WayOut:
    """Robots on a plan."""

    def __init__(self, ground: FreeCells, path: IntArray) -> None:
        """`path` [T, R] are cells."""
        self._ground, self._path = ground, path

    def action(self, state: IntArray) -> ActionArray | None:
        """[R] what robots do next; None where they are at the end."""
        cell, heading = np.divmod(state, 4)
        while len(self._path) and (self._path[0] == cell).all():
            self._path = self._path[1:]
        if not len(self._path):
            return None
        goes = self._path[0] != cell
        ahead = self._ground.ahead.reshape(-1, 4)[cell]
        quarters = np.where(goes, (np.argmax(ahead == self._path[0][:, None], 1) - heading) % 4, 0)
        return np.where(goes, FORWARD, WAIT).astype(np.int8) if not quarters.any() else TURNS[quarters]


def way_out(ground: FreeCells, state: IntArray, goal: IntArray, order: IntArray, seed: int) -> WayOut | None:
    """The way of robots in these states to their goals [R], cells or NOTHING; None where none is found.

    Of those that have one goal the first in the order goes there. The others, and who cannot come to its own, go to the nearest free cell.
    """
    slots = {cell: ground.slot(cell) for cell in goal[goal != NOTHING].tolist()}
    ends, num_cells = np.full(len(state), NOTHING), ground.num_cells
    taken = np.zeros(num_cells, np.bool_)
    for r in order.tolist():
        cell = int(goal[r])
        if cell != NOTHING and not taken[cell] and slots[cell] >= 0 and ground.table[slots[cell], state[r]] < FAR:
            ends[r], taken[cell] = cell, True
    for r in order[ends[order] == NOTHING].tolist():
        away = np.where(taken, FAR, ground.apart(np.full(num_cells, state[r] >> 2), np.arange(num_cells)))
        ends[r] = int(away.argmin())
        taken[ends[r]] = True
    lanes = np.stack([np.arange(4 * num_cells) >> 2, ground.ahead], 1)[ground.ahead >= 0]
    graph = plan_graph(nav_graph(name="free cells", xy=ground.xy, lanes=lanes.tolist()), kind="roadmap", cell_m=1.0)
    robots, num_robots = fleet_of(RobotType("any", 0.1, 0.1, 1.0, 1.0, 1.0, 1.0), len(state)), len(state)
    problem = Problem(graph, robots, state >> 2, ends, np.arange(num_robots), 1.0, seed, effort=LEAST_LABELS + LABELS * num_robots)
    lacam = planner("lacam", {"polish": 0})
    lacam.prepare()
    plan = lacam.plan(problem, math.inf).plan
    return None if plan is None else WayOut(ground, side_by_side(paths_of_plan(plan, 1.0)))
