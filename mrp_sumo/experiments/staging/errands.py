"""Check that the tasks of a scenario can be done at all: a robot that each is for can make its stops, one after the other.

Refuses tasks at places that no robot can reach, in one line.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from mrp_sumo.core.digraph import strong_components
from mrp_sumo.core.graph import PlanGraph
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.stream import ClosedLoop, TaskList, TaskSource, TaskStream
from mrp_sumo.core.task import NOBODY, Station
from mrp_sumo.search.distance import UNREACHABLE, distances
from mrp_sumo.traffic.turns import obstacle_to


def unreachable(sources: Sequence[TaskSource], problem: Problem) -> str:
    """Tasks that no robot can do, in words; '' where all tasks can be done."""
    component_of = [strong_components(graph.num_vertices, graph.tail, graph.head) for graph in problem.graph_of_kind]
    if not any(piece.any() for piece in component_of):  # all is one piece
        return ""
    of_start = zip(problem.fleet.kind.tolist(), problem.start.tolist())
    starts = {(k, int(component_of[k][v])): v for k, v in reversed(list(of_start))}  # one robot of each type and piece
    checked: set[tuple[tuple[Station, ...], int]] = set()
    for name, route, robot in _routes(sources):
        pieces = {(0, int(component_of[0][v])) for station in route for v in station.places}
        is_one = len(starts) == 1 and pieces == set(starts) and not problem.fleet.is_by_load  # the usual case: one piece
        if (route, robot) in checked or is_one:
            continue
        checked.add((route, robot))
        able = starts if robot == NOBODY else {(int(problem.fleet.kind[robot]), 0): int(problem.start[robot])}
        graphs, loaded = problem.graph_of_kind, len(problem.graph_of_kind) // 2 if problem.fleet.is_by_load else 0
        furthest = max((_stops_made(graphs[k], graphs[k + loaded], start, route) for (k, _), start in able.items()), default=0)
        if furthest < len(route):
            before = f" after '{route[furthest - 1].name}'" if furthest else ""
            who = "no robot can" if robot == NOBODY else f"{problem.fleet.robot_name[robot]} cannot"
            return f"{who} reach '{route[furthest].name}'{before}, a stop of '{name}'{_no_way_back(problem, route[furthest])}"
    return ""


def _no_way_back(problem: Problem, station: Station) -> str:
    """Why a type that cannot turn in place would not come back along the lane to a station, in words; '' if it would."""
    graph = replace(problem.graph, closed_to={})
    models = [model for model in problem.fleet.types if model.is_vehicle]
    routes = [[u, v, u] for v in station.places for u in graph.tail[graph.head == v].tolist() if graph.lane_between(v, u) >= 0]
    return next((f": {why}" for model in models for route in routes if (why := obstacle_to(graph, model, route))), "")


def oddities(sources: Sequence[TaskSource], problem: Problem, end_s: float) -> tuple[str, ...]:
    """A line each for people: orders that are released after the end of a run, and last stops from which robots do not come back."""
    errands = []
    listed = [task for source in sources if isinstance(source, TaskList) for task in source.listed]
    late = [task for task in listed if task.release_s >= end_s]
    if late:
        first = f"the first is '{late[0].name}' at {late[0].release_s:g} s"
        errands.append(f"{len(late)} of {len(listed)} orders are released after the run's end at {end_s:g} s, {first}")
    graph, steps = problem.graph, distances(problem.graph)
    if not strong_components(graph.num_vertices, graph.tail, graph.head).any():
        return tuple(errands)
    routes = dict.fromkeys((name, route[0], route[-1]) for name, route, _ in _routes(sources))
    begins = {v for _, first_station, _ in routes for v in first_station.places}
    ends = {station.name: (name, station.places) for name, _, station in routes}
    for station, (name, places) in ends.items():
        if all(int(steps.to(u)[v]) >= UNREACHABLE for v in places for u in begins):
            errands.append(
                f"no way leads from '{station}', the last stop of '{name}', to where an order begins: a robot stays there for good"
            )
    return tuple(errands)


def _stops_made(graph: PlanGraph, with_load: PlanGraph, start: int, route: Sequence[Station]) -> int:
    """How many stops of a route a robot can make from a vertex, after the first with a load."""
    at = {start}
    for made, station in enumerate(route):
        steps = distances(with_load if made else graph)
        at = {v for v in station.places if min(int(steps.to(v)[u]) for u in at) < UNREACHABLE}
        if not at:
            return made
    return len(route)


def _routes(sources: Sequence[TaskSource]) -> Iterator[tuple[str, tuple[Station, ...], int]]:
    """The name of every task, or of its stream, the stations of its stops, and the only robot that may do it."""
    for source in sources:
        if isinstance(source, ClosedLoop):
            yield from _routes(source.sources)
        elif isinstance(source, TaskStream):
            yield from ((source.name, route, source.robot) for route in source.routes)
        elif isinstance(source, TaskList):
            for task in source.listed:
                yield task.name, tuple(stop.station or Station("", (stop.vertex,)) for stop in task.stops), task.robot
