"""Kernels of safe interval path planning: a path in time among robots whose paths are fixed.

Source: Phillips, Likhachev, "SIPP: safe interval path planning for dynamic environments", ICRA 2011, in whole
steps. A vertex's time is cut into intervals in which nobody stands on it; of two arrivals in one interval the
earlier is as good as the later, so the search has a state an interval, not a state a step.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._distance import UNREACHABLE
from mrp_sumo.search._heap import pop, push
from mrp_sumo.search._kernel import kernel

FOREVER = 1 << 40
FOUND, NO_PATH, FULL = 0, 1, 2


class Intervals(NamedTuple):
    """Safe intervals of all vertices. The list of v begins at interval v; others follow by `after`, in time."""

    span: np.ndarray  # [N, 2] int64, first and last free step
    after: np.ndarray  # [N] int64, next interval of the vertex, -1 at the end
    vertex: np.ndarray  # [N] int64
    leaver: np.ndarray  # [N] int64, where the robot that freed the vertex went as the interval began, -1 for none
    count: np.ndarray  # [1] int64, intervals in use


class SippScratch(NamedTuple):
    """Scratch of a search, by interval."""

    arrival: np.ndarray  # [N] int64
    parent: np.ndarray  # [N] int64
    stamp: np.ndarray  # [N] int64, the search that wrote; [0] of `searches` counts them
    heap: np.ndarray  # [H] int64
    searches: np.ndarray  # [1] int64


def new_intervals(num_vertices: int, capacity: int) -> tuple[Intervals, SippScratch]:
    """Intervals of a graph without robots after `reset`, and scratch, with room for `capacity` intervals."""
    capacity = max(capacity, num_vertices)
    intervals = Intervals(
        np.zeros((capacity, 2), np.int64),
        np.zeros(capacity, np.int64),
        np.zeros(capacity, np.int64),
        np.zeros(capacity, np.int64),
        np.zeros(1, np.int64),
    )
    scratch = SippScratch(
        np.zeros(capacity, np.int64),
        np.zeros(capacity, np.int64),
        np.zeros(capacity, np.int64),
        np.zeros(16 * capacity, np.int64),
        np.zeros(1, np.int64),
    )
    return intervals, scratch


@kernel
def reset(num_vertices, intervals):
    """Free every vertex for ever."""
    for v in range(num_vertices):
        intervals.span[v, 0] = 0
        intervals.span[v, 1] = FOREVER
        intervals.after[v] = -1
        intervals.vertex[v] = v
        intervals.leaver[v] = -1
    intervals.count[0] = num_vertices


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
def reserve(intervals, path, length):
    """Take the vertices of a path away, the last one for ever; False when there is no room."""
    if intervals.count[0] + length > len(intervals.after):
        return False
    begin = 0
    for t in range(1, length):
        if path[t] != path[t - 1]:
            _occupy(intervals, path[t - 1], begin, t - 1, path[t])
            begin = t
    _occupy(intervals, path[length - 1], begin, FOREVER, -1)
    return True


@kernel
def find_path(first, head, distance, start, goal, following, intervals, scratch, path):
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
    intervals, scratch
        Where others are not.
    path
        [P] is filled with the vertex at each step.

    Returns
    -------
    code, length
        FOUND and the number of steps written, NO_PATH, or FULL when path or heap are too short.
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
                if arrive <= latest and (scratch.stamp[b] != now or arrive < scratch.arrival[b]):
                    if count >= len(heap):
                        return FULL, 0
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
        return FULL, length
    until = length
    while end >= 0:
        for step in range(scratch.arrival[end], until):
            path[step] = intervals.vertex[end]
        until = scratch.arrival[end]
        end = scratch.parent[end]
    return FOUND, length
