"""Kernels that find conflicts between the paths of records.

A conflict is a row of WIDTH numbers: robots ONE and OTHER, what kind, where and when; then, filled in by those who
choose between conflicts, its priority and the constraints to split on: rows A0..A1 for ONE, B0..B1 for OTHER.
"""

import numpy as np

from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._occupancy import steps_known, visitor
from mrp_sumo.search._records import COST, PATH0, place

WIDTH = 11
ONE, OTHER, KIND, TAIL, AT, STEP, PRIORITY, A0, A1, B0, B1 = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10
MEET = 0  # both are at AT at STEP
SWAP = 1  # ONE comes from TAIL to AT at STEP, OTHER the other way
TARGET = 2  # ONE stays at AT, its goal, when OTHER is there at STEP
FOLLOW = 3  # ONE is at AT at STEP, OTHER is there one step later
UNKNOWN = -1  # a priority not yet looked at


@kernel
def _add(found, count, i, j, kind, tail, at, step):
    if count == len(found):
        longer = np.empty((2 * count, WIDTH), np.int32)
        longer[:count] = found
        found = longer
    row = found[count]
    row[ONE], row[OTHER], row[KIND], row[TAIL], row[AT], row[STEP], row[PRIORITY] = i, j, kind, tail, at, step, UNKNOWN
    row[A0], row[A1], row[B0], row[B1] = 0, 0, 0, 0
    return found


@kernel
def conflicts_of(world, store, occupancy, robot, record, old):
    """The conflicts of a robot on a new record with all installed others, after those of `old` that are not its own.

    Parameters
    ----------
    old
        [K, WIDTH] the conflicts before.

    Returns
    -------
    conflicts
        [K', WIDTH] in a new array.
    """
    horizon = steps_known(occupancy)
    num_robots = len(occupancy.record)
    path0, cost = store.meta[record, PATH0], store.meta[record, COST]
    found = np.empty((len(old) + 16, WIDTH), np.int32)
    count = 0
    for k in range(len(old)):
        if old[k, ONE] != robot and old[k, OTHER] != robot:
            found[count] = old[k]
            count += 1
    latest = np.int64(0)
    for r in range(num_robots):
        if occupancy.record[r] >= 0:
            latest = max(latest, store.meta[occupancy.record[r], COST])
    u = np.int64(store.path[path0])
    for t in range(max(cost, latest) + 1):
        v = np.int64(store.path[path0 + min(t, cost)])
        if t < horizon:
            visit = visitor(occupancy, v, t, 0)
            while visit:
                other = visit - t * num_robots - 1
                if t < cost:
                    found = _add(found, count, min(robot, other), max(robot, other), MEET, -1, v, t)
                else:
                    found = _add(found, count, robot, other, TARGET, -1, v, t)
                count += 1
                visit = visitor(occupancy, v, t, visit)
        if t <= cost and occupancy.since[v] <= t:
            found = _add(found, count, np.int64(occupancy.parked[v]), robot, TARGET, -1, v, t)
            count += 1
        if u != v:
            if t - 1 < horizon:
                visit = visitor(occupancy, v, t - 1, 0)
                while visit:
                    other = visit - (t - 1) * num_robots - 1
                    went = place(store, occupancy.record[other], t)
                    if world.following:
                        if went != v:
                            found = _add(found, count, other, robot, FOLLOW, -1, v, t - 1)
                            count += 1
                    elif went == u:
                        if robot < other:
                            found = _add(found, count, robot, other, SWAP, u, v, t)
                        else:
                            found = _add(found, count, other, robot, SWAP, v, u, t)
                        count += 1
                    visit = visitor(occupancy, v, t - 1, visit)
            if world.following:  # others that come in where this robot goes out; two that swap are found once
                if t < horizon:
                    visit = visitor(occupancy, u, t, 0)
                    while visit:
                        other = visit - t * num_robots - 1
                        came = place(store, occupancy.record[other], t - 1)
                        if came != u and came != v:
                            found = _add(found, count, robot, other, FOLLOW, -1, u, t - 1)
                            count += 1
                        visit = visitor(occupancy, u, t, visit)
                parked = np.int64(occupancy.parked[u])
                if parked >= 0 and occupancy.since[u] == t and place(store, occupancy.record[parked], t - 1) != v:
                    found = _add(found, count, robot, parked, FOLLOW, -1, u, t - 1)
                    count += 1
        u = v
    return found[:count]
