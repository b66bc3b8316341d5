"""Kernels of discs that drive straight lanes at one speed: when two collide, and the earliest way of one that keeps off times or others.

The moments at which one robot may set out relative to another without a collision are all but one interval, since the set of pairs of
moments at which two discs on straight ways overlap is convex. Times are exact, as published costs are: `_search` works in whole steps.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._heap import pop_by, push_by
from mrp_sumo.search._kernel import kernel

NEVER = 1e15  # s: after all finite times; who leaves a vertex before this leaves it, who stays until inf is there to stay
EPS = 1e-7  # s that two may be too close
MOVES, STAYS_OTHER, STAYS_ONE = 0, 1, 2  # who moves in a conflict: both, the first, the second
NOT_MOVE, NOT_STAY, MUST_MOVE = 0, 1, 2  # kinds of rules

# robot: the first of two, or the second
RULE = np.dtype((np.record, [(name, np.int64) for name in ("robot", "kind", "place")] + [(name, np.float64) for name in ("begin", "end")]))


class Lanes(NamedTuple):
    """The graph: V vertices, L lanes sorted by tail."""

    first: np.ndarray  # [V + 1]
    tail: np.ndarray  # [L]
    head: np.ndarray  # [L]
    xy: np.ndarray  # [V, 2] m
    duration: np.ndarray  # [L] s
    reach: float  # m that two must keep from each other
    reverse: np.ndarray  # [L] the lane back, -1: none
    inner: np.ndarray  # [V] whether a vertex has two neighbours
    clear: float  # s before which nobody is by `reach` away from where it was
    zero: np.ndarray  # [V] s to a goal of which nothing is known


class DiscPaths(NamedTuple):
    """Ways by number: W ways of K moves altogether."""

    first: np.ndarray  # [W + 1]
    start: np.ndarray  # [W] vertex
    lane: np.ndarray  # [K]
    left: np.ndarray  # [K] s, when the robot sets out


def new_ways(room: int) -> DiscPaths:
    """No ways; room for so many, and for so many moves of them."""
    index = [np.zeros(room, np.int64) for _ in range(3)]
    return DiscPaths(index[0], index[1], index[2], np.zeros(room))


class DiscConflict(NamedTuple):
    """A conflict of two ways."""

    kind: int  # who moves: `MOVES`, `STAYS_OTHER` or `STAYS_ONE`
    part: int  # the move or stay of the first way; stay k is the one before move k
    other_part: int
    path: int  # the number of the first way
    other_path: int


class DiscConstraints(NamedTuple):
    """Constraints of one robot: departures to lanes and stays at vertices that are forbidden it, in rows 0 and 1, each sorted; and in row 2
    departures that it has to make, in their order. There may be room for more.
    """

    count: np.ndarray  # [3] how many of each
    place: np.ndarray  # [3, N] the lane, the vertex, the lane
    begin: np.ndarray  # [3, N] s, from when on it may not depart; before when it may not have come to stay; from when on it must depart
    end: np.ndarray  # [3, N] s, until when it may not depart; until when or longer it may not stay; until when it must depart


class DiscScratch(NamedTuple):
    """Room for a search of N entries, and as many forbidden stays."""

    move_of: np.ndarray  # [L] the first forbidden departure, -1: none
    stay_of: np.ndarray  # [V] the first forbidden stay, -1: none
    leave_by: np.ndarray  # [N] s, of those who come before a forbidden stay begins
    least: np.ndarray  # [N] s, least arrival at the goal by how many departures that it has to make a robot has made
    best: np.ndarray  # [V + N] s, earliest arrival by state
    state: np.ndarray  # [N]
    vertex: np.ndarray  # [N]
    until: np.ndarray  # [N] s
    arrived: np.ndarray  # [N] s
    parent: np.ndarray  # [N]
    lane: np.ndarray  # [N]
    left: np.ndarray  # [N] s
    key: np.ndarray  # [N] s, of a heap
    heap: np.ndarray  # [N] its entries


def new_scratch(num_vertices: int, num_lanes: int, room: int) -> DiscScratch:
    """Room for so many entries and stays."""
    index, seconds = (lambda: np.zeros(room, np.int64)), (lambda: np.zeros(room))
    return DiscScratch(
        np.full(num_lanes, -1), np.full(num_vertices, -1), seconds(), seconds(), np.zeros(num_vertices + room),
        index(), index(), seconds(), seconds(), index(), index(), seconds(), seconds(), index(),
    )  # fmt: skip


@kernel
def too_close_on(cx, cy, ux, uy, long, reach):
    """Times t from 0 to `long` at which |c + u t| < reach: an interval, empty as (0, 0)."""
    a, b, c = ux * ux + uy * uy, cx * ux + cy * uy, cx * cx + cy * cy - reach * reach
    if a <= 0.0:
        return (0.0, long) if c < 0.0 else (0.0, 0.0)
    root = b * b - a * c
    if root <= 0.0:
        return 0.0, 0.0
    root = np.sqrt(root)
    low, high = max(0.0, (-b - root) / a), min(long, (-b + root) / a)
    return (low, high) if low < high else (0.0, 0.0)


@kernel
def passes(lanes, e, v):
    """Times after it has set out at which a robot on lane e is too close to vertex v: an open interval, empty as (0, 0)."""
    reach = lanes.reach
    a, b, long = lanes.tail[e], lanes.head[e], lanes.duration[e]
    x, y = lanes.xy[v, 0], lanes.xy[v, 1]
    if (
        max(lanes.xy[a, 0], lanes.xy[b, 0]) + reach < x or min(lanes.xy[a, 0], lanes.xy[b, 0]) - reach > x
        or max(lanes.xy[a, 1], lanes.xy[b, 1]) + reach < y or min(lanes.xy[a, 1], lanes.xy[b, 1]) - reach > y
    ):  # fmt: skip
        return 0.0, 0.0
    ux, uy = (lanes.xy[b, 0] - lanes.xy[a, 0]) / long, (lanes.xy[b, 1] - lanes.xy[a, 1]) / long
    return too_close_on(lanes.xy[a, 0] - x, lanes.xy[a, 1] - y, ux, uy, long, reach)


@kernel
def collide(lanes, e, f):
    """Delays of the one on lane f after the one on lane e at which they collide: an open interval, empty as (0, 0).

    The extremes of t - s over the pairs of moments (t on e, s on f) at which they are too close: on a border of the rectangle of all
    pairs, or where a line of equal t - s touches the ellipse.
    """
    reach = lanes.reach
    a, b, c, d = lanes.tail[e], lanes.head[e], lanes.tail[f], lanes.head[f]
    long, other_long = lanes.duration[e], lanes.duration[f]
    ax, ay, cx, cy = lanes.xy[a, 0], lanes.xy[a, 1], lanes.xy[c, 0], lanes.xy[c, 1]
    bx, by, dx, dy = lanes.xy[b, 0], lanes.xy[b, 1], lanes.xy[d, 0], lanes.xy[d, 1]
    if (
        max(ax, bx) + reach < min(cx, dx) or max(cx, dx) + reach < min(ax, bx)
        or max(ay, by) + reach < min(cy, dy) or max(cy, dy) + reach < min(ay, by)
    ):  # fmt: skip
        return 0.0, 0.0
    ux, uy, wx, wy = (bx - ax) / long, (by - ay) / long, (dx - cx) / other_long, (dy - cy) / other_long
    low, high = np.inf, -np.inf
    for at_end in range(2):
        t = long if at_end else 0.0
        t0, t1 = too_close_on(cx - ax - ux * t, cy - ay - uy * t, wx, wy, other_long, reach)
        if t1 > t0:
            low, high = min(low, t - t1), max(high, t - t0)
        s = other_long if at_end else 0.0
        t0, t1 = too_close_on(ax - cx - wx * s, ay - cy - wy * s, ux, uy, long, reach)
        if t1 > t0:
            low, high = min(low, t0 - s), max(high, t1 - s)
    nx, ny = ux - wx, uy - wy
    size = np.hypot(nx, ny)
    if size > 1e-12:
        nx, ny = nx / size, ny / size
        px, py = ax - cx, ay - cy
        slope = wx * ny - wy * nx
        if abs(slope) > 1e-12:
            for sign in (-1.0, 1.0):
                delay = (sign * reach - (px * ny - py * nx)) / slope
                t = -((px + wx * delay) * nx + (py + wy * delay) * ny) / size
                if 0.0 <= t <= long and 0.0 <= t - delay <= other_long:
                    low, high = min(low, delay), max(high, delay)
    return (low, high) if low < high else (0.0, 0.0)


@kernel
def conflicts(lanes, ways, one, other, most, rows, num):
    """Write the conflicts of two ways to `rows` from row `num` on, by time, as in `DiscConflict`. Returns the new number.

    Rows are as many as there is room for.
    """
    a, b, c, d = ways.first[one], ways.first[one + 1], ways.first[other], ways.first[other + 1]
    i, j = a, c  # moves of both, each after its stay
    most = min(most + num, len(rows))
    while num < most:
        begin, left = arrival(lanes, ways, one, i), ways.left[i] if i < b else np.inf
        other_begin, other_left = arrival(lanes, ways, other, j), ways.left[j] if j < d else np.inf
        end = left + lanes.duration[ways.lane[i]] if i < b else np.inf
        other_end = other_left + lanes.duration[ways.lane[j]] if j < d else np.inf
        if i < b and j < d and left < other_end and other_left < end:
            low, high = collide(lanes, ways.lane[i], ways.lane[j])
            if low + EPS < other_left - left < high - EPS:
                rows[num, 0], rows[num, 1], rows[num, 2] = MOVES, i - a, j - c
                num += 1
        if i < b and num < most and left < other_left and other_begin < end and other_left > other_begin + EPS:
            v = stands_at(lanes, ways, other, j)
            if meets_stay(lanes, ways.lane[i], left, v, other_begin, other_left):
                rows[num, 0], rows[num, 1], rows[num, 2] = STAYS_OTHER, i - a, j - c
                num += 1
        if j < d and num < most and other_left < left and begin < other_end and left > begin + EPS:
            v = stands_at(lanes, ways, one, i)
            if meets_stay(lanes, ways.lane[j], other_left, v, begin, left):
                rows[num, 0], rows[num, 1], rows[num, 2] = STAYS_ONE, i - a, j - c
                num += 1
        if i >= b and j >= d:
            break
        if end <= other_end:
            i += 1
        else:
            j += 1
    return num


@kernel
def meets_stay(lanes, lane, left, vertex, begin, until):
    """True if a move that sets out at `left` comes too close to a stay at a vertex from `begin` until `until`."""
    low, high = passes(lanes, lane, vertex)
    return high > low and begin < left + high - EPS and until > left + low + EPS


@kernel
def stands_at(lanes, ways, path, k):
    """The vertex of the stay before a way's move k (counted in all ways)."""
    return ways.start[path] if k == ways.first[path] else lanes.head[ways.lane[k - 1]]


