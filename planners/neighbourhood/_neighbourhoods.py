"""Which robots are planned again together: kinds of neighbourhoods, chosen by what each has gained lately.

Sources: Li, Chen, Harabor, Stuckey, Koenig, "Anytime multi-agent path finding via large neighborhood search", IJCAI
2021 (a robot that is late and those in its way; robots about one place; any), and "MAPF-LNS2", AAAI 2022 (robots in
collision and those in their way). Phan, Zhang, Chan, Koenig, "Anytime multi-agent path finding with an adaptive delay-based heuristic",
AAAI 2025 (ADDRESS: which of the latest robots, by Thompson sampling of what each has been good for).
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.neighbourhood._cells import anyone_in, num_in
from planners.neighbourhood._sipps import steps_from
from planners.neighbourhood._traffic import RepairTask, holds

DECAY = 0.01  # of a neighbourhood kind's record
LATEST = 32  # robots that a bandit chooses from


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


@kernel(allocates=False)
def pick_kind(hood, rng):
    x = rng.random() * (hood.record[0] + hood.record[1] + hood.record[2])
    if x < hood.record[0]:
        return 0
    return 1 if x < hood.record[0] + hood.record[1] else 2


@kernel(allocates=False)
def _choose(hood, num, robot):
    """Add a robot to the neighbourhood unless it is in it."""
    if hood.chosen[robot]:
        return num
    hood.chosen[robot] = True
    hood.robot[num] = robot
    return num + 1


@kernel(allocates=False)
def fill_any(hood, num, size, rng):
    """Fill up with any robots."""
    num_robots = len(hood.chosen)
    size = min(size, num_robots)
    while num < size:
        num = _choose(hood, num, np.int64(rng.random() * num_robots))
    return num


@kernel(allocates=False)
def fill_by_hits(hood, num, size, rng):
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
    return fill_any(hood, num, size, rng)


@kernel(allocates=False)
def around_late(task, traffic, hood, size, rng):
    """A robot that is late, and those met on random walks that would bring it home earlier."""
    num_robots = len(task.goal)
    size = min(size, num_robots)
    late, latest = np.int64(0), np.int64(-1)
    for _ in range(1 + num_robots // 16):
        robot = np.int64(rng.random() * num_robots)
        delay = traffic.end[robot] - task.least[robot]
        if delay > latest:
            late, latest = robot, delay
    return _fill_around(task, traffic, hood, size, late, rng)


@kernel(allocates=False)
def around_promising(task, traffic, hood, size, rng):
    """One of the latest robots, by Thompson sampling (Beta posteriors of its successes), and those met on random walks.

    The robot comes first in `hood.robot`.
    """
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
    return _fill_around(task, traffic, hood, size, best, rng)


@kernel(allocates=False)
def _fill_around(task, traffic, hood, size, late, rng):
    """A robot, those met on random walks that would bring it home earlier, and any."""
    size = min(size, len(task.goal))
    num = _choose(hood, 0, late)
    for _ in range(10):
        if num >= size:
            break
        robot = hood.robot[np.int64(rng.random() * num)] if rng.random() < 0.5 else late
        num = _walk(task, traffic, hood, num, size, robot, traffic.end[robot], rng)
    return fill_any(hood, num, size, rng)


@kernel(allocates=False)
def _walk(task, traffic, hood, num, size, robot, before, rng):
    """Walk from a random step of a robot's path, so that it could still arrive `before`; choose whom it meets."""
    if traffic.end[robot] <= 0:
        return num
    t = np.int64(rng.random() * traffic.end[robot])
    v = np.int64(traffic.at[robot, t])
    to_go = _to_go(task, traffic, robot, t)
    for _ in range(traffic.at.shape[1]):
        if num >= size or t + 2 >= traffic.at.shape[1]:
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
            moved = True
            if (traffic.busy[u, (t + 1) >> 5] >> ((t + 1) & 31)) & 1:
                num = _choose_about(task, traffic, hood, num, size, u, t + 1)
            if num < size and at < b and task.reverse[at] >= 0:
                back = task.reverse[at]
                if (traffic.along[back, (t + 1) >> 5] >> ((t + 1) & 31)) & 1:
                    num = _choose_on(traffic, hood, num, size, v, t + 1)
            v, to_go = u, onward
            break
        if not moved:
            break
        t += 1
    return num


