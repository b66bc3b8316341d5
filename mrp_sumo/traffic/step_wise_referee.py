"""The referee of step-wise lifelong solutions: replays the rules of the League of Robot Runners and names the first fault.

Robots begin at the problem's cells, heading east. By the rules of 2024 each one goes forward, turns right or left by a quarter, or waits in
each step. Nobody leaves the map or enters a blocked cell, no two robots are in one cell, and no two change places; to follow is allowed.
Those of 2026, where an action takes several ticks, are in `traffic.ticks`.

After each step or tick, in this order: what the schedule says from this time on takes effect, errands are done (at most one a robot: the
next of its task, where it stands), finished tasks leave the pool, and as many are revealed in the order of the problem. A robot may be
given a task that is in the pool and that nobody else has, by the rules of 2023 one of its own; who has opened one keeps it until it is
finished.

What a solution states (starts, errands done, tasks revealed, tasks finished) has to be what follows. Knows no planner.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.step_wise import EAST, FORWARD, LEFT, NOTHING, RIGHT, WAIT, StepWiseProblem, StepWiseSolution, cell_ahead
from mrp_sumo.traffic.ticks import PlanFault, in_ticks, place_of

CROSSINGS = 3  # of the map, height and width, in the time of which a robot should have done an errand


@dataclass(frozen=True)
class StepWiseVerdict:
    """The referee's judgement of a solution."""

    fault: str  # the first, '' where there is none
    tasks_done: int  # up to the fault
    errands_done: int

    @property
    def valid(self) -> bool:
        """True without a fault."""
        return not self.fault


@dataclass(frozen=True)
class CrowdProgress:
    """Progress of a step-wise solution."""

    errands_by_tenth: tuple[int, ...]  # errands done in each tenth of its time
    wait_share: float  # of all actions
    stalled_since_step: int | None  # the step (or tick) of the last errand, if none follows for long; 0: there was none


