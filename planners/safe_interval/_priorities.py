"""Kernel of priorities: who goes before whom, kept transitive."""

import numpy as np

from mrp_sumo.search._kernel import kernel


@kernel(allocates=True)
def put_before(above, first, second):
    """Let one robot go before another, and all above it before all below the other.

    Parameters
    ----------
    above
        [R, R] bool whether one robot goes before another; the first of both may not be below the second.
    first, second
        The robots.

    Returns
    -------
    robots
        [N] the second and those below it, each after those above it.
    """
    num_robots, num = len(above), 0
    robots, rank = np.empty(num_robots, np.int64), np.empty(num_robots, np.int64)
    for b in range(num_robots):
        if b == second or above[second, b]:
            robots[num] = b
            num += 1
    for a in range(num_robots):
        if a == first or above[a, first]:
            for k in range(num):
                above[a, robots[k]] = True
    for k in range(num):
        rank[k] = above[:, robots[k]].sum()
    return robots[:num][np.argsort(rank[:num], kind="mergesort")]  # who is above has fewer above
