"""Kernels of ways through a window of steps: the best one by a robot's stops, around others', and shorter ways for all.

Sources: Li, Tinka, Kiesel, Durham, Kumar, Koenig, "Lifelong multi-agent path finding in large-scale warehouses", AAAI 2021 (windows;
states that count the stops made); Silver, "Cooperative pathfinding", AIIDE 2005 (A* in space and time); Li, Chen, Harabor, Stuckey,
Koenig, "Anytime multi-agent path finding via large neighborhood search", IJCAI 2021. Beyond the window a way is as long as the shortest
one by the stops that are left. Of the shortest ways it is the one that crosses fewest others. `search._space_time` looks through steps,
too, but to one goal, without end, and under the constraints of a tree, which windows would have to be written as.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.core.clashes import Clashes
from mrp_sumo.search._clashing import move_of, too_close
from mrp_sumo.search._distance import UNREACHABLE
from mrp_sumo.search._kernel import kernel
from planners.safe_interval._priorities import put_before

NOBODY, SEVERAL = -1, -2
NO_WAY = 1 << 40
AT_A_TIME = 6  # robots planned again
MOST_CROSSED = 31  # ways that cross more others count as equal


class WindowTask(NamedTuple):
    """R robots on a graph of V vertices and L lanes, each with stops, S in all, and W steps for which they keep clear of each other.

    P spots and N moves between them, see `core.clashes`.
    """

    first: np.ndarray  # [V + 1]
    head: np.ndarray  # [L]
    spot: np.ndarray  # [V] spot of a vertex
    spot_first: np.ndarray  # [P + 1] moves that leave a spot
    spot_head: np.ndarray  # [N]
    spot_tail: np.ndarray  # [N]
    clashes: Clashes
    start: np.ndarray  # [R]
    stop_first: np.ndarray  # [R + 1]
    stop: np.ndarray  # [S] in the order in which they are made; each robot has one or more
    steps: np.ndarray  # [S, V] int32 to each stop
    after: np.ndarray  # [S] steps from each stop by those after it to the robot's last
    least: np.ndarray  # [R] steps of each robot's shortest way
    window: int


class Room(NamedTuple):
    """Table of who is where, and room for a search: K stops at most, N = (W + 1) (K + 1) V states."""

    above: np.ndarray  # [W + 1, P] int32 who holds a spot at a step and must not be met
    others: np.ndarray  # [W + 1, P] int32 likewise, of those who may be crossed at a price; SEVERAL: more than one
    mark: np.ndarray  # [N] int64 the search that came to a state
    steps: np.ndarray  # [N] int32 its cost
    crossed: np.ndarray  # [N] int32 others crossed
    before: np.ndarray  # [N] int32 the state before
    top: np.ndarray  # [B] int32 the last entry of each bucket of states: by steps, then by others crossed
    state: np.ndarray  # [E] int32 of each entry
    below: np.ndarray  # [E] int32 the entry before it in its bucket
    count: np.ndarray  # [3] int64 searches; labels of all of them; others that the last way crosses


def room_for(task: WindowTask) -> Room:
    """Room for the searches of a task."""
    num_vertices = len(task.first) - 1
    longest, later = (int(np.max(each, where=each < UNREACHABLE, initial=0)) for each in (task.steps, task.after))
    num_states = (task.window + 1) * (int(np.diff(task.stop_first).max(initial=1)) + 1) * num_vertices
    return Room(
        *(np.full((task.window + 1, len(task.spot_first) - 1), NOBODY, np.int32) for _ in range(2)),
        np.zeros(num_states, np.int64),
        *(np.zeros(num_states, np.int32) for _ in range(3)),
        np.full((task.window + longest + later + 1) * (MOST_CROSSED + 1), -1, np.int32),
        *(np.zeros(4 * num_states, np.int32) for _ in range(2)),
        np.zeros(3, np.int64),
    )


@kernel
def enter(task, table, at, robot):
    """Put a robot's way into a table of who is where."""
    for t in range(table.shape[0]):
        v = task.spot[at[robot, t]]
        table[t, v] = robot if table[t, v] == NOBODY else SEVERAL


@kernel
def take_out(task, table, at, robot):
    """Empty the places of a robot's way in a table."""
    for t in range(table.shape[0]):
        table[t, task.spot[at[robot, t]]] = NOBODY


