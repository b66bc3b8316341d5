"""Traffic: the paths of robots as tables that answer at once whether a spot is free and who is on it.

Where following is refused, a robot holds the spot it leaves in the step of its move too: any two robots that come too
near then hold one spot at one step, and swaps and rings need no rules of their own.

How many robots hold a spot at a step is in a table of spots and steps: every cell has its slot, or, where that would take too much
memory, only cells in use have one. A sparse table is hashed: slots lie at the number of a cell, mixed, or behind it (Knuth, The Art of
Computer Programming, volume 3, section 6.4: linear probing, algorithm R for deletion). A robot that stays at its goal is one entry there.
The table begins small and moves to one of twice as many slots, behind it in the same arrays, when two thirds of it are in use: memory that
is never written to is not taken.

Where moves clash, a robot bars the spots and moves that are too close to its own: spots are then busy as if it held them. So are
others at its place, at the step at which it is there.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.core.clashes import Clashes, Spots
from mrp_sumo.search._clashing import move_of
from mrp_sumo.search._kernel import kernel

MOST_CELLS = 1 << 22  # of a table in which every cell has its slot
FEWEST_SLOTS = 16  # of a hashed table at first
WORD = 32  # steps in a word of a bit set; reckoned with as an int64, so that nothing overflows
_LOWEST = np.zeros(32, np.int64)  # position of the lowest bit by de Bruijn's sequence
for _k in range(32):
    _LOWEST[((0x077CB531 << _k) & 0xFFFFFFFF) >> 27] = _k


class RepairTask(NamedTuple):
    """Task of a repair, which does not change. V vertices, L lanes, R robots; S spots and N moves between them, see `Spots`."""

    first: np.ndarray  # [V + 1] int64
    head: np.ndarray  # [L] int64
    start: np.ndarray  # [R] int64
    goal: np.ndarray  # [R] int64
    least: np.ndarray  # [R] int64 steps from each robot's start to its goal
    steps: np.ndarray  # [R, V] int32 to each robot's goal; [R, 0] where only `code` is known
    code: np.ndarray  # [R, ceil(V / 4)] uint8 which way is nearer, see _pibt_instance; [R, 0] where `steps` are
    clashes: Clashes  # between spots
    spots: Spots
    following: bool  # nobody may enter a spot in the step in which another leaves it
    rings: bool  # rings of robots may not move at once, and there is no rule about following that keeps them from it
    window: int  # steps for which robots keep clear of each other; 0: always


class Holders(NamedTuple):
    """Robots that hold each spot at each of T steps, over K slots; a hashed table of N slots is at N to 2 N - 1."""

    key: np.ndarray  # [K] int64 number of the cell and 1, 0 of an empty slot; [0] where every cell has its slot
    num: np.ndarray  # [K] uint8
    who: np.ndarray  # [K] int32 one of them
    since: np.ndarray  # [S] int64 step from which on a robot stays at a spot, not counted in slots; [0] where stays are, too
    stayer: np.ndarray  # [S] int32 that robot
    used: np.ndarray  # [2] int64 slots of the hashed table, and how many of them are in use
    steps: int  # T


class Traffic(NamedTuple):
    """Robots by spot and step. S spots, N moves, R robots, T steps, W = T / WORD. Robots stay at their goals up to step T - 1."""

    task: RepairTask
    at: np.ndarray  # [R, T] int32 vertex of each robot, -1 where a robot has no path
    end: np.ndarray  # [R] int64 step at which each arrives to stay, -1 without a path
    on: Holders
    busy: np.ndarray  # [S, W] uint32 bits: somebody holds or bars it
    num_near: np.ndarray  # [S, T] uint16 moves that bar a spot, at the step they end in and the one before; [1, 1] without clashes
    along: np.ndarray  # [W, N] uint32 bits: somebody arrives by a move; by time, so that steps to which nobody drives take no memory
    num_barred: np.ndarray  # [N, T] uint16 moves that bar arrivals by another at a step; [1, 1] without clashes
    barred: np.ndarray  # [N, W] uint32 bits: some do; [1, 1] without clashes
    window: int  # paths count up to the step before this one only


@kernel(inline="always")
def mixed(key):
    """A number whose lowest bits all bits of a key have a part in."""
    return ((key ^ (key >> 17)) & 0x7FFFFFFF) * 0x9E3779B1 >> 20


@kernel
def home(key, slots):
    """Index at which the slot of a cell is looked for first: eight steps of a spot are side by side in memory."""
    return slots + (((mixed(key >> 3) << 3) + (key & 7)) & (slots - 1))


@kernel(inline="always")
def _after(k, slots):
    """The slot after another, around the end of a table."""
    return slots + ((k + 1) & (slots - 1))


@kernel
def _find_slot(cells, key):
    """The slot of a cell among hashed ones, -1 where it has none."""
    keys, slots = cells.key, cells.used[0]
    k = home(key, slots)
    while keys[k] != 0:
        if keys[k] == key + 1:
            return k
        k = _after(k, slots)
    return np.int64(-1)


@kernel
def _make_slot(cells, key):
    """The slot of a cell among hashed ones, made where it has none."""
    keys, used = cells.key, cells.used
    if 3 * used[1] >= 2 * used[0] and 4 * used[0] <= len(keys):
        _move_all(cells)
    k = home(key, used[0])
    while keys[k] != 0 and keys[k] != key + 1:
        k = _after(k, used[0])
    if keys[k] == 0:
        keys[k] = key + 1
        cells.num[k] = 0
        used[1] += 1
    return k


@kernel
def _move_all(cells):
    """Move what is in a hashed table to one of twice as many slots."""
    keys, slots = cells.key, cells.used[0]
    cells.used[0] = 2 * slots
    for old in range(slots, 2 * slots):
        if keys[old] != 0:
            k = home(keys[old] - 1, 2 * slots)
            while keys[k] != 0:
                k = _after(k, 2 * slots)
            keys[k], cells.num[k], cells.who[k] = keys[old], cells.num[old], cells.who[old]
            keys[old] = 0


@kernel
def _empty_slot(cells, k):
    """Empty a slot, and move up those behind it that would not be found any more."""
    keys, num, who, slots = cells.key, cells.num, cells.who, cells.used[0]
    behind = _after(k, slots)
    while keys[behind] != 0:
        if (behind - home(keys[behind] - 1, slots)) & (slots - 1) >= (behind - k) & (slots - 1):
            keys[k], num[k], who[k] = keys[behind], num[behind], who[behind]
            k = behind
        behind = _after(behind, slots)
    keys[k] = 0
    cells.used[1] -= 1


@kernel(inline="always")
def slot_of(cells, v, t):
    """The slot of a cell, -1 where nobody is."""
    key = np.int64(v) * cells.steps + t
    return key if len(cells.key) == 0 else _find_slot(cells, key)


@kernel(inline="always")
def is_stayed_at(cells, v, t):
    """True if a robot that is one entry stays in a cell."""
    return len(cells.since) > 0 and cells.since[v] <= t


@kernel(inline="always")
def num_in(cells, v, t):
    """Number of robots in a cell."""
    k = slot_of(cells, v, t)
    return (np.int64(cells.num[k]) if k >= 0 else np.int64(0)) + (1 if is_stayed_at(cells, v, t) else 0)


@kernel(inline="always")
def anyone_in(cells, v, t):
    """One of the robots in a cell, -1 where there is none."""
    k = slot_of(cells, v, t)
    if k >= 0 and cells.num[k] > 0:
        return np.int64(cells.who[k])
    return np.int64(cells.stayer[v]) if is_stayed_at(cells, v, t) else np.int64(-1)


@kernel(inline="always")
def enter(cells, v, t):
    """One robot more in a cell; its slot."""
    key = np.int64(v) * cells.steps + t
    k = key if len(cells.key) == 0 else _make_slot(cells, key)
    cells.num[k] += 1
    return k


@kernel(inline="always")
def leave(cells, v, t):
    """One robot fewer in a cell; how many are left."""
    k = slot_of(cells, v, t)
    cells.num[k] -= 1
    left = np.int64(cells.num[k])
    if left == 0 and len(cells.key) > 0:
        _empty_slot(cells, k)
    return left + (1 if is_stayed_at(cells, v, t) else 0)


@kernel
def run_end(bits, t):
    """(whether the bit at t is set, the last step of the run of equal bits around t)."""
    word = t >> 5
    shift = t & 31
    bit = (np.int64(bits[word]) >> shift) & 1
    flip = 0xFFFFFFFF if bit else 0
    rest = (np.int64(bits[word]) ^ flip) >> shift
    if rest:
        return bit == 1, t + _LOWEST[(((rest & -rest) * 0x077CB531) & 0xFFFFFFFF) >> 27] - 1
    for k in range(word + 1, len(bits)):
        rest = np.int64(bits[k]) ^ flip
        if rest:
            return bit == 1, (k << 5) + _LOWEST[(((rest & -rest) * 0x077CB531) & 0xFFFFFFFF) >> 27] - 1
    return bit == 1, (len(bits) << 5) - 1


@kernel
def lane_between(first, head, u, v):
    """The lane from u to v, -1 where there is none."""
    for lane in range(first[u], first[u + 1]):
        if head[lane] == v:
            return lane
    return np.int64(-1)


@kernel(inline="always")
def stay_of(traffic, robot):
    """Step from which on a robot stays where it is as one entry; that of the window's end where cells have to be entered one by one."""
    return traffic.end[robot] if len(traffic.on.since) > 0 else np.int64(traffic.window)