@kernel
def arrival(lanes, ways, path, k):
    """Time at which a robot begins the stay before its move k (counted in all ways)."""
    return 0.0 if k == ways.first[path] else ways.left[k - 1] + lanes.duration[ways.lane[k - 1]]


@kernel
def conflicts_with_all(lanes, ways, one, others, most, rows, of):
    """The conflicts of a way with others [N]; `of` says with which of them. Returns how many."""
    num = 0
    for k in range(len(others)):
        before = num
        num = conflicts(lanes, ways, one, others[k], most, rows, num)
        of[before:num] = k
    return num


@kernel
def find(lanes, trip, rules, scratch, to_stay, barred):
    """The earliest way to a goal for a robot that is at its start from 0 on.

    A vertex has windows of arrival; in each a robot must have left by some time. At rest it may wait, so within a window the earlier of
    two arrivals is as good as the later (Phillips, Likhachev, ICRA 2011).

    Parameters
    ----------
    trip
        [V] s to the goal without others, inf: none; the start and the goal.
    to_stay
        Whether it must stay at the goal.
    barred
        A lane that it may not use, -1: none.

    Returns
    -------
    int
        The entry at the goal, -1: no way, -2: no room.
    """
    num_vertices, num_stays, lane, vertex, lasts = len(lanes.first) - 1, rules.count[1], rules.place[0], rules.place[1], rules.end[1]
    num_musts = rules.count[2] if to_stay else 0
    num_states = (num_musts + 1) * (num_vertices + num_stays)
    if num_stays > len(scratch.leave_by) or num_states > len(scratch.best):
        return -2
    for k in range(rules.count[0] - 1, -1, -1):
        scratch.move_of[lane[k]] = k
    for k in range(num_stays - 1, -1, -1):
        later = k + 1 < num_stays and vertex[k + 1] == vertex[k]
        scratch.leave_by[k] = min(lasts[k], scratch.leave_by[k + 1]) if later else lasts[k]
        scratch.stay_of[vertex[k]] = k
    scratch.least[num_musts] = 0.0
    for k in range(num_musts - 1, -1, -1):
        e = rules.place[2, k]
        scratch.least[k] = max(scratch.least[k + 1], rules.begin[2, k] + lanes.duration[e] + trip[0][lanes.head[e]])
    scratch.best[:num_states] = np.inf
    entry = search(lanes, trip, rules, scratch, to_stay, barred)
    for k in range(rules.count[0]):
        scratch.move_of[lane[k]] = -1
    for k in range(num_stays):
        scratch.stay_of[vertex[k]] = -1
    return entry


