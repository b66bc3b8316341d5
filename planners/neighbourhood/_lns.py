"""Kernels of large neighbourhood search over paths: take a few out, plan them again one by one, keep what is better.

Sources: Li, Chen, Harabor, Stuckey, Koenig, "Anytime multi-agent path finding via large neighborhood search",
IJCAI 2021 (`improve`: fewer steps, never a collision), and "MAPF-LNS2", AAAI 2022 (`repair`: fewer pairs of robots
in collision). Both choose among three kinds of neighbourhoods by how much each has gained lately.

Several threads work on copies of the same paths, and bring together what they have gained: Chan, Chen, Lin, Zhang, Harabor, Huang, Koenig,
Phan, "Anytime multi-agent path finding using operation parallelism in large neighborhood search", AAMAS 2024 (DROP-LNS), where
neighbourhoods are replanned concurrently and update one best solution. There threads do so as they come; here they do in rounds and in
order, so that chance and work decide the outcome and the scheduler does not.
"""

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.neighbourhood._neighbourhoods import (
    DECAY,
    around_collision,
    around_failure,
    around_late,
    around_place,
    around_promising,
    collide,
    fill_any,
    fill_by_hits,
    find_collisions,
    forget,
    pick_kind,
)
from planners.neighbourhood._sipps import plan_one, plan_straight
from planners.neighbourhood._traffic import add_path, closes_ring, lane_between, remove_path


@kernel(nogil=True)
def improve(traffic, labels, hood, gains, iterations, most_labels, rng):
    """Try to make paths without collisions shorter.

    Parameters
    ----------
    traffic, labels, hood
        The paths, room, room.
    gains
        Where the neighbourhoods that gained are noted; when it is full it stops. Without room nothing is.
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
    task, gained = traffic.task, np.int64(0)
    for _ in range(iterations):
        if labels.stamp[1] >= most_labels or 0 < len(gains.size) == gains.num[0]:
            break
        bandit = len(hood.tried) > 0
        kind = 0 if bandit else pick_kind(hood, rng)
        hood.chosen[:] = False
        if bandit:
            num = around_promising(traffic, hood, rng)
        elif kind == 0:
            num = around_late(traffic, hood, rng)
        elif kind == 1:
            num = around_place(traffic, hood, rng)
        else:
            num = fill_any(hood, 0, rng)
        seed, gain = hood.robot[0], np.int64(0)
        for k in range(num):
            gain += traffic.end[hood.robot[k]] - task.least[hood.robot[k]]
        if gain > 0:
            _shuffle(hood, num, rng)
            _take_out(traffic, hood, num)
            planned = 0
            while planned < num:
                robot = hood.robot[planned]
                end = plan_one(traffic, labels, robot, min(task.least[robot] + gain, traffic.at.shape[1] - 2), False)
                if end < 0:
                    break
                gain -= end - task.least[robot]
                add_path(traffic, robot)
                planned += 1
            if planned < num:
                gain = 0
                _put_back(traffic, hood, num, planned)
        gained += gain
        if gain > 0 and len(gains.size) > 0:
            _keep_gain(traffic, hood, gains, num)
        if bandit:
            hood.tried[seed, 1 if gain > 0 else 0] += 1
        hood.record[kind] = (1 - DECAY) * hood.record[kind] + DECAY * max(gain, 0.05)
    return gained


@kernel
def plan_all(traffic, labels, robots, clear):
    """Plan robots one after another, crossing others where it has to be. False when one has no path or room.

    Where most have a path `clear` of all others it is sooner found by a search for such a path alone: both are as short. Where
    tables are packed and hashed, for many robots on large maps, one as short as the shortest way is looked for before.
    """
    latest = traffic.at.shape[1] - 2
    for robot in robots:
        if traffic.task.steps.shape[1] == 0 and len(traffic.on.key) > 0 and plan_straight(traffic, labels, robot):
            add_path(traffic, robot)
            continue
        arrival = plan_one(traffic, labels, robot, latest, False) if clear else np.int64(-1)
        if arrival < 0:
            arrival = plan_one(traffic, labels, robot, latest, True)
        if arrival < 0:
            return False
        add_path(traffic, robot)
    return True


@kernel
def repair_each(traffic, labels, hood, pairs, rng):
    """Plan each robot in collision again, the one in most pairs first, while any of the `pairs` is left; how many are.

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
        _shuffle(hood, 1, rng)
        _take_out(traffic, hood, 1)
        if plan_one(traffic, labels, robot, traffic.at.shape[1] - 2, True) >= 0:
            add_path(traffic, robot)
        else:
            _put_back(traffic, hood, 1, 0)
        pairs += collide(traffic, hood, robot, traffic.at.shape[1]) - most
    return find_collisions(traffic, hood) if traffic.task.rings else pairs


