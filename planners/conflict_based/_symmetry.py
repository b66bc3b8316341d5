"""Kernels that choose the conflict to split on, and how to split it: cardinality and pairwise symmetries.

Sources: Boyarski et al., "ICBS: improved conflict-based search algorithm for multi-agent pathfinding", IJCAI 2015
(cardinal conflicts first); Li, Harabor, Stuckey, Ma, Gange, Koenig, "Pairwise symmetry reasoning for multi-agent
path finding search", AIJ 2021 (rectangles with barrier constraints in section 4, targets in section 5, corridors
in section 6). Every split is sound: each pair of paths without conflict keeps one side's constraints at least.

Where paths are shortest ones the joint MDD of two robots finds what no single conflict shows, see `_joint_mdd.py`; what is here is
for those that are not cardinal, and for longer paths. Rectangles are looked for on 4-connected grids only. The barrier of a robot is
restricted to the members of its MDD: a path through (vertex, step) of an MDD has come through the MDD's earlier levels of one member, so
it has entered the rectangle where the reasoning needs it to.
"""

import numpy as np

from mrp_sumo.search._clashing import move_of, too_close
from mrp_sumo.search._conflicts import (
    CLASH,
    CLASH_AT_TARGET,
    MEET,
    SWAP,
    TARGET,
    UNKNOWN,
)
from mrp_sumo.search._constraints import load
from mrp_sumo.search._distance import UNREACHABLE
from mrp_sumo.search._earliest import NO_EDGE, earliest_arrival, is_banned
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._mdd import mdd_cost, mdd_of, only, raises_cost
from mrp_sumo.search._records import (
    EDGE,
    FOREVER,
    MIN_COST,
    NO_PATH,
    OK,
    RANGE,
    ROWS,
    STORE_FULL,
    add_row,
    spot_at,
)
from planners.conflict_based._joint_mdd import LOST, UNKNOWN_YET, breaks, joint_paths

PLAIN, RECTANGLE, CORRIDOR, AT_TARGET = 0, 1, 2, 3  # in the order of preference among equally cardinal ones
CARDINAL = 2  # the rank of a split that raises the cost of both
MOST_CORNERS = 5  # levels of one member looked at for each corner of a rectangle
CORRIDOR_BUDGET = 20_000  # expansions for an arrival time


@kernel(allocates=True)
def choose(instance, store, scratch, records, conflicts, symmetries, shortest):
    """Fill in the priorities and splits that are unknown, and choose.

    Parameters
    ----------
    records
        [R] of the node.
    conflicts
        [K] CONFLICT, K > 0; priorities and splits are written.
    symmetries
        Whether to look for rectangles, corridors and targets.
    shortest
        Whether to ask the joint MDD, too, which tells most where paths are shortest ones.

    Returns
    -------
    code, chosen
        OK and the row of the conflict to split on: cardinal ones before semi-cardinal before others, then by
        kind, then the earliest.
    """
    chosen = -1
    joint = np.empty((len(conflicts), 6), np.int64), np.zeros(1, np.int64)  # pairs of robots asked, what came of it, constraints; how many
    for k in range(len(conflicts)):
        row = conflicts[k]
        if row.priority == UNKNOWN:
            one, other = records[row.one], records[row.other]
            for record in (one, other):
                if store.meta[record].mdd0 == -1:
                    code = mdd_of(instance, store, scratch, record)
                    if code != OK:
                        return code, -1
            code = _split(instance, store, scratch, one, other, row, symmetries)
            if code == OK and symmetries and shortest and row.priority < 4 * CARDINAL:
                code = _split_joint(instance, store, scratch, one, other, row, joint)
            if code != OK:
                row.priority = UNKNOWN
                return code, -1
        if (
            chosen < 0
            or row.priority > conflicts[chosen].priority
            or (row.priority == conflicts[chosen].priority and row.step < conflicts[chosen].step)
        ):
            chosen = k
    return OK, chosen


