"""Kernels of PIBT's swap operation: two robots that meet in a corridor change places at the next fork.

Source: Okumura, "Improving LaCAM for scalable eventually optimal multi-agent pathfinding", IJCAI 2023, section 4.
"""

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.configuration._pibt_instance import prefers


@kernel(allocates=False)
def swap_partner(world, scratch, here, to, i):
    """The robot that i has to change places with in a corridor, and can; -1 for none."""
    v, best = here[i], scratch.candidate[i, 0]
    if best == v:
        return -1
    j = scratch.now[best]
    if j >= 0 and to[j] < 0 and _swap_required(world, scratch, i, j, v, best) and _swap_possible(world, scratch, best, v):
        return j
    for k in range(world.first[v], world.first[v + 1]):
        u = world.head[k]
        j = scratch.now[u]
        if j < 0 or u == best:
            continue
        if _swap_required(world, scratch, j, i, v, best) and _swap_possible(world, scratch, best, v):
            return j
    return -1


@kernel(allocates=False)
def _swap_required(world, scratch, pusher, puller, at, ahead):
    """Follow the corridor through which the pusher would push the puller: does each want to get to the other's side?"""
    steps = 0
    while prefers(world, pusher, ahead, at):
        num, onward = _ways_on(world, scratch, at, ahead)
        if num >= 2:
            return False
        if num <= 0:
            break
        at, ahead = ahead, onward
        steps += 1
        if steps > len(scratch.now):
            return False
    pusher_there = at == world.goal[pusher]
    return prefers(world, puller, at, ahead) and (pusher_there or prefers(world, pusher, ahead, at))


@kernel(allocates=False)
def _swap_possible(world, scratch, begin, at):
    """Follow the corridor the other way: is there a fork where one of the two can step aside?"""
    before, here = begin, at
    steps = 0
    while here != begin and steps <= len(scratch.now):
        num, onward = _ways_on(world, scratch, before, here)
        if num >= 2:
            return True
        if num <= 0:
            return False
        before, here = here, onward
        steps += 1
    return False


@kernel(allocates=False)
def _ways_on(world, scratch, before, at):
    """How many ways lead on from `at`, and the last of them; not back to `before`, nor into a dead end whose robot is at its goal."""
    num, onward = 0, np.int64(-1)
    for k in range(world.first[at], world.first[at + 1]):
        u = world.head[k]
        if u == before:
            continue
        j = scratch.now[u]
        if j >= 0 and world.first[u + 1] - world.first[u] == 1 and world.goal[j] == u:
            continue
        num += 1
        onward = u
    return num, onward