@kernel
def add_path(traffic, robot):
    """Enter the robot's row of `at`, which ends at its `end`, in the rest of the traffic."""
    task = traffic.task
    spot_of, first, head = task.spots.of, task.spots.first, task.spots.head
    at, on, busy, following = traffic.at[robot], traffic.on, traffic.busy, traffic.task.following
    before, stay = np.int64(-1), stay_of(traffic, robot)
    if stay < traffic.window:
        v = spot_of[at[stay]]
        on.since[v], on.stayer[v] = stay, robot
        busy[v, stay >> 5] |= (np.int64(0xFFFFFFFF) << (stay & 31)) & 0xFFFFFFFF
        for word in range((stay >> 5) + 1, busy.shape[1]):
            busy[v, word] = 0xFFFFFFFF
    for t in range(min(stay + 1, traffic.window)):
        v = spot_of[at[t]]
        bit = np.int64(1) << (t & 31)
        if t < stay:
            on.who[enter(on, v, t)] = robot
        busy[v, t >> 5] |= bit
        if t > 0 and v != before:
            traffic.along[t >> 5, lane_between(first, head, before, v)] |= bit
            if following:
                on.who[enter(on, before, t)] = robot
                busy[before, t >> 5] |= bit
        before = v
    if task.clashes.any:
        _bar(traffic, robot)