@kernel(inline="always", allocates=True)
def _split_joint(instance, store, scratch, one, other, row, known):
    """Where all shortest paths of the two are in conflict, write the split that raises the cost of both.

    `known` holds what came of other pairs, and how many it holds.
    """
    joint, num_joint = known
    low, high = min(row.one, row.other), max(row.one, row.other)
    k = 0
    while k < num_joint[0] and (joint[k, 0] != low or joint[k, 1] != high):
        k += 1
    if k == num_joint[0]:
        first, second = (one, other) if row.one == low else (other, one)
        code, verdict, row0, middle, row1 = joint_paths(instance, store, scratch, first, second)
        if code != OK:
            return code
        if verdict == LOST and not (breaks(store, first, row0, middle) and breaks(store, second, middle, row1)):
            verdict = UNKNOWN_YET  # a path that is not among the shortest may go on as it is
        joint[k, 0], joint[k, 1], joint[k, 2], joint[k, 3], joint[k, 4], joint[k, 5] = low, high, verdict, row0, middle, row1
        num_joint[0] += 1
    if joint[k, 2] == LOST:
        if row.one == low:
            row.a0, row.a1, row.b0, row.b1 = joint[k, 3], joint[k, 4], joint[k, 4], joint[k, 5]
        else:
            row.a0, row.a1, row.b0, row.b1 = joint[k, 4], joint[k, 5], joint[k, 3], joint[k, 4]
        row.priority = 4 * CARDINAL + RECTANGLE
    return OK


@kernel(inline="always", allocates=True)
def _split(instance, store, scratch, one, other, row, symmetries):
    """Write the best split of one conflict."""
    kind, at, step = row.kind, row.at, row.step
    begin = store.used[ROWS]
    if begin + 4 > len(store.rows):
        return STORE_FULL
    sort = PLAIN
    if kind in (CLASH, CLASH_AT_TARGET):
        sort = AT_TARGET if kind == CLASH_AT_TARGET else PLAIN
        middle = _split_clash(instance, store, one, other, row)
        if middle < 0:
            store.used[ROWS] = begin
            return STORE_FULL
    elif kind == TARGET:
        sort = AT_TARGET
        add_row(store, MIN_COST, at, -1, step + 1, step + 1)
        middle = store.used[ROWS]
        if not _bar_place(instance, store, at, step, FOREVER):
            store.used[ROWS] = begin
            return STORE_FULL
    elif kind == MEET:
        middle = _split_meeting(instance, store, at, at, step)
        if middle < 0:
            store.used[ROWS] = begin
            return STORE_FULL
    elif kind == SWAP:
        add_row(store, EDGE, at, row.tail, step, step)
        middle = store.used[ROWS]
        add_row(store, EDGE, row.tail, at, step, step)
    else:
        add_row(store, RANGE, at, -1, step, step)
        middle = store.used[ROWS]
        add_row(store, RANGE, at, -1, step + 1, step + 1)
    row.a0, row.a1, row.b0, row.b1 = begin, middle, middle, store.used[ROWS]
    rank = _rank(instance, store, scratch, one, other, row)
    if symmetries and kind in (MEET, SWAP, CLASH):
        corridor = np.empty(4, np.int64)
        if _corridor_of(instance, store, one, other, row, corridor):
            code = _split_corridor(instance, store, scratch, one, other, row, corridor)
            if code == OK:
                sort = CORRIDOR
                rank = _rank(instance, store, scratch, one, other, row)
            elif code != NO_PATH:
                return code
        if sort == PLAIN and kind == MEET and len(instance.column) and rank < 2:
            used_before = store.used[ROWS]
            code = _split_rectangle(instance, store, one, other, row)
            if code == OK:
                sort = RECTANGLE
                rank = _rank(instance, store, scratch, one, other, row)
            elif code == NO_PATH:
                store.used[ROWS] = used_before
            else:
                return code
    row.priority = 4 * rank + sort
    return OK


