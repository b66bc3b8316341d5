"""Kernel of the weighted dependency graph heuristic: what a pair of robots costs more than its paths.

Source: Li, Felner, Boyarski, Ma, Koenig, "Improved heuristics for multi-agent path finding with conflict-based
search", IJCAI 2019 (WDG). The cost of a pair is found by a small conflict-based search of the two alone, which ends as soon as
their joint MDD says that there are paths without conflict.
"""

import numpy as np

from mrp_sumo.search._arrays import write_over
from mrp_sumo.search._conflicts import CONFLICT, conflicts_of
from mrp_sumo.search._heap import pop, push
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._mdd import mdd_of
from mrp_sumo.search._occupancy import install_all
from mrp_sumo.search._records import NO_PATH, OK, STORE_FULL, add_record
from mrp_sumo.search._space_time import ReplanEffort, replan
from planners.conflict_based._symmetry import CARDINAL, choose

PAIR_PATIENCE = 20
IMPOSSIBLE = 1 << 28  # the weight of a pair that cannot be solved under its constraints


@kernel(allocates=True)
def pair_weight(tables, one, other, most_nodes, budget):
    """The least sum of costs of two robots without conflicts, minus that of their paths.

    Parameters
    ----------
    tables
        The occupancy is used for these two; nobody else may be installed.
    one, other
        Records with shortest paths.
    most_nodes
        Nodes to expand; when they do not suffice the weight is a lower bound.

    Returns
    -------
    code, weight
    """
    instance, store, _, scratch = tables
    for record in (one, other):  # before the mark, so that their MDDs are kept
        if store.meta[record].mdd0 == -1:
            code = mdd_of(instance, store, scratch, record)
            if code != OK:
                return code, np.int64(0)
    mark = store.used.copy()
    code, weight = _solve_pair(tables, one, other, most_nodes, budget)
    write_over(store.used, mark)  # what the search appended is dropped
    return code, weight


@kernel(inline="always", allocates=True)
def _solve_pair(tables, one, other, most_nodes, budget):
    instance, store, occupancy, scratch = tables
    num_robots = len(instance.start)
    i, j = store.meta[one].robot, store.meta[other].robot
    base = store.meta[one].cost + store.meta[other].cost
    records = np.full(num_robots, -1, np.int64)
    nothing = np.empty(0, CONFLICT)
    node = np.empty((2 * most_nodes + 3, 2), np.int64)
    heap = np.empty(2 * most_nodes + 3, np.int64)
    node[0, 0], node[0, 1] = one, other
    num_nodes = 1
    push(heap, 0, base << 32)
    count = 1
    code = OK
    weight = np.int64(IMPOSSIBLE)
    is_told = not instance.clashes.any and len(instance.spots.place) == len(instance.spots.of)  # the joint MDD knows all conflicts
    patience = 0 if is_told else PAIR_PATIENCE  # it also finds what these paths miss
    for expanded in range(most_nodes + 1):
        if count == 0:
            break
        key = pop(heap, count)
        count -= 1
        weight = (key >> 32) - base
        if expanded == most_nodes:
            break
        k = key & 0xFFFFF
        records[i], records[j] = node[k, 0], node[k, 1]
        code = install_all(store, occupancy, records, i)
        if code != OK:
            break
        conflicts = conflicts_of(instance, store, occupancy, i, records[i], nothing)
        if len(conflicts) == 0:
            break
        code, chosen = choose(instance, store, scratch, records, conflicts, True, True)
        if code != OK:
            break
        row = conflicts[chosen]
        if row.priority < 4 * CARDINAL and is_told and store.meta[records[i]].mdd0 >= 0 and store.meta[records[j]].mdd0 >= 0:
            break  # there are paths without conflict at this cost
        for side in range(2):
            robot = row.one if side == 0 else row.other
            row0, row1 = (row.a0, row.a1) if side == 0 else (row.b0, row.b1)
            parent = records[robot]
            record = add_record(store, parent, robot, row0, row1)
            if record < 0:
                code = STORE_FULL
                break
            code = install_all(store, occupancy, records, robot)
            if code != OK:
                break
            code = replan(tables, record, ReplanEffort(1.0, store.meta[parent].cost, patience, budget))
            if code == NO_PATH:
                code = OK
                continue
            if code != OK:
                break
            third = records[j] if robot == i else records[i]
            node[num_nodes, 0] = record if robot == i else third
            node[num_nodes, 1] = third if robot == i else record
            push(heap, count, ((store.meta[record].cost + store.meta[third].cost) << 32) | num_nodes)
            num_nodes += 1
            count += 1
        if code != OK:
            break
        weight = np.int64(IMPOSSIBLE)
    records[i], records[j] = -1, -1
    install_all(store, occupancy, records, -1)
    return code, weight
