"""Kernels of large neighbourhood search over paths: take a few out, plan them again one by one, keep what is better.

Sources: Li, Chen, Harabor, Stuckey, Koenig, "Anytime multi-agent path finding via large neighborhood search",
IJCAI 2021 (`improve`: fewer steps, never a collision), and "MAPF-LNS2", AAAI 2022 (`repair`: fewer pairs of robots
in collision). Both choose among three kinds of neighbourhoods by how much each has gained lately.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from planners._sipps import Labels, Traffic, add_path, lane_between, plan_one, remove_path

DECAY = 0.01  # of a neighbourhood kind's record


class Task(NamedTuple):
    """What does not change. V vertices, L lanes, R robots."""

    first: np.ndarray  # [V + 1] int64
    head: np.ndarray  # [L] int64
    reverse: np.ndarray  # [L] int64
    start: np.ndarray  # [R] int64
    goal: np.ndarray  # [R] int64
    steps: np.ndarray  # [R, V] int32 to each robot's goal


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


@njit(cache=True)
def enter_all(task, traffic):
    """Put all paths of `at` into the empty traffic."""
    for robot in range(len(task.goal)):
        add_path(task.first, task.head, traffic, robot)


@njit(cache=True)
def improve(task, traffic, labels, hood, size, iterations, most_labels, rng):
    """Try to make paths without collisions shorter.

    Parameters
    ----------
    task, traffic, labels, hood
        The problem, the paths, room, room.
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
    horizon = len(traffic.at)
    for _ in range(iterations):
        if labels.stamp[1] >= most_labels:
            break
        kind = _pick_kind(hood, rng)
        hood.chosen[:] = False
        if kind == 0:
            num = _around_late(task, traffic, hood, size, rng)
        elif kind == 1:
            num = _around_place(task, traffic, hood, size, rng)
        else:
            num = _fill_any(hood, 0, size, rng)
        slack = np.int64(0)
        for k in range(num):
            robot = hood.robot[k]
            slack += traffic.end[robot] - task.steps[robot, task.start[robot]]
        gain = np.int64(0)
        if slack > 0:
            _take_out(task, traffic, hood, num, rng)
            gain = slack
            planned = 0
            while planned < num:
                robot = hood.robot[planned]
                least = np.int64(task.steps[robot, task.start[robot]])
                limit = min(least + gain, horizon - 2)
                end = plan_one(
                    task.first, task.head, task.reverse, traffic, labels, robot,
                    task.start[robot], task.goal[robot], task.steps[robot], limit, False, len(labels.vertex),
                )  # fmt: skip
                if end < 0:
                    break
                gain -= end - least
                add_path(task.first, task.head, traffic, robot)
                planned += 1
            if planned < num:
                gain = 0
                _put_back(task, traffic, hood, num, planned)
        gained += gain
        hood.record[kind] = (1 - DECAY) * hood.record[kind] + DECAY * max(gain, 0.05)
    return gained


@njit(cache=True)
def plan_all(task, traffic, labels, order, begin, end):
    """Plan robots order[begin:end] one after another, crossing others where it has to be. False when one has no path or room."""
    for k in range(begin, end):
        robot = order[k]
        arrival = plan_one(
            task.first, task.head, task.reverse, traffic, labels, robot,
            task.start[robot], task.goal[robot], task.steps[robot], len(traffic.at) - 2, True, len(labels.vertex),
        )  # fmt: skip
        if arrival < 0:
            return False
        add_path(task.first, task.head, traffic, robot)
    return True


@njit(cache=True)
def scatter(task, traffic, labels, order, begin, end, margin, most):
    """Plan, or plan again, robots order[begin:end] on ways at most `margin` longer than the shortest that cross few others."""
    for k in range(begin, end):
        robot = order[k]
        again = traffic.end[robot] >= 0
        if again:
            remove_path(task.first, task.head, traffic, robot)
        limit = min(task.steps[robot, task.start[robot]] + margin, len(traffic.at) - 2)
        arrival = plan_one(
            task.first, task.head, task.reverse, traffic, labels, robot,
            task.start[robot], task.goal[robot], task.steps[robot], limit, True, most,
        )  # fmt: skip
        if again or arrival >= 0:
            add_path(task.first, task.head, traffic, robot)


@njit(cache=True)
def write_guide(traffic, guide):
    """[R, V] where each robot's path goes next from each vertex, the last time it is there; -1 elsewhere."""
    guide[:] = -1
    for robot in range(len(guide)):
        for t in range(1, traffic.end[robot] + 1):
            v = traffic.at[t - 1, robot]
            if traffic.at[t, robot] != v:
                guide[robot, v] = traffic.at[t, robot]