@kernel(allocates=True)
def _split_clash(instance, store, one, other, row):
    """Rows that keep two robots from making moves that clash; the row at which those of OTHER begin, -1 where there is no room.

    One robot is kept from a place, the other from all that clashes with it: a multi-constraint of Li, Surynek, Felner, Ma, Kumar,
    Koenig, "Multi-agent path finding for large agents", AAAI 2019. Of two robots in a plan one keeps its side, since
    everything on the one side clashes with everything on the other.
    """
    clashes, spots, step = instance.clashes, instance.spots, np.int64(row.step)
    if row.kind == CLASH_AT_TARGET:
        fits = add_row(store, MIN_COST, row.at, -1, step + 1, step + 1)
        middle = store.used[ROWS]
        fits = fits and _bar_place(instance, store, row.at, step, FOREVER)
        return middle if fits and _bar(instance, store, len(spots.head) + row.at, (step - 1, FOREVER, step, FOREVER)) else np.int64(-1)
    moves = np.empty((2, 3), np.int64)
    for side in range(2):
        record = one if side == 0 else other
        u, v = spot_at(store, record, step - 1), spot_at(store, record, step)
        moves[side, 0], moves[side, 1], moves[side, 2] = u, v, move_of(spots.first, spots.head, u, v)
    for k in range(spots.beside_first[moves[0, 1]], spots.beside_first[moves[0, 1] + 1]):
        if spots.beside[k] == moves[1, 1]:
            return _split_meeting(instance, store, moves[0, 1], moves[1, 1], step)
    for side in range(2):  # who is kept from a place
        mine, theirs = moves[side], moves[1 - side]
        for end in range(1, -1, -1):
            v, t = mine[end], step - 1 + end
            if too_close(clashes, len(spots.head) + v, theirs[2], theirs[0], theirs[1]):
                return _two_sides(instance, store, side, (RANGE, v, -1, t), len(spots.head) + v, (max(t - 1, 0), t + 1, t, t + 1))
    edge = EDGE, moves[0, 1], moves[0, 0], step
    return _two_sides(instance, store, 0, edge, moves[0, 2], (step - 1, step, step, step))


@kernel
def _split_meeting(instance, store, one_at, other_at, step):
    """Keep one of two robots from a place at a step; the row at which those of OTHER begin, -1 where there is no room."""
    fits = _bar_place(instance, store, one_at, step, step)
    middle = store.used[ROWS]
    return middle if fits and _bar_place(instance, store, other_at, step, step) else np.int64(-1)


@kernel
def _bar_place(instance, store, v, begin, end):
    """Keep a robot from the place of spot v, from a step to another. False where there is no room."""
    spots, fits = instance.spots, add_row(store, RANGE, v, -1, begin, end)
    for k in range(spots.beside_first[v], spots.beside_first[v + 1]):
        fits = fits and add_row(store, RANGE, spots.beside[k], -1, begin, end)
    return fits


@kernel
def _two_sides(instance, store, side, where, move, span):
    """Keep the robot of a side from a place (kind, v, u, t), the other from what clashes with `move`; see `_bar` for `span`.

    Returns the row at which those of OTHER begin, -1 where there is no room.
    """
    kind, v, u, t = where
    if side == 0:
        fits = add_row(store, kind, v, u, t, t)
        middle = store.used[ROWS]
        fits = fits and _bar(instance, store, move, span)
    else:
        fits = _bar(instance, store, move, span)
        middle = store.used[ROWS]
        fits = fits and add_row(store, kind, v, u, t, t)
    return middle if fits else np.int64(-1)


@kernel
def _bar(instance, store, move, span):
    """Keep a robot from what clashes with a move. `span`: the steps from and to which spots are barred, and arrivals by moves."""
    begin, end, arrive, until = span
    clashes = instance.clashes
    fits = True
    for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
        fits = fits and add_row(store, RANGE, clashes.vertex[k], -1, begin, end)
    for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
        lane = clashes.lane[k]
        fits = fits and add_row(store, EDGE, instance.spots.head[lane], instance.spots.tail[lane], arrive, until)
    return fits


@kernel
def _rank(instance, store, scratch, one, other, row):
    """2 for a cardinal split, 1 for a semi-cardinal one, else 0."""
    rank = 0
    if raises_cost(instance, store, scratch, one, row.a0, row.a1):
        rank += 1
    if raises_cost(instance, store, scratch, other, row.b0, row.b1):
        rank += 1
    return rank


