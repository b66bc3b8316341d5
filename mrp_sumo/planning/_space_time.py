"""Kernels of search in space and time, for planners that replan one robot at a time under constraints.

A *record* is one robot's set of constraints and the path found under it. Records form chains: a record adds
rows to those of its parent. The *occupancy* says who is where and when, so that a search can count the robots
it would disturb (soft) while constraints forbid (hard). The low level is focal search on (vertex, step): among
open states whose f is at most w times the least f, the one that disturbs fewest robots is expanded. With w = 1
this is A* that breaks ties by conflicts. Source: Barer, Sharon, Stern, Felner, "Suboptimal variants of the
conflict-based search algorithm", SoCS 2014; Silver, "Cooperative pathfinding", AIIDE 2005.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from mrp_sumo.planning._heap import pop, push
from mrp_sumo.planning._kernels import UNREACHABLE

FOREVER = 1 << 30
OK, NO_PATH, STORE_FULL, SCRATCH_FULL, TOO_LATE, OUT_OF_BUDGET = 0, 1, 2, 3, 4, 5  # what kernels return

# columns of Store.meta
PARENT, ROW0, ROW1, ORIGIN, PATH0, COST, BOUND, MDD0, ROBOT = 0, 1, 2, 3, 4, 5, 6, 7, 8
# kinds of rows: (kind, vertex, tail, from step, to step)
RANGE, EDGE, MIN_COST, MAX_COST, MUST = 0, 1, 2, 3, 4
# entries of Store.used
RECORDS, ROWS, PATH, LEVELS, MEMBERS = 0, 1, 2, 3, 4
# columns of Scratch.state
VERTEX, STEP, BEFORE, DISTURBS, NEXT, STATUS = 0, 1, 2, 3, 4, 5
WAITING, EXPANDED, FINISH = 0, 1, 2
# entries of Scratch.number
STAMP, EXPANSIONS, NUM_CLOSED, NUM_EDGES, MARK = 0, 1, 2, 3, 4
# entries of Scratch.limit, what the constraints say
LAST, EARLIEST, LATEST, HAS_MUST = 0, 1, 2, 3


class World(NamedTuple):
    """What does not change: V vertices, L lanes, R robots, G goals."""

    first: np.ndarray  # [V + 1] int64, lanes that leave a vertex
    head: np.ndarray  # [L] int64
    first_in: np.ndarray  # [V + 1] int64, lanes that enter a vertex
    tail_in: np.ndarray  # [L] int64
    distance: np.ndarray  # [G, V] int32 steps to each goal
    row: np.ndarray  # [R] int64, the row of `distance` of each robot
    start: np.ndarray  # [R] int64
    goal: np.ndarray  # [R] int64
    column: np.ndarray  # [V] int64 cell coordinates on a 4-connected grid; empty on other graphs
    line: np.ndarray  # [V] int64
    following: bool  # whether following conflicts count


class Store(NamedTuple):
    """Records and their pools; only ever appended to (or cut off at the end)."""

    meta: np.ndarray  # [N, 9] int64
    rows: np.ndarray  # [C, 5] int32 constraints
    path: np.ndarray  # [P] int32 vertices by step
    level: np.ndarray  # [M] int64, where each level of an MDD begins in `member`
    member: np.ndarray  # [Q] int32 vertices
    used: np.ndarray  # [5] int64


class Occupancy(NamedTuple):
    """Who is where, of the installed records: moving robots in lists by (step, vertex), parked ones by vertex."""

    someone: np.ndarray  # [T * V] int32, robot + 1, 0 for nobody
    another: np.ndarray  # [R * T] int32, the next robot + 1 at the same place as this robot at this step
    parked: np.ndarray  # [V] int32, robot that stays for ever, -1 for none
    since: np.ndarray  # [V] int32
    record: np.ndarray  # [R] int64 installed, -1 for none


class Scratch(NamedTuple):
    """Tables of one search. Stamped, so that none is cleared."""

    blocked: np.ndarray  # [T * V] int32, stamp << 2 | (vertex forbidden) | (an edge into it forbidden) << 1
    visited: np.ndarray  # [T * V] int64, stamp << 32 | state
    must: np.ndarray  # [T] int64, stamp << 32 | the vertex to be at
    closed_since: np.ndarray  # [V] int32, forbidden from this step on
    closed: np.ndarray  # [V] int64, vertices of `closed_since` to clear
    edge: np.ndarray  # [E, 3] int32 forbidden moves (step of arrival, tail, head)
    state: np.ndarray  # [N, 6] int32
    heap: np.ndarray  # [H] int64
    bucket: np.ndarray  # [F] int32, states beyond the focal bound by f, 0 for none (state + 1)
    open_at: np.ndarray  # [F] int32, open states by f
    after: np.ndarray  # [T] int32, visits of others at the goal from this step on
    mark: np.ndarray  # [V] int64, stamps of level sets
    queue: np.ndarray  # [V] int64
    reach: np.ndarray  # [V] int32, distance table of a corridor's end
    level: np.ndarray  # [M] int64 levels being built
    member: np.ndarray  # [Q] int32
    number: np.ndarray  # [8] int64
    limit: np.ndarray  # [4] int64


@njit(cache=True)
def place(store, record, step):
    """The vertex of a record's robot at a step."""
    return np.int64(store.path[store.meta[record, PATH0] + min(step, store.meta[record, COST])])