@kernel
def search(lanes, trip, rules, scratch, to_stay, barred):
    """See `find`. States are windows of vertices, by how many departures that it has to make the robot has made."""
    left_s, start, goal = trip
    num_moves, num_stays, num_vertices = rules.count[0], rules.count[1], len(lanes.first) - 1
    num_musts, num_windows = rules.count[2] if to_stay else 0, num_vertices + num_stays
    lane, not_from, not_until = rules.place[0], rules.begin[0], rules.end[0]
    vertex, begins = rules.place[1], rules.begin[1]
    must, must_from, must_until = rules.place[2], rules.begin[2], rules.end[2]
    window = scratch.stay_of[start]
    while 0 <= window < num_stays and vertex[window] == start and begins[window] <= 0.0:
        window += 1
    inside = 0 <= window < num_stays and vertex[window] == start
    scratch.state[0] = num_vertices + window if inside else start
    scratch.until[0] = scratch.leave_by[window] if inside else np.inf
    scratch.vertex[0], scratch.arrived[0], scratch.parent[0], scratch.lane[0], scratch.key[0] = start, 0.0, -1, -1, left_s[start]
    scratch.best[scratch.state[0]] = 0.0
    scratch.heap[0] = 0
    if not np.isfinite(left_s[start]):
        return -1
    entries = count = 1
    while count:
        n = pop_by(scratch.key, scratch.heap, count)
        count -= 1
        v, t, until = scratch.vertex[n], scratch.arrived[n], scratch.until[n]
        if t > scratch.best[scratch.state[n]]:
            continue
        made = scratch.state[n] // num_windows
        if v == goal and made == num_musts and (until == np.inf or not to_stay):
            return n
        for e in range(lanes.first[v], lanes.first[v + 1]):
            w = lanes.head[e]
            if e == barred or not np.isfinite(left_s[w]):
                continue
            for then in range(made, made + (2 if made < num_musts and must[made] == e else 1)):
                depart_from, depart_until = (must_from[made], min(until, must_until[made])) if then > made else (t, until)
                window, since = scratch.stay_of[w], 0.0
                while True:
                    inside = 0 <= window < num_stays and vertex[window] == w
                    before = begins[window] if inside else np.inf
                    at = max(t, depart_from, since - lanes.duration[e])
                    m = scratch.move_of[e]
                    while 0 <= m < num_moves and lane[m] == e and not_from[m] <= at:
                        at = max(at, not_until[m])
                        m += 1
                    there, stays_until = at + lanes.duration[e], scratch.leave_by[window] if inside else np.inf
                    state = then * num_windows + (num_vertices + window if inside else w)
                    if at >= depart_until or (then < num_musts and too_late(lanes, left_s, w, there, must[then], must_until[then])):
                        break
                    if there < before and there < stays_until and there < scratch.best[state]:
                        if entries >= len(scratch.heap):
                            return -2
                        scratch.best[state] = there
                        scratch.state[entries], scratch.vertex[entries], scratch.until[entries] = state, w, stays_until
                        scratch.arrived[entries], scratch.parent[entries] = there, n
                        scratch.lane[entries], scratch.left[entries] = e, at
                        push_by(scratch.key, scratch.heap, count, max(there + left_s[w], scratch.least[then]), entries)
                        entries += 1
                        count += 1
                    if not inside:
                        break
                    since = before
                    window += 1
    return -1


