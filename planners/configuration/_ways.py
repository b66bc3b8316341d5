"""Kernels that give robots shortest ways on which they meet few others.

After the space utilisation of Okumura, "Engineering LaCAM*", AAMAS 2024 (section 4): one robot after another is given a shortest way that
meets as few of the others' as can be, and again when all have one. What differs: a robot is `k` steps along a shortest way where `k` steps
fewer are left, so that a vertex has one step at which a way may pass it, and the search needs no time; and robots that have been pushed off
their ways, or are late on them, find themselves again by the same count.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.configuration._pibt_instance import move_along, spot_of, step_towards

COUNT = 16  # bits of a slot that count who holds it
MOST_MET = 63  # beyond, ways are equally bad
NEVER = 1 << 30


class StepPaths(NamedTuple):
    """The ways of R robots of at most N steps between V vertices, what they hold at which step; S spots and M moves between them."""

    first: np.ndarray  # [V + 1] int64, lanes that leave a vertex
    head: np.ndarray  # [L] int64
    start: np.ndarray  # [R] int64
    goal: np.ndarray  # [R] int64
    steps: np.ndarray  # [R] int64 from each robot's start to its goal
    table: np.ndarray  # [R, V] steps to each robot's goal; [1, 1] when packed
    packed: bool  # distances are in `code` instead
    code: np.ndarray  # [R, ceil(V / 4)] uint8, see _pibt_instance
    shared: bool  # see `PibtInstance`
    spot: np.ndarray  # [V] int64
    move: np.ndarray  # [L] int64
    back: np.ndarray  # [M] int64
    path: np.ndarray  # [R, N + 1] int32 vertices; -1 before there is one
    held: np.ndarray  # [H] int64 spots, then moves, with the step and by how many they are held; 0: nothing. A hash table, never half full
    held_from: np.ndarray  # [S] int32 the step at which the robot arrives that stays there
    stamp: np.ndarray  # [V] int64 search in which the rest was last written
    step: np.ndarray  # [V] int32 steps to a vertex from the start
    met: np.ndarray  # [V] int32 others met on the best way to a vertex
    before: np.ndarray  # [V] int32 the vertex before it
    bucket: np.ndarray  # [MOST_MET + 1] int64 entries by others met
    entry_vertex: np.ndarray  # [L + 1] int32
    entry_met: np.ndarray  # [L + 1] int32
    entry_next: np.ndarray  # [L + 1] int64


@kernel
def give_ways(ways, robots, search, rng):
    """Give robots ways in the place of those they have; `search` is the number of the first one's search, never used before."""
    for k in range(len(robots)):
        robot = robots[k]
        if ways.path[robot, 0] >= 0:
            _hold(ways, robot, -1)
        _find(ways, robot, search + k, rng)
        _hold(ways, robot, 1)


@kernel
def _find(ways, robot, search, rng):
    """Write the shortest way that meets the fewest others, the deepest vertex first among equals."""
    start, goal = ways.start[robot], ways.goal[robot]
    first, head, bucket = ways.first, ways.head, ways.bucket
    bucket[:] = -1
    bucket[0] = 0
    ways.entry_vertex[0], ways.entry_met[0], ways.entry_next[0] = start, 0, -1
    ways.stamp[start], ways.step[start], ways.met[start], ways.before[start] = search, 0, 0, -1
    num, level = 1, 0
    while True:
        while bucket[level] < 0:
            level += 1
        entry = bucket[level]
        bucket[level] = ways.entry_next[entry]
        v, met = np.int64(ways.entry_vertex[entry]), ways.entry_met[entry]
        if met > ways.met[v]:
            continue
        if v == goal:
            break
        step = np.int64(ways.step[v]) + 1
        a, num_lanes = first[v], first[v + 1] - first[v]
        turn = np.int64(rng.random() * num_lanes)
        for n in range(num_lanes):
            lane = a + (n + turn) % num_lanes
            u = head[lane]
            if not _leads_on(ways, robot, v, u):
                continue
            there = spot_of(ways, u)
            others = met + _held(ways, there, step) + (1 if ways.held_from[there] <= step else 0)
            back = ways.back[move_along(ways, lane)]
            if back >= 0 and _held(ways, there, step - 1) > 0:  # looked up for nothing elsewhere, and far from the rest
                others += _held(ways, len(ways.held_from) + back, step)
            if ways.stamp[u] == search and ways.met[u] <= others:
                continue
            ways.stamp[u], ways.step[u], ways.met[u], ways.before[u] = search, step, others, v
            ways.entry_vertex[num], ways.entry_met[num] = u, others
            k = min(others, MOST_MET)
            ways.entry_next[num] = bucket[k]
            bucket[k] = num
            level = min(level, k)
            num += 1
    at = np.int64(goal)
    for step in range(ways.steps[robot], -1, -1):
        ways.path[robot, step] = at
        at = np.int64(ways.before[at])


@kernel
def _leads_on(ways, robot, v, u):
    """Whether the lane from v to u is on a shortest way."""
    if ways.packed:
        return step_towards(ways.code, robot, u, v) < 0
    return ways.table[robot, u] < ways.table[robot, v]


@kernel
def _hold(ways, robot, change):
    """Enter the robot's way among what is held, or take it out."""
    path, first, head = ways.path[robot], ways.first, ways.head
    steps = ways.steps[robot]
    for step in range(steps + 1):
        v = np.int64(path[step])
        ways.held[_slot(ways, spot_of(ways, v), step)] += change
        if step > 0:
            u = np.int64(path[step - 1])
            for lane in range(first[u], first[u + 1]):
                if head[lane] == v:
                    ways.held[_slot(ways, len(ways.held_from) + move_along(ways, lane), step)] += change
                    break
    ways.held_from[spot_of(ways, path[steps])] = steps if change > 0 else NEVER


@kernel
def _held(ways, place, step):
    """How many hold a spot, or a move beyond those, at a step."""
    return ways.held[_probed(ways, place, step)] & ((1 << COUNT) - 1)


@kernel
def _slot(ways, place, step):
    """Where that is counted."""
    slot = _probed(ways, place, step)
    if ways.held[slot] == 0:
        ways.held[slot] = _key(ways, place, step) << COUNT
    return slot


@kernel
def _probed(ways, place, step):
    """Where that is counted, or could be; places near each other are near at the same time, which is placed by Fibonacci hashing."""
    wanted, mask = _key(ways, place, step), len(ways.held) - 1
    slot = 16 * np.int64(place) + (step & 15) + (((step >> 4) * np.int64(0x9E3779B1)) >> 8) & mask
    while ways.held[slot] != 0 and ways.held[slot] >> COUNT != wanted:
        slot = (slot + 1) & mask
    return slot


@kernel
def _key(ways, place, step):
    """A number above 0."""
    return np.int64(place) * ways.path.shape[1] + step + 1
