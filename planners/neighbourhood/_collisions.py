"""Which pairs of robots are in collision, kept up to date while their paths change."""

import numpy as np

from mrp_sumo.search._clashing import move_of
from mrp_sumo.search._kernel import kernel
from planners.neighbourhood._cells import anyone_in, num_in
from planners.neighbourhood._traffic import closes_ring, holds, lane_between


@kernel(allocates=False)
def find_collisions(task, traffic, hood):
    """Fill `hit`; the number of pairs."""
    hood.hit[:] = False
    hood.num_hits[:] = 0
    pairs = 0
    for robot in range(len(task.goal)):
        pairs += collide(task, traffic, hood, robot)
    return pairs


@kernel(allocates=False)
def collide(task, traffic, hood, robot):
    """Enter the pairs of a robot whose path is in the traffic; how many were not known.

    Of a ring the robot and the one ahead of it are such a pair. It stays one until one of the two is planned again,
    also when the ring is broken elsewhere; and where several hold a vertex only one of them is followed. So rings have
    to be looked for again when no pair is left.
    """
    new = 0
    rings = not traffic.rotations and not traffic.following
    before = np.int64(-1)
    for t in range(traffic.at.shape[1]):
        v = np.int64(traffic.at[robot, t])
        if num_in(traffic.on, v, t) > 1:
            new += _hit_holders(traffic, hood, robot, v, t)
        if t > 0 and v != before:
            if traffic.following and num_in(traffic.on, before, t) > 1:
                new += _hit_holders(traffic, hood, robot, before, t)
            back = lane_between(task.first, task.head, v, before)
            if back >= 0 and num_in(traffic.arrivals, back, t) > 0:
                for other in range(len(traffic.at)):
                    crossed = traffic.at[other, t] == before and traffic.at[other, t - 1] == v and traffic.end[other] >= 0
                    if crossed and not hood.hit[robot, other]:
                        new += _hit(hood, robot, other)
            ahead = anyone_in(traffic.on, v, t - 1) if rings else np.int64(-1)
            if ahead >= 0 and ahead != robot and not hood.hit[robot, ahead] and closes_ring(traffic, before, v, t):
                new += _hit(hood, robot, ahead)
        if task.clashes.any and t > 0:
            new += _hit_near(task, traffic, hood, robot, before, v, t)
        before = v
    return new


@kernel(allocates=False)
def _hit_near(task, traffic, hood, robot, u, v, t):
    """Enter the pairs of a robot that goes from u to v, or waits, and all others that come too close in that step."""
    clashes, new = task.clashes, 0
    move = move_of(task.first, task.head, u, v)
    for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
        w = clashes.vertex[k]
        for step in range(t - 1, t + 1):
            if num_in(traffic.on, w, step) > 0:
                new += _hit_holders(traffic, hood, robot, w, step)
    for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
        lane = clashes.lane[k]
        if num_in(traffic.arrivals, lane, t) > 0:
            for other in range(len(traffic.at)):
                if other != robot and traffic.end[other] >= 0 and traffic.at[other, t] == task.head[lane] and not hood.hit[robot, other]:
                    w = np.int64(traffic.at[other, t - 1])
                    if w != task.head[lane] and lane_between(task.first, task.head, w, task.head[lane]) == lane:
                        new += _hit(hood, robot, other)
    return new


@kernel(allocates=False)
def _hit_holders(traffic, hood, robot, v, t):
    """Enter the pairs of a robot and all others that hold a vertex at a step."""
    new = 0
    for other in range(len(traffic.at)):
        if other != robot and not hood.hit[robot, other] and holds(traffic, other, v, t):
            new += _hit(hood, robot, other)
    return new


@kernel(allocates=False)
def _hit(hood, robot, other):
    hood.hit[robot, other] = True
    hood.hit[other, robot] = True
    hood.num_hits[robot] += 1
    hood.num_hits[other] += 1
    return 1


@kernel(allocates=False)
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
