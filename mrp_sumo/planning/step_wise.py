"""Step-wise planning: in each step a planner sees where robots are and which tasks there are, and says what they do next.

`run_step_wise` is the loop: it keeps the pool of tasks, asks, moves, and counts. Time is in steps, or in ticks by the rules of 2026;
nothing depends on the clock, which only measures. Refuses answers that are no answers; whether robots collide is for the referee.
"""

from collections.abc import Callable
from dataclasses import dataclass
from time import process_time
from typing import Protocol, runtime_checkable

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.step_wise import EAST, FORWARD, LEFT, NOTHING, RIGHT, WAIT, ActionArray, StepWiseProblem, StepWiseSolution, cell_ahead
from mrp_sumo.errors import PlanError, PlugInError
from mrp_sumo.planning.ticks import CrowdInTicks, Delays
from mrp_sumo.traffic.step_wise_referee import Pool


@dataclass(frozen=True, eq=False)
class Observation:
    """Observation of a planner before a step."""

    time: int  # in steps
    cell: IntArray  # [R]; by the rules of 2026 where robots will be, once they have done what is planned
    heading: IntArray  # [R]
    task_of: IntArray  # [R] task or NOTHING
    pool: dict[int, int]  # task revealed and not finished -> its errands done; above 0 it is open
    problem: StepWiseProblem

    def errands_left(self, task: int) -> IntArray:
        """The cells of a task in the pool that are to be visited."""
        return self.problem.errands_of(task)[self.pool[task] :]


@dataclass(frozen=True, eq=False)
class Decision:
    """Answer of a planner."""

    action: ActionArray  # [R]
    task_of: IntArray  # [R] task or NOTHING


class Stepper(Protocol):
    """A planner at work on a problem."""

    def step(self, seen: Observation) -> Decision | ActionArray:
        """Actions of robots in the next step, and their tasks; an action for each alone leaves their tasks to `tasks_in_turn`.

        A planner at work whose time is not that of this process has a method `cpu_s`, its CPU time so far.
        """


@runtime_checkable
class StepPlanner(Protocol):
    """Plans step by step. A plug-in is a class with this face, best a frozen dataclass whose fields are its parameters."""

    def prepare(self) -> None:
        """Compile or load the kernels, so that only planning is measured."""

    def begin(self, problem: StepWiseProblem, seed: int) -> Stepper:
        """Get ready for a problem. It may see map and robots; of the tasks those that are revealed, later."""


@dataclass(frozen=True, eq=False)
class StepWiseRun:
    """Result of a step-wise run."""

    solution: StepWiseSolution
    plan_time_s: list[float]  # [steps] CPU time of each step's planning
    begin_time_s: float  # CPU time of getting ready

    @property
    def planning_cpu_s(self) -> float:
        """All of the planner's CPU time."""
        return self.begin_time_s + sum(self.plan_time_s)


