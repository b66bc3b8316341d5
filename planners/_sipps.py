"""Kernels of a search over safe intervals among paths that may be crossed at a price.

Source: SIPPS of Li, Chen, Harabor, Stuckey, Koenig, "MAPF-LNS2: fast repairing for multi-agent path finding via
large neighborhood search", AAAI 2022 (section 4), after Phillips and Likhachev, "SIPP", ICRA 2011. A vertex's
time falls into runs in which it is free or somebody is on it. A path is rated by the runs of others it enters
and the swaps it makes, then by its length; or, when crossing is forbidden, by its length alone.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

WORD = 32  # steps in a word of a bit set, kept in an int64 so that no arithmetic overflows
_LOWEST = np.zeros(32, np.int64)  # position of the lowest bit by de Bruijn's sequence
for _k in range(32):
    _LOWEST[((0x077CB531 << _k) & 0xFFFFFFFF) >> 27] = _k


class Traffic(NamedTuple):
    """Who is where. V vertices, L lanes, R robots, T steps, W = T / WORD. Robots stay at their goals up to step T - 1."""

    at: np.ndarray  # [T, R] int32 position of each robot, -1 where a robot has no path
    end: np.ndarray  # [R] int64 step at which each arrives to stay, -1 without a path
    num_on: np.ndarray  # [V, T] uint8 robots on a vertex
    busy: np.ndarray  # [V, W] int64 bits: somebody is on it
    num_along: np.ndarray  # [L, T] uint8 robots that arrive by a lane at a step
    along: np.ndarray  # [L, W] int64 bits: somebody does


class Labels(NamedTuple):
    """Room for a search: N labels, and what is known of each run, named by its vertex and last step."""

    vertex: np.ndarray  # [N] int64
    low: np.ndarray  # [N] int64 arrival
    high: np.ndarray  # [N] int64 last step of the run
    cost: np.ndarray  # [N] int64 crossings
    parent: np.ndarray  # [N] int64
    heap_key: np.ndarray  # [N] int64
    heap_label: np.ndarray  # [N] int64
    pushed: np.ndarray  # [V, T] int64 stamp, cost and arrival of the last label that was worth it
    closed: np.ndarray  # [V, T] int64 stamp and earliest arrival that was expanded
    stamp: np.ndarray  # [2] int64 number of searches, number of labels in all of them


@njit(cache=True)
def run_end(bits, t):
    """(whether the bit at t is set, the last step of the run of equal bits around t)."""
    word = t >> 5
    shift = t & 31
    bit = (bits[word] >> shift) & 1
    flip = 0xFFFFFFFF if bit else 0
    rest = (bits[word] ^ flip) >> shift
    if rest:
        return bit == 1, t + _LOWEST[(((rest & -rest) * 0x077CB531) & 0xFFFFFFFF) >> 27] - 1
    for k in range(word + 1, len(bits)):
        rest = bits[k] ^ flip
        if rest:
            return bit == 1, (k << 5) + _LOWEST[(((rest & -rest) * 0x077CB531) & 0xFFFFFFFF) >> 27] - 1
    return bit == 1, (len(bits) << 5) - 1


@njit(cache=True)
def lane_between(first, head, u, v):
    """The lane from u to v, -1 where there is none."""
    for lane in range(first[u], first[u + 1]):
        if head[lane] == v:
            return lane
    return np.int64(-1)


@njit(cache=True)
def add_path(first, head, traffic, robot):
    """Enter the robot's column of `at` in the rest of the traffic."""
    horizon = len(traffic.at)
    before = np.int64(-1)
    for t in range(horizon):
        v = np.int64(traffic.at[t, robot])
        traffic.num_on[v, t] += 1
        traffic.busy[v, t >> 5] |= np.int64(1) << (t & 31)
        if t > 0 and v != before:
            lane = lane_between(first, head, before, v)
            traffic.num_along[lane, t] += 1
            traffic.along[lane, t >> 5] |= np.int64(1) << (t & 31)
        before = v


@njit(cache=True)
def remove_path(first, head, traffic, robot):
    """Take the robot's path out of the traffic; its column of `at` stays."""
    horizon = len(traffic.at)
    before = np.int64(-1)
    for t in range(horizon):
        v = np.int64(traffic.at[t, robot])
        traffic.num_on[v, t] -= 1
        if traffic.num_on[v, t] == 0:
            traffic.busy[v, t >> 5] &= ~(np.int64(1) << (t & 31))
        if t > 0 and v != before:
            lane = lane_between(first, head, before, v)
            traffic.num_along[lane, t] -= 1
            if traffic.num_along[lane, t] == 0:
                traffic.along[lane, t >> 5] &= ~(np.int64(1) << (t & 31))
        before = v