@kernel
def _bar(traffic, robot):
    """Bar what is too close to the robot's moves."""
    task = traffic.task
    clashes, spots, at, num_near, busy, num_barred, barred = (
        task.clashes, task.spots, traffic.at[robot], traffic.num_near, traffic.busy, traffic.num_barred, traffic.barred,
    )  # fmt: skip
    for t in range(traffic.window):
        here = spots.of[at[t]]
        for k in range(spots.beside_first[here], spots.beside_first[here + 1]):
            v = spots.beside[k]
            num_near[v, t] += 1
            busy[v, t >> 5] |= np.int64(1) << (t & 31)
    for t in range(1, traffic.window):
        move = move_of(spots.first, spots.head, spots.of[at[t - 1]], spots.of[at[t]])
        for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
            v = clashes.vertex[k]
            for step in range(t - 1, t + 1):
                num_near[v, step] += 1
                busy[v, step >> 5] |= np.int64(1) << (step & 31)
        for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
            num_barred[clashes.lane[k], t] += 1
            barred[clashes.lane[k], t >> 5] |= np.int64(1) << (t & 31)


@kernel
def _unbar(traffic, robot):
    """Take back what `_bar` did."""
    task = traffic.task
    clashes, spots, at, on, num_near, busy, num_barred, barred = (
        task.clashes, task.spots, traffic.at[robot], traffic.on, traffic.num_near, traffic.busy, traffic.num_barred, traffic.barred,
    )  # fmt: skip
    for t in range(traffic.window):
        here = spots.of[at[t]]
        for k in range(spots.beside_first[here], spots.beside_first[here + 1]):
            v = spots.beside[k]
            num_near[v, t] -= 1
            if num_near[v, t] == 0 and num_in(on, v, t) == 0:
                busy[v, t >> 5] &= ~(np.int64(1) << (t & 31))
    for t in range(1, traffic.window):
        move = move_of(spots.first, spots.head, spots.of[at[t - 1]], spots.of[at[t]])
        for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
            v = clashes.vertex[k]
            for step in range(t - 1, t + 1):
                num_near[v, step] -= 1
                if num_near[v, step] == 0 and num_in(on, v, step) == 0:
                    busy[v, step >> 5] &= ~(np.int64(1) << (step & 31))
        for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
            lane = clashes.lane[k]
            num_barred[lane, t] -= 1
            if num_barred[lane, t] == 0:
                barred[lane, t >> 5] &= ~(np.int64(1) << (t & 31))


