"""Moves by the rules of the League of Robot Runners of 2026: an action takes several ticks, and robots are squares.

In a tick a robot makes progress with its action, or none: W, by its own choice, for a delay, or because progress would not be safe. An
action that is begun is finished before the next. What a robot's square sweeps in a tick, from where it was to where it is, overlaps with
what nobody else's does; to touch is allowed, so that one robot follows another a tick behind. A robot is at a cell while it stands or
turns there.
"""

from collections.abc import Iterator

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.step_wise import COLUMN_AHEAD, EAST, FORWARD, LEFT, RIGHT, ROW_AHEAD, WAIT, StepWiseProblem, StepWiseSolution, cell_ahead

MOST_AT_A_CELL = 5  # robots that can be at a cell or on their ways from and to it
TOUCH = 1e-9  # cells


class PlanFault(Exception):
    """The first fault of a solution."""


def in_ticks(problem: StepWiseProblem, solution: StepWiseSolution) -> Iterator[IntArray]:
    """[R] the cells of robots after each tick, -1 between two. Raises Fault for the first tick that breaks a rule."""
    ahead, num_robots, width = cell_ahead(problem.free), problem.num_robots, problem.free.shape[1]
    row_ahead, column_ahead = np.array(ROW_AHEAD), np.array(COLUMN_AHEAD)
    cell, heading, doing = problem.start.copy(), np.full(num_robots, EAST), np.full(num_robots, WAIT)
    progress = np.zeros(num_robots, np.int64)
    centre = np.stack([cell // width, cell % width], axis=1).astype(np.float64)
    for now in range(1, solution.num_steps + 1):
        action = solution.action[:, now - 1].astype(np.int64)
        acts = action != WAIT
        for r in np.flatnonzero(acts & (progress > 0) & (action != doing)):
            raise PlanFault(f"tick {now}: robot {r} begins another action after {progress[r]} of {problem.ticks} ticks of its last")
        doing = np.where(acts, action, doing)
        there = np.where((doing == FORWARD) & (acts | (progress > 0)), ahead[cell, heading], cell)
        for r in np.flatnonzero(there < 0):
            raise PlanFault(f"tick {now}: robot {r} drives from {place_of(problem, int(cell[r]))} into what is not free")
        progress += acts
        before, share = centre, np.where(doing == FORWARD, progress / problem.ticks, 0.0)
        centre = np.stack([cell // width + share * row_ahead[heading], cell % width + share * column_ahead[heading]], axis=1)
        _require_apart(problem, now, before, centre, cell, there)
        over = progress == problem.ticks
        heading = np.where(over, (heading + (doing == RIGHT) - (doing == LEFT)) % 4, heading)
        cell = np.where(over, there, cell)
        progress[over] = 0
        yield np.where((doing == FORWARD) & (progress > 0), -1, cell)


def place_of(problem: StepWiseProblem, cell: int) -> str:
    """A cell in words."""
    width = problem.free.shape[1]
    return f"row {cell // width}, column {cell % width}"


def _require_apart(problem: StepWiseProblem, now: int, before: FloatArray, after: FloatArray, cell: IntArray, there: IntArray) -> None:
    """Refuse a tick in which what two squares sweep overlaps. Robots that share no cell, from or to, are at least a touch apart."""
    low, high = np.minimum(before, after) - problem.size / 2, np.maximum(before, after) + problem.size / 2
    moving = np.flatnonzero(there != cell)
    where, robot = np.concatenate([cell, there[moving]]), np.concatenate([np.arange(len(cell)), moving])
    order = np.lexsort((robot, where))
    where, robot = where[order], robot[order]
    for apart in range(1, MOST_AT_A_CELL):
        k = np.flatnonzero(where[apart:] == where[:-apart])
        one, other = robot[k], robot[k + apart]
        overlaps = ((low[one] < high[other] - TOUCH) & (low[other] < high[one] - TOUCH)).all(axis=1)
        for i in np.flatnonzero(overlaps):
            place = place_of(problem, int(where[k[i]]))
            raise PlanFault(f"tick {now}: robots {one[i]} and {other[i]} come too close at {place}")
