"""Kernels that bring together what several threads have gained on copies of the same paths.

Source: Chan, Chen, Lin, Zhang, Harabor, Huang, Koenig, Phan, "Anytime multi-agent path finding using operation parallelism in large
neighborhood search", AAMAS 2024 (DROP-LNS): neighbourhoods are replanned concurrently and update one best solution. There threads
do so as they come; here they do in rounds and in order, so that chance and work decide the outcome and the scheduler does not.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.neighbourhood._traffic import RepairTask, add_path, closes_ring, lane_between, remove_path


class Gains(NamedTuple):
    """Neighbourhoods whose paths became shorter, in order. Room for N of K robots over T steps; [0, ...] where nobody asks."""

    num: np.ndarray  # [1] int64 how many there are
    size: np.ndarray  # [N] int64 robots in each
    robot: np.ndarray  # [N, K] int64
    end: np.ndarray  # [N, K] int64 when they arrive now
    at: np.ndarray  # [N, K, T] int32 their new paths


@kernel
def keep_gain(traffic, gains, robots, num):
    """Note the new paths of the first `num` of `robots`."""
    n = gains.num[0]
    gains.num[0] += 1
    gains.size[n] = num
    for k in range(num):
        robot = robots[k]
        gains.robot[n, k] = robot
        gains.end[n, k] = traffic.end[robot]
        gains.at[n, k] = traffic.at[robot]


@kernel(nogil=True)
def take_over(task, traffic, hood, gains):
    """Replan by another's gains, those that still are gains and cross nobody here; how many do."""
    taken = 0
    for n in range(gains.num[0]):
        num = gains.size[n]
        gain = np.int64(0)
        for k in range(num):
            gain += traffic.end[gains.robot[n, k]] - gains.end[n, k]
        if gain <= 0:
            continue
        for k in range(num):
            robot = gains.robot[n, k]
            hood.saved[k] = traffic.at[robot]
            hood.saved_end[k] = traffic.end[robot]
            remove_path(task, traffic, robot)
            traffic.end[robot] = -1
        entered = 0
        while entered < num:
            robot = gains.robot[n, entered]
            traffic.at[robot] = gains.at[n, entered]
            if not _is_free(task, traffic, robot):
                break
            traffic.end[robot] = gains.end[n, entered]
            add_path(task, traffic, robot)
            entered += 1
        if entered == num:
            taken += 1
            continue
        for k in range(entered):
            remove_path(task, traffic, gains.robot[n, k])
        for k in range(num):
            robot = gains.robot[n, k]
            traffic.at[robot] = hood.saved[k]
            traffic.end[robot] = hood.saved_end[k]
            add_path(task, traffic, robot)
    return taken


@kernel(allocates=False)
def _is_free(task, traffic, robot):
    """Whether a robot that is not in the traffic could follow its row of `at` without crossing anybody."""
    at = traffic.at[robot]
    rings = not traffic.rotations and not traffic.following
    before = np.int64(at[0])
    for t in range(traffic.window):
        v = np.int64(at[t])
        if (traffic.busy[v, t >> 5] >> (t & 31)) & 1:
            return False
        if v != before:
            lane = lane_between(task.first, task.head, before, v)
            back = task.reverse[lane]
            if back >= 0 and (traffic.along[back, t >> 5] >> (t & 31)) & 1:
                return False
            if len(traffic.num_near) > 1 and (traffic.barred[lane, t >> 5] >> (t & 31)) & 1:
                return False
            if traffic.following and (traffic.busy[before, t >> 5] >> (t & 31)) & 1:
                return False
            if rings and closes_ring(traffic, before, v, t):
                return False
        before = v
    return True


@kernel(nogil=True)
def catch_up(task, traffic, hood, best):
    """Replan all whose paths are others in the traffic `best`."""
    steps = traffic.at.shape[1]
    for robot in range(len(task.goal)):
        t = steps - 1  # they mostly differ late, if at all
        while t >= 0 and traffic.at[robot, t] == best.at[robot, t]:
            t -= 1
        hood.chosen[robot] = t >= 0
        if t >= 0:
            remove_path(task, traffic, robot)
            traffic.end[robot] = -1
    for robot in range(len(task.goal)):
        if hood.chosen[robot]:
            traffic.at[robot] = best.at[robot]
            traffic.end[robot] = best.end[robot]
            add_path(task, traffic, robot)


def room_for_gains(task: RepairTask, most: int, size: int, horizon: int) -> Gains:
    """Room for so many neighbourhoods of `size` robots over `horizon` steps."""
    size = min(size, len(task.goal))
    return Gains(
        num=np.zeros(1, np.int64),
        size=np.zeros(most, np.int64),
        robot=np.zeros((most, size), np.int64),
        end=np.zeros((most, size), np.int64),
        at=np.zeros((most, size, horizon), np.int32),
    )
