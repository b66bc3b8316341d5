"""Kernels that count whom a robot disturbs: the installed robots that it would be in conflict with.

What counts as a conflict of two robots is decided here for searches, in `_conflicts` for constraint trees.
"""

import numpy as np

from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._occupancy import MANY, ONE, WORD, next_visit
from mrp_sumo.search._records import spot_at


@kernel(inline="always")
def is_taken(occupancy, spot, step):
    """True if another robot is at a spot at a step, on its way or for good; False beyond the steps that are known."""
    words = occupancy.words
    on_way = step < words * WORD and ((occupancy.busy[spot * words + (step >> 5)] >> np.uint64(step & 31)) & ONE) != 0
    return on_way or (step < words * WORD and occupancy.since[spot] <= step)


@kernel(inline="always")
def num_disturbed(store, occupancy, u, v, step, u_is_taken, following):
    """Number of robots disturbed by a move from spot u that arrives at spot v at a step, or by waiting at u = v.

    Parameters
    ----------
    u_is_taken
        Whether another robot is at u at this step, see `is_taken`: only then can it have changed places with this one.
    following
        Whether following conflicts count.
    """
    busy, visit, words = occupancy.busy, occupancy.visit, occupancy.words
    num = np.int64(0)
    if occupancy.since[v] <= step:
        num += 1
    if step < words * WORD:
        there, there_before, here = v * words + (step >> 5), v * words + ((step - 1) >> 5), u * words + (step >> 5)
        bits = busy[there] >> np.uint64(step & 31)
        num += np.int64(bits & ONE)
        if bits & MANY:
            num += _others_there(occupancy, visit[there], step)
        if u != v:
            if (u_is_taken or following) and (busy[there_before] >> np.uint64((step - 1) & 31)) & ONE:
                num += _who_leave(store, occupancy, visit[there_before], u, v, step, following)
            if following and (busy[here] >> np.uint64(step & 31)) & ONE:
                num += _who_follow(store, occupancy, visit[here], v, step)
    return num


@kernel
def num_too_close(instance, occupancy, move, at, step):
    """Number, about, of spots that clash with a move to `at` at `step` and are taken by others: one robot may count more than once."""
    clashes, spots = instance.clashes, instance.spots
    num = np.int64(0)
    for k in range(spots.beside_first[at], spots.beside_first[at + 1]):
        num += is_taken(occupancy, spots.beside[k], step)
    for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
        v = clashes.vertex[k]
        num += is_taken(occupancy, v, step) or is_taken(occupancy, v, step - 1)
    for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
        lane = clashes.lane[k]
        num += is_taken(occupancy, spots.tail[lane], step - 1) and is_taken(occupancy, spots.head[lane], step)
    return num


@kernel
def _others_there(occupancy, visit, step):
    """How many robots but the first are at a spot at a step."""
    after, num_robots = occupancy.after, len(occupancy.record)
    low = step * num_robots
    num = 0
    e = next_visit(after, after[next_visit(after, visit, low, num_robots)], low, num_robots)
    while e:
        num += 1
        e = next_visit(after, after[e], low, num_robots)
    return num


@kernel
def _who_leave(store, occupancy, visit, u, v, step, following):
    """How many robots at v the step before go to u as the robot comes from there; with `following`, all who leave v."""
    after, num_robots = occupancy.after, len(occupancy.record)
    low = (step - 1) * num_robots
    num = 0
    e = next_visit(after, visit, low, num_robots)
    while e:
        went = spot_at(store, occupancy.record[e - low - 1], step)
        if went == u or (following and went != v):
            num += 1
        e = next_visit(after, after[e], low, num_robots)
    return num


@kernel
def _who_follow(store, occupancy, visit, v, step):
    """How many robots enter the spot that the robot leaves, but those that come from v, where it goes."""
    after, num_robots = occupancy.after, len(occupancy.record)
    low = step * num_robots
    num = 0
    e = next_visit(after, visit, low, num_robots)
    while e:
        if spot_at(store, occupancy.record[e - low - 1], step - 1) != v:
            num += 1
        e = next_visit(after, after[e], low, num_robots)
    return num


@kernel
def count_visits_from(occupancy, goal, begin, later):
    """Fill `later` with the visits of others at the goal, a spot, from each step on, from `begin`; the last step with one, -1 for none."""
    words, num_robots = occupancy.words, len(occupancy.record)
    low, last = goal * words, np.int64(-1)
    for word in range(words - 1, (begin >> 5) - 1, -1):
        if occupancy.busy[low + word] == 0:
            if last >= 0:
                later[word * WORD : (word + 1) * WORD] = later[(word + 1) * WORD]
            continue
        if last < 0:
            last = np.int64(word * WORD + WORD - 1)
            later[last + 1] = 0
        later[word * WORD : (word + 1) * WORD] = 0
        k = np.int64(occupancy.visit[low + word])
        while k > 0:
            later[(k - 1) // num_robots] += 1
            k = np.int64(occupancy.after[k])
        for t in range(word * WORD + WORD - 1, word * WORD - 1, -1):
            later[t] += later[t + 1]
    return last