@kernel
def _between(instance, v, ends):
    """Whether the place of spot v has exactly two neighbours; a spot at each is written to `ends`."""
    spots, count = instance.spots, 0
    for k in range(spots.beside_first[v] - 1, spots.beside_first[v + 1]):
        u = v if k < spots.beside_first[v] else spots.beside[k]
        for m in range(spots.first[u], spots.first[u + 1]):
            count = _noted(spots.place, ends, count, spots.head[m])
        for m in range(spots.first_in[u], spots.first_in[u + 1]):
            count = _noted(spots.place, ends, count, spots.tail_in[m])
    return count == 2


@kernel
def _noted(place_of, ends, count, v):
    """Write a spot to `ends` unless one at its place is there; how many places there are then, of which two are written."""
    for k in range(min(count, 2)):
        if place_of[ends[k]] == place_of[v]:
            return count
    if count < 2:
        ends[count] = v
    return count + 1


@kernel(allocates=True)
def _followed(instance, row, before, at, other_end):
    """Follow a corridor to which one comes from `before`: its end, the spot before that, and the lanes to there, -1 on a ring."""
    place_of, ends, lanes = instance.spots.place, np.empty(2, np.int64), 0
    while not _is_bound_for(instance, row, at) and _between(instance, at, ends):
        onward = ends[0] if place_of[ends[1]] == place_of[before] else ends[1]
        if place_of[onward] == place_of[other_end]:
            return at, before, -1
        before, at, lanes = at, onward, lanes + 1
    return at, before, lanes


@kernel
def _is_bound_for(instance, row, v):
    """Whether one of the two robots of a conflict starts or ends at the place of spot v."""
    spots = instance.spots
    for robot in (row.one, row.other):
        start, goal = spots.of[instance.start[robot]], spots.of[instance.goal[robot]]
        if spots.place[v] == spots.place[start] or spots.place[v] == spots.place[goal]:
            return True
    return False


@kernel(allocates=True)
def _corridor_of(instance, store, one, other, row, corridor):
    """Find the corridor around a conflict of robots that go through it in opposite directions.

    `corridor` becomes: the end at which ONE comes out, the end at which OTHER comes out, its length in lanes,
    and the spot before ONE's end.
    """
    place_of, ends, step = instance.spots.place, np.empty(2, np.int64), row.step
    at, beyond = spot_at(store, one, step), spot_at(store, other, step)
    if place_of[at] == place_of[beyond]:
        if _is_bound_for(instance, row, at) or not _between(instance, at, ends):
            return False
        # the robots came from either side
        one_from, other_from = np.int64(-1), np.int64(-1)
        for t in range(step - 1, -1, -1):
            if one_from < 0 and place_of[spot_at(store, one, t)] != place_of[at]:
                one_from = spot_at(store, one, t)
            if other_from < 0 and place_of[spot_at(store, other, t)] != place_of[at]:
                other_from = spot_at(store, other, t)
        if one_from < 0 or other_from < 0 or place_of[one_from] == place_of[other_from]:
            return False
        ahead, behind = other_from, one_from  # seen from ONE
        length = 2
        last, previous = at, at
    else:
        ahead, behind = at, beyond
        if place_of[spot_at(store, one, step - 1)] != place_of[behind] or place_of[spot_at(store, other, step - 1)] != place_of[ahead]:
            return False
        length = 1
        last, previous = behind, ahead
    ahead, corridor[3], more = _followed(instance, row, last, ahead, behind)
    if more < 0:
        return False
    behind, _, others = _followed(instance, row, previous, behind, ahead)
    if others < 0:
        return False
    length += more + others
    if length < 2:
        return False
    corridor[0], corridor[1], corridor[2] = ahead, behind, length
    return True


@kernel
def _first_at(instance, store, record, spot, step):
    """When the path is at the place of a spot, from a step on; -1 for never."""
    place_of, path0, cost = instance.spots.place, store.meta[record].path0, store.meta[record].cost
    for t in range(step, cost + 1):
        if place_of[store.path[path0 + t].spot] == place_of[spot]:
            return t
    return -1


