"""Starts and goals drawn from a seed: as MRP-Bench draws them, and uniformly.

Refuses to draw more robots than there are vertices to stand on, or may stand at once.
"""

import random

import numpy as np

from mrp_sumo.core.digraph import strong_components
from mrp_sumo.core.graph import IntArray, PlanGraph
from mrp_sumo.core.near import pairs_within
from mrp_sumo.errors import PlanError
from mrp_sumo.traffic.resources import groups_of, resources_of

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


def uniform_draw(
    graph: PlanGraph, num_robots: int, seed: int, separation_m: float = 0.0, *, anywhere: bool = False
) -> tuple[IntArray, IntArray]:
    """Starts and goals uniformly among the stations of the strongly connected component with most of them.

    Every drawn start reaches every drawn goal, along one-way lanes too. No two starts, and no two goals, are in one mutex group or
    nearer to each other than the separation: a station that is, to one drawn before, is passed over. None is in a lift.

    Parameters
    ----------
    graph
        Its stations are drawn from: the vertices that stand for those of the nav graph; on a grid map
        every cell is one.
    num_robots
        How many to draw.
    seed
        Of both streams.
    separation_m
        The least distance of two robots' centres.
    anywhere
        Among all vertices of the plan graph instead, between stations, too.

    Returns
    -------
    start, goal
        [R] vertices of the plan graph each, distinct within each; a robot may start at its goal.

    Raises
    ------
    PlanError
        When the component has fewer stations than robots, or fewer that robots may stand on at once.
    """
    station = np.arange(graph.num_vertices) if anywhere else np.unique(graph.vertex_of_station[graph.vertex_of_station >= 0])
    if graph.is_ride.any():  # who stands at a lift keeps others from it
        station = station[~graph.having("cabin")[station]]
    if len(station):
        piece = strong_components(graph.num_vertices, graph.tail, graph.head)[station]
        station = station[piece == np.bincount(piece).argmax()]
    what = "vertices" if anywhere else "stations"
    _enough(len(station), num_robots, f"{what} that reach each other")
    orders = [np.random.default_rng([seed, purpose]).permutation(station) for purpose in (STARTS, GOALS)]
    shared = _shared(graph, station, separation_m)
    start, goal = (_apart(order, shared, num_robots, what) for order in orders)
    return start.astype(np.int64), goal.astype(np.int64)


def _shared(graph: PlanGraph, station: IntArray, separation_m: float) -> dict[int, set[tuple[str, int]]]:
    """What each station shares with others, as names: its mutex groups, and pairs of stations that are too near; most share nothing."""
    shared: dict[int, set[tuple[str, int]]] = {}
    if any(groups_of(options) for options in (*graph.vertex_options, *graph.lane_options)):
        found = resources_of(graph, separation_m)
        for v in station.tolist():
            zones = found.zones_of[found.zones_first[v] : found.zones_first[v + 1]]
            if groups := {("group", int(g)) for g in zones[zones >= len(found.zone)]}:
                shared[v] = groups
    near = pairs_within(graph.xy[station], separation_m - 1e-9) if separation_m > 0 else np.zeros((0, 2), np.int64)
    for pair, (a, b) in enumerate(station[near].tolist()):
        if graph.level[a] == graph.level[b]:
            for v in (a, b):
                shared.setdefault(v, set()).add(("near", pair))
    return shared


def _apart(order: IntArray, shared: dict[int, set[tuple[str, int]]], num_robots: int, what: str) -> IntArray:
    """[R] the first stations in an order that share nothing."""
    if not shared:
        return order[:num_robots]
    taken: set[tuple[str, int]] = set()
    chosen: list[int] = []
    for v in order.tolist():
        own = shared.get(v, set())
        if len(chosen) < num_robots and taken.isdisjoint(own):
            taken |= own
            chosen.append(v)
    _enough(len(chosen), num_robots, f"{what} on which robots may stand at once, one for each mutex group and none too near to another")
    return np.array(chosen, np.int64)


def _enough(available: int, num_robots: int, what: str) -> None:
    if num_robots < 0:
        raise PlanError(f"cannot draw {num_robots} robots, expected 0 or more")
    if num_robots > available:
        raise PlanError(f"cannot draw {num_robots} robots: there are {available} {what}")
