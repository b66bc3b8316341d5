"""Kernel of independent planning: down the distance table, lowest lane first."""

import numpy as np

from mrp_sumo.search._kernel import kernel


@kernel
def shortest_path(first, head, distance, start):
    """Vertices of a shortest path by a [V] table of steps to its end."""
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
