"""Kernels of safe interval path planning: a path in time among robots whose paths are fixed.

Source: Phillips, Likhachev, "SIPP: safe interval path planning for dynamic environments", ICRA 2011, in whole
steps. A vertex's time is cut into intervals in which nobody stands on it, nor makes a move that clashes with waiting there; of
two arrivals in one interval the earlier is as good as the later, so the search has a state an interval, not a state a step.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.core.clashes import Clashes
from mrp_sumo.search._clashing import move_of
from mrp_sumo.search._distance import UNREACHABLE
from mrp_sumo.search._heap import pop, push
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._records import NO_PATH, OK, SCRATCH_FULL

FOREVER = 1 << 40


class Intervals(NamedTuple):
    """Safe intervals of all vertices. The list of v begins at interval v; others follow by `after`, in time."""

    span: np.ndarray  # [N, 2] int64, first and last free step
    after: np.ndarray  # [N] int64, next interval of the vertex, -1 at the end
    vertex: np.ndarray  # [N] int64
    leaver: np.ndarray  # [N] int64, where the robot that freed the vertex went as the interval began, -1 for none
    barred_first: np.ndarray  # [L] int64, the last entry of a lane in `barred`, -1 for none
    barred: np.ndarray  # [B, 3] int64, arrivals from and to which nobody may drive along a lane, and its entry before, -1 for none
    left_first: np.ndarray  # [V] int64, the last entry of a vertex in `left`, -1 for none
    left: np.ndarray  # [D, 3] int64, when a robot arrived elsewhere, and where; the vertex's entry before, -1 for none
    count: np.ndarray  # [3] int64, intervals, entries of `barred` and of `left` in use


class SippScratch(NamedTuple):
    """Scratch of a search, by interval."""

    arrival: np.ndarray  # [N] int64
    parent: np.ndarray  # [N] int64
    stamp: np.ndarray  # [N] int64, the search that wrote; [0] of `searches` counts them
    heap: np.ndarray  # [H] int64
    searches: np.ndarray  # [1] int64


def new_intervals(num_vertices: int, num_lanes: int, capacity: int, clashes: Clashes) -> tuple[Intervals, SippScratch]:
    """Intervals of a graph without robots after `reset`, and scratch, with room for `capacity` intervals."""
    capacity = max(capacity, num_vertices)
    intervals = Intervals(
        np.zeros((capacity, 2), np.int64),
        np.zeros(capacity, np.int64),
        np.zeros(capacity, np.int64),
        np.zeros(capacity, np.int64),
        np.zeros(num_lanes, np.int64),
        np.zeros((capacity if clashes.any else 1, 3), np.int64),
        np.zeros(num_vertices, np.int64),
        np.zeros((1 if clashes.rotations else capacity, 3), np.int64),
        np.zeros(3, np.int64),
    )
    scratch = SippScratch(
        np.zeros(capacity, np.int64),
        np.zeros(capacity, np.int64),
        np.zeros(capacity, np.int64),
        np.zeros(16 * capacity, np.int64),
        np.zeros(1, np.int64),
    )
    return intervals, scratch


def with_double_room(intervals: Intervals, scratch: SippScratch) -> tuple[Intervals, SippScratch]:
    """The same, with the same intervals in use, and room for twice as many."""
    grow = ("span", "after", "vertex", "leaver", "barred", "left")
    return (
        intervals._replace(**{name: _twice(getattr(intervals, name)) for name in grow}),
        SippScratch(*(_twice(array) for array in scratch[:-1]), scratch.searches),
    )


def _twice(array: np.ndarray) -> np.ndarray:
    return np.concatenate([array, np.zeros_like(array)])


@kernel
def reset(num_vertices, intervals):
    """Free every vertex for ever."""
    for v in range(num_vertices):
        intervals.span[v, 0] = 0
        intervals.span[v, 1] = FOREVER
        intervals.after[v] = -1
        intervals.vertex[v] = v
        intervals.leaver[v] = -1
    intervals.barred_first[:] = -1
    intervals.left_first[:] = -1
    intervals.count[0], intervals.count[1], intervals.count[2] = num_vertices, 0, 0


@kernel
def _occupy(intervals, v, begin, end, went_to):
    """Take steps begin..end of v away; the robot then goes to `went_to`. Empty intervals stay in the list, begin > end."""
    k = v
    while intervals.span[k, 1] < begin or intervals.span[k, 0] > intervals.span[k, 1]:
        k = intervals.after[k]
    last = intervals.span[k, 1]
    if end < last:
        new = intervals.count[0]
        intervals.count[0] += 1
        intervals.span[new, 0] = end + 1
        intervals.span[new, 1] = last
        intervals.after[new] = intervals.after[k]
        intervals.vertex[new] = v
        intervals.leaver[new] = went_to
        intervals.after[k] = new
    intervals.span[k, 1] = begin - 1


@kernel
def _block(intervals, v, begin, end):
    """Take steps begin..end of v away as far as they are free."""
    k = v
    while k >= 0:
        first, last = intervals.span[k, 0], intervals.span[k, 1]
        if first <= min(last, end) and last >= begin:
            if first < begin:
                intervals.span[k, 1] = begin - 1
                if last > end:
                    new = intervals.count[0]
                    intervals.count[0] += 1
                    intervals.span[new, 0], intervals.span[new, 1] = end + 1, last
                    intervals.after[new] = intervals.after[k]
                    intervals.vertex[new], intervals.leaver[new] = v, -1
                    intervals.after[k] = new
            elif last > end:
                intervals.span[k, 0], intervals.leaver[k] = end + 1, -1
            else:
                intervals.span[k, 1] = first - 1
        k = intervals.after[k]


@kernel
def reserve(first, head, clashes, intervals, path, length, until):
    """Take the vertices of a path away, the last one until a step, and what clashes with its moves; False when there is no room."""
    vertices, lanes = length, 0
    if clashes.any:
        for t in range(1, length + 1):
            move = move_of(first, head, path[t - 1], path[min(t, length - 1)])
            vertices += clashes.vertex_first[move + 1] - clashes.vertex_first[move]
            lanes += clashes.lane_first[move + 1] - clashes.lane_first[move]
    count = intervals.count
    if count[0] + vertices > len(intervals.after) or count[1] + lanes > len(intervals.barred):
        return False
    if not clashes.rotations and count[2] + length > len(intervals.left):
        return False
    begin = 0
    for t in range(1, length):
        if path[t] != path[t - 1]:
            _occupy(intervals, path[t - 1], begin, t - 1, path[t])
            begin = t
            if not clashes.rotations:
                new = count[2]
                count[2] += 1
                intervals.left[new, 0], intervals.left[new, 1], intervals.left[new, 2] = t, path[t], intervals.left_first[path[t - 1]]
                intervals.left_first[path[t - 1]] = new
    _occupy(intervals, path[length - 1], begin, until, -1)
    if clashes.any:
        t = 1
        while t <= length:
            move, end = move_of(first, head, path[t - 1], path[min(t, length - 1)]), t
            if t == length:
                end = max(until, t)
            while end < length - 1 and move >= len(head) and path[end + 1] == path[end]:
                end += 1  # a wait
            for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
                _block(intervals, clashes.vertex[k], t - 1, end)
            for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
                new = count[1]
                count[1] += 1
                intervals.barred[new, 0], intervals.barred[new, 1] = t, end
                intervals.barred[new, 2] = intervals.barred_first[clashes.lane[k]]
                intervals.barred_first[clashes.lane[k]] = new
            t = end + 1
    return True


@kernel
def _not_barred(intervals, lane, step, latest):
    """The first arrival by a lane from a step on that nobody bars; beyond `latest`: none."""
    again = True
    while again and step <= latest:
        again = False
        k = intervals.barred_first[lane]
        while k >= 0:
            if intervals.barred[k, 0] <= step <= intervals.barred[k, 1]:
                step = intervals.barred[k, 1] + 1
                again = True
            k = intervals.barred[k, 2]
    return step


@kernel
def _closes_ring(intervals, u, v, step):
    """Whether a move from u that arrives on v completes a ring of robots that move at once."""
    while v != u:
        k = intervals.left_first[v]
        while k >= 0 and intervals.left[k, 0] != step:
            k = intervals.left[k, 2]
        if k < 0:
            return False
        v = intervals.left[k, 1]
    return True


@kernel
def find_path(first, head, distance, start, goal, following, clashes, intervals, scratch, path):
    """The earliest way to the goal, to stay.

    Parameters
    ----------
    first, head
        Lanes that leave each vertex.
    distance
        [V] steps to the goal.
    start, goal
        Vertices.
    following
        Whether a vertex must be free for a step before it is entered.
    clashes
        Of the moves of the graph.
    intervals, scratch
        Where others are not.
    path
        [P] is filled with the vertex at each step.

    Returns
    -------
    code, length
        OK and the number of steps written, NO_PATH, or SCRATCH_FULL when path or heap are too short.
    """
    scratch.searches[0] += 1
    now = scratch.searches[0]
    if distance[start] >= UNREACHABLE or intervals.span[start, 0] != 0 or intervals.span[start, 1] < 0:
        return NO_PATH, 0
    scratch.arrival[start] = 0
    scratch.parent[start] = -1
    scratch.stamp[start] = now
    heap = scratch.heap
    push(heap, 0, (np.int64(distance[start]) << 32) | start)
    count = 1
    end = -1
    while count:
        key = pop(heap, count)
        count -= 1
        a = key & 0xFFFFFFFF
        u = intervals.vertex[a]
        t = scratch.arrival[a]
        if (key >> 32) != t + distance[u]:
            continue  # reached earlier meanwhile
        last = intervals.span[a, 1]
        if u == goal and last == FOREVER:
            end = a
            break
        for lane in range(first[u], first[u + 1]):
            v = head[lane]
            if distance[v] >= UNREACHABLE:
                continue
            b = v
            while b >= 0:
                begin, until = intervals.span[b, 0], intervals.span[b, 1]
                if begin > last + 1:
                    break
                arrive = max(t + 1, begin)
                latest = min(last + 1, until)
                if following:
                    arrive = max(t + 1, begin + 1) if begin > 0 else t + 1
                    latest = min(last, until)
                elif arrive == begin and begin > 0 and intervals.leaver[b] == u:
                    latest = -1  # a swap: u is taken from this step on
                if clashes.any:
                    arrive = _not_barred(intervals, lane, arrive, latest)
                if not clashes.rotations and begin == arrive == last + 1 and arrive <= latest and _closes_ring(intervals, u, v, arrive):
                    latest = -1
                if arrive <= latest and (scratch.stamp[b] != now or arrive < scratch.arrival[b]):
                    if count >= len(heap):
                        return SCRATCH_FULL, 0
                    scratch.arrival[b] = arrive
                    scratch.parent[b] = a
                    scratch.stamp[b] = now
                    push(heap, count, ((arrive + distance[v]) << 32) | b)
                    count += 1
                b = intervals.after[b]
    if end < 0:
        return NO_PATH, 0
    length = scratch.arrival[end] + 1
    if length > len(path):
        return SCRATCH_FULL, length
    until = length
    while end >= 0:
        for step in range(scratch.arrival[end], until):
            path[step] = intervals.vertex[end]
        until = scratch.arrival[end]
        end = scratch.parent[end]
    return OK, length
