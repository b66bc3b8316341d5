"""Kernel of the earliest arrival under constraints, with nobody but them in the way.

Source: Phillips, Likhachev, "SIPP: safe interval path planning for dynamic environments", ICRA 2011. The
constraints cut a vertex's time into intervals; of two arrivals in one interval the earlier is as good as the later.
"""

import numpy as np

from mrp_sumo.search._constraints import (
    ALIKE,
    BEFORE,
    BELOW,
    EARLIEST,
    EXPANSIONS,
    FROM,
    LABEL,
    LAST_MUST,
    LATEST,
    NEXT,
    OPEN_FROM,
    STAMP,
    STEP,
    TAIL,
    TO,
    VERTEX,
    elsewhere,
    forbidden,
)
from mrp_sumo.search._distance import UNREACHABLE
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._records import FOREVER, NO_PATH, OK, OUT_OF_BUDGET, SCRATCH_FULL


@kernel
def _free_until(rule, k, must, stamp, last_must, v, step):
    """The last step until which a robot that is at v, whose first rule is k, can stay there."""
    until = np.int64(FOREVER)
    while k >= 0:
        if rule[k, TAIL] < 0 and rule[k, FROM] > step:
            until = min(until, np.int64(rule[k, FROM]) - 1)
        k = rule[k, NEXT]
    for t in range(step + 1, min(last_must, until) + 1):
        if elsewhere(must, stamp, t, v):
            return np.int64(t - 1)
    return until


@kernel
def _entry(rule, first_rule, must, stamp, last_must, u, v, step, latest):
    """(when v, whose first rule is given, can be entered from u, not before `step`; the first step of its interval then)."""
    begin = np.int64(0)
    again = True
    while again and step <= latest:
        again = False
        begin = np.int64(0)
        k = first_rule
        while k >= 0:
            if rule[k, FROM] <= step <= rule[k, TO] and (rule[k, TAIL] < 0 or rule[k, TAIL] == u):
                step = np.int64(rule[k, TO]) + 1
                again = True
            elif rule[k, TAIL] < 0 and rule[k, TO] < step:
                begin = max(begin, np.int64(rule[k, TO]) + 1)
            k = rule[k, NEXT]
        while step <= min(last_must, latest) and elsewhere(must, stamp, step, v):
            step += 1
            again = True
    for t in range(min(step - 1, last_must), begin - 1, -1):
        if elsewhere(must, stamp, t, v):
            begin = np.int64(t + 1)
            break
    return step, begin


@kernel(inline="always")
def _entered_before(state, e, begin, arrive):
    """Whether an interval of a vertex, whose last state is e, was entered as early before."""
    known = False
    while e >= 0 and not known:
        known = state[e, LABEL] == begin and state[e, STEP] <= arrive
        e = np.int64(state[e, ALIKE])
    return known


@kernel(inline="always")
def _banned(u, v, ban_u, ban_v):
    """Whether a lane is the banned edge, in either direction."""
    return ban_u >= 0 and ((u == ban_u and v == ban_v) or (u == ban_v and v == ban_u))


@kernel
def earliest_arrival(world, scratch, start, goal, distance, stay, ban_u, ban_v, budget):
    """The least cost under the constraints laid out.

    Parameters
    ----------
    world, scratch
        The graph, the constraints and room.
    start, goal
        Vertices.
    distance
        [V] steps to the goal.
    stay
        Whether the robot stays at the goal, so that the constraints on ending hold.
    ban_u, ban_v
        An edge that must not be used, in either direction; -1 for none.
    budget
        Expansions allowed.

    Returns
    -------
    code, cost, state
        OK, NO_PATH, SCRATCH_FULL or OUT_OF_BUDGET; the cost, a lower bound of it in the latter cases; the last
        state, from which `BEFORE` leads back, with waits left out.
    """
    first, head = world.first, world.head
    limit, state, top, at = scratch.limit, scratch.state, scratch.top, scratch.visited
    touched, rule_at, rule, must = scratch.touched, scratch.rule_at, scratch.rule, scratch.must
    stamp, last_must = scratch.number[STAMP], limit[LAST_MUST]
    shortest = np.int64(distance[start])
    least = max(shortest, limit[EARLIEST]) if stay else shortest
    if shortest >= UNREACHABLE or least > limit[LATEST] or forbidden(scratch, start, start, 0):
        return NO_PATH, least, np.int64(-1)
    open_from = limit[OPEN_FROM] if stay else np.int64(0)
    # a bucket for each delay; LABEL is the first step of the state's interval, ALIKE the vertex's state before this one
    state[0, VERTEX], state[0, STEP], state[0, BEFORE], state[0, LABEL], state[0, BELOW], state[0, ALIKE] = start, 0, -1, 0, -1, -1
    at[start] = 0
    num_states = 1
    top[0] = 0
    delay, longest = 0, 0
    spent = 0
    code, end = NO_PATH, np.int64(-1)
    while True:
        while delay <= longest and top[delay] < 0:
            delay += 1
        if delay > longest:
            break
        k = np.int64(top[delay])
        top[delay] = state[k, BELOW]
        u, t = np.int64(state[k, VERTEX]), np.int64(state[k, STEP])
        least = max(least, shortest + delay) if stay else shortest + delay
        if u == goal and t >= open_from:
            code, end = OK, k
            break
        spent += 1
        if spent > budget:
            code = OUT_OF_BUDGET
            break
        until = np.int64(FOREVER)
        if touched[u] == stamp or t < last_must:
            until = _free_until(rule, np.int64(rule_at[u]) if touched[u] == stamp else -1, must, stamp, last_must, u, t)
        latest = min(until + 1, FOREVER - 1)
        for lane in range(first[u], first[u + 1]):
            v = head[lane]
            to_go = np.int64(distance[v])
            if to_go >= UNREACHABLE or _banned(u, v, ban_u, ban_v):
                continue
            arrive, begin = t + 1, np.int64(0)
            constrained = touched[v] == stamp or t < last_must
            k_rule = np.int64(rule_at[v]) if touched[v] == stamp else np.int64(-1)
            while arrive <= latest:
                if constrained:
                    arrive, begin = _entry(rule, k_rule, must, stamp, last_must, u, v, arrive, latest)
                    if arrive > latest:
                        break
                last = np.int64(at[v])
                if last >= num_states or state[last, VERTEX] != v:
                    last = np.int64(-1)
                if not _entered_before(state, last, begin, arrive):
                    bucket = arrive + to_go - shortest
                    if num_states >= len(state) or bucket >= len(top):
                        code = SCRATCH_FULL
                        break
                    state[num_states, VERTEX], state[num_states, STEP], state[num_states, BEFORE] = v, arrive, k
                    state[num_states, LABEL], state[num_states, BELOW], state[num_states, ALIKE] = begin, top[bucket], last
                    at[v] = num_states
                    top[bucket] = num_states
                    longest = max(longest, bucket)
                    num_states += 1
                if not constrained:
                    break
                arrive = _free_until(rule, k_rule, must, stamp, last_must, v, arrive) + 1  # the next interval, if u can be held so long
        if code == SCRATCH_FULL:
            break
    top[: longest + 1] = -1
    scratch.number[EXPANSIONS] += spent
    if code == OK and stay and least > limit[LATEST]:
        code = NO_PATH
    return code, least, end
