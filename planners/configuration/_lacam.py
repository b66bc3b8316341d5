"""Kernels of LaCAM*: a depth-first search over configurations, with successors generated lazily.

Sources: Okumura, "LaCAM: search-based algorithm for quick multi-agent pathfinding", AAAI 2023 (algorithm 1);
"Improving LaCAM for scalable eventually optimal multi-agent pathfinding", IJCAI 2023 (algorithm 1, rewiring);
"Engineering LaCAM*: towards real-time, large-scale, and near-optimal multi-agent pathfinding", AAMAS 2024
(non-deterministic extraction, Monte-Carlo configuration generator).

A configuration says where all robots are. Its successors are described by a tree of constraints ("robot a goes to
x, robot b to y, ..."), expanded breadth-first one node a visit; PIBT fills in the robots without a constraint.
The cost of a transition is the number of robots that are not at their goals before and after it, so that the cost
of a path is the sum of loss.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.configuration._local_guidance import guide_locally
from planners.configuration._pibt import reorder, step
from planners.configuration._pibt_instance import nearer

NONE = -1
# positions in LacamMemory.count
NODES, BRANCHES, EDGES, OPEN, GOAL, EXPANSIONS = 0, 1, 2, 3, 4, 5
# what `search` returns
RUNNING, REACHED, EXHAUSTED, FULL = 0, 1, 2, 3


class LacamMemory(NamedTuple):
    """The search's memory. N nodes, B branches of constraint trees, E edges; all are room, of which `count` says how much is used."""

    config: np.ndarray  # [N, R] int32 where every robot is
    order: np.ndarray  # [N, R] int32 priorities
    g: np.ndarray  # [N] int64 cost from the start
    h: np.ndarray  # [N] int64 sum of steps to the goals
    parent: np.ndarray  # [N] int64
    digest: np.ndarray  # [N] int64 hash of the configuration
    first_branch: np.ndarray  # [N] int64 queue of branches: where it begins
    last_branch: np.ndarray  # [N] int64 and ends
    first_edge: np.ndarray  # [N] int64 known transitions
    branch_parent: np.ndarray  # [B] int64
    branch_vertex: np.ndarray  # [B] int32
    branch_depth: np.ndarray  # [B] int32 number of constraints
    branch_next: np.ndarray  # [B] int64
    edge_to: np.ndarray  # [E] int64
    edge_cost: np.ndarray  # [E] int32
    edge_next: np.ndarray  # [E] int64
    slot: np.ndarray  # [S] int64 hash table of nodes, S a power of two of 2 N or more
    open: np.ndarray  # [O] int64 stack of nodes
    relax: np.ndarray  # [N] int64 stack of nodes to relax
    relaxing: np.ndarray  # [N] bool
    to: np.ndarray  # [R] int32 scratch: a configuration that is being generated
    best: np.ndarray  # [R] int32 scratch: the best of those that were
    count: np.ndarray  # [6] int64


@kernel(allocates=True)
def begin(world, search, start, h):
    """Put the start in the empty search."""
    n = search.count
    n[:] = 0
    n[GOAL] = NONE
    search.slot[:] = NONE
    node = _create(search, start, _digest(start), h)
    search.order[node] = world.base_order
    search.g[node] = 0
    search.open[0] = node
    n[OPEN] = 1


