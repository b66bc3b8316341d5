"""Kernels that sort the vertices where a robot of PIBT may go next.

Nearest to the goal first. Ties are broken by the way that a robot has of its own, then by hindrance, how many neighbours a robot would
hinder there (Okumura, "Engineering LaCAM*", AAMAS 2024), then by chance. A robot that makes way for a swap takes them in the opposite
order. Where somebody waits until nobody is near, robots go last.
"""

from mrp_sumo.search._kernel import kernel
from planners._compass import SLACK_STEPS, UNKNOWN, extend, read_code
from planners.configuration._pibt_instance import nearer, next_on_way, prefers
from planners.configuration._pibt_swap import swap_partner

IN_THE_WAY = 1e12  # beyond any other key
GUIDED = 1e6  # more than any step
ON_WAY = 32.0  # more than any hindrance, less than a step


@kernel(allocates=False)
def sort_candidates(world, scratch, here, to, i, hindrance, rng):
    """List the candidates of robot i, the preferred first, and find its partner for a swap."""
    v = here[i]
    a, b = world.first[v], world.first[v + 1]
    if world.packed:
        unknown = read_code(world.code, i, v) == UNKNOWN
        for k in range(a, b):
            unknown = unknown or read_code(world.code, i, world.head[k]) == UNKNOWN
        if unknown:
            extend(world.first_packed, world.head_packed, world.goal[i], i, v, world.code, world.queue, world.bound, SLACK_STEPS)
    num = b - a + 1
    onward = next_on_way(world, i, v)
    for k in range(num):
        u = world.head[a + k] if k < num - 1 else v
        key = rng.random() + (world.guide[i, u] if world.guided else 64.0 * nearer(world, i, u, v))
        if hindrance and num > 2:
            key += _num_hindered(world, scratch, i, u)
        if u == onward:
            key -= ON_WAY
        if u == scratch.onward[i]:
            key -= GUIDED
        if world.near and scratch.wished[u] >= 0 and scratch.wished[u] != i:
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
        partner = swap_partner(world, scratch, here, to, i)
        scratch.partner[i] = partner
        if partner >= 0:
            for k in range(num // 2):
                u = scratch.candidate[i, k]
                scratch.candidate[i, k] = scratch.candidate[i, num - 1 - k]
                scratch.candidate[i, num - 1 - k] = u


@kernel(allocates=False)
def _num_hindered(world, scratch, i, u):
    """How many other robots prefer u to where they are."""
    num = 0
    for k in range(world.first[u], world.first[u + 1]):
        w = world.head[k]
        j = scratch.now[w]
        if j >= 0 and j != i and prefers(world, j, u, w):
            num += 1
    return num