@kernel
def leave(task, table, at):
    """Empty a table of all ways."""
    for r in range(len(at)):
        take_out(task, table, at, r)


@kernel(inline="always")
def meets(table, u, v, t):
    """True if a robot that goes from spot u to v, or waits, and arrives at step t meets somebody of a table; clashes are not looked at."""
    met = table[t, v] != NOBODY
    if not met and u != v and table[t - 1, v] != NOBODY and table[t, u] != NOBODY:
        met = table[t - 1, v] == SEVERAL or table[t - 1, v] == table[t, u]
    return met


@kernel
def comes_too_close(task, table, u, v, t):
    """True if the move from spot u to v clashes with one of a table."""
    clashes, move = task.clashes, move_of(task.spot_first, task.spot_head, u, v)
    for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
        w = clashes.vertex[k]
        if table[t - 1, w] != NOBODY or table[t, w] != NOBODY:
            return True
    for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
        lane = clashes.lane[k]
        other = table[t - 1, task.spot_tail[lane]]
        if other != NOBODY and (other == table[t, task.spot_head[lane]] or other == SEVERAL):
            return True
    return False


@kernel
def closes_ring(task, room, at, robot, u, v, t):
    """True if a move from spot u to v that ends at step t completes a ring of robots that all move at once."""
    for _ in range(len(at)):
        other = room.above[t - 1, v]
        if other < 0:
            other = room.others[t - 1, v]
        if other < 0 or other == robot or task.spot[at[other, t]] == v:
            return False
        v = task.spot[at[other, t]]
        if v == u:
            return True
    return False


@kernel(inline="always")
def _to_go(steps, after, begin, num_stops, made, v):
    """Steps from a vertex by the stops that have not been made, or back to the last."""
    row = begin + min(made, num_stops - 1)
    return np.int64(steps[row, v]) + (after[row] if made < num_stops else 0)


@kernel(inline="always")
def _bucket(late, crossed, most_late, clear):
    """The bucket of a state by its steps, then by the others crossed, or the other way round."""
    return crossed * most_late + late if clear else late * (MOST_CROSSED + 1) + crossed


