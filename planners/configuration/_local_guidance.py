"""Kernels of local guidance: before each step, robots are given short paths in space and time that collide little with each other.

Source: Arita, Okumura, "Local guidance for configuration-based multi-agent pathfinding", AAAI 2026. In the order of their priorities,
robots are given paths of `window` steps, each the cheapest one by what it does not lead nearer the goal and by its collisions with
the others' paths; PIBT prefers the first step of a robot's path to all others. Paths begin as what is left of those for the
step before, so that only robots whose paths collide or lose steps search: where robots are far from each other, hardly any do. What
differs from the paper: costs are those of the guide that a robot has besides, its own way or the traffic flow; one round is enough.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.configuration._flow import STEP
from planners.configuration._pibt_instance import move_along, nearer, next_on_way, spot_of

COLLISION = 3 * STEP  # what a collision costs: robots that would wait longer for each other take their chance
NONE = -1
COST = 10  # bits of `seen` that hold a cost
DEAREST = (1 << COST) - 1  # paths that cost more are equally bad
MOST_SEARCHES = 1 << (31 - COST)  # then `seen` is wiped
# positions in LocalGuidance.count
NOW, SEARCH, LAST_BUCKET = 0, 1, 2


class LocalGuidance(NamedTuple):
    """Paths of R robots over a window, with slots for W steps, W a power of two: step t is in slot t modulo W. S spots, N moves.

    Counts are kept modulo 256: they are seldom above 2, and only guide.
    """

    window: int  # steps of a path, at most W - 2; 0 for no guidance
    path: np.ndarray  # [R, W] int32 vertices; NONE before there is a path
    num_at: np.ndarray  # [W, S] uint8 paths at a spot
    num_on: np.ndarray  # [W, N] uint8 paths along a move, by the step at its end
    seen: np.ndarray  # [W, V] int32 the search that came by last, and its least cost
    entry: np.ndarray  # [E, 4] int32 of a search: vertex, step, entry before it, next entry in its bucket
    bucket: np.ndarray  # [DEAREST + 1] int64 entries by cost
    count: np.ndarray  # [3] int64 the present step, searches so far, the last bucket that was used


@kernel
def guide_locally(world, local, onward, here, order, rng):
    """Write robots' next steps to `onward` [R].

    Parameters
    ----------
    world, local
        Of PIBT. `local` has the paths from where robots were before; those of robots that are on their paths go on.
    here
        [R] where robots are.
    order
        [R] robots, in the order in which they are given paths.
    rng
        Chooses among equally good paths.
    """
    mask = local.path.shape[1] - 1
    last, now = local.count[NOW] & mask, (local.count[NOW] + 1) & mask
    as_before = True
    for i in range(len(here)):
        as_before = as_before and local.path[i, last] == here[i]
    if as_before:
        return
    for i in range(len(here)):
        if local.path[i, last] == NONE:
            continue
        if local.path[i, now] == here[i]:
            local.num_at[last, spot_of(world, local.path[i, last])] -= 1
            _count_lane(world, local, i, local.count[NOW] + 1, -1)
            _lengthen(world, local, i, local.count[NOW] + local.window)
        else:
            _count(world, local, i, -1)
            local.path[i, now] = NONE
    local.count[NOW] += 1
    for i in order:
        if local.path[i, now] != NONE:
            if _is_best(world, local, i):
                continue
            _count(world, local, i, -1)
        _find(world, local, i, here[i], rng)
        _count(world, local, i, 1)
    for i in range(len(here)):
        onward[i] = local.path[i, (now + 1) & mask]


@kernel
def _is_best(world, local, i):
    """Whether a path loses no step and collides with nobody's."""
    mask, now = local.path.shape[1] - 1, local.count[NOW]
    for t in range(now + 1, now + local.window + 1):
        v, u = np.int64(local.path[i, (t - 1) & mask]), np.int64(local.path[i, t & mask])
        if local.num_at[t & mask, spot_of(world, u)] > 1:
            return False
        if v == u:
            if v != world.goal[i]:
                return False
            continue
        lane = _lane(world, v, u)
        if _loss(world, i, v, u, lane) > 0 or _num_on_lane(world, local, lane, u, t) > 0:
            return False
    return True


