"""Which way is nearer, in two bits a vertex: distance tables for thousands of robots on large maps.

On a graph whose lanes all run both ways, steps to a goal differ by at most one between neighbours, so the
distance modulo 3 tells which of two neighbours is nearer: a quarter of a byte a vertex instead of two to
four. Where one distance is known, those along any way from there follow. Distances are found by a breadth-first search
from the goal, which goes everywhere or keeps to the vertices v with d(v) + h(v, robot) <= d(robot) + slack, h an
admissible guess of what is left: they are exact there, since no shortest path from such a vertex leaves the region.
A robot that comes to the region's edge has it extended. What is not known is 0, so that memory that nobody wrote is never made.
"""

import numpy as np

from mrp_sumo.search._kernel import kernel

UNKNOWN = 0
SLACK_STEPS = 10


@kernel(allocates=False)
def read_code(code, robot, v):
    """Distance modulo 3 and 1, or UNKNOWN."""
    return np.int64((code[robot, v >> 2] >> (2 * (v & 3))) & 3)


@kernel(allocates=False)
def step_towards(code, robot, u, v):
    """Steps to the goal of `robot` from u less those from v, neighbours or the same: -1, 0 or 1; 0 where one is not known."""
    a, b = read_code(code, robot, u), read_code(code, robot, v)
    if a == UNKNOWN or b == UNKNOWN:
        return np.int64(0)
    d = (a - b + 3) % 3
    return np.int64(d if d < 2 else -1)


@kernel(allocates=False)
def extend(first, head, goal, robot, at, code, queue, bound, slack):
    """Search again for a robot at vertex `at`, with four times the room each time until it and its neighbours are known.

    Parameters
    ----------
    first, head
        The graph in int32, every lane with its opposite.
    goal, robot, at
        Where the robot goes, who it is, where it is.
    code
        [R, ceil(V / 4)] uint8; the robot's row is overwritten.
    queue
        [V] int32, scratch.
    bound
        [V, 2] float32 coordinates, scaled such that no lane is longer than 1 by the sum of absolute differences.
    slack
        Of the first search; V or more is everywhere.

    Returns
    -------
    int
        Steps from `at` to the goal, -1 when it cannot be reached.
    """
    num_vertices = len(first) - 1
    while True:
        distance, whole = _search(first, head, goal, robot, at, code, queue, bound, slack)
        if whole:
            return distance
        known = distance >= 0
        for k in range(first[at], first[at + 1]):
            known = known and read_code(code, robot, head[k]) != UNKNOWN
        if known:
            return distance
        slack = slack * 4 if slack < num_vertices else 4 * num_vertices


@kernel(allocates=False)
def _search(first, head, goal, robot, at, code, queue, bound, slack):
    """One breadth-first search in the region of `slack`; (steps from `at` or -1, whether the region was everything)."""
    row = code[robot]
    if read_code(code, robot, goal) != UNKNOWN:
        row[:] = 0
    queue[0] = goal
    row[goal >> 2] |= np.uint8(1 << (2 * (goal & 3)))
    x, y = bound[at, 0], bound[at, 1]
    limit = abs(bound[goal, 0] - x) + abs(bound[goal, 1] - y) + np.float32(slack + 0.01)
    begin, end, whole, nearby = 0, 1, True, slack < len(first) - 1
    found = np.int64(0) if goal == at else np.int64(-1)
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
                if nearby and abs(bound[u, 0] - x) + abs(bound[u, 1] - y) > left:
                    whole = False
                    continue
                row[u >> 2] |= np.uint8(mark << shift)
                if u == at:
                    found = np.int64(d)
                queue[end] = u
                end += 1
    return found, whole


@kernel(allocates=False)
def extend_all(first, head, goal, at, begin, end, code, queue, bound, slack, steps):
    """`extend` for those of robots begin to end - 1 whose own vertices are not known, with their steps to the goal in `steps`."""
    for robot in range(begin, end):
        if read_code(code, robot, at[robot]) == UNKNOWN:
            steps[robot] = extend(first, head, goal[robot], robot, at[robot], code, queue, bound, slack)