@njit(cache=True)
def find_collisions(task, traffic, hood):
    """Fill `hit`; the number of pairs."""
    hood.hit[:] = False
    hood.num_hits[:] = 0
    pairs = 0
    for robot in range(len(task.goal)):
        pairs += _collide(task, traffic, hood, robot)
    return pairs


@njit(cache=True)
def repair(task, traffic, labels, hood, size, pairs, iterations, rng):
    """Try to bring down the number of pairs in collision, `pairs`; what is left of it."""
    horizon = len(traffic.at)
    for _ in range(iterations):
        if pairs == 0:
            break
        kind = _pick_kind(hood, rng)
        hood.chosen[:] = False
        if kind == 0:
            num = _around_collision(task, traffic, hood, size, rng)
        elif kind == 1:
            num = _around_failure(task, traffic, hood, size, rng)
        else:
            num = _fill_by_hits(hood, 0, size, rng)
        old = np.int64(0)
        for k in range(num):
            old += _forget(hood, hood.robot[k])
        new = np.int64(0)
        if old > 0:
            _take_out(task, traffic, hood, num, rng)
            planned = 0
            while planned < num:
                robot = hood.robot[planned]
                end = plan_one(
                    task.first, task.head, task.reverse, traffic, labels, robot,
                    task.start[robot], task.goal[robot], task.steps[robot], horizon - 2, True, len(labels.vertex),
                )  # fmt: skip
                if end < 0:
                    break
                add_path(task.first, task.head, traffic, robot)
                new += _collide(task, traffic, hood, robot)
                planned += 1
                if new > old:
                    break
            if planned < num or new > old:
                for k in range(planned):
                    _forget(hood, hood.robot[k])
                _put_back(task, traffic, hood, num, planned)
                for k in range(num):
                    _collide(task, traffic, hood, hood.robot[k])
                new = old
        pairs += new - old
        hood.record[kind] = (1 - DECAY) * hood.record[kind] + DECAY * max(old - new, 0.05)
    return pairs


@njit(cache=True)
def _pick_kind(hood, rng):
    x = rng.random() * (hood.record[0] + hood.record[1] + hood.record[2])
    if x < hood.record[0]:
        return 0
    return 1 if x < hood.record[0] + hood.record[1] else 2


@njit(cache=True)
def _take_out(task, traffic, hood, num, rng):
    """Save and remove the chosen robots' paths, and shuffle the robots."""
    for k in range(num):
        other = np.int64(rng.random() * (num - k)) + k
        hood.robot[k], hood.robot[other] = hood.robot[other], hood.robot[k]
        robot = hood.robot[k]
        for t in range(len(traffic.at)):
            hood.saved[k, t] = traffic.at[t, robot]
        hood.saved_end[k] = traffic.end[robot]
        remove_path(task.first, task.head, traffic, robot)
        traffic.end[robot] = -1  # its column of `at` is out of date until it is planned


@njit(cache=True)
def _put_back(task, traffic, hood, num, planned):
    """Undo: the first `planned` robots have new paths in the traffic, the others none."""
    for k in range(planned):
        remove_path(task.first, task.head, traffic, hood.robot[k])
    for k in range(num):
        robot = hood.robot[k]
        for t in range(len(traffic.at)):
            traffic.at[t, robot] = hood.saved[k, t]
        traffic.end[robot] = hood.saved_end[k]
        add_path(task.first, task.head, traffic, robot)


@njit(cache=True)
def _choose(hood, num, robot):
    """Add a robot to the neighbourhood unless it is in it."""
    if hood.chosen[robot]:
        return num
    hood.chosen[robot] = True
    hood.robot[num] = robot
    return num + 1


@njit(cache=True)
def _fill_any(hood, num, size, rng):
    """Fill up with any robots."""
    num_robots = len(hood.chosen)
    size = min(size, num_robots)
    while num < size:
        num = _choose(hood, num, np.int64(rng.random() * num_robots))
    return num


@njit(cache=True)
def _fill_by_hits(hood, num, size, rng):
    """Fill up with robots by the number of their collisions."""
    num_robots = len(hood.chosen)
    total = np.int64(0)
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
    return _fill_any(hood, num, size, rng)