class StepWiseWorld:
    """A problem under way: where robots are, who has which task, and what has happened."""

    in_ticks = False

    def __init__(self, problem: StepWiseProblem) -> None:
        self.problem, self.pool, self.ahead = problem, Pool(problem), cell_ahead(problem.free)
        self.time = self.num_steps = 0  # they are one but by the rules of 2026
        self.cell, self.heading = problem.start.copy(), np.full(problem.num_robots, EAST, np.int64)
        self._actions: list[ActionArray] = []
        self._had = np.full(problem.num_robots, -2, np.int64)  # as the schedule last said; at first nothing
        self._schedule: list[tuple[int, int, int]] = []
        self._events: list[tuple[int, int, int, int]] = []

    def seen(self) -> Observation:
        """The observation of the next step."""
        task_of = np.array(self.pool.task_of, np.int64)
        return Observation(self.num_steps, self.cell.copy(), self.heading.copy(), task_of, dict(self.pool.done), self.problem)

    def ends(self, action: IntArray | ActionArray) -> IntArray:
        """[R] the cells where actions lead, -1 where nothing is free."""
        ends: IntArray = np.where(action == FORWARD, self.ahead[self.cell, self.heading], self.cell)
        return ends

    def advance(self, action: ActionArray, task_of: IntArray) -> list[tuple[int, int, int, int]]:
        """Make a step: (time, robot, task, errands done by then) of each errand that was done in it.

        `task_of` [R] are the tasks that robots have from now on, NOTHING for none. Raises PlanError for who leaves what is free, and for
        tasks that robots may not have.
        """
        cell = self._free_ends(action)
        self._move(action, cell)
        return self._record(action, task_of, cell)

    def _free_ends(self, action: ActionArray) -> IntArray:
        cell = self.ends(action)
        if (cell < 0).any():
            raise PlanError(f"robot {np.argmin(cell)} drives into what is not free")
        return cell

    def _move(self, action: ActionArray, cell: IntArray) -> None:
        self.num_steps += 1
        self.cell, self.heading = cell, (self.heading + (action == RIGHT) - (action == LEFT)) % 4

    def _record(self, action: ActionArray, task_of: IntArray, cell: IntArray) -> list[tuple[int, int, int, int]]:
        """Keep what robots do in a step or tick, at whose end they are at cells [R], -1 for none; the errands that are done then."""
        self.time += 1
        self._actions.append(action)
        changed = np.flatnonzero(task_of != self._had)
        self._schedule += [(self.time, r, task) for r, task in zip(changed.tolist(), task_of[changed].tolist())]
        self._had = task_of
        others = np.flatnonzero(task_of != np.array(self.pool.task_of, np.int64))  # than they have
        if fault := self.pool.give(list(zip(others.tolist(), task_of[others].tolist()))):
            raise PlanError(fault)
        events = self.pool.advance(self.time, cell.tolist())
        self._events += events
        return events

    def solution(self) -> StepWiseSolution:
        """All that has happened."""
        problem, released = self.problem, self.pool.released
        return StepWiseSolution(
            start=problem.start,
            heading=np.full(problem.num_robots, EAST, np.int64),
            action=np.array(self._actions, np.int8).reshape(-1, problem.num_robots).T,
            schedule=np.array(self._schedule, np.int64).reshape(-1, 3),
            event=np.array(self._events, np.int64).reshape(-1, 4),
            released=np.array(released, np.int64),
            errands=tuple(tuple(problem.errands_of(k).tolist()) for k in range(len(released))),
            num_done=self.pool.num_finished,
            in_ticks=self.in_ticks,
        )


class TickWorld(StepWiseWorld):
    """A problem under way by the rules of 2026: `cell` and `heading` are those of the plan, which robots carry out in ticks."""

    in_ticks = True

    def __init__(self, problem: StepWiseProblem, num_ticks: int, seed: int) -> None:
        """`num_ticks` is when it ends, `seed` of delays."""
        super().__init__(problem)
        self._crowd, self._delays = CrowdInTicks(problem, self.ahead), Delays(problem.delays, problem.num_robots, seed)
        self._num_ticks = num_ticks

    def advance(self, action: ActionArray, task_of: IntArray) -> list[tuple[int, int, int, int]]:
        """Plan a step, and make the ticks that it takes. Who has not begun what is planned waits, as does who needs its cell."""
        self._free_ends(action)
        action = safe(self, np.where(self._crowd.ready(), action, WAIT).astype(np.int8), round_corners=False)
        cell = self.ends(action)
        self._crowd.tell(action, cell)
        self._move(action, cell)
        events = []
        for _ in range(min(self.problem.ticks, self._num_ticks - self.time)):
            moves = self._crowd.tick(self._delays.draw())
            events += self._record(moves, task_of, self._crowd.standing())
            task_of = np.array(self.pool.task_of, np.int64)
        return events


def safe(world: StepWiseWorld, wanted: ActionArray, round_corners: bool = True) -> ActionArray:
    """[R] the actions, with waits instead of moves that leave the map or collide.

    Of several robots that want one cell the first in order gets it, if it is left or free. Without `round_corners` it is not free for who
    comes from another side than its robot leaves to.
    """
    action = wanted.copy()
    while True:
        end = world.ends(action)
        moves, robots = end != world.cell, np.arange(len(end))
        wrong = end < 0
        stays = np.zeros(world.problem.free.size, np.bool_)
        stays[world.cell[~moves]] = True
        wrong |= moves & stays[end]
        at = np.full(world.problem.free.size, -1, np.int64)
        at[world.cell] = robots
        other = at[end]
        wrong |= moves & (other >= 0) & (end[other] == world.cell)  # they would change places
        if not round_corners:
            wrong |= moves & (other >= 0) & (world.heading[other] != world.heading)
        going = np.flatnonzero(moves & ~wrong)
        _, first = np.unique(end[going], return_index=True)
        wrong[np.delete(going, first)] = True
        if not wrong.any():
            return action
        action[wrong] = WAIT


