"""Kernels: corridors that two discs want to pass in opposite directions, and lines on which they stand in the wrong order.

After the corridor reasoning of Li, Harabor, Stuckey, Ma, Gange, Koenig, "Pairwise symmetry reasoning for multi-agent path finding search",
AIJ 2021, in continuous time. In a corridor, lanes that are joined by vertices with two neighbours, two discs cannot pass each other: who is
through second has entered after the first one has left, and has gone on by as much as both must keep. So one of both reaches its end only
after the other's earliest arrival and the length of the corridor, unless it goes round: one split for what else takes many, each of which
delays either by next to nothing.

On a line, a way that comes by no vertex twice, two discs keep their order as long as both stay on it. Where their goals are on it in the
other order than their starts, one of both has to leave it, and comes to its goal only after the shortest way that does. If the first never
leaves it, it is of no use to the second to come back by the end where it left.
"""

import numpy as np

from mrp_sumo.search._heap import pop_by, push_by
from mrp_sumo.search._kernel import kernel
from planners.safe_interval._discs import NEVER, NOT_MOVE, NOT_STAY, arrival, find, put_rule, rules_against, stands_at

EPS = 1e-6  # s that no rule may rest on
MIDDLE = 1 << 40  # number of the first vertex of a way on its line


@kernel
def rules_of(lanes, ways, conflict, forbidden, scratch, keeper, rows):
    """Write rules that end a conflict to `rows`: where the first robot gives way, and where the second does; returns as `rules_against`.

    Neither may end its way before it can have left a line on which both are in the wrong order, or leave a corridor before the other can be
    through; where there is none, or that would not keep them from what they do now, see `rules_against`.

    Parameters
    ----------
    conflict
        A `DiscConflict`.
    forbidden
        Rules of both so far.
    keeper
        See `rules_against`. The second robot is asked for where splits that keep the first have more than one rule a side, or none.
    """
    if keeper == 0 and joint_rules(lanes, ways, conflict, forbidden, scratch, rows):
        return 1, 1
    return rules_against(lanes, ways, conflict, forbidden, keeper, rows)


@kernel
def joint_rules(lanes, ways, conflict, forbidden, scratch, rows):
    """Write the rule of a line or a corridor for either robot, see `rules_of`. Returns whether there is one."""
    one, other = conflict.path, conflict.other_path
    a, b = ways.first[one + 1], ways.first[other + 1]
    for path in (one, other):
        until, other_until = ends_off_line(lanes, ways, path, one, other, scratch)
        if arrival(lanes, ways, one, a) < until - 2 * EPS and arrival(lanes, ways, other, b) < other_until - 2 * EPS:
            put_rule(rows, 0, 0, NOT_STAY, stands_at(lanes, ways, one, a), until - EPS, NEVER)
            put_rule(rows, 1, 1, NOT_STAY, stands_at(lanes, ways, other, b), other_until - EPS, NEVER)
            return True
    p, q, num = corridor(lanes, ways, conflict)
    if num == 0:
        return False
    last, other_last = ways.lane[p + num - 1], ways.lane[q + num - 1]
    ours, theirs = (
        at_end(lanes, ways.start[one], last, forbidden[0], scratch),
        at_end(lanes, ways.start[other], other_last, forbidden[1], scratch),
    )
    through = lanes.clear - EPS
    for k in range(num):
        through += lanes.duration[ways.lane[p + k]]
    until = min(ours[1], theirs[0] + through) - lanes.duration[last]
    other_until = min(theirs[1], ours[0] + through) - lanes.duration[other_last]
    if ways.left[p + num - 1] < until - EPS and ways.left[q + num - 1] < other_until - EPS:
        put_rule(rows, 0, 0, NOT_MOVE, last, -1.0, until)
        put_rule(rows, 1, 1, NOT_MOVE, other_last, -1.0, other_until)
        return True
    return False


@kernel
def at_end(lanes, start, lane, rules, scratch):
    """Earliest times of a robot at the end of a lane, to pass or to stay: at all, and by another lane; inf: never, nan: no room to say."""
    vertex = lanes.head[lane]
    trip = lanes.zero, start, vertex
    entry = find(lanes, trip, rules, scratch, False, -1)
    direct = scratch.arrived[entry] if entry >= 0 else np.inf if entry == -1 else np.nan
    entry = find(lanes, trip, rules, scratch, False, lane)
    return direct, scratch.arrived[entry] if entry >= 0 else np.inf if entry == -1 else np.nan


@kernel
def corridor(lanes, ways, conflict):
    """The longest corridor about a conflict that both pass: a move of each, its first one there, and how many; 0: none.

    Nobody starts within, nor at its own end.
    """
    _, i, j, one, other = conflict
    a0, a1, b0, b1 = ways.first[one], ways.first[one + 1], ways.first[other], ways.first[other + 1]
    for p in range(max(a0, a0 + i - 1), min(a1, a0 + i + 2)):
        for q in range(max(b0, b0 + j - 1), min(b1, b0 + j + 2)):
            if lanes.reverse[ways.lane[p]] == ways.lane[q]:
                return cut(lanes, ways, one, other, *extended(lanes, ways, one, other, p, q))
    return 0, 0, 0


