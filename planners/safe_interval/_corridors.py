"""Kernels: corridors that two discs want to pass in opposite directions.

After the corridor reasoning of Li, Harabor, Stuckey, Ma, Gange, Koenig, "Pairwise symmetry reasoning for multi-agent path finding search",
AIJ 2021, in continuous time. In a corridor, lanes that are joined by vertices with two neighbours, two discs cannot pass each other: who is
through second has entered after the first one has left, and has gone on by as much as both must keep. So one of both reaches its end only
after the other's earliest arrival and the length of the corridor, unless it goes round: one split for what else takes many, each of which
delays either by next to nothing.
"""

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.safe_interval._discs import find

EPS = 1e-6  # s that no rule may rest on


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
                return cut(lanes, ways, one, other, *extended(lanes, ways, p, q, a0, a1, b0, b1))
    return 0, 0, 0


@kernel(allocates=False)
def extended(lanes, ways, p, q, a0, a1, b0, b1):
    """All of a corridor of which one passes a lane in its move p, the other in its move q."""
    num, begin, end = 1, lanes.tail[ways.lane[p]], lanes.head[ways.lane[p]]
    while p > a0 and q + num < b1 and lanes.inner[begin] and lanes.reverse[ways.lane[p - 1]] == ways.lane[q + num]:
        v = lanes.tail[ways.lane[p - 1]]
        if v == end:
            break
        p, num, begin = p - 1, num + 1, v
    while p + num < a1 and q > b0 and lanes.inner[end] and lanes.reverse[ways.lane[p + num]] == ways.lane[q - 1]:
        v = lanes.head[ways.lane[p + num]]
        if v == begin:
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


@kernel(allocates=False)
def earliest(lanes, start, vertex, rules, scratch):
    """Earliest time of a robot at a vertex, whether or not it can stay; inf: never, nan: no room to say."""
    entry = find(lanes, lanes.zero, start, vertex, rules, scratch, False)
    return scratch.arrived[entry] if entry >= 0 else np.inf if entry == -1 else np.nan


@kernel(allocates=False)
def last_lane(ways, first, num):
    """The lane on which a robot leaves a corridor that it enters with this move."""
    return ways.lane[first + num - 1]


@kernel(allocates=False)
def departures(lanes, ways, run, ours, theirs):
    """Until when either may not leave the corridor on its last lane; of both -1.0 where that would not keep them from what they do now.

    Parameters
    ----------
    run
        See `corridor`.
    ours, theirs
        When either can be at its end, and when without the last lane, see `earliest`.
    """
    p, q, num = run
    last, other_last = last_lane(ways, p, num), last_lane(ways, q, num)
    through = lanes.clear - EPS
    for k in range(num):
        through += lanes.duration[ways.lane[p + k]]
    until = min(ours[1], theirs[0] + through) - lanes.duration[last]
    other_until = min(theirs[1], ours[0] + through) - lanes.duration[other_last]
    helps = ways.left[p + num - 1] < until - EPS and ways.left[q + num - 1] < other_until - EPS
    return (until, other_until) if helps else (-1.0, -1.0)