@kernel(allocates=True)
def search_on(world, room, search, num_tries, iterations, rng):
    """Go on for a number of iterations.

    Parameters
    ----------
    world, room
        Of PIBT.
    search
        After `begin`.
    num_tries
        Configurations generated for a visit, of which the best is kept.
    iterations
        Visits at most.
    rng
        Chance.

    Returns
    -------
    int
        RUNNING: iterations are used up. REACHED: the goal was just reached for the first time, or at less cost.
        EXHAUSTED: there is no more, so that the best solution is optimal, or there is none. FULL: room is needed.
    """
    n, best = search.count, search.best
    goal_g = search.g[n[GOAL]] if n[GOAL] >= 0 else np.int64(-1)
    for _ in range(iterations):
        if n[OPEN] == 0:
            return EXHAUSTED
        if _full(room.step, search):
            return FULL
        n[EXPANSIONS] += 1
        goal = n[GOAL]
        if goal >= 0 and rng.random() < 0.001:  # non-deterministic extraction
            k = np.int64(rng.random() * n[OPEN])
            last = n[OPEN] - 1
            search.open[k], search.open[last] = search.open[last], search.open[k]
        node = search.open[n[OPEN] - 1]
        if goal >= 0 and search.g[node] + search.h[node] >= search.g[goal]:
            n[OPEN] -= 1
            continue
        here = search.config[node]
        branch = search.first_branch[node]
        if branch < 0:
            n[OPEN] -= 1
            continue
        search.first_branch[node] = search.branch_next[branch]
        _grow_tree(world, search, node, branch, rng)
        if room.local.window > 0:
            guide_locally(world, room.local, room.step.onward, here, search.order[node], rng)
        if not _generate(world, room.step, search, node, branch, num_tries, rng):
            continue
        cost, h_change = _transition(world, here, best)
        digest = _digest(best)
        other = _find(search, best, digest)
        if other >= 0:
            if other != node:
                _connect(search, node, other, cost)
                _relax_from(search, node)
            if n[GOAL] < 0 or search.g[other] + search.h[other] < search.g[n[GOAL]]:
                search.open[n[OPEN]] = other
                n[OPEN] += 1
        else:
            other = _create(search, best, digest, search.h[node] + h_change)
            search.order[other] = search.order[node]
            reorder(world, search.config[other], search.order[other], search.order[other])
            search.g[other] = search.g[node] + cost
            search.parent[other] = node
            _connect(search, node, other, cost)
            if n[GOAL] < 0 or search.g[other] + search.h[other] < search.g[n[GOAL]]:
                search.open[n[OPEN]] = other
                n[OPEN] += 1
            if search.h[other] == 0 and n[GOAL] < 0:
                n[GOAL] = other
        if n[GOAL] >= 0 and (goal_g < 0 or search.g[n[GOAL]] < goal_g):
            goal_g = search.g[n[GOAL]]
            return REACHED
    return RUNNING


@kernel(allocates=True)
def insert_path(world, scratch, search, path):
    """Make a solution found elsewhere, [T, R] rows from start to goal, part of the search. False when room is needed."""
    n = search.count
    node = np.int64(0)
    for t in range(1, len(path)):
        if _full(scratch, search):
            return False
        cost, h_change = _transition(world, search.config[node], path[t])
        digest = _digest(path[t])
        other = _find(search, path[t], digest)
        if other == node:
            continue
        if other < 0:
            other = _create(search, path[t], digest, search.h[node] + h_change)
            search.order[other] = search.order[node]
            reorder(world, search.config[other], search.order[other], search.order[other])
            search.g[other] = search.g[node] + cost
            search.parent[other] = node
            if search.h[other] == 0 and n[GOAL] < 0:
                n[GOAL] = other
            if search.h[other] > 0:
                search.open[n[OPEN]] = other
                n[OPEN] += 1
        _connect(search, node, other, cost)
        _relax_from(search, node)
        node = other
    return True


@kernel
def _full(scratch, search):
    """Whether the next visit may need more room than there is: a node, an edge, a branch a candidate, some of open."""
    n = search.count
    return (
        n[NODES] + 1 > len(search.g)
        or n[BRANCHES] + 1 + len(scratch.key) > len(search.branch_next)
        or n[EDGES] + 1 > len(search.edge_to)
        or n[OPEN] + n[NODES] + 2 > len(search.open)
    )


