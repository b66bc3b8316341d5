"""What the kernels of PIBT and LaCAM plan on, and how near vertices are to a robot's goal."""

from typing import NamedTuple

import numpy as np

from mrp_sumo.core.clashes import Clashes
from mrp_sumo.search._kernel import kernel
from planners._compass import read_code, step_towards


class PibtInstance(NamedTuple):
    """What does not change while planning. V vertices, L lanes, R robots; arrays are only read (but `code`, which grows)."""

    first: np.ndarray  # [V + 1] int64, lanes that leave a vertex
    head: np.ndarray  # [L] int64
    tail: np.ndarray  # [L] int64
    goal: np.ndarray  # [R] int64
    steps: np.ndarray  # [R] int64 from each robot's start to its goal
    table: np.ndarray  # [R, V] steps to the robot's goal, or [1, 1] when packed
    packed: bool  # distances are looked up in `code` instead: only which way is nearer is known
    code: np.ndarray  # [R, ceil(V / 4)] uint8, see _compass
    first_packed: np.ndarray  # `first` and `head` in int32, a queue and coordinates: see _compass; [1] and [1, 2] unless packed
    head_packed: np.ndarray
    queue: np.ndarray
    bound: np.ndarray
    two_way: bool  # every lane has its opposite: robots can swap in corridors
    guided: bool  # robots go by `guide`, not by steps
    guide: np.ndarray  # [R, V] int32 what is left to the goal, see _flow; [1, 1] where there is no guide
    toll: np.ndarray  # [L] int64 what lanes cost there
    way: np.ndarray  # [R, N + 1] int32 vertices of shortest ways that meet few others, see _ways; [0, 1] where there are none
    following: bool  # nobody may enter a vertex in the step in which another leaves it
    rotations: bool  # rings of robots may move at once
    near: bool  # there are clashes
    clashes: Clashes  # which moves robots cannot make in one step because they would come too close


class PibtScratch(NamedTuple):
    """Room for a step. `now`, `next` and `wished` are -1 everywhere between calls."""

    now: np.ndarray  # [V] robot on each vertex
    next: np.ndarray  # [V] robot that has reserved it
    wished: np.ndarray  # [V] robot that waits until nobody is there; [1] where there are no clashes
    onward: np.ndarray  # [R] where local guidance leads each robot, -1: nowhere, see _local_guidance
    wish: np.ndarray  # [R] the lane for which each robot waits, -1: none
    stack: np.ndarray  # [R] robots that inherited priority
    choice: np.ndarray  # [R] position in the robot's candidates
    candidate: np.ndarray  # [R, D + 1] vertices from the most preferred down; D the largest out-degree
    num: np.ndarray  # [R] of them
    partner: np.ndarray  # [R] robot to swap with, -1 for none
    key: np.ndarray  # [D + 1] what candidates are sorted by


@kernel(allocates=False)
def nearer(world, robot, u, v):
    """Steps to the goal of `robot` from u less those from v. u and v are neighbours or the same."""
    if not world.packed:
        return np.int64(world.table[robot, u]) - np.int64(world.table[robot, v])
    return step_towards(world.code, robot, u, v)


@kernel(allocates=False)
def prefers(world, robot, u, v):
    """Whether a robot prefers u to v, which are neighbours or the same."""
    if world.guided:
        return world.guide[robot, u] < world.guide[robot, v]
    return nearer(world, robot, u, v) < 0


@kernel(allocates=False)
def next_on_way(world, robot, v):
    """The vertex after v on the robot's way, -1 where v is not on it, or the robot has none."""
    if len(world.way) != len(world.goal):
        return np.int64(-1)
    way = world.way[robot]
    if not world.packed:
        step = world.steps[robot] - np.int64(world.table[robot, v])
        return np.int64(way[step + 1]) if 0 <= step < len(way) - 1 and way[step] == v else np.int64(-1)
    for step in range((world.steps[robot] - read_code(world.code, robot, v) + 1) % 3, world.steps[robot], 3):
        if way[step] == v:
            return np.int64(way[step + 1])
    return np.int64(-1)