@kernel
def _steps_without(instance, scratch, end, banned):
    """Fill `scratch.reach` with the steps to the place of spot `end` that do not use an edge between two places."""
    reach, queue, spots = scratch.reach, scratch.queue, instance.spots
    reach[:] = UNREACHABLE
    k, count = 0, 0
    for v in range(len(spots.of)):
        if spots.place[spots.of[v]] == spots.place[end]:
            reach[v] = 0
            queue[count] = v
            count += 1
    while k < count:
        v = queue[k]
        k += 1
        for m in range(instance.first_in[v], instance.first_in[v + 1]):
            u = instance.tail_in[m]
            if reach[u] == UNREACHABLE and not is_banned(spots.place, spots.of[u], spots.of[v], banned):
                reach[u] = reach[v] + 1
                queue[count] = u
                count += 1


@kernel
def _arrival(instance, scratch, start, end, banned):
    """The earliest step at the place of spot `end` under the loaded constraints, FOREVER if never; a lower bound when it takes too long."""
    _steps_without(instance, scratch, end, banned)
    code, cost, _ = earliest_arrival(instance, scratch, start, scratch.reach_read, False, banned, CORRIDOR_BUDGET)
    return np.int64(FOREVER) if code == NO_PATH else np.int64(cost)


@kernel
def _split_corridor(instance, store, scratch, one, other, row, corridor):
    """Range constraints at the ends of a corridor; NO_PATH when they would not end the conflict."""
    one_end, other_end, length, step, place_of = corridor[0], corridor[1], corridor[2], row.step, instance.spots.place
    cut = place_of[spot_at(store, one, step)], place_of[spot_at(store, other, step)]
    if cut[0] == cut[1]:
        cut = place_of[corridor[3]], place_of[one_end]
    one_at = _first_at(instance, store, one, one_end, step)
    other_at = _first_at(instance, store, other, other_end, step)
    if one_at < 0 or other_at < 0:
        return NO_PATH
    code = load(instance, store, scratch, one)
    if code != OK:
        return code
    one_start = instance.start[row.one]
    one_through = _arrival(instance, scratch, one_start, one_end, NO_EDGE)
    one_around = _arrival(instance, scratch, one_start, one_end, cut)
    if one_at >= one_around:
        return NO_PATH
    code = load(instance, store, scratch, other)
    if code != OK:
        return code
    other_start = instance.start[row.other]
    other_through = _arrival(instance, scratch, other_start, other_end, NO_EDGE)
    other_around = _arrival(instance, scratch, other_start, other_end, cut)
    one_until = min(one_around - 1, other_through + length)
    other_until = min(other_around - 1, one_through + length)
    if one_at > one_until or other_at > other_until:
        return NO_PATH
    begin = store.used[ROWS]
    fits = _bar_place(instance, store, one_end, 0, one_until)
    middle = store.used[ROWS]
    if not (fits and _bar_place(instance, store, other_end, 0, other_until)):
        return STORE_FULL
    row.a0, row.a1, row.b0, row.b1 = begin, middle, middle, store.used[ROWS]
    return OK


@kernel
def _corners(instance, store, record, at, step, direction, corner):
    """Steps of MDD levels with one member from which (direction -1) or to which (+1) all paths run straight to the conflict.

    The conflict's own step comes first; [MOST_CORNERS] steps, nearest first, are written. Straight: in as many steps as cells lie between.
    """
    count = 0
    t = step
    cost = mdd_cost(store, record)
    while 0 <= t <= cost and count < MOST_CORNERS:
        v = only(store, record, t)
        if v >= 0:
            apart = abs(instance.column[v] - instance.column[at]) + abs(instance.line[v] - instance.line[at])
            if apart != abs(step - t):
                break
            corner[count] = t
            count += 1
        t += direction
    return count


@kernel
def _ways(instance, store, record, at, direction, step, ways):
    """The signs in which a corner at `step` lies from the conflict, in the sense of travel: ways[0] for columns, ways[1] for lines."""
    v = only(store, record, step)
    ways[0] = direction * np.sign(instance.column[v] - instance.column[at])
    ways[1] = direction * np.sign(instance.line[v] - instance.line[at])


