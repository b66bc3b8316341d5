"""Kernel: what two discs cost at least that must not collide, by conflict-based search over both.

It is the weight of an edge of the WDG heuristic (Li, Felner, Boyarski, Ma, Koenig, "Improved heuristics for multi-agent path finding with
conflict-based search", IJCAI 2019).
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._heap import pop_by, push_by
from mrp_sumo.search._kernel import kernel
from planners.safe_interval._corridors import corridor, departures, earliest, last_lane
from planners.safe_interval._discs import (
    DiscConstraints,
    DiscPaths,
    DiscScratch,
    Lanes,
    add_rule,
    conflicts,
    copy_rules,
    find,
    new_ways,
    rule_against,
    write_way,
)

EPS = 1e-6  # s
MOST_CONFLICTS = 4  # that are looked at in a node


class PairTask(NamedTuple):
    """Two robots; see `_discs.find`."""

    lanes: Lanes
    left_s: np.ndarray  # [2, V]
    start: np.ndarray  # [2]
    goal: np.ndarray  # [2]
    forbidden: tuple[DiscConstraints, DiscConstraints]
    rules: DiscConstraints  # room for all that one may not do
    scratch: DiscScratch


class Pair(NamedTuple):
    """Room for a tree of N nodes."""

    parent: np.ndarray  # [N]
    robot: np.ndarray  # [N] which of both has one rule more than at the parent
    is_stay: np.ndarray  # [N] the rule
    place: np.ndarray  # [N]
    times: np.ndarray  # [N, 2]
    way: np.ndarray  # [N, 2]
    cost: np.ndarray  # [N, 2] s, inf: that robot has no way
    bound: np.ndarray  # [N] s
    child: np.ndarray  # [N] the first of two, 0: not known yet, -1: the node is a solution
    key: np.ndarray  # [N] s, of a heap
    heap: np.ndarray  # [N] its nodes
    found: np.ndarray  # [MOST_CONFLICTS, 3]
    ways: DiscPaths


def new_pair(nodes: int, moves: int) -> Pair:
    """Room for so many nodes, and for moves of their ways."""
    index = [np.zeros(nodes, np.int64) for _ in range(4)]
    return Pair(
        *index, np.zeros((nodes, 2)), np.zeros((nodes, 2), np.int64), np.zeros((nodes, 2)), np.zeros(nodes),
        np.zeros(nodes, np.int64), np.zeros(nodes), np.zeros(nodes, np.int64), np.zeros((MOST_CONFLICTS, 3), np.int64), new_ways(moves),
    )  # fmt: skip


@kernel(allocates=False)
def least_cost(task, pair):
    """A bound on the sum of costs of two robots, exact where there is room to find them."""
    pair.ways.first[0] = 0
    pair.parent[0] = -1
    used, made, count = 0, 1, 1
    for k in range(2):
        used, fits = add_way(task, pair, 0, k, used)
        if not fits:
            return 0.0
    pair.bound[0] = pair.cost[0, 0] + pair.cost[0, 1]
    pair.child[0] = 0
    push_by(pair.key, pair.heap, 0, pair.bound[0], 0)
    while count:
        n = pop_by(pair.key, pair.heap, count)
        count -= 1
        bound = pair.bound[n]
        if not bound < np.inf:
            return np.inf
        if pair.child[n] == 0:
            used, fits = split(task, pair, n, made, used)
            if not fits or pair.child[n] < 0:
                return bound
            made += 2
            pair.bound[n] = max(bound, min(total(pair, made - 2), total(pair, made - 1)))
            if pair.bound[n] > bound + EPS:
                push_by(pair.key, pair.heap, count, pair.bound[n], n)
                count += 1
                continue
        for c in range(pair.child[n], pair.child[n] + 2):
            pair.bound[c] = max(pair.bound[n], total(pair, c))
            if pair.bound[c] < np.inf:
                pair.child[c] = 0
                push_by(pair.key, pair.heap, count, pair.bound[c], c)
                count += 1
    return np.inf


@kernel(allocates=False)
def total(pair, n):
    """Cost of both at a node."""
    return pair.cost[n, 0] + pair.cost[n, 1]


@kernel(allocates=False)
def split(task, pair, node, made, used):
    """Make the children (`made`, and the next) for that conflict of a node of which the cheaper one costs most.

    Returns the number of ways by then, and whether there is room.
    """
    ways, best, chosen = pair.ways, -1.0, made
    one, other = pair.way[node, 0], pair.way[node, 1]
    num = conflicts(task.lanes, ways, one, other, MOST_CONFLICTS, pair.found, 0)
    if made + 4 > len(pair.parent):
        return used, False
    for c in range(num):
        low = np.inf
        conflict = pair.found[c, 0], pair.found[c, 1], pair.found[c, 2]
        run = corridor(task.lanes, ways, conflict, one, other)
        until = through(task, pair, node, run)
        for k in range(2):
            n = chosen + k
            if until[k] >= 0.0:
                is_stay, place, t0, t1 = 0, last_lane(ways, run[k], run[2]), -1.0, until[k]
            else:
                is_stay, place, t0, t1 = rule_against(task.lanes, ways, conflict, one, other, k == 1)
            pair.parent[n], pair.robot[n], pair.is_stay[n], pair.place[n] = node, k, is_stay, place
            pair.times[n, 0], pair.times[n, 1] = t0, t1
            pair.way[n, 1 - k], pair.cost[n, 1 - k] = pair.way[node, 1 - k], pair.cost[node, 1 - k]
            used, fits = add_way(task, pair, n, k, used)
            if not fits:
                return used, False
            low = min(low, total(pair, n))
        if low > best:
            best = low
            if chosen > made:
                for k in range(2):
                    copy_node(pair, chosen + k, made + k)
        chosen = made + 2
    pair.child[node] = made if num else -1
    return used, True


@kernel(allocates=False)
def through(task, pair, n, run):
    """Until when either may not leave a corridor at a node, -1.0: any time; see `_corridors.departures`."""
    if run[2] == 0:
        return -1.0, -1.0
    ours, theirs = at_end(task, pair, n, 0, run[0], run[2]), at_end(task, pair, n, 1, run[1], run[2])
    return departures(task.lanes, pair.ways, run, ours, theirs)


@kernel(allocates=False)
def at_end(task, pair, n, k, first, num):
    """Earliest times of one of both at the end of a corridor: at all, and without its last lane."""
    lanes, rules = task.lanes, task.rules
    lane = last_lane(pair.ways, first, num)
    if not load_rules(task, pair, n, k) or rules.count[0] >= len(rules.lane):
        return np.nan, np.nan
    direct = earliest(lanes, task.start[k], lanes.head[lane], rules, task.scratch)
    add_rule(rules, 0, lane, -1.0, np.inf)
    return direct, earliest(lanes, task.start[k], lanes.head[lane], rules, task.scratch)


@kernel(allocates=False)
def copy_node(pair, n, into):
    """The same node under another number."""
    pair.parent[into], pair.robot[into], pair.is_stay[into], pair.place[into] = (
        pair.parent[n],
        pair.robot[n],
        pair.is_stay[n],
        pair.place[n],
    )
    for k in range(2):
        pair.times[into, k], pair.way[into, k], pair.cost[into, k] = pair.times[n, k], pair.way[n, k], pair.cost[n, k]


@kernel(allocates=False)
def add_way(task, pair, n, k, used):
    """Let one of both drive at a node. Returns the number of ways by then, and whether there is room."""
    rules, scratch = task.rules, task.scratch
    if not load_rules(task, pair, n, k):
        return used, False
    entry = find(task.lanes, task.left_s[k], task.start[k], task.goal[k], rules, scratch, True)
    if entry == -2:
        return used, False
    pair.cost[n, k] = scratch.arrived[entry] if entry >= 0 else np.inf
    if entry >= 0 and not write_way(entry, scratch, task.start[k], used, pair.ways):
        return used, False
    pair.way[n, k] = used
    return used + (1 if entry >= 0 else 0), True


@kernel(allocates=False)
def load_rules(task, pair, n, k):
    """Have the rules of one of both at a node in `task.rules`; False where there is no room."""
    rules = task.rules
    copy_rules(task.forbidden[0] if k == 0 else task.forbidden[1], rules)
    while n > 0:
        if pair.robot[n] == k:
            if rules.count[pair.is_stay[n]] >= len(rules.lane):
                return False
            add_rule(rules, pair.is_stay[n], pair.place[n], pair.times[n, 0], pair.times[n, 1])
        n = pair.parent[n]
    return True
