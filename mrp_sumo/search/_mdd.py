"""Kernels of multi-valued decision diagrams: all paths of least cost of one robot under its constraints, level by level.

Source: Sharon, Stern, Goldenberg, Felner, "The increasing cost tree search", AIJ 2013, section 4.
"""

import numpy as np

from mrp_sumo.search._constraints import EARLIEST, LAST_MUST, MARK, STAMP, forbidden, load
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._records import (
    EDGE,
    FOREVER,
    LEVELS,
    MEMBERS,
    MIN_COST,
    MUST,
    OK,
    RANGE,
    SCRATCH_FULL,
    STORE_FULL,
)

TOO_LARGE = -2  # in MDD0: more members than are worth building
MOST_MEMBERS = 20_000


@kernel
def _levels(instance, scratch, start, goal, distance, cost):
    """Build the levels 0..cost in scratch: how many members, 0 when there is no path of this cost, -1 too many, -2 no room."""
    level, member, mark, number = scratch.level, scratch.member, scratch.mark, scratch.number
    first, head, touched, stamp, last_must = instance.first, instance.head, scratch.touched, number[STAMP], scratch.limit[LAST_MUST]
    spot_of = instance.spots.of
    if cost + 3 > len(level):
        return -2
    level[0], level[1] = 0, 1
    member[0] = start
    for t in range(1, cost + 1):
        number[MARK] += 1
        now = number[MARK]
        end = level[t]
        for k in range(level[t - 1], level[t]):
            u = np.int64(member[k])
            lanes_end = first[u + 1]
            if end + (lanes_end - first[u]) + 1 > len(member):
                return -2
            for lane in range(first[u], lanes_end + 1):
                v = head[lane] if lane < lanes_end else u
                if mark[v] == now or t + distance[v] > cost:
                    continue
                if (touched[spot_of[v]] == stamp or t <= last_must) and forbidden(scratch, spot_of[u], spot_of[v], t):
                    continue
                mark[v] = now
                member[end] = v
                end += 1
        level[t + 1] = end
        if end == level[t]:
            return 0
        if end > MOST_MEMBERS:
            return -1
    # backwards: only what leads to the goal stays, packed to the front of each level's room
    begin, end = level[cost], level[cost + 1]
    num_kept = 0
    for k in range(begin, end):
        if member[k] == goal:
            num_kept = 1
    if not num_kept:
        return 0
    member[begin] = goal
    scratch.queue[0] = 1
    total = 1
    number[MARK] += 1
    mark[goal] = number[MARK]
    level[cost + 1] = begin + 1
    for t in range(cost - 1, -1, -1):
        later = number[MARK]
        number[MARK] += 1
        end = level[t]
        room_end = begin
        begin = level[t]
        for k in range(begin, room_end):
            u = np.int64(member[k])
            lanes_end = first[u + 1]
            for lane in range(first[u], lanes_end + 1):
                v = head[lane] if lane < lanes_end else u
                if mark[v] != later:
                    continue
                if not ((touched[spot_of[v]] == stamp or t < last_must) and forbidden(scratch, spot_of[u], spot_of[v], t + 1)):
                    member[end] = u
                    end += 1
                    break
        # a vertex may be in both levels (waiting): marks of this level are set when it is complete
        for k in range(begin, end):
            mark[member[k]] = number[MARK]
        total += end - begin
        member[end:room_end] = -1
    return total