@kernel
def too_late(lanes, left_s, vertex, at, lane, until):
    """True if who is at a vertex by then cannot depart to a lane before `until`, by the triangle inequality."""
    return at + max(0.0, left_s[vertex] - left_s[lanes.tail[lane]]) >= until


@kernel
def write_way(entry, scratch, start, path, ways):
    """Add the way that led to an entry under this number, the next one. Returns whether there is room."""
    num, n, begin = 0, entry, ways.first[path]
    while scratch.parent[n] >= 0:
        num += 1
        n = scratch.parent[n]
    if begin + num > len(ways.lane) or path + 2 > len(ways.first):
        return False
    n = entry
    for k in range(begin + num - 1, begin - 1, -1):
        ways.lane[k], ways.left[k] = scratch.lane[n], scratch.left[n]
        n = scratch.parent[n]
    ways.start[path], ways.first[path + 1] = start, begin + num
    return True


@kernel(allocates=True)
def new_rules(room):
    """No rules, with room for so many of each kind."""
    return DiscConstraints(np.zeros(3, np.int64), np.zeros((3, room), np.int64), np.zeros((3, room)), np.zeros((3, room)))


@kernel(allocates=True)
def with_rules(rules, rows, robot, begin, end):
    """The rules of one of two robots, and those for it among `rows` [K] RULE from `begin` to `end`."""
    num = rules.count.copy()
    for k in range(begin, end):
        if rows[k].robot == robot:
            num[rows[k].kind] += 1
    new = new_rules(num.max())
    copy_rules(rules, new)
    for k in range(begin, end):
        if rows[k].robot == robot:
            add_rule(new, rows[k].kind, rows[k].place, rows[k].begin, rows[k].end)
    return new


