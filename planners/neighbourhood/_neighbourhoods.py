"""Neighbourhoods, robots that are planned again together: those in collision, and kinds, chosen by what each has gained lately.

Sources: Li, Chen, Harabor, Stuckey, Koenig, "Anytime multi-agent path finding via large neighborhood search", IJCAI
2021 (a robot that is late and those in its way; robots about one place; any), and "MAPF-LNS2", AAAI 2022 (robots in
collision and those in their way). Phan, Zhang, Chan, Koenig, "Anytime multi-agent path finding with an adaptive delay-based heuristic",
AAAI 2025 (ADDRESS: which of the latest robots, by Thompson sampling of what each has been good for).
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._clashing import move_of
from mrp_sumo.search._kernel import kernel
from planners.neighbourhood._sipps import steps_from
from planners.neighbourhood._traffic import RepairTask, anyone_at, anyone_in, closes_ring, holds, lane_between, num_in

DECAY = 0.01  # of a neighbourhood kind's record
LATEST = 32  # robots that a bandit chooses from


class Gains(NamedTuple):
    """Neighbourhoods whose paths became shorter, in order. Room for N of K robots over T steps; [0, ...] where nobody asks for them."""

    num: np.ndarray  # [1] int64 how many there are
    size: np.ndarray  # [N] int64 robots in each
    robot: np.ndarray  # [N, K] int64
    end: np.ndarray  # [N, K] int64 when they arrive now
    at: np.ndarray  # [N, K, T] int32 their new paths


class Neighbourhood(NamedTuple):
    """Room for K robots taken out of R, over T steps."""

    robot: np.ndarray  # [K] int64
    chosen: np.ndarray  # [R] bool
    saved: np.ndarray  # [K, T] int32 their old paths
    saved_end: np.ndarray  # [K] int64
    record: np.ndarray  # [3] float64 what each kind has gained lately
    queue: np.ndarray  # [R] int64
    hit: np.ndarray  # [R, R] bool pairs in collision, [1, 1] when there can be none
    num_hits: np.ndarray  # [R] int64 of each robot
    tried: np.ndarray  # [R, 2] float64 how often the neighbourhood of each robot did not gain, and did; [0, 2] without a bandit
    latest: np.ndarray  # [LATEST] int64


@kernel
def find_collisions(traffic, hood):
    """Fill `hit`; the number of pairs."""
    task = traffic.task
    for robot in range(len(task.goal)):  # pairs are noted for both
        if hood.num_hits[robot] > 0:
            hood.hit[robot, :] = False
    hood.num_hits[:] = 0
    pairs = 0
    for robot in range(len(task.goal)):
        pairs += collide(traffic, hood, robot, traffic.at.shape[1] if task.clashes.any else traffic.end[robot] + 1)
    return pairs


@kernel
def collide(traffic, hood, robot, until):
    """Enter the pairs of a robot whose path is in the traffic, before a step; how many were not known.

    Who passes a robot that stays at its goal sees it, too.

    Of a ring the robot and the one ahead of it are such a pair. It stays one until one of the two is planned again,
    also when the ring is broken elsewhere; and where several hold a vertex only one of them is followed. So rings have
    to be looked for again when no pair is left.
    """
    task, spots = traffic.task, traffic.task.spots
    new = 0
    before = np.int64(-1)
    for t in range(until):
        v = spots.of[traffic.at[robot, t]]
        if num_in(traffic.on, v, t) > 1:
            new += _hit_holders(traffic, hood, robot, v, t)
        if t > 0 and v != before:
            if traffic.task.following and num_in(traffic.on, before, t) > 1:
                new += _hit_holders(traffic, hood, robot, before, t)
            back = lane_between(spots.first, spots.head, v, before)
            if back >= 0 and (traffic.along[t >> 5, back] >> (t & 31)) & 1:
                for other in range(len(traffic.at)):
                    crossed = spots.of[traffic.at[other, t]] == before and spots.of[traffic.at[other, t - 1]] == v
                    if crossed and traffic.end[other] >= 0 and not hood.hit[robot, other]:
                        new += _hit(hood, robot, other)
            ahead = anyone_at(traffic, v, t - 1) if task.rings else np.int64(-1)
            if ahead >= 0 and ahead != robot and not hood.hit[robot, ahead] and closes_ring(traffic, before, v, t):
                new += _hit(hood, robot, ahead)
        if task.clashes.any and t > 0:
            new += _hit_near(traffic, hood, robot, before, v, t)
        before = v
    return new


@kernel
def _hit_near(traffic, hood, robot, u, v, t):
    """Enter the pairs of a robot that goes from spot u to spot v, or waits, and all that come too close in that step, or to one place."""
    clashes, spots, new = traffic.task.clashes, traffic.task.spots, 0
    for k in range(spots.beside_first[v], spots.beside_first[v + 1]):
        if num_in(traffic.on, spots.beside[k], t) > 0:
            new += _hit_holders(traffic, hood, robot, spots.beside[k], t)
    move = move_of(spots.first, spots.head, u, v)
    for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
        w = clashes.vertex[k]
        for step in range(t - 1, t + 1):
            if num_in(traffic.on, w, step) > 0:
                new += _hit_holders(traffic, hood, robot, w, step)
    for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
        lane = clashes.lane[k]
        if (traffic.along[t >> 5, lane] >> (t & 31)) & 1:
            for other in range(len(traffic.at)):
                if other != robot and traffic.end[other] >= 0 and not hood.hit[robot, other]:
                    at = traffic.at[other]
                    if spots.of[at[t]] == spots.head[lane] and spots.of[at[t - 1]] == spots.tail[lane]:
                        new += _hit(hood, robot, other)
    return new


@kernel
def _hit_holders(traffic, hood, robot, v, t):
    """Enter the pairs of a robot and all others that hold a spot at a step."""
    new = 0
    for other in range(len(traffic.at)):
        if other != robot and not hood.hit[robot, other] and holds(traffic, other, v, t):
            new += _hit(hood, robot, other)
    return new


@kernel
def _hit(hood, robot, other):
    hood.hit[robot, other] = True
    hood.hit[other, robot] = True
    hood.num_hits[robot] += 1
    hood.num_hits[other] += 1
    return 1


@kernel
def forget(hood, robot):
    """Drop the pairs of a robot; how many there were."""
    num = hood.num_hits[robot]
    if num > 0:
        for other in range(len(hood.num_hits)):
            if hood.hit[robot, other]:
                hood.hit[robot, other] = False
                hood.hit[other, robot] = False
                hood.num_hits[other] -= 1
        hood.num_hits[robot] = 0
    return num


@kernel
def pick_kind(hood, rng):
    x = rng.random() * (hood.record[0] + hood.record[1] + hood.record[2])
    if x < hood.record[0]:
        return 0
    return 1 if x < hood.record[0] + hood.record[1] else 2


@kernel
def _choose(hood, num, robot):
    """Add a robot to the neighbourhood unless it is in it or that is full; how many there are then."""
    if num >= len(hood.robot) or hood.chosen[robot]:
        return num
    hood.chosen[robot] = True
    hood.robot[num] = robot
    return num + 1


@kernel
def fill_any(hood, num, rng):
    """Fill up with any robots."""
    while num < len(hood.robot):
        num = _choose(hood, num, np.int64(rng.random() * len(hood.chosen)))
    return num


@kernel
def fill_by_hits(hood, size, rng):
    """Fill up to a size with robots by the number of their collisions."""
    num, num_robots, total = 0, len(hood.chosen), np.int64(0)
    for robot in range(num_robots):
        total += hood.num_hits[robot] + 1
    for _ in range(4 * size):
        if num >= min(size, num_robots):
            return num
        x = np.int64(rng.random() * total)
        robot = 0
        while x >= hood.num_hits[robot] + 1:
            x -= hood.num_hits[robot] + 1
            robot += 1
        num = _choose(hood, num, np.int64(robot))
    while num < min(size, num_robots):
        num = _choose(hood, num, np.int64(rng.random() * num_robots))
    return num


@kernel
def around_late(traffic, hood, rng):
    """A robot that is late, and those met on random walks that would bring it home earlier."""
    task = traffic.task
    num_robots = len(task.goal)
    late, latest = np.int64(0), np.int64(-1)
    for _ in range(1 + num_robots // 16):
        robot = np.int64(rng.random() * num_robots)
        delay = traffic.end[robot] - task.least[robot]
        if delay > latest:
            late, latest = robot, delay
    return _fill_around(traffic, hood, late, rng)


@kernel
def around_promising(traffic, hood, rng):
    """One of the latest robots, by Thompson sampling (Beta posteriors of its successes), and those met on random walks.

    The robot comes first in `hood.robot`.
    """
    task = traffic.task
    num_late = 0
    for robot in range(len(task.goal)):  # the latest by insertion
        delay = traffic.end[robot] - task.least[robot]
        k = min(num_late, LATEST - 1)
        if delay <= 0 or (num_late == LATEST and delay <= traffic.end[hood.latest[k]] - task.least[hood.latest[k]]):
            continue
        num_late = min(num_late + 1, LATEST)
        while k > 0 and delay > traffic.end[hood.latest[k - 1]] - task.least[hood.latest[k - 1]]:
            hood.latest[k] = hood.latest[k - 1]
            k -= 1
        hood.latest[k] = robot
    best, most = np.int64(rng.random() * len(task.goal)), -1.0
    for k in range(num_late):
        robot = hood.latest[k]
        promise = rng.beta(1.0 + hood.tried[robot, 1], 1.0 + hood.tried[robot, 0])
        if promise > most:
            best, most = robot, promise
    return _fill_around(traffic, hood, best, rng)


@kernel
def _fill_around(traffic, hood, late, rng):
    """A robot, those met on random walks that would bring it home earlier, and any."""
    num = _choose(hood, 0, late)
    for _ in range(10):
        if num >= len(hood.robot):
            break
        robot = hood.robot[np.int64(rng.random() * num)] if rng.random() < 0.5 else late
        num = _walk(traffic, hood, num, robot, traffic.end[robot], rng)
    return fill_any(hood, num, rng)


@kernel
def _walk(traffic, hood, num, robot, before, rng):
    """Walk from a random step of a robot's path, so that it could still arrive `before`; choose whom it meets."""
    task, spots = traffic.task, traffic.task.spots
    if traffic.end[robot] <= 0:
        return num
    t = np.int64(rng.random() * traffic.end[robot])
    v = np.int64(traffic.at[robot, t])
    to_go = _to_go(traffic, robot, t)
    for _ in range(traffic.at.shape[1]):
        if num >= len(hood.robot) or t + 2 >= traffic.at.shape[1]:
            break
        a, b = task.first[v], task.first[v + 1]
        count = b - a + 1
        shift = np.int64(rng.random() * count)
        moved = False
        for k in range(count):
            at = a + (k + shift) % count
            u = task.head[at] if at < b else v
            onward = steps_from(task.steps[robot], task.code[robot], v, u, to_go)
            if t + 1 + onward >= before:
                continue
            moved, there = True, spots.of[u]
            if (traffic.busy[there, (t + 1) >> 5] >> ((t + 1) & 31)) & 1:
                num = _choose_about(traffic, hood, num, there, t + 1)
            back = spots.back[spots.move[at]] if at < b else -1
            if num < len(hood.robot) and back >= 0 and (traffic.along[(t + 1) >> 5, back] >> ((t + 1) & 31)) & 1:
                num = _choose_on(traffic, hood, num, spots.of[v], t + 1)
            v, to_go = u, onward
            break
        if not moved:
            break
        t += 1
    return num


