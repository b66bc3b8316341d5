"""Kernels of search in space and time, for planners that replan one robot at a time under constraints.

A search has two stages: the least cost by safe intervals, which the constraints cut (`_earliest.py`); then,
among the paths that cost at most w times that, the one that disturbs fewest others, by best-first search on
(vertex, step). This is the focal search of Barer, Sharon, Stern, Felner, "Suboptimal variants of the
conflict-based search algorithm", SoCS 2014, with the lower bound known beforehand; with w = 1 it is A* that
breaks ties by conflicts. Constraints forbid (hard), other robots' paths are disturbed at a price (soft).
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._constraints import (
    EARLIEST,
    EXPANSIONS,
    LAST_MUST,
    STAMP,
    ConstraintScratch,
    is_forbidden,
    load,
    put,
)
from mrp_sumo.search._disturbance import count_visits_from, is_taken, num_disturbed, num_too_close
from mrp_sumo.search._earliest import NO_EDGE, earliest_arrival
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._occupancy import Occupancy, uninstall
from mrp_sumo.search._records import FOREVER, NO_PATH, OK, OUT_OF_BUDGET, PATH, SCRATCH_FULL, STORE_FULL, SearchInstance, Store

PATIENCE = 500  # expansions that are always spent on disturbing few robots
HURRY = 8  # steps of delay that a robot takes then to disturb one robot less
MOST_DISTURBED = 255  # beyond, paths count as equal, whomever they disturb

# what a state's label ends in, after the number of robots disturbed
WAITING, EXPANDED, FINISH = 0, 1, 2


class TreeTables(NamedTuple):
    """Tables that a constraint tree's kernels work on: the graph, the records, where robots are, and buffers."""

    instance: SearchInstance
    store: Store
    occupancy: Occupancy
    scratch: ConstraintScratch


class ReplanEffort(NamedTuple):
    """Effort with which a robot is replanned."""

    w: float  # the path costs at most w times the least cost, or w times `lower`
    lower: int  # a known lower bound
    patience: int  # expansions a step of the least cost to spend on disturbing few robots, before the first path there is is taken
    budget: int  # expansions allowed for finding that


class _Window(NamedTuple):
    """The costs that a search tells apart, and the buckets that its states go into."""

    shortest: int  # steps of the shortest path without constraints: a state's delay is what it costs more
    least: int  # the least cost under the constraints
    latest: int  # the most that a path may cost
    shift: int  # a vertex has 2 ** shift cells, one for each delay
    width: int  # buckets for each number of robots disturbed, one for each cost
    most: int  # robots disturbed that have buckets of their own; paths that disturb more share the last ones


