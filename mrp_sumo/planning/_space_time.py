"""Kernels of search in space and time, for planners that replan one robot at a time under constraints.

A *record* is one robot's set of constraints and the path found under it. Records form chains: a record adds
rows to those of its parent. The *occupancy* says who is where and when, so that a search can count the robots
it would disturb (soft) while constraints forbid (hard). A search has two stages: the least cost by safe intervals
(Phillips, Likhachev, "SIPP", ICRA 2011), which the constraints cut; then, among the paths that cost at most w
times that, the one that disturbs fewest by best-first search on (vertex, step). This is the focal search of
Barer, Sharon, Stern, Felner, "Suboptimal variants of the conflict-based search algorithm", SoCS 2014, with the
lower bound known beforehand; with w = 1 it is A* that breaks ties by conflicts.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from mrp_sumo.planning._heap import pop, push
from mrp_sumo.planning._kernels import UNREACHABLE

FOREVER = 1 << 30
OK, NO_PATH, STORE_FULL, SCRATCH_FULL, TOO_LATE, OUT_OF_BUDGET = 0, 1, 2, 3, 4, 5  # what kernels return

PATIENCE = 500  # expansions that are always spent on disturbing few robots
HURRY = 8  # steps that a robot goes out of its way then to disturb one robot less

# columns of Store.meta
PARENT, ROW0, ROW1, ORIGIN, PATH0, COST, BOUND, MDD0, ROBOT = 0, 1, 2, 3, 4, 5, 6, 7, 8
# kinds of rows: (kind, vertex, tail, from step, to step)
RANGE, EDGE, MIN_COST, MAX_COST, MUST = 0, 1, 2, 3, 4
# entries of Store.used
RECORDS, ROWS, PATH, LEVELS, MEMBERS = 0, 1, 2, 3, 4
# columns of Scratch.state
VERTEX, STEP, BEFORE, DISTURBS, STATUS = 0, 1, 2, 3, 4
WAITING, EXPANDED, FINISH = 0, 1, 2
# entries of Scratch.number
STAMP, EXPANSIONS, NUM_CLOSED, NUM_EDGES, MARK = 0, 1, 2, 3, 4
# entries of Scratch.limit, what the constraints say
LAST, EARLIEST, LATEST, HAS_MUST, OPEN_FROM = 0, 1, 2, 3, 4


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
    touched: np.ndarray  # [V] int64, stamp of vertices with constraints for a time
    closed_since: np.ndarray  # [V] int32, forbidden from this step on
    closed: np.ndarray  # [V] int64, vertices of `closed_since` to clear
    edge: np.ndarray  # [E, 3] int32 forbidden moves (step of arrival, tail, head)
    state: np.ndarray  # [N, 5] int32
    heap: np.ndarray  # [H] int64
    after: np.ndarray  # [T] int32, visits of others at the goal from this step on
    mark: np.ndarray  # [V] int64, stamps of level sets
    queue: np.ndarray  # [V] int64
    reach: np.ndarray  # [V] int32, distance table of a corridor's end
    level: np.ndarray  # [M] int64 levels being built
    member: np.ndarray  # [Q] int32
    number: np.ndarray  # [8] int64
    limit: np.ndarray  # [5] int64


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
    last, earliest, latest, has_must, open_from = np.int64(0), np.int64(0), np.int64(FOREVER), 0, np.int64(0)
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
                    scratch.touched[v] = stamp
                    for t in range(begin, end + 1):
                        cell = t * num_vertices + v
                        old = scratch.blocked[cell]
                        scratch.blocked[cell] = (old | 1) if old >> 2 == stamp else (stamp << 2) | 1
                    if v == goal:
                        open_from = max(open_from, end + 1)
            elif kind == EDGE:
                if begin + 2 >= horizon:
                    return TOO_LATE
                if number[NUM_EDGES] >= len(scratch.edge):
                    return SCRATCH_FULL
                last = max(last, begin)
                scratch.touched[v] = stamp
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
                open_from = max(open_from, t + 1)
    if last_must_vertex >= 0 and last_must > latest and last_must_vertex != goal:
        return NO_PATH
    earliest = max(earliest, open_from)
    limit[LAST], limit[EARLIEST], limit[LATEST], limit[HAS_MUST], limit[OPEN_FROM] = last, earliest, latest, has_must, open_from
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
def earliest_arrival(world, scratch, start, goal, distance, stay, ban_u, ban_v, budget):
    """The least cost under the loaded constraints: safe intervals, as nobody but them is in the way.

    Parameters
    ----------
    world, scratch
        As above.
    start, goal
        Vertices.
    distance
        [V] steps to the goal.
    stay
        Whether the robot stays at the goal, so that the constraints on ending hold.
    ban_u, ban_v
        An edge that must not be used, in either direction; -1 for none.
    budget
        Expansions allowed.

    Returns
    -------
    code, cost, state
        OK, NO_PATH, SCRATCH_FULL or OUT_OF_BUDGET; the cost, a lower bound of it in the latter cases; the last
        state, from which `BEFORE` leads back, with waits left out.
    """
    num_vertices = len(world.first) - 1
    first, head = world.first, world.head
    number, limit, state, heap = scratch.number, scratch.limit, scratch.state, scratch.heap
    visited, blocked, closed_since, edge = scratch.visited, scratch.blocked, scratch.closed_since, scratch.edge
    must_be, touched = scratch.must, scratch.touched
    number[MARK] += 1
    now = number[MARK]
    stamp, num_edges = number[STAMP], number[NUM_EDGES]
    last, has_must = limit[LAST], limit[HAS_MUST]
    least = max(np.int64(distance[start]), limit[EARLIEST]) if stay else np.int64(distance[start])
    if distance[start] >= UNREACHABLE or least > limit[LATEST] or forbidden(world, scratch, start, start, 0):
        return NO_PATH, least, -1
    open_from = limit[OPEN_FROM] if stay else np.int64(0)
    state[0, VERTEX], state[0, STEP], state[0, BEFORE] = start, 0, -1
    visited[start] = now << 32
    num_states = 1
    push(heap, 0, np.int64(distance[start]) << 32)
    count = 1
    spent = 0
    code, end = NO_PATH, -1
    while count:
        key = pop(heap, count)
        count -= 1
        k = key & 0xFFFFFFFF
        u, t = np.int64(state[k, VERTEX]), np.int64(state[k, STEP])
        least = max(least, key >> 32) if stay else key >> 32
        if u == goal and t >= open_from:
            code, end = OK, k
            break
        spent += 1
        if spent > budget:
            code = OUT_OF_BUDGET
            break
        # until when the robot can stay at u
        until = np.int64(closed_since[u]) - 1
        if t <= last and (has_must or touched[u] == stamp):
            for step in range(t + 1, min(last, until) + 1):
                found = blocked[step * num_vertices + u]
                must = must_be[step] if has_must else 0
                if (found >> 2 == stamp and found & 1) or (must >> 32 == stamp and (must & 0xFFFFFFFF) != u):
                    until = step - 1
                    break
        for lane in range(first[u], first[u + 1]):
            v = head[lane]
            if distance[v] >= UNREACHABLE or (ban_u >= 0 and ((u == ban_u and v == ban_v) or (u == ban_v and v == ban_u))):
                continue
            latest = min(until + 1, np.int64(closed_since[v]) - 1)
            constrained = has_must or touched[v] == stamp
            arrive = t + 1
            while arrive <= latest:
                begin = np.int64(0)  # the first step of the interval of v that is entered
                if constrained and arrive <= last + 1:
                    while arrive <= last:  # the next step at which v may be entered from u
                        found = blocked[arrive * num_vertices + v]
                        barred = found >> 2 == stamp and found & 1 == 1
                        if found >> 2 == stamp and found & 2:
                            for e in range(num_edges):
                                if edge[e, 0] == arrive and edge[e, 1] == u and edge[e, 2] == v:
                                    barred = True
                        must = must_be[arrive] if has_must else 0
                        if not barred and not (must >> 32 == stamp and (must & 0xFFFFFFFF) != v):
                            break
                        arrive += 1
                    if arrive > latest:
                        break
                    begin = arrive
                    while begin > 0:
                        found = blocked[(begin - 1) * num_vertices + v]
                        must = must_be[begin - 1] if has_must else 0
                        if (found >> 2 == stamp and found & 1) or (must >> 32 == stamp and (must & 0xFFFFFFFF) != v):
                            break
                        begin -= 1
                elif constrained:
                    begin = last + 1
                cell = min(begin, last + 1) * num_vertices + v
                seen = visited[cell]
                if not (seen >> 32 == now and state[seen & 0xFFFFFFFF, STEP] <= arrive):
                    if num_states >= len(state) or count >= len(heap):
                        return SCRATCH_FULL, least, -1
                    state[num_states, VERTEX], state[num_states, STEP], state[num_states, BEFORE] = v, arrive, k
                    visited[cell] = (now << 32) | num_states
                    push(heap, count, ((arrive + distance[v]) << 32) | num_states)
                    num_states += 1
                    count += 1
                if not constrained or arrive > last:
                    break
                arrive += 1  # the next interval of v, if u can be held so long
                while arrive <= last:
                    found = blocked[arrive * num_vertices + v]
                    must = must_be[arrive] if has_must else 0
                    if (found >> 2 == stamp and found & 1) or (must >> 32 == stamp and (must & 0xFFFFFFFF) != v):
                        break
                    arrive += 1
                if arrive > last:
                    break
    number[EXPANSIONS] += spent
    if code == OK and stay and least > limit[LATEST]:
        code = NO_PATH
    return code, least, end


@njit(cache=True)
def find_path(world, store, occupancy, scratch, robot, least, bound, soft, budget):
    """The path of a cost of at most `bound` that disturbs fewest, under the loaded constraints.

    Parameters
    ----------
    world, store, occupancy, scratch
        As above; the searching robot is not installed.
    robot
        Who searches.
    least
        The least cost there is.
    bound
        The most that the path may cost.
    soft
        1 for the path that disturbs fewest, 2 for one that disturbs few: best first by steps to go and robots disturbed.
    budget
        Expansions allowed.

    Returns
    -------
    code, state
        OK and the last state, from which `BEFORE` leads back.
    """
    # arrays by themselves: to hand a tuple to a function in the inner loop counts references of all its arrays
    num_vertices = len(world.first) - 1
    horizon = len(scratch.must)
    start, goal, distance = world.start[robot], world.goal[robot], world.distance[world.row[robot]]
    first, head, following = world.first, world.head, world.following
    meta, path = store.meta, store.path
    someone, another, parked = occupancy.someone, occupancy.another, occupancy.parked
    since, installed = occupancy.since, occupancy.record
    number, limit, state, heap = scratch.number, scratch.limit, scratch.state, scratch.heap
    visited, blocked, closed_since, edge, must_be = scratch.visited, scratch.blocked, scratch.closed_since, scratch.edge, scratch.must
    number[MARK] += 1
    now = number[MARK]
    stamp = number[STAMP]
    last, earliest, latest = limit[LAST], limit[EARLIEST], min(limit[LATEST], bound)
    has_must, num_edges = limit[HAS_MUST], number[NUM_EDGES]
    cap = max(last, earliest)
    for other in range(len(installed)):
        if installed[other] >= 0:
            cap = max(cap, meta[installed[other], COST])
    cap += 1  # from this step on nothing changes
    if cap + 1 >= horizon:
        return TOO_LATE, -1
    visits = 0
    for t in range(cap, min(np.int64(distance[start]), cap) - 1, -1):
        other = np.int64(someone[t * num_vertices + goal])
        while other:
            visits += 1
            other = np.int64(another[(other - 1) * horizon + t])
        scratch.after[t] = visits
    state[0, VERTEX], state[0, STEP], state[0, BEFORE], state[0, DISTURBS], state[0, STATUS] = start, 0, -1, 0, WAITING
    visited[start] = now << 32
    num_states = 1
    push(heap, 0, np.int64(0))
    count = 1
    spent = 0
    code, end = NO_PATH, -1
    while count:
        key = pop(heap, count)
        count -= 1
        k = key & 0x1FFFFFF
        if state[k, STATUS] == FINISH:
            code, end = OK, k
            break
        u, t = np.int64(state[k, VERTEX]), np.int64(state[k, STEP])
        if visited[min(t, cap) * num_vertices + u] != (now << 32) | k:
            continue
        disturbs = np.int64(state[k, DISTURBS])
        state[k, STATUS] = EXPANDED
        if num_states + first[u + 1] - first[u] + 8 >= len(state) or count + first[u + 1] - first[u] + 8 >= len(heap):
            code = SCRATCH_FULL
            break
        if u == goal and t >= earliest:
            more = np.int64(scratch.after[min(t, cap)])
            if more == 0:
                code, end = OK, k
                break
            # the robot may stay in the way, or go on
            state[num_states, VERTEX], state[num_states, STEP], state[num_states, BEFORE] = u, t, k
            state[num_states, DISTURBS], state[num_states, STATUS] = disturbs + more, FINISH
            if soft == 2:
                push(heap, count, (min(HURRY * (disturbs + more), (1 << 38) - 1) << 25) | num_states)
            else:
                push(heap, count, (min(disturbs + more, 4095) << 51) | (min(max(t, least) - least, 8191) << 38) | num_states)
            num_states += 1
            count += 1
        spent += 1
        if spent > budget:
            code = OUT_OF_BUDGET
            break
        step = t + 1
        row = min(step, cap) * num_vertices
        lanes_end = first[u + 1]
        for lane in range(first[u], lanes_end + 1):
            v = head[lane] if lane < lanes_end else u
            to_go = np.int64(distance[v])
            if step + to_go > latest or step >= closed_since[v]:
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
            new_disturbs = disturbs
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
            seen = visited[row + v]
            if seen >> 32 == now:
                e = seen & 0xFFFFFFFF
                if state[e, STEP] < step:
                    continue
                if state[e, STEP] == step and (state[e, STATUS] == EXPANDED or state[e, DISTURBS] <= new_disturbs):
                    continue
            state[num_states, VERTEX], state[num_states, STEP], state[num_states, BEFORE] = v, step, k
            state[num_states, DISTURBS], state[num_states, STATUS] = new_disturbs, WAITING
            visited[row + v] = (now << 32) | num_states
            if soft == 2:
                key = min(to_go + HURRY * new_disturbs, (1 << 38) - 1) << 25
            else:
                key = (min(new_disturbs, 4095) << 51) | (min(max(step + to_go, least) - least, 8191) << 38) | (min(to_go, 8191) << 25)
            push(heap, count, key | num_states)
            num_states += 1
            count += 1
    number[EXPANSIONS] += spent
    return code, end


@njit(cache=True)
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
        uninstall(world, store, occupancy, robot)
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
        code, end = find_path(world, store, occupancy, scratch, robot, least, bound, 1, polite)
        if code == OUT_OF_BUDGET:
            code, end = find_path(world, store, occupancy, scratch, robot, least, bound, 2, polite)
        if code == OK:
            if state[end, STATUS] == FINISH:
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
