"""Kernels of a search over safe intervals among paths that may be crossed at a price.

Source: SIPPS of Li, Chen, Harabor, Stuckey, Koenig, "MAPF-LNS2: fast repairing for multi-agent path finding via
large neighborhood search", AAAI 2022 (section 4), after Phillips and Likhachev, "SIPP", ICRA 2011. A vertex's
time falls into runs in which it is free or somebody is on it, or too close. A path is rated by the runs of others it enters
and the swaps, clashes and rings it makes, then by its length; or, when crossing is forbidden, by its length alone.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners._compass import UNKNOWN
from planners.neighbourhood._cells import is_sparse, slots_for
from planners.neighbourhood._traffic import closes_ring, run_end

FAR = 1 << 30
EASE = 32  # steps of a detour that are as bad as one step done again: what is left weighs 1 + 1 / EASE


class Labels(NamedTuple):
    """Room for a search: N labels, and what is known of each run, named by its vertex and last step."""

    vertex: np.ndarray  # [N] int64
    low: np.ndarray  # [N] int64 arrival
    high: np.ndarray  # [N] int64 last step of the run
    cost: np.ndarray  # [N] int64 crossings
    parent: np.ndarray  # [N] int64
    heap_key: np.ndarray  # [N] int64
    heap_label: np.ndarray  # [N] int64
    link: np.ndarray  # [N] int64 the next label of the same length, where crossing is forbidden
    queue: np.ndarray  # [T] int64 the first label of each length, likewise
    pushed: np.ndarray  # [K] int64 of each run, see `run_slot`: stamp, cost and arrival of the last label that was worth it
    closed: np.ndarray  # [K] int64 likewise: stamp and earliest arrival that was expanded
    run: np.ndarray  # [K] int64 which run a slot is of; [0] where each that can be has its slot
    run_stamp: np.ndarray  # [K] int64 the search that it is of, likewise
    stamp: np.ndarray  # [2] int64 number of searches, number of labels in all of them


@kernel(allocates=False)
def steps_from(steps, code, v, u, to_go):
    """Steps to the goal from u, of which there are `to_go` from its neighbour v; FAR where that is not known."""
    if len(steps) > 0:
        return np.int64(steps[u])
    a, b = (code[u >> 2] >> (2 * (u & 3))) & 3, (code[v >> 2] >> (2 * (v & 3))) & 3
    if a == UNKNOWN or b == UNKNOWN:
        return np.int64(FAR)
    d = (np.int64(a) - np.int64(b) + 3) % 3
    return to_go + (d if d < 2 else -1)


@kernel(inline="always")
def run_slot(labels, v, high):
    """Where what is known of a vertex's run with this last step is kept."""
    run = np.int64(v) * len(labels.queue) + high
    if len(labels.run) == 0:
        return run
    near = 8 * np.int64(v) + (high & 7) + (((high >> 3) * 0x9E3779B1) >> 8)
    return _hashed_run(labels.run, labels.run_stamp, labels.pushed, labels.closed, labels.stamp[0], run, near)


@kernel(allocates=False)
def _hashed_run(runs, run_stamp, pushed, closed, stamp, run, near):
    """Its slot among hashed ones, looked for from `near` on; those of earlier searches are empty.

    Runs of a vertex and of those around it that end at about one time are near each other in memory: searches stay in a few places.
    """
    mask = len(runs) - 1
    k = near & mask
    while run_stamp[k] == stamp:
        if runs[k] == run:
            return k
        k = (k + 1) & mask
    runs[k], run_stamp[k], pushed[k], closed[k] = run, stamp, 0, 0
    return k


@kernel(inline="always")
def _first_crossing(traffic, held, along, barred, near, rings, lane, back, v, u, t, until):
    """The first arrival at u from v, not before `t`, that swaps and clashes with nobody and closes no ring; beyond `until`: none.

    Whoever swaps is on v at that step, which `held` says, the row of v that is at hand.
    """
    while t <= until and (
        (back >= 0 and (held[t >> 5] >> (t & 31)) & 1 and (along[back, t >> 5] >> (t & 31)) & 1)
        or (near and (barred[lane, t >> 5] >> (t & 31)) & 1)
        or (rings and closes_ring(traffic, v, u, t))
    ):
        t += 1
    return t


@kernel(allocates=False)
def plan_one(first, head, reverse, traffic, labels, robot, start, goal, least, steps, code, limit, crossing, most):
    """The best path of a robot that is not in the traffic, written to its row of `at`.

    Parameters
    ----------
    first, head, reverse
        The graph.
    traffic, labels
        The others, and room.
    robot, start, goal
        Who goes where.
    least, steps, code
        Steps to the goal: from the start, [V] from everywhere, and [ceil(V / 4)] packed where that is [0].
    limit
        Arrival at the latest, at most T - 1.
    crossing
        Whether others' paths may be crossed.
    most
        Labels after which it gives up.

    Returns
    -------
    int
        Step of arrival, -1 when there is no path. `labels.stamp[1]` goes up by the number of labels.
    """
    if crossing:
        end, num_labels = _search(first, head, reverse, traffic, labels, robot, start, goal, least, steps, code, limit, most)
    else:
        end, num_labels = _search_free(first, head, reverse, traffic, labels, robot, start, goal, least, steps, code, limit, most)
    labels.stamp[1] += num_labels
    return end