@kernel
def remove_path(traffic, robot):
    """Take the robot's path out of the traffic; its row of `at` stays."""
    task, at, on, spots = traffic.task, traffic.at[robot], traffic.on, traffic.task.spots
    if task.clashes.any:
        _unbar(traffic, robot)
    before, stay = np.int64(-1), stay_of(traffic, robot)
    if stay < traffic.window:
        on.since[spots.of[at[stay]]] = traffic.window
    for t in range(traffic.window):
        v = spots.of[at[t]]
        left = leave(on, v, t) if t < stay else num_in(on, v, t)
        if left == 0:
            _set_free(traffic, v, t)
        else:
            _hand_over(traffic, robot, v, t)
        if t > 0 and v != before:
            if left == 0 or not _do_others_arrive(traffic, robot, before, v, t):
                traffic.along[t >> 5, lane_between(spots.first, spots.head, before, v)] &= ~(np.int64(1) << (t & 31))
            if task.following:
                if leave(on, before, t) == 0:
                    _set_free(traffic, before, t)
                else:
                    _hand_over(traffic, robot, before, t)
        before = v


@kernel(inline="always")
def _set_free(traffic, v, t):
    """Nobody holds v any more at t."""
    if len(traffic.num_near) == 1 or traffic.num_near[v, t] == 0:
        traffic.busy[v, t >> 5] &= ~(np.int64(1) << (t & 31))


@kernel
def _hand_over(traffic, robot, v, t):
    """Of those that still hold v at t, and do not stay there, let another one be known of than this robot."""
    k = slot_of(traffic.on, v, t)
    if k >= 0 and traffic.on.who[k] == robot:
        for other in range(len(traffic.at)):
            if other != robot and t < stay_of(traffic, other) and holds(traffic, other, v, t):
                traffic.on.who[k] = other
                break


@kernel
def _do_others_arrive(traffic, robot, u, v, t):
    """True if other robots than this one come from u to v at t."""
    at, spot_of = traffic.at, traffic.task.spots.of
    for other in range(len(at)):
        if other != robot and traffic.end[other] >= 0 and spot_of[at[other, t]] == v and spot_of[at[other, t - 1]] == u:
            return True
    return False


@kernel
def holds(traffic, robot, v, t):
    """True if a robot with a path holds spot v at a step."""
    if traffic.end[robot] < 0 or t >= traffic.window:
        return False
    at, spot_of = traffic.at[robot], traffic.task.spots.of
    return spot_of[at[t]] == v or (traffic.task.following and t > 0 and spot_of[at[t - 1]] == v)


@kernel
def anyone_at(traffic, v, t):
    """One of the robots at the place of spot v at a step, -1 where there is none."""
    spots = traffic.task.spots
    robot = anyone_in(traffic.on, v, t)
    for k in range(spots.beside_first[v], spots.beside_first[v + 1]):
        if robot < 0:
            robot = anyone_in(traffic.on, spots.beside[k], t)
    return robot


@kernel
def closes_ring(traffic, v, u, t):
    """True if a move from spot v that arrives on spot u at step t completes a ring of robots that move at once."""
    w, spot_of, place = u, traffic.task.spots.of, traffic.task.spots.place
    for _ in range(len(traffic.at)):
        robot = anyone_at(traffic, w, t - 1)
        if robot < 0:
            return False
        onward = spot_of[traffic.at[robot, t]]
        if place[onward] == place[v]:
            return True
        if place[onward] == place[w]:
            return False
        w = onward
    return False