@kernel
def find_way(task, room, at, robot, clear):
    """The best way of a robot that is in neither table, written to its row of `at`.

    Parameters
    ----------
    clear
        Whether the best is the one that crosses fewest others, and the shortest of those, instead of the other way round.

    Returns
    -------
    int
        Its steps, with those that it takes beyond the window; NO_WAY where there is none.
    """
    first, head, window, stop, steps_to, after = task.first, task.head, task.window, task.stop, task.steps, task.after
    top, state, below, above, others = room.top, room.state, room.below, room.above, room.others
    mark, steps_of, crossed_by, before = room.mark, room.steps, room.crossed, room.before
    begin, num_stops = task.stop_first[robot], task.stop_first[robot + 1] - task.stop_first[robot]
    end, rings, near = stop[begin + num_stops - 1], not task.clashes.rotations, task.clashes.any
    num_vertices = len(first) - 1
    layer = (num_stops + 1) * num_vertices
    room.count[0] += 1
    now = room.count[0]
    start, made = task.start[robot], np.int64(0)
    while made < num_stops and stop[begin + made] == start:
        made += 1
    least = _to_go(steps_to, after, begin, num_stops, made, start)
    if least >= UNREACHABLE:
        return NO_WAY
    x = made * num_vertices + start
    mark[x], steps_of[x], crossed_by[x], before[x] = now, 0, 0, -1
    most_late = len(top) // (MOST_CROSSED + 1)
    top[0], state[0], below[0] = 0, x, -1
    num, bucket, highest = np.int64(1), np.int64(0), np.int64(0)
    labels = 0
    length = NO_WAY
    while True:
        while bucket <= highest and top[bucket] < 0:
            bucket += 1
        if bucket > highest:
            length = NO_WAY
            break
        x = np.int64(state[top[bucket]])
        top[bucket] = below[top[bucket]]
        t, made, u = x // layer, x % layer // num_vertices, x % num_vertices
        cost, crossed = np.int64(steps_of[x]), np.int64(crossed_by[x])
        length = cost + _to_go(steps_to, after, begin, num_stops, made, u)
        if bucket != _bucket(length - least, crossed, most_late, clear):
            continue  # reached better meanwhile
        if t == window:
            room.count[2] = crossed
            while x >= 0:
                at[robot, x // layer] = x % num_vertices
                x = np.int64(before[x])
            break
        labels += 1
        if num + first[u + 1] - first[u] + 1 > len(state):
            length = NO_WAY
            break
        row, here = begin + min(made, num_stops - 1), task.spot[u]
        for lane in range(first[u], first[u + 1] + 1):
            v = np.int64(head[lane]) if lane < first[u + 1] else u
            spot = task.spot[v]
            if (
                steps_to[row, v] >= UNREACHABLE
                or meets(above, here, spot, t + 1)
                or (near and comes_too_close(task, above, here, spot, t + 1))
            ):
                continue
            if rings and v != u and closes_ring(task, room, at, robot, here, spot, t + 1):
                continue
            there = made
            while there < num_stops and stop[begin + there] == v:
                there += 1
            steps = cost + (0 if made == num_stops and v == u and v == end else 1)
            crosses = meets(others, here, spot, t + 1) or (near and comes_too_close(task, others, here, spot, t + 1))
            price = min(crossed + (1 if crosses else 0), MOST_CROSSED)
            y = (t + 1) * layer + there * num_vertices + v
            if mark[y] == now:
                fewer, shorter = crossed_by[y] <= price, steps_of[y] <= steps
                if (fewer and shorter) or (crossed_by[y] < price if clear else steps_of[y] < steps):
                    continue
            mark[y], steps_of[y], crossed_by[y], before[y] = now, steps, price, x
            to = _bucket(steps + _to_go(steps_to, after, begin, num_stops, there, v) - least, price, most_late, clear)
            state[num], below[num] = y, top[to]
            top[to] = num
            num += 1
            highest, bucket = max(highest, to), min(bucket, to)
    top[: highest + 1] = -1
    room.count[1] += labels
    return length


@kernel(allocates=True)
def find_all(task, room, at, cost):
    """Each robot's best way, which may cross others'. Whether everybody has one."""
    complete = True
    for r in range(len(task.start)):
        cost[r] = find_way(task, room, at, r, False)
        if cost[r] == NO_WAY:
            complete = False
            break
        enter(task, room.others, at, r)
    room.others[:] = NOBODY
    return complete


@kernel(allocates=True)
def branch(task, room, holder, above, at, cost):
    """Let either of the two robots that meet first go before the other, the second before the first at first.

    Parameters
    ----------
    holder
        [2, P] scratch, NOBODY between calls.
    above, at, cost
        [2, R, R], [2, R, W + 1] and [2, R] priorities, ways and their steps, of the node for both orders; written.

    Returns
    -------
    meets, one, other
        False where nobody meets; whether everybody has a way in the one order, and in the other.
    """
    first, second = first_conflict(task, holder, above[0], at[0])
    if first < 0:
        return False, False, False
    one = not above[0, first, second] and find_below(task, room, above[0], at[0], cost[0], (second, first))
    other = not above[1, second, first] and find_below(task, room, above[1], at[1], cost[1], (first, second))
    return True, one, other


@kernel(allocates=True)
def find_below(task, room, above, at, cost, pair):
    """Let the first of two robots go before the second; whether everybody has a way.

    The second looks for another way, and of those below it those that meet somebody above them; each after those above it.
    """
    num_robots, robots = len(task.start), put_before(above, pair[0], pair[1])
    for k in range(len(robots)):
        r = robots[k]
        if k > 0 and not _is_hindered(task, at, above, r):
            continue
        for other in range(num_robots):
            if other != r:
                enter(task, room.above if above[other, r] else room.others, at, other)
        cost[r] = find_way(task, room, at, r, False)
        leave(task, room.above, at)
        leave(task, room.others, at)
        if cost[r] == NO_WAY:
            return False
    return True


@kernel
def first_conflict(task, holder, above, at):
    """The two robots that meet first; -1 where nobody does. `holder` [2, P] is scratch: NOBODY between calls."""
    before, now, num_robots, spot = holder[0], holder[1], len(at), task.spot
    one, other = np.int64(-1), np.int64(-1)
    for r in range(num_robots):
        before[spot[at[r, 0]]] = r
    for t in range(1, at.shape[1]):
        for r in range(num_robots):
            there = spot[at[r, t]]
            if now[there] != NOBODY:
                one, other = np.int64(now[there]), np.int64(r)
                break
            now[there] = r
        if one < 0:
            for r in range(num_robots):
                other = _met(task, before, now, above, at, r, t)
                if other >= 0:
                    one = np.int64(r)
                    break
        for r in range(num_robots):
            before[spot[at[r, t - 1]]], now[spot[at[r, t]]] = NOBODY, NOBODY
        if one >= 0:
            break
        for r in range(num_robots):
            before[spot[at[r, t]]] = r
    for r in range(num_robots):
        before[spot[at[r, at.shape[1] - 1]]] = NOBODY
    return one, other


@kernel
def _met(task, before, now, above, at, r, t):
    """Somebody that a robot meets on its way to step t, where all are at spots of their own; -1: nobody."""
    clashes, spot = task.clashes, task.spot
    u, v = spot[at[r, t - 1]], spot[at[r, t]]
    ahead = np.int64(before[v])
    if u != v and ahead >= 0:
        if spot[at[ahead, t]] == u:
            return ahead
        if not clashes.rotations:
            behind, x = ahead, spot[at[ahead, t]]
            for _ in range(len(at)):
                if x == u:
                    return ahead if not above[r, ahead] and not above[ahead, r] else behind
                behind = np.int64(before[x])
                if behind < 0 or spot[at[behind, t]] == x:
                    break
                x = spot[at[behind, t]]
    if clashes.any:
        move = move_of(task.spot_first, task.spot_head, u, v)
        for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
            w = clashes.vertex[k]
            for other in (np.int64(before[w]), np.int64(now[w])):
                if other >= 0 and other != r:
                    return other
        for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
            lane = clashes.lane[k]
            other = np.int64(before[task.spot_tail[lane]])
            if other >= 0 and other != r and spot[at[other, t]] == task.spot_head[lane]:
                return other
    return np.int64(-1)


@kernel
def _is_hindered(task, at, above, r):
    """Whether a robot meets one of those above it on its way, or moves in a ring."""
    for other in range(len(at)):
        if above[other, r]:
            for t in range(1, at.shape[1]):
                u, v, here, there = task.spot[at[other, t - 1]], task.spot[at[other, t]], task.spot[at[r, t - 1]], task.spot[at[r, t]]
                if v == there or (v == here and u == there):
                    return True
                if task.clashes.any:
                    move = move_of(task.spot_first, task.spot_head, here, there)
                    if too_close(task.clashes, move, move_of(task.spot_first, task.spot_head, u, v), u, v):
                        return True
    return False


@kernel(allocates=True)
def mend(task, room, holder, at, cost, most_labels, rng):
    """Plan robots that meet again, with those around them, by ways that cross fewest others, until nobody meets anybody.

    Parameters
    ----------
    holder
        [2, P] scratch, NOBODY between calls.
    at, cost
        [R, W + 1] and [R] the ways of all, and their steps.
    most_labels
        Labels after which there are no more tries.
    rng
        Chance.

    Returns
    -------
    bool
        Whether nobody meets anybody.
    """
    num_robots, others, nobody = len(task.start), room.others, np.zeros(len(task.start), np.bool_)
    hood, unordered = _room_for_hood(at), np.zeros((num_robots, num_robots), np.bool_)
    chosen, clear = hood[0], False
    while room.count[1] < most_labels:
        first, second = first_conflict(task, holder, unordered, at)
        clear = first < 0
        if clear:
            break
        if rng.random() < 0.5:
            first, second = second, first
        _enter_all(task, others, at, nobody)
        num = _around(task, others, at, first, chosen)
        met = False
        for k in range(num):
            met = met or chosen[k] == second
        if not met:
            num = min(num + 1, AT_A_TIME)
            chosen[num - 1] = second
        leave(task, others, at)
        _shuffle(chosen, num, rng)
        is_chosen = np.zeros(num_robots, np.bool_)
        for k in range(num):
            is_chosen[chosen[k]] = True
        _enter_all(task, others, at, is_chosen)
        old = np.int64(0)
        for k in range(num):
            old += _num_crossed(task, others, at, chosen[k])
            enter(task, others, at, chosen[k])
        leave(task, others, at)
        _enter_all(task, others, at, is_chosen)
        _replan(task, room, (at, cost), hood, num, old, True)
        others[:] = NOBODY
    return clear


@kernel
def _enter_all(task, table, at, but):
    """Put robots' ways into a table of who is where, but for those of some [R]."""
    for r in range(len(but)):
        if not but[r]:
            enter(task, table, at, r)


@kernel
def _num_crossed(task, table, at, robot):
    """The others of a table that a robot's way crosses, a step each."""
    num = 0
    for t in range(1, at.shape[1]):
        u, v = task.spot[at[robot, t - 1]], task.spot[at[robot, t]]
        if meets(table, u, v, t) or (task.clashes.any and comes_too_close(task, table, u, v, t)):
            num += 1
    return num


@kernel(allocates=True)
def polish(task, room, at, cost, most_labels, rng):
    """Plan a late robot again with those in its way, and keep what is shorter, time and again.

    Parameters
    ----------
    at, cost
        [R, W + 1] and [R] the ways of all, and their steps.
    most_labels
        Labels after which there are no more tries.
    rng
        Chance.
    """
    least, hood = task.least, _room_for_hood(at)
    chosen = hood[0]
    for r in range(len(at)):
        enter(task, room.above, at, r)
    while room.count[1] < most_labels:
        late = (cost - least).sum()
        if late == 0:
            break
        drawn, r = np.int64(rng.random() * late), np.int64(0)
        while drawn >= cost[r] - least[r]:
            drawn -= cost[r] - least[r]
            r += 1
        num = _around(task, room.above, at, r, chosen)
        _shuffle(chosen, num, rng)
        old = np.int64(0)
        for k in range(num):
            old += cost[chosen[k]]
            take_out(task, room.above, at, chosen[k])
        _replan(task, room, (at, cost), hood, num, old, False)
    leave(task, room.above, at)


@kernel(allocates=True)
def _room_for_hood(at):
    """Room for robots that are planned again, their old ways, and the steps of these."""
    return np.zeros(AT_A_TIME, np.int64), np.zeros((AT_A_TIME, at.shape[1]), np.int32), np.zeros(AT_A_TIME, np.int64)


@kernel(allocates=True)
def _replan(task, room, ways, hood, num, old, clear):
    """Plan the robots of a neighbourhood, whose ways are in no table, one after another; they keep these where all together are worse.

    Parameters
    ----------
    ways
        The ways of all, and their steps.
    hood, num
        See `_room_for_hood`, and how many robots there are.
    old
        What their ways cost: the steps, or the others that they cross.
    clear
        Whether to cross few among `room.others`, or to take few steps around `room.above`.
    """
    (at, cost), (chosen, saved, saved_cost), table = ways, hood, room.others if clear else room.above
    for k in range(num):
        saved[k], saved_cost[k] = at[chosen[k]], cost[chosen[k]]
    new, planned = np.int64(0), 0
    while planned < num and new <= old:
        steps = find_way(task, room, at, chosen[planned], clear)
        new += room.count[2] if clear and steps < NO_WAY else steps
        if new <= old:
            cost[chosen[planned]] = steps
            enter(task, table, at, chosen[planned])
            planned += 1
    if new > old:
        for k in range(planned):
            take_out(task, table, at, chosen[k])
        for k in range(num):
            at[chosen[k]], cost[chosen[k]] = saved[k], saved_cost[k]
            enter(task, table, at, chosen[k])


@kernel
def _shuffle(chosen, num, rng):
    """Put the first so many in an order by chance."""
    for k in range(num):
        other = np.int64(rng.random() * (num - k)) + k
        chosen[k], chosen[other] = chosen[other], chosen[k]


@kernel
def _around(task, table, at, robot, chosen):
    """A robot and those of a table that hold spots beside its way while it is near; how many."""
    chosen[0], num = robot, 1
    for t in range(1, at.shape[1]):
        u = task.spot[at[robot, t - 1]]
        for move in range(task.spot_first[u], task.spot_first[u + 1]):
            other = table[t, task.spot_head[move]]
            if other >= 0 and num < len(chosen):
                known = False
                for k in range(num):
                    known = known or chosen[k] == other
                if not known:
                    chosen[num] = other
                    num += 1
    return num