@njit(cache=True)
def add_row(store, kind, vertex, tail, from_step, to_step):
    """Append a constraint; False when there is no room."""
    k = store.used[ROWS]
    if k >= len(store.rows):
        return False
    store.rows[k, 0] = kind
    store.rows[k, 1] = vertex
    store.rows[k, 2] = tail
    store.rows[k, 3] = from_step
    store.rows[k, 4] = to_step
    store.used[ROWS] = k + 1
    return True


@njit(cache=True)
def add_record(store, parent, robot, row0, row1):
    """Append a record without path; -1 when there is no room."""
    k = store.used[RECORDS]
    if k >= len(store.meta):
        return -1
    store.used[RECORDS] = k + 1
    meta = store.meta[k]
    meta[PARENT], meta[ROW0], meta[ROW1], meta[ORIGIN] = parent, row0, row1, k
    meta[PATH0], meta[COST], meta[BOUND], meta[MDD0], meta[ROBOT] = 0, 0, 0, -1, robot
    return k


@njit(cache=True)
def install(world, store, occupancy, record):
    """Put a robot on its path; False when the path is longer than the tables."""
    num_vertices = len(world.first) - 1
    horizon = len(occupancy.someone) // num_vertices
    robot, path0, cost = store.meta[record, ROBOT], store.meta[record, PATH0], store.meta[record, COST]
    if cost >= horizon:
        return False
    for t in range(cost):
        k = t * num_vertices + store.path[path0 + t]
        occupancy.another[robot * horizon + t] = occupancy.someone[k]
        occupancy.someone[k] = robot + 1
    v = store.path[path0 + cost]
    occupancy.parked[v] = robot
    occupancy.since[v] = cost
    occupancy.record[robot] = record
    return True


@njit(cache=True)
def uninstall(world, store, occupancy, robot):
    """Take a robot off its path."""
    record = occupancy.record[robot]
    if record < 0:
        return
    num_vertices = len(world.first) - 1
    horizon = len(occupancy.someone) // num_vertices
    path0, cost = store.meta[record, PATH0], store.meta[record, COST]
    for t in range(cost):
        k = t * num_vertices + store.path[path0 + t]
        after = occupancy.another[robot * horizon + t]
        other = occupancy.someone[k]
        if other == robot + 1:
            occupancy.someone[k] = after
        else:
            while occupancy.another[(other - 1) * horizon + t] != robot + 1:
                other = occupancy.another[(other - 1) * horizon + t]
            occupancy.another[(other - 1) * horizon + t] = after
    v = store.path[path0 + cost]
    if occupancy.parked[v] == robot:
        occupancy.parked[v] = -1
    occupancy.record[robot] = -1


@njit(cache=True)
def install_all(world, store, occupancy, records, but):
    """Make the occupancy that of these records [R] without robot `but`; only what differs is touched."""
    for robot in range(len(records)):
        if occupancy.record[robot] != records[robot] or robot == but:
            uninstall(world, store, occupancy, robot)
    for robot in range(len(records)):
        if (
            robot != but
            and records[robot] >= 0
            and occupancy.record[robot] != records[robot]
            and not install(world, store, occupancy, records[robot])
        ):
            return TOO_LATE
    return OK


