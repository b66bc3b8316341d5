"""Kernels of search in space and time, for planners that replan one robot at a time under constraints.

A search has two stages: the least cost by safe intervals, which the constraints cut (`_earliest.py`); then,
among the paths that cost at most w times that, the one that disturbs fewest others, by best-first search on
(vertex, step). This is the focal search of Barer, Sharon, Stern, Felner, "Suboptimal variants of the
conflict-based search algorithm", SoCS 2014, with the lower bound known beforehand; with w = 1 it is A* that
breaks ties by conflicts. Constraints forbid (hard), other robots' paths are disturbed at a price (soft).
"""

import numpy as np

from mrp_sumo.search._constraints import (
    BEFORE,
    BELOW,
    EARLIEST,
    EXPANSIONS,
    LABEL,
    LAST_MUST,
    LATEST,
    STAMP,
    STEP,
    VERTEX,
    barred,
    elsewhere,
    load,
)
from mrp_sumo.search._earliest import earliest_arrival
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._occupancy import MANY, ONE, WORD, next_visit, uninstall
from mrp_sumo.search._records import (
    BOUND,
    COST,
    FOREVER,
    NO_PATH,
    OK,
    OUT_OF_BUDGET,
    PATH,
    PATH0,
    ROBOT,
    SCRATCH_FULL,
    STORE_FULL,
)

PATIENCE = 500  # expansions that are always spent on disturbing few robots
HURRY = 8  # steps of delay that a robot takes then to disturb one robot less
MOST_DISTURBED = 255  # beyond, paths are not told apart by whom they disturb

# what a state's label ends in, after the number of robots disturbed
WAITING, EXPANDED, FINISH = 0, 1, 2