@kernel
def extended(lanes, ways, one, other, p, q):
    """All of a corridor of which one passes a lane in its move p, the other in its move q."""
    num, begin, end = 1, lanes.tail[ways.lane[p]], lanes.head[ways.lane[p]]
    while p > ways.first[one] and q + num < ways.first[other + 1] and lanes.inner[begin]:
        v = lanes.tail[ways.lane[p - 1]]
        if v == end or lanes.reverse[ways.lane[p - 1]] != ways.lane[q + num]:
            break
        p, num, begin = p - 1, num + 1, v
    while p + num < ways.first[one + 1] and q > ways.first[other] and lanes.inner[end]:
        v = lanes.head[ways.lane[p + num]]
        if v == begin or lanes.reverse[ways.lane[p + num]] != ways.lane[q - 1]:
            break
        q, num, end = q - 1, num + 1, v
    return p, q, num


@kernel
def cut(lanes, ways, one, other, p, q, num):
    """The part between the starts of both, where they are inside."""
    start, other_start = ways.start[one], ways.start[other]
    for k in range(num):
        if lanes.head[ways.lane[p + k]] == start:
            p, num = p + k + 1, num - k - 1
            break
    for k in range(num):
        if lanes.head[ways.lane[q + k]] == other_start:
            q, num = q + k + 1, num - k - 1
            break
    return p, q, num


@kernel
def ends_off_line(lanes, ways, path, one, other, scratch):
    """Times before which two robots are not at their goals for good if they leave the line of a way; 0 where they need not leave it.

    If one stays on the line, the other has to come back to it elsewhere than by the end where it left: which of both that holds for is a
    choice, here the one by which the earlier of both ends gets later.
    """
    size = number_line(lanes, ways, path, scratch)
    place = scratch.stay_of
    start, goal = ways.start[one], stands_at(lanes, ways, one, ways.first[one + 1])
    other_start, other_goal = ways.start[other], stands_at(lanes, ways, other, ways.first[other + 1])
    until = other_until = 0.0
    all_on_line = min(place[start], place[goal], place[other_start], place[other_goal]) >= 0
    if all_on_line and (place[start] < place[other_start]) != (place[goal] < place[other_goal]):
        low = high = MIDDLE
        for k in range(size):
            low, high = min(low, place[scratch.state[k]]), max(high, place[scratch.state[k]])
        until, round_it = off_line(lanes, start, goal, scratch, -1, -1), off_line(lanes, start, goal, scratch, low, high)
        other_until = off_line(lanes, other_start, other_goal, scratch, -1, -1)
        other_round_it = off_line(lanes, other_start, other_goal, scratch, low, high)
        now, other_now = arrival(lanes, ways, one, ways.first[one + 1]), arrival(lanes, ways, other, ways.first[other + 1])
        if min(round_it - now, other_until - other_now) > min(until - now, other_round_it - other_now):
            until = round_it
        else:
            other_until = other_round_it
    for k in range(size):
        place[scratch.state[k]] = -1
    return until, other_until


@kernel
def number_line(lanes, ways, path, scratch):
    """Number the vertices of a way in turn, in `stay_of`, until it comes by one twice, and those of the corridors beyond its ends.

    Returns how many, and lists them in `state`.
    """
    place, vertices, v, size = scratch.stay_of, scratch.state, ways.start[path], 1
    place[v], vertices[0] = MIDDLE, v
    for k in range(ways.first[path], ways.first[path + 1]):
        w = lanes.head[ways.lane[k]]
        if place[w] >= 0 or size == len(vertices):
            break
        place[w], vertices[size], v, size = MIDDLE + size, w, w, size + 1
    for onward in (1, -1):
        while lanes.inner[v]:
            w = -1
            for e in range(lanes.first[v], lanes.first[v + 1]):
                if place[lanes.head[e]] < 0:
                    w = lanes.head[e]
            if w < 0 or size == len(vertices):
                break
            place[w], vertices[size], v, size = place[v] + onward, w, w, size + 1
        v = ways.start[path]
    return size


@kernel
def off_line(lanes, start, goal, scratch, low, high):
    """The earliest arrival at a goal of who leaves the numbered line on its way, inf: there is none; 0 where there is no room to say.

    Who leaves it at one of its ends, the vertices with the numbers `low` and `high`, has to come back to it elsewhere. States are
    vertices, V times 0 before that, 1 afterwards, 2 or 3 meanwhile (Dijkstra).
    """
    num_vertices, best, place, state, arrived = len(lanes.first) - 1, scratch.best, scratch.stay_of, scratch.vertex, scratch.arrived
    if 4 * num_vertices > len(best):
        return 0.0
    best[: 4 * num_vertices] = np.inf
    best[start] = arrived[0] = 0.0
    state[0], scratch.heap[0] = start, 0
    entries = count = 1
    while count:
        n = pop_by(scratch.key, scratch.heap, count)
        count -= 1
        if arrived[n] > best[state[n]]:
            continue
        phase, v = divmod(state[n], num_vertices)
        if v == goal and phase == 1:
            return arrived[n]
        for e in range(lanes.first[v], lanes.first[v + 1]):
            w, then = lanes.head[e], phase
            if phase == 0 and not (place[v] >= 0 and place[w] >= 0 and abs(place[v] - place[w]) == 1):
                then = 2 if place[v] == low else 3 if place[v] == high else 1
            if then >= 2 and place[w] >= 0:
                then = 0 if place[w] == (low if then == 2 else high) else 1
            at = arrived[n] + lanes.duration[e]
            to = then * num_vertices + w
            if at < best[to]:
                if entries == len(state):
                    return 0.0
                best[to], state[entries], arrived[entries] = at, to, at
                push_by(scratch.key, scratch.heap, count, at, entries)
                entries += 1
                count += 1
    return np.inf
