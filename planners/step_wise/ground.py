"""The ground that step-wise planners share: states of robots that turn on a grid, and distances to goals.

Tables of distances are made when they are asked for, so many states of them a step; beyond a number of megabytes, the least recently used
are forgotten.
"""

import math
from itertools import accumulate, product

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.step_wise import ACTION_LETTERS, FORWARD, LEFT, NOTHING, RIGHT, WAIT, StepWiseProblem, cell_ahead
from mrp_sumo.errors import PlanError

FAR = 65535  # in tables: no way
RESERVE = 0.5  # of a step's work, for tables of robots' own goals
MOST_DEAR = 12  # times `against` that a step may count more


class FreeCells:
    """A problem's free cells, numbered from 0, with tables of steps to those that are goals. A state is 4 x cell + heading.

    Rows lead east and west in turn, columns north and south: a step against that counts as `against` more, until there are other prices.
    """

    def __init__(self, problem: StepWiseProblem, memory_mb: int, against: int = 0, work: int = 2**62) -> None:
        """`work` is how many states of tables are filled in a step; a table that has been begun is made."""
        free = np.flatnonzero(problem.free.reshape(-1))
        self.number = np.full(problem.free.size, -1, np.int64)  # [H x W] of each cell
        self.number[free] = np.arange(len(free))
        ahead = cell_ahead(problem.free)[free]
        self.ahead = np.where(ahead < 0, -1, self.number[ahead]).astype(np.int32).reshape(-1)  # [S]
        self.outward = outward(self.ahead.reshape(-1, 4))
        num_states, (row, column) = len(self.ahead), np.divmod(free, problem.free.shape[1])
        turned = np.stack([row % 2 == 1, column % 2 == 1, row % 2 == 0, column % 2 == 0], 1)  # by heading
        self.against, self.price = against, np.where(turned.reshape(-1), 1 + against, 1).astype(np.int32)  # [S]
        num_slots = min(len(free), memory_mb * 1_000_000 // (2 * num_states))
        if num_slots < (least := min(len(free), 2 * problem.num_robots + 2)):
            need_mb = math.ceil(2 * num_states * least / 1e6)
            raise PlanError(
                f"{problem.name}: memory_mb is {memory_mb}, expected {need_mb} or more: two tables a robot of {2 * num_states} bytes"
            )
        self.table: NDArray[np.uint16] = np.empty((num_slots + 1, num_states), np.uint16)  # steps; FAR where there is no way
        self._slot: dict[int, int] = {}  # goal -> its table; the least recently used first
        self._old: set[int] = set()  # goals whose tables are of prices that were
        self.work, self._left_of_step = work, work
        self._at = np.stack([row, column])  # [2, C]
        self._errands_of, self._errands = problem.errands_of, dict[int, list[int]]()  # task -> cells
        self._left: dict[int, list[int]] = {}  # task -> steps from each errand to the end
        self._unused = list(range(num_slots - 1, -1, -1))
        most = 2 + MOST_DEAR * against
        self._bucket, self._size = np.empty((most, num_states), np.int32), np.empty(most, np.int64)

    def reprice(self, price: NDArray[np.int32]) -> None:
        """Have steps cost this [S] from now on. Tables are used as they are until they are made anew, when they are asked for."""
        self.price, self._old, self._left = price, set(self._slot), {}

    def begin_step(self) -> None:
        """A step begins, in which tables may be made again."""
        self._left_of_step = self.work

    @property
    def num_tables(self) -> int:
        """Tables of distances that are there, of the prices that are."""
        return len(self._slot) - len(self._old)

    @property
    def xy(self) -> NDArray[np.int64]:
        """[C, 2] of cells, columns and rows."""
        return self._at[::-1].T

    @property
    def num_cells(self) -> int:
        """Free ones."""
        return len(self.ahead) // 4

    def slot(self, goal: int, reserve: float = 0.0) -> int:
        """The table of a goal. Others may be forgotten for it: those that were asked for longest ago.

        -1 where it is not there and has to wait for another step, so that the share `reserve` of the work of this one is left.
        """
        slot = self._slot.pop(goal, -1)
        if slot < 0 or goal in self._old:
            if self._left_of_step > reserve * self.work:
                if slot < 0:
                    slot = self._unused.pop() if self._unused else self._forget(next(iter(self._slot)))
                self._fill(slot, np.array([goal]))
                self._old.discard(goal)
            elif slot < 0:
                return -1
        self._slot[goal] = slot
        return slot

    def to_nearest(self, goals: IntArray) -> int:
        """A table of the steps to the nearest of some cells, until it is asked for again."""
        self._fill(len(self.table) - 1, goals)
        return len(self.table) - 1

    def _fill(self, slot: int, goals: IntArray) -> None:
        from planners.step_wise._distance import fill_distance

        fill_distance(self.ahead, self.price, goals, self.table[slot], self._bucket, self._size)
        self._left_of_step -= len(self.ahead)

    def _forget(self, goal: int) -> int:
        self._old.discard(goal)
        return self._slot.pop(goal)

    def apart(self, begin: NDArray[np.int64], end: NDArray[np.int64]) -> NDArray[np.int64]:
        """Rows and columns between cells: what is taken for the steps while there is no table."""
        steps: NDArray[np.int64] = np.abs(self._at[:, begin] - self._at[:, end]).sum(0)
        return steps

    def steps_left(self, task: int) -> list[int]:
        """The steps from each errand of a task, in the best heading, through all that come after."""
        if task in self._left:
            return self._left[task]
        errands = self.errands(task)
        slots = [self.slot(end, RESERVE) for end in errands[1:]]
        least = self.apart(np.array(errands[:-1], np.int64), np.array(errands[1:], np.int64)).tolist()
        steps = [int(self.table[s, 4 * a : 4 * a + 4].min()) if s >= 0 else m for s, a, m in zip(slots, errands, least)]
        left = [*accumulate(reversed(steps), initial=0)][::-1]
        if min(slots, default=0) >= 0:
            self._left[task] = left
        return left

    def errands(self, task: int) -> list[int]:
        """The cells of a task's errands."""
        if task not in self._errands:
            self._errands[task] = self.number[self._errands_of(task)].tolist()
        return self._errands[task]


def outward(ahead: IntArray | NDArray[np.int32]) -> IntArray:
    """[C] the cell by which one leaves a dead end, NOTHING for cells in none; `ahead` [C, 4] are neighbours."""
    out, num_left = np.full(len(ahead), NOTHING), (ahead >= 0).sum(1)
    ends = np.flatnonzero(num_left == 1).tolist()
    for cell in ends:  # which grows
        for beside in ahead[cell].tolist() if num_left[cell] == 1 else ():
            if beside >= 0 and out[beside] == NOTHING:
                out[cell] = beside
                num_left[beside] -= 1
                if num_left[beside] == 1:
                    ends.append(beside)
    return out


def operations(depth: int) -> NDArray[np.int8]:
    """[O, depth] all sequences of actions that are of use; the first one waits.

    None turns back and forth or twice to the left, or three times to the right. None but single actions ends by turning.
    """
    useful = []
    for actions in product((WAIT, FORWARD, RIGHT, LEFT), repeat=depth):
        letters = "".join(ACTION_LETTERS[a] for a in actions)
        if (depth == 1 or letters.rstrip("W")[-1:] in ("", "F")) and not any(part in letters for part in ("RC", "CR", "CC", "RRR")):
            useful.append(actions)
    return np.array(useful, np.int8)


def moved_up(action: NDArray[np.int8]) -> NDArray[np.int16]:
    """[O] for each operation the one that is left of it after a step, ended by waiting."""
    number = {tuple(actions): o for o, actions in enumerate(action.tolist())}
    return np.array([number[(*actions[1:], WAIT)] for actions in action.tolist()], np.int16)