@kernel
def copy_rules(rules, into):
    """The same rules in other arrays."""
    for kind in range(3):
        into.count[kind] = rules.count[kind]
        for k in range(rules.count[kind]):
            into.place[kind, k], into.begin[kind, k], into.end[kind, k] = rules.place[kind, k], rules.begin[kind, k], rules.end[kind, k]


@kernel
def add_rule(rules, kind, place, begin, end):
    """Insert one, see `DiscConstraints`; of departures that the robot has to make, see `window_of`."""
    where, first, second, k = rules.place[kind], rules.begin[kind], rules.end[kind], rules.count[kind]
    if kind == MUST_MOVE:
        for m in range(k):
            if where[m] == place and first[m] < end and begin < second[m]:
                first[m], second[m] = max(first[m], begin), min(second[m], end)
                return
    rules.count[kind] = k + 1
    by_place = kind != MUST_MOVE
    while k > 0 and ((by_place and where[k - 1] > place) or ((not by_place or where[k - 1] == place) and first[k - 1] > begin)):
        where[k], first[k], second[k] = where[k - 1], first[k - 1], second[k - 1]
        k -= 1
    where[k], first[k], second[k] = place, begin, end


@kernel
def put_rule(rows, k, robot, kind, place, begin, end):
    """Write row k of `rows` [K] RULE, where there is room. Returns the number of the next row."""
    if k < len(rows):
        rows[k].robot, rows[k].kind, rows[k].place, rows[k].begin, rows[k].end = robot, kind, place, begin, end
    return k + 1


@kernel
def window_of(lanes, rules, lane, begin, end):
    """The end of a time to depart that a robot may be told to keep, which begins and ends then; `begin` where it must not be told.

    The departures that it has to make by then come before or after this one whatever it does, or are this one.
    """
    for k in range(rules.count[2]):
        other, first, second = rules.place[2, k], rules.begin[2, k], rules.end[2, k]
        if other == lane and begin < second:
            end = min(end, second if first <= begin else first)
            if k + 1 < rules.count[2] and rules.begin[2, k + 1] < begin:
                return begin
        elif other != lane and (end > first + lanes.duration[other] if begin < first else second > begin + lanes.duration[lane]):
            return begin
    return end


