"""Kernels of large neighbourhood search over paths: take a few out, plan them again one by one, keep what is better.

Sources: Li, Chen, Harabor, Stuckey, Koenig, "Anytime multi-agent path finding via large neighborhood search",
IJCAI 2021 (`improve`: fewer steps, never a collision), and "MAPF-LNS2", AAAI 2022 (`repair`: fewer pairs of robots
in collision). Both choose among three kinds of neighbourhoods by how much each has gained lately.
"""

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.neighbourhood._collisions import collide, find_collisions, forget
from planners.neighbourhood._merging import keep_gain
from planners.neighbourhood._neighbourhoods import (
    DECAY,
    around_collision,
    around_failure,
    around_late,
    around_place,
    around_promising,
    fill_any,
    fill_by_hits,
    pick_kind,
)
from planners.neighbourhood._sipps import plan_one
from planners.neighbourhood._traffic import add_path, remove_path


@kernel(nogil=True)
def improve(task, traffic, labels, hood, gains, size, iterations, most_labels, rng):
    """Try to make paths without collisions shorter.

    Parameters
    ----------
    task, traffic, labels, hood
        The problem, the paths, room, room.
    gains
        Where the neighbourhoods that gained are noted; when it is full it stops. Without room nothing is.
    size
        Robots in a neighbourhood, at most K.
    iterations
        How often.
    most_labels
        Stop when `labels.stamp[1]` has come to this.
    rng
        Chance.

    Returns
    -------
    int
        Steps gained in the sum of costs.
    """
    gained = np.int64(0)
    horizon = traffic.at.shape[1]
    for _ in range(iterations):
        if labels.stamp[1] >= most_labels or 0 < len(gains.size) == gains.num[0]:
            break
        bandit = len(hood.tried) > 0
        kind = 0 if bandit else pick_kind(hood, rng)
        hood.chosen[:] = False
        if bandit:
            num = around_promising(task, traffic, hood, size, rng)
        elif kind == 0:
            num = around_late(task, traffic, hood, size, rng)
        elif kind == 1:
            num = around_place(task, traffic, hood, size, rng)
        else:
            num = fill_any(hood, 0, size, rng)
        seed = hood.robot[0]
        slack = np.int64(0)
        for k in range(num):
            robot = hood.robot[k]
            slack += traffic.end[robot] - task.least[robot]
        gain = np.int64(0)
        if slack > 0:
            _take_out(task, traffic, hood, num, rng)
            gain = slack
            planned = 0
            while planned < num:
                robot = hood.robot[planned]
                least = task.least[robot]
                limit = min(least + gain, horizon - 2)
                end = plan_one(
                    task.first, task.head, task.reverse, traffic, labels, robot,
                    task.start[robot], task.goal[robot], task.least[robot], task.steps[robot], task.code[robot],
                    limit, False, len(labels.vertex),
                )  # fmt: skip
                if end < 0:
                    break
                gain -= end - least
                add_path(task, traffic, robot)
                planned += 1
            if planned < num:
                gain = 0
                _put_back(task, traffic, hood, num, planned)
        gained += gain
        if gain > 0 and len(gains.size) > 0:
            keep_gain(traffic, gains, hood.robot, num)
        if bandit:
            hood.tried[seed, 1 if gain > 0 else 0] += 1
        hood.record[kind] = (1 - DECAY) * hood.record[kind] + DECAY * max(gain, 0.05)
    return gained


@kernel
def plan_all(task, traffic, labels, order, begin, end, clear):
    """Plan robots order[begin:end] one after another, crossing others where it has to be. False when one has no path or room.

    Where most have a path `clear` of all others it is sooner found by a search for such a path alone: both are as short.
    """
    for k in range(begin, end):
        robot = order[k]
        arrival = _plan(task, traffic, labels, robot, False) if clear else np.int64(-1)
        if arrival < 0:
            arrival = _plan(task, traffic, labels, robot, True)
        if arrival < 0:
            return False
        add_path(task, traffic, robot)
    return True


