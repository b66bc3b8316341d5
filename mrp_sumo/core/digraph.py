"""Questions to directed graphs of N nodes that are given as arrays of arcs: what is connected, and whether there is a cycle.

Graphs without one-way arcs and graphs without cycles, which most are, are answered with numpy alone; scipy, slow to
import, is asked for the rest.
"""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.csr import ranges

IntArray = NDArray[np.int64]


def weak_components(num_nodes: int, tail: IntArray, head: IntArray) -> IntArray:
    """[N] component of each node when arcs are followed both ways, numbered by their lowest nodes."""
    lowest = np.arange(num_nodes)  # a node of the same component, in the end its lowest
    while True:
        low = np.minimum(lowest[tail], lowest[head])
        joined = lowest.copy()
        np.minimum.at(joined, lowest[tail], low)
        np.minimum.at(joined, lowest[head], low)
        while not np.array_equal(further := joined[joined], joined):
            joined = further
        if np.array_equal(joined, lowest):
            return np.unique(lowest, return_inverse=True)[1].reshape(-1)
        lowest = joined


def strong_components(num_nodes: int, tail: IntArray, head: IntArray) -> IntArray:
    """[N] component of each node, within which every node can be reached from every other; as for `weak_components`."""
    there, back = (np.unique(a * num_nodes + b) for a, b in ((tail, head), (head, tail)))
    if np.array_equal(there, back):
        return weak_components(num_nodes, tail, head)
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    arcs = coo_array((np.ones(len(tail), np.int8), (tail, head)), shape=(num_nodes, num_nodes))
    label: IntArray = connected_components(arcs, connection="strong")[1].astype(np.int64)
    return label


def has_cycle(num_nodes: int, tail: IntArray, head: IntArray) -> bool:
    """True where arcs lead from some node back to itself: nodes that no arc enters are taken away until there are none."""
    count = partial(np.bincount, minlength=num_nodes)
    order = np.argsort(tail, kind="stable")
    head = head[order]
    first = np.append(0, np.cumsum(count(tail)))
    entering = count(head)
    free, num_left = np.flatnonzero(entering == 0), num_nodes
    while len(free):
        num_left -= len(free)
        degree = first[free + 1] - first[free]
        entered, times = np.unique(head[ranges(first[free], degree)], return_counts=True)
        entering[entered] -= times
        free = entered[entering[entered] == 0]
    return num_left > 0
