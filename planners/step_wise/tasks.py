"""Tasks of robots: the choices of step-wise planners.

`nearest` gives the robots that have not opened a task those tasks of the pool for which the sum of steps to their first errands is least.
Steps from there through all errands count, too, but less: a long task that is put off fills the pool, and has to be done in the end.
It decides again in each step, until tasks are opened (in large problems, every tenth step).
`in_turn` gives robot r of R the tasks r, r + R, r + 2 R, ...: as benchmarks do in which each robot has goals of its own.
"""

from typing import Literal

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.step_wise import NOTHING
from mrp_sumo.planning.step_wise import Observation
from planners.step_wise.ground import FAR, RESERVE, FreeCells

MOST_PAIRS = 200_000  # of robots and tasks; where there are more, in most steps only robots without a task are given one
MOST_AT_ONCE = 10_000_000  # pairs that are matched at once; where there are more, robots choose in groups, MOST_PAIRS at a time
THROUGH = 0.3  # of the steps through all errands of a task count beside those to its first one
PAUSE = 10  # steps from one decision on all robots to the next
Choice = Literal["nearest", "in_turn"]


class InTurn:
    """Each robot has tasks of its own."""

    def __init__(self, num_robots: int) -> None:
        self._next = np.arange(num_robots)

    def choose(self, seen: Observation, ground: FreeCells, state: IntArray) -> IntArray:
        """[R] the task of each robot, NOTHING while its next one is not in the pool."""
        idle = seen.task_of == NOTHING
        ready = idle & np.array([task in seen.pool for task in self._next.tolist()])
        task_of = np.where(ready, self._next, seen.task_of)
        self._next[ready] += len(self._next)
        return task_of


class NearestGoal:
    """The least sum of steps."""

    def choose(self, seen: Observation, ground: FreeCells, state: IntArray) -> IntArray:
        """[R] the task of each robot, NOTHING where there are not enough."""
        from scipy.optimize import linear_sum_assignment

        opened = np.array([task != NOTHING and seen.pool[task] > 0 for task in seen.task_of.tolist()], np.bool_)
        task_of = np.where(opened, seen.task_of, NOTHING)
        robots = np.flatnonzero(~opened)
        tasks = [task for task, done in seen.pool.items() if done == 0]
        if seen.time % PAUSE and len(robots) * len(tasks) > MOST_PAIRS:
            task_of, held = seen.task_of.copy(), set(seen.task_of.tolist())
            robots, tasks = np.flatnonzero(task_of == NOTHING), [task for task in tasks if task not in held]
        if not len(robots) or not tasks:
            return task_of
        through = np.array([ground.steps_left(task)[0] for task in tasks])
        first = np.array([ground.errands(task)[0] for task in tasks])
        slots = np.array([ground.slot(goal, RESERVE) for goal in first.tolist()])
        left = np.arange(len(tasks))
        at_once = len(robots) if len(robots) * len(tasks) <= MOST_AT_ONCE else max(1, MOST_PAIRS // len(tasks))
        for group in np.split(robots, range(at_once, len(robots), at_once)):
            goal, slot = first[left], slots[left]
            steps = ground.table[slot[:, None], state[group][None, :]].astype(np.int64)
            steps[slot < 0] = ground.apart(goal[slot < 0][:, None], state[group][None, :] >> 2)
            never = (steps == FAR) | (through[left][:, None] >= FAR)
            cost = np.where(never, 10 * FAR, steps + THROUGH * through[left][:, None])
            task, robot = linear_sum_assignment(cost)
            can_end = cost[task, robot] < FAR
            task, robot = task[can_end], robot[can_end]
            task_of[group[robot]] = np.array(tasks)[left[task]]
            left = np.delete(left, task)
        return task_of
