"""Kernels of a search over safe intervals among paths that may be crossed at a price.

Source: SIPPS of Li, Chen, Harabor, Stuckey, Koenig, "MAPF-LNS2: fast repairing for multi-agent path finding via
large neighborhood search", AAAI 2022 (section 4), after Phillips and Likhachev, "SIPP", ICRA 2011. A vertex's
time falls into runs in which it is free or somebody is on it, or too close. A path is rated by the runs of others it enters
and the swaps, clashes and rings it makes, then by its length; or, when crossing is forbidden, by its length alone: exactly, and so with
a queue of its own. `search._earliest` has the intervals of constraints, which are few; those of others' paths are bits.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._heap import pop_by, push_by
from mrp_sumo.search._kernel import kernel
from planners.configuration._pibt_instance import UNKNOWN
from planners.neighbourhood._traffic import MOST_CELLS, add_path, closes_ring, free_start, mixed, run_end, slots_for

FAR = 1 << 30
FEW_LABELS = 1 << 15  # of a search that is tried first, so that its hashed runs stay in the processor's cache; then all
NO_ROOM = -2  # how a search ends that has made all the labels it may
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
    pushed: np.ndarray  # [K] int64 of each run, see `hashed_run`: stamp, cost and arrival of the last label that was worth it
    closed: np.ndarray  # [K] int64 likewise: stamp and earliest arrival that was expanded
    run: np.ndarray  # [K] int64 which run a slot is of; [0] where each that can be has its slot
    run_stamp: np.ndarray  # [K] int64 the search that it is of, likewise
    stamp: np.ndarray  # [3] int64 number of searches, number of labels in all of them, slots of the search at hand less one
    count: np.ndarray  # [2] int64 labels of this search, and how many of them are in the heap


@kernel
def steps_from(steps, code, v, u, to_go):
    """Steps to the goal from u, of which there are `to_go` from its neighbour v; FAR where that is not known."""
    if len(steps) > 0:
        return np.int64(steps[u])
    a, b = (code[u >> 2] >> (2 * (u & 3))) & 3, (code[v >> 2] >> (2 * (v & 3))) & 3
    if a == UNKNOWN or b == UNKNOWN:
        return np.int64(FAR)
    d = (np.int64(a) - np.int64(b) + 3) % 3
    return to_go + (d if d < 2 else -1)


@kernel
def hashed_run(labels, v, high):
    """Slot of what is known of a vertex's run with this last step, among hashed ones; those of earlier searches are empty.

    Runs of a vertex and of those around it that end at about one time are near each other in memory: searches stay in a few places.
    """
    runs, run_stamp, stamp, mask = labels.run, labels.run_stamp, labels.stamp[0], labels.stamp[2]
    run = v * len(labels.queue) + high
    k = (8 * v + (high & 7) + (((high >> 3) * 0x9E3779B1) >> 8)) & mask
    while run_stamp[k] == stamp:
        if runs[k] == run:
            return k
        k = (k + 1) & mask
    runs[k], run_stamp[k], labels.pushed[k], labels.closed[k] = run, stamp, 0, 0
    return k


@kernel
def plan_one(traffic, labels, robot, limit, crossing):
    """The best path of a robot that is not in the traffic, written to its row of `at`.

    Parameters
    ----------
    traffic, labels
        The others, and room.
    robot
        Who searches.
    limit
        Arrival at the latest, at most T - 1.
    crossing
        Whether others' paths may be crossed.

    Returns
    -------
    int
        Step of arrival, -1 when there is no path. `labels.stamp[1]` goes up by the number of labels.
    """
    most, end = len(labels.vertex), np.int64(NO_ROOM)
    room = min(FEW_LABELS, most) if len(labels.run) > 0 else most
    while end == NO_ROOM:
        _begin(labels, room)
        end = np.int64(-1)
        if traffic.task.least[robot] <= limit:
            end = _search(traffic, labels, robot, limit, room) if crossing else _search_free(traffic, labels, robot, limit, room)
        if room == most:
            break
        room = most
    labels.stamp[1] += labels.count[0]
    return max(end, np.int64(-1))


@kernel(inline="always")
def _begin(labels, most):
    """Begin a search that makes so many labels at most."""
    labels.stamp[0] += 1
    labels.stamp[2] = min(len(labels.run), 2 * FEW_LABELS if most <= FEW_LABELS else len(labels.run)) - 1
    labels.count[0], labels.count[1] = 1, 0


@kernel
def plan_straight(traffic, labels, robot):
    """A path of a robot that is not in the traffic, as short as its shortest way and past everybody, written to its row of `at`.

    Searched depth first: such a path can be at each vertex at one step only. It gives up where it has come back from as many vertices
    as the path has. True if there is one. `labels.stamp[1]` goes up by the number of vertices.
    """
    task, busy, along, barred = traffic.task, traffic.busy, traffic.along, traffic.barred
    first, head, goal, least, steps, code = task.first, task.head, task.goal[robot], task.least[robot], task.steps[robot], task.code[robot]
    path, lane_of, near, rings, following = labels.vertex, labels.low, len(traffic.num_near) > 1, task.rings, task.following
    spot_of, move_along = task.spots.of, task.spots.move
    _begin(labels, 2 * least + 2)
    stamp = labels.stamp[0] << 32
    occupied, high = run_end(busy[spot_of[goal]], least)
    if occupied or high < traffic.at.shape[1] - 1 or 2 * least >= len(path) or run_end(busy[spot_of[task.start[robot]]], 0)[0]:
        return False
    t, num = np.int64(0), np.int64(1)
    path[0], lane_of[0] = task.start[robot], 0
    while 0 <= t < least and num <= 2 * least:
        v, word, shift = path[t], (t + 1) >> 5, (t + 1) & 31
        degree = first[v + 1] - first[v]
        if lane_of[t] == degree:
            t -= 1
            continue
        lane = first[v] + (lane_of[t] + mixed((robot << 12) + (t >> 3))) % degree  # each has its own sides to go to first
        lane_of[t] += 1
        u, move = np.int64(head[lane]), move_along[lane]
        here, there, back = spot_of[v], spot_of[u], task.spots.back[move]
        held = (busy[here, word] >> shift) & 1
        if steps_from(steps, code, v, u, least - t) != least - t - 1 or (busy[there, word] >> shift) & 1 or (held and following):
            continue
        if (held and back >= 0 and (along[word, back] >> shift) & 1) or (near and (barred[move, word] >> shift) & 1):
            continue
        k = u * len(labels.queue) if len(labels.run) == 0 else hashed_run(labels, u, np.int64(0))
        if labels.closed[k] == stamp or (rings and closes_ring(traffic, here, there, t + 1)):
            continue
        labels.closed[k] = stamp
        t, num = t + 1, num + 1
        path[t], lane_of[t] = u, 0
    labels.stamp[1] += num
    if t != least:
        return False
    traffic.end[robot] = least
    for step in range(least):
        traffic.at[robot, step] = path[step]
    traffic.at[robot, least:] = goal
    return True


@kernel
def plan_apart(traffic, labels, robots):
    """Plan robots one after another, each past those before it, until one has no path; how many have one."""
    for k in range(len(robots)):
        if traffic.task.following:
            free_start(traffic, robots[k])
        if plan_one(traffic, labels, robots[k], traffic.at.shape[1] - 1, False) < 0:
            return k
        add_path(traffic, robots[k])
    return len(robots)


@kernel
def _search_free(traffic, labels, robot, limit, room):
    """`plan_one` where nobody may be crossed, or NO_ROOM: only arrivals count, so that a queue of lengths does for a heap.

    What is left to the goal is the length of a label less its arrival. Where it is not known no path would be short enough.
    Of labels of one length the last is the first to be expanded, which goes straight on.
    """
    task, busy, horizon, goal = traffic.task, traffic.busy, traffic.at.shape[1], traffic.task.goal[robot]
    first, head, steps, code = task.first, task.head, task.steps[robot], task.code[robot]
    vertex, lows, highs, parent, link, queue, seen = (
        labels.vertex, labels.low, labels.high, labels.parent, labels.link, labels.queue, labels.pushed,
    )  # fmt: skip
    along, barred, near, rings = traffic.along, traffic.barred, len(traffic.num_near) > 1, task.rings
    spot_of, move_along, back_of = task.spots.of, task.spots.move, task.spots.back
    stamp, start, dense = labels.stamp[0] << 32, task.start[robot], len(labels.run) == 0
    occupied, high = run_end(busy[spot_of[start]], 0)
    if occupied:
        return np.int64(-1)
    length = task.least[robot]
    queue[length : limit + 1] = -1
    vertex[0], lows[0], highs[0], parent[0], link[0] = start, 0, high, -1, -1
    queue[length] = 0
    num_labels, end = 1, np.int64(-1)
    while end < 0:
        while length <= limit and queue[length] < 0:
            length += 1
        if length > limit:
            break
        x = queue[length]
        queue[length] = link[x]
        v, low, high = vertex[x], lows[x], highs[x]
        if v == goal and high == horizon - 1:
            _write(labels, traffic, robot, x)
            end = low
            break
        mark = seen[v * horizon + high if dense else hashed_run(labels, v, high)]
        if mark >= stamp and mark - stamp < low:
            continue
        leave, here = high if task.following else high + 1, spot_of[v]
        for lane in range(first[v], first[v + 1]):
            u, move = head[lane], move_along[lane]
            to_go = steps_from(steps, code, v, u, length - low)
            t = low + 1
            last, back, there = min(leave, limit - to_go), back_of[move], spot_of[u]
            while t <= last:
                occupied, run = run_end(busy[there], t)
                if not occupied:
                    until = min(run, last)
                    while t <= until and (  # a swap, for which the other is on v, a clash or a ring
                        (back >= 0 and (busy[here, t >> 5] >> (t & 31)) & 1 and (along[t >> 5, back] >> (t & 31)) & 1)
                        or (near and (barred[move, t >> 5] >> (t & 31)) & 1)
                        or (rings and closes_ring(traffic, here, there, t))
                    ):
                        t += 1
                    k = np.int64(0)
                    if t <= until:
                        k = np.int64(u) * horizon + run if dense else hashed_run(labels, np.int64(u), run)
                    if t <= until and (seen[k] < stamp or seen[k] - stamp > t):
                        if num_labels >= room:
                            labels.count[0] = num_labels
                            return np.int64(NO_ROOM)
                        seen[k] = stamp + t
                        vertex[num_labels], lows[num_labels], highs[num_labels], parent[num_labels] = u, t, run, x
                        link[num_labels] = queue[t + to_go]
                        queue[t + to_go] = num_labels
                        num_labels += 1
                t = run + 1
    labels.count[0] = num_labels
    return end


@kernel
def _search(traffic, labels, robot, limit, room):
    """`plan_one` where others may be crossed, or NO_ROOM.

    Steps that are left count a little more than steps that are done, so that of all paths that are about as short not every one is tried
    before the first that is a step longer (weighted A*: Pohl, "Heuristic search viewed as path finding in a graph", AIJ 1970).
    """
    task, busy, horizon, goal = traffic.task, traffic.busy, traffic.at.shape[1], traffic.task.goal[robot]
    first, head, steps, code, count = task.first, task.head, task.steps[robot], task.code[robot], labels.count
    along, barred, near, rings = traffic.along, traffic.barred, len(traffic.num_near) > 1, task.rings
    spot_of, move_along, back_of = task.spots.of, task.spots.move, task.spots.back
    stamp, start, dense = labels.stamp[0] << 32, task.start[robot], len(labels.run) == 0
    room -= 2
    occupied, high = run_end(busy[spot_of[start]], 0)
    labels.vertex[0], labels.low[0], labels.high[0], labels.parent[0] = start, 0, high, -1
    labels.cost[0] = 1 if occupied else 0
    push_by(labels.heap_key, labels.heap_label, 0, _rank(0, 0, task.least[robot]), 0)
    count[1] = 1
    while count[1] > 0:
        left = labels.heap_key[0] & 0xFFFFF
        x = pop_by(labels.heap_key, labels.heap_label, count[1])
        count[1] -= 1
        final = x < 0
        if final:
            x = -1 - x
        v, low, high, cost = labels.vertex[x], labels.low[x], labels.high[x], labels.cost[x]
        if final:
            _write(labels, traffic, robot, x)
            return low
        k = v * horizon + high if dense else hashed_run(labels, v, high)
        mark = labels.closed[k]
        if mark >= stamp and mark - stamp <= low:
            continue
        labels.closed[k] = stamp + low
        if v == goal:
            later, t = cost, high + 1
            while t < horizon:
                occupied, t = run_end(busy[spot_of[v]], t)
                later += 1 if occupied else 0
                t += 1
            if later == cost:  # nobody comes by any more
                _write(labels, traffic, robot, x)
                return low
            push_by(labels.heap_key, labels.heap_label, count[1], _rank(later, low, 0), -1 - x)
            count[1] += 1
        if max(count[0], count[1]) + 8 * (first[v + 1] - first[v] + 1) > room:
            return np.int64(NO_ROOM)
        if high + 1 + left <= limit:
            occupied, end = run_end(busy[spot_of[v]], high + 1)
            _reach(labels, x, v, high + 1, end, cost + (1 if occupied else 0), left)
        leave, here = high if task.following else high + 1, spot_of[v]
        for lane in range(first[v], first[v + 1]):
            u, move = head[lane], move_along[lane]
            to_go = steps_from(steps, code, v, u, left)
            t = low + 1
            last, back, there = min(leave, limit - to_go), back_of[move], spot_of[u]
            while t <= last:
                occupied, end = run_end(busy[there], t)
                arrive, price = t, cost + (1 if occupied else 0)
                until = min(end, last)
                while arrive <= until and (
                    (back >= 0 and (busy[here, arrive >> 5] >> (arrive & 31)) & 1 and (along[arrive >> 5, back] >> (arrive & 31)) & 1)
                    or (near and (barred[move, arrive >> 5] >> (arrive & 31)) & 1)
                    or (rings and closes_ring(traffic, here, there, arrive))
                ):
                    arrive += 1
                if arrive > until:
                    arrive, price = t, price + 1
                if max(count[0], count[1]) >= room:
                    return np.int64(NO_ROOM)
                _reach(labels, x, np.int64(u), arrive, end, price, to_go)
                t = end + 1
    return np.int64(-1)


@kernel(inline="always")
def _rank(cost, low, to_go):
    """Where a label stands in the queue: by crossings, then by its length, then by what is left, which are the lowest 20 bits."""
    return (cost << 44) + ((EASE * (low + to_go) + to_go) << 20) + to_go


@kernel(inline="always")
def _reach(labels, parent, v, low, high, cost, to_go):
    """Put a label in the queue unless a better one of its run was there before."""
    k = v * len(labels.queue) + high if len(labels.run) == 0 else hashed_run(labels, v, high)
    stamp, n = labels.stamp[0] << 32, labels.count[0]
    pushed, closed = labels.pushed[k] - stamp, labels.closed[k] - stamp  # below 0: by searches before
    better = (pushed >= 0 and (pushed >> 18) <= cost and (pushed & 0x3FFFF) <= low) or 0 <= closed <= low
    if not better:
        labels.pushed[k] = stamp + (min(cost, 0x3FFF) << 18) + low
        labels.vertex[n], labels.low[n], labels.high[n], labels.cost[n], labels.parent[n] = v, low, high, cost, parent
        push_by(labels.heap_key, labels.heap_label, labels.count[1], _rank(cost, low, to_go), n)
        labels.count[0] += 1
        labels.count[1] += 1


@kernel
def _write(labels, traffic, robot, x):
    """The path that ends in label x, and the stay at its end."""
    at = traffic.at[robot]
    traffic.end[robot] = labels.low[x]
    end = len(at)
    while x >= 0:
        at[labels.low[x] : end] = labels.vertex[x]
        end = labels.low[x]
        x = labels.parent[x]


def labels_for(num_vertices: int, num_lanes: int) -> int:
    """Number of labels that a search may make."""
    return 20_000 + 16 * num_vertices + 2 * num_lanes


def room_for_labels(num_vertices: int, num_lanes: int, horizon: int, most: int = 1 << 62, cells: int = MOST_CELLS) -> Labels:
    """Room for searches over so many steps.

    It is for `most` labels, or for as many as may be needed on the map if those are fewer. Runs are hashed where there are more than so
    many cells, of a vertex and a step each.
    """
    num_labels = min(labels_for(num_vertices, num_lanes), most)
    sparse = num_vertices * horizon > cells
    num_runs = slots_for(num_labels + 2) if sparse else num_vertices * horizon
    known = np.empty if sparse else np.zeros  # a hashed run is unknown until it has its slot
    return Labels(
        *(np.empty(num_labels, np.int64) for _ in range(8)),
        queue=np.zeros(horizon, np.int64),
        pushed=known(num_runs, np.int64),
        closed=known(num_runs, np.int64),
        run=np.empty(num_runs if sparse else 0, np.int64),
        run_stamp=np.zeros(num_runs if sparse else 0, np.int64),
        stamp=np.zeros(3, np.int64),
        count=np.zeros(2, np.int64),
    )
