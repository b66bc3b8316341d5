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

# begin, end: first and last free step; after: the next interval of the vertex, -1 at the end; leaver: where the robot that freed the vertex
# went as the interval began, -1 for none
INTERVAL = np.dtype((np.record, [(name, np.int64) for name in ("begin", "end", "after", "vertex", "leaver")]))
# begin, end: arrivals from and to which nobody may drive along a lane; before: the lane's entry before, -1 for none
BARRED = np.dtype((np.record, [(name, np.int64) for name in ("begin", "end", "before")]))
# step, to: when a robot arrived elsewhere, and where; before: the vertex's entry before, -1 for none
DEPARTURE = np.dtype((np.record, [(name, np.int64) for name in ("step", "to", "before")]))


class Intervals(NamedTuple):
    """Safe intervals of all vertices. The list of v begins at interval v; others follow by `after`, in time."""

    span: np.ndarray  # [N] INTERVAL
    barred_first: np.ndarray  # [L] int64, the last entry of a lane in `barred`, -1 for none
    barred: np.ndarray  # [B] BARRED
    left_first: np.ndarray  # [V] int64, the last entry of a vertex in `left`, -1 for none
    left: np.ndarray  # [D] DEPARTURE
    count: np.ndarray  # [3] int64, intervals, entries of `barred` and of `left` in use


class UnitLanes(NamedTuple):
    """Lanes of a graph that are driven in one step each, and what must not happen on them at once."""

    first: np.ndarray  # [V + 1] int64, lanes that leave each vertex
    head: np.ndarray  # [L] int64
    clashes: Clashes
    following: bool  # whether a vertex must be free for a step before it is entered


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
        np.zeros(capacity, INTERVAL),
        np.zeros(num_lanes, np.int64),
        np.zeros(capacity if clashes.any else 1, BARRED),
        np.zeros(num_vertices, np.int64),
        np.zeros(1 if clashes.rotations else capacity, DEPARTURE),
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
    grow = ("span", "barred", "left")
    return (
        intervals._replace(**{name: _twice(getattr(intervals, name)) for name in grow}),
        SippScratch(*(_twice(array) for array in scratch[:-1]), scratch.searches),
    )


def _twice(array: np.ndarray) -> np.ndarray:
    longer = np.zeros(2 * len(array), array.dtype)
    longer[: len(array)] = array
    return longer


@kernel
def reset(num_vertices, intervals):
    """Free every vertex for ever."""
    for v in range(num_vertices):
        span = intervals.span[v]
        span.begin, span.end, span.after, span.vertex, span.leaver = 0, FOREVER, -1, v, -1
    intervals.barred_first[:] = -1
    intervals.left_first[:] = -1
    intervals.count[0], intervals.count[1], intervals.count[2] = num_vertices, 0, 0


@kernel(allocates=False)
def _append(intervals, before, new, v, begin, end, leaver):
    """Put a new interval of a vertex behind another one in its list."""
    span = intervals.span[new]
    span.begin, span.end, span.after, span.vertex, span.leaver = begin, end, intervals.span[before].after, v, leaver
    intervals.span[before].after = new


@kernel
def _occupy(intervals, v, begin, end, went_to):
    """Take steps begin..end of v away; the robot then goes to `went_to`. Empty intervals stay in the list, begin > end."""
    k = v
    while intervals.span[k].end < begin or intervals.span[k].begin > intervals.span[k].end:
        k = intervals.span[k].after
    last = intervals.span[k].end
    if end < last:
        new = intervals.count[0]
        intervals.count[0] += 1
        _append(intervals, k, new, v, end + 1, last, went_to)
    intervals.span[k].end = begin - 1


@kernel
def _block(intervals, v, begin, end):
    """Take steps begin..end of v away as far as they are free."""
    k = v
    while k >= 0:
        first, last = intervals.span[k].begin, intervals.span[k].end
        if first <= min(last, end) and last >= begin:
            if first < begin:
                intervals.span[k].end = begin - 1
                if last > end:
                    new = intervals.count[0]
                    intervals.count[0] += 1
                    _append(intervals, k, new, v, end + 1, last, -1)
            elif last > end:
                intervals.span[k].begin, intervals.span[k].leaver = end + 1, -1
            else:
                intervals.span[k].end = first - 1
        k = intervals.span[k].after


@kernel
def reserve(lanes, intervals, path, length, until):
    """Take the vertices of a path away, the last one until a step, and what clashes with its moves; False when there is no room."""
    first, head, clashes, _ = lanes
    num_vertices, num_lanes = length, 0
    if clashes.any:
        for t in range(1, length + 1):
            move = move_of(first, head, path[t - 1], path[min(t, length - 1)])
            num_vertices += clashes.vertex_first[move + 1] - clashes.vertex_first[move]
            num_lanes += clashes.lane_first[move + 1] - clashes.lane_first[move]
    count = intervals.count
    if count[0] + num_vertices > len(intervals.span) or count[1] + num_lanes > len(intervals.barred):
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
                intervals.left[new].step, intervals.left[new].to, intervals.left[new].before = t, path[t], intervals.left_first[path[t - 1]]
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
                intervals.barred[new].begin, intervals.barred[new].end = t, end
                intervals.barred[new].before = intervals.barred_first[clashes.lane[k]]
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
            if intervals.barred[k].begin <= step <= intervals.barred[k].end:
                step = intervals.barred[k].end + 1
                again = True
            k = intervals.barred[k].before
    return step


@kernel
def _closes_ring(intervals, u, v, step):
    """Whether a move from u that arrives on v completes a ring of robots that move at once."""
    while v != u:
        k = intervals.left_first[v]
        while k >= 0 and intervals.left[k].step != step:
            k = intervals.left[k].before
        if k < 0:
            return False
        v = intervals.left[k].to
    return True


@kernel
def find_path(lanes, distance, start, goal, intervals, scratch, path):
    """The earliest way to the goal, to stay.

    Parameters
    ----------
    distance
        [V] steps to the goal.
    start, goal
        Vertices.
    intervals, scratch
        Where others are not.
    path
        [P] is filled with the vertex at each step.

    Returns
    -------
    code, length
        OK and the number of steps written, NO_PATH, or SCRATCH_FULL when path or heap are too short.
    """
    first, head, clashes, following = lanes
    scratch.searches[0] += 1
    now = scratch.searches[0]
    if distance[start] >= UNREACHABLE or intervals.span[start].begin != 0 or intervals.span[start].end < 0:
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
        u = intervals.span[a].vertex
        t = scratch.arrival[a]
        if (key >> 32) != t + distance[u]:
            continue  # reached earlier meanwhile
        last = intervals.span[a].end
        if u == goal and last == FOREVER:
            end = a
            break
        for lane in range(first[u], first[u + 1]):
            v = head[lane]
            if distance[v] >= UNREACHABLE:
                continue
            b = v
            while b >= 0:
                begin, until = intervals.span[b].begin, intervals.span[b].end
                if begin > last + 1:
                    break
                arrive = max(t + 1, begin)
                latest = min(last + 1, until)
                if following:
                    arrive = max(t + 1, begin + 1) if begin > 0 else t + 1
                    latest = min(last, until)
                elif arrive == begin and begin > 0 and intervals.span[b].leaver == u:
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
                b = intervals.span[b].after
    if end < 0:
        return NO_PATH, 0
    length = scratch.arrival[end] + 1
    if length > len(path):
        return SCRATCH_FULL, length
    until = length
    while end >= 0:
        for step in range(scratch.arrival[end], until):
            path[step] = intervals.span[end].vertex
        until = scratch.arrival[end]
        end = scratch.parent[end]
    return OK, length