@kernel
def hold_starts(traffic):
    """Let everybody hold its start in the first step: where following is refused nobody can leave it sooner."""
    for robot in range(len(traffic.task.start)):
        v = traffic.task.spots.of[traffic.task.start[robot]]
        traffic.on.who[enter(traffic.on, v, 1)] = robot
        traffic.busy[v, 0] |= 2


@kernel
def free_start(traffic, robot):
    """Take back what `hold_starts` did for a robot."""
    v = traffic.task.spots.of[traffic.task.start[robot]]
    if leave(traffic.on, v, 1) == 0:
        _set_free(traffic, v, 1)


@kernel
def enter_all(traffic):
    """Put all paths of `at` into the empty traffic."""
    task = traffic.task
    for robot in range(len(task.goal)):
        add_path(traffic, robot)


def no_holders(num_spots: int, num_steps: int, most: int, *, stays: bool = True) -> Holders:
    """Empty cells, of which at most so many are in use at a time; with `stays`, a sparse table has one entry for a robot that stays."""
    sparse = is_sparse(num_spots, num_steps)
    num_slots = 2 * slots_for(most) if sparse else num_spots * num_steps
    key = np.zeros(num_slots if sparse else 0, np.int64)
    since = np.full(num_spots if sparse and stays else 0, num_steps, np.int64)
    num, who = np.zeros(num_slots, np.uint8), np.empty(num_slots, np.int32)
    used = np.array([min(num_slots // 2, FEWEST_SLOTS), 0])
    return Holders(key, num, who, since, np.empty(len(since), np.int32), used, num_steps)


def is_sparse(num_spots: int, num_steps: int) -> bool:
    """True if only cells in use have a slot."""
    return num_spots * num_steps > MOST_CELLS


def slots_for(most: int) -> int:
    """A power of two, of which so many are at most two thirds."""
    return 1 << max(4, int(np.ceil(np.log2(1.5 * most))))


def empty_traffic(task: RepairTask, horizon: int, most: int | None = None) -> Traffic:
    """Traffic without paths over `horizon` steps, a multiple of WORD; all together may move or wait on their ways for `most`, None: any."""
    num_spots, num_moves, num_robots = len(task.spots.place), len(task.spots.head), len(task.goal)
    near = (num_spots, num_moves, horizon) if task.clashes.any else (1, 1, 1)
    held = (num_robots * horizon if most is None or task.window else most) * (2 if task.following else 1)
    return Traffic(
        task,
        at=np.full((num_robots, horizon), -1, np.int32),
        end=np.full(num_robots, -1, np.int64),
        on=no_holders(num_spots, horizon, held, stays=not task.window),
        busy=np.zeros((num_spots, horizon // WORD), np.uint32),
        num_near=np.zeros((near[0], near[2]), np.uint16),
        along=np.zeros((horizon // WORD, num_moves), np.uint32),
        num_barred=np.zeros((near[1], near[2]), np.uint16),
        barred=np.zeros((near[1], (near[2] + WORD - 1) // WORD), np.uint32),
        window=min(task.window + 1, horizon) if task.window else horizon,
    )


def traffic_of(task: RepairTask, path: np.ndarray, spare: int) -> Traffic:
    """Traffic of the paths [T, R], with `spare` steps or more of room."""
    traffic = empty_traffic(task, (len(path) + spare + 2 + WORD - 1) // WORD * WORD)
    traffic.at[:, : len(path)] = path.T
    traffic.at[:, len(path) :] = path[-1][:, None]
    away = path != task.goal
    traffic.end[:] = np.where(away.any(axis=0), len(path) - np.argmax(away[::-1], axis=0), 0)
    enter_all(traffic)
    return traffic


def path_of(at: np.ndarray, end: np.ndarray) -> np.ndarray:
    """[T, R] where everybody is, up to the last arrival; `at` and `end` are those of the traffic."""
    return np.ascontiguousarray(at[:, : int(end.max(initial=0)) + 1].T)
