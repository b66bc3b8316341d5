"""Kernels of a traffic map: what the search has seen of traffic makes lanes dear for the searches after it.

After the abstract of Shen, Zhang, Chen, Harabor, "A lightweight traffic map for efficient anytime LaCAM*", 2026 (arXiv 2603.07891):
the map is made by the search itself, of what PIBT did in configurations that it generated, instead of by searching for robots one by
one before it begins, and guides the search from there on. Details are ours: a step in which a robot comes no nearer its goal is a delay
on the lane that it would have taken, and a lane costs what robots took on the average to get over it, in all solutions so far.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel
from planners.configuration._flow import MOST, STEP
from planners.configuration._pibt_instance import nearer


class TrafficMap(NamedTuple):
    """What was seen on L lanes."""

    passages: np.ndarray  # [L] int64 moves along a lane
    delay: np.ndarray  # [L] int64 steps lost by robots that would have taken it


@kernel(allocates=False)
def observe(world, traffic, path):
    """Enter what robots did on the way [T, R] to their goals."""
    for t in range(len(path) - 1):
        for i in range(path.shape[1]):
            v, u = np.int64(path[t, i]), np.int64(path[t + 1, i])
            if v == world.goal[i]:
                continue
            lost = 1 + nearer(world, i, u, v)
            for lane in range(world.first[v], world.first[v + 1]):
                if lost == 0 and world.head[lane] == u:
                    traffic.passages[lane] += 1
                if lost > 0 and nearer(world, i, world.head[lane], v) < 0:
                    traffic.delay[lane] += lost
                    break


@kernel(allocates=False)
def write_tolls(traffic, toll):
    """[L] int64 what lanes cost, STEP to MOST."""
    for lane in range(len(toll)):
        seen = traffic.passages[lane] + 1
        toll[lane] = min(STEP + STEP * traffic.delay[lane] // seen, MOST)
