"""Kernels that planners share: the graph as arrays, lanes into a vertex, breadth-first distance tables."""

import numpy as np

from mrp_sumo.search._kernel import kernel

UNREACHABLE = 1 << 30  # distance of a vertex the goal cannot be reached from: larger than any, and two of them still fit int32


@kernel(allocates=True)
def reversed_lanes(first, head):
    """The lanes that enter each vertex.

    Parameters
    ----------
    first, head
        [V + 1], [L] CSR of the lanes that leave each vertex.

    Returns
    -------
    first_in, tail_in
        [V + 1], [L] CSR of the tails of the lanes that enter each vertex, ascending.
    """
    num_vertices = len(first) - 1
    first_in = np.zeros(num_vertices + 1, np.int64)
    for lane in range(len(head)):
        first_in[head[lane] + 1] += 1
    for v in range(num_vertices):
        first_in[v + 1] += first_in[v]
    at = first_in[:-1].copy()
    tail_in = np.empty(len(head), np.int64)
    for u in range(num_vertices):
        for lane in range(first[u], first[u + 1]):
            v = head[lane]
            tail_in[at[v]] = u
            at[v] += 1
    return first_in, tail_in


@kernel
def steps_to(goal, first_in, tail_in, distance, queue):
    """Fill `distance` [V] int32 with the steps from each vertex to `goal`; `queue` [V] is scratch."""
    distance[:] = UNREACHABLE
    distance[goal] = 0
    queue[0] = goal
    begin, end = 0, 1
    while begin < end:
        v = queue[begin]
        begin += 1
        next_distance = distance[v] + 1
        for k in range(first_in[v], first_in[v + 1]):
            u = tail_in[k]
            if distance[u] == UNREACHABLE:
                distance[u] = next_distance
                queue[end] = u
                end += 1


@kernel(allocates=True)
def shortest_path(first, head, distance, start):
    """Vertices of a shortest path by a [V] table of steps to its end: the lowest lane first."""
    path = np.empty(distance[start] + 1, np.int64)
    v = start
    path[0] = v
    for step in range(1, len(path)):
        for lane in range(first[v], first[v + 1]):
            if distance[head[lane]] < distance[v]:
                v = head[lane]
                break
        path[step] = v
    return path
