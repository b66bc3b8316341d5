"""Kernels of `drive.switching`: when robots will be where in a given order of passages, and what a pair that is switched draws along."""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel

CYCLIC = np.inf  # the cost of an order that nobody can keep


class Net(NamedTuple):
    """N visits of R robots, and the E passages of these at Q resources."""

    first: np.ndarray  # [R + 1] CSR: robot r makes visits first[r]:first[r + 1]
    ready_s: np.ndarray  # [R] when it made the first of them
    run_s: np.ndarray  # [N] from the visit before, nothing in the way
    rest_s: np.ndarray  # [N] the same for who had to wait for somebody to leave
    opens_first: np.ndarray  # [N + 1] CSR: passages that begin with a visit
    opens: np.ndarray  # [E]
    robot: np.ndarray  # [E]
    left_at: np.ndarray  # [E] visit at whose arrival the resource has been left at the latest, N: never
    early_s: np.ndarray  # [E] how much before that it is free
    fixed: np.ndarray  # [E] whether the robot has been granted it: nobody passes before
    begin: np.ndarray  # [E] first place in the order of the passage's resource


class SwitchScratch(NamedTuple):
    """Working arrays of a look at an order."""

    arrive_s: np.ndarray  # [N]
    waits: np.ndarray  # [N] the passage whose beginning was waited for, -1: nothing was
    at: np.ndarray  # [R] the visit of each robot that could not be made, or its end
    stuck: np.ndarray  # [R] the passage that it could not begin
    yields: np.ndarray  # [R] who lets the robot that is to go first pass


@kernel
def cost_of(net, order, place, scratch):
    """Longest paths: the sum of the times at which robots make their last visits, s; CYCLIC where they wait for each other.

    Parameters
    ----------
    order
        [E] passages, resource by resource, each in the order in which robots pass.
    place
        [E] of each passage in it.
    """
    arrive, waits, at, stuck = scratch.arrive_s, scratch.waits, scratch.at, scratch.stuck
    first, num_robots, num_visits = net.first, len(net.ready_s), len(net.run_s)
    for r in range(num_robots):
        arrive[first[r]] = net.ready_s[r]
        waits[first[r]] = -1
        at[r] = first[r] + 1
        stuck[r] = -1
    moved = True
    while moved:
        moved = False
        for r in range(num_robots):
            while at[r] < first[r + 1]:
                k = at[r]
                time_s, cause, stuck[r] = arrive[k - 1] + net.run_s[k], -1, -1
                for c in range(net.opens_first[k], net.opens_first[k + 1]):
                    e = net.opens[c]
                    if place[e] == net.begin[e]:
                        continue
                    before = order[place[e] - 1]
                    i, leaves = net.robot[before], net.left_at[before]
                    if i == r:
                        continue
                    if leaves == num_visits or leaves >= at[i]:
                        stuck[r] = e
                        break
                    free_s = arrive[leaves] - net.early_s[before] + net.rest_s[k]
                    if free_s > time_s:
                        time_s, cause = free_s, e
                if stuck[r] >= 0:
                    break
                arrive[k], waits[k] = time_s, cause
                at[r] += 1
                moved = True
    total = 0.0
    for r in range(num_robots):
        if at[r] < first[r + 1]:
            return CYCLIC
        total += arrive[first[r + 1] - 1]
    return total


@kernel
def switch(net, order, place, passage, until, most, scratch):
    """Let a passage take place `until` in the order of its resource, and switch what this draws along: pairs of robots that
    would wait for each other otherwise, as in a corridor. Changes `order` and `place`.

    Returns
    -------
    cost_s
        See `cost_of`; CYCLIC where no order came of it.
    num_looks
        How often longest paths were looked for, at most `most`.
    """
    goes_first, yields = net.robot[passage], scratch.yields
    yields[:] = False
    while place[passage] > until:
        before = order[place[passage] - 1]
        if not may_switch(net, before, passage):
            return CYCLIC, 0
        yields[net.robot[before]] = True
        exchange(order, place, before, passage)
    for looks in range(1, most + 1):
        cost = cost_of(net, order, place, scratch)
        if cost < CYCLIC:
            return cost, looks
        best, chosen = 0, -1
        r = in_a_cycle(net, order, place, scratch)
        if r < 0:  # behind somebody who stays
            return CYCLIC, looks
        start = r
        while True:
            e = scratch.stuck[r]
            before = order[place[e] - 1]
            i = net.robot[before]
            rank = 2 * yields[i] + (r == goes_first)
            if rank > best and may_switch(net, before, e):
                best, chosen = rank, e
            r = i
            if r == start:
                break
        if chosen < 0:
            return CYCLIC, looks
        before = order[place[chosen] - 1]
        if net.robot[chosen] == goes_first:
            yields[net.robot[before]] = True
        exchange(order, place, before, chosen)
    return CYCLIC, most


@kernel
def in_a_cycle(net, order, place, scratch):
    """A robot among those that wait for each other, -1 where they wait for one that stays."""
    stuck, num_robots = scratch.stuck, len(net.ready_s)
    for start in range(num_robots):
        if stuck[start] < 0:
            continue
        r = start
        for _ in range(num_robots):
            if stuck[r] < 0:
                break
            r = net.robot[order[place[stuck[r]] - 1]]
        if stuck[r] >= 0:
            return r
    return -1


@kernel
def may_switch(net, before, after):
    """True if, of two passages, one directly before the other, the second may be the first."""
    stays = net.left_at[after] == len(net.run_s)
    return not net.fixed[before] and not stays and net.robot[before] != net.robot[after]


@kernel
def exchange(order, place, before, after):
    """Two passages, one directly before the other, change places."""
    place[after] -= 1
    place[before] += 1
    order[place[after]] = after
    order[place[before]] = before


@kernel(allocates=True)
def critical(net, order, place, scratch):
    """[E] how many robots would be done earlier if a passage began when its robot comes, after `cost_of`."""
    count = np.zeros(len(net.robot), np.int64)
    for r in range(len(net.ready_s)):
        i, k = r, net.first[r + 1] - 1
        while k > net.first[i]:
            e = scratch.waits[k]
            if e < 0:
                k -= 1
                continue
            count[e] += 1
            before = order[place[e] - 1]
            i, k = net.robot[before], net.left_at[before]
    return count
