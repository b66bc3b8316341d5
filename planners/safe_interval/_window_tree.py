"""Kernels of priority-based search in a window of steps, depth first, and of what makes its plans shorter.

Sources: Ma, Harabor, Stuckey, Li, Koenig, "Searching with consistent prioritization for multi-agent path finding", AAAI 2019;
Li, Chen, Harabor, Stuckey, Koenig, "Anytime multi-agent path finding via large neighborhood search", IJCAI 2021.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._clashing import move_of, too_close
from mrp_sumo.search._kernel import kernel
from planners.safe_interval._window_way import NO_WAY, NOBODY, enter, find_way, leave

UNDER_WAY, SOLVED, NO_PLAN = 0, 1, 2
MOST_DEEP = 64 << 20  # bytes of nodes that are kept; beyond, the worse of two children is dropped


class WindowTree(NamedTuple):
    """Up to D nodes that are still to be looked at, the next one last, and the one that is looked at; R robots."""

    above: np.ndarray  # [D, R, R] bool whether one robot goes before another, as far as that is decided
    at: np.ndarray  # [D, R, W + 1] int32 the ways
    cost: np.ndarray  # [D, R] int64 their steps
    own_above: np.ndarray  # [3, R, R] of the node that is looked at, and of its children
    own_at: np.ndarray  # [3, R, W + 1]
    own_cost: np.ndarray  # [3, R]
    before: np.ndarray  # [V] int32 who is where, at a step and at the next
    now: np.ndarray  # [V] int32
    order: np.ndarray  # [R] int64
    count: np.ndarray  # [2] int64 nodes that are still to be looked at; nodes looked at


def room_for_tree(num_robots: int, num_vertices: int, window: int) -> WindowTree:
    """Room for a search, without nodes."""
    deep = max(8, min(4 * num_robots, MOST_DEEP // max(num_robots * (num_robots + 4 * window + 12), 1)))
    shape = [((num_robots, num_robots), np.bool_), ((num_robots, window + 1), np.int32), ((num_robots,), np.int64)]
    return WindowTree(
        *(np.zeros((deep, *of), kind) for of, kind in shape),
        *(np.zeros((3, *of), kind) for of, kind in shape),
        *(np.full(num_vertices, NOBODY, np.int32) for _ in range(2)),
        np.zeros(num_robots, np.int64),
        np.zeros(2, np.int64),
    )


@kernel
def plant(task, room, tree):
    """The root: each robot's best way, which may cross others'. Whether everybody has one."""
    at, num_robots, complete = tree.own_at[0], len(task.start), True
    for r in range(num_robots):
        tree.own_cost[0, r] = find_way(task, room, at, r)
        if tree.own_cost[0, r] == NO_WAY:
            complete = False
            break
        enter(room.others, at, r)
    room.others[:] = NOBODY
    tree.own_above[0, :, :] = False
    tree.count[1] = 0
    tree.count[0] = 1 if complete else 0
    if complete:
        _keep(tree, 0, 0)
    return complete


@kernel(allocates=False)
def _copy(above, at, cost, above_to, at_to, cost_to):
    """Copy a node."""
    for r in range(len(cost)):
        cost_to[r] = cost[r]
        for other in range(len(cost)):
            above_to[r, other] = above[r, other]
        for t in range(at.shape[1]):
            at_to[r, t] = at[r, t]


@kernel(allocates=False)
def _keep(tree, place, own):
    """Keep the node that is looked at, or a child of it, until its turn comes."""
    _copy(tree.own_above[own], tree.own_at[own], tree.own_cost[own], tree.above[place], tree.at[place], tree.cost[place])


@kernel
def search(task, room, tree, nodes, most_labels):
    """Look at so many nodes, or until there have been so many labels; a plan is left in `own_at[0]`."""
    deep = len(tree.above)
    for _ in range(nodes):
        if tree.count[0] == 0:
            return NO_PLAN
        if room.count[1] >= most_labels:
            break
        tree.count[0] -= 1
        tree.count[1] += 1
        place = tree.count[0]
        _copy(tree.above[place], tree.at[place], tree.cost[place], tree.own_above[0], tree.own_at[0], tree.own_cost[0])
        one, other = first_conflict(task, tree, tree.own_at[0])
        if one < 0:
            return SOLVED
        fine = _below(task, room, tree, 1, one, other), _below(task, room, tree, 2, other, one)
        costs = tree.own_cost[1].sum(), tree.own_cost[2].sum()
        better = 1 if costs[0] <= costs[1] else 2
        if fine[0] and fine[1] and place + 1 < deep:
            _keep(tree, place, 3 - better)
            place += 1
        elif fine[0] != fine[1]:
            better = 1 if fine[0] else 2
        if fine[0] or fine[1]:
            _keep(tree, place, better)
            place += 1
        tree.count[0] = place
    return UNDER_WAY


@kernel(allocates=False)
def first_conflict(task, tree, at):
    """The two robots that meet first; -1 where nobody does."""
    before, now, num_robots = tree.before, tree.now, len(at)
    one, other = np.int64(-1), np.int64(-1)
    for r in range(num_robots):
        before[at[r, 0]] = r
    for t in range(1, at.shape[1]):
        for r in range(num_robots):
            if now[at[r, t]] != NOBODY:
                one, other = np.int64(now[at[r, t]]), np.int64(r)
                break
            now[at[r, t]] = r
        if one < 0:
            for r in range(num_robots):
                other = _met(task, tree, at, r, t)
                if other >= 0:
                    one = np.int64(r)
                    break
        for r in range(num_robots):
            before[at[r, t - 1]], now[at[r, t]] = NOBODY, NOBODY
        if one >= 0:
            break
        for r in range(num_robots):
            before[at[r, t]] = r
    for r in range(num_robots):
        before[at[r, at.shape[1] - 1]] = NOBODY
    return one, other


@kernel(allocates=False)
def _met(task, tree, at, r, t):
    """Somebody that a robot meets on its way to step t, where all are on vertices of their own; -1: nobody."""
    before, now, clashes = tree.before, tree.now, task.clashes
    u, v = np.int64(at[r, t - 1]), np.int64(at[r, t])
    ahead = np.int64(before[v])
    if u != v and ahead >= 0:
        if at[ahead, t] == u:
            return ahead
        if not clashes.rotations:
            behind, x = ahead, np.int64(at[ahead, t])
            for _ in range(len(at)):
                if x == u:
                    return ahead if not tree.own_above[0, r, ahead] and not tree.own_above[0, ahead, r] else behind
                behind = np.int64(before[x])
                if behind < 0 or at[behind, t] == x:
                    break
                x = np.int64(at[behind, t])
    if clashes.any:
        move = move_of(task.first, task.head, u, v)
        for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
            w = clashes.vertex[k]
            for found in (np.int64(before[w]), np.int64(now[w])):
                if found >= 0 and found != r:
                    return found
        for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
            lane = clashes.lane[k]
            found = np.int64(before[task.tail[lane]])
            if found >= 0 and found != r and at[found, t] == task.head[lane]:
                return found
    return np.int64(-1)


@kernel
def _below(task, room, tree, own, high, low):
    """A child, in which one robot goes before another; whether everybody has a way. Who meets those above looks for another way."""
    num_robots = len(task.start)
    above, at, cost = tree.own_above[own], tree.own_at[own], tree.own_cost[own]
    _copy(tree.own_above[0], tree.own_at[0], tree.own_cost[0], above, at, cost)
    if above[low, high]:
        return False
    for a in range(num_robots):
        if a == high or above[a, high]:
            for b in range(num_robots):
                if b == low or above[low, b]:
                    above[a, b] = True
    num = 0
    for r in range(num_robots):
        if r == low or above[low, r]:
            tree.order[num] = r
            num += 1
    rank = np.zeros(num, np.int64)
    for k in range(num):
        rank[k] = above[:, tree.order[k]].sum()
    by_rank = np.argsort(rank, kind="mergesort")  # the relation is transitive: who is above has fewer above
    for k in by_rank:
        r = tree.order[k]
        if r != low and not _is_hindered(task, at, above, r):
            continue
        for other in range(num_robots):
            if other != r:
                enter(room.above if above[other, r] else room.others, at, other)
        cost[r] = find_way(task, room, at, r)
        leave(room.above, at, num_robots)
        leave(room.others, at, num_robots)
        if cost[r] == NO_WAY:
            return False
    return True


@kernel(allocates=False)
def _is_hindered(task, at, above, r):
    """Whether a robot meets one of those above it on its way, or moves in a ring."""
    for other in range(len(at)):
        if above[other, r]:
            for t in range(1, at.shape[1]):
                if at[other, t] == at[r, t] or (at[other, t] == at[r, t - 1] and at[other, t - 1] == at[r, t]):
                    return True
                if task.clashes.any:
                    u, v = np.int64(at[other, t - 1]), np.int64(at[other, t])
                    move = move_of(task.first, task.head, np.int64(at[r, t - 1]), np.int64(at[r, t]))
                    if too_close(task.clashes, move, move_of(task.first, task.head, u, v), u, v):
                        return True
    return False


@kernel
def polish(task, room, tree, least, size, rounds, most_labels, rng):
    """Plan a late robot again with those in its way, and keep what is shorter, time and again.

    Parameters
    ----------
    least
        [R] steps of each robot's shortest way.
    size
        Robots at a time, at most.
    rounds, most_labels
        Tries; labels after which there are no more.
    rng
        Chance.
    """
    at, cost, num_robots = tree.own_at[0], tree.own_cost[0], len(task.start)
    saved, saved_cost, chosen = np.zeros((size, at.shape[1]), np.int32), np.zeros(size, np.int64), np.zeros(size, np.int64)
    for r in range(num_robots):
        enter(room.above, at, r)
    for _ in range(rounds):
        late = (cost - least).sum()
        if late == 0 or room.count[1] >= most_labels:
            break
        drawn, r = np.int64(rng.random() * late), np.int64(0)
        while drawn >= cost[r] - least[r]:
            drawn -= cost[r] - least[r]
            r += 1
        num = _around(task, room, at, r, chosen, saved)
        old = np.int64(0)
        for k in range(num):
            other = np.int64(rng.random() * (num - k)) + k
            chosen[k], chosen[other] = chosen[other], chosen[k]
            saved[k], saved_cost[k] = at[chosen[k]], cost[chosen[k]]
            old += saved_cost[k]
        for k in range(num):
            for t in range(at.shape[1]):
                room.above[t, at[chosen[k], t]] = NOBODY
        new, planned = np.int64(0), 0
        while planned < num:
            steps = find_way(task, room, at, chosen[planned])
            new += steps
            if new > old:
                break
            cost[chosen[planned]] = steps
            enter(room.above, at, chosen[planned])
            planned += 1
        if planned < num:
            for k in range(planned):
                for t in range(at.shape[1]):
                    room.above[t, at[chosen[k], t]] = NOBODY
            for k in range(num):
                at[chosen[k]], cost[chosen[k]] = saved[k], saved_cost[k]
                enter(room.above, at, chosen[k])
    leave(room.above, at, num_robots)


@kernel(allocates=False)
def _around(task, room, at, robot, chosen, saved):
    """A robot and those that hold vertices beside its way while it is near; how many."""
    chosen[0], num = robot, 1
    for t in range(1, at.shape[1]):
        u = at[robot, t - 1]
        for lane in range(task.first[u], task.first[u + 1]):
            other = room.above[t, task.head[lane]]
            if other >= 0 and num < len(chosen):
                known = False
                for k in range(num):
                    known = known or chosen[k] == other
                if not known:
                    chosen[num] = other
                    num += 1
    return num
