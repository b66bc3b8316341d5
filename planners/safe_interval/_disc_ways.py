"""Kernels: what the ways of other discs forbid one."""

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.safe_interval._discs import arrival, collide, passes, stands_at


@kernel
def forbidden_by(lanes, ways, way, room):
    """Rules that keep others from a conflict with a way: [2, 3, N] of departures and stays, see `Rules`, and how many of each.

    Without the room, the numbers are -1.
    """
    rows, num_moves, num_stays = np.zeros((2, 3, room)), 0, 0
    for k in range(ways.first[way], ways.first[way + 1] + 1):
        begin = arrival(lanes, ways, way, k)
        last = k == ways.first[way + 1]
        end = np.inf if last else ways.left[k]
        u = stands_at(lanes, ways, way, k)
        for e in range(len(lanes.tail)):
            if num_moves + 2 > room:
                return rows, -1, -1
            low, high = passes(lanes, e, u)
            if high > low:
                rows[0, 0, num_moves], rows[0, 1, num_moves], rows[0, 2, num_moves] = e, begin - high, end - low
                num_moves += 1
            if not last:
                low, high = collide(lanes, ways.lane[k], e)
                if high > low:
                    rows[0, 0, num_moves], rows[0, 1, num_moves], rows[0, 2, num_moves] = e, end + low, end + high
                    num_moves += 1
        if last:
            break
        for v in range(len(lanes.first) - 1):
            if num_stays + 1 > room:
                return rows, -1, -1
            low, high = passes(lanes, ways.lane[k], v)
            if high > low:
                rows[1, 0, num_stays], rows[1, 1, num_stays], rows[1, 2, num_stays] = v, end + high, end + low
                num_stays += 1
    return rows, num_moves, num_stays


@kernel
def sort_rules(rows, num_places, kind, rules):
    """Make [3, N] rows the rules of a kind, sorted by place and time: into places first, then within each, where few are."""
    place, begin, end = rules.place[kind], rules.begin[kind], rules.end[kind]
    next_of = np.zeros(num_places + 1, np.int64)
    for i in range(rows.shape[1]):
        next_of[np.int64(rows[0, i]) + 1] += 1
    next_of = np.cumsum(next_of)
    for i in range(rows.shape[1]):
        p, t = np.int64(rows[0, i]), rows[1, i]
        k = next_of[p]
        next_of[p] += 1
        while k > 0 and place[k - 1] == p and begin[k - 1] > t:
            place[k], begin[k], end[k] = p, begin[k - 1], end[k - 1]
            k -= 1
        place[k], begin[k], end[k] = p, t, rows[2, i]
    rules.count[kind] = rows.shape[1]