@njit(cache=True)
def _around_late(task, traffic, hood, size, rng):
    """A robot that is late, and those met on random walks that would bring it home earlier."""
    num_robots = len(task.goal)
    size = min(size, num_robots)
    late, latest = np.int64(0), np.int64(-1)
    for _ in range(1 + num_robots // 16):
        robot = np.int64(rng.random() * num_robots)
        delay = traffic.end[robot] - task.steps[robot, task.start[robot]]
        if delay > latest:
            late, latest = robot, delay
    num = _choose(hood, 0, late)
    for _ in range(10):
        if num >= size:
            break
        robot = hood.robot[np.int64(rng.random() * num)] if rng.random() < 0.5 else late
        num = _walk(task, traffic, hood, num, size, robot, traffic.end[robot], rng)
    return _fill_any(hood, num, size, rng)


@njit(cache=True)
def _walk(task, traffic, hood, num, size, robot, before, rng):
    """Walk from a random step of a robot's path, so that it could still arrive `before`; choose whom it meets."""
    if traffic.end[robot] <= 0:
        return num
    t = np.int64(rng.random() * traffic.end[robot])
    v = np.int64(traffic.at[t, robot])
    for _ in range(len(traffic.at)):
        if num >= size or t + 2 >= len(traffic.at):
            break
        a, b = task.first[v], task.first[v + 1]
        count = b - a + 1
        shift = np.int64(rng.random() * count)
        moved = False
        for k in range(count):
            at = a + (k + shift) % count
            u = task.head[at] if at < b else v
            if t + 1 + task.steps[robot, u] >= before:
                continue
            moved = True
            if (traffic.busy[u, (t + 1) >> 5] >> ((t + 1) & 31)) & 1:
                num = _choose_on(traffic, hood, num, size, u, t + 1)
            if num < size and at < b and task.reverse[at] >= 0:
                back = task.reverse[at]
                if (traffic.along[back, (t + 1) >> 5] >> ((t + 1) & 31)) & 1:
                    num = _choose_on(traffic, hood, num, size, v, t + 1)
            v = u
            break
        if not moved:
            break
        t += 1
    return num


@njit(cache=True)
def _choose_on(traffic, hood, num, size, v, t):
    """Choose the robots on a vertex at a step."""
    for robot in range(traffic.at.shape[1]):
        if traffic.at[t, robot] == v and num < size:
            num = _choose(hood, num, np.int64(robot))
    return num


@njit(cache=True)
def _around_place(task, traffic, hood, size, rng):
    """Robots that are about a place at about one time: around a random robot's position at a random step."""
    num_robots = traffic.at.shape[1]
    size = min(size, num_robots)
    robot = np.int64(rng.random() * num_robots)
    t = np.int64(rng.random() * (traffic.end[robot] + 1))
    num = _choose(hood, 0, robot)
    begin, end = 0, 1
    hood.queue[0] = traffic.at[t, robot]
    while begin < end and num < size:
        v = hood.queue[begin]
        begin += 1
        for d in range(-3, 4):
            if 0 <= t + d < len(traffic.at) and (traffic.busy[v, (t + d) >> 5] >> ((t + d) & 31)) & 1:
                num = _choose_on(traffic, hood, num, size, v, t + d)
        a, b = task.first[v], task.first[v + 1]
        shift = np.int64(rng.random() * (b - a)) if b > a else np.int64(0)
        for k in range(b - a):
            if end < len(hood.queue):  # vertices may come twice: that is cheaper than to remember them
                hood.queue[end] = task.head[a + (k + shift) % (b - a)]
                end += 1
    return _fill_any(hood, num, size, rng)


@njit(cache=True)
def _collide(task, traffic, hood, robot):
    """Enter the pairs of a robot whose path is in the traffic; how many were not known."""
    new = 0
    horizon, num_robots = traffic.at.shape
    before = np.int64(-1)
    for t in range(horizon):
        v = np.int64(traffic.at[t, robot])
        if traffic.num_on[v, t] > 1:
            for other in range(num_robots):
                if traffic.at[t, other] == v and other != robot and traffic.end[other] >= 0 and not hood.hit[robot, other]:
                    new += _hit(hood, robot, other)
        if t > 0 and v != before:
            back = lane_between(task.first, task.head, v, before)
            if back >= 0 and traffic.num_along[back, t] > 0:
                for other in range(num_robots):
                    crossed = traffic.at[t, other] == before and traffic.at[t - 1, other] == v and traffic.end[other] >= 0
                    if crossed and not hood.hit[robot, other]:
                        new += _hit(hood, robot, other)
        before = v
    return new


@njit(cache=True)
def _hit(hood, robot, other):
    hood.hit[robot, other] = True
    hood.hit[other, robot] = True
    hood.num_hits[robot] += 1
    hood.num_hits[other] += 1
    return 1


@njit(cache=True)
def _forget(hood, robot):
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


@njit(cache=True)
def _around_collision(task, traffic, hood, size, rng):
    """Robots of one component of the graph of collisions: all, and whom they meet on walks, or some on a random walk in it."""
    num_robots = len(task.goal)
    size = min(size, num_robots)
    root = np.int64(rng.random() * num_robots)
    while hood.num_hits[root] == 0:
        root = (root + 1) % num_robots
    num = _choose(hood, 0, root)
    k = 0
    while k < num and num < size:  # breadth first, others in a random rotation
        shift = np.int64(rng.random() * num_robots)
        for j in range(num_robots):
            other = (j + shift) % num_robots
            if hood.hit[hood.robot[k], other] and num < size:
                num = _choose(hood, num, other)
        k += 1
    for _ in range(10):
        if num >= size:
            break
        robot = hood.robot[np.int64(rng.random() * num)]
        num = _walk(task, traffic, hood, num, size, robot, np.int64(len(traffic.at)), rng)
    return _fill_any(hood, num, size, rng)


@njit(cache=True)
def _around_failure(task, traffic, hood, size, rng):
    """A robot in collision, those that stand for good on its way, and those that pass its goal after it."""
    num_robots = len(task.goal)
    size = min(size, num_robots)
    num = _fill_by_hits(hood, 0, 1, rng)
    robot = hood.robot[0]
    shift = np.int64(rng.random() * num_robots)
    for j in range(num_robots):
        other = (j + shift) % num_robots
        if num >= size:
            break
        end = traffic.end[other]
        blocks = end <= traffic.end[robot] and task.steps[robot, task.start[robot]] == (
            task.steps[robot, task.goal[other]] + task.steps[other, task.start[robot]]
        )
        if other != robot and blocks:
            num = _choose(hood, num, other)
    for t in range(traffic.end[robot], len(traffic.at)):
        if num >= size:
            break
        if traffic.num_on[task.goal[robot], t] > 1:
            num = _choose_on(traffic, hood, num, size, task.goal[robot], t)
    return _fill_any(hood, num, size, rng)


def room_for(task: Task, horizon: int, size: int, *, with_hits: bool) -> tuple[Traffic, Labels, Neighbourhood]:
    """Empty traffic and room for `horizon` steps, a multiple of 32, and neighbourhoods of `size`."""
    num_vertices, num_lanes, num_robots = len(task.first) - 1, len(task.head), len(task.goal)
    traffic = Traffic(
        at=np.full((horizon, num_robots), -1, np.int32),
        end=np.full(num_robots, -1, np.int64),
        num_on=np.zeros((num_vertices, horizon), np.uint8),
        busy=np.zeros((num_vertices, horizon // 32), np.int64),
        num_along=np.zeros((num_lanes, horizon), np.uint8),
        along=np.zeros((num_lanes, horizon // 32), np.int64),
    )
    num_labels = 20_000 + 16 * num_vertices + 2 * num_lanes
    labels = Labels(
        *(np.zeros(num_labels, np.int64) for _ in range(7)),
        pushed=np.zeros((num_vertices, horizon), np.int64),
        closed=np.zeros((num_vertices, horizon), np.int64),
        stamp=np.zeros(2, np.int64),
    )
    hits = num_robots if with_hits else 1
    hood = Neighbourhood(
        robot=np.zeros(size, np.int64),
        chosen=np.zeros(num_robots, np.bool_),
        saved=np.zeros((size, horizon), np.int32),
        saved_end=np.zeros(size, np.int64),
        record=np.ones(3, np.float64),
        queue=np.zeros(max(num_robots, 256), np.int64),
        hit=np.zeros((hits, hits), np.bool_),
        num_hits=np.zeros(num_robots, np.int64),
    )
    return traffic, labels, hood


def traffic_of(task: Task, path: np.ndarray, size: int, spare: int) -> tuple[Traffic, Labels, Neighbourhood]:
    """Traffic of the paths [T, R], with `spare` steps or more of room, and room to improve them."""
    horizon = (len(path) + spare + 2 + 31) // 32 * 32
    traffic, labels, hood = room_for(task, horizon, size, with_hits=False)
    traffic.at[: len(path)] = path
    traffic.at[len(path) :] = path[-1]
    away = path != task.goal
    traffic.end[:] = np.where(away.any(axis=0), len(path) - np.argmax(away[::-1], axis=0), 0)
    enter_all(task, traffic)
    return traffic, labels, hood
