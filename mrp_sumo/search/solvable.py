"""Tells problems that no planner can solve, where that is cheap to see.

On a line robots keep their order, on a ring their cyclic order (pebble motion: Kornhauser, Miller, Spirakis,
FOCS 1984); few robots on a small graph are searched outright. Says nothing about other problems.
"""

import numpy as np

from mrp_sumo.core.clashes import Clashes, Spots, no_clashes, vertices_alone
from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.problem import Problem
from mrp_sumo.search.distance import UNREACHABLE, distances

MOST_STATES = 2_000_000
MOST_MOVES = 100_000_000


def order_broken(problem: Problem) -> tuple[int, int] | None:
    """Two robots on a line or ring that would have to pass each other, or None."""
    graph, target = problem.graph, problem.target
    if problem.num_robots < 2 or not graph.num_lanes or (graph.reverse < 0).any():
        return None
    degree = np.diff(graph.first)
    junctions = np.flatnonzero(degree > 2)
    if len(junctions) and (distances(graph).to(int(junctions[0]))[target] < UNREACHABLE).all():
        return None  # the common case, without looking for components
    narrow = np.ones(graph.num_components, np.bool_)
    narrow[graph.component[degree > 2]] = False
    for component in np.unique(graph.component[problem.start]):
        robots = np.flatnonzero(graph.component[problem.start] == component)
        if not narrow[component] or len(robots) < 2 or (graph.component[target[robots]] != component).any():
            continue
        place, ring = _along(problem, np.flatnonzero(graph.component == component))
        before = robots[np.argsort([place[v] for v in problem.start[robots].tolist()])]
        after = robots[np.argsort([place[v] for v in target[robots].tolist()])]
        if ring:
            after = np.roll(after, -int(np.flatnonzero(after == before[0])[0]))
        differs = np.flatnonzero(before != after)
        if len(differs):
            return int(before[differs[0]]), int(after[differs[0]])
    return None


def _along(problem: Problem, vertices: IntArray) -> tuple[dict[int, int], bool]:
    """The position of each vertex of a line or ring, and whether it is a ring."""
    graph = problem.graph
    degree = np.diff(graph.first)
    ends = vertices[degree[vertices] < 2]
    ring = not len(ends)
    v, previous = int(vertices[0] if ring else ends[0]), -1
    place: dict[int, int] = {}
    while v not in place:
        place[v] = len(place)
        onward = [int(u) for u in graph.head[graph.first[v] : graph.first[v + 1]] if u != previous]
        if onward:
            previous, v = v, onward[0]
    return place, ring


def unsolvable(problem: Problem, clashes: Clashes, spots: Spots, following: bool = False) -> bool:
    """True if a search of all joint states, where it is small, finds no way. False for large problems."""
    from mrp_sumo.search._joint import can_reach

    graph, target = problem.graph, problem.target
    if clashes.any or len(spots.place) < graph.num_vertices:  # robots of different components may come too close
        degree = float(np.diff(graph.first).mean()) + 1
        num_states = problem.num_robots * np.log(graph.num_vertices)
        if num_states > np.log(MOST_STATES) or num_states + problem.num_robots * np.log(degree) > np.log(MOST_MOVES):
            return False
        return not can_reach(graph.first, graph.head, np.array(problem.start), np.array(target), following, clashes, spots)
    alone = no_clashes(0, 0, rotations=clashes.rotations)
    for component in np.unique(graph.component[problem.start]):
        vertices = np.flatnonzero(graph.component == component)
        robots = np.flatnonzero(graph.component[problem.start] == component)
        degree = float(np.diff(graph.first)[vertices].mean()) + 1
        states, moves = len(robots) * np.log(len(vertices)), len(robots) * np.log(len(vertices) * degree)
        if states > np.log(MOST_STATES) or moves > np.log(MOST_MOVES):
            continue
        number = np.full(graph.num_vertices, -1)
        number[vertices] = np.arange(len(vertices))
        inside = np.isin(graph.tail, vertices) & np.isin(graph.head, vertices)
        tail, head = number[graph.tail[inside]], number[graph.head[inside]]
        first = np.searchsorted(tail, np.arange(len(vertices) + 1)).astype(np.int64)
        ends, head = (number[problem.start[robots]], number[target[robots]]), head.astype(np.int64)
        if (ends[1] < 0).any() or not can_reach(
            first, head, *ends, following, alone, vertices_alone(first, head, tail, np.full(len(head), -1))
        ):
            return True
    return False
