"""Instance that the kernels of PIBT and LaCAM plan on, and how near vertices are to a robot's goal: in tables of steps, or packed.

Packed, it takes two bits a vertex to say which way is nearer, for thousands of robots on large maps. On a graph whose lanes all run both
ways, steps to a goal differ by at most one between neighbours, so the distance modulo 3 tells which of two neighbours is nearer: a quarter
of a byte a vertex instead of two to four. Where one distance is known, those along any way from there follow. Distances are found by a
breadth-first search from the goal, which goes everywhere or keeps to the vertices v with d(v) + h(v, robot) <= d(robot) + slack, h an
admissible guess of what is left: they are exact there, since no shortest path from such a vertex leaves the region. Where the guess is
right for the robot itself, as it mostly is on open floors, a band about the straight line is enough: its own distance is exact then, and
others are those of ways within the band. A robot that comes to the region's edge has it extended. What is not known is 0, so that memory
that nobody wrote is never made.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.core.clashes import Clashes
from mrp_sumo.search._kernel import kernel

UNKNOWN = 0
SLACK_STEPS = 10
BAND_STEPS = 16  # on either side of the straight line


class Compass(NamedTuple):
    """Packed distances of R robots, and what is needed to extend them; all are of length 1 where steps are in a table."""

    code: np.ndarray  # [R, ceil(V / 4)] uint8, distances modulo 3
    first: np.ndarray  # [V + 1] int32, lanes that leave a vertex; every lane has its opposite
    head: np.ndarray  # [L] int32
    queue: np.ndarray  # [V] int32, scratch
    bound: np.ndarray  # [V, 2] float32 coordinates, scaled such that no lane is longer than 1 by the sum of absolute differences


class PibtInstance(NamedTuple):
    """Instance, which does not change while planning; only the compass's code is written to, and grows.

    V vertices, L lanes, R robots; S spots and N moves between them, see `core.clashes`. Not a `Spots`: kernels pass on all that is in here.
    """

    first: np.ndarray  # [V + 1] int64, lanes that leave a vertex
    head: np.ndarray  # [L] int64
    goal: np.ndarray  # [R] int64
    steps: np.ndarray  # [R] int64 from each robot's start to its goal
    base_order: np.ndarray  # [R] int32 robots, those longest on their way first where that is known, then the farthest from their goals
    table: np.ndarray  # [R, V] steps to the robot's goal, or [1, 1] when packed
    packed: bool  # distances are looked up in `compass` instead: only which way is nearer is known
    compass: Compass
    two_way: bool  # every lane has its opposite: robots can swap in corridors
    guided: bool  # robots go by `guide`, not by steps
    guide: np.ndarray  # [R, V] int32 what is left to the goal, see _flow; [1, 1] where there is no guide
    toll: np.ndarray  # [L] int64 what lanes cost there
    path: np.ndarray  # [R, N + 1] int32 vertices of shortest ways that meet few others, see _ways; [0, 1] where there are none
    following: bool  # nobody may enter a vertex in the step in which another leaves it
    rotations: bool  # rings of robots may move at once
    hindrance: bool  # ties are broken in favour of vertices that fewer neighbours want
    near: bool  # there are clashes
    clashes: Clashes  # which moves robots cannot make in one step because they would come too close
    shared: bool  # several vertices are one spot, as where vehicles cannot turn in place
    spot: np.ndarray  # [V] int64 spot of a vertex
    move: np.ndarray  # [L] int64 move of a lane
    spot_first: np.ndarray  # [S + 1] int64 moves that leave a spot
    spot_head: np.ndarray  # [N] int64
    spot_tail: np.ndarray  # [N] int64
    back: np.ndarray  # [N] int64 the move the other way, -1: none


@kernel(inline="always")
def spot_of(world, v):
    """The spot that a robot takes at v."""
    return world.spot[v]


@kernel
def nearer(world, robot, u, v):
    """Steps to the goal of `robot` from u less those from v. u and v are neighbours or the same."""
    if not world.packed:
        return np.int64(world.table[robot, u]) - np.int64(world.table[robot, v])
    return step_towards(world.compass.code, robot, u, v)


@kernel
def prefers(world, robot, u, v):
    """True if a robot prefers u to v, which are neighbours or the same."""
    if world.guided:
        return world.guide[robot, u] < world.guide[robot, v]
    return nearer(world, robot, u, v) < 0


@kernel(inline="always")
def move_along(world, lane):
    """The move between spots that a robot makes along a lane."""
    return world.move[lane] if world.shared else np.int64(lane)


@kernel
def wants(world, robot, v, spot):
    """True if a robot at v prefers to be at a spot beside it."""
    if not world.shared:
        return prefers(world, robot, spot, v)
    for lane in range(world.first[v], world.first[v + 1]):
        if world.spot[world.head[lane]] == spot:
            return prefers(world, robot, world.head[lane], v)
    return False


@kernel
def next_on_way(world, robot, v):
    """The vertex after v on the robot's way, -1 where v is not on it, or the robot has none."""
    if len(world.path) != len(world.goal):
        return np.int64(-1)
    path = world.path[robot]
    if not world.packed:
        step = world.steps[robot] - np.int64(world.table[robot, v])
        return np.int64(path[step + 1]) if 0 <= step < len(path) - 1 and path[step] == v else np.int64(-1)
    for step in range((world.steps[robot] - read_code(world.compass.code, robot, v) + 1) % 3, world.steps[robot], 3):
        if path[step] == v:
            return np.int64(path[step + 1])
    return np.int64(-1)


