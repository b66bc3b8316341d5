"""Kernel: what two discs cost at least that must not collide, by conflict-based search over both.

It is the weight of an edge of the WDG heuristic (Li, Felner, Boyarski, Ma, Koenig, "Improved heuristics for multi-agent path finding with
conflict-based search", IJCAI 2019). By a `TimedTree` of two robots, which knows any motion, `ccbs` takes twice as long.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._heap import pop_by, push_by
from mrp_sumo.search._kernel import kernel
from planners.safe_interval._corridors import rules_of
from planners.safe_interval._discs import (
    RULE,
    DiscConflict,
    DiscConstraints,
    DiscPaths,
    DiscScratch,
    Lanes,
    add_rule,
    conflicts,
    copy_rules,
    find,
    new_ways,
    write_way,
)

EPS = 1e-6  # s
MOST_CONFLICTS = 4  # that are looked at in a node

# begin, end: rows of the rules that are more than at the parent's; child: the first of two, 0: not known yet, -1: it is a solution
PAIR_NODE = np.dtype(
    (
        np.record,
        [*((name, np.int64) for name in ("parent", "begin", "end", "child")), ("bound", np.float64)],
    )
)


class PairTask(NamedTuple):
    """Two robots; see `_discs.find`."""

    lanes: Lanes
    left_s: np.ndarray  # [2, V]
    start: np.ndarray  # [2]
    goal: np.ndarray  # [2]
    forbidden: tuple[DiscConstraints, DiscConstraints]
    rules: tuple[DiscConstraints, DiscConstraints]  # room for those of both at a node
    more: DiscConstraints  # and of one of them below it
    scratch: DiscScratch


class Pair(NamedTuple):
    """Room for a tree of N nodes."""

    node: np.ndarray  # [N] PAIR_NODE
    path: np.ndarray  # [N, 2]
    cost: np.ndarray  # [N, 2] s, inf: that robot has no way
    key: np.ndarray  # [N] s, of a heap
    heap: np.ndarray  # [N] its nodes
    conflict_rows: np.ndarray  # [MOST_CONFLICTS, 3]
    rule: np.ndarray  # [K] RULE, of all nodes
    ways: DiscPaths


def new_pair(nodes: int, room: int) -> Pair:
    """Room for so many nodes, and for moves of their ways and their rules."""
    return Pair(
        np.zeros(nodes, PAIR_NODE), np.zeros((nodes, 2), np.int64), np.zeros((nodes, 2)), np.zeros(nodes), np.zeros(nodes, np.int64),
        np.zeros((MOST_CONFLICTS, 3), np.int64), np.zeros(room, RULE), new_ways(room),
    )  # fmt: skip


@kernel
def least_cost(task, pair):
    """A bound on the sum of costs of two robots, exact where there is room to find them."""
    node = pair.node
    pair.ways.first[0] = 0
    node[0].parent = -1
    used, made, count, ruled = 0, 1, 1, 0
    for k in range(2):
        used, fits = add_way(task, pair, 0, k, used)
        if not fits:
            return 0.0
    node[0].bound = total(pair, 0)
    node[0].child = 0
    push_by(pair.key, pair.heap, 0, node[0].bound, 0)
    while count:
        n = pop_by(pair.key, pair.heap, count)
        count -= 1
        bound = node[n].bound
        if not bound < np.inf:
            return np.inf
        if node[n].child == 0:
            used, ruled, fits = split(task, pair, n, made, used, ruled)
            if not fits or node[n].child < 0:
                return bound
            made += 2
            node[n].bound = max(bound, min(total(pair, made - 2), total(pair, made - 1)))
            if node[n].bound > bound + EPS:
                push_by(pair.key, pair.heap, count, node[n].bound, n)
                count += 1
                continue
        for c in range(node[n].child, node[n].child + 2):
            node[c].bound = max(node[n].bound, total(pair, c))
            if node[c].bound < np.inf:
                node[c].child = 0
                push_by(pair.key, pair.heap, count, node[c].bound, c)
                count += 1
    return np.inf


@kernel
def total(pair, n):
    """Cost of both at a node."""
    return pair.cost[n, 0] + pair.cost[n, 1]


@kernel
def split(task, pair, n, made, used, ruled):
    """Make the children (`made`, and the next) of a node for that conflict and keeper of which the cheaper one costs most, then the other.

    Returns the number of ways and of rules by then, and whether there is room.
    """
    node, ways, paths = pair.node, pair.ways, (pair.path[n, 0], pair.path[n, 1])
    best, best_high, chosen = -1.0, -1.0, made
    num = conflicts(task.lanes, ways, paths[0], paths[1], MOST_CONFLICTS, pair.conflict_rows, 0)
    if made + 4 > len(node):
        return used, ruled, False
    for k in range(2):
        if not load_rules(task, pair, n, k, task.rules[k]):
            return used, ruled, False
    parts = 0, 0
    for c in range(2 * num):
        row, keeper = c // 2, c % 2
        if keeper == 1 and parts == (1, 1):
            continue
        kind, part, other_part = pair.conflict_rows[row, 0], pair.conflict_rows[row, 1], pair.conflict_rows[row, 2]
        conflict = DiscConflict(kind, part, other_part, paths[0], paths[1])
        parts = rules_of(task.lanes, ways, conflict, task.rules, task.scratch, keeper, pair.rule[ruled:])
        if parts[0] == 0:
            continue
        if ruled + parts[0] + parts[1] > len(pair.rule):
            return used, ruled, False
        low, high, before = np.inf, -np.inf, used
        for k in range(2):
            child = chosen + k
            node[child].parent, node[child].begin, node[child].end = n, ruled + k * parts[0], ruled + parts[0] + k * parts[1]
            pair.path[child, 1 - k], pair.cost[child, 1 - k] = pair.path[n, 1 - k], pair.cost[n, 1 - k]
            used, fits = add_way(task, pair, child, k, used)
            if not fits:
                return used, ruled, False
            low, high = min(low, total(pair, child)), max(high, total(pair, child))
            if low < best:
                break
        if low < best or (low == best and high <= best_high):
            used = before
            continue
        best, best_high, ruled = low, high, ruled + parts[0] + parts[1]
        if chosen > made:
            for k in range(2):
                node[made + k] = node[chosen + k]
                for j in range(2):
                    pair.path[made + k, j], pair.cost[made + k, j] = pair.path[chosen + k, j], pair.cost[chosen + k, j]
        chosen = made + 2
    node[n].child = made if num else -1
    return used, ruled, True


@kernel
def add_way(task, pair, n, k, used):
    """Let one of both drive at a node. Returns the number of ways by then, and whether there is room."""
    scratch = task.scratch
    if not load_rules(task, pair, n, k, task.more):
        return used, False
    trip = task.left_s[k], task.start[k], task.goal[k]
    entry = find(task.lanes, trip, task.more, scratch, True, -1)
    if entry == -2:
        return used, False
    pair.cost[n, k] = scratch.arrived[entry] if entry >= 0 else np.inf
    if entry >= 0 and not write_way(entry, scratch, task.start[k], used, pair.ways):
        return used, False
    pair.path[n, k] = used
    return used + (1 if entry >= 0 else 0), True


@kernel
def load_rules(task, pair, n, k, rules):
    """Have the rules of one of both at a node in `rules`. Returns whether there is room."""
    copy_rules(task.forbidden[k], rules)
    while n > 0:
        node = pair.node[n]
        for r in range(node.begin, node.end):
            row = pair.rule[r]
            if row.robot == k:
                if rules.count[row.kind] == rules.place.shape[1]:
                    return False
                add_rule(rules, row.kind, row.place, row.begin, row.end)
        n = node.parent
    return True