@njit(cache=True)
def load(world, store, scratch, record):
    """Write the constraints of a record's chain into the tables.

    Returns
    -------
    code
        OK, NO_PATH when they contradict each other, TOO_LATE or SCRATCH_FULL.
    """
    num_vertices = len(world.first) - 1
    horizon = len(scratch.must)
    robot = store.meta[record, ROBOT]
    goal = world.goal[robot]
    number, limit = scratch.number, scratch.limit
    for k in range(number[NUM_CLOSED]):
        scratch.closed_since[scratch.closed[k]] = FOREVER
    number[NUM_CLOSED] = 0
    number[NUM_EDGES] = 0
    number[STAMP] += 1
    stamp = number[STAMP]
    last, earliest, latest, has_must = np.int64(0), np.int64(0), np.int64(FOREVER), 0
    last_must = np.int64(-1)
    last_must_vertex = np.int64(-1)
    while record >= 0:
        for k in range(store.meta[record, ROW0], store.meta[record, ROW1]):
            kind = store.rows[k, 0]
            v = np.int64(store.rows[k, 1])
            begin, end = np.int64(store.rows[k, 3]), np.int64(store.rows[k, 4])
            if kind == RANGE:
                if end >= FOREVER:
                    if scratch.closed_since[v] == FOREVER:
                        scratch.closed[number[NUM_CLOSED]] = v
                        number[NUM_CLOSED] += 1
                    scratch.closed_since[v] = min(scratch.closed_since[v], begin)
                    if v == goal:
                        return NO_PATH
                else:
                    if end + 2 >= horizon:
                        return TOO_LATE
                    last = max(last, end)
                    for t in range(begin, end + 1):
                        cell = t * num_vertices + v
                        old = scratch.blocked[cell]
                        scratch.blocked[cell] = (old | 1) if old >> 2 == stamp else (stamp << 2) | 1
                    if v == goal:
                        earliest = max(earliest, end + 1)
            elif kind == EDGE:
                if begin + 2 >= horizon:
                    return TOO_LATE
                if number[NUM_EDGES] >= len(scratch.edge):
                    return SCRATCH_FULL
                last = max(last, begin)
                cell = begin * num_vertices + v
                old = scratch.blocked[cell]
                scratch.blocked[cell] = (old | 2) if old >> 2 == stamp else (stamp << 2) | 2
                edge = scratch.edge[number[NUM_EDGES]]
                edge[0], edge[1], edge[2] = begin, store.rows[k, 2], v
                number[NUM_EDGES] += 1
            elif kind == MIN_COST:
                earliest = max(earliest, begin)
            elif kind == MAX_COST:
                latest = min(latest, begin)
            else:
                if begin + 2 >= horizon:
                    return TOO_LATE
                old_must = scratch.must[begin]
                if old_must >> 32 == stamp and (old_must & 0xFFFFFFFF) != v:
                    return NO_PATH
                scratch.must[begin] = (stamp << 32) | v
                has_must = 1
                last = max(last, begin)
                if begin > last_must:
                    last_must = begin
                    last_must_vertex = v
        record = store.meta[record, PARENT]
    if has_must:
        for t in range(last_must + 1):  # the robot may only end after every place it must pass
            old_must = scratch.must[t]
            if old_must >> 32 == stamp and (old_must & 0xFFFFFFFF) != goal:
                earliest = max(earliest, t + 1)
    if last_must_vertex >= 0 and last_must > latest and last_must_vertex != goal:
        return NO_PATH
    limit[LAST], limit[EARLIEST], limit[LATEST], limit[HAS_MUST] = last, earliest, latest, has_must
    return OK if earliest <= latest else NO_PATH


@njit(cache=True)
def forbidden(world, scratch, u, v, step):
    """Whether the loaded constraints forbid to come from u to v at this step."""
    if step >= scratch.closed_since[v]:
        return True
    if step > scratch.limit[LAST]:
        return False
    stamp = scratch.number[STAMP]
    found = scratch.blocked[step * (len(world.first) - 1) + v]
    if found >> 2 == stamp:
        if found & 1:
            return True
        if u != v:
            for k in range(scratch.number[NUM_EDGES]):
                if scratch.edge[k, 0] == step and scratch.edge[k, 1] == u and scratch.edge[k, 2] == v:
                    return True
    if scratch.limit[HAS_MUST]:
        must = scratch.must[step]
        return must >> 32 == stamp and (must & 0xFFFFFFFF) != v
    return False