@kernel
def _digest(config):
    """31 bits; a product of 31 and 25 bits stays within an int64."""
    digest = np.int64(0x11C9DC5)
    for i in range(len(config)):
        digest = ((digest ^ np.int64(config[i])) * 0x1000193) & 0x7FFFFFFF
        digest ^= digest >> 15
    return digest


@kernel(allocates=True)
def _find(search, config, digest):
    mask = len(search.slot) - 1
    k = digest & mask
    while search.slot[k] >= 0:
        node = search.slot[k]
        if search.digest[node] == digest and np.array_equal(search.config[node], config):
            return node
        k = (k + 1) & mask
    return np.int64(NONE)


@kernel(allocates=True)
def fill_slots(search):
    """Rebuild the hash table after the store has grown."""
    search.slot[:] = NONE
    mask = len(search.slot) - 1
    for node in range(search.count[NODES]):
        k = search.digest[node] & mask
        while search.slot[k] >= 0:
            k = (k + 1) & mask
        search.slot[k] = node


@kernel(allocates=True)
def _create(search, config, digest, h):
    n = search.count
    node = n[NODES]
    n[NODES] += 1
    search.config[node] = config
    search.digest[node] = digest
    search.h[node] = h
    search.parent[node] = NONE
    search.first_edge[node] = NONE
    search.relaxing[node] = False
    root = n[BRANCHES]
    n[BRANCHES] += 1
    search.branch_parent[root] = NONE
    search.branch_vertex[root] = NONE
    search.branch_depth[root] = 0
    search.branch_next[root] = NONE
    search.first_branch[node] = root
    search.last_branch[node] = root
    mask = len(search.slot) - 1
    k = digest & mask
    while search.slot[k] >= 0:
        k = (k + 1) & mask
    search.slot[k] = node
    return node


@kernel
def _grow_tree(world, search, node, branch, rng):
    """Append what may come after a branch: one more robot on each of its vertices, in random order."""
    depth = search.branch_depth[branch]
    if depth >= search.config.shape[1]:
        return
    n = search.count
    i = search.order[node, depth]
    v = search.config[node, i]
    a, b = world.first[v], world.first[v + 1]
    num = b - a + 1
    shift = np.int64(rng.random() * num)
    for k in range(num):
        at = a + (k + shift) % num
        new = n[BRANCHES]
        n[BRANCHES] += 1
        search.branch_parent[new] = branch
        search.branch_vertex[new] = world.head[at] if at < b else v
        search.branch_depth[new] = depth + 1
        search.branch_next[new] = NONE
        if search.first_branch[node] < 0:
            search.first_branch[node] = new
        else:
            search.branch_next[search.last_branch[node]] = new
        search.last_branch[node] = new


@kernel(allocates=True)
def _generate(world, scratch, search, node, branch, num_tries, rng):
    """Generate configurations that keep to the branch; `search.best` is the one of least cost to come. False when there is none."""
    here, order, to = search.config[node], search.order[node], search.to
    least = np.int64(-1)
    for _ in range(num_tries):
        to[:] = NONE
        b = branch
        while search.branch_depth[b] > 0:
            to[order[search.branch_depth[b] - 1]] = search.branch_vertex[b]
            b = search.branch_parent[b]
        if not step(world, scratch, here, to, order, rng):
            continue
        cost, h_change = _transition(world, here, to)
        if least < 0 or cost + h_change < least:
            least = cost + h_change
            search.best[:] = to
    return least >= 0


@kernel
def _transition(world, here, to):
    """(robots not at their goals before and after, change of the sum of steps to go). The sum of both is never negative."""
    cost, h_change = np.int64(0), np.int64(0)
    for i in range(len(here)):
        if here[i] != to[i]:
            h_change += nearer(world, i, to[i], here[i])
            cost += 1
        elif here[i] != world.goal[i]:
            cost += 1
    return cost, h_change


