"""Kernels of priority inheritance with backtracking (PIBT): one step of all robots at once.

Source: Okumura, Machida, Défago, Tamura, "Priority inheritance with backtracking for iterative multi-agent
path finding", AIJ 2022, algorithm 1; the paper's names are in brackets; two robots that meet in a corridor change
places at the next fork after Okumura, "Improving LaCAM for scalable eventually optimal multi-agent pathfinding", IJCAI 2023.
`tests/plain_pibt.py` is the same algorithm in plain Python. Here the recursion is a stack, since a compiled recursive function cannot be
stored.

Where rings may not move at once, a move that would close one is refused when it is proposed. Where following is
refused, a robot still pushes whoever stands on the vertex that it wants, but waits until that robot has gone. It does so too
where somebody stands too close to its move (a clash): it waits, those who push it wait, and meanwhile nobody else comes near.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._clashing import move_of
from mrp_sumo.search._kernel import kernel
from planners.configuration._local_guidance import LocalGuidance, guide_locally
from planners.configuration._pibt_instance import (
    SLACK_STEPS,
    UNKNOWN,
    PibtInstance,
    extend,
    nearer,
    next_on_way,
    prefers,
    read_code,
    spot_of,
    wants,
)

NOBODY, CHOSEN = -1, -2  # who is too close
IN_THE_WAY = 1e12  # in the order of candidates, beyond any other key
GUIDED = 1e6  # more than any step
ON_WAY = 32.0  # more than any hindrance, less than a step


class PibtScratch(NamedTuple):
    """Room for a step, with S spots. `now`, `next` and `wished` are -1 everywhere between calls."""

    now: np.ndarray  # [S] robot at each spot
    next: np.ndarray  # [S] robot that has reserved it
    wished: np.ndarray  # [S] robot that waits until nobody is there; [1] where there are no clashes
    onward: np.ndarray  # [R] where local guidance leads each robot, -1: nowhere, see _local_guidance
    wish: np.ndarray  # [R] the move for which each robot waits, -1: none
    stack: np.ndarray  # [R] robots that inherited priority
    choice: np.ndarray  # [R] position in the robot's candidates
    candidate: np.ndarray  # [R, D + 1] vertices from the most preferred down; D the largest out-degree
    num: np.ndarray  # [R] of them
    partner: np.ndarray  # [R] robot to swap with, -1 for none
    key: np.ndarray  # [D + 1] what candidates are sorted by


class PibtRoom(NamedTuple):
    """Room for PIBT over time. Kernels of a step, which pass on all that they are given, have no need of the guidance before it."""

    step: PibtScratch
    local: LocalGuidance


@kernel
def step(world, scratch, here, to, order, rng):
    """Choose every robot's next vertex.

    Parameters
    ----------
    world, scratch
        See `PibtInstance` and `PibtScratch`.
    here
        [R] where robots are (Q_from).
    to
        [R] out: where they go next (Q_to). In: -1, or a vertex that is imposed on the robot.
    order
        [R] robots, the highest priority first.
    rng
        Breaks the ties that hindrance leaves.

    Returns
    -------
    bool
        False when the imposed vertices leave some robot without a move; `to` is then of no use.
    """
    now, reserved = scratch.now, scratch.next
    for i in range(len(here)):
        now[spot_of(world, here[i])] = i
    valid = _impose(world, scratch, here, to)
    for i in order:
        if not valid:
            break
        if to[i] >= 0:
            continue
        led_away = scratch.onward[i] >= 0 and scratch.onward[i] != here[i]
        at = spot_of(world, here[i])
        if here[i] == world.goal[i] and reserved[at] < 0 and not led_away:  # at its goal and not pushed: it stays
            to[i] = here[i]
            reserved[at] = i
        else:
            valid = _pibt(world, scratch, here, to, i, rng)
    for i in range(len(here)):
        at = spot_of(world, here[i])
        now[at] = -1
        reserved[at] = -1
        if to[i] >= 0:
            reserved[spot_of(world, to[i])] = -1
        if world.near and scratch.wish[i] >= 0:
            _wish(world, scratch, scratch.wish[i], -1)
            scratch.wish[i] = -1
    return valid


@kernel
def _pibt(world, scratch, here, to, root, rng):
    """Find a next vertex for `root`, and for whoever it pushes (the function PIBT). False when `root` cannot even stay."""
    now, reserved, stack, choice = scratch.now, scratch.next, scratch.stack, scratch.choice
    depth = 0
    stack[0] = root
    _sort_candidates(world, scratch, here, to, root, rng)
    while depth >= 0:
        i = stack[depth]  # (a_i)
        while choice[i] < scratch.num[i] and _refused(world, scratch, here, to, i, scratch.candidate[i, choice[i]]):
            choice[i] += 1
        if choice[i] == scratch.num[i]:  # i stays (invalid); backtracking: who pushed it tries its next candidate
            reserved[spot_of(world, here[i])] = i
            to[i] = here[i]
            depth -= 1
            if depth >= 0:
                choice[stack[depth]] += 1
            continue
        v = scratch.candidate[i, choice[i]]
        if world.near:
            k = _too_close(world, scratch, here, to, i, v)
            if k >= 0:
                if not _wait_all(world, scratch, here, to, depth):
                    choice[i] += 1
                    continue
                if scratch.wish[i] >= 0:
                    _wish(world, scratch, scratch.wish[i], -1)
                scratch.wish[i] = move_of(world.spot_first, world.spot_head, spot_of(world, here[i]), spot_of(world, v))
                _wish(world, scratch, scratch.wish[i], i)
                reserved[spot_of(world, here[k])] = i  # k may not stay
                depth += 1
                stack[depth] = k
                _sort_candidates(world, scratch, here, to, k, rng)
                continue
        there = spot_of(world, v)
        reserved[there] = i
        to[i] = v
        k = now[there]  # (a_k) who stands there
        if world.following and k >= 0 and k != i:  # i waits; k may not stay, since v is reserved
            reserved[spot_of(world, here[i])] = i
            to[i] = here[i]
        if k >= 0 and k != i and to[k] < 0:  # priority inheritance
            depth += 1
            stack[depth] = k
            _sort_candidates(world, scratch, here, to, k, rng)
            continue
        for d in range(depth, -1, -1):  # (valid) all on the stack move
            _pull_partner(world, scratch, here, to, stack[d])
        return True
    return False


@kernel
def _pull_partner(world, scratch, here, to, i):
    """Have the robot that i swaps with follow at once, so that the two can turn round at the fork ahead."""
    p = scratch.partner[i]
    if p < 0 or to[p] >= 0 or scratch.choice[i] > 0 or world.following:
        return
    if world.near and _too_close(world, scratch, here, to, p, here[i]) != NOBODY:
        return
    if not _refused(world, scratch, here, to, p, here[i]):
        scratch.next[spot_of(world, here[i])] = p
        to[p] = here[i]


@kernel
def _impose(world, scratch, here, to):
    """Reserve the vertices that are imposed on robots. False when they collide."""
    for i in range(len(here)):
        u = to[i]
        if u < 0:
            continue
        there = spot_of(world, u)
        if _refused(world, scratch, here, to, i, u) or (world.following and scratch.now[there] >= 0 and u != here[i]):
            return False
        if world.near and _too_close(world, scratch, here, to, i, u) >= 0:
            return False
        scratch.next[there] = i
    return True


@kernel
def _refused(world, scratch, here, to, i, u):
    """Whether i may not go to u, given who has chosen already: taken, a swap, following, a ring or a clash."""
    if _taken(world, scratch, here, to, i, u):
        return True
    return world.near and u != here[i] and _too_close(world, scratch, here, to, i, u) == CHOSEN


@kernel
def _taken(world, scratch, here, to, i, u):
    """`_refused` by the rules of MAPF."""
    there = spot_of(world, u)
    if scratch.next[there] >= 0 and scratch.next[there] != i:
        return True
    j = scratch.now[there]
    if j < 0 or j == i or to[j] < 0:
        return False
    if world.following:
        return True  # who has chosen has been pushed already
    at = spot_of(world, here[i])
    if spot_of(world, to[j]) == at:
        return True
    if world.rotations:
        return False
    for _ in range(len(here)):
        if j < 0 or to[j] < 0 or to[j] == here[j]:
            return False
        onward = spot_of(world, to[j])
        if onward == at:
            return True
        j = scratch.now[onward]
    return False


@kernel
def _too_close(world, scratch, here, to, i, u):
    """Who keeps i from going to u by being too close: NOBODY, robots that have CHOSEN, or else one that can be pushed away.

    Robots stay where they are without asking: whoever chose before kept away from them.
    """
    if u == here[i]:
        return NOBODY
    clashes, now, reserved = world.clashes, scratch.now, scratch.next
    at, there = spot_of(world, here[i]), spot_of(world, u)
    if scratch.wished[there] >= 0 and scratch.wished[there] != i and scratch.wished[at] < 0:
        return CHOSEN  # somebody with a higher priority waits until nobody is there
    move = move_of(world.spot_first, world.spot_head, at, there)
    standing = NOBODY
    for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
        w = clashes.vertex[k]
        j = now[w]
        if j >= 0 and j != i:
            if to[j] >= 0:
                return CHOSEN
            standing = j
        j = reserved[w]
        if j >= 0 and j != i and (w != at or spot_of(world, to[j]) == w):  # who pushes i does not come yet
            return CHOSEN
    for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
        other = clashes.lane[k]
        j = now[world.spot_tail[other]]
        if j >= 0 and j != i and to[j] >= 0 and spot_of(world, to[j]) == world.spot_head[other]:
            return CHOSEN
    return standing


@kernel
def _wish(world, scratch, move, robot):
    """Let nobody come near a move for which a robot waits; -1 lifts that."""
    clashes = world.clashes
    scratch.wished[world.spot_head[move]] = robot
    for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
        scratch.wished[clashes.vertex[k]] = robot


@kernel
def _wait_all(world, scratch, here, to, depth):
    """Let all on the stack stay for this step; False where somebody else is to come where the first of them stands."""
    first = scratch.stack[0]
    at = spot_of(world, here[first])
    if scratch.next[at] >= 0 and scratch.next[at] != first:
        return False
    for d in range(depth + 1):
        robot = scratch.stack[d]
        scratch.next[spot_of(world, here[robot])] = robot
        to[robot] = here[robot]
    return True


@kernel
def _sort_candidates(world, scratch, here, to, i, rng):
    """List the candidates of robot i, the preferred first, and find its partner for a swap.

    Nearest to the goal first. Ties are broken by the way that a robot has of its own, then by hindrance, how many neighbours a robot would
    hinder there (Okumura, "Engineering LaCAM*", AAMAS 2024), then by chance. A robot that makes way for a swap takes them in the opposite
    order. Where somebody waits until nobody is near, robots go last.
    """
    v = here[i]
    a, b = world.first[v], world.first[v + 1]
    if world.packed:
        unknown = read_code(world.compass.code, i, v) == UNKNOWN
        for k in range(a, b):
            unknown = unknown or read_code(world.compass.code, i, world.head[k]) == UNKNOWN
        if unknown:
            extend(world.compass, world.goal[i], i, v, SLACK_STEPS)
    num = b - a + 1
    onward = next_on_way(world, i, v)
    for k in range(num):
        u = world.head[a + k] if k < num - 1 else v
        key = rng.random() + (world.guide[i, u] if world.guided else 64.0 * nearer(world, i, u, v))
        if world.hindrance and num > 2:
            key += _num_hindered(world, scratch, here, i, u)
        if u == onward:
            key -= ON_WAY
        if u == scratch.onward[i]:
            key -= GUIDED
        if world.near:
            there = spot_of(world, u)
            if scratch.wished[there] >= 0 and scratch.wished[there] != i:
                key += IN_THE_WAY
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
def _num_hindered(world, scratch, here, i, u):
    """How many other robots prefer to be at u's spot to where they are."""
    num, spot = 0, spot_of(world, u)
    for k in range(world.spot_first[spot], world.spot_first[spot + 1]):
        j = scratch.now[world.spot_head[k]]
        if j >= 0 and j != i and wants(world, j, here[j], spot):
            num += 1
    return num