@kernel
def mdd_of(instance, store, scratch, record):
    """See that a record has its MDD: `MDD0` is where its levels begin, or TOO_LARGE.

    Its cost is that of the path, or, of a path that need not be shortest, the least there is: the record's
    `BOUND` is raised to it.

    Returns
    -------
    code
        OK, STORE_FULL or SCRATCH_FULL.
    """
    origin = store.meta[record].origin
    if store.meta[origin].mdd0 == -1:
        code = load(instance, store, scratch, record)
        if code != OK:
            return code
        robot = store.meta[record].robot
        distance = instance.distance[robot]
        cost = max(store.meta[origin].bound, scratch.limit[EARLIEST])
        total = _levels(instance, scratch, instance.start[robot], instance.goal[robot], distance, cost)
        while total == 0:
            cost += 1
            total = _levels(instance, scratch, instance.start[robot], instance.goal[robot], distance, cost)
        if total == -2:
            return SCRATCH_FULL
        if total == -1:
            store.meta[origin].mdd0 = TOO_LARGE
        else:
            first, at = store.used[LEVELS], store.used[MEMBERS]
            if first + cost + 2 > len(store.level) or at + total > len(store.member):
                return STORE_FULL
            for t in range(cost + 1):
                store.level[first + t] = at
                for k in range(scratch.level[t], scratch.level[t + 1]):
                    if scratch.member[k] < 0:
                        break
                    store.member[at] = scratch.member[k]
                    at += 1
            store.level[first + cost + 1] = at
            store.used[LEVELS], store.used[MEMBERS] = first + cost + 2, at
            store.meta[origin].mdd0 = first
            store.meta[origin].bound = cost
    store.meta[record].mdd0 = store.meta[origin].mdd0
    store.meta[record].bound = max(store.meta[record].bound, min(store.meta[origin].bound, store.meta[record].cost))
    return OK


@kernel
def mdd_cost(store, record):
    """The cost of the record's MDD."""
    return store.meta[store.meta[record].origin].bound


@kernel
def only(store, record, step):
    """The vertex of a level with one member, else -1; the last level's after the end."""
    mdd = store.meta[record].mdd0
    if mdd < 0:
        return np.int64(-1)
    k = mdd + min(step, mdd_cost(store, record))
    if store.level[k + 1] - store.level[k] == 1:
        return np.int64(store.member[store.level[k]])
    return np.int64(-1)


@kernel
def raises_cost(instance, store, scratch, record, row0, row1):
    """True if these constraints cut through all paths of the record's MDD. False also when it is too large."""
    mdd = store.meta[record].mdd0
    cost = mdd_cost(store, record)
    begin, end = FOREVER, -1
    for r in range(row0, row1):
        kind = store.rows[r].kind
        if kind == MIN_COST:
            if store.rows[r].begin > cost:
                return True
        elif kind in (RANGE, EDGE, MUST):
            begin = min(begin, np.int64(store.rows[r].begin))
            end = max(end, np.int64(store.rows[r].end))
    if end > cost:  # after its end the robot is at its goal
        goal = instance.spots.of[instance.goal[store.meta[record].robot]]
        for r in range(row0, row1):
            if store.rows[r].kind == RANGE and store.rows[r].spot == goal and store.rows[r].end >= cost:
                return True
    if mdd < 0 or begin > end or begin > cost:
        return False
    end = min(end, cost)
    begin = max(begin, 1)
    mark, number, queue, first, head = scratch.mark, scratch.number, scratch.queue, instance.first, instance.head
    count = 0
    for m in range(store.level[mdd + begin - 1], store.level[mdd + begin]):
        queue[count] = store.member[m]
        count += 1
    for t in range(begin, end + 1):
        number[MARK] += 1
        now = number[MARK]
        low, high = store.level[mdd + t], store.level[mdd + t + 1]
        # negative marks: reached in this level; positive: a member that is not
        for k in range(count):
            u = queue[k]
            lanes_end = first[u + 1]
            for lane in range(first[u], lanes_end + 1):
                v = head[lane] if lane < lanes_end else u
                if mark[v] == -now:
                    continue
                barred, here, there = False, instance.spots.of[u], instance.spots.of[v]
                for r in range(row0, row1):
                    if store.rows[r].begin <= t <= store.rows[r].end:
                        kind = store.rows[r].kind
                        if kind == RANGE:
                            barred = barred or store.rows[r].spot == there
                        elif kind == EDGE:
                            barred = barred or (store.rows[r].spot == there and store.rows[r].tail == here)
                        elif kind == MUST:
                            barred = barred or store.rows[r].spot != there
                if not barred:
                    mark[v] = -now
        count = 0
        for m in range(low, high):
            v = store.member[m]
            if mark[v] == -now:
                queue[count] = v
                count += 1
        if count == 0:
            return True
    return False
