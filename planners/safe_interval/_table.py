"""Kernels of reservations: who holds each resource when, in steps, half-open, in order and without overlap; and what two hold at once."""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._records import FOREVER


class ReservationTable(NamedTuple):
    """Reservations of Q resources, in rows of N places that grow by moving to the end."""

    row: np.ndarray  # [Q] int64, where each resource's reservations begin
    count: np.ndarray  # [Q] int64
    room: np.ndarray  # [Q] int64
    begin: np.ndarray  # [N] int64
    end: np.ndarray  # [N] int64
    robot: np.ndarray  # [N] int64
    used: np.ndarray  # [1] int64


def empty_table(num_resources: int, places: int) -> ReservationTable:
    """Nobody holds anything; room for so many reservations before `copied` is needed."""
    index = np.zeros(num_resources, np.int64)
    return ReservationTable(
        index, index.copy(), index.copy(), *(np.zeros(max(places, 16), np.int64) for _ in range(3)), np.zeros(1, np.int64)
    )


@kernel
def clear(table):
    """Nobody holds anything."""
    table.row[:] = 0
    table.count[:] = 0
    table.room[:] = 0
    table.used[0] = 0


@kernel(allocates=True)
def copied(table, into):
    """The same reservations in another table with more room."""
    used = 0
    for q in range(len(table.row)):
        a, n = table.row[q], table.count[q]
        into.row[q] = used
        into.count[q] = n
        into.room[q] = n
        into.begin[used : used + n] = table.begin[a : a + n]
        into.end[used : used + n] = table.end[a : a + n]
        into.robot[used : used + n] = table.robot[a : a + n]
        used += n
    into.used[0] = used


@kernel
def first_after(table, q, t):
    """The place of the first reservation of a resource that ends after step t; may be one beyond the last."""
    a = table.row[q]
    b = a + table.count[q]
    end = table.end
    while a < b:
        m = (a + b) >> 1
        if end[m] > t:
            b = m
        else:
            a = m + 1
    return a


@kernel
def next_begin(table, q, t):
    """Begin of the first reservation that ends after step t."""
    k = first_after(table, q, t)
    return table.begin[k] if k < table.row[q] + table.count[q] else FOREVER


@kernel(allocates=True)
def reserve(table, resource, begin, end, robot):
    """Add a robot's reservations. Returns whether there is room for them; if not, it has none afterwards."""
    for i in range(len(resource)):
        q = resource[i]
        if table.count[q] == table.room[q]:
            used, room = table.used[0], max(4, 2 * table.room[q])
            if used + room > len(table.begin):
                release(table, resource[:i], robot)
                return False
            a, n = table.row[q], table.count[q]
            table.begin[used : used + n] = table.begin[a : a + n]
            table.end[used : used + n] = table.end[a : a + n]
            table.robot[used : used + n] = table.robot[a : a + n]
            table.row[q] = used
            table.room[q] = room
            table.used[0] = used + room
        k = table.row[q] + table.count[q]
        table.count[q] += 1
        while k > table.row[q] and table.begin[k - 1] > begin[i]:
            table.begin[k] = table.begin[k - 1]
            table.end[k] = table.end[k - 1]
            table.robot[k] = table.robot[k - 1]
            k -= 1
        table.begin[k] = begin[i]
        table.end[k] = end[i]
        table.robot[k] = robot
    return True


@kernel
def settle(table):
    """Let searches see reservations that overlap as one that grows: they rely on ends in order. Nothing can be released then."""
    for q in range(len(table.row)):
        for k in range(table.row[q] + 1, table.row[q] + table.count[q]):
            table.end[k] = max(table.end[k], table.end[k - 1])


@kernel
def release(table, resource, robot):
    """Take a robot's reservations of these resources away."""
    for q in resource:
        a = table.row[q]
        last = a
        for k in range(a, a + table.count[q]):
            if table.robot[k] != robot:
                table.begin[last] = table.begin[k]
                table.end[last] = table.end[k]
                table.robot[last] = table.robot[k]
                last += 1
        table.count[q] = last - a


@kernel
def holders(table, resource, begin, end, robot, first_step):
    """Write the first step at which a reservation of another robot overlaps with these to `first_step` [R]. Returns how many do."""
    overlaps = 0
    for i in range(len(resource)):
        q = resource[i]
        k = first_after(table, q, begin[i])
        last = table.row[q] + table.count[q]
        while k < last and table.begin[k] < end[i]:
            if table.robot[k] != robot:
                first_step[table.robot[k]] = min(first_step[table.robot[k]], max(table.begin[k], begin[i]))
                overlaps += 1
            k += 1
    return overlaps


@kernel
def overlaps(one_resource, one_begin, one_end, other_resource, other_begin, other_end, rows):
    """Write resource, first step and the step after the last, for each time that two hold one resource at once. Returns how many.

    What each holds is in order of resources, then of time. Rows are as many as there is room for.
    """
    i, j, num = 0, 0, 0
    while num < len(rows):
        k, begin, end, i, j = next_overlap((one_resource, one_begin, one_end), (other_resource, other_begin, other_end), i, j)
        if k < 0:
            break
        rows[num, 0], rows[num, 1], rows[num, 2] = one_resource[k], begin, end
        num += 1
    return num


@kernel
def first_overlap(one_resource, one_begin, one_end, other_resource, other_begin, other_end):
    """The first step at which two robots hold one resource, FOREVER if never."""
    i, j, first = 0, 0, FOREVER
    while True:
        k, begin, _, i, j = next_overlap((one_resource, one_begin, one_end), (other_resource, other_begin, other_end), i, j)
        if k < 0:
            return first
        first = min(first, begin)


@kernel
def next_overlap(one, other, i, j):
    """The next time that both hold one resource, from entries i and j on.

    Parameters
    ----------
    one, other
        What each holds: resources, first steps, and steps after the last.
    i, j
        Where to begin.

    Returns
    -------
    k
        The entry of the first robot; -1 where there is no such time.
    begin, end
        The first step, and the one after the last.
    i, j
        Where to go on.
    """
    (one_resource, one_begin, one_end), (other_resource, other_begin, other_end) = one, other
    while i < len(one_resource) and j < len(other_resource):
        if one_resource[i] != other_resource[j]:
            if one_resource[i] < other_resource[j]:
                i += 1
            else:
                j += 1
            continue
        k, begin, end = i, max(one_begin[i], other_begin[j]), min(one_end[i], other_end[j])
        if one_end[i] < other_end[j]:
            i += 1
        else:
            j += 1
        if begin < end:
            return k, begin, end, i, j
    return -1, 0, 0, i, j
