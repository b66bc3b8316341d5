"""Step-wise lifelong problems on grids, after the League of Robot Runners: robots turn and drive one cell a step, tasks never end.

An *errand* is a visit to a cell, a *task* is errands in order. A pool of revealed tasks is kept full: as many as are finished in a step
are revealed at its end, in the order of the problem. A task is *open* once its first errand is done, and then belongs to its robot.
By the rules of 2023 each robot has tasks of its own, and the pool always has some of each robot's.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.graph import BoolArray, IntArray
from mrp_sumo.errors import PlanError

EAST = 0  # of headings east, south, west, north; a turn to the right adds one
FORWARD, RIGHT, LEFT, WAIT = range(4)  # actions: FW, CR, CCR, W
ACTION_LETTERS = "FRCW"
HEADING_LETTERS = "ESWN"
NOTHING = -1  # the task of a robot that has none
ROW_AHEAD = (0, 1, 0, -1)  # by heading
COLUMN_AHEAD = (1, 0, -1, 0)

ActionArray = NDArray[np.int8]


@dataclass(frozen=True)
class DelayLaw:
    """Law of delays by the rules of 2026: in each tick some robots begin to make no progress, for some ticks."""

    seed: int
    least: int  # ticks
    most: int
    event: Literal["bernoulli", "poisson"]  # each robot with probability p, or as many as are drawn with the mean of robots times p
    p: float
    duration: Literal["uniform", "gaussian"]  # from least to most, or normal with these shares of the span, cut off at both
    mean_share: float
    std_share: float


@dataclass(frozen=True, eq=False)
class StepWiseProblem:
    """A step-wise problem. Cells are row x width + column; row 0 is the uppermost. All robots begin heading east."""

    name: str
    free: BoolArray  # [H, W]
    start: IntArray  # [R] cells
    first: IntArray  # [N + 1] each task's first errand; after the last task the first begins again, under another number
    errand: IntArray  # cells
    num_revealed: int  # how many tasks are in the pool at any time
    ticks: int = 0  # that an action takes by the rules of 2026; 0: by those of 2024, in steps
    size: float = 1.0  # cells, side of a robot's square by the rules of 2026
    delays: DelayLaw | None = None  # by the rules of 2026
    own_tasks: bool = False  # by the rules of 2023: robot r of R has the tasks r, r + R, ...; else robots may have any

    def __post_init__(self) -> None:
        height, width = self.free.shape
        blocked = ~self.free.reshape(-1)
        for what, cells in (("robot", self.start), ("errand", self.errand)):
            outside = (cells < 0) | (cells >= height * width)
            wrong = np.flatnonzero(outside | blocked[np.where(outside, 0, cells)])
            if len(wrong):
                cell, of = int(cells[wrong[0]]), int(wrong[0])
                of = int(np.searchsorted(self.first, of, "right")) - 1 if what == "errand" else of
                state = "off the map" if outside[wrong[0]] else f"blocked (row {cell // width}, column {cell % width})"
                raise PlanError(f"{self.name}: {'task' if what == 'errand' else what} {of}: cell {cell} is {state}")
        where, count = np.unique(self.start, return_counts=True)
        if (count > 1).any():
            cell = int(where[count > 1][0])
            one, two = np.flatnonzero(self.start == cell)[:2]
            raise PlanError(f"{self.name}: robots {one} and {two} start at the same cell {cell}")
        empty = np.flatnonzero(np.diff(self.first) < 1)
        if len(empty):
            raise PlanError(f"{self.name}: task {empty[0]} has no errands")
        if self.num_revealed < 1 or not self.num_tasks:
            raise PlanError(f"{self.name}: {self.num_tasks} tasks of which {self.num_revealed} are revealed, expected 1 or more")
        if self.ticks < 0 or not 0 < self.size <= 1:
            raise PlanError(f"{self.name}: actions of {self.ticks} ticks, squares of {self.size:g} cells, expected 0 to 1 cells")

    @property
    def num_robots(self) -> int:
        """R."""
        return len(self.start)

    @property
    def num_tasks(self) -> int:
        """N, before they begin again."""
        return len(self.first) - 1

    def owner_of(self, task: int) -> int:
        """The only robot that may have a task; NOTHING where any may."""
        return task % self.num_robots if self.own_tasks else NOTHING

    def errands_of(self, task: int) -> IntArray:
        """The cells of a task, which may have any number from 0 up."""
        k = task % self.num_tasks
        cells: IntArray = self.errand[self.first[k] : self.first[k + 1]]
        return cells


@dataclass(frozen=True, eq=False)
class StepWiseSolution:
    """Actions of robots, and the tasks that they had. Step t leads from time t to time t + 1. By the rules of 2026 steps are ticks."""

    start: IntArray  # [R] cells
    heading: IntArray  # [R] at time 0
    action: ActionArray  # [R, T]
    schedule: IntArray  # [S, 3] (time, robot, task or NOTHING): what the robot has from this time on; times ascend
    event: IntArray  # [E, 4] (time, robot, task, errands done by then); times ascend
    released: IntArray  # [tasks revealed] times
    errands: tuple[tuple[int, ...], ...]  # their cells
    num_done: int
    in_ticks: bool = False

    @property
    def num_steps(self) -> int:
        """T."""
        return int(self.action.shape[1])


def cell_ahead(free: BoolArray) -> IntArray:
    """[H x W, 4] the cell ahead of each cell and heading; -1 where nothing is free."""
    height, width = free.shape
    padded = np.full((height + 2, width + 2), -1, np.int64)
    padded[1:-1, 1:-1] = np.where(free, np.arange(height * width).reshape(height, width), -1)
    columns = [padded[1 + r : 1 + r + height, 1 + c : 1 + c + width].reshape(-1) for r, c in zip(ROW_AHEAD, COLUMN_AHEAD)]
    ahead: IntArray = np.where(free.reshape(-1, 1), np.stack(columns, axis=1), -1)
    return ahead
