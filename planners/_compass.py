"""Which way is nearer, in two bits a vertex: distance tables for thousands of robots on large maps.

On a graph whose lanes all run both ways, steps to a goal differ by at most one between neighbours, so the
distance modulo 3 tells which of two neighbours is nearer: a quarter of a byte a vertex instead of two to
four. Distances are found by a breadth-first search from the goal that keeps to the vertices v with
d(v) + h(v, robot) <= d(robot) + slack, h an admissible guess of what is left: they are exact there, since no
shortest path from such a vertex leaves the region. A robot that comes to the region's edge has it extended.
"""

import numpy as np

from mrp_sumo.search._kernel import kernel

UNKNOWN = 3
SLACK_STEPS = 10


@kernel
def read_code(code, robot, v):
    """Distance modulo 3, or UNKNOWN."""
    return np.int64((code[robot, v >> 2] >> (2 * (v & 3))) & 3)


@kernel
def extend(first, head, goal, robot, at, code, queue, bound):
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

    Returns
    -------
    int
        Steps from `at` to the goal, -1 when it cannot be reached.
    """
    num_vertices = len(first) - 1
    slack = SLACK_STEPS
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


@kernel
def _search(first, head, goal, robot, at, code, queue, bound, slack):
    """One breadth-first search in the region of `slack`; (steps from `at` or -1, whether the region was everything)."""
    row = code[robot]
    row[:] = 255
    queue[0] = goal
    row[goal >> 2] ^= np.uint8(3 << (2 * (goal & 3)))
    x, y = bound[at, 0], bound[at, 1]
    limit = abs(bound[goal, 0] - x) + abs(bound[goal, 1] - y) + np.float32(slack + 0.01)
    begin, end, whole = 0, 1, True
    found = np.int64(0) if goal == at else np.int64(-1)
    d = 0
    while begin < end:
        d += 1
        change = 3 ^ (d % 3)
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
                if abs(bound[u, 0] - x) + abs(bound[u, 1] - y) > left:
                    whole = False
                    continue
                row[u >> 2] ^= np.uint8(change << shift)
                if u == at:
                    found = np.int64(d)
                queue[end] = u
                end += 1
    return found, whole


@kernel
def extend_all(first, head, goal, at, begin, end, code, queue, bound, steps):
    """`extend` for robots begin to end - 1, with their steps to the goal in `steps`."""
    for robot in range(begin, end):
        steps[robot] = extend(first, head, goal[robot], robot, at[robot], code, queue, bound)