@njit(cache=True)
def find_path(world, store, occupancy, scratch, start, goal, distance, w, lower, soft, stay, ban_u, ban_v, budget):
    """Focal search under the loaded constraints.

    Parameters
    ----------
    world, store, occupancy, scratch
        As above; the searching robot is not installed.
    start, goal
        Vertices.
    distance
        [V] steps to the goal.
    w
        Factor of the focal bound, 1 for shortest paths.
    lower
        A known lower bound of the cost.
    soft
        Whether to count disturbed robots.
    stay
        Whether the robot stays at the goal, so that the constraints on ending hold.
    ban_u, ban_v
        An edge that must not be used, in either direction; -1 for none.
    budget
        Expansions allowed.

    Returns
    -------
    code, state, bound
        OK and the last state, from which `BEFORE` leads back; the lower bound that is now known.
    """
    # arrays by themselves: to hand a tuple to a function in the inner loop counts references of all its arrays
    num_vertices = len(world.first) - 1
    horizon = len(scratch.must)
    first, head, following = world.first, world.head, world.following
    meta, path = store.meta, store.path
    someone, another, parked = occupancy.someone, occupancy.another, occupancy.parked
    since, installed = occupancy.since, occupancy.record
    number, limit, state, heap = scratch.number, scratch.limit, scratch.state, scratch.heap
    visited, blocked, bucket, open_at = scratch.visited, scratch.blocked, scratch.bucket, scratch.open_at
    closed_since, edge, must_be = scratch.closed_since, scratch.edge, scratch.must
    number[MARK] += 1
    now = number[MARK]
    stamp = number[STAMP]
    last = limit[LAST]
    earliest, latest = (limit[EARLIEST], limit[LATEST]) if stay else (np.int64(0), np.int64(FOREVER))
    has_must, num_edges = limit[HAS_MUST], number[NUM_EDGES]
    if distance[start] >= UNREACHABLE or forbidden(world, scratch, start, start, 0):
        return NO_PATH, -1, lower
    cap = max(last, earliest)
    if soft:
        for robot in range(len(occupancy.record)):
            record = occupancy.record[robot]
            if record >= 0:
                cap = max(cap, store.meta[record, COST])
    cap += 1
    if cap + 1 >= horizon:
        return TOO_LATE, -1, lower
    base = max(np.int64(distance[start]), earliest)
    if base > latest:
        return NO_PATH, -1, lower
    first_end = min(np.int64(distance[start]), cap)
    if soft and stay:
        count = 0
        for t in range(cap, first_end - 1, -1):
            other = occupancy.someone[t * num_vertices + goal]
            while other:
                count += 1
                other = occupancy.another[(other - 1) * horizon + t]
            scratch.after[t] = count
    lower = max(lower, base)
    least = base  # f of the best open state
    top = base  # largest f seen
    bound = np.int64(w * lower + 1e-9)
    state[0, VERTEX], state[0, STEP], state[0, BEFORE], state[0, DISTURBS], state[0, STATUS] = start, 0, -1, 0, WAITING
    visited[start] = now << 32
    num_states = 1
    bucket[0] = 0
    open_at[0] = 1
    push(heap, 0, np.int64(0))
    count = 1
    spent = 0
    code, end = NO_PATH, -1
    while True:
        while least <= top and open_at[least - base] == 0:
            least += 1
        if least > top:
            break
        if least > lower:
            lower = least
            old, bound = bound, np.int64(w * lower + 1e-9)
            for f in range(old + 1, min(bound, top) + 1):
                k = bucket[f - base]
                bucket[f - base] = 0
                while k:
                    k -= 1
                    v = np.int64(state[k, VERTEX])
                    if visited[min(np.int64(state[k, STEP]), cap) * num_vertices + v] == (now << 32) | k:
                        if count >= len(heap):
                            code = SCRATCH_FULL
                            break
                        key = (min(np.int64(state[k, DISTURBS]), 4095) << 51) | (min(f - base, 8191) << 38)
                        push(heap, count, key | (min(np.int64(distance[v]), 8191) << 25) | k)
                        count += 1
                    k = state[k, NEXT]
        if count == 0 or code == SCRATCH_FULL:
            break
        key = pop(heap, count)
        count -= 1
        k = key & 0x1FFFFFF
        u, t = np.int64(state[k, VERTEX]), np.int64(state[k, STEP])
        disturbs = np.int64(state[k, DISTURBS])
        f = max(t + distance[u], earliest)
        if state[k, STATUS] == FINISH:
            code, end = OK, k
            break
        if state[k, STATUS] == EXPANDED or visited[min(t, cap) * num_vertices + u] != (now << 32) | k:
            continue
        state[k, STATUS] = EXPANDED
        if u == goal and t >= earliest:
            more = np.int64(scratch.after[min(t, cap)]) if soft and stay else 0
            if more == 0:
                code, end = OK, k
                break
            if num_states + 8 >= len(state) or count >= len(heap):
                code = SCRATCH_FULL
                break
            s = num_states  # the robot may stay in the way, or go on
            num_states += 1
            state[s, VERTEX], state[s, STEP], state[s, BEFORE] = u, t, k
            state[s, DISTURBS], state[s, STATUS] = disturbs + more, FINISH
            open_at[f - base] += 1
            push(heap, count, (min(disturbs + more, 4095) << 51) | (min(f - base, 8191) << 38) | s)
            count += 1
        open_at[f - base] -= 1
        spent += 1
        if spent > budget:
            code = OUT_OF_BUDGET
            break
        step = t + 1
        slot = min(step, cap)
        lanes_end = first[u + 1]
        if num_states + (lanes_end - first[u]) + 8 >= len(state):
            code = SCRATCH_FULL
            break
        for lane in range(first[u], lanes_end + 1):
            v = head[lane] if lane < lanes_end else u
            to_go = np.int64(distance[v])
            if to_go >= UNREACHABLE:
                continue
            f = max(step + to_go, earliest)
            if f > latest or step >= closed_since[v]:
                continue
            if step <= last:
                found = blocked[step * num_vertices + v]
                if found >> 2 == stamp:
                    if found & 1:
                        continue
                    if u != v:
                        barred = False
                        for e in range(num_edges):
                            if edge[e, 0] == step and edge[e, 1] == u and edge[e, 2] == v:
                                barred = True
                        if barred:
                            continue
                if has_must:
                    must = must_be[step]
                    if must >> 32 == stamp and (must & 0xFFFFFFFF) != v:
                        continue
            if ban_u >= 0 and ((u == ban_u and v == ban_v) or (u == ban_v and v == ban_u)):
                continue
            new_disturbs = disturbs
            if soft:
                if parked[v] >= 0 and since[v] <= step:
                    new_disturbs += 1
                if step < horizon:
                    other = np.int64(someone[step * num_vertices + v])
                    while other:
                        new_disturbs += 1
                        other = np.int64(another[(other - 1) * horizon + step])
                    if u != v:
                        other = np.int64(someone[t * num_vertices + v])
                        while other:
                            record = installed[other - 1]
                            went = path[meta[record, PATH0] + min(step, meta[record, COST])]
                            if went == u or (following and went != v):
                                new_disturbs += 1
                            other = np.int64(another[(other - 1) * horizon + t])
                        if following:
                            other = np.int64(someone[step * num_vertices + u])
                            while other:
                                record = installed[other - 1]
                                if path[meta[record, PATH0] + min(t, meta[record, COST])] != v:
                                    new_disturbs += 1
                                other = np.int64(another[(other - 1) * horizon + step])
            cell = slot * num_vertices + v
            seen = visited[cell]
            if seen >> 32 == now:
                e = seen & 0xFFFFFFFF
                if state[e, STEP] < step:
                    continue
                if state[e, STEP] == step and (state[e, STATUS] == EXPANDED or state[e, DISTURBS] <= new_disturbs):
                    continue
                if state[e, STATUS] == WAITING:
                    open_at[max(state[e, STEP] + to_go, earliest) - base] -= 1
            while f > top:
                top += 1
                if top - base >= len(bucket):
                    return SCRATCH_FULL, -1, lower
                bucket[top - base] = 0
                open_at[top - base] = 0
            s = num_states
            num_states += 1
            state[s, VERTEX], state[s, STEP], state[s, BEFORE] = v, step, k
            state[s, DISTURBS], state[s, STATUS] = new_disturbs, WAITING
            visited[cell] = (now << 32) | s
            open_at[f - base] += 1
            if f <= bound:
                if count >= len(heap):
                    code = SCRATCH_FULL
                    break
                key = (min(new_disturbs, 4095) << 51) | (min(f - base, 8191) << 38) | (min(to_go, 8191) << 25)
                push(heap, count, key | s)
                count += 1
            else:
                state[s, NEXT] = bucket[f - base]
                bucket[f - base] = s + 1
        if code == SCRATCH_FULL:
            break
    number[EXPANSIONS] += spent
    return code, end, lower


@njit(cache=True)
def replan(world, store, occupancy, scratch, record, w, lower, soft, budget):
    """Find the path of a record under its constraints, and write it to the store.

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
        uninstall(world, store, occupancy, robot)
    distance = world.distance[world.row[robot]]
    code, end, bound = find_path(
        world, store, occupancy, scratch, world.start[robot], world.goal[robot], distance, w, lower, soft, True, -1, -1, budget
    )
    if code != OK:
        return code
    state = scratch.state
    if state[end, STATUS] == FINISH:
        end = state[end, BEFORE]
    cost = np.int64(state[end, STEP])
    begin = store.used[PATH]
    if begin + cost + 1 > len(store.path):
        return STORE_FULL
    k = end
    for t in range(cost, -1, -1):
        store.path[begin + t] = state[k, VERTEX]
        k = state[k, BEFORE]
    store.used[PATH] = begin + cost + 1
    store.meta[record, PATH0] = begin
    store.meta[record, COST] = cost
    store.meta[record, BOUND] = min(bound, cost)
    return OK
