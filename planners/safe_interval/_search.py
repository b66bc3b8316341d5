"""Kernels of safe interval planning by runs: the earliest way of one robot among reservations, and what is left of it without others.

At rest a robot may wait, so of two arrivals at a vertex by one lane within one safe interval the earlier is as good as the later: a state
is a lane and a safe interval of its head (Phillips, Likhachev, ICRA 2011). Moves are a turn and a run of any number of lanes. Only when
to set out is free: all that a run needs is taken and left at fixed steps after it, so that each reservation forbids an interval of steps.
States are expanded in part (Yoshizumi, Miura, Ishida, AAAI 2000): first by the rays that could be best, then by the runs of each ray
that could be.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._heap import pop, push
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._records import FOREVER, NO_PATH, OK, OUT_OF_BUDGET, SCRATCH_FULL
from planners.safe_interval._rays import STRAIGHT_RAD, steps_of_last_turn, steps_of_turn
from planners.safe_interval._table import ReservationTable, first_after, next_begin
from planners.safe_interval.moves import Moves

GUARD = 2  # steps before which what is needed is taken
FAR = 1 << 29  # no way to the goal
LAST_ENTRY = 0xFFFFFF
NEVER = 1 << 22  # steps no plan takes
ROUNDED = 2  # steps by which two runs may differ from what they take without steps
AT_ONCE = 40  # runs that are worse by so many steps are looked at together
EXPAND, TURN = -1, -2
MOST_GAPS = 64
MOST_PENDING = 1024
STATES_A_LANE = 16  # for which there is room where a search looks for a way that acceleration does not delay
LONG = 300  # entries after which a search looks whether there is any way at all

# ray: or EXPAND, the state itself, or TURN, its last turn; lanes: of the run, 0: any; bound, step: from which on
ENTRY = np.dtype((np.record, [(name, np.int64) for name in ("state", "ray", "lanes", "bound", "step")]))
ARRIVAL = np.dtype((np.record, [(name, np.int64) for name in ("search", "step", "until")]))


class IntervalScratch(NamedTuple):
    """Room for a search of N states, E entries and a table of H places."""

    lane: np.ndarray  # [N] by which the robot came, -1: it has not moved
    arrived: np.ndarray  # [N] step
    until: np.ndarray  # [N] the end of the safe interval
    parent: np.ndarray  # [N]
    ray: np.ndarray  # [N] the first lane of the run that led here, and its number of lanes
    lanes: np.ndarray  # [N]
    left: np.ndarray  # [N] step at which it set out
    entry: np.ndarray  # [E] ENTRY
    heap: np.ndarray  # [E]
    key: np.ndarray  # [H] of each state
    place: np.ndarray  # [H] its number
    stamp: np.ndarray  # [H] the search that wrote it
    searches: np.ndarray  # [1]
    gap: np.ndarray  # [4, MOST_GAPS] steps from which on and until when the robot may set out; room for those still to be split
    pending: np.ndarray  # [2, MOST_PENDING] resource, and the step at which it is taken
    pending_m: np.ndarray  # [MOST_PENDING] where along the ray it is left
    seen: np.ndarray  # [L] ARRIVAL, of the last state at the end of each lane, or of one alike
    soonest: np.ndarray  # [L] step after which the robot may be at the end of each lane, of `is_shut_in`
    queue: np.ndarray  # [L] its lanes that come next, -1: they do not
    work: np.ndarray  # [5] states and entries so far, over all searches; of `find` when the goal is free for ever, `latest`, last turn


class Trip(NamedTuple):
    """Places of a robot: where it is, and where it is to stand."""

    start: int
    start_heading: float  # rad, NaN where the robot is turned as it sets out
    goal: int
    goal_heading: float  # rad, to which it turns at its goal, NaN where it stays as it comes


class RunGround(NamedTuple):
    """Ground of a search: the moves of a robot on L lanes, what others hold, and what is left to the goal, see `steps_left`."""

    moves: Moves
    table: ReservationTable
    at_rest: np.ndarray  # [L] int32
    facing: np.ndarray  # [L] int32
    weight: float  # the way takes at most so many times the steps of the earliest one


def new_scratch(states: int, num_lanes: int) -> IntervalScratch:
    """Room for so many states, and four times as many entries, on a graph of so many lanes."""
    index = [np.zeros(states, np.int64) for _ in range(7)]
    places = 1 << (4 * states - 1).bit_length()
    return IntervalScratch(
        *index,
        entry=np.zeros(4 * states, ENTRY),
        heap=np.zeros(4 * states, np.int64),
        key=np.zeros(places, np.int64),
        place=np.zeros(places, np.int64),
        stamp=np.zeros(places, np.int64),
        searches=np.zeros(1, np.int64),
        gap=np.zeros((4, MOST_GAPS), np.int64),
        pending=np.zeros((2, MOST_PENDING), np.int64),
        pending_m=np.zeros(MOST_PENDING),
        seen=np.zeros(num_lanes, ARRIVAL),
        soonest=np.zeros(num_lanes, np.int64),
        queue=np.zeros(num_lanes, np.int64),
        work=np.zeros(5, np.int64),
    )


@kernel
def steps_left(moves, end, at_rest, facing, lanes_best, stack, heap):
    """Steps to the goal without others: `at_rest` [L] after each lane, `facing` [L] at its tail and turned towards it.

    `end` are the goal and the heading there, NaN where any will do; `lanes_best` [L] and `stack` [L + 1] are scratch. Returns False where
    the heap has no room.

    Where all lanes have one speed limit, a longer run takes fewer steps for each lane more, and no run fewer than at top speed. So where
    a run along a ray is no better than a longer one, neither is it from any place behind; nor where it is worse than a shorter one by
    more than the latter has saved by not driving at top speed yet.
    """
    goal, goal_heading = end
    at_rest[:] = FAR
    facing[:] = FAR
    count = 0
    for k in range(moves.first_in[goal], moves.first_in[goal + 1]):
        lane = moves.lane_in[k]
        if moves.alike[lane] == lane:
            at_rest[lane] = steps_of_last_turn(goal_heading - moves.heading_rad[lane], moves.turn_rad)
            push(heap, count, (np.int64(at_rest[lane]) << 32) | lane)
            count += 1
    while count:
        key = pop(heap, count)
        count -= 1
        steps, end = key >> 32, key & 0xFFFFFFFF
        if steps != at_rest[end]:
            continue
        depth, v = 0, moves.head[end]
        for k in range(moves.first_in[v], moves.first_in[v + 1]):
            if moves.alike[moves.lane_in[k]] == end:
                at_rest[moves.lane_in[k]] = steps
                stack[depth] = (moves.lane_in[k] << 32) | 1
                depth += 1
        while depth:
            depth -= 1
            ray, lanes = stack[depth] >> 32, stack[depth] & 0xFFFFFFFF
            if lanes > moves.length[ray]:
                continue
            run = moves.run_first[moves.course[ray]] + lanes - 1
            now = steps + moves.time[run]
            if now >= facing[ray]:
                if moves.concave:
                    best = run - lanes + lanes_best[ray]
                    saved = moves.time[run] - moves.time[best] - (moves.end_m[run] - moves.end_m[best]) * moves.steps_per_m
                    if best >= run or now - facing[ray] > saved + ROUNDED:
                        continue
            else:
                facing[ray] = now
                lanes_best[ray] = lanes
                v = moves.tail[ray]
                for k in range(moves.first_in[v], moves.first_in[v + 1]):
                    lane = moves.lane_in[k]
                    turned = now + moves.turn[moves.turn_first[lane] + ray - moves.first[v]]
                    if turned < at_rest[lane] and moves.alike[lane] == lane:
                        at_rest[lane] = turned
                        if count >= len(heap):
                            return False
                        push(heap, count, (turned << 32) | lane)
                        count += 1
            for k in range(moves.behind_first[ray], moves.behind_first[ray + 1]):
                if depth < len(stack):
                    stack[depth] = (moves.behind[k] << 32) | (lanes + 1)
                    depth += 1
    return True


@kernel
def step_at(moves, ray, at_m):
    """The step after which a robot that drives along a ray without end is at a place or beyond."""
    a = moves.along_first[moves.course[ray]]
    b = moves.along_first[moves.course[ray] + 1]
    begin = a
    while a < b:
        m = (a + b) >> 1
        if moves.along_m[m] >= at_m:
            b = m
        else:
            a = m + 1
    return a - begin


@kernel
def step_of_run(moves, ray, lanes, at_m):
    """The same of a run of so many lanes."""
    run = moves.run_first[moves.course[ray]] + lanes - 1
    brake, time = moves.brake[run], moves.time[run]
    begin = moves.along_first[moves.course[ray]]
    if moves.along_m[begin + brake] >= at_m:
        return step_at(moves, ray, at_m)
    tail = moves.tail_first[run] - brake
    a, b = brake + 1, time
    while a < b:
        m = (a + b) >> 1
        if moves.tail_m[tail + m] >= at_m:
            b = m
        else:
            a = m + 1
    return a


@kernel
def taken_at(moves, ray, lanes):
    """The step at which a robot has to be let on to the last of so many lanes of a ray."""
    return 0 if lanes == 1 else moves.brake[moves.run_first[moves.course[ray]] + lanes - 2]


@kernel
def safe_until(moves, table, v):
    """The end of the safe interval of a vertex that step 0 is in; 0 or less if it is not in one."""
    until = FOREVER
    for k in range(moves.at_first[v], moves.at_first[v + 1]):
        until = min(until, next_begin(table, moves.at[k], 0))
    return until


@kernel
def free_for_ever(moves, table, v):
    """The step from which on nobody else needs a vertex, FOREVER if somebody stays."""
    free = 0
    for k in range(moves.at_first[v], moves.at_first[v + 1]):
        q = moves.at[k]
        if table.count[q]:
            free = max(free, table.end[table.row[q] + table.count[q] - 1])
    return free


@kernel
def without(table, q, taken, left, gap, num):
    """Take away from the gaps what a reservation of a resource forbids that is needed from `taken` until `left`. Returns their number."""
    count = 0
    last = table.row[q] + table.count[q]
    for i in range(num):  # each gap is read before anything is written in its place, but for those that split
        low, high = gap[0, i], gap[1, i]
        k = first_after(table, q, low + taken)
        if k >= last or table.begin[k] - left >= high:
            gap[0, count] = low
            gap[1, count] = high
            count += 1
            continue
        return split(table, q, (taken, left), gap, num, i, count)
    return count


@kernel(inline="always")
def is_held_after(table, q, t):
    """True if somebody holds a resource after step t."""
    last = table.row[q] + table.count[q] - 1
    return last >= table.row[q] and table.end[last] > t


@kernel
def split(table, q, needed, gap, num, i, count):
    """The rest of `without`, from gap i on, where some has to be taken away."""
    taken, left = needed
    for j in range(i, num):
        gap[2, j] = gap[0, j]
        gap[3, j] = gap[1, j]
    last = table.row[q] + table.count[q]
    for j in range(i, num):
        low, high = gap[2, j], gap[3, j]
        k = first_after(table, q, low + taken)
        while low <= high and count < MOST_GAPS:
            if k >= last or table.begin[k] - left >= high:
                gap[0, count] = low
                gap[1, count] = high
                count += 1
                break
            if table.begin[k] - left >= low:
                gap[0, count] = low
                gap[1, count] = table.begin[k] - left
                count += 1
            low = max(low, table.end[k] - taken)
            k += 1
    return count


@kernel
def holds(array, begin, end, q):
    """True if q is in a part of an array."""
    for k in range(begin, end):  # noqa: SIM110  numba knows no any()
        if array[k] == q:
            return True
    return False


@kernel
def latest_start(moves, table, scratch, state, ray, lanes):
    """The last step at which a robot in this state may set out on a run: it is off its vertex before that is reserved."""
    came_by, t, v = scratch.lane[state], scratch.arrived[state], moves.tail[ray]
    latest = FOREVER
    for i in range(moves.at_first[v + 1] - moves.at_first[v]):
        q = moves.at[moves.at_first[v] + i]
        begin = next_begin(table, q, t)
        if begin < FOREVER:
            latest = min(latest, begin - step_of_run(moves, ray, lanes, moves.off_m[moves.off_first[ray] + i]))
    if came_by >= 0:  # what both the lane there and the next visit need stays the robot's in between
        w = moves.head[ray]
        t = scratch.left[state] + taken_at(moves, scratch.ray[state], scratch.lanes[state]) - GUARD
        for k in range(moves.on_first[came_by], moves.on_first[came_by + 1]):
            q = moves.on[k]
            if holds(moves.on, moves.on_first[ray], moves.on_first[ray + 1], q) or holds(
                moves.at, moves.at_first[w], moves.at_first[w + 1], q
            ):
                latest = min(latest, next_begin(table, q, t))
    return latest


@kernel(allocates=True)
def find(ground, trip, most, latest, scratch):
    """The earliest way to a goal, to stay, for a robot that stands at its start from step 0 on.

    Parameters
    ----------
    most
        Entries to look at before the search is given up.
    latest
        Step after which it is of no use to be there.

    Returns
    -------
    code, state
        OK and the last state, NO_PATH, SCRATCH_FULL or OUT_OF_BUDGET. The steps of the last turn are in `scratch.work[4]`.
    """
    (moves, table, at_rest, facing, weight), (start, start_heading, goal, goal_heading) = ground, trip
    scratch.searches[0] += 1
    until = safe_until(moves, table, start)
    if until <= 0:
        return NO_PATH, 0
    scratch.lane[0] = -1
    scratch.arrived[0] = 0
    scratch.until[0] = until
    scratch.parent[0] = -1
    scratch.work[2] = free_for_ever(moves, table, goal)
    scratch.work[3] = min(latest, NEVER - 1)
    if scratch.work[2] > scratch.work[3]:
        return NO_PATH, 0
    scratch.work[4] = 0
    if start == goal and until >= FOREVER:
        scratch.work[4] = steps_of_last_turn(goal_heading - start_heading, moves.turn_rad)
        if scratch.work[4] == 0:
            return OK, 0
    scratch.entry[0].state, scratch.entry[0].ray = 0, EXPAND
    push(scratch.heap, 0, LAST_ENTRY)
    states = entries = count = 1
    if scratch.work[4]:
        entries, count = push_last_turn(scratch, 0, 0, scratch.work[4], weight, entries, count)
    mask = len(scratch.key) - 1
    now = scratch.searches[0]
    looked = 0
    while count:
        key = pop(scratch.heap, count)
        count -= 1
        e = LAST_ENTRY - (key & LAST_ENTRY)
        state, ray = scratch.entry[e].state, scratch.entry[e].ray
        lane, arrived = scratch.lane[state], scratch.arrived[state]
        looked += 1
        if looked == LONG and (is_cut_off(ground, start, goal) if moves.many_states else is_shut_in(ground, scratch, start, goal)):
            scratch.work[1] += looked
            return NO_PATH, 0
        if looked > most:
            scratch.work[1] += looked
            return OUT_OF_BUDGET, 0
        if ray == TURN:
            scratch.work[0] += states
            scratch.work[1] += looked
            scratch.work[4] = scratch.entry[e].step
            return OK, state
        if ray == EXPAND:
            if lane >= 0:
                v = moves.head[lane]
                h = key_place(scratch, state_key(moves.alike[lane], scratch.until[state]), now, mask)
                if scratch.place[h] != state:
                    continue  # reached earlier meanwhile
                if v == goal and scratch.until[state] >= FOREVER:
                    last_turn = steps_of_last_turn(goal_heading - moves.heading_rad[lane], moves.turn_rad)
                    if last_turn <= at_rest[lane]:
                        scratch.work[0] += states
                        scratch.work[1] += looked
                        scratch.work[4] = last_turn
                        return OK, state
                    # it would be sooner to come again by another lane, if nobody is in the way
                    entries, count = push_last_turn(scratch, state, arrived, last_turn, weight, entries, count)
            else:
                v = start
            for out in range(moves.first[v], moves.first[v + 1]):
                if facing[out] >= FAR or entries >= len(scratch.entry):
                    continue
                if lane >= 0:
                    turn = moves.turn[moves.turn_first[lane] + out - moves.first[v]]
                else:
                    turn = steps_of_turn(moves.heading_rad[out] - start_heading, moves.turn_rad)
                if arrived + turn > latest_start(moves, table, scratch, state, out, moves.length[out]):
                    continue
                bound = arrived + turn + facing[out]
                if bound > scratch.work[3]:
                    continue
                rank = priority(arrived, turn + facing[out], weight, scratch.work[2])
                entries, count = push_entry(scratch, (state, out, 0), bound, arrived + turn, rank, entries, count)
            continue
        if entries + 4 * moves.length[ray] + 64 >= len(scratch.entry) or states + 2 * moves.length[ray] + 64 >= len(scratch.lane):
            return SCRATCH_FULL, 0
        states, entries, count = expand_ray(ground, scratch, e, states, entries, count)
    scratch.work[0] += states
    scratch.work[1] += looked
    return NO_PATH, 0


@kernel
def is_shut_in(ground, scratch, start, goal):
    """True if on every way to a goal others stay for ever before the robot can have passed, even at its highest speed all along."""
    moves, facing, soonest, queue = ground.moves, ground.facing, scratch.soonest, scratch.queue
    soonest[:] = FAR
    queue[:] = -1
    end = len(queue)
    first, last, v, at = end, end, start, np.int64(0)
    while True:
        for out in range(moves.first[v], moves.first[v + 1]):
            there = at + np.int64(moves.end_m[moves.run_first[moves.course[out]]] * moves.steps_per_m)
            if facing[out] >= FAR or there >= soonest[out] or is_closed_by(ground, out, at, there):
                continue
            if moves.head[out] == goal:
                return False
            soonest[out] = there
            if queue[out] < 0:
                queue[out] = end
                if first == end:
                    first = out
                else:
                    queue[last] = out
                last = out
        if first == end:
            return True
        lane = first
        first, queue[lane] = queue[lane], -1
        v, at = moves.head[lane], soonest[lane]


@kernel(allocates=True)
def is_cut_off(ground, start, goal):
    """True if no way to a goal leads through times at which others leave it free, for a robot that brakes and accelerates at once.

    States are lanes and safe intervals, as in `find`, each with the least steps at which it can be taken, and arrived at. A robot leaves a
    stop from rest; where it goes straight on it may be at its highest speed. For vehicles, whose searches have so many states to look at
    that `is_shut_in` would tell too little; False, too, where there are more than there is room for.
    """
    moves, table, facing, steps_per_m = ground.moves, ground.table, ground.facing, ground.moves.steps_per_m
    most = STATES_A_LANE * len(moves.head)
    newest, queue = np.full(len(moves.head), -1, np.int64), np.empty(most, np.int64)
    lane_of, until, taken, arrived, before = np.empty((5, most), np.int64)
    is_queued = np.zeros(most, np.bool_)
    lane_of[0], until[0], taken[0], arrived[0] = -1, safe_until(moves, table, start), 0, 0
    queue[0] = 0
    begin, size, count = 0, 1, 1
    while size:
        state = queue[begin]
        begin, size = (begin + 1) % most, size - 1
        is_queued[state] = False
        came_by = lane_of[state]
        v = start if came_by < 0 else moves.head[came_by]
        for out in range(moves.first[v], moves.first[v + 1]):
            if facing[out] >= FAR:
                continue
            w, end_m = moves.head[out], moves.end_m[moves.run_first[moves.course[out]]]
            off_m = moves.off_m[moves.off_first[out] : moves.off_first[out + 1]].min()
            ready, off, there = arrived[state], np.int64(off_m * steps_per_m), np.int64(end_m * steps_per_m)
            if came_by < 0 or not _goes_straight(moves, came_by, out):
                ready += moves.turn[moves.turn_first[came_by] + out - moves.first[v]] if came_by >= 0 else 0
                off, there = step_at(moves, out, off_m), step_at(moves, out, end_m)
            at = taken[state]
            while max(at, ready) + off <= until[state]:
                free, end = _free_from(moves, table, out, at, max(at, ready), there)
                if free > at:
                    at = free
                    continue
                if w == goal and end >= FOREVER:
                    return False
                lane = moves.alike[out]
                k = newest[lane]
                while k >= 0 and until[k] != end:
                    k = before[k]
                if k < 0:
                    if count == most:
                        return False
                    k, count = count, count + 1
                    lane_of[k], until[k], taken[k], arrived[k], before[k] = lane, end, FOREVER, FOREVER, newest[lane]
                    newest[lane] = k
                arrives = max(at, ready) + there
                if at < taken[k] or arrives < arrived[k]:
                    taken[k], arrived[k] = min(at, taken[k]), min(arrives, arrived[k])
                    if not is_queued[k]:
                        is_queued[k] = True
                        queue[(begin + size) % most] = k
                        size += 1
                at = end + 1
    return True


@kernel(inline="always")
def _goes_straight(moves, came_by, out):
    """True if a run may go on from a lane to the next."""
    bend = (moves.heading_rad[out] - moves.heading_rad[came_by] + np.pi) % (2 * np.pi) - np.pi
    return abs(bend) <= STRAIGHT_RAD + 1e-6


@kernel
def _free_from(moves, table, lane, at, leaves, takes):
    """(when a lane and its head are free, which is `at` or later; the end of the head's safe interval if it is `at`).

    A robot takes both at step `at`, is on the lane from step `leaves` on, and at its head `takes` steps later.
    """
    free, until, v = at, FOREVER, moves.head[lane]
    for k in range(moves.on_first[lane], moves.on_first[lane + 1]):
        q = moves.on[k]
        j = first_after(table, q, at)
        if j < table.row[q] + table.count[q] and table.begin[j] < leaves + np.int64(moves.on_m[k] * moves.steps_per_m):
            free = max(free, table.end[j])
    for k in range(moves.at_first[v], moves.at_first[v + 1]):
        q = moves.at[k]
        j = first_after(table, q, at)
        if j < table.row[q] + table.count[q]:
            if table.begin[j] <= leaves + takes:
                free = max(free, table.end[j])
            else:
                until = min(until, table.begin[j])
    return free, until


@kernel(inline="always")
def is_closed_by(ground, lane, at, there):
    """True if what a lane needs is held for ever from the step on at which the robot may be at its tail, or what its head needs."""
    moves, table = ground.moves, ground.table
    v = moves.head[lane]
    for k in range(moves.on_first[lane], moves.on_first[lane + 1]):
        if stays_from(table, moves.on[k]) <= at:
            return True
    for k in range(moves.at_first[v], moves.at_first[v + 1]):  # noqa: SIM110  numba knows no any()
        if stays_from(table, moves.at[k]) <= there:
            return True
    return False


@kernel(inline="always")
def stays_from(table, q):
    """The step from which on somebody holds a resource for ever, FOREVER if nobody does."""
    last = table.row[q] + table.count[q] - 1
    return table.begin[last] if last >= table.row[q] and table.end[last] >= FOREVER else FOREVER


@kernel(inline="always")
def priority(spent, left, weight, floor):
    """Priority by which a state is expanded: when the robot can be at its goal, which is not before that is free; then what is left."""
    return (np.int64(min(max(spent + np.int64(weight * left), floor), NEVER)) << 16) | np.int64(min(left, 0xFFFF))


@kernel(inline="always")
def push_entry(scratch, run, bound, step, rank, entries, count):
    """Add an entry, for which there is room, by its `priority`. A run is a state, a ray and a number of lanes."""
    entry = scratch.entry[entries]
    entry.state, entry.ray, entry.lanes = run
    entry.bound, entry.step = bound, step
    push(scratch.heap, count, (rank << 24) | (LAST_ENTRY - entries))
    return entries + 1, count + 1


@kernel(inline="always")
def push_last_turn(scratch, state, arrived, turn, weight, entries, count):
    """Add an entry for a robot that stays at its goal and turns there, if that is of use and there is room."""
    if arrived + turn > scratch.work[3] or entries >= len(scratch.entry):
        return entries, count
    return push_entry(scratch, (state, TURN, 0), 0, turn, priority(arrived, turn, weight, scratch.work[2]), entries, count)


@kernel(inline="always")
def state_key(lane, until):
    """A state as a number."""
    return (lane << 31) | until


@kernel
def key_place(scratch, key, now, mask):
    """Index of a state in the table of states, there or not."""
    h = ((key >> 31) * 2654435761 + (key & 0x7FFFFFFF) * 40503) & mask
    while scratch.stamp[h] == now and scratch.key[h] != key:
        h = (h + 1) & mask
    return h


@kernel
def expand_ray(ground, scratch, e, states, entries, count):
    """Add the states at the ends of those runs of a ray that could be the best by now, and an entry for the others."""
    moves, table, at_rest, weight, now = ground.moves, ground.table, ground.at_rest, ground.weight, scratch.searches[0]
    state, ray, only = scratch.entry[e].state, scratch.entry[e].ray, scratch.entry[e].lanes
    bound, ready = scratch.entry[e].bound, scratch.entry[e].step
    arrived = scratch.arrived[state]
    first_run = moves.run_first[moves.course[ray]]
    last, following = 0, FAR
    worst = min(bound + AT_ONCE, scratch.work[3])
    if only:
        last = only
    else:
        lane = ray
        for lanes in range(1, moves.length[ray] + 1):
            if at_rest[lane] < FAR:
                reached = ready + moves.time[first_run + lanes - 1] + at_rest[lane]
                if bound <= reached <= worst:
                    last = lanes
                elif reached > worst and reached < following:
                    following = reached
            lane = moves.onward[lane]
    gap = scratch.gap
    gap[0, 0] = ready
    gap[1, 0] = latest_start(moves, table, scratch, state, ray, moves.length[ray])
    num = 1 if gap[0, 0] <= gap[1, 0] else 0
    pending, pending_m, waiting = scratch.pending, scratch.pending_m, 0
    lane, before = ray, -1
    taken, taken_before = -GUARD, -GUARD
    begin_m = 0.0
    for lanes in range(1, last + 1):
        run = first_run + lanes - 1
        end_m = moves.end_m[run]
        if lanes > 1:
            taken_before = taken
            taken = moves.brake[run - 1] - GUARD
            v = moves.tail[lane]  # what its vertex needs is left on this lane
            for i in range(moves.at_first[v + 1] - moves.at_first[v]):
                q = moves.at[moves.at_first[v] + i]
                pending[0, waiting] = q
                pending[1, waiting] = taken_before
                if before >= 0 and holds(moves.on, moves.on_first[before], moves.on_first[before + 1], q):
                    pending[1, waiting] = min(taken_before, taken_at(moves, ray, lanes - 2) - GUARD)
                pending_m[waiting] = begin_m + moves.off_m[moves.off_first[lane] + i]
                waiting += 1
        for k in range(moves.on_first[lane], moves.on_first[lane + 1]):
            pending[0, waiting] = moves.on[k]
            pending[1, waiting] = taken
            pending_m[waiting] = begin_m + moves.on_m[k]
            waiting += 1
        if waiting > MOST_PENDING - 256:
            break
        brake_m = moves.along_m[moves.along_first[moves.course[ray]] + moves.brake[run]]
        left = 0
        for i in range(waiting):  # what is left before the robot could brake is left at that step by all longer runs too
            if pending_m[i] <= brake_m:
                if num and is_held_after(table, pending[0, i], gap[0, 0] + pending[1, i]):
                    num = without(table, pending[0, i], pending[1, i], step_at(moves, ray, pending_m[i]), gap, num)
            else:
                pending[0, left] = pending[0, i]
                pending[1, left] = pending[1, i]
                pending_m[left] = pending_m[i]
                left += 1
        waiting = left
        if num == 0:
            return states, entries, count
        reached = ready + moves.time[run] + at_rest[lane]
        if at_rest[lane] < FAR and (only == lanes or (only == 0 and bound <= reached <= worst)):
            earliest = gap[0, 0] + moves.time[run]
            seen = scratch.seen[moves.alike[lane]]
            if seen.search == now and seen.step <= earliest < seen.until:  # no better than that one
                later = seen.until + 1 - taken
                if later <= gap[1, num - 1]:
                    takes = moves.time[run], np.int64(at_rest[lane])
                    entries, count = push_later(scratch, (state, ray, lanes), later, takes, weight, entries, count)
            else:
                sizes = states, entries, count
                states, entries, count = arrive(ground, scratch, (state, ray, lanes), taken, num, waiting, sizes)
        begin_m = end_m
        before = lane
        lane = moves.onward[lane]
    if following <= scratch.work[3]:
        rank = priority(arrived, following - arrived, weight, scratch.work[2])
        entries, count = push_entry(scratch, (state, ray, 0), following, ready, rank, entries, count)
    return states, entries, count


@kernel
def arrive(ground, scratch, stretch, taken, num, waiting, sizes):
    """Add the earliest state at the end of one run, and an entry for the later ones.

    Parameters
    ----------
    stretch
        State, ray and number of lanes.
    taken
        Step of the run at which its last lane is taken.
    num, waiting
        How many gaps there are, and resources that are held at the end of the run.
    sizes
        Numbers of states, entries and keys of the heap, which are returned as they are then.
    """
    (moves, table, at_rest, _, weight), (state, ray, lanes), (states, entries, count) = ground, stretch, sizes
    now, mask = scratch.searches[0], len(scratch.key) - 1
    run = moves.run_first[moves.course[ray]] + lanes - 1
    lane = ray
    for _ in range(lanes - 1):
        lane = np.int64(moves.onward[lane])
    time, v = moves.time[run], moves.head[lane]
    latest = latest_start(moves, table, scratch, state, ray, lanes)
    gap, pending, pending_m = scratch.gap, scratch.pending, scratch.pending_m
    for i in range(num):
        at = gap[0, i]
        high = min(gap[1, i], latest)
        while at <= high:
            moved = False
            for k in range(waiting):
                q = pending[0, k]
                if not is_held_after(table, q, at + pending[1, k]):
                    continue
                j = first_after(table, q, at + pending[1, k])
                if table.begin[j] < at + time and table.begin[j] < at + step_of_run(moves, ray, lanes, pending_m[k]):
                    at = table.end[j] - pending[1, k]
                    moved = True
            until = FOREVER
            for k in range(moves.at_first[v], moves.at_first[v + 1]):
                q = moves.at[k]
                j = first_after(table, q, at + taken)
                if j < table.row[q] + table.count[q]:
                    if table.begin[j] <= at + time:
                        at = table.end[j] - taken
                        moved = True
                    else:
                        until = min(until, table.begin[j])
            if moved:
                continue
            if at > high:
                break
            there = at + time
            if there + at_rest[lane] > scratch.work[3]:
                break
            key = state_key(moves.alike[lane], until)
            h = key_place(scratch, key, now, mask)
            if scratch.stamp[h] != now or there < scratch.arrived[scratch.place[h]]:
                scratch.stamp[h] = now
                scratch.key[h] = key
                scratch.place[h] = states
                scratch.lane[states] = lane
                scratch.arrived[states] = there
                scratch.until[states] = until
                scratch.parent[states] = state
                scratch.ray[states] = ray
                scratch.lanes[states] = lanes
                scratch.left[states] = at
                rank = priority(there, np.int64(at_rest[lane]), weight, scratch.work[2])
                entries, count = push_entry(scratch, (states, EXPAND, 0), 0, 0, rank, entries, count)
                seen = scratch.seen[moves.alike[lane]]
                seen.search, seen.step, seen.until = now, there, until
                states += 1
            later = until + 1 - taken  # at the earliest: what ends the safe interval takes a step at least
            if later <= latest and until < FOREVER:
                entries, count = push_later(scratch, stretch, later, (time, np.int64(at_rest[lane])), weight, entries, count)
            return states, entries, count
    return states, entries, count


@kernel(inline="always")
def push_later(scratch, run, later, takes, weight, entries, count):
    """Add an entry for a run that sets out at a step or later; it takes so long, and so much is left after it."""
    time, left = takes
    bound = later + time + left
    if bound > scratch.work[3]:
        return entries, count
    return push_entry(scratch, run, bound, later, priority(later + time, left, weight, scratch.work[2]), entries, count)


@kernel(allocates=True)
def needs_along(moves, start, runs):
    """Resources that a robot holds on its way, and from which step until when. Consecutive visits keep what both of them need.

    Parameters
    ----------
    start
        Vertex.
    runs
        [K, 3] first lane, number of lanes, step at which the robot sets out.

    Returns
    -------
    held
        [3, H] resources, first steps, and steps after the last; by resource, then by visit.
    """
    size = moves.at_first[start + 1] - moves.at_first[start]
    for r in range(len(runs)):
        lane = runs[r, 0]
        for _ in range(runs[r, 1]):
            v = moves.head[lane]
            size += moves.on_first[lane + 1] - moves.on_first[lane] + moves.at_first[v + 1] - moves.at_first[v]
            lane = moves.onward[lane]
    held = np.empty((3, size), np.int64)
    resource, begin, end, visit = held[0], held[1], held[2], np.empty(size, np.int64)
    num = k = 0
    for i in range(moves.at_first[start], moves.at_first[start + 1]):
        resource[num], begin[num], end[num], visit[num] = moves.at[i], 0, FOREVER, 0
        num += 1
    last = 0  # where the last vertex's resources begin
    for r in range(len(runs)):
        ray, lanes, left = runs[r, 0], runs[r, 1], runs[r, 2]
        course, lane, begin_m = moves.course[ray], ray, 0.0
        for n in range(1, lanes + 1):
            k += 1
            for i in range(moves.off_first[lane + 1] - moves.off_first[lane]):
                end[last + i] = left + step_of_run(moves, ray, lanes, begin_m + moves.off_m[moves.off_first[lane] + i])
            taken = left + taken_at(moves, ray, n) - GUARD
            v = moves.head[lane]
            for i in range(moves.on_first[lane], moves.on_first[lane + 1]):
                resource[num], begin[num], visit[num] = moves.on[i], max(taken, 0), k
                end[num] = left + step_of_run(moves, ray, lanes, begin_m + moves.on_m[i])
                num += 1
            last = num
            for i in range(moves.at_first[v], moves.at_first[v + 1]):
                resource[num], begin[num], end[num], visit[num] = moves.at[i], max(taken, 0), FOREVER, k
                num += 1
            begin_m = moves.end_m[moves.run_first[course] + n - 1]
            lane = moves.onward[lane]
    order = np.argsort(resource * (k + 1) + visit)
    resource[:], begin[:], end[:], visit[:] = resource[order], begin[order], end[order], visit[order]
    row = 0
    for i in range(1, num):
        same = resource[i] == resource[row]
        if same and (begin[i] <= end[row] or visit[i] <= visit[row] + 1):
            end[row] = max(end[row], end[i])
            visit[row] = visit[i]
            continue
        row += 1
        resource[row], begin[row], end[row], visit[row] = resource[i], begin[i], end[i], visit[i]
    return held[:, : row + 1].copy()


@kernel(allocates=True)
def runs_to(state, scratch):
    """[K, 3] the runs that led to a state, in order: first lane, number of lanes, step at which the robot sets out."""
    num, at = 0, state
    while scratch.parent[at] >= 0:
        num += 1
        at = scratch.parent[at]
    runs, at = np.empty((num, 3), np.int64), state
    for k in range(num - 1, -1, -1):
        runs[k, 0], runs[k, 1], runs[k, 2] = scratch.ray[at], scratch.lanes[at], scratch.left[at]
        at = scratch.parent[at]
    return runs