@kernel
def _to_go(traffic, robot, t):
    """Steps to a robot's goal from where it is at t."""
    task = traffic.task
    if task.steps.shape[1] > 0:
        return np.int64(task.steps[robot, traffic.at[robot, t]])
    to_go, at = task.least[robot], traffic.at[robot]
    for step in range(t):
        to_go = steps_from(task.steps[robot], task.code[robot], np.int64(at[step]), np.int64(at[step + 1]), to_go)
    return to_go


@kernel
def _choose_on(traffic, hood, num, v, t):
    """Choose the robots that hold a spot at a step."""
    there = num_in(traffic.on, v, t)
    if there == 1 and num < len(hood.robot):
        return _choose(hood, num, anyone_in(traffic.on, v, t))
    if there > 1:
        for robot in range(len(traffic.at)):
            if num < len(hood.robot) and holds(traffic, robot, v, t):
                num = _choose(hood, num, np.int64(robot))
    return num


@kernel
def _choose_about(traffic, hood, num, v, t):
    """Choose the robots that hold a spot at a step, or stand too close to it."""
    clashes, spots = traffic.task.clashes, traffic.task.spots
    num = _choose_on(traffic, hood, num, v, t)
    for k in range(spots.beside_first[v], spots.beside_first[v + 1]):
        num = _choose_on(traffic, hood, num, spots.beside[k], t)
    if clashes.any:
        move = len(spots.head) + v
        for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
            num = _choose_on(traffic, hood, num, clashes.vertex[k], t)
        for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
            if num < len(hood.robot) and (traffic.along[t >> 5, clashes.lane[k]] >> (t & 31)) & 1:
                num = _choose_on(traffic, hood, num, spots.head[clashes.lane[k]], t)
    return num


