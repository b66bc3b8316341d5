"""Kernels that find conflicts between the paths of records.

A conflict says of which robots, `one` and `other`, what kind, where and when; then, filled in by those who choose between conflicts, its
priority and the constraints to split on: rows a0..a1 for `one`, b0..b1 for `other`.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._clashing import move_of
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._occupancy import steps_known, visitor
from mrp_sumo.search._records import spot_at

CONFLICT = np.dtype(
    (np.record, [(name, np.int32) for name in ("one", "other", "kind", "tail", "at", "step", "priority", "a0", "a1", "b0", "b1")])
)
MEET = 0  # both are at `at` at `step`
SWAP = 1  # one comes from tail to at at step, other the other way
TARGET = 2  # one stays at at, its goal, when other is there at step
FOLLOW = 3  # one is at at at step, other is there one step later
CLASH = 4  # the moves that lead to step clash
CLASH_AT_TARGET = 5  # one stays at at, its goal, when other makes a move that clashes with it, which leads to step
UNKNOWN = -1  # a priority not yet looked at


class _Move(NamedTuple):
    """A robot's move from spot u to spot v, which ends at step t; its path has `cost` steps."""

    robot: int
    cost: int
    u: int
    v: int
    t: int


@kernel(allocates=True)
def conflicts_of(instance, store, occupancy, robot, record, old):
    """The conflicts of a robot on a new record with all installed others, after those of `old` that are not its own.

    Parameters
    ----------
    old
        [K] CONFLICT before.

    Returns
    -------
    conflicts
        [K'] CONFLICT in a new array.
    """
    conflicts = np.empty(len(old) + 16, CONFLICT)
    end = 0
    for k in range(len(old)):
        if old[k].one != robot and old[k].other != robot:
            conflicts[end] = old[k]
            end += 1
    count = _find(instance, store, occupancy, robot, record, conflicts, end)
    if count > len(conflicts):
        longer = np.empty(count, CONFLICT)
        for k in range(end):
            longer[k] = conflicts[k]
        conflicts = longer
        count = _find(instance, store, occupancy, robot, record, conflicts, end)
    return conflicts[:count]


@kernel
def _find(instance, store, occupancy, robot, record, conflicts, count):
    """Add the conflicts of a robot, step by step, to the first `count`; how many there are then, also where they do not fit."""
    path0, cost, following, near = store.meta[record].path0, store.meta[record].cost, instance.following, instance.clashes.any
    latest = np.int64(0)
    for r in range(len(occupancy.record)):
        if occupancy.record[r] >= 0:
            latest = max(latest, store.meta[occupancy.record[r]].cost)
    u = np.int64(store.path[path0].spot)
    for t in range(max(cost, latest) + 1):
        v = np.int64(store.path[path0 + min(t, cost)].spot)
        move = _Move(robot, cost, u, v, np.int64(t))
        count = _meetings(occupancy, move, conflicts, count)
        if u != v and following:
            count = _entered_too_early(store, occupancy, move, conflicts, count)
            count = _left_too_late(store, occupancy, move, conflicts, count)
        elif u != v:
            count = _swaps(store, occupancy, move, conflicts, count)
        if near and t > 0:
            count = _clashes(instance, store, occupancy, move, conflicts, count)
        u = v
    return count


@kernel(inline="always")
def _meetings(occupancy, move, conflicts, count):
    """Others that are at v, where the robot is at t: on their way, or at their goals for good."""
    robot, cost, _, v, t = move
    if t < steps_known(occupancy):
        visit = visitor(occupancy, v, t, 0)
        while visit:
            other = visit - t * len(occupancy.record) - 1
            if t < cost:
                count = _add(conflicts, count, (min(robot, other), max(robot, other)), MEET, -1, v, t)
            else:
                count = _add(conflicts, count, (robot, other), TARGET, -1, v, t)
            visit = visitor(occupancy, v, t, visit)
    if t <= cost and occupancy.since[v] <= t:
        count = _add(conflicts, count, (np.int64(occupancy.parked[v]), robot), TARGET, -1, v, t)
    return count


@kernel(inline="always")
def _swaps(store, occupancy, move, conflicts, count):
    """Others that go from v to u as the robot goes from u to v."""
    robot, _, u, v, t = move
    if t - 1 < steps_known(occupancy):
        visit = visitor(occupancy, v, t - 1, 0)
        while visit:
            other = visit - (t - 1) * len(occupancy.record) - 1
            if spot_at(store, occupancy.record[other], t) == u:
                if robot < other:
                    count = _add(conflicts, count, (robot, other), SWAP, u, v, t)
                else:
                    count = _add(conflicts, count, (other, robot), SWAP, v, u, t)
            visit = visitor(occupancy, v, t - 1, visit)
    return count


