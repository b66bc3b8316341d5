"""The shortest way of one robot in metres, over some of the lanes."""

from typing import TYPE_CHECKING

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, NavGraph

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def shortest_route(graph: NavGraph, open_: BoolArray, start: int, goal: int) -> list[int] | None:
    """Vertices of the shortest way from `start` to `goal`, both included; None if there is none."""
    from scipy.sparse.csgraph import dijkstra

    distance, before = dijkstra(_lengths(graph, open_), indices=start, return_predecessors=True)
    if not np.isfinite(distance[goal]):
        return None
    route = [goal]
    while route[-1] != start:
        route.append(int(before[route[-1]]))
    return route[::-1]


def reach_m(graph: NavGraph, open_: BoolArray, start: IntArray) -> FloatArray:
    """[S, V] metres from each start to every vertex over open lanes, inf where no way leads."""
    from scipy.sparse.csgraph import dijkstra

    metres: FloatArray = dijkstra(_lengths(graph, open_), indices=start)
    return metres


def _lengths(graph: NavGraph, open_: BoolArray) -> "csr_array":
    from scipy.sparse import coo_array

    lanes = np.flatnonzero(open_)
    return coo_array((graph.length_m[lanes], (graph.tail[lanes], graph.head[lanes])), shape=(graph.num_vertices,) * 2).tocsr()