@kernel
def around_place(traffic, hood, rng):
    """Robots that are about a place at about one time: around a random robot's position at a random step."""
    task = traffic.task
    num_robots = len(traffic.at)
    robot = np.int64(rng.random() * num_robots)
    t = np.int64(rng.random() * (traffic.end[robot] + 1))
    num = _choose(hood, 0, robot)
    begin, end = 0, 1
    hood.queue[0] = traffic.at[robot, t]
    while begin < end and num < len(hood.robot):
        v = hood.queue[begin]
        begin += 1
        here = task.spots.of[v]
        for d in range(-3, 4):
            if 0 <= t + d < traffic.at.shape[1] and (traffic.busy[here, (t + d) >> 5] >> ((t + d) & 31)) & 1:
                num = _choose_about(traffic, hood, num, here, t + d)
        a, b = task.first[v], task.first[v + 1]
        shift = np.int64(rng.random() * (b - a)) if b > a else np.int64(0)
        for k in range(b - a):
            if end < len(hood.queue):  # vertices may come twice: that is cheaper than to remember them
                hood.queue[end] = task.head[a + (k + shift) % (b - a)]
                end += 1
    return fill_any(hood, num, rng)


@kernel
def around_collision(traffic, hood, rng):
    """Robots of one component of the graph of collisions: all, and whom they meet on walks, or some on a random walk in it."""
    task = traffic.task
    num_robots = len(task.goal)
    root = np.int64(rng.random() * num_robots)
    while hood.num_hits[root] == 0:
        root = (root + 1) % num_robots
    num = _choose(hood, 0, root)
    k = 0
    while k < num and num < len(hood.robot):  # breadth first, others in a random rotation
        shift = np.int64(rng.random() * num_robots)
        for j in range(num_robots):
            other = (j + shift) % num_robots
            if hood.hit[hood.robot[k], other] and num < len(hood.robot):
                num = _choose(hood, num, other)
        k += 1
    for _ in range(10):
        if num >= len(hood.robot):
            break
        robot = hood.robot[np.int64(rng.random() * num)]
        num = _walk(traffic, hood, num, robot, np.int64(traffic.at.shape[1]), rng)
    return fill_any(hood, num, rng)