@kernel
def _plan(task, traffic, labels, robot, crossing):
    """The arrival of a robot's best path; -1 where it has none."""
    return plan_one(
        task.first, task.head, task.reverse, traffic, labels, robot,
        task.start[robot], task.goal[robot], task.least[robot], task.steps[robot], task.code[robot],
        traffic.at.shape[1] - 2, crossing, len(labels.vertex),
    )  # fmt: skip


@kernel
def repair_each(task, traffic, labels, hood, pairs, rng):
    """Plan each robot in collision again, the one in most pairs first, while any of the `pairs` is left.

    So a robot that is at a goal where others have to pass plans after them.
    """
    hood.chosen[:] = False
    while pairs > 0:
        robot, most = np.int64(-1), np.int64(0)
        for other in range(len(hood.chosen)):
            if not hood.chosen[other] and hood.num_hits[other] > most:
                robot, most = np.int64(other), hood.num_hits[other]
        if robot < 0:
            break
        hood.chosen[robot] = True
        hood.robot[0] = robot
        forget(hood, robot)
        _take_out(task, traffic, hood, 1, rng)
        if _plan(task, traffic, labels, robot, True) >= 0:
            add_path(task, traffic, robot)
        else:
            _put_back(task, traffic, hood, 1, 0)
        pairs += collide(task, traffic, hood, robot) - most


@kernel
def repair(task, traffic, labels, hood, size, pairs, iterations, rng):
    """Try to bring down the number of pairs in collision, `pairs`; what is left of it."""
    rings = not traffic.rotations and not traffic.following
    for _ in range(iterations):
        if pairs == 0:
            break
        kind = pick_kind(hood, rng)
        hood.chosen[:] = False
        if kind == 0:
            num = around_collision(task, traffic, hood, size, rng)
        elif kind == 1:
            num = around_failure(task, traffic, hood, size, rng)
        else:
            num = fill_by_hits(hood, 0, size, rng)
        old = np.int64(0)
        for k in range(num):
            old += forget(hood, hood.robot[k])
        new = np.int64(0)
        if old > 0:
            _take_out(task, traffic, hood, num, rng)
            planned = 0
            while planned < num:
                robot = hood.robot[planned]
                end = _plan(task, traffic, labels, robot, True)
                if end < 0:
                    break
                add_path(task, traffic, robot)
                new += collide(task, traffic, hood, robot)
                planned += 1
                if new > old:
                    break
            if planned < num or new > old:
                for k in range(planned):
                    forget(hood, hood.robot[k])
                _put_back(task, traffic, hood, num, planned)
                new = np.int64(0)
                for k in range(num):
                    new += collide(task, traffic, hood, hood.robot[k])
        pairs += new - old
        hood.record[kind] = (1 - DECAY) * hood.record[kind] + DECAY * max(old - new, 0.05)
        if pairs == 0 and rings:
            pairs = find_collisions(task, traffic, hood)
    return pairs


@kernel
def _take_out(task, traffic, hood, num, rng):
    """Save and remove the chosen robots' paths, and shuffle the robots."""
    for k in range(num):
        other = np.int64(rng.random() * (num - k)) + k
        hood.robot[k], hood.robot[other] = hood.robot[other], hood.robot[k]
        robot = hood.robot[k]
        hood.saved[k] = traffic.at[robot]
        hood.saved_end[k] = traffic.end[robot]
        remove_path(task, traffic, robot)
        traffic.end[robot] = -1  # its row of `at` is out of date until it is planned


@kernel
def _put_back(task, traffic, hood, num, planned):
    """Undo: the first `planned` robots have new paths in the traffic, the others none."""
    for k in range(planned):
        remove_path(task, traffic, hood.robot[k])
        traffic.end[hood.robot[k]] = -1
    for k in range(num):
        robot = hood.robot[k]
        traffic.at[robot] = hood.saved[k]
        traffic.end[robot] = hood.saved_end[k]
        add_path(task, traffic, robot)