@njit(cache=True)
def plan_one(first, head, reverse, traffic, labels, robot, start, goal, steps, limit, crossing, most):
    """The best path of a robot that is not in the traffic, written to its column of `at`.

    Parameters
    ----------
    first, head, reverse
        The graph.
    traffic, labels
        The others, and room.
    robot, start, goal
        Who goes where.
    steps
        [V] steps to the goal.
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
    end, num_labels = _search(first, head, reverse, traffic, labels, robot, start, goal, steps, limit, crossing, most)
    labels.stamp[1] += num_labels
    return end


@njit(cache=True)
def _search(first, head, reverse, traffic, labels, robot, start, goal, steps, limit, crossing, most):
    """(step of arrival or -1, number of labels); see `plan_one`."""
    horizon = len(traffic.at)
    labels.stamp[0] += 1
    stamp = labels.stamp[0] << 32
    room = min(len(labels.vertex) - 2, most)
    occupied, high = run_end(traffic.busy[start], 0)
    if (occupied and not crossing) or steps[start] > limit:
        return np.int64(-1), 1
    labels.vertex[0], labels.low[0], labels.high[0], labels.parent[0] = start, 0, high, -1
    labels.cost[0] = 1 if occupied else 0
    num_labels, num_heap = 1, 1
    labels.heap_key[0] = np.int64(steps[start]) << 20
    labels.heap_label[0] = 0
    while num_heap > 0:
        x = labels.heap_label[0]
        num_heap = _pop(labels, num_heap)
        final = x < 0
        if final:
            x = -1 - x
        v, low, high, cost = labels.vertex[x], labels.low[x], labels.high[x], labels.cost[x]
        if final:
            _write(labels, traffic, robot, x)
            return low, num_labels
        mark = labels.closed[v, high]
        if mark >= stamp and mark - stamp <= low:
            continue
        labels.closed[v, high] = stamp + low
        if v == goal:
            later, t = cost, high + 1
            while t < horizon:
                occupied, t = run_end(traffic.busy[v], t)
                later += 1 if occupied else 0
                t += 1
            if later == cost:  # nobody comes by any more
                _write(labels, traffic, robot, x)
                return low, num_labels
            if crossing:
                num_heap = _push(labels, num_heap, (later << 40) + (low << 20), -1 - x)
        if num_labels + 8 * (first[v + 1] - first[v] + 1) > room or num_heap + 8 * (first[v + 1] - first[v] + 1) > room:
            return np.int64(-1), num_labels
        if crossing and high + 1 + steps[v] <= limit:
            occupied, end = run_end(traffic.busy[v], high + 1)
            num_labels, num_heap = _reach(
                labels, num_labels, num_heap, stamp, x, v, high + 1, end, cost + (1 if occupied else 0), np.int64(steps[v])
            )
        for lane in range(first[v], first[v + 1]):
            u = head[lane]
            to_go = np.int64(steps[u])
            t = low + 1
            last = min(high + 1, limit - to_go)
            back = reverse[lane]
            while t <= last:
                occupied, end = run_end(traffic.busy[u], t)
                if occupied and not crossing:
                    t = end + 1
                    continue
                arrive, swaps = t, 0
                if back >= 0:
                    until = min(end, last)
                    while arrive <= until and (traffic.along[back, arrive >> 5] >> (arrive & 31)) & 1:
                        arrive += 1
                    if arrive > until:
                        arrive, swaps = t, 1
                if swaps == 0 or crossing:
                    if num_labels >= room or num_heap >= room:
                        return np.int64(-1), num_labels
                    price = cost + swaps + (1 if occupied else 0)
                    num_labels, num_heap = _reach(labels, num_labels, num_heap, stamp, x, u, arrive, end, price, to_go)
                t = end + 1
    return np.int64(-1), num_labels


@njit(cache=True)
def _reach(labels, num_labels, num_heap, stamp, parent, v, low, high, cost, to_go):
    """Put a label in the queue unless a better one of its run was there before."""
    mark = labels.pushed[v, high]
    if mark >= stamp and ((mark - stamp) >> 18) <= cost and ((mark - stamp) & 0x3FFFF) <= low:
        return num_labels, num_heap
    mark = labels.closed[v, high]
    if mark >= stamp and mark - stamp <= low:
        return num_labels, num_heap
    labels.pushed[v, high] = stamp + (min(cost, 0x3FFF) << 18) + low
    labels.vertex[num_labels] = v
    labels.low[num_labels] = low
    labels.high[num_labels] = high
    labels.cost[num_labels] = cost
    labels.parent[num_labels] = parent
    num_heap = _push(labels, num_heap, (cost << 40) + ((low + to_go) << 20) + to_go, num_labels)
    return num_labels + 1, num_heap


@njit(cache=True)
def _write(labels, traffic, robot, x):
    """The path that ends in label x, and the stay at its end."""
    horizon = len(traffic.at)
    traffic.end[robot] = labels.low[x]
    end = horizon
    while x >= 0:
        for t in range(labels.low[x], end):
            traffic.at[t, robot] = labels.vertex[x]
        end = labels.low[x]
        x = labels.parent[x]


@njit(cache=True)
def _push(labels, num, key, label):
    keys, heap = labels.heap_key, labels.heap_label
    k = num
    while k > 0:
        up = (k - 1) >> 1
        if keys[up] <= key:
            break
        keys[k], heap[k] = keys[up], heap[up]
        k = up
    keys[k], heap[k] = key, label
    return num + 1


@njit(cache=True)
def _pop(labels, num):
    keys, heap = labels.heap_key, labels.heap_label
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