@kernel
def _connect(search, node, other, cost):
    e = search.first_edge[node]
    while e >= 0:
        if search.edge_to[e] == other:
            return
        e = search.edge_next[e]
    n = search.count
    e = n[EDGES]
    n[EDGES] += 1
    search.edge_to[e] = other
    search.edge_cost[e] = cost
    search.edge_next[e] = search.first_edge[node]
    search.first_edge[node] = e


@kernel
def _relax_from(search, node):
    """Lower the costs of what is reached from a node, as far as that helps; open again what has become promising."""
    n = search.count
    num = 1
    search.relax[0] = node
    search.relaxing[node] = True
    while num > 0:
        num -= 1
        v = search.relax[num]
        search.relaxing[v] = False
        e = search.first_edge[v]
        while e >= 0:
            u = search.edge_to[e]
            g = search.g[v] + search.edge_cost[e]
            if g < search.g[u]:
                search.g[u] = g
                search.parent[u] = v
                if not search.relaxing[u]:
                    search.relaxing[u] = True
                    search.relax[num] = u
                    num += 1
                goal = n[GOAL]
                if goal >= 0 and g + search.h[u] < search.g[goal] and n[OPEN] < len(search.open):
                    search.open[n[OPEN]] = u
                    n[OPEN] += 1
            e = search.edge_next[e]


def room_for_nodes(num_robots: int, width: int, nodes: int) -> LacamMemory:
    """Memory for a number of nodes, and in proportion for the rest; `width` is the most candidates of a robot."""
    branches, edges, opened = nodes * (width + 2) + width, 3 * nodes, 4 * nodes
    return LacamMemory(
        config=np.empty((nodes, num_robots), np.int32),
        order=np.empty((nodes, num_robots), np.int32),
        **{
            name: np.empty(nodes, np.int64) for name in ("g", "h", "parent", "digest", "first_branch", "last_branch", "first_edge", "relax")
        },
        relaxing=np.empty(nodes, np.bool_),
        **{name: np.empty(num_robots, np.int32) for name in ("to", "best")},
        **{name: np.empty(branches, np.int64) for name in ("branch_parent", "branch_next")},
        **{name: np.empty(branches, np.int32) for name in ("branch_vertex", "branch_depth")},
        edge_to=np.empty(edges, np.int64),
        edge_cost=np.empty(edges, np.int32),
        edge_next=np.empty(edges, np.int64),
        slot=np.full(1 << (2 * nodes - 1).bit_length(), -1, np.int64),
        open=np.empty(opened, np.int64),
        count=np.zeros(6, np.int64),
    )


def larger_room(search: LacamMemory, memory_mb: int) -> LacamMemory | None:
    """The same search with twice the room where room is short; None when that is more memory than allowed."""
    n = search.count
    num_nodes, num_robots = search.config.shape
    nodes = ("config", "order", "g", "h", "parent", "first_branch", "last_branch", "first_edge", "relax", "digest", "relaxing")
    groups = {
        (n[NODES], num_nodes): nodes,
        (n[BRANCHES], len(search.branch_next)): ("branch_parent", "branch_next", "branch_vertex", "branch_depth"),
        (n[EDGES], len(search.edge_to)): ("edge_to", "edge_cost", "edge_next"),
        (n[OPEN] + n[NODES], len(search.open)): ("open",),
    }
    grown: dict[str, np.ndarray] = {}
    for (used, room), names in groups.items():
        if 4 * used < 3 * room:
            continue
        for name in names:
            old = getattr(search, name)
            if name in ("config", "order") and 2 * 2 * room * num_robots * 4 > memory_mb * 1_000_000:
                return None
            grown[name] = np.empty((2 * len(old), *old.shape[1:]), old.dtype)  # what is not written takes no memory
            grown[name][: len(old)] = old
    if "config" in grown:
        grown["slot"] = np.empty(2 * len(search.slot), np.int64)
    larger = search._replace(**grown)
    if "config" in grown:
        fill_slots(larger)
    return larger