@kernel(inline="always")
def _entered_too_early(store, occupancy, move, conflicts, count):
    """Others that leave v as the robot enters it."""
    robot, _, _, v, t = move
    if t - 1 < steps_known(occupancy):
        visit = visitor(occupancy, v, t - 1, 0)
        while visit:
            other = visit - (t - 1) * len(occupancy.record) - 1
            if spot_at(store, occupancy.record[other], t) != v:
                count = _add(conflicts, count, (other, robot), FOLLOW, -1, v, t - 1)
            visit = visitor(occupancy, v, t - 1, visit)
    return count


@kernel(inline="always")
def _left_too_late(store, occupancy, move, conflicts, count):
    """Others that enter u as the robot leaves it for v; of two that swap, `_entered_too_early` finds the conflict."""
    robot, _, u, v, t = move
    if t < steps_known(occupancy):
        visit = visitor(occupancy, u, t, 0)
        while visit:
            other = visit - t * len(occupancy.record) - 1
            came = spot_at(store, occupancy.record[other], t - 1)
            if came != u and came != v:
                count = _add(conflicts, count, (robot, other), FOLLOW, -1, u, t - 1)
            visit = visitor(occupancy, u, t, visit)
    parked = np.int64(occupancy.parked[u])
    if parked >= 0 and occupancy.since[u] == t and spot_at(store, occupancy.record[parked], t - 1) != v:
        count = _add(conflicts, count, (robot, parked), FOLLOW, -1, u, t - 1)
    return count


@kernel
def _clashes(instance, store, occupancy, move, conflicts, count):
    """Others whose moves to step t clash with the robot's from u to v, or that are then at its place."""
    clashes, spots, num_robots, before, t = instance.clashes, instance.spots, len(occupancy.record), count, move.t
    for k in range(spots.beside_first[move.v], spots.beside_first[move.v + 1]):
        count = _clashes_at(store, occupancy, move, (spots.beside[k], t), conflicts, before, count)
    own = move_of(spots.first, spots.head, move.u, move.v)
    for k in range(clashes.vertex_first[own], clashes.vertex_first[own + 1]):
        count = _clashes_at(store, occupancy, move, (clashes.vertex[k], t - 1), conflicts, before, count)
    for k in range(clashes.lane_first[own], clashes.lane_first[own + 1]):
        lane = clashes.lane[k]
        if t - 1 < steps_known(occupancy):
            visit = visitor(occupancy, spots.tail[lane], t - 1, 0)
            while visit:
                other = visit - (t - 1) * num_robots - 1
                if spot_at(store, occupancy.record[other], t) == spots.head[lane]:
                    count = _add_clash(store, occupancy, move, other, conflicts, before, count)
                visit = visitor(occupancy, spots.tail[lane], t - 1, visit)
    return count


@kernel
def _clashes_at(store, occupancy, move, since, conflicts, before, count):
    """Others that are at a spot from a step on to that of the move: (spot, step)."""
    (w, begin), num_robots = since, len(occupancy.record)
    for step in range(begin, move.t + 1):
        if step < steps_known(occupancy):
            visit = visitor(occupancy, w, step, 0)
            while visit:
                count = _add_clash(store, occupancy, move, visit - step * num_robots - 1, conflicts, before, count)
                visit = visitor(occupancy, w, step, visit)
    if occupancy.since[w] <= move.t:
        count = _add_clash(store, occupancy, move, np.int64(occupancy.parked[w]), conflicts, before, count)
    return count


@kernel
def _add_clash(store, occupancy, move, other, conflicts, before, count):
    """Write the clash of two robots at a step unless it has been, since there were `before` conflicts."""
    robot, cost, _, v, t = move
    for k in range(before, min(count, len(conflicts))):
        if conflicts[k].one + conflicts[k].other == robot + other and (conflicts[k].one == other or conflicts[k].other == other):
            return count
    if count > len(conflicts):  # they are only counted, and again when there is room
        return count + 1
    record = occupancy.record[other]
    if cost < t:
        return _add(conflicts, count, (robot, other), CLASH_AT_TARGET, -1, v, t)
    if store.meta[record].cost < t:
        return _add(conflicts, count, (other, robot), CLASH_AT_TARGET, -1, spot_at(store, record, t), t)
    return _add(conflicts, count, (min(robot, other), max(robot, other)), CLASH, -1, v, t)


@kernel
def _add(conflicts, count, robots, kind, tail, at, step):
    """Write a conflict where there is room for it; the number of conflicts with it."""
    if count < len(conflicts):
        row = conflicts[count]
        row.one, row.other = robots
        row.kind, row.tail, row.at, row.step, row.priority = kind, tail, at, step, UNKNOWN
        row.a0, row.a1, row.b0, row.b1 = 0, 0, 0, 0
    return count + 1
