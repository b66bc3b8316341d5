"""Kernel of the joint MDD of two robots: whether they have shortest paths without conflict, and what separates them where not.

Level by level it holds the pairs of places that the two can be at without a conflict up to then. Where no pair is left, every
shortest path of the one is in conflict with every shortest path of the other, however many there are: a cardinal conflict
that no single pair of paths shows. That covers rectangles (Li, Harabor, Stuckey, Ma, Gange, Koenig, "Pairwise symmetry
reasoning for multi-agent path finding search", AIJ 2021, section 4), those generalised to any region between obstacles
(section 5), and combinations of them, on any graph. For two robots it is the mutex propagation of Zhang, Li,
Surynek, Kumar, Koenig, "Multi-agent path finding with mutex propagation", AIJ 2022, with whose exclusion sets it shares the idea
of the split: *lost* places.

A place of robot a at step t is lost when no place of robot b at t goes with it. If a passes a lost place at t and b a lost place at
t' >= t, then both went through their MDDs until t (a path that passes a member of an MDD has come through the MDD), so that they
are in conflict: of two robots in a plan one keeps out of its lost places. At the last level all places are lost, so that
both sides cost more. Of the lost places only the first ones on a path are written: none of the others is reached without them.
"""

import numpy as np

from mrp_sumo.search._constraints import MARK, forbidden, load
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._mdd import mdd_cost
from mrp_sumo.search._records import MIN_COST, OK, RANGE, ROWS, STORE_FULL, add_row

APART, TOGETHER, LOST = 0, 1, 2  # nowhere near each other; a pair of shortest paths is without conflict; none is
UNKNOWN_YET = 3  # an MDD is too large


@kernel(inline="always")
def _level(store, record, cost, step):
    """(first, end) of the members of a level; after the end the robot stays."""
    k = store.meta[record].mdd0 + min(step, cost)
    return store.level[k], store.level[k + 1]


@kernel
def _near(instance, store, scratch, one, other):
    """(first, last) step at which the two may be in conflict, on shortest paths; last is 0 where they cannot."""
    mark, number = scratch.mark, scratch.number
    one_cost, other_cost = mdd_cost(store, one), mdd_cost(store, other)
    first, last = 0, 0
    number[MARK] += 1
    for t in range(max(one_cost, other_cost) + 1):
        number[MARK] += 1
        now = number[MARK]
        begin, end = _level(store, one, one_cost, t)
        for k in range(begin, end):
            mark[store.member[k]] = now
        begin, end = _level(store, other, other_cost, t)
        meets = False
        for k in range(begin, end):
            meets = meets or mark[store.member[k]] >= now - 1  # where the one is, or was a step before
        if instance.following and t > 0:
            begin, end = _level(store, other, other_cost, t - 1)
            for k in range(begin, end):
                meets = meets or mark[store.member[k]] == now
        if meets:
            first, last = first or t, t
    return first, last


@kernel(allocates=True)
def _moves(instance, store, scratch, record, begin, end):
    """The moves between the levels of an MDD from `begin` to `end`.

    Returns
    -------
    code, first, to
        OK, or why there is no room; `first[m]` is where the moves of a member begin, members counted from the first of level
        `begin`; `to` is a place in the next level.
    """
    code = load(instance, store, scratch, record)
    cost = mdd_cost(store, record)
    mark, queue, number = scratch.mark, scratch.queue, scratch.number
    count = 0
    for t in range(begin, end):
        low, high = _level(store, record, cost, t)
        for k in range(low, high):
            u = store.member[k]
            count += 1 + instance.first[u + 1] - instance.first[u]
    size = 0
    for t in range(begin, end):
        low, high = _level(store, record, cost, t)
        size += high - low
    first, to = np.empty(size + 1, np.int32), np.empty(count, np.int32)
    first[0] = 0
    m = count = 0
    for t in range(begin, end):
        number[MARK] += 1
        now = number[MARK]
        low, high = _level(store, record, cost, t + 1)
        for k in range(low, high):
            mark[store.member[k]], queue[store.member[k]] = now, k - low
        low, high = _level(store, record, cost, t)
        for k in range(low, high):
            u = np.int64(store.member[k])
            lanes_end = instance.first[u + 1]
            for lane in range(instance.first[u], lanes_end + 1):
                v = instance.head[lane] if lane < lanes_end else u
                if mark[v] == now and (t >= cost or not forbidden(scratch, u, v, t + 1)):
                    to[count] = queue[v]
                    count += 1
            m += 1
            first[m] = count
    return code, first, to