@kernel
def around_failure(traffic, hood, rng):
    """A robot in collision, those that stand for good on its way, and those that pass its goal after it."""
    task, spot_of = traffic.task, traffic.task.spots.of
    num = fill_by_hits(hood, 1, rng)
    robot = hood.robot[0]
    if task.steps.shape[1] > 0:
        num = _fill_by_goals_on_the_way(traffic, hood, num, robot, rng)
    else:  # steps between other places are not known: those that it meets
        for t in range(traffic.end[robot]):
            here = spot_of[traffic.at[robot, t]]
            if num < len(hood.robot) and num_in(traffic.on, here, t) > 1:
                num = _choose_on(traffic, hood, num, here, t)
    for t in range(traffic.end[robot], traffic.at.shape[1]):
        if num >= len(hood.robot):
            break
        if num_in(traffic.on, spot_of[task.goal[robot]], t) > 1:
            num = _choose_on(traffic, hood, num, spot_of[task.goal[robot]], t)
    return fill_any(hood, num, rng)


@kernel
def _fill_by_goals_on_the_way(traffic, hood, num, robot, rng):
    """Those that are at their goals before the robot is at its own, if their goals are on a shortest way of the robot."""
    task = traffic.task
    num_robots = len(task.goal)
    shift = np.int64(rng.random() * num_robots)
    for j in range(num_robots):
        other = (j + shift) % num_robots
        if num >= len(hood.robot):
            break
        end = traffic.end[other]
        blocks = end <= traffic.end[robot] and task.least[robot] == (
            task.steps[robot, task.goal[other]] + task.steps[other, task.start[robot]]
        )
        if other != robot and blocks:
            num = _choose(hood, num, other)
    return num


def room_for_hood(task: RepairTask, horizon: int, size: int, *, with_hits: bool, bandit: bool = False) -> Neighbourhood:
    """Room for neighbourhoods of `size`, and for pairs in collision if there can be any."""
    num_robots = len(task.goal)
    hits = num_robots if with_hits else 1
    return Neighbourhood(
        robot=np.zeros(min(size, num_robots), np.int64),
        chosen=np.zeros(num_robots, np.bool_),
        saved=np.zeros((size, horizon), np.int32),
        saved_end=np.zeros(size, np.int64),
        record=np.ones(3, np.float64),
        queue=np.zeros(max(num_robots, 256), np.int64),
        hit=np.zeros((hits, hits), np.bool_),
        num_hits=np.zeros(num_robots, np.int64),
        tried=np.zeros((num_robots if bandit else 0, 2), np.float64),
        latest=np.zeros(LATEST, np.int64),
    )


def room_for_gains(task: RepairTask, most: int, size: int, horizon: int) -> Gains:
    """Room for so many neighbourhoods of `size` robots over `horizon` steps."""
    shape = most, min(size, len(task.goal))
    return Gains(
        num=np.zeros(1, np.int64),
        size=np.zeros(most, np.int64),
        robot=np.zeros(shape, np.int64),
        end=np.zeros(shape, np.int64),
        at=np.zeros((*shape, horizon), np.int32),
    )
