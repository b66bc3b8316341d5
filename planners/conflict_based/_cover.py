"""Kernels of the least cover: what robots cost more, in sum, when of several groups each costs at least so much more.

Source: Li, Felner, Boyarski, Ma, Koenig, "Improved heuristics for multi-agent path finding with conflict-based search", IJCAI 2019,
for pairs (the edge-weighted minimum vertex cover), each connected component by itself; groups of more robots: Shen, Chen, Li, Cheema,
Harabor, Stuckey, "Beyond pairwise reasoning in multi-agent path finding", ICAPS 2023.
"""

import numpy as np

from mrp_sumo.search._kernel import kernel

MOST_STEPS = 20_000


@kernel(allocates=True)
def cover(num_robots, first, member, least):
    """The least sum of x >= 0 in which every group g has a sum of at least least[g]: exact, or a lower bound where that takes long.

    Parameters
    ----------
    num_robots
        Robots that are in groups; numbered from 0.
    first, member
        [G + 1] and [first[G]] int64: the robots of each group.
    least
        [G] int64, above 0.
    """
    num_groups = len(least)
    part = np.arange(num_robots)
    for g in range(num_groups):
        for m in range(first[g] + 1, first[g + 1]):
            a, b = part[member[first[g]]], part[member[m]]
            if a != b:
                for r in range(num_robots):
                    if part[r] == b:
                        part[r] = a
    total = np.int64(0)
    order, groups = np.empty(num_robots, np.int64), np.empty(num_groups, np.int64)
    for p in range(num_robots):
        count = 0
        for g in range(num_groups):
            if part[member[first[g]]] == p:
                groups[count] = g
                count += 1
        if count == 1:
            total += least[groups[0]]
        elif count > 1:
            size = 0
            for r in range(num_robots):
                if part[r] == p:
                    order[size] = r
                    size += 1
            total += _cover_part(order[:size], groups[:count], num_robots, first, member, least)
    return total


@kernel(allocates=True)
def _cover_part(order, groups, num_robots, first, member, least):
    """Depth first over the values of each robot, in the order of `order`, which is sorted here: those in the weightiest groups first."""
    size = len(order)
    load = np.zeros(num_robots, np.int64)
    for g in groups:
        for m in range(first[g], first[g + 1]):
            load[member[m]] += least[g]
    order = order[np.argsort(-load[order], kind="mergesort")]
    place = np.empty(num_robots, np.int64)
    for k in range(size):
        place[order[k]] = k
    # groups by the place of their last robot, heaviest first
    begin, end = np.empty(len(groups), np.int64), np.empty(len(groups), np.int64)  # first and last place of each
    most = np.zeros(size, np.int64)
    for n in range(len(groups)):
        g = groups[n]
        begin[n], end[n] = size, -1
        for m in range(first[g], first[g + 1]):
            k = place[member[m]]
            begin[n], end[n] = min(begin[n], k), max(end[n], k)
            most[k] = max(most[k], least[g])
    heaviest = np.argsort(-least[groups], kind="mergesort")
    ahead = np.zeros(size + 1, np.int64)  # of groups whose robots all come from a place on, disjoint ones: what they cost at least
    used = np.empty(size, np.bool_)
    for k in range(size):
        used[:] = False
        for n in heaviest:
            g = groups[n]
            if begin[n] >= k:
                is_free = True
                for m in range(first[g], first[g + 1]):
                    is_free = is_free and not used[place[member[m]]]
                if is_free:
                    ahead[k] += least[g]
                    for m in range(first[g], first[g + 1]):
                        used[place[member[m]]] = True
    lower, upper = ahead[0], most.sum() + 1
    value = np.full(size, -1, np.int64)
    steps = 0
    spent = np.int64(0)
    k = 0
    while k >= 0:
        steps += 1
        if steps > MOST_STEPS:
            return lower
        if value[k] < 0:
            value[k] = 0
            for n in range(len(groups)):
                if end[n] == k:
                    g = groups[n]
                    need = least[g]
                    for m in range(first[g], first[g + 1]):
                        if place[member[m]] < k:
                            need -= value[place[member[m]]]
                    value[k] = max(value[k], need)
        else:
            spent -= value[k]
            value[k] += 1
        if value[k] > most[k] or spent + value[k] + ahead[k + 1] >= upper:
            value[k] = -1
            k -= 1
            continue
        spent += value[k]
        if k < size - 1:
            k += 1
            continue
        upper = spent
        if upper == lower:
            return upper
        spent -= value[k]
        value[k] = -1
        k -= 1
    return upper