@kernel
def _places(store, scratch, record, step, of, of_step, entry):
    """For each member of a level of record `of`, its place in a level of `record`, -1 for none."""
    mark, queue, number = scratch.mark, scratch.queue, scratch.number
    number[MARK] += 1
    now = number[MARK]
    low, high = _level(store, record, mdd_cost(store, record), step)
    for k in range(low, high):
        mark[store.member[k]], queue[store.member[k]] = now, k - low
    low, high = _level(store, of, mdd_cost(store, of), of_step)
    for k in range(low, high):
        entry[k - low] = queue[store.member[k]] if mark[store.member[k]] == now else -1


@kernel
def _advance(following, pairs, moves, begins, sizes, swaps):
    """Find the pairs that both can be at a step after others.

    Parameters
    ----------
    following
        Whether following conflicts count.
    pairs
        [A, B] uint8 before and after, which is filled; [B] scratch.
    moves
        (first, to) of ONE and (first, to) of OTHER, see `_moves`.
    begins
        The first member of the level, of ONE and of OTHER.
    sizes
        Members of the level and of the next one, of ONE and of OTHER.
    swaps
        For the places of ONE: where OTHER is at the new place before; where OTHER is at the old place after; both at once.
    """
    pair, after, row = pairs
    one_first, one_to, other_first, other_to = moves
    theirs, mine_after, meets = swaps
    after[: sizes[1], : sizes[3]] = 0
    for a in range(sizes[0]):
        row[: sizes[3]] = 0
        some = False
        for b in range(sizes[2]):
            if pair[a, b]:
                some = True
                for e in range(other_first[begins[1] + b], other_first[begins[1] + b + 1]):
                    row[other_to[e]] = 1
        if not some:
            continue
        for m in range(one_first[begins[0] + a], one_first[begins[0] + a + 1]):
            to = one_to[m]
            from_there, to_here = theirs[to], mine_after[a]
            if (from_there >= 0 and to_here >= 0) or (following and (from_there >= 0 or to_here >= 0)):
                for b in range(sizes[2]):
                    if pair[a, b] and not (following and b == from_there):
                        for e in range(other_first[begins[1] + b], other_first[begins[1] + b + 1]):
                            if not (other_to[e] == to_here and (following or b == from_there)):
                                after[to, other_to[e]] = 1
            else:
                for b in range(sizes[3]):
                    after[to, b] |= row[b]
    for a in range(sizes[1]):
        if meets[a] >= 0:
            after[a, meets[a]] = 0


@kernel
def _note_lost(store, lost, count, both_alive, moves, level):
    """Write the lost places of a robot that it reaches from one that is not; the number written so far.

    Parameters
    ----------
    lost, count
        [N, 2] vertices and steps, and how many there are.
    both_alive
        Which places are not lost before, and after.
    moves
        (first, to), see `_moves`.
    level
        The first member of the level before, its members, the first member of the level after, its step.
    """
    (alive, alive_after), (moves_first, moves_to), (begin, size, low, t) = both_alive, moves, level
    for a in range(size):
        if alive[a]:
            for m in range(moves_first[begin + a], moves_first[begin + a + 1]):
                to = moves_to[m]
                if alive_after[to] == 0:
                    alive_after[to] = 2  # lost, and written
                    lost[count, 0], lost[count, 1] = store.member[low + to], t
                    count += 1
    return count


