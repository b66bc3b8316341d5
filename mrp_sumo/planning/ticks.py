"""Robots that carry out a plan of steps by the rules of the League of Robot Runners of 2026: in ticks, with delays, apart from each other.

A planner says as ever what each robot does in the next step, and robots do it at their own pace. Who has not begun what it was told last
waits in the plan. For each cell the order of those who come is that of the plan: who comes begins once those before it have begun to leave,
and goes on as long as its square sweeps nothing of theirs. In the plan nobody enters a cell that another one leaves round a corner in the
same step, since squares cannot follow there: so nobody waits for one who waits for it. The referee (`traffic.ticks`) knows nothing of this.
"""

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray
from mrp_sumo.core.step_wise import (
    COLUMN_AHEAD,
    FORWARD,
    LEFT,
    RIGHT,
    ROW_AHEAD,
    WAIT,
    ActionArray,
    DelayLaw,
    StepWiseProblem,
)

PURPOSE = 14  # of the stream of chance
TOUCH = 1e-9  # cells
AHEAD = np.stack([ROW_AHEAD, COLUMN_AHEAD], axis=1)  # [4, 2] by heading


class Delays:
    """Delays of robots, drawn tick by tick."""

    def __init__(self, law: DelayLaw | None, num_robots: int, seed: int) -> None:
        self._law, self._left = law, np.zeros(num_robots, np.int64)
        self._rng = np.random.default_rng([seed, law.seed if law else 0, PURPOSE])

    def draw(self) -> BoolArray:
        """[R] who makes no progress in the next tick."""
        law, rng, left = self._law, self._rng, self._left
        if law is None:
            return left > 0
        left -= left > 0
        ready = np.flatnonzero(left == 0)
        if law.event == "bernoulli":
            hit = ready[rng.random(len(ready)) < law.p]
        else:
            hit = rng.choice(ready, min(int(rng.poisson(len(left) * law.p)), len(ready)), replace=False)
        span = law.most - law.least
        if law.duration == "uniform":
            left[hit] = rng.integers(law.least, law.most + 1, len(hit))
        else:
            drawn = rng.normal(law.least + span * law.mean_share, span * law.std_share, len(hit))
            left[hit] = np.clip(np.rint(drawn), law.least, law.most)
        return left > 0


class CrowdInTicks:
    """Robots that carry out a plan, each at its own pace."""

    def __init__(self, problem: StepWiseProblem, ahead: IntArray) -> None:
        """`ahead` is [H x W, 4], the cell ahead of each cell and heading."""
        num_robots, num_cells = problem.num_robots, problem.free.size
        self._ticks, self._size, self._ahead, self._width = problem.ticks, problem.size, ahead, problem.free.shape[1]
        self.cell, self.heading = problem.start.copy(), np.zeros(num_robots, np.int64)  # while it drives, the cell that it leaves
        self._doing, self._progress = np.full(num_robots, WAIT), np.zeros(num_robots, np.int64)
        self._next, self._ticket = np.full(num_robots, WAIT), np.zeros(num_robots, np.int64)  # what it does next, and its turn at the cell
        self._coming, self._left = np.zeros(num_cells, np.int64), np.zeros(num_cells, np.int64)  # who comes to a cell, and who left, in all
        self._coming[problem.start] = 1
        self._at = np.full(num_cells, -1, np.int64)  # the robot whose `cell` it is
        self._at[problem.start] = np.arange(num_robots)

    def ready(self) -> BoolArray:
        """[R] who can be told what to do next."""
        ready: BoolArray = self._next == WAIT
        return ready

    def tell(self, action: ActionArray, end: IntArray) -> None:
        """Have those that are ready do actions [R] next, which lead to cells [R]."""
        acts, drives = action != WAIT, action == FORWARD
        self._next[acts] = action[acts]
        self._ticket[drives] = self._coming[end[drives]]
        self._coming[end[drives]] += 1

    def tick(self, delayed: BoolArray) -> ActionArray:
        """Make a tick: [R] the actions in which robots make progress, WAIT for none; those that are delayed [R] make none."""
        idle = np.flatnonzero((self._doing == WAIT) & (self._next != WAIT) & ~delayed)
        there = self._ahead[self.cell[idle], self.heading[idle]]
        begins = idle[(self._next[idle] != FORWARD) | (self._left[there] == self._ticket[idle])]
        self._doing[begins] = self._next[begins]
        acts = (self._doing != WAIT) & ~delayed & ~self._too_close()
        self._doing[begins[~acts[begins]]] = WAIT
        begins = begins[acts[begins]]
        self._next[begins] = WAIT
        self._left[self.cell[begins[self._doing[begins] == FORWARD]]] += 1
        action: ActionArray = np.where(acts, self._doing, WAIT).astype(np.int8)
        self._progress += acts
        self._finish(np.flatnonzero(self._progress == self._ticks))
        return action

    def standing(self) -> IntArray:
        """[R] the cells of robots, -1 between two."""
        return np.where((self._doing == FORWARD) & (self._progress > 0), -1, self.cell)

    def _finish(self, over: IntArray) -> None:
        """End actions that have taken their ticks."""
        doing = self._doing[over]
        drove = over[doing == FORWARD]
        self._at[self.cell[drove]] = np.where(self._at[self.cell[drove]] == drove, -1, self._at[self.cell[drove]])
        self.cell[drove] = self._ahead[self.cell[drove], self.heading[drove]]
        self._at[self.cell[drove]] = drove
        self.heading[over] = (self.heading[over] + (doing == RIGHT) - (doing == LEFT)) % 4
        self._doing[over], self._progress[over] = WAIT, 0

    def _too_close(self) -> BoolArray:
        """[R] whose next tick would sweep what another one's square covers that leaves the cell ahead."""
        close = np.zeros(len(self.cell), np.bool_)
        drives = np.flatnonzero(self._doing == FORWARD)
        other = self._at[self._ahead[self.cell[drives], self.heading[drives]]]
        drives, other = drives[other >= 0], other[other >= 0]
        apart = np.abs(self._centre(drives, 1) - self._centre(other, 0)).max(axis=1)
        close[drives] = apart < self._size - TOUCH
        return close

    def _centre(self, robot: IntArray, more: int) -> FloatArray:
        """[robots, 2] row and column of their centres, after so many more ticks of driving."""
        drives = self._doing[robot] == FORWARD
        share = np.where(drives, (self._progress[robot] + more) / self._ticks, 0.0)
        centre: FloatArray = np.stack(np.divmod(self.cell[robot], self._width), axis=1) + share[:, None] * AHEAD[self.heading[robot]]
        return centre