@kernel
def read_code(code, robot, v):
    """Distance modulo 3 and 1, or UNKNOWN."""
    return np.int64((code[robot, v >> 2] >> (2 * (v & 3))) & 3)


@kernel
def step_towards(code, robot, u, v):
    """Steps to the goal of `robot` from u less those from v, neighbours or the same: -1, 0 or 1; 0 where one is not known."""
    a, b = read_code(code, robot, u), read_code(code, robot, v)
    if a == UNKNOWN or b == UNKNOWN:
        return np.int64(0)
    d = (a - b + 3) % 3
    return np.int64(d if d < 2 else -1)


@kernel
def extend(compass, goal, robot, at, slack):
    """Search again for a robot at vertex `at`, with four times the room each time until it and its neighbours are known.

    Parameters
    ----------
    compass
        The robot's row of its code is overwritten.
    goal, robot, at
        Where the robot goes, who it is, where it is.
    slack
        Of the first search; V or more is everywhere.

    Returns
    -------
    int
        Steps from `at` to the goal, -1 when it cannot be reached.
    """
    first, head, code = compass.first, compass.head, compass.code
    num_vertices = len(first) - 1
    while True:
        distance, whole = _search(compass, goal, robot, at, slack, np.float32(np.inf))
        if whole:
            return distance
        known = distance >= 0
        for k in range(first[at], first[at + 1]):
            known = known and read_code(code, robot, head[k]) != UNKNOWN
        if known:
            return distance
        slack = slack * 4 if slack < num_vertices else 4 * num_vertices


@kernel
def _search(compass, goal, robot, at, slack, aside):
    """One breadth-first search in the region of `slack`, so far aside of the line from the goal to `at` at most.

    Returns steps from `at` or -1, and whether the region was everything.
    """
    code, first, head, queue, bound = compass
    row = code[robot]
    if read_code(code, robot, goal) != UNKNOWN:
        row[:] = 0
    queue[0] = goal
    row[goal >> 2] |= np.uint8(1 << (2 * (goal & 3)))
    x, y = bound[at, 0], bound[at, 1]
    dx, dy = bound[goal, 0] - x, bound[goal, 1] - y
    limit, most = abs(dx) + abs(dy) + np.float32(slack + 0.01), aside * max(np.hypot(dx, dy), np.float32(1.0))
    begin, end, whole, nearby = 0, 1, True, slack < len(first) - 1
    nearest = np.int64(0) if goal == at else np.int64(-1)
    d = 0
    while begin < end:
        d += 1
        mark = d % 3 + 1
        left = limit - np.float32(d)
        level_end = end
        while begin < level_end:
            v = queue[begin]
            begin += 1
            for k in range(first[v], first[v + 1]):
                u = head[k]
                shift = 2 * (u & 3)
                if (row[u >> 2] >> shift) & 3 != UNKNOWN:
                    continue
                ux, uy = bound[u, 0] - x, bound[u, 1] - y
                if nearby and (abs(ux) + abs(uy) > left or abs(ux * dy - uy * dx) > most):
                    whole = False
                    continue
                row[u >> 2] |= np.uint8(mark << shift)
                if u == at:
                    nearest = np.int64(d)
                queue[end] = u
                end += 1
    return nearest, whole


@kernel
def extend_all(compass, goal, at, begin, end, slack, steps):
    """`extend` for those of robots begin to end - 1 whose own vertices are not known, with their steps to the goal in `steps`."""
    bound = compass.bound
    for robot in range(begin, end):
        if read_code(compass.code, robot, at[robot]) == UNKNOWN:
            least = abs(bound[goal[robot], 0] - bound[at[robot], 0]) + abs(bound[goal[robot], 1] - bound[at[robot], 1])
            steps[robot] = -1
            if slack < len(compass.first) - 1 and least > BAND_STEPS:
                steps[robot] = _search(compass, goal[robot], robot, at[robot], slack, np.float32(BAND_STEPS))[0]
            if steps[robot] < 0 or steps[robot] > least + np.float32(0.01):
                steps[robot] = extend(compass, goal[robot], robot, at[robot], slack)