@kernel(allocates=True)
def joint_paths(instance, store, scratch, one, other):
    """Shortest paths of two robots without a conflict, and where there are none, what to split on.

    Conflicts of moves that clash are not looked for: with these, TOGETHER may be said of robots that are LOST. Nothing is known where
    several vertices are one spot.

    Parameters
    ----------
    one, other
        Records with their MDDs.

    Returns
    -------
    code, verdict, row0, middle, row1
        OK, or why there is no room; APART, TOGETHER, LOST or UNKNOWN_YET; where LOST, the constraints of ONE and those of OTHER, one side
        of which each pair of paths without a conflict keeps.
    """
    nothing = np.int64(0)
    spots = instance.spots
    if store.meta[one].mdd0 < 0 or store.meta[other].mdd0 < 0 or len(spots.place) < len(spots.of):  # members of a level share spots
        return OK, UNKNOWN_YET, nothing, nothing, nothing
    first, last = _near(instance, store, scratch, one, other)
    if last == 0:
        return OK, APART, nothing, nothing, nothing
    one_cost, other_cost = mdd_cost(store, one), mdd_cost(store, other)
    code, one_first, one_to = _moves(instance, store, scratch, one, first - 1, last)
    if code != OK:
        return code, UNKNOWN_YET, nothing, nothing, nothing
    code, other_first, other_to = _moves(instance, store, scratch, other, first - 1, last)
    if code != OK:
        return code, UNKNOWN_YET, nothing, nothing, nothing
    one_most, other_most = 0, 0
    for t in range(first - 1, last + 1):
        low, high = _level(store, one, one_cost, t)
        one_most = max(one_most, high - low)
        low, high = _level(store, other, other_cost, t)
        other_most = max(other_most, high - low)
    pair, after = np.ones((one_most, other_most), np.uint8), np.zeros((one_most, other_most), np.uint8)
    row = np.zeros(other_most, np.uint8)
    theirs, mine_after, meets = np.empty(one_most, np.int64), np.empty(one_most, np.int64), np.empty(one_most, np.int64)
    one_alive, one_alive_after = np.ones(one_most, np.uint8), np.zeros(one_most, np.uint8)
    other_alive, other_alive_after = np.ones(other_most, np.uint8), np.zeros(other_most, np.uint8)
    one_lost, other_lost = np.empty((len(one_first) + one_most, 2), np.int64), np.empty((len(other_first) + other_most, 2), np.int64)
    num_one, num_other = 0, 0
    one_begin, other_begin = 0, 0
    verdict = TOGETHER
    for t in range(first, last + 1):
        one_low, one_high = _level(store, one, one_cost, t - 1)
        other_low, other_high = _level(store, other, other_cost, t - 1)
        one_size, other_size = one_high - one_low, other_high - other_low
        one_low, one_high = _level(store, one, one_cost, t)
        other_low, other_high = _level(store, other, other_cost, t)
        one_next, other_next = one_high - one_low, other_high - other_low
        _places(store, scratch, other, t - 1, one, t, theirs)
        _places(store, scratch, other, t, one, t - 1, mine_after)
        _places(store, scratch, other, t, one, t, meets)
        _advance(
            instance.following,
            (pair, after, row),
            (one_first, one_to, other_first, other_to),
            (one_begin, other_begin),
            (one_size, one_next, other_size, other_next),
            (theirs, mine_after, meets),
        )
        one_alive_after[:one_next], other_alive_after[:other_next] = 0, 0
        num_alive = 0
        for a in range(one_next):
            for b in range(other_next):
                if after[a, b]:
                    one_alive_after[a], other_alive_after[b] = 1, 1
                    num_alive += 1
        level = one_begin, one_size, one_low, t
        num_one = _note_lost(store, one_lost, num_one, (one_alive, one_alive_after), (one_first, one_to), level)
        level = other_begin, other_size, other_low, t
        num_other = _note_lost(store, other_lost, num_other, (other_alive, other_alive_after), (other_first, other_to), level)
        if num_alive == 0:
            verdict = LOST
            break
        for a in range(one_next):
            one_alive[a] = one_alive_after[a] == 1
        for b in range(other_next):
            other_alive[b] = other_alive_after[b] == 1
        pair, after = after, pair
        one_begin += one_size
        other_begin += other_size
    if verdict != LOST:
        return OK, verdict, nothing, nothing, nothing
    row0 = store.used[ROWS]
    fits = _bar_lost(store, one_lost[:num_one], one_cost)
    middle = store.used[ROWS]
    fits = fits and _bar_lost(store, other_lost[:num_other], other_cost)
    if not fits:
        store.used[ROWS] = row0
        return STORE_FULL, verdict, nothing, nothing, nothing
    return OK, verdict, row0, middle, store.used[ROWS]


@kernel
def _bar_lost(store, lost, cost):
    """Keep a robot from its lost places; False where there is no room. At its goal after its end: from ending so early."""
    fits = True
    for k in range(len(lost)):
        v, t = lost[k]
        if not (add_row(store, RANGE, v, -1, t, t) if t <= cost else add_row(store, MIN_COST, v, -1, cost + 1, cost + 1)):
            fits = False
    return fits


@kernel
def breaks(store, record, row0, row1):
    """True if the path of a record does not keep these constraints, RANGE and MIN_COST."""
    path0, cost = store.meta[record].path0, store.meta[record].cost
    for r in range(row0, row1):
        v, begin, end = store.rows[r].spot, np.int64(store.rows[r].begin), np.int64(store.rows[r].end)
        if store.rows[r].kind == MIN_COST:
            if cost < begin:
                return True
        elif begin <= cost:
            for t in range(begin, min(end, cost) + 1):
                if store.path[path0 + t].spot == v:
                    return True
        elif store.path[path0 + cost].spot == v:
            return True
    return False