@kernel
def put_rules_beside(lanes, departures, near, robot, rows, num):
    """Rules against a departure to a lane and a stay at its head that collide with all departures to another lane within a time."""
    lane, begin, end = departures
    low, high = collide(lanes, lane, near)
    if high > low and end + low < begin + high:
        num = put_rule(rows, num, robot, NOT_MOVE, near, end + low, begin + high)
    low, high = passes(lanes, lane, lanes.head[near])
    if high > low:
        num = put_rule(rows, num, robot, NOT_STAY, lanes.head[near], begin + high, end + low)
    return num


@kernel
def rules_against(lanes, ways, conflict, forbidden, keeper, rows):
    """Write the rules of a `DiscConflict` to `rows` [K] RULE: where the first robot gives way, then the second.

    One of both is the keeper of its departure. Either it does not depart until it no longer collides with what the other does now; or it
    has to depart before, so no solution is in both (disjoint splitting), and the other does nothing on lanes at the ends of theirs that
    collides with all such departures. Where that cannot be demanded, the other gives way to what the keeper does now.

    Returns
    -------
    tuple[int, int]
        How many rules there are of either; (0, 0) where the same comes of the other keeper.
    """
    kind, i, j, one, other = conflict
    if kind != MOVES and keeper != (0 if kind == STAYS_OTHER else 1):
        return 0, 0
    a, b = ways.first[one] + i, ways.first[other] + j
    if keeper == 1:
        one, other, a, b = other, one, b, a
    e, t = ways.lane[a], ways.left[a]
    f, v = -1, -1
    if kind == MOVES:
        f, now = ways.lane[b], ways.left[b]
        low, high = collide(lanes, e, f)
    else:
        v, now = stands_at(lanes, ways, other, b), min(ways.left[b] if b < ways.first[other + 1] else np.inf, NEVER)
        low, high = passes(lanes, e, v)
    end = window_of(lanes, forbidden[keeper], e, t, now - low)
    demanded = end > t
    if not demanded:
        end = now - low
    num = 0
    if keeper == 0:
        num = put_rule(rows, num, keeper, NOT_MOVE, e, t, end)
    if kind == MOVES:
        num = put_rule(rows, num, 1 - keeper, NOT_MOVE, f, now, t + high)
    else:
        num = put_rule(rows, num, 1 - keeper, NOT_STAY, v, t + high, now)
    if demanded:
        num = put_rule(rows, num, keeper, MUST_MOVE, e, t, end)
        ends = lanes.tail[e], lanes.head[e], lanes.tail[f] if f >= 0 else v, lanes.head[f] if f >= 0 else v
        for k in range(4):
            if (k > 0 and ends[k] == ends[0]) or (k > 1 and ends[k] == ends[1]) or (k > 2 and ends[k] == ends[2]):
                continue
            for near in range(lanes.first[ends[k]], lanes.first[ends[k] + 1]):
                num = put_rules_beside(lanes, (e, t, end), near, 1 - keeper, rows, num)
                if lanes.reverse[near] >= 0:
                    num = put_rules_beside(lanes, (e, t, end), lanes.reverse[near], 1 - keeper, rows, num)
    if keeper == 0:
        return 1, num - 1
    put_rule(rows, num, keeper, NOT_MOVE, e, t, end)
    return num, 1


@kernel(allocates=True)
def forbidden_by(lanes, ways, path, room):
    """Rules that keep others from a conflict with a way: [2, 3, N] of departures and stays, see `Rules`, and how many of each.

    Without the room, the numbers are -1.
    """
    rows, num_moves, num_stays = np.zeros((2, 3, room)), 0, 0
    for k in range(ways.first[path], ways.first[path + 1] + 1):
        begin = arrival(lanes, ways, path, k)
        last = k == ways.first[path + 1]
        end = np.inf if last else ways.left[k]
        u = stands_at(lanes, ways, path, k)
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


@kernel(allocates=True)
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