@kernel
def _find(world, local, i, start, rng):
    """Write the cheapest path: by cost, the deepest vertex first among equals."""
    mask, now = local.path.shape[1] - 1, local.count[NOW]
    first, head, entry, bucket, seen = world.first, world.head, local.entry, local.bucket, local.seen
    search = _next_search(local)
    bucket[: local.count[LAST_BUCKET] + 1] = NONE
    local.count[LAST_BUCKET] = 0
    entry[0, 0], entry[0, 1], entry[0, 2], entry[0, 3] = start, 0, NONE, NONE
    bucket[0] = 0
    seen[now & mask, start] = search << COST
    num, level, e = 1, 0, np.int64(0)
    while True:
        while bucket[level] < 0:
            level += 1
        e = bucket[level]
        bucket[level] = entry[e, 3]
        v, t = np.int64(entry[e, 0]), now + entry[e, 1]
        a, num_lanes = first[v], first[v + 1] - first[v]
        if entry[e, 1] == local.window or num + num_lanes >= len(entry):
            break
        if seen[t & mask, v] != (search << COST) + level:
            continue
        t += 1
        slot = t & mask
        turn = _turn(world, i, v, rng)
        for n in range(num_lanes + 1):
            k = (n + turn) % (num_lanes + 1)
            if k == num_lanes:
                u, cost = v, np.int64(level if v == world.goal[i] else level + STEP)
            else:
                u = head[a + k]
                cost = level + _loss(world, i, v, u, a + k) + COLLISION * _num_on_lane(world, local, a + k, u, t)
            cost = min(cost + COLLISION * np.int64(local.num_at[slot, spot_of(world, u)]), DEAREST)
            if seen[slot, u] >> COST == search and seen[slot, u] & DEAREST <= cost:
                continue
            seen[slot, u] = (search << COST) + cost
            entry[num, 0], entry[num, 1], entry[num, 2], entry[num, 3] = u, t - now, e, bucket[cost]
            bucket[cost] = num
            level = min(level, cost)
            local.count[LAST_BUCKET] = max(local.count[LAST_BUCKET], cost)
            num += 1
    for n in range(entry[e, 1] + 1, local.window + 1):  # no room to search on: it may stay
        local.path[i, (now + n) & mask] = entry[e, 0]
    while e >= 0:
        local.path[i, (now + entry[e, 1]) & mask] = entry[e, 0]
        e = np.int64(entry[e, 2])


@kernel
def _next_search(local):
    """The number of a new search."""
    local.count[SEARCH] += 1
    if local.count[SEARCH] == MOST_SEARCHES:
        local.seen[:] = 0
        local.count[SEARCH] = 1
    return local.count[SEARCH]


@kernel
def _turn(world, i, v, rng):
    """Which move to enter first; the last is looked at first: the one on the robot's own way, or any."""
    num_lanes = world.first[v + 1] - world.first[v]
    onward = next_on_way(world, i, v)
    if onward >= 0:
        return _lane(world, v, onward) - world.first[v] + 1
    return np.int64(rng.random() * (num_lanes + 1))


@kernel
def _loss(world, i, v, u, lane):
    """What a move costs, and what is left of the way after it, less what was left before it."""
    if world.guided:
        return world.toll[lane] + np.int64(world.guide[i, u]) - np.int64(world.guide[i, v])
    return STEP * (1 + nearer(world, i, u, v))


@kernel
def _num_on_lane(world, local, lane, u, t):
    """How many others' paths forbid to come along a lane to u at a step, but for those that are at u then."""
    mask = local.path.shape[1] - 1
    num = np.int64(local.num_at[(t - 1) & mask, spot_of(world, u)])
    if num == 0 or world.following:
        return num
    back = world.back[move_along(world, lane)]
    return np.int64(local.num_on[t & mask, back]) if back >= 0 else np.int64(0)


@kernel
def _lengthen(world, local, i, t):
    """Have a path that ends at step t lead one step nearer the goal, where nobody is if that is possible."""
    mask = local.path.shape[1] - 1
    v = np.int64(local.path[i, t & mask])
    u, slot = v, (t + 1) & mask
    onward = next_on_way(world, i, v)
    if onward >= 0:
        u = onward
    elif v != world.goal[i]:
        for lane in range(world.first[v], world.first[v + 1]):
            if _loss(world, i, v, world.head[lane], lane) <= 0:
                u = world.head[lane]
                if local.num_at[slot, spot_of(world, u)] == 0:
                    break
    local.path[i, slot] = u
    local.num_at[slot, spot_of(world, u)] += 1
    _count_lane(world, local, i, t + 1, 1)


@kernel
def _count(world, local, i, change):
    """Count a path, or no longer."""
    mask, now = local.path.shape[1] - 1, local.count[NOW]
    local.num_at[now & mask, spot_of(world, local.path[i, now & mask])] += np.int64(change)
    for t in range(now + 1, now + local.window + 1):
        local.num_at[t & mask, spot_of(world, local.path[i, t & mask])] += np.int64(change)
        _count_lane(world, local, i, t, change)


@kernel
def _count_lane(world, local, i, t, change):
    """Count the lane on which a path comes to where it is at step t."""
    mask = local.path.shape[1] - 1
    v, u = np.int64(local.path[i, (t - 1) & mask]), np.int64(local.path[i, t & mask])
    if v != u:
        local.num_on[t & mask, move_along(world, _lane(world, v, u))] += np.int64(change)


@kernel
def _lane(world, v, u):
    """The lane from v to u, which are neighbours."""
    lane = world.first[v]
    while world.head[lane] != u:
        lane += 1
    return lane
