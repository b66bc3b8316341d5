"""Who is where and when: the paths of robots as tables that answer at once whether a vertex is free and who is on it.

Where following is refused, a robot holds the vertex it leaves in the step of its move too: any two robots that come too
near then hold one vertex at one step, and swaps and rings need no rules of their own.

Where moves clash, a robot bars the vertices and lanes that are too close to its own: vertices are then busy as if it held them.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.core.clashes import Clashes
from mrp_sumo.search._clashing import move_of
from mrp_sumo.search._kernel import kernel
from planners.neighbourhood._cells import RowOccupancy, anyone_in, cells_of, enter, leave, num_in, slot_of

WORD = 32  # steps in a word of a bit set; reckoned with as an int64, so that nothing overflows
_LOWEST = np.zeros(32, np.int64)  # position of the lowest bit by de Bruijn's sequence
for _k in range(32):
    _LOWEST[((0x077CB531 << _k) & 0xFFFFFFFF) >> 27] = _k


class RepairTask(NamedTuple):
    """What does not change. V vertices, L lanes, R robots."""

    first: np.ndarray  # [V + 1] int64
    head: np.ndarray  # [L] int64
    reverse: np.ndarray  # [L] int64
    start: np.ndarray  # [R] int64
    goal: np.ndarray  # [R] int64
    least: np.ndarray  # [R] int64 steps from each robot's start to its goal
    steps: np.ndarray  # [R, V] int32 to each robot's goal; [R, 0] where only `code` is known
    code: np.ndarray  # [R, ceil(V / 4)] uint8 which way is nearer, see _compass; [R, 0] where `steps` are
    clashes: Clashes


class Traffic(NamedTuple):
    """Who is where. V vertices, L lanes, R robots, T steps, W = T / WORD. Robots stay at their goals up to step T - 1."""

    at: np.ndarray  # [R, T] int32 position of each robot, -1 where a robot has no path
    end: np.ndarray  # [R] int64 step at which each arrives to stay, -1 without a path
    on: RowOccupancy  # robots that hold a vertex
    busy: np.ndarray  # [V, W] uint32 bits: somebody holds or bars it
    num_near: np.ndarray  # [V, T] uint16 moves that bar a vertex, at the step they end in and the one before; [1, 1] without clashes
    arrivals: RowOccupancy  # robots that arrive by a lane
    along: np.ndarray  # [L, W] uint32 bits: somebody does
    num_barred: np.ndarray  # [L, T] uint16 moves that bar arrivals by a lane at a step; [1, 1] without clashes
    barred: np.ndarray  # [L, W] uint32 bits: some do; [1, 1] without clashes
    following: bool  # nobody may enter a vertex in the step in which another leaves it
    rotations: bool  # rings of robots may move at once
    window: int  # paths count up to the step before this one only


@kernel(allocates=False)
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


@kernel(allocates=False)
def lane_between(first, head, u, v):
    """The lane from u to v, -1 where there is none."""
    for lane in range(first[u], first[u + 1]):
        if head[lane] == v:
            return lane
    return np.int64(-1)


@kernel(allocates=False)
def add_path(task, traffic, robot):
    """Enter the robot's row of `at` in the rest of the traffic."""
    first, head = task.first, task.head
    at, on, busy, following = traffic.at[robot], traffic.on, traffic.busy, traffic.following
    before = np.int64(-1)
    for t in range(traffic.window):
        v = np.int64(at[t])
        bit = np.int64(1) << (t & 31)
        on.who[enter(on, v, t)] = robot
        busy[v, t >> 5] |= bit
        if t > 0 and v != before:
            lane = lane_between(first, head, before, v)
            enter(traffic.arrivals, lane, t)
            traffic.along[lane, t >> 5] |= bit
            if following:
                on.who[enter(on, before, t)] = robot
                busy[before, t >> 5] |= bit
        before = v
    if task.clashes.any:
        _bar(task, traffic, robot)


@kernel(allocates=False)
def _bar(task, traffic, robot):
    """Bar what is too close to the robot's moves."""
    clashes, at, num_near, busy, num_barred, barred = (
        task.clashes, traffic.at[robot], traffic.num_near, traffic.busy, traffic.num_barred, traffic.barred,
    )  # fmt: skip
    for t in range(1, traffic.window):
        move = move_of(task.first, task.head, np.int64(at[t - 1]), np.int64(at[t]))
        for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
            v = clashes.vertex[k]
            for step in range(t - 1, t + 1):
                num_near[v, step] += 1
                busy[v, step >> 5] |= np.int64(1) << (step & 31)
        for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
            num_barred[clashes.lane[k], t] += 1
            barred[clashes.lane[k], t >> 5] |= np.int64(1) << (t & 31)


