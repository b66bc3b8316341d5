"""Kernels: corridors that two discs want to pass in opposite directions.

After the corridor reasoning of Li, Harabor, Stuckey, Ma, Gange, Koenig, "Pairwise symmetry reasoning for multi-agent path finding search",
AIJ 2021, in continuous time. In a corridor, lanes that are joined by vertices with two neighbours, two discs cannot pass each other: who is
through second has entered after the first one has left, and has gone on by as much as both must keep. So one of both reaches its end only
after the other's earliest arrival and the length of the corridor, unless it goes round: one split for what else takes many, each of which
delays either by next to nothing.
"""

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.safe_interval._discs import find, rule_against

EPS = 1e-6  # s that no rule may rest on


@kernel(allocates=False)
def rules_of(lanes, ways, conflict, paths, forbidden, scratch):
    """Rules that end a conflict, one against either robot: is_stay, place, two times.

    Neither may leave a corridor before the other can be through; where there is none, or that would not keep them from what they do now,
    see `rule_against`.

    Parameters
    ----------
    conflict
        Kind, and move or stay of each way, see `conflicts`.
    paths
        The ways of both.
    forbidden
        Rules of both so far.
    """
    one, other = paths
    p, q, num = corridor(lanes, ways, conflict, one, other)
    if num > 0:
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
            return (0, last, -1.0, until), (0, other_last, -1.0, other_until)
    return rule_against(lanes, ways, conflict, one, other, False), rule_against(lanes, ways, conflict, one, other, True)


@kernel(allocates=False)
def at_end(lanes, start, lane, rules, scratch):
    """Earliest times of a robot at the end of a lane, to pass or to stay: at all, and by another lane; inf: never, nan: no room to say."""
    vertex = lanes.head[lane]
    trip = lanes.zero, start, vertex
    entry = find(lanes, trip, rules, scratch, False, -1)
    direct = scratch.arrived[entry] if entry >= 0 else np.inf if entry == -1 else np.nan
    entry = find(lanes, trip, rules, scratch, False, lane)
    return direct, scratch.arrived[entry] if entry >= 0 else np.inf if entry == -1 else np.nan


@kernel(allocates=False)
def corridor(lanes, ways, conflict, one, other):
    """The longest corridor about a conflict that both pass: a move of each, its first one there, and how many; 0: none.

    Nobody starts within, nor at its own end.
    """
    _, i, j = conflict
    a0, a1, b0, b1 = ways.first[one], ways.first[one + 1], ways.first[other], ways.first[other + 1]
    for p in range(max(a0, a0 + i - 1), min(a1, a0 + i + 2)):
        for q in range(max(b0, b0 + j - 1), min(b1, b0 + j + 2)):
            if lanes.reverse[ways.lane[p]] == ways.lane[q]:
                return cut(lanes, ways, one, other, *extended(lanes, ways, one, other, p, q))
    return 0, 0, 0


@kernel(allocates=False)
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


@kernel(allocates=False)
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
