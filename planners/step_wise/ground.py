"""The ground that step-wise planners share: states of robots that turn on a grid, and distances to goals.

Tables of distances are made when they are asked for; beyond a number of megabytes, the least recently used are forgotten.
"""

from itertools import accumulate, pairwise, product

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.step_wise import ACTION_LETTERS, FORWARD, LEFT, RIGHT, WAIT, StepWiseProblem, cell_ahead
from mrp_sumo.errors import PlanError

FAR = 65535  # in tables: no way
MOST_DEAR = 12  # times `against` that a step may count more


class FreeCells:
    """A problem's free cells, numbered from 0, with tables of steps to those that are goals. A state is 4 x cell + heading.

    Rows lead east and west in turn, columns north and south: a step against that counts as `against` more, until there are other prices.
    """

    def __init__(self, problem: StepWiseProblem, memory_mb: int, against: int = 0) -> None:
        free = np.flatnonzero(problem.free.reshape(-1))
        self.number = np.full(problem.free.size, -1, np.int64)  # [H x W] of each cell
        self.number[free] = np.arange(len(free))
        ahead = cell_ahead(problem.free)[free]
        self.ahead = np.where(ahead < 0, -1, self.number[ahead]).astype(np.int32).reshape(-1)  # [S]
        num_states, (row, column) = len(self.ahead), np.divmod(free, problem.free.shape[1])
        turned = np.stack([row % 2 == 1, column % 2 == 1, row % 2 == 0, column % 2 == 0], 1)  # by heading
        self.against, self.price = against, np.where(turned.reshape(-1), 1 + against, 1).astype(np.int32)  # [S]
        num_slots = min(len(free), memory_mb * 1_000_000 // (2 * num_states))
        if num_slots < min(len(free), 2 * problem.num_robots + 2):
            raise PlanError(f"{problem.name}: memory_mb is {memory_mb}, too little for two tables a robot of {2 * num_states} bytes")
        self.table: NDArray[np.uint16] = np.empty((num_slots, num_states), np.uint16)  # steps; FAR where there is no way
        self._slot: dict[int, int] = {}  # goal -> its table; the least recently used first
        self._errands_of, self._errands = problem.errands_of, dict[int, list[int]]()  # task -> cells
        self._left: dict[int, list[int]] = {}  # task -> steps from each errand to the end
        self._unused = list(range(num_slots - 1, -1, -1))
        most = 2 + MOST_DEAR * against
        self._bucket, self._size = np.empty((most, num_states), np.int32), np.empty(most, np.int64)

    def reprice(self, price: NDArray[np.int32]) -> None:
        """Have steps cost this [S] from now on. All distances are forgotten: they are worked out anew when they are asked for."""
        self.price = price
        self._unused += self._slot.values()
        self._slot, self._left = {}, {}

    @property
    def num_tables(self) -> int:
        """Tables of distances that are there."""
        return len(self._slot)

    @property
    def num_cells(self) -> int:
        """Free ones."""
        return len(self.ahead) // 4

    def slot(self, goal: int) -> int:
        """The table of a goal. Others may be forgotten for it: those that were asked for longest ago."""
        slot = self._slot.pop(goal, -1)
        if slot < 0:
            from planners.step_wise._distance import fill_distance

            slot = self._unused.pop() if self._unused else self._slot.pop(next(iter(self._slot)))
            fill_distance(self.ahead, self.price, goal, self.table[slot], self._bucket, self._size)
        self._slot[goal] = slot
        return slot

    def steps_between(self, begin: int, end: int) -> int:
        """The fewest steps from a cell, in the best heading, to another."""
        return int(self.table[self.slot(end), 4 * begin : 4 * begin + 4].min())

    def steps_left(self, task: int) -> list[int]:
        """The steps from each errand of a task through all that come after."""
        if task not in self._left:
            steps = [self.steps_between(a, b) for a, b in pairwise(self.errands(task))]
            self._left[task] = [*accumulate(reversed(steps), initial=0)][::-1]
        return self._left[task]

    def errands(self, task: int) -> list[int]:
        """The cells of a task's errands."""
        if task not in self._errands:
            self._errands[task] = self.number[self._errands_of(task)].tolist()
        return self._errands[task]


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