@kernel
def _swap_partner(world, scratch, here, to, i):
    """The robot that i has to change places with in a corridor, and can; -1 for none (Okumura, IJCAI 2023, section 4)."""
    v, best = here[i], scratch.candidate[i, 0]
    if best == v:
        return -1
    j = scratch.now[best]
    if j >= 0 and to[j] < 0 and _swap_required(world, scratch, i, j, v, best) and _swap_possible(world, scratch, best, v):
        return j
    for k in range(world.first[v], world.first[v + 1]):
        u = world.head[k]
        j = scratch.now[u]
        if j < 0 or u == best:
            continue
        if _swap_required(world, scratch, j, i, v, best) and _swap_possible(world, scratch, best, v):
            return j
    return -1


@kernel
def _swap_required(world, scratch, pusher, puller, at, ahead):
    """Follow the corridor through which the pusher would push the puller: does each want to get to the other's side?

    Not where both have the same goal, as in windows of lifelong work: each would make way for the other again and again.
    """
    if world.goal[pusher] == world.goal[puller]:
        return False
    steps = 0
    while prefers(world, pusher, ahead, at):
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
    return prefers(world, puller, at, ahead) and (pusher_there or prefers(world, pusher, ahead, at))


@kernel
def _swap_possible(world, scratch, begin, at):
    """Follow the corridor the other way: is there a fork where one of the two can step aside?"""
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
    """How many ways lead on from `at`, and the last of them; not back to `before`, nor into a dead end whose robot is at its goal."""
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
def run(world, room, path, begin, end, order, rng):
    """PIBT over time: fill rows begin + 1 to end of `path` [T, R], or up to where all are at their goals.

    `order` [R] is the priorities at `begin` and is kept up to date: robots not yet at their goals in the order
    they have it in, those at their goals after them. Returns (last row filled, all at their goals).
    """
    for t in range(begin, end + 1):
        home = True
        for i in range(path.shape[1]):
            home = home and path[t, i] == world.goal[i]
        if home or t == end:
            return t, home
        if room.local.window > 0:
            guide_locally(world, room.local, room.step.onward, path[t], order, rng)
        path[t + 1, :] = -1
        step(world, room.step, path[t], path[t + 1], order, rng)
        reorder(world, path[t + 1], order, order)
    return end, False


@kernel
def reorder(world, here, order, out):
    """Priorities after a step: elapsed time since a robot was last at its goal. `out` may be `order`."""
    k = 0
    for i in order:
        if here[i] != world.goal[i]:
            out[k] = i
            k += 1
    for i in world.base_order:
        if here[i] == world.goal[i]:
            out[k] = i
            k += 1


def room_for_step(world: PibtInstance) -> PibtScratch:
    """Room for PIBT's steps."""
    num_spots, num_robots = len(world.spot_first) - 1, len(world.goal)
    width = int(np.diff(world.first).max(initial=0)) + 1
    return PibtScratch(
        now=np.full(num_spots, -1, np.int64),
        next=np.full(num_spots, -1, np.int64),
        wished=np.full(num_spots if world.near else 1, -1, np.int64),
        onward=np.full(num_robots, -1, np.int64),
        wish=np.full(num_robots, -1, np.int64),
        stack=np.zeros(num_robots + 1, np.int64),
        choice=np.zeros(num_robots, np.int64),
        candidate=np.zeros((num_robots, width), np.int64),
        num=np.zeros(num_robots, np.int64),
        partner=np.zeros(num_robots, np.int64),
        key=np.zeros(width, np.float64),
    )
