"""Kernel of the earliest arrival under constraints, with nobody but them in the way.

Source: Phillips, Likhachev, "SIPP: safe interval path planning for dynamic environments", ICRA 2011. The
constraints cut a vertex's time into intervals; of two arrivals in one interval the earlier is as good as the later.
"""

import numpy as np

from mrp_sumo.search._constraints import (
    EARLIEST,
    EXPANSIONS,
    LAST_MUST,
    OPEN_FROM,
    STAMP,
    elsewhere,
    forbidden,
    put,
)
from mrp_sumo.search._distance import UNREACHABLE
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._records import FOREVER, NO_PATH, OK, OUT_OF_BUDGET, SCRATCH_FULL

NO_EDGE = (-1, -1)


@kernel(inline="always")
def _first_rule(touched, rule_at, stamp, v):
    """The first rule of a spot, -1 for none."""
    return np.int64(rule_at[v]) if touched[v] == stamp else np.int64(-1)


@kernel
def _free_until(scratch, first_rule, v, step):
    """The last step until which a robot that is at spot v can stay there."""
    rule, must, stamp, last_must = scratch.rule, scratch.must, scratch.number[STAMP], scratch.limit[LAST_MUST]
    until = np.int64(FOREVER)
    k = first_rule
    while k >= 0:
        if rule[k].tail < 0 and rule[k].begin > step:
            until = min(until, np.int64(rule[k].begin) - 1)
        k = rule[k].after
    for t in range(step + 1, min(last_must, until) + 1):
        if elsewhere(must, stamp, t, v):
            return np.int64(t - 1)
    return until


@kernel
def _entry(scratch, first_rule, u, v, step, latest):
    """(when spot v can be entered from spot u, not before `step`; the first step of its interval then)."""
    rule, must, stamp, last_must = scratch.rule, scratch.must, scratch.number[STAMP], scratch.limit[LAST_MUST]
    begin = np.int64(0)
    again = True
    while again and step <= latest:
        again = False
        begin = np.int64(0)
        k = first_rule
        while k >= 0:
            if rule[k].begin <= step <= rule[k].end and (rule[k].tail < 0 or rule[k].tail == u):
                step = np.int64(rule[k].end) + 1
                again = True
            elif rule[k].tail < 0 and rule[k].end < step:
                begin = max(begin, np.int64(rule[k].end) + 1)
            k = rule[k].after
        while step <= min(last_must, latest) and elsewhere(must, stamp, step, v):
            step += 1
            again = True
    for t in range(min(step - 1, last_must), begin - 1, -1):
        if elsewhere(must, stamp, t, v):
            begin = np.int64(t + 1)
            break
    return step, begin


@kernel(inline="always")
def _last_state_at(state, at, num_states, v):
    """The state last put at v by this search, -1 for none."""
    k = np.int64(at[v])
    if k >= num_states or state[k].vertex != v:
        k = np.int64(-1)
    return k


@kernel(inline="always")
def _entered_before(state, e, begin, arrive):
    """Whether an interval of a vertex, whose last state is e, was entered as early before."""
    known = False
    while e >= 0 and not known:
        known = state[e].label == begin and state[e].step <= arrive
        e = np.int64(state[e].alike)
    return known


@kernel(inline="always")
def is_banned(place_of, u, v, banned):
    """True if a move between spots is the banned edge between two places, in either direction."""
    return banned[0] >= 0 and (
        (place_of[u] == banned[0] and place_of[v] == banned[1]) or (place_of[u] == banned[1] and place_of[v] == banned[0])
    )


@kernel
def earliest_arrival(instance, scratch, start, distance, stay, banned, budget):
    """The least cost under the constraints laid out.

    Parameters
    ----------
    instance, scratch
        The graph; the constraints and buffers.
    start
        Vertex.
    distance
        [V] steps to the goal, where it is 0.
    stay
        Whether the robot stays at the goal, so that the constraints on ending hold.
    banned
        The two places (`Spots.place`) between which no edge must be used, in either direction; see `NO_EDGE`.
    budget
        Expansions allowed.

    Returns
    -------
    code, cost, state
        OK, NO_PATH, SCRATCH_FULL or OUT_OF_BUDGET; the cost, a lower bound of it in the latter cases; the last
        state, from which `BEFORE` leads back, with waits left out.
    """
    first, head, spot_of, place_of = instance.first, instance.head, instance.spots.of, instance.spots.place
    limit, state, top, at = scratch.limit, scratch.state, scratch.top, scratch.visited
    touched, rule_at = scratch.touched, scratch.rule_at
    stamp, last_must = scratch.number[STAMP], limit[LAST_MUST]
    shortest = np.int64(distance[start])
    least = max(shortest, limit[EARLIEST]) if stay else shortest
    if shortest >= UNREACHABLE or forbidden(scratch, spot_of[start], spot_of[start], 0):
        return NO_PATH, least, np.int64(-1)
    open_from = limit[OPEN_FROM] if stay else np.int64(0)
    # a bucket for each delay; LABEL is the first step of the state's interval, ALIKE the vertex's state before this one
    put(scratch, 0, start, 0, -1, 0, 0)
    state[0].alike = -1
    at[start] = 0
    num_states = 1
    delay, longest = 0, 0
    spent = 0
    code, end = NO_PATH, np.int64(-1)
    while code == NO_PATH:
        while delay <= longest and top[delay] < 0:
            delay += 1
        if delay > longest:
            break
        k = np.int64(top[delay])
        top[delay] = state[k].below
        u, t = np.int64(state[k].vertex), np.int64(state[k].step)
        least = max(least, shortest + delay) if stay else shortest + delay
        if distance[u] == 0 and t >= open_from:
            code, end = OK, k
            break
        spent += 1
        if spent > budget:
            code = OUT_OF_BUDGET
            break
        until = np.int64(FOREVER)
        here = spot_of[u]
        if touched[here] == stamp or t < last_must:
            until = _free_until(scratch, _first_rule(touched, rule_at, stamp, here), here, t)
        latest = min(until + 1, FOREVER - 1)
        for lane in range(first[u], first[u + 1]):
            v = head[lane]
            to_go, there = np.int64(distance[v]), spot_of[v]
            if to_go >= UNREACHABLE or is_banned(place_of, here, there, banned):
                continue
            constrained = touched[there] == stamp or last_must >= 0  # a place that the robot had to be at ends intervals of all others
            first_rule = _first_rule(touched, rule_at, stamp, there)
            arrive, begin = t + 1, np.int64(0)
            while arrive <= latest:  # one interval of v after another
                if constrained:
                    arrive, begin = _entry(scratch, first_rule, here, there, arrive, latest)
                    if arrive > latest:
                        break
                last = _last_state_at(state, at, num_states, v)
                if not _entered_before(state, last, begin, arrive):
                    bucket = arrive + to_go - shortest
                    if num_states >= len(state) or bucket >= len(top):
                        code = SCRATCH_FULL
                        break
                    put(scratch, num_states, v, arrive, k, begin, bucket)
                    state[num_states].alike = last
                    at[v] = num_states
                    longest = max(longest, bucket)
                    num_states += 1
                if not constrained:
                    break
                arrive = _free_until(scratch, first_rule, there, arrive) + 1  # the next interval, if u can be held so long
    top[: longest + 1] = -1
    scratch.number[EXPANSIONS] += spent
    return code, least, end