@kernel(allocates=False)
def _to_go(task, traffic, robot, t):
    """Steps to a robot's goal from where it is at t."""
    if task.steps.shape[1] > 0:
        return np.int64(task.steps[robot, traffic.at[robot, t]])
    to_go, at = task.least[robot], traffic.at[robot]
    for step in range(t):
        to_go = steps_from(task.steps[robot], task.code[robot], np.int64(at[step]), np.int64(at[step + 1]), to_go)
    return to_go


@kernel(allocates=False)
def _choose_on(traffic, hood, num, size, v, t):
    """Choose the robots that hold a vertex at a step."""
    there = num_in(traffic.on, v, t)
    if there == 1 and num < size:
        return _choose(hood, num, anyone_in(traffic.on, v, t))
    if there > 1:
        for robot in range(len(traffic.at)):
            if num < size and holds(traffic, robot, v, t):
                num = _choose(hood, num, np.int64(robot))
    return num


@kernel(allocates=False)
def _choose_about(task, traffic, hood, num, size, v, t):
    """Choose the robots that hold a vertex at a step, or stand too close to it."""
    num = _choose_on(traffic, hood, num, size, v, t)
    clashes = task.clashes
    if clashes.any:
        move = len(task.head) + v
        for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
            num = _choose_on(traffic, hood, num, size, clashes.vertex[k], t)
        for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
            if num < size and num_in(traffic.arrivals, clashes.lane[k], t) > 0:
                num = _choose_on(traffic, hood, num, size, task.head[clashes.lane[k]], t)
    return num


@kernel(allocates=False)
def around_place(task, traffic, hood, size, rng):
    """Robots that are about a place at about one time: around a random robot's position at a random step."""
    num_robots = len(traffic.at)
    size = min(size, num_robots)
    robot = np.int64(rng.random() * num_robots)
    t = np.int64(rng.random() * (traffic.end[robot] + 1))
    num = _choose(hood, 0, robot)
    begin, end = 0, 1
    hood.queue[0] = traffic.at[robot, t]
    while begin < end and num < size:
        v = hood.queue[begin]
        begin += 1
        for d in range(-3, 4):
            if 0 <= t + d < traffic.at.shape[1] and (traffic.busy[v, (t + d) >> 5] >> ((t + d) & 31)) & 1:
                num = _choose_about(task, traffic, hood, num, size, v, t + d)
        a, b = task.first[v], task.first[v + 1]
        shift = np.int64(rng.random() * (b - a)) if b > a else np.int64(0)
        for k in range(b - a):
            if end < len(hood.queue):  # vertices may come twice: that is cheaper than to remember them
                hood.queue[end] = task.head[a + (k + shift) % (b - a)]
                end += 1
    return fill_any(hood, num, size, rng)


@kernel(allocates=False)
def around_collision(task, traffic, hood, size, rng):
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
        num = _walk(task, traffic, hood, num, size, robot, np.int64(traffic.at.shape[1]), rng)
    return fill_any(hood, num, size, rng)


@kernel(allocates=False)
def around_failure(task, traffic, hood, size, rng):
    """A robot in collision, those that stand for good on its way, and those that pass its goal after it."""
    num_robots = len(task.goal)
    size = min(size, num_robots)
    num = fill_by_hits(hood, 0, 1, rng)
    robot = hood.robot[0]
    if task.steps.shape[1] > 0:
        num = _fill_by_goals_on_the_way(task, traffic, hood, num, size, robot, rng)
    else:  # steps between other places are not known: those that it meets
        for t in range(traffic.end[robot]):
            if num < size and num_in(traffic.on, np.int64(traffic.at[robot, t]), t) > 1:
                num = _choose_on(traffic, hood, num, size, np.int64(traffic.at[robot, t]), t)
    for t in range(traffic.end[robot], traffic.at.shape[1]):
        if num >= size:
            break
        if num_in(traffic.on, task.goal[robot], t) > 1:
            num = _choose_on(traffic, hood, num, size, task.goal[robot], t)
    return fill_any(hood, num, size, rng)


@kernel(allocates=False)
def _fill_by_goals_on_the_way(task, traffic, hood, num, size, robot, rng):
    """Those that are at their goals before the robot is at its own, if their goals are on a shortest way of the robot."""
    num_robots = len(task.goal)
    shift = np.int64(rng.random() * num_robots)
    for j in range(num_robots):
        other = (j + shift) % num_robots
        if num >= size:
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
        robot=np.zeros(size, np.int64),
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