@kernel(allocates=False)
def _search_free(first, head, reverse, traffic, labels, robot, start, goal, least, steps, code, limit, most):
    """`plan_one` where nobody may be crossed: only arrivals count, so that a queue of lengths does for a heap.

    What is left to the goal is the length of a label less its arrival. Where it is not known no path would be short enough.
    Of labels of one length the last is the first to be expanded, which goes straight on.
    """
    busy, along, following, barred, near = traffic.busy, traffic.along, traffic.following, traffic.barred, len(traffic.num_near) > 1
    vertex, lows, highs, parent, link, queue, seen = (
        labels.vertex, labels.low, labels.high, labels.parent, labels.link, labels.queue, labels.pushed,
    )  # fmt: skip
    horizon = traffic.at.shape[1]
    rings = not traffic.rotations and not following
    labels.stamp[0] += 1
    stamp = labels.stamp[0] << 32
    room = min(len(vertex), most)
    occupied, high = run_end(busy[start], 0)
    if occupied or least > limit:
        return np.int64(-1), 1
    length = least
    queue[length : limit + 1] = -1
    vertex[0], lows[0], highs[0], parent[0], link[0] = start, 0, high, -1, -1
    queue[length] = 0
    num_labels = 1
    while True:
        while length <= limit and queue[length] < 0:
            length += 1
        if length > limit:
            return np.int64(-1), num_labels
        x = queue[length]
        queue[length] = link[x]
        v, low, high = vertex[x], lows[x], highs[x]
        if v == goal and high == horizon - 1:
            _write(labels, traffic, robot, x)
            return low, num_labels
        mark = seen[run_slot(labels, v, high)]
        if mark >= stamp and mark - stamp < low:
            continue
        leave = high if following else high + 1
        for lane in range(first[v], first[v + 1]):
            u = head[lane]
            to_go = steps_from(steps, code, v, u, length - low)
            t = low + 1
            last = min(leave, limit - to_go)
            back = reverse[lane]
            while t <= last:
                occupied, end = run_end(busy[u], t)
                if not occupied:
                    until = min(end, last)
                    t = _first_crossing(traffic, busy[v], along, barred, near, rings, lane, back, v, u, t, until)
                    k = run_slot(labels, u, end) if t <= until else np.int64(0)
                    if t <= until and (seen[k] < stamp or seen[k] - stamp > t):
                        if num_labels >= room:
                            return np.int64(-1), num_labels
                        seen[k] = stamp + t
                        vertex[num_labels], lows[num_labels], highs[num_labels], parent[num_labels] = u, t, end, x
                        link[num_labels] = queue[t + to_go]
                        queue[t + to_go] = num_labels
                        num_labels += 1
                t = end + 1


@kernel(allocates=False)
def _search(first, head, reverse, traffic, labels, robot, start, goal, least, steps, code, limit, most):
    """`plan_one` where others may be crossed.

    Steps that are left count a little more than steps that are done, so that of all paths that are about as short not every one is tried
    before the first that is a step longer (weighted A*: Pohl, "Heuristic search viewed as path finding in a graph", AIJ 1970).
    """
    busy, along, following, barred, near = traffic.busy, traffic.along, traffic.following, traffic.barred, len(traffic.num_near) > 1
    horizon = traffic.at.shape[1]
    rings = not traffic.rotations and not following
    labels.stamp[0] += 1
    stamp = labels.stamp[0] << 32
    room = min(len(labels.vertex) - 2, most)
    occupied, high = run_end(busy[start], 0)
    if least > limit:
        return np.int64(-1), 1
    labels.vertex[0], labels.low[0], labels.high[0], labels.parent[0] = start, 0, high, -1
    labels.cost[0] = 1 if occupied else 0
    num_labels, num_heap = 1, 1
    labels.heap_key[0] = _rank(0, 0, least)
    labels.heap_label[0] = 0
    while num_heap > 0:
        x, left = labels.heap_label[0], labels.heap_key[0] & 0xFFFFF
        num_heap = _pop(labels.heap_key, labels.heap_label, num_heap)
        final = x < 0
        if final:
            x = -1 - x
        v, low, high, cost = labels.vertex[x], labels.low[x], labels.high[x], labels.cost[x]
        if final:
            _write(labels, traffic, robot, x)
            return low, num_labels
        k = run_slot(labels, v, high)
        mark = labels.closed[k]
        if mark >= stamp and mark - stamp <= low:
            continue
        labels.closed[k] = stamp + low
        if v == goal:
            later, t = cost, high + 1
            while t < horizon:
                occupied, t = run_end(busy[v], t)
                later += 1 if occupied else 0
                t += 1
            if later == cost:  # nobody comes by any more
                _write(labels, traffic, robot, x)
                return low, num_labels
            num_heap = _push(labels.heap_key, labels.heap_label, num_heap, _rank(later, low, 0), -1 - x)
        if num_labels + 8 * (first[v + 1] - first[v] + 1) > room or num_heap + 8 * (first[v + 1] - first[v] + 1) > room:
            return np.int64(-1), num_labels
        if high + 1 + left <= limit:
            occupied, end = run_end(busy[v], high + 1)
            price = cost + (1 if occupied else 0)
            num_labels, num_heap = _reach(labels, num_labels, num_heap, stamp, x, v, high + 1, end, price, left)
        leave = high if following else high + 1
        for lane in range(first[v], first[v + 1]):
            u = head[lane]
            to_go = steps_from(steps, code, v, u, left)
            t = low + 1
            last = min(leave, limit - to_go)
            back = reverse[lane]
            while t <= last:
                occupied, end = run_end(busy[u], t)
                arrive, price = t, cost + (1 if occupied else 0)
                until = min(end, last)
                arrive = _first_crossing(traffic, busy[v], along, barred, near, rings, lane, back, v, u, arrive, until)
                if arrive > until:
                    arrive, price = t, price + 1
                if num_labels >= room or num_heap >= room:
                    return np.int64(-1), num_labels
                num_labels, num_heap = _reach(labels, num_labels, num_heap, stamp, x, u, arrive, end, price, to_go)
                t = end + 1
    return np.int64(-1), num_labels