class Pool:
    """Tasks that are revealed and not finished, who has them, and how far they are: the rules for tasks, for the referee and for runs."""

    def __init__(self, problem: StepWiseProblem) -> None:
        self.problem = problem
        self.done: dict[int, int] = {}  # task in the pool -> errands done
        self.task_of: list[int] = [NOTHING] * problem.num_robots
        self.holder: dict[int, int] = {}  # task -> robot that has it
        self.released: list[int] = []
        self.num_finished = 0
        self.num_errands = 0
        num_robots = problem.num_robots
        self._num_lacking = num_robots  # robots with fewer than `_least` tasks of their own in the pool
        self._least, self._num_own = max(1, problem.num_revealed // max(num_robots, 1)), [0] * num_robots
        self.reveal(0)

    def reveal(self, now: int) -> None:
        """Fill the pool."""
        while self._num_lacking if self.problem.own_tasks else len(self.done) < self.problem.num_revealed:
            task = len(self.released)
            self.done[task] = 0
            self.released.append(now)
            if (robot := self.problem.owner_of(task)) != NOTHING:
                self._num_own[robot] += 1
                self._num_lacking -= self._num_own[robot] == self._least

    def give(self, changes: list[tuple[int, int]]) -> str:
        """Have robots take tasks, all at once; (robot, task or NOTHING). What is wrong with it is returned."""
        for robot, task in changes:
            had = self.task_of[robot]
            if had != NOTHING and task != had:
                if self.done[had] > 0:
                    return f"robot {robot} is given {_named(task)}, but has opened task {had}"
                del self.holder[had]
                self.task_of[robot] = NOTHING
        for robot, task in changes:
            if task == NOTHING or task == self.task_of[robot]:
                continue
            if task not in self.done:
                state = "finished" if 0 <= task < len(self.released) else "not revealed"
                return f"robot {robot} is given task {task}, which is {state}"
            if task in self.holder:
                opened = "has opened" if self.done[task] else "has"
                return f"robot {robot} is given task {task}, which robot {self.holder[task]} {opened}"
            if (owner := self.problem.owner_of(task)) not in (robot, NOTHING):
                return f"robot {robot} is given task {task}, which is robot {owner}'s own"
            self.holder[task] = robot
            self.task_of[robot] = task
        return ""

    def advance(self, now: int, cell: list[int]) -> list[tuple[int, int, int, int]]:
        """Errands done by robots at these cells, as events; finished tasks leave the pool, others are revealed."""
        events = []
        for robot, task in enumerate(self.task_of):
            if task == NOTHING:
                continue
            errands, done = self.problem.errands_of(task), self.done[task]
            if errands[done] != cell[robot]:
                continue
            events.append((now, robot, task, done + 1))
            self.num_errands += 1
            self.done[task] = done + 1
            if done + 1 == len(errands):
                del self.done[task], self.holder[task]
                self.task_of[robot] = NOTHING
                self.num_finished += 1
                self._num_own[robot] -= 1
                self._num_lacking += self._num_own[robot] == self._least - 1
        self.reveal(now)
        return events


def judge_step_wise(problem: StepWiseProblem, solution: StepWiseSolution) -> StepWiseVerdict:
    """Replay a solution up to its first fault."""
    pool = Pool(problem)
    try:
        _require_start(problem, solution)
        _replay(problem, solution, pool)
        _require_account(problem, solution, pool)
    except PlanFault as fault:
        return StepWiseVerdict(str(fault), pool.num_finished, pool.num_errands)
    return StepWiseVerdict("", pool.num_finished, pool.num_errands)


def pace_of(problem: StepWiseProblem, solution: StepWiseSolution) -> CrowdProgress:
    """Progress of a solution. It has stalled if no errand is done in its last tenth, and robots could cross the map three times in it."""
    time, end = solution.event[:, 0], solution.num_steps
    tenths = np.bincount((time - 1) * 10 // max(end, 1), minlength=10)
    last = int(time.max(initial=0))
    crossing = CROSSINGS * sum(problem.free.shape) * max(problem.ticks, 1)
    stalled = end - last >= max(end / 10, crossing)
    waits = float((solution.action == WAIT).mean()) if solution.action.size else 0.0
    return CrowdProgress(tuple(tenths.tolist()), waits, last if stalled else None)


def _require_start(problem: StepWiseProblem, solution: StepWiseSolution) -> None:
    if len(solution.start) != problem.num_robots:
        raise PlanFault(f"{len(solution.start)} robots, but the problem has {problem.num_robots}")
    for r in np.flatnonzero((solution.start != problem.start) | (solution.heading != EAST)):
        cell = place_of(problem, int(problem.start[r]))
        raise PlanFault(f"time 0: robot {r} does not start at {cell} heading east, as the problem says")


def _replay(problem: StepWiseProblem, solution: StepWiseSolution, pool: Pool) -> None:
    if len(solution.schedule) and not ((solution.schedule[:, 1] >= 0) & (solution.schedule[:, 1] < problem.num_robots)).all():
        raise PlanFault("the schedule is of robots that there are not")
    scheduled = np.maximum(solution.schedule[:, 0], 1)  # what holds from time 0 on takes effect with the first step
    at_time = np.searchsorted(scheduled, np.arange(solution.num_steps + 2))
    of_time = np.searchsorted(solution.event[:, 0], np.arange(solution.num_steps + 2))
    if len(solution.event) and not 1 <= solution.event[0, 0] <= solution.event[-1, 0] <= solution.num_steps:
        raise PlanFault(f"an errand is done outside the times 1 to {solution.num_steps}")
    unit = "tick" if solution.in_ticks else "time"
    for now, cell in enumerate((in_ticks if solution.in_ticks else _in_steps)(problem, solution), 1):
        changes = solution.schedule[at_time[now] : at_time[now + 1], 1:].tolist()
        if fault := pool.give([(robot, task) for robot, task in changes]):
            raise PlanFault(f"{unit} {now}: {fault}")
        done = sorted(pool.advance(now, cell.tolist()))
        stated = sorted(tuple(row) for row in solution.event[of_time[now] : of_time[now + 1]].tolist())
        if done != stated:
            only = next((e for e in stated if e not in done), None)
            e = only or next(e for e in done if e not in stated)
            where = place_of(problem, int(cell[e[1]])) if 0 <= e[1] < problem.num_robots and cell[e[1]] >= 0 else "no cell"
            says = "is stated, but" if only else "is not stated, though"
            raise PlanFault(f"{unit} {now}: errand {e[3]} of task {e[2]} by robot {e[1]} {says} the robot is at {where} with its schedule")


def _in_steps(problem: StepWiseProblem, solution: StepWiseSolution) -> Iterator[IntArray]:
    """[R] the cells of robots after each step, by the rules of 2024. Raises Fault."""
    ahead = cell_ahead(problem.free)
    cell, heading = problem.start.copy(), np.full(problem.num_robots, EAST)
    for now in range(1, solution.num_steps + 1):
        action, before = solution.action[:, now - 1], cell
        cell = np.where(action == FORWARD, ahead[before, heading], before)
        heading = (heading + (action == RIGHT) - (action == LEFT)) % 4
        _require_no_conflict(problem, now, before, cell)
        yield cell


def _require_no_conflict(problem: StepWiseProblem, now: int, before: IntArray, cell: IntArray) -> None:
    for r in np.flatnonzero(cell < 0):
        raise PlanFault(f"time {now}: robot {r} drives from {place_of(problem, int(before[r]))} into what is not free")
    order = np.argsort(cell, kind="stable")
    for k in np.flatnonzero(cell[order[1:]] == cell[order[:-1]]):
        place = place_of(problem, int(cell[order[k]]))
        raise PlanFault(f"time {now}: vertex conflict of robots {order[k]} and {order[k + 1]} at {place}")
    at = np.full(problem.free.size, -1, np.int64)
    at[before] = np.arange(len(before))
    other = at[cell]
    swap = (other >= 0) & (cell != before) & (cell[other] == before)
    for r in np.flatnonzero(swap):
        ends = f"{place_of(problem, int(before[r]))} and {place_of(problem, int(cell[r]))}"
        raise PlanFault(f"time {now}: edge conflict of robots {r} and {other[r]} between {ends}")


def _require_account(problem: StepWiseProblem, solution: StepWiseSolution, pool: Pool) -> None:
    if solution.released.tolist() != pool.released:
        num = f"{len(solution.released)} tasks are stated to be revealed, {len(pool.released)} are"
        wrong = [(k, a, b) for k, (a, b) in enumerate(zip(solution.released.tolist(), pool.released)) if a != b]
        raise PlanFault(f"task {wrong[0][0]} is stated to be revealed at time {wrong[0][1]}, but is at {wrong[0][2]}" if wrong else num)
    for k, cells in enumerate(solution.errands):
        if cells != tuple(problem.errands_of(k).tolist()):
            raise PlanFault(f"task {k} has other errands than the problem says")
    if solution.num_done != pool.num_finished:
        raise PlanFault(f"{solution.num_done} tasks are stated to be finished, {pool.num_finished} are")


def _named(task: int) -> str:
    return f"task {task}" if task != NOTHING else "no task"