@kernel
def _window(scratch, num_vertices, shortest, least, bound):
    """(whether there is room for a search, its window)."""
    delays = np.int64(1)  # how many there is room for, a power of two
    while 2 * delays * num_vertices <= len(scratch.visited):
        delays *= 2
    latest = max(least, min(bound, shortest + delays - 1))
    shift = np.int64(0)
    while (1 << shift) <= latest - shortest:
        shift += 1
    width = latest - least + 1
    most = min(MOST_DISTURBED, len(scratch.top) // width - 1)
    return latest - shortest < delays and most >= 1, _Window(shortest, least, latest, shift, width, most)


@kernel(inline="always")
def _bucket(window, hurry, num_buckets, delay, to_go, disturbs):
    """Where a state goes: fewest robots disturbed first, then by cost; in a hurry, by a weighted sum of them and the steps to go."""
    if hurry:
        to = min(delay + to_go + HURRY * disturbs, num_buckets - 1)
    else:
        to = min(disturbs, window.most) * window.width + max(window.shortest + delay - window.least, 0)
    return to


@kernel(inline="always")
def _is_no_better(state, e, num_states, vertex, step, disturbs):
    """Whether state e is the same vertex and step, and is expanded already or disturbs no more robots."""
    known = False
    if e < num_states and state[e].vertex == vertex and state[e].step == step:
        label = state[e].label
        known = label & 3 == EXPANDED or label >> 2 <= disturbs
    return known


@kernel(inline="always")
def _write(instance, store, k, vertex):
    """Write a vertex of a path."""
    store.path[k].vertex, store.path[k].spot = vertex, instance.spots.of[vertex]


@kernel
def find_path(tables, robot, least, bound, hurry, budget):
    """The path of a cost of at most `bound` that disturbs fewest, under the constraints laid out.

    Parameters
    ----------
    tables
        See `TreeTables`; the searching robot is not installed.
    robot
        Who searches.
    least
        The least cost under the constraints.
    bound
        The most that the path may cost; less is allowed where the buffers are small.
    hurry
        Whether a path that disturbs few will do: best first by steps to go, delay, and robots disturbed.
    budget
        Expansions allowed.

    Returns
    -------
    code, state
        OK and the last state, from which `BEFORE` leads back.
    """
    instance, store, occupancy, scratch = tables
    start, goal, distance = instance.start[robot], instance.goal[robot], instance.distance[robot]
    first, head, following, near = instance.first, instance.head, instance.following, instance.clashes.any
    spot_of, lane_move, num_moves = instance.spots.of, instance.spots.move, len(instance.spots.head)
    state, top, visited, later = scratch.state, scratch.top, scratch.visited, scratch.later
    stamp, last_must, earliest = scratch.number[STAMP], scratch.limit[LAST_MUST], scratch.limit[EARLIEST]
    shortest = np.int64(distance[start])
    fits, window = _window(scratch, len(first) - 1, shortest, np.int64(least), np.int64(bound))
    if not fits:
        return SCRATCH_FULL, np.int64(-1)
    last_visit = count_visits_from(occupancy, spot_of[goal], shortest, later)
    put(scratch, 0, start, 0, -1, WAITING, 0)
    visited[start << window.shift] = 0
    num_states = 1
    bucket, highest = np.int64(0), np.int64(0)
    spent = 0
    code, end = NO_PATH, np.int64(-1)
    while True:
        while bucket <= highest and top[bucket] < 0:
            bucket += 1
        if bucket > highest:
            break
        k = np.int64(top[bucket])
        top[bucket] = state[k].below
        label = state[k].label
        if label & 3 == FINISH:
            code, end = OK, k
            break
        u, t = np.int64(state[k].vertex), np.int64(state[k].step)
        if visited[(u << window.shift) + t + distance[u] - shortest] != k:
            continue
        disturbs = np.int64(label >> 2)
        state[k].label = label | EXPANDED
        lanes_begin, lanes_end = first[u], first[u + 1]
        if num_states + lanes_end - lanes_begin + 2 >= len(state):
            code = SCRATCH_FULL
            break
        if u == goal and t >= earliest:
            if t > last_visit or later[t] == 0:
                code, end = OK, k
                break
            # the robot may stay in the way, or go on
            disturbs_here = disturbs + later[t]
            to = _bucket(window, hurry, len(top), t - shortest, 0, disturbs_here)
            put(scratch, num_states, u, t, k, (disturbs_here << 2) | FINISH, to)
            highest, bucket = max(highest, to), min(bucket, to)
            num_states += 1
        spent += 1
        if spent > budget:
            code = OUT_OF_BUDGET
            break
        step = t + 1
        here = spot_of[u]
        u_is_taken = is_taken(occupancy, here, step)
        for lane in range(lanes_begin, lanes_end + 1):
            v = head[lane] if lane < lanes_end else u
            to_go, there = np.int64(distance[v]), spot_of[v]
            delay = step + to_go - shortest
            if delay > window.latest - shortest or is_forbidden(scratch, stamp, last_must, here, there, step):
                continue
            disturbs_there = disturbs + num_disturbed(store, occupancy, here, there, step, u_is_taken, following)
            if near:
                disturbs_there += num_too_close(instance, occupancy, lane_move[lane] if lane < lanes_end else num_moves + here, there, step)
            cell = (v << window.shift) + delay
            if _is_no_better(state, np.int64(visited[cell]), num_states, v, step, disturbs_there):
                continue
            to = _bucket(window, hurry, len(top), delay, to_go, disturbs_there)
            put(scratch, num_states, v, step, k, disturbs_there << 2, to)
            highest, bucket = max(highest, to), min(bucket, to)
            visited[cell] = num_states
            num_states += 1
    top[: highest + 1] = -1
    scratch.number[EXPANSIONS] += spent
    return code, end


@kernel
def replan(tables, record, effort):
    """Find the path of a record under its constraints, and write it to the store.

    Parameters
    ----------
    tables
        See `TreeTables`.
    record
        With its constraints.
    effort
        What may be spent on it.

    Returns
    -------
    code
        OK, or why there is none (yet).
    """
    instance, store, occupancy, scratch = tables
    robot = store.meta[record].robot
    code = load(instance, store, scratch, record)
    if code != OK:
        return code
    if occupancy.record[robot] >= 0:
        uninstall(store, occupancy, robot)
    distance = instance.distance[robot]
    code, least, end = earliest_arrival(instance, scratch, instance.start[robot], distance, True, NO_EDGE, effort.budget)
    if code != OK:
        return code
    begin = store.used[PATH]
    if begin + least + 1 > len(store.path):
        return STORE_FULL
    state = scratch.state
    cost = until = least
    while end >= 0:
        for t in range(state[end].step, until + 1):
            _write(instance, store, begin + t, state[end].vertex)
        until = state[end].step - 1
        end = state[end].before
    if effort.patience > 0:
        bound = np.int64(min(effort.w * max(least, effort.lower) + 1e-9, FOREVER // 4))
        polite = min(effort.budget, PATIENCE + effort.patience * least)
        code, end = find_path(tables, robot, least, bound, False, polite)
        if code == OUT_OF_BUDGET:
            code, end = find_path(tables, robot, least, bound, True, polite)
        if code == OK:
            if state[end].label & 3 == FINISH:
                end = state[end].before
            cost = np.int64(state[end].step)
            if begin + cost + 1 > len(store.path):
                return STORE_FULL
            for t in range(cost, -1, -1):
                _write(instance, store, begin + t, state[end].vertex)
                end = state[end].before
        elif code != OUT_OF_BUDGET:  # out of patience: the robot takes its earliest path, whomever it disturbs
            return code
    store.used[PATH] = begin + cost + 1
    store.meta[record].path0 = begin
    store.meta[record].cost = cost
    store.meta[record].bound = min(max(least, effort.lower), cost)
    return OK