@kernel(inline="always")
def _rank(cost, low, to_go):
    """Where a label stands in the queue: by crossings, then by its length, then by what is left, which are the lowest 20 bits."""
    return (cost << 44) + ((EASE * (low + to_go) + to_go) << 20) + to_go


@kernel(inline="always")
def _reach(labels, num_labels, num_heap, stamp, parent, v, low, high, cost, to_go):
    """Put a label in the queue unless a better one of its run was there before."""
    k = run_slot(labels, v, high)
    mark = labels.pushed[k]
    if mark >= stamp and ((mark - stamp) >> 18) <= cost and ((mark - stamp) & 0x3FFFF) <= low:
        return num_labels, num_heap
    mark = labels.closed[k]
    if mark >= stamp and mark - stamp <= low:
        return num_labels, num_heap
    labels.pushed[k] = stamp + (min(cost, 0x3FFF) << 18) + low
    labels.vertex[num_labels] = v
    labels.low[num_labels] = low
    labels.high[num_labels] = high
    labels.cost[num_labels] = cost
    labels.parent[num_labels] = parent
    num_heap = _push(labels.heap_key, labels.heap_label, num_heap, _rank(cost, low, to_go), num_labels)
    return num_labels + 1, num_heap


@kernel(allocates=False)
def _write(labels, traffic, robot, x):
    """The path that ends in label x, and the stay at its end."""
    at = traffic.at[robot]
    traffic.end[robot] = labels.low[x]
    end = len(at)
    while x >= 0:
        at[labels.low[x] : end] = labels.vertex[x]
        end = labels.low[x]
        x = labels.parent[x]


@kernel(allocates=False)
def _push(keys, heap, num, key, label):
    k = num
    while k > 0:
        up = (k - 1) >> 1
        if keys[up] <= key:
            break
        keys[k], heap[k] = keys[up], heap[up]
        k = up
    keys[k], heap[k] = key, label
    return num + 1


@kernel(allocates=False)
def _pop(keys, heap, num):
    num -= 1
    key, label = keys[num], heap[num]
    k = 0
    while True:
        down = 2 * k + 1
        if down >= num:
            break
        if down + 1 < num and keys[down + 1] < keys[down]:
            down += 1
        if keys[down] >= key:
            break
        keys[k], heap[k] = keys[down], heap[down]
        k = down
    keys[k], heap[k] = key, label
    return num


def labels_for(num_vertices: int, num_lanes: int) -> int:
    """How many labels a search may make."""
    return 20_000 + 16 * num_vertices + 2 * num_lanes


def room_for_labels(num_vertices: int, num_lanes: int, horizon: int, most: int = 1 << 62) -> Labels:
    """Room for searches over so many steps, of `most` labels, or of as many as may be needed on the map if those are fewer."""
    num_labels = min(labels_for(num_vertices, num_lanes), most)
    sparse = is_sparse(num_vertices, horizon)
    num_runs = slots_for(num_labels + 2) if sparse else num_vertices * horizon
    return Labels(
        *(np.zeros(num_labels, np.int64) for _ in range(8)),
        queue=np.zeros(horizon, np.int64),
        pushed=np.zeros(num_runs, np.int64),
        closed=np.zeros(num_runs, np.int64),
        run=np.zeros(num_runs if sparse else 0, np.int64),
        run_stamp=np.zeros(num_runs if sparse else 0, np.int64),
        stamp=np.zeros(2, np.int64),
    )