@kernel(allocates=True)
def _split_rectangle(instance, store, one, other, row):
    """Barrier constraints of a rectangle around a meeting; NO_PATH when there is none."""
    at, step = row.at, row.step
    if store.meta[one].mdd0 < 0 or store.meta[other].mdd0 < 0:
        return NO_PATH
    if step > mdd_cost(store, one) or step > mdd_cost(store, other):
        return NO_PATH
    corner, num, ways = np.empty((4, MOST_CORNERS), np.int64), np.empty(4, np.int64), np.empty((4, 2), np.int64)
    for side in range(4):  # where ONE and OTHER come from, where they go
        record, direction = one if side % 2 == 0 else other, -1 if side < 2 else 1
        num[side] = _corners(instance, store, record, at, step, direction, corner[side])
    for a in range(num[0] - 1, -1, -1):
        for b in range(num[1] - 1, -1, -1):
            for c in range(num[2] - 1, -1, -1):
                for d in range(num[3] - 1, -1, -1):
                    steps = corner[0, a], corner[1, b], corner[2, c], corner[3, d]
                    for side in range(4):
                        record, direction = one if side % 2 == 0 else other, -1 if side < 2 else 1
                        _ways(instance, store, record, at, direction, steps[side], ways[side])
                    begins, ends = (
                        (only(store, one, steps[0]), only(store, other, steps[1])),
                        (only(store, one, steps[2]), only(store, other, steps[3])),
                    )
                    code = _barriers(instance, store, one, other, row, (begins, ends), ways)
                    if code != NO_PATH:
                        return code
    return NO_PATH


@kernel(allocates=True)
def _barriers(instance, store, one, other, row, corners, ways):
    """The barriers for these corners; NO_PATH when they make no rectangle or a path does not break its barrier."""
    (from_one, from_other), (to_one, to_other) = corners
    at, step = row.at, row.step
    right, up = 0, 0  # the directions in which both travel
    for k in range(4):
        if ways[k, 0] * right < 0 or ways[k, 1] * up < 0:
            return NO_PATH
        right = right or ways[k, 0]
        up = up or ways[k, 1]
    if right == 0 or up == 0:
        return NO_PATH
    # in coordinates that grow in the direction of travel
    x_one, y_one = right * instance.column[from_one], up * instance.line[from_one]
    x_other, y_other = right * instance.column[from_other], up * instance.line[from_other]
    if x_one <= x_other and y_one >= y_other and (x_one, y_one) != (x_other, y_other):
        one_from_left = True
    elif x_one >= x_other and y_one <= y_other and (x_one, y_one) != (x_other, y_other):
        one_from_left = False
    else:
        return NO_PATH
    low_x, low_y = max(x_one, x_other), max(y_one, y_other)
    high_x = min(right * instance.column[to_one], right * instance.column[to_other])
    high_y = min(up * instance.line[to_one], up * instance.line[to_other])
    x_at, y_at = right * instance.column[at], up * instance.line[at]
    if low_x > x_at or low_y > y_at or high_x < x_at or high_y < y_at or (low_x == high_x and low_y == high_y):
        return NO_PATH
    begin = store.used[ROWS]
    bounds = np.empty(3, np.int64)
    bounds[0] = begin
    for k in range(2):
        record = one if k == 0 else other
        path0, cost = store.meta[record].path0, store.meta[record].cost
        mdd_end = mdd_cost(store, record)
        vertical = one_from_left == (k == 0)  # who enters from the left leaves through the right side
        broken = False
        length = high_y - low_y + 1 if vertical else high_x - low_x + 1
        for m in range(length):
            x, y = (high_x, low_y + m) if vertical else (low_x + m, high_y)
            t = step + (x + y) - (x_at + y_at)
            if t < 0 or t > mdd_end:
                continue
            mdd = store.meta[record].mdd0
            for p in range(store.level[mdd + t], store.level[mdd + t + 1]):
                v = store.member[p]
                if right * instance.column[v] == x and up * instance.line[v] == y:
                    if not add_row(store, RANGE, v, -1, t, t):
                        return STORE_FULL
                    if t <= cost and store.path[path0 + t].spot == v:
                        broken = True
                    break
        bounds[k + 1] = store.used[ROWS]
        if not broken:
            store.used[ROWS] = begin
            return NO_PATH
    row.a0, row.a1, row.b0, row.b1 = bounds[0], bounds[1], bounds[1], bounds[2]
    return OK