@kernel(allocates=False)
def _unbar(task, traffic, robot):
    """Take back what `_bar` did."""
    clashes, at, on, num_near, busy, num_barred, barred = (
        task.clashes, traffic.at[robot], traffic.on, traffic.num_near, traffic.busy, traffic.num_barred, traffic.barred,
    )  # fmt: skip
    for t in range(1, traffic.window):
        move = move_of(task.first, task.head, np.int64(at[t - 1]), np.int64(at[t]))
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


@kernel(allocates=False)
def remove_path(task, traffic, robot):
    """Take the robot's path out of the traffic; its row of `at` stays."""
    first, head = task.first, task.head
    if task.clashes.any:
        _unbar(task, traffic, robot)
    at, following = traffic.at[robot], traffic.following
    before = np.int64(-1)
    for t in range(traffic.window):
        v = np.int64(at[t])
        _let_go(traffic, robot, v, t)
        if t > 0 and v != before:
            lane = lane_between(first, head, before, v)
            if leave(traffic.arrivals, lane, t) == 0:
                traffic.along[lane, t >> 5] &= ~(np.int64(1) << (t & 31))
            if following:
                _let_go(traffic, robot, before, t)
        before = v


@kernel(allocates=False)
def _let_go(traffic, robot, v, t):
    """The robot holds v no longer at t."""
    if leave(traffic.on, v, t) == 0:
        if len(traffic.num_near) == 1 or traffic.num_near[v, t] == 0:
            traffic.busy[v, t >> 5] &= ~(np.int64(1) << (t & 31))
        return
    k = slot_of(traffic.on, v, t)
    if traffic.on.who[k] == robot:
        for other in range(len(traffic.at)):
            if other != robot and holds(traffic, other, v, t):
                traffic.on.who[k] = other
                break


@kernel(allocates=False)
def holds(traffic, robot, v, t):
    """Whether a robot with a path holds a vertex at a step."""
    if traffic.end[robot] < 0 or t >= traffic.window:
        return False
    return traffic.at[robot, t] == v or (traffic.following and t > 0 and traffic.at[robot, t - 1] == v)


@kernel(allocates=False)
def closes_ring(traffic, v, u, t):
    """Whether a move from v that arrives on u at step t completes a ring of robots that move at once."""
    w = u
    for _ in range(len(traffic.at)):
        robot = anyone_in(traffic.on, w, t - 1)
        if robot < 0:
            return False
        onward = np.int64(traffic.at[robot, t])
        if onward == v:
            return True
        if onward == w:
            return False
        w = onward
    return False


@kernel(allocates=False)
def enter_all(task, traffic):
    """Put all paths of `at` into the empty traffic."""
    for robot in range(len(task.goal)):
        add_path(task, traffic, robot)


def empty_traffic(task: RepairTask, horizon: int, *, following: bool, rotations: bool, window: int = 0) -> Traffic:
    """Traffic without paths over `horizon` steps, a multiple of WORD; they count for `window` steps, 0: for all."""
    num_vertices, num_lanes, num_robots = len(task.first) - 1, len(task.head), len(task.goal)
    near = (num_vertices, num_lanes, horizon) if task.clashes.any else (1, 1, 1)
    held = num_robots * horizon * (2 if following else 1)
    return Traffic(
        at=np.full((num_robots, horizon), -1, np.int32),
        end=np.full(num_robots, -1, np.int64),
        on=cells_of(num_vertices, horizon, held, with_who=True),
        busy=np.zeros((num_vertices, horizon // WORD), np.uint32),
        num_near=np.zeros((near[0], near[2]), np.uint16),
        arrivals=cells_of(num_lanes, horizon, num_robots * horizon, with_who=False),
        along=np.zeros((num_lanes, horizon // WORD), np.uint32),
        num_barred=np.zeros((near[1], near[2]), np.uint16),
        barred=np.zeros((near[1], (near[2] + WORD - 1) // WORD), np.uint32),
        following=following,
        rotations=rotations and task.clashes.rotations,
        window=min(window + 1, horizon) if window else horizon,
    )


def traffic_of(task: RepairTask, path: np.ndarray, spare: int, *, following: bool, rotations: bool, window: int = 0) -> Traffic:
    """Traffic of the paths [T, R], with `spare` steps or more of room."""
    horizon = (len(path) + spare + 2 + WORD - 1) // WORD * WORD
    traffic = empty_traffic(task, horizon, following=following, rotations=rotations, window=window)
    traffic.at[:, : len(path)] = path.T
    traffic.at[:, len(path) :] = path[-1][:, None]
    away = path != task.goal
    traffic.end[:] = np.where(away.any(axis=0), len(path) - np.argmax(away[::-1], axis=0), 0)
    enter_all(task, traffic)
    return traffic


def path_of(traffic: Traffic) -> np.ndarray:
    """[T, R] where everybody is, up to the last arrival."""
    return np.ascontiguousarray(traffic.at[:, : int(traffic.end.max(initial=0)) + 1].T)
