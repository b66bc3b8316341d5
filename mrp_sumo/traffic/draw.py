"""Starts and goals drawn from a seed: as MRP-Bench draws them, and uniformly.

Refuses to draw more robots than there are vertices to stand on.
"""

import random

import numpy as np

from mrp_sumo.core.digraph import strong_components
from mrp_sumo.core.graph import IntArray, PlanGraph
from mrp_sumo.errors import PlanError

STARTS, GOALS = 1, 2  # purposes of the streams of chance


def mrp_bench_draw(num_vertices: int, num_robots: int, seed: int) -> tuple[IntArray, IntArray]:
    """The draw of MRP-Bench: `random.sample` after `random.seed(seed)` for starts, `seed + 1` for goals.

    Parameters
    ----------
    num_vertices
        Vertices of the nav graph, in the order of its files.
    num_robots
        How many to draw.
    seed
        Of the starts.

    Returns
    -------
    start, goal
        [R] vertices of the nav graph each, distinct within each; goals are not assigned yet. Two
        vertices may share a cell of the plan graph, and start and goal may lie in different components.

    Raises
    ------
    PlanError
        When there are fewer vertices than robots.
    """
    _enough(num_vertices, num_robots, "vertices")
    start = random.Random(seed).sample(range(num_vertices), num_robots)
    goal = random.Random(seed + 1).sample(range(num_vertices), num_robots)
    return np.array(start, np.int64), np.array(goal, np.int64)


def uniform_draw(graph: PlanGraph, num_robots: int, seed: int) -> tuple[IntArray, IntArray]:
    """Starts and goals uniformly among the stations of the strongly connected component with most of them.

    Every drawn start reaches every drawn goal, along one-way lanes too.

    Parameters
    ----------
    graph
        Its stations are drawn from: the vertices that stand for those of the nav graph; on a grid map
        every cell is one.
    num_robots
        How many to draw.
    seed
        Of both streams.

    Returns
    -------
    start, goal
        [R] vertices of the plan graph each, distinct within each; a robot may start at its goal.

    Raises
    ------
    PlanError
        When the component has fewer stations than robots.
    """
    station = np.unique(graph.vertex_of_station[graph.vertex_of_station >= 0])
    if len(station):
        piece = strong_components(graph.num_vertices, graph.tail, graph.head)[station]
        station = station[piece == np.bincount(piece).argmax()]
    _enough(len(station), num_robots, "stations that reach each other")
    start, goal = (np.random.default_rng([seed, purpose]).permutation(station)[:num_robots] for purpose in (STARTS, GOALS))
    return start.astype(np.int64), goal.astype(np.int64)


def _enough(available: int, num_robots: int, what: str) -> None:
    if num_robots < 0:
        raise PlanError(f"cannot draw {num_robots} robots, expected 0 or more")
    if num_robots > available:
        raise PlanError(f"cannot draw {num_robots} robots: there are {available} {what}")