@kernel
def repair(traffic, labels, hood, pairs, iterations, rng):
    """Try to bring down the number of pairs in collision, `pairs`; what is left of it."""
    for _ in range(iterations):
        if pairs == 0:
            break
        kind = pick_kind(hood, rng)
        hood.chosen[:] = False
        if kind == 0:
            num = around_collision(traffic, hood, rng)
        elif kind == 1:
            num = around_failure(traffic, hood, rng)
        else:
            num = fill_by_hits(hood, len(hood.saved), rng)
        old = np.int64(0)
        for k in range(num):
            old += forget(hood, hood.robot[k])
        new = np.int64(0)
        if old > 0:
            _shuffle(hood, num, rng)
            _take_out(traffic, hood, num)
            planned = 0
            while planned < num:
                robot = hood.robot[planned]
                if plan_one(traffic, labels, robot, traffic.at.shape[1] - 2, True) < 0:
                    break
                add_path(traffic, robot)
                new += collide(traffic, hood, robot, traffic.at.shape[1])
                planned += 1
                if new > old:
                    break
            if planned < num or new > old:
                for k in range(planned):
                    forget(hood, hood.robot[k])
                _put_back(traffic, hood, num, planned)
                new = np.int64(0)
                for k in range(num):
                    new += collide(traffic, hood, hood.robot[k], traffic.at.shape[1])
        pairs += new - old
        hood.record[kind] = (1 - DECAY) * hood.record[kind] + DECAY * max(old - new, 0.05)
        if pairs == 0 and traffic.task.rings:
            pairs = find_collisions(traffic, hood)
    return pairs


@kernel
def _shuffle(hood, num, rng):
    """Put the chosen robots in any order."""
    for k in range(num):
        other = np.int64(rng.random() * (num - k)) + k
        hood.robot[k], hood.robot[other] = hood.robot[other], hood.robot[k]


@kernel
def _copy(path, row):
    """Write a path to a row, step by step: numba makes a copy of a whole row first, lest the two overlap."""
    for t in range(len(path)):
        row[t] = path[t]


@kernel
def _take_out(traffic, hood, num):
    """Save and remove the chosen robots' paths."""
    for k in range(num):
        robot = hood.robot[k]
        _copy(traffic.at[robot], hood.saved[k])
        hood.saved_end[k] = traffic.end[robot]
        remove_path(traffic, robot)
        traffic.end[robot] = -1  # its row of `at` is out of date until it is planned


@kernel
def _put_back(traffic, hood, num, planned):
    """Undo: the first `planned` robots have new paths in the traffic, the others none."""
    for k in range(planned):
        remove_path(traffic, hood.robot[k])
        traffic.end[hood.robot[k]] = -1
    for k in range(num):
        robot = hood.robot[k]
        _copy(hood.saved[k], traffic.at[robot])
        traffic.end[robot] = hood.saved_end[k]
        add_path(traffic, robot)


@kernel
def _keep_gain(traffic, hood, gains, num):
    """Note the new paths of the first `num` robots of the neighbourhood."""
    n = gains.num[0]
    gains.num[0] += 1
    gains.size[n] = num
    for k in range(num):
        robot = hood.robot[k]
        gains.robot[n, k], gains.end[n, k] = robot, traffic.end[robot]
        _copy(traffic.at[robot], gains.at[n, k])


@kernel(nogil=True)
def take_over(traffic, hood, gains):
    """Replan by another's gains, those that still are gains and cross nobody here; how many do."""
    taken = 0
    for n in range(gains.num[0]):
        num, gain = gains.size[n], np.int64(0)
        for k in range(num):
            hood.robot[k] = gains.robot[n, k]
            gain += traffic.end[gains.robot[n, k]] - gains.end[n, k]
        if gain <= 0:
            continue
        _take_out(traffic, hood, num)
        entered = 0
        while entered < num:
            robot = hood.robot[entered]
            _copy(gains.at[n, entered], traffic.at[robot])
            if not _is_free(traffic, robot):
                break
            traffic.end[robot] = gains.end[n, entered]
            add_path(traffic, robot)
            entered += 1
        if entered == num:
            taken += 1
        else:
            _put_back(traffic, hood, num, entered)
    return taken


@kernel
def _is_free(traffic, robot):
    """Whether a robot that is not in the traffic could follow its row of `at` without crossing anybody."""
    task, spots = traffic.task, traffic.task.spots
    at = traffic.at[robot]
    before = spots.of[at[0]]
    for t in range(traffic.window):
        v = spots.of[at[t]]
        if (traffic.busy[v, t >> 5] >> (t & 31)) & 1:
            return False
        if v != before:
            move = lane_between(spots.first, spots.head, before, v)
            back = task.spots.back[move]
            if back >= 0 and (traffic.along[t >> 5, back] >> (t & 31)) & 1:
                return False
            if len(traffic.num_near) > 1 and (traffic.barred[move, t >> 5] >> (t & 31)) & 1:
                return False
            if traffic.task.following and (traffic.busy[before, t >> 5] >> (t & 31)) & 1:
                return False
            if task.rings and closes_ring(traffic, before, v, t):
                return False
        before = v
    return True


@kernel(nogil=True)
def catch_up(traffic, hood, best):
    """Replan all whose paths are others in the traffic `best`."""
    task = traffic.task
    steps = traffic.at.shape[1]
    for robot in range(len(task.goal)):
        t = steps - 1  # they mostly differ late, if at all
        while t >= 0 and traffic.at[robot, t] == best.at[robot, t]:
            t -= 1
        hood.chosen[robot] = t >= 0
        if t >= 0:
            remove_path(traffic, robot)
            traffic.end[robot] = -1
    for robot in range(len(task.goal)):
        if hood.chosen[robot]:
            _copy(best.at[robot], traffic.at[robot])
            traffic.end[robot] = best.end[robot]
            add_path(traffic, robot)
