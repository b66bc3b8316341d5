"""Kernel: what the ways of discs leave to another one."""

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.safe_interval._discs import Rules, arrival, collide, passes, stands_at


@kernel
def rules_around(lanes, ways, others, reach, room):
    """All that a robot may not do so as not to conflict with the ways of others [N]. Without the room, `count` is -1."""
    rules = Rules(
        np.zeros(2, np.int64),
        np.zeros(room, np.int64),
        np.zeros(room),
        np.zeros(room),
        np.zeros(room, np.int64),
        np.zeros(room),
        np.zeros(room),
    )
    move, stay = np.zeros((3, room)), np.zeros((3, room))
    for other in others:
        for k in range(ways.first[other], ways.first[other + 1] + 1):
            begin = arrival(lanes, ways, other, k)
            last = k == ways.first[other + 1]
            end = np.inf if last else ways.left[k]
            u = stands_at(lanes, ways, other, k)
            num_moves, num_stays = rules.count[0], rules.count[1]
            if num_moves + 2 * len(lanes.tail) > room or num_stays + len(lanes.first) > room:
                rules.count[0] = -1
                return rules
            for e in range(len(lanes.tail)):
                low, high = passes(lanes, e, u, reach)
                if high > low:
                    move[0, num_moves], move[1, num_moves], move[2, num_moves] = e, begin - high, end - low
                    num_moves += 1
                if not last:
                    low, high = collide(lanes, ways.lane[k], e, reach)
                    if high > low:
                        move[0, num_moves], move[1, num_moves], move[2, num_moves] = e, end + low, end + high
                        num_moves += 1
            if not last:
                for v in range(len(lanes.first) - 1):
                    low, high = passes(lanes, ways.lane[k], v, reach)
                    if high > low:
                        stay[0, num_stays], stay[1, num_stays], stay[2, num_stays] = v, end + high, end + low
                        num_stays += 1
            rules.count[0], rules.count[1] = num_moves, num_stays
    for kind in range(2):
        num = rules.count[kind]
        rows = stay if kind else move
        by_time = np.argsort(rows[1, :num], kind="mergesort")
        order = by_time[np.argsort(rows[0, by_time], kind="mergesort")]
        where, first, second = (rules.vertex, rules.begins, rules.lasts) if kind else (rules.lane, rules.not_from, rules.not_until)
        for i in range(num):
            where[i], first[i], second[i] = np.int64(rows[0, order[i]]), rows[1, order[i]], rows[2, order[i]]
    return rules
