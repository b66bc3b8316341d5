"""Kernels of guides by traffic flow: what is left to the goal, where driving against others costs more.

After Chen, Harabor, Li, Stuckey, "Traffic flow optimisation for lifelong multi-agent path finding", AAAI 2024: one
robot after another is given a way on lanes that cost more the more ways already given run against them, and again when
all have one. What differs: the price is linear in the ways against, up to a most, and a robot follows not its one way
but the costs that all ways together leave behind, from wherever others have pushed it.

Costs can also come of what a search has seen of traffic, after the abstract of Shen, Zhang, Chen, Harabor, "A lightweight traffic map for
efficient anytime LaCAM*", 2026 (arXiv 2603.07891): of what PIBT did in configurations that it generated. Details are ours: a step in which
a robot comes no nearer its goal is a delay on the lane that it would have taken, and a lane costs what robots took on the average to get
over it, in all solutions so far.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.configuration._pibt_instance import nearer

STEP = 10  # what a lane costs that nobody runs against
AGAINST = 1  # and each way against it
MOST = 40  # and a lane at most
FAR = 1 << 30


class LaneFlow(NamedTuple):
    """The ways of R robots over L lanes between V vertices."""

    first: np.ndarray  # [V + 1] int64, lanes that leave a vertex
    head: np.ndarray  # [L] int64
    reverse: np.ndarray  # [L] int64
    first_in: np.ndarray  # [V + 1] int64, lanes that enter a vertex: numbers in `entering`
    entering: np.ndarray  # [L] int64
    tail: np.ndarray  # [L] int64
    start: np.ndarray  # [R] int64
    goal: np.ndarray  # [R] int64
    cost: np.ndarray  # [L] int64
    num: np.ndarray  # [L] int64 ways along a lane
    path_lanes: np.ndarray  # [R, N] int32 lanes of each robot's way
    length: np.ndarray  # [R] int64 lanes of it, up to N; the rest is not counted
    bucket: np.ndarray  # [MOST + 1] int64 entries of a queue by cost
    entry_vertex: np.ndarray  # [L + 1] int64
    entry_next: np.ndarray  # [L + 1] int64
    left: np.ndarray  # [V] int32 scratch


@kernel
def give_ways(flow, robots):
    """Give robots the cheapest ways, in the place of those they have."""
    first, head, cost, left, start, goal = flow.first, flow.head, flow.cost, flow.left, flow.start, flow.goal
    for robot in robots:
        for n in range(flow.length[robot]):
            _count(flow, flow.path_lanes[robot, n], -1)
        write_left(flow, goal[robot], start[robot], left)
        at, n = start[robot], 0
        while at != goal[robot]:
            best, least = np.int64(-1), np.int64(FAR)
            for lane in range(first[at], first[at + 1]):
                if left[head[lane]] < FAR and cost[lane] + left[head[lane]] < least:
                    best, least = np.int64(lane), cost[lane] + left[head[lane]]
            if n < flow.path_lanes.shape[1]:
                flow.path_lanes[robot, n] = best
                n += 1
            at = head[best]
        flow.length[robot] = n
        for m in range(n):
            _count(flow, flow.path_lanes[robot, m], 1)


@kernel
def _count(flow, lane, change):
    flow.num[lane] += change
    back = flow.reverse[lane]
    if back >= 0:
        flow.cost[back] = min(STEP + AGAINST * flow.num[lane], MOST)


@kernel
def write_guide(flow, guide, begin, end):
    """[R, V] what is left to each robot's goal from everywhere, for robots begin to end - 1."""
    for robot in range(begin, end):
        write_left(flow, flow.goal[robot], np.int64(-1), guide[robot])


@kernel
def write_left(flow, goal, until, left):
    """Least costs [V] from every vertex to the goal, or from those that are nearer than `until`; FAR where there is no way.

    Dijkstra's algorithm with a queue of buckets in a ring, which costs of MOST at most allow.
    """
    first_in, entering, tail, cost = flow.first_in, flow.entering, flow.tail, flow.cost
    bucket, entry_vertex, entry_next = flow.bucket, flow.entry_vertex, flow.entry_next
    left[:] = FAR
    bucket[:] = -1
    width = len(bucket)
    left[goal] = 0
    entry_vertex[0], entry_next[0] = goal, -1
    bucket[0] = 0
    num, waiting, d = 1, 1, 0
    while waiting > 0:
        k = d % width
        while bucket[k] >= 0:
            entry = bucket[k]
            bucket[k] = entry_next[entry]
            waiting -= 1
            v = entry_vertex[entry]
            if left[v] != d:
                continue
            if v == until:
                return
            for at in range(first_in[v], first_in[v + 1]):
                lane = entering[at]
                u, c = tail[lane], d + cost[lane]
                if c < left[u]:
                    left[u] = c
                    entry_vertex[num], entry_next[num] = u, bucket[c % width]
                    bucket[c % width] = num
                    num += 1
                    waiting += 1
        d += 1


class TrafficMap(NamedTuple):
    """Traffic that was seen on L lanes."""

    passages: np.ndarray  # [L] int64 moves along a lane
    delay: np.ndarray  # [L] int64 steps lost by robots that would have taken it


@kernel
def observe(world, traffic, path):
    """Enter what robots did on the way [T, R] to their goals."""
    for t in range(len(path) - 1):
        for i in range(path.shape[1]):
            v, u = np.int64(path[t, i]), np.int64(path[t + 1, i])
            if v == world.goal[i]:
                continue
            lost = 1 + nearer(world, i, u, v)
            for lane in range(world.first[v], world.first[v + 1]):
                if lost == 0 and world.head[lane] == u:
                    traffic.passages[lane] += 1
                if lost > 0 and nearer(world, i, world.head[lane], v) < 0:
                    traffic.delay[lane] += lost
                    break


@kernel
def write_tolls(traffic, toll):
    """[L] int64 what lanes cost, STEP to MOST."""
    for lane in range(len(toll)):
        seen = traffic.passages[lane] + 1
        toll[lane] = min(STEP + STEP * traffic.delay[lane] // seen, MOST)
