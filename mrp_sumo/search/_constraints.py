"""The constraints of a record, laid out for a search; the room that searches work in, and its queues of states by bucket."""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._records import (
    EDGE,
    FOREVER,
    MIN_COST,
    NO_PATH,
    OK,
    RANGE,
    SCRATCH_FULL,
    TOO_LATE,
)

# after: the spot's next rule or -1; begin, end: steps, both included; tail: -1 for all
RULE = np.dtype((np.record, [(name, np.int32) for name in ("after", "begin", "end", "tail")]))
# before: the state that it was reached from; below: the next in its bucket; alike: the vertex's state before it
SEARCH_STATE = np.dtype((np.record, [(name, np.int32) for name in ("vertex", "step", "before", "label", "below", "alike")]))
# entries of ConstraintScratch.number
STAMP, EXPANSIONS, NUM_RULES, MARK = 0, 1, 2, 3
# entries of ConstraintScratch.limit, what the constraints say
LAST_MUST, EARLIEST, OPEN_FROM = 0, 1, 2


class ConstraintScratch(NamedTuple):
    """Tables of one search. Entries tell by themselves whether they are of this search, so that none is cleared."""

    touched: np.ndarray  # [S] int32, stamp of spots with constraints
    rule_at: np.ndarray  # [S] int32, the first rule of a spot that is touched
    rule: np.ndarray  # [C] RULE
    must: np.ndarray  # [T] int64, stamp << 32 | the spot to be at
    visited: np.ndarray  # [C] int32, states by vertex and delay; only what the state named says too holds
    state: np.ndarray  # [N] SEARCH_STATE
    top: np.ndarray  # [B] int32, the last state put into each bucket, -1 for none; empty between searches
    later: np.ndarray  # [T + 1] int32, visits of others at the goal from this step on
    mark: np.ndarray  # [V] int64, stamps of level sets
    queue: np.ndarray  # [V] int64
    reach: np.ndarray  # [V] int32, distance table of a corridor's end
    reach_read: np.ndarray  # the same read-only, as are tables of distances: the search is compiled once for both
    level: np.ndarray  # [M] int64 levels being built
    member: np.ndarray  # [Q] int32
    number: np.ndarray  # [4] int64
    limit: np.ndarray  # [3] int64


@kernel
def load(instance, store, scratch, record):
    """Lay out the constraints of a record's chain.

    Returns
    -------
    code
        OK, NO_PATH when they contradict each other, TOO_LATE or SCRATCH_FULL.
    """
    goal = instance.spots.of[instance.goal[store.meta[record].robot]]
    number, limit, rule, touched, rule_at = scratch.number, scratch.limit, scratch.rule, scratch.touched, scratch.rule_at
    number[STAMP] += 1
    stamp = number[STAMP]
    num_rules = 0
    open_from, earliest, last_must = np.int64(0), np.int64(0), np.int64(-1)
    while record >= 0:
        for k in range(store.meta[record].row0, store.meta[record].row1):
            kind = store.rows[k].kind
            v = np.int64(store.rows[k].spot)
            begin, end = np.int64(store.rows[k].begin), np.int64(store.rows[k].end)
            if kind in (RANGE, EDGE):
                if kind == RANGE and v == goal:
                    if end >= FOREVER:
                        return NO_PATH
                    open_from = max(open_from, end + 1)
                if num_rules >= len(rule):
                    return SCRATCH_FULL
                rule[num_rules].after = rule_at[v] if touched[v] == stamp else -1
                rule[num_rules].begin, rule[num_rules].end = begin, end
                rule[num_rules].tail = store.rows[k].tail if kind == EDGE else -1
                touched[v] = stamp
                rule_at[v] = num_rules
                num_rules += 1
            elif kind == MIN_COST:
                earliest = max(earliest, begin)
            else:
                if begin + 1 >= len(scratch.must):
                    return TOO_LATE
                old = scratch.must[begin]
                if old >> 32 == stamp and (old & 0xFFFFFFFF) != v:
                    return NO_PATH
                scratch.must[begin] = (stamp << 32) | v
                last_must = max(last_must, begin)
        record = store.meta[record].parent
    for t in range(last_must + 1):  # the robot may only end after every place it must pass
        old = scratch.must[t]
        if old >> 32 == stamp and (old & 0xFFFFFFFF) != goal:
            open_from = max(open_from, t + 1)
    number[NUM_RULES] = num_rules
    limit[LAST_MUST], limit[EARLIEST], limit[OPEN_FROM] = last_must, max(earliest, open_from), open_from
    return OK


@kernel(inline="always")
def elsewhere(must, stamp, step, spot):
    """True if the robot must be at another spot at this step."""
    return must[step] >> 32 == stamp and (must[step] & 0xFFFFFFFF) != spot


@kernel(inline="always")
def barred(rule, rule_at, u, v, step):
    """True if a rule of a touched spot v forbids to come from u at this step."""
    k = rule_at[v]
    while k >= 0:
        if rule[k].begin <= step <= rule[k].end and (rule[k].tail < 0 or rule[k].tail == u):
            return True
        k = rule[k].after
    return False


@kernel(inline="always")
def is_forbidden(scratch, stamp, last_must, u, v, step):
    """See `forbidden`; for inner loops, where `number[STAMP]` and `limit[LAST_MUST]` are looked up before."""
    return (scratch.touched[v] == stamp and barred(scratch.rule, scratch.rule_at, u, v, step)) or (
        step <= last_must and elsewhere(scratch.must, stamp, step, v)
    )


@kernel
def forbidden(scratch, u, v, step):
    """True if the constraints laid out forbid to come from spot u to spot v at this step, or to be at v = u at the first."""
    return is_forbidden(scratch, scratch.number[STAMP], scratch.limit[LAST_MUST], u, v, step)


@kernel(inline="always")
def put(scratch, k, vertex, step, before, label, bucket):
    """Write state k, and put it on top of a bucket: a list, of which the last state put in comes out first.

    Parameters
    ----------
    scratch
        See `ConstraintScratch`.
    k
        The state's number.
    vertex, step, before, label
        What is written; `before` is the state that it was reached from.
    bucket
        Where it goes.
    """
    state, top = scratch.state, scratch.top
    state[k].vertex, state[k].step, state[k].before = vertex, step, before
    state[k].label, state[k].below = label, top[bucket]
    top[bucket] = k
