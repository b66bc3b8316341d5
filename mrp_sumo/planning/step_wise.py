"""Step-wise planning: in each step a planner sees where robots are and which tasks there are, and says what they do next.

`run_step_wise` is the loop: it keeps the pool of tasks, asks, moves, and counts. Time is in steps; nothing depends on the clock, which
only measures. Refuses answers that are no answers; whether robots collide is for the referee.
"""

from collections.abc import Callable
from dataclasses import dataclass
from time import process_time
from typing import Protocol, runtime_checkable

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.step_wise import EAST, FORWARD, LEFT, NOTHING, RIGHT, ActionArray, StepWiseProblem, StepWiseSolution, cell_ahead
from mrp_sumo.errors import PlugInError
from mrp_sumo.traffic.step_wise_referee import Pool


@dataclass(frozen=True, eq=False)
class Observation:
    """What a planner sees before a step."""

    time: int
    cell: IntArray  # [R]
    heading: IntArray  # [R]
    task_of: IntArray  # [R] task or NOTHING
    pool: dict[int, int]  # task revealed and not finished -> its errands done; above 0 it is open
    problem: StepWiseProblem

    def errands_left(self, task: int) -> IntArray:
        """The cells of a task in the pool that are to be visited."""
        return self.problem.errands_of(task)[self.pool[task] :]


@dataclass(frozen=True, eq=False)
class Decision:
    """What a planner answers."""

    action: ActionArray  # [R]
    task_of: IntArray  # [R] task or NOTHING


class Stepper(Protocol):
    """A planner at work on a problem."""

    def step(self, seen: Observation) -> Decision:
        """What robots do in the next step, and which tasks they have."""


@runtime_checkable
class StepPlanner(Protocol):
    """Plans step by step. A plug-in is a class with this face, best a frozen dataclass whose fields are its parameters."""

    def prepare(self) -> None:
        """Compile or load the kernels, so that only planning is measured."""

    def begin(self, problem: StepWiseProblem, seed: int) -> Stepper:
        """Get ready for a problem. It may see map and robots; of the tasks those that are revealed, later."""


@dataclass(frozen=True, eq=False)
class StepWiseRun:
    """What came of it."""

    solution: StepWiseSolution
    plan_time_s: list[float]  # [T] CPU time of each step's planning
    begin_time_s: float  # CPU time of getting ready

    @property
    def planning_cpu_s(self) -> float:
        """All of the planner's CPU time."""
        return self.begin_time_s + sum(self.plan_time_s)


def run_step_wise(
    problem: StepWiseProblem, planner: StepPlanner, num_steps: int, seed: int = 0, show: Callable[[int, int], None] | None = None
) -> StepWiseRun:
    """Have a planner work on a problem for so many steps.

    Parameters
    ----------
    problem, planner
        The two.
    num_steps
        T.
    seed
        Of the planner's chance.
    show
        Called with the time and the number of finished tasks after each step.

    Raises
    ------
    PlugInError
        For an answer of the wrong form, or that gives robots tasks which they may not have.
    """
    began_s = process_time()
    stepper = planner.begin(problem, seed)
    begin_time_s = process_time() - began_s
    pool, ahead = Pool(problem), cell_ahead(problem.free)
    cell, heading = problem.start.copy(), np.full(problem.num_robots, EAST, np.int64)
    action = np.zeros((problem.num_robots, num_steps), np.int8)
    had = np.full(problem.num_robots, -2, np.int64)  # as the schedule last said; at first nothing
    schedule, events, times_s = [], [], []
    for now in range(1, num_steps + 1):
        seen = Observation(now - 1, cell.copy(), heading.copy(), np.array(pool.task_of, np.int64), dict(pool.done), problem)
        began_s = process_time()
        decision = stepper.step(seen)
        times_s.append(process_time() - began_s)
        moves, task_of = _checked(decision, problem, planner, now - 1)
        action[:, now - 1] = moves
        next_cell = np.where(moves == FORWARD, ahead[cell, heading], cell)
        if (next_cell < 0).any():
            raise _wrong(planner, f"robot {np.argmin(next_cell)} drives into what is not free", now - 1)
        cell, heading = next_cell, (heading + (moves == RIGHT) - (moves == LEFT)) % 4
        changed = np.flatnonzero(task_of != had)
        schedule += [(now, r, task) for r, task in zip(changed.tolist(), task_of[changed].tolist())]
        had = task_of
        if fault := pool.give(list(enumerate(task_of.tolist()))):
            raise _wrong(planner, fault, now - 1)
        events += pool.advance(now, cell.tolist())
        if show:
            show(now, pool.num_finished)
    solution = StepWiseSolution(
        start=problem.start,
        heading=np.full(problem.num_robots, EAST, np.int64),
        action=action,
        schedule=np.array(schedule, np.int64).reshape(-1, 3),
        event=np.array(events, np.int64).reshape(-1, 4),
        released=np.array(pool.released, np.int64),
        errands=tuple(tuple(problem.errands_of(k).tolist()) for k in range(len(pool.released))),
        num_done=pool.num_finished,
    )
    return StepWiseRun(solution, times_s, begin_time_s)


def _checked(decision: Decision, problem: StepWiseProblem, planner: StepPlanner, now: int) -> tuple[ActionArray, IntArray]:
    if not isinstance(decision, Decision):
        raise _wrong(planner, f"answers {type(decision).__name__}, expected a Decision", now)
    moves, task_of = np.asarray(decision.action), np.asarray(decision.task_of)
    for what, values in (("actions", moves), ("tasks", task_of)):
        if values.shape != (problem.num_robots,) or not np.issubdtype(values.dtype, np.integer):
            raise _wrong(planner, f"{what} of shape {values.shape}, expected {problem.num_robots} whole numbers", now)
    if len(moves) and not (moves.min() >= 0 and moves.max() <= 3):
        raise _wrong(planner, "an action that is none of 0 to 3", now)
    return moves.astype(np.int8), np.where(task_of < 0, NOTHING, task_of).astype(np.int64)


def _wrong(planner: StepPlanner, what: str, now: int) -> PlugInError:
    return PlugInError(f"planner '{type(planner).__name__}', step {now}: {what}")