@kernel
def _visits_at_goal(occupancy, goal, begin, later):
    """Fill `later` with the visits of others at the goal from each step on, from `begin`; the last step with one, -1 for none."""
    words, num_robots = len(occupancy.busy) // len(occupancy.since), len(occupancy.record)
    low, last = goal * words, np.int64(-1)
    for word in range(words - 1, (begin >> 5) - 1, -1):
        if occupancy.busy[low + word] == 0:
            if last >= 0:
                later[word * WORD : (word + 1) * WORD] = later[(word + 1) * WORD]
            continue
        if last < 0:
            last = np.int64(word * WORD + WORD - 1)
            later[last + 1] = 0
        later[word * WORD : (word + 1) * WORD] = 0
        k = np.int64(occupancy.visit[low + word])
        while k > 0:
            later[(k - 1) // num_robots] += 1
            k = np.int64(occupancy.after[k])
        for t in range(word * WORD + WORD - 1, word * WORD - 1, -1):
            later[t] += later[t + 1]
    return last


@kernel
def _delays_that_fit(num_states, num_vertices):
    """How many delays states can have, a power of two: states differ by vertex and delay, steps beyond the shortest path."""
    delays = np.int64(1)
    while 2 * delays * num_vertices <= num_states:
        delays *= 2
    return delays


@kernel
def _others_there(after, visit, low, num_robots):
    """How many robots but the first are at a vertex at the step whose visits begin above `low`."""
    num = 0
    e = next_visit(after, after[next_visit(after, visit, low, num_robots)], low, num_robots)
    while e:
        num += 1
        e = next_visit(after, after[e], low, num_robots)
    return num


@kernel
def _who_leave(after, visit, low, num_robots, installed, meta, path, u, v, step, following):
    """How many robots at v the step before go to u as the robot comes from there; with `following`, all who leave v."""
    num = 0
    e = next_visit(after, visit, low - num_robots, num_robots)
    while e:
        record = installed[e - low + num_robots - 1]
        went = path[meta[record, PATH0] + min(step, meta[record, COST])]
        if went == u or (following and went != v):
            num += 1
        e = next_visit(after, after[e], low - num_robots, num_robots)
    return num


@kernel
def _who_follow(after, visit, low, num_robots, installed, meta, path, v, t):
    """How many robots enter the vertex that the robot leaves, but those that come from v, where it goes."""
    num = 0
    e = next_visit(after, visit, low, num_robots)
    while e:
        record = installed[e - low - 1]
        if path[meta[record, PATH0] + min(t, meta[record, COST])] != v:
            num += 1
        e = next_visit(after, after[e], low, num_robots)
    return num


@kernel
def find_path(world, store, occupancy, scratch, robot, least, bound, hurry, budget):
    """The path of a cost of at most `bound` that disturbs fewest, under the constraints laid out.

    Parameters
    ----------
    world, store, occupancy, scratch
        The graph, the records, the others, room; the searching robot is not installed.
    robot
        Who searches.
    least
        The least cost there is.
    bound
        The most that the path may cost; less is allowed where the room is short.
    hurry
        Whether a path that disturbs few will do: best first by steps to go, late, and robots disturbed.
    budget
        Expansions allowed.

    Returns
    -------
    code, state
        OK and the last state, from which `BEFORE` leads back.
    """
    # arrays by themselves: to hand a tuple to a function in the inner loop counts references of all its arrays
    start, goal, distance = world.start[robot], world.goal[robot], world.distance[world.row[robot]]
    first, head, following = world.first, world.head, world.following
    meta, path = store.meta, store.path
    busy, visit, after, since, installed = occupancy.busy, occupancy.visit, occupancy.after, occupancy.since, occupancy.record
    state, top, visited, later = scratch.state, scratch.top, scratch.visited, scratch.later
    touched, rule_at, rule, must = scratch.touched, scratch.rule_at, scratch.rule, scratch.must
    stamp, limit = scratch.number[STAMP], scratch.limit
    num_robots, words = len(installed), len(busy) // len(since)
    horizon, last_must, earliest = words * WORD, limit[LAST_MUST], limit[EARLIEST]
    shortest = np.int64(distance[start])
    delays = _delays_that_fit(len(visited), len(since))
    latest = min(limit[LATEST], max(least, min(bound, shortest + delays - 1)))
    if latest - shortest >= delays:
        return SCRATCH_FULL, np.int64(-1)
    shift = 0
    while (1 << shift) <= latest - shortest:
        shift += 1
    width = latest - least + 1
    most = min(MOST_DISTURBED, len(top) // width - 1)
    if most < 1:
        return SCRATCH_FULL, np.int64(-1)
    last_visit = _visits_at_goal(occupancy, goal, shortest, later)
    state[0, VERTEX], state[0, STEP], state[0, BEFORE], state[0, LABEL], state[0, BELOW] = start, 0, -1, WAITING, -1
    visited[start << shift] = 0
    num_states = 1
    top[0] = 0
    bucket, highest = np.int64(0), np.int64(0)
    spent = 0
    code, end = NO_PATH, np.int64(-1)
    while True:
        while bucket <= highest and top[bucket] < 0:
            bucket += 1
        if bucket > highest:
            break
        k = np.int64(top[bucket])
        top[bucket] = state[k, BELOW]
        label = state[k, LABEL]
        if label & 3 == FINISH:
            code, end = OK, k
            break
        u, t = np.int64(state[k, VERTEX]), np.int64(state[k, STEP])
        if visited[(u << shift) + t + distance[u] - shortest] != k:
            continue
        disturbs = np.int64(label >> 2)
        state[k, LABEL] = label | EXPANDED
        begin, lanes_end = first[u], first[u + 1]
        if num_states + lanes_end - begin + 2 >= len(state):
            code = SCRATCH_FULL
            break
        if u == goal and t >= earliest:
            if t > last_visit or later[t] == 0:
                code, end = OK, k
                break
            # the robot may stay in the way, or go on
            more = disturbs + later[t]
            state[num_states, VERTEX], state[num_states, STEP], state[num_states, BEFORE] = u, t, k
            to = min(t - shortest + HURRY * more, len(top) - 1) if hurry else min(more, most) * width + max(t - least, 0)
            state[num_states, LABEL], state[num_states, BELOW] = (more << 2) | FINISH, top[to]
            top[to] = num_states
            highest = max(highest, to)
            bucket = min(bucket, to)
            num_states += 1
        spent += 1
        if spent > budget:
            code = OUT_OF_BUDGET
            break
        step = t + 1
        column, bit = step >> 5, np.uint64(step & 31)
        column_before, bit_before = t >> 5, np.uint64(t & 31)
        low = step * num_robots
        here = step < horizon and (((busy[u * words + column] >> bit) & ONE) != 0 or since[u] <= step)
        for lane in range(begin, lanes_end + 1):
            v = head[lane] if lane < lanes_end else u
            delay = step + distance[v] - shortest
            if delay > latest - shortest:
                continue
            if touched[v] == stamp and barred(rule, rule_at, u, v, step):
                continue
            if step <= last_must and elsewhere(must, stamp, step, v):
                continue
            new_disturbs = disturbs
            if since[v] <= step:
                new_disturbs += 1
            if step < horizon:
                bits = busy[v * words + column] >> bit
                new_disturbs += np.int64(bits & ONE)
                if bits & MANY:
                    new_disturbs += _others_there(after, visit[v * words + column], low, num_robots)
                if u != v:
                    # who swaps places with the robot is there before and here after
                    if (here or following) and (busy[v * words + column_before] >> bit_before) & ONE:
                        new_disturbs += _who_leave(
                            after, visit[v * words + column_before], low, num_robots, installed, meta, path, u, v, step, following
                        )
                    if following and (busy[u * words + column] >> bit) & ONE:
                        new_disturbs += _who_follow(after, visit[u * words + column], low, num_robots, installed, meta, path, v, t)
            cell = (v << shift) + delay
            e = np.int64(visited[cell])
            if e < num_states and state[e, VERTEX] == v and state[e, STEP] == step:
                label = state[e, LABEL]
                if label & 3 == EXPANDED or label >> 2 <= new_disturbs:
                    continue
            state[num_states, VERTEX], state[num_states, STEP], state[num_states, BEFORE] = v, step, k
            if hurry:
                to = min(delay + distance[v] + HURRY * new_disturbs, len(top) - 1)
                bucket = min(bucket, to)
            else:
                to = min(new_disturbs, most) * width + max(delay + shortest - least, 0)
            state[num_states, LABEL], state[num_states, BELOW] = new_disturbs << 2, top[to]
            top[to] = num_states
            highest = max(highest, to)
            visited[cell] = num_states
            num_states += 1
    top[: highest + 1] = -1
    scratch.number[EXPANSIONS] += spent
    return code, end


@kernel
def replan(world, store, occupancy, scratch, record, w, lower, patience, budget):
    """Find the path of a record under its constraints, and write it to the store.

    Parameters
    ----------
    world, store, occupancy, scratch
        As above.
    record
        With its constraints.
    w, lower
        The path costs at most w times the least cost, or w times `lower`, a known lower bound.
    patience
        Expansions a step of the least cost to spend on disturbing few robots, before the first path there is is taken.
    budget
        Expansions allowed for finding that.

    Returns
    -------
    code
        OK, or why there is none (yet).
    """
    robot = store.meta[record, ROBOT]
    code = load(world, store, scratch, record)
    if code != OK:
        return code
    if occupancy.record[robot] >= 0:
        uninstall(store, occupancy, robot)
    distance = world.distance[world.row[robot]]
    code, least, end = earliest_arrival(world, scratch, world.start[robot], world.goal[robot], distance, True, -1, -1, budget)
    if code != OK:
        return code
    begin = store.used[PATH]
    if begin + least + 1 > len(store.path):
        return STORE_FULL
    state = scratch.state
    cost = until = least
    while end >= 0:
        for t in range(state[end, STEP], until + 1):
            store.path[begin + t] = state[end, VERTEX]
        until = state[end, STEP] - 1
        end = state[end, BEFORE]
    if patience > 0:
        bound = np.int64(min(w * max(least, lower) + 1e-9, FOREVER // 4))
        polite = min(budget, PATIENCE + patience * least)
        code, end = find_path(world, store, occupancy, scratch, robot, least, bound, False, polite)
        if code == OUT_OF_BUDGET:
            code, end = find_path(world, store, occupancy, scratch, robot, least, bound, True, polite)
        if code == OK:
            if state[end, LABEL] & 3 == FINISH:
                end = state[end, BEFORE]
            cost = np.int64(state[end, STEP])
            if begin + cost + 1 > len(store.path):
                return STORE_FULL
            for t in range(cost, -1, -1):
                store.path[begin + t] = state[end, VERTEX]
                end = state[end, BEFORE]
        elif code != OUT_OF_BUDGET:  # out of patience: the robot takes its earliest path, whomever it disturbs
            return code
    store.used[PATH] = begin + cost + 1
    store.meta[record, PATH0] = begin
    store.meta[record, COST] = cost
    store.meta[record, BOUND] = min(max(least, lower), cost)
    return OK