def run_step_wise(
    problem: StepWiseProblem, planner: StepPlanner, num_steps: int, seed: int = 0, show: Callable[[int, int], None] | None = None
) -> StepWiseRun:
    """Have a planner work on a problem for so many steps, or ticks by the rules of 2026.

    The seed is of the planner's chance, and of delays; `show` is called with the time and the number of finished tasks after each step.
    Raises PlugInError for an answer of the wrong form, or that gives robots tasks which they may not have.
    """
    began_s = process_time()
    stepper = planner.begin(problem, seed)
    cpu_s: Callable[[], float] = getattr(stepper, "cpu_s", process_time)
    begin_time_s = cpu_s() - began_s
    world, times_s = TickWorld(problem, num_steps, seed) if problem.ticks else StepWiseWorld(problem), list[float]()
    while world.time < num_steps:
        seen = world.seen()
        began_s = cpu_s()
        answer = stepper.step(seen)
        times_s.append(cpu_s() - began_s)
        moves, task_of = _checked(answer, seen, planner)
        try:
            world.advance(moves, task_of)
        except PlanError as error:
            raise _wrong(planner, str(error), seen.time) from error
        if show:
            show(world.time, world.pool.num_finished)
    return StepWiseRun(world.solution(), times_s, begin_time_s)


def tasks_in_turn(seen: Observation) -> IntArray:
    """[R] the tasks that robots have; those without one take, in turn, the free task whose first errand is nearest by rows and columns.

    Where robots have tasks of their own each takes its next one.
    """
    task_of, width = seen.task_of.copy(), seen.problem.free.shape[1]
    if seen.problem.own_tasks:
        first: dict[int, int] = {}
        for task in sorted(seen.pool):
            first.setdefault(seen.problem.owner_of(task), task)
        return np.array([first.get(r, NOTHING) if task == NOTHING else task for r, task in enumerate(task_of.tolist())], np.int64)
    held = set(task_of.tolist())
    free = np.array([task for task in seen.pool if task not in held], np.int64)
    at = np.array([seen.problem.errands_of(task)[0] for task in free.tolist()], np.int64)
    for robot in np.flatnonzero(task_of == NOTHING).tolist():
        if not len(free):
            break
        away = np.abs(at // width - seen.cell[robot] // width) + np.abs(at % width - seen.cell[robot] % width)
        nearest = int(away.argmin())
        task_of[robot] = free[nearest]
        free, at = np.delete(free, nearest), np.delete(at, nearest)
    return task_of


def _checked(answer: Decision | ActionArray, seen: Observation, planner: StepPlanner) -> tuple[ActionArray, IntArray]:
    """Actions and tasks; actions alone leave the tasks to us."""
    decision = answer if isinstance(answer, Decision) else Decision(answer, tasks_in_turn(seen))
    moves, task_of = np.asarray(decision.action), np.asarray(decision.task_of)
    if moves.dtype == object or moves.ndim != 1:
        raise _wrong(planner, f"answers {type(answer).__name__}, expected a Decision or an action for each robot", seen.time)
    num_robots = seen.problem.num_robots
    for what, values in (("actions", moves), ("tasks", task_of)):
        if values.shape != (num_robots,) or not np.issubdtype(values.dtype, np.integer):
            raise _wrong(planner, f"{what} of shape {values.shape}, expected {num_robots} whole numbers", seen.time)
    if len(moves) and not (moves.min() >= 0 and moves.max() <= 3):
        raise _wrong(planner, "an action that is none of 0 to 3", seen.time)
    return moves.astype(np.int8), np.where(task_of < 0, NOTHING, task_of).astype(np.int64)


def _wrong(planner: StepPlanner, what: str, now: int) -> PlugInError:
    return PlugInError(f"planner '{type(planner).__name__}', step {now}: {what}")
