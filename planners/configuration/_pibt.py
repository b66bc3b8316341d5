"""Kernels of priority inheritance with backtracking: one step of all robots at once.

Source: Okumura, Machida, Défago, Tamura, "Priority inheritance with backtracking for iterative multi-agent
path finding", AIJ 2022 (algorithm 1), and the swap operation of Okumura, "Improving LaCAM for scalable
eventually optimal multi-agent pathfinding", IJCAI 2023 (section 4). Recursion is an explicit stack.

Where rings may not move at once, a move that would close one is refused when it is proposed. Where following is
refused, a robot that wants an occupied vertex pushes who is on it, as ever, but waits until it has gone.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners._compass import UNKNOWN, extend, read_code


class PibtInstance(NamedTuple):
    """What does not change while planning. V vertices, L lanes, R robots; arrays are only read (but `code`, which grows)."""

    first: np.ndarray  # [V + 1] int64, lanes that leave a vertex
    head: np.ndarray  # [L] int64
    goal: np.ndarray  # [R] int64
    table: np.ndarray  # [R, V] steps to the robot's goal, or [1, 1] when packed
    packed: bool  # distances are looked up in `code` instead: only which way is nearer is known
    code: np.ndarray  # [R, ceil(V / 4)] uint8, see _compass
    first_packed: np.ndarray  # `first` and `head` in int32, a queue and coordinates: see _compass; [1] and [1, 2] unless packed
    head_packed: np.ndarray
    queue: np.ndarray
    bound: np.ndarray
    two_way: bool  # every lane has its opposite: robots can swap in corridors
    guided: bool  # robots go by `guide`, not by steps
    guide: np.ndarray  # [R, V] int32 what is left to the goal, see _flow; [1, 1] where there is no guide
    following: bool  # nobody may enter a vertex in the step in which another leaves it
    rotations: bool  # rings of robots may move at once


class PibtScratch(NamedTuple):
    """Room for a step. `now` and `next` are -1 everywhere between calls."""

    now: np.ndarray  # [V] robot on each vertex
    next: np.ndarray  # [V] robot that has reserved it
    stack: np.ndarray  # [R] robots that inherited priority
    choice: np.ndarray  # [R] position in the robot's candidates
    candidate: np.ndarray  # [R, D + 1] vertices from the most preferred down; D the largest out-degree
    num: np.ndarray  # [R] of them
    partner: np.ndarray  # [R] robot to swap with, -1 for none
    key: np.ndarray  # [D + 1] what candidates are sorted by


@kernel
def nearer(world, robot, u, v):
    """Steps to the goal of `robot` from u less those from v. u and v are neighbours or the same."""
    if not world.packed:
        return np.int64(world.table[robot, u]) - np.int64(world.table[robot, v])
    a, b = read_code(world.code, robot, u), read_code(world.code, robot, v)
    if a == UNKNOWN or b == UNKNOWN:
        return np.int64(0)
    d = (a - b + 3) % 3
    return np.int64(d if d < 2 else -1)


@kernel
def _drawn(world, robot, u, v):
    """Whether a robot would rather be on u than on v. They are neighbours or the same."""
    if world.guided:
        return world.guide[robot, u] < world.guide[robot, v]
    return nearer(world, robot, u, v) < 0


@kernel
def _refused(world, scratch, here, to, i, u):
    """Whether i may not go to u, given who has chosen already: taken, a swap, following or a ring."""
    if scratch.next[u] >= 0 and scratch.next[u] != i:
        return True
    j = scratch.now[u]
    if j < 0 or j == i:
        return False
    if world.following:
        return to[j] >= 0  # who has chosen has been pushed already
    if to[j] == here[i]:
        return True
    if world.rotations:
        return False
    for _ in range(len(here)):
        if j < 0 or to[j] < 0 or to[j] == here[j]:
            return False
        if to[j] == here[i]:
            return True
        j = scratch.now[to[j]]
    return False


@kernel
def step(world, scratch, here, to, order, hindrance, rng):
    """Choose every robot's next vertex.

    Parameters
    ----------
    world, scratch
        See `PibtInstance` and `PibtScratch`.
    here
        [R] where robots are.
    to
        [R] out: where they go next. In: -1, or a vertex that is imposed on the robot.
    order
        [R] robots from the highest priority down.
    hindrance
        Whether ties are broken in favour of vertices that fewer neighbours want.
    rng
        Breaks the other ties.

    Returns
    -------
    bool
        False when the imposed vertices leave some robot without a move; `to` is then of no use.
    """
    num_robots = len(here)
    for i in range(num_robots):
        scratch.now[here[i]] = i
    fine = True
    for i in range(num_robots):
        u = to[i]
        if u < 0:
            continue
        if _refused(world, scratch, here, to, i, u) or (world.following and scratch.now[u] >= 0 and u != here[i]):
            fine = False
            break
        scratch.next[u] = i
    if fine:
        for k in range(num_robots):
            i = order[k]
            if to[i] >= 0:
                continue
            if here[i] == world.goal[i] and scratch.next[here[i]] < 0:  # at home and not pushed: what it likes best
                to[i] = here[i]
                scratch.next[here[i]] = i
            elif not _inherit(world, scratch, here, to, i, hindrance, rng):
                fine = False
                break
    for i in range(num_robots):
        scratch.now[here[i]] = -1
        scratch.next[here[i]] = -1
        if to[i] >= 0:
            scratch.next[to[i]] = -1
    return fine


@kernel
def _inherit(world, scratch, here, to, root, hindrance, rng):
    """Give `root`, and whoever it pushes, a next vertex. False when it cannot even stay."""
    depth = 0
    scratch.stack[0] = root
    _prefer(world, scratch, here, to, root, hindrance, rng)
    returned, moved = False, False
    while depth >= 0:
        i = scratch.stack[depth]
        done = False
        if returned:
            returned = False
            if moved:
                done = True
            else:
                scratch.choice[i] += 1
        pushed = False
        while not done and scratch.choice[i] < scratch.num[i]:
            u = scratch.candidate[i, scratch.choice[i]]
            if _refused(world, scratch, here, to, i, u):
                scratch.choice[i] += 1
                continue
            j = scratch.now[u]
            scratch.next[u] = i
            to[i] = u
            if world.following and j >= 0 and j != i:  # waits; who is pushed may not stay, since u is taken
                scratch.next[here[i]] = i
                to[i] = here[i]
            if j >= 0 and j != i and to[j] < 0:
                depth += 1
                scratch.stack[depth] = j
                _prefer(world, scratch, here, to, j, hindrance, rng)
                pushed = True
                break
            done = True
        if pushed:
            continue
        if done:
            p = scratch.partner[i]
            follows = scratch.choice[i] == 0 and p >= 0 and to[p] < 0 and not world.following
            if follows and not _refused(world, scratch, here, to, p, here[i]):
                scratch.next[here[i]] = p  # the partner follows at once, so that the pair can turn round ahead
                to[p] = here[i]
            moved = True
        else:
            scratch.next[here[i]] = i
            to[i] = here[i]
            moved = False
        returned = True
        depth -= 1
    return moved


@kernel
def _prefer(world, scratch, here, to, i, hindrance, rng):
    """List the robot's candidates from the nearest to its goal down, or up when it has to make way for a swap."""
    v = here[i]
    a, b = world.first[v], world.first[v + 1]
    if world.packed:
        unknown = read_code(world.code, i, v) == UNKNOWN
        for k in range(a, b):
            unknown = unknown or read_code(world.code, i, world.head[k]) == UNKNOWN
        if unknown:
            extend(world.first_packed, world.head_packed, world.goal[i], i, v, world.code, world.queue, world.bound)
    num = b - a + 1
    for k in range(num):
        u = world.head[a + k] if k < num - 1 else v
        key = rng.random() + (world.guide[i, u] if world.guided else 64.0 * nearer(world, i, u, v))
        if hindrance and num > 2:
            key += _num_wanting(world, scratch, i, u)
        p = k
        while p > 0 and scratch.key[p - 1] > key:
            scratch.key[p] = scratch.key[p - 1]
            scratch.candidate[i, p] = scratch.candidate[i, p - 1]
            p -= 1
        scratch.key[p] = key
        scratch.candidate[i, p] = u
    scratch.num[i] = num
    scratch.choice[i] = 0
    scratch.partner[i] = -1
    if world.two_way and num > 1:
        partner = _swap_partner(world, scratch, here, to, i)
        scratch.partner[i] = partner
        if partner >= 0:
            for k in range(num // 2):
                u = scratch.candidate[i, k]
                scratch.candidate[i, k] = scratch.candidate[i, num - 1 - k]
                scratch.candidate[i, num - 1 - k] = u


@kernel
def _num_wanting(world, scratch, i, u):
    """How many other robots are drawn to u."""
    num = 0
    for k in range(world.first[u], world.first[u + 1]):
        w = world.head[k]
        j = scratch.now[w]
        if j >= 0 and j != i and _drawn(world, j, u, w):
            num += 1
    return num


@kernel
def _swap_partner(world, scratch, here, to, i):
    """The robot with which i has to change places, and can, in a corridor; -1 if there is none."""
    v, best = here[i], scratch.candidate[i, 0]
    if best == v:
        return -1
    j = scratch.now[best]
    if j >= 0 and to[j] < 0 and _must_swap(world, scratch, i, j, v, best) and _can_swap(world, scratch, best, v):
        return j
    for k in range(world.first[v], world.first[v + 1]):
        u = world.head[k]
        j = scratch.now[u]
        if j < 0 or u == best:
            continue
        if _must_swap(world, scratch, j, i, v, best) and _can_swap(world, scratch, best, v):
            return j
    return -1


@kernel
def _must_swap(world, scratch, pusher, puller, at, ahead):
    """Walk the corridor that the pusher wants to push the puller through: do both want the other's side?"""
    steps = 0
    while _drawn(world, pusher, ahead, at):
        num, onward = _ways_on(world, scratch, at, ahead)
        if num >= 2:
            return False
        if num <= 0:
            break
        at, ahead = ahead, onward
        steps += 1
        if steps > len(scratch.now):
            return False
    pusher_there = at == world.goal[pusher]
    return _drawn(world, puller, at, ahead) and (pusher_there or _drawn(world, pusher, ahead, at))


@kernel
def _can_swap(world, scratch, begin, at):
    """Walk the other way: is there a fork at which one of the two can step aside?"""
    before, here = begin, at
    steps = 0
    while here != begin and steps <= len(scratch.now):
        num, onward = _ways_on(world, scratch, before, here)
        if num >= 2:
            return True
        if num <= 0:
            return False
        before, here = here, onward
        steps += 1
    return False


@kernel
def _ways_on(world, scratch, before, at):
    """How many ways lead on from `at` but back to `before` and into a dead end whose robot is at home, and the last of them."""
    num, onward = 0, np.int64(-1)
    for k in range(world.first[at], world.first[at + 1]):
        u = world.head[k]
        if u == before:
            continue
        j = scratch.now[u]
        if j >= 0 and world.first[u + 1] - world.first[u] == 1 and world.goal[j] == u:
            continue
        num += 1
        onward = u
    return num, onward


@kernel
def run(world, scratch, path, begin, end, order, base_order, hindrance, rng):
    """PIBT over time: fill rows begin + 1 to end of `path` [T, R], or up to where all are at their goals.

    `order` [R] is the priorities at `begin` and is kept up to date: robots not yet at their goals in the order
    they have it in, those at their goals after them in `base_order`. Returns (last row filled, all at their goals).
    """
    for t in range(begin, end + 1):
        home = True
        for i in range(path.shape[1]):
            home = home and path[t, i] == world.goal[i]
        if home or t == end:
            return t, home
        path[t + 1, :] = -1
        step(world, scratch, path[t], path[t + 1], order, hindrance, rng)
        reorder(world, path[t + 1], order, base_order, order)
    return end, False


@kernel
def reorder(world, here, order, base_order, out):
    """Priorities after a step: elapsed time since a robot was last at its goal. `out` may be `order`."""
    k = 0
    for i in order:
        if here[i] != world.goal[i]:
            out[k] = i
            k += 1
    for i in base_order:
        if here[i] == world.goal[i]:
            out[k] = i
            k += 1
