"""Vehicles that cannot turn in place, at their starts: which way they face, and which lanes they would never come back from.

Refuses starts without room for trailers, and headings that no lane has.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.digraph import strong_components
from mrp_sumo.core.graph import BoolArray, FloatArray, NavGraph, PlanGraph, frozen
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.stream import TaskSource
from mrp_sumo.errors import PlanError, ScenarioError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.traffic.courses import course_rad
from mrp_sumo.traffic.moves import BOUND, UNDER_WAY, arrivals_at, move_graph, off_rad, standing_at_starts
from mrp_sumo.traffic.turns import BACKWARD, FORWARD, MAY_STAND_RAD, turns_of


def with_vehicles(file: ScenarioFile, maps: MapCache, problem: Problem) -> Problem:
    """The problem, in which vehicles that wait for tasks face along a lane. Raises ScenarioError where one cannot stand at its start."""
    if file.scenario.tasks is not None:
        problem = replace(problem, barred=_without_traps(problem))
        closed = _closed(problem)
        problem = replace(problem, graph=maps.of(_closed_to, problem.graph, *closed.items())) if any(closed.values()) else problem
        problem = replace(problem, start_heading_rad=frozen(_along_lanes(problem)))
    try:
        standing = standing_at_starts(problem)
    except PlanError as error:
        raise ScenarioError(f"{file.at('robots')}: {error}") from None
    heading, stands, at_end = problem.heading_at_start.copy(), standing.lane >= 0, (standing.does != BOUND).astype(np.int64)
    heading[stands] = (course_rad(problem.graph)[standing.lane, at_end] + np.pi * standing.gear)[stands]  # exactly along the lane
    return replace(problem, start_heading_rad=frozen(heading)) if stands.any() else problem


def require_station_headings(file: ScenarioFile, nav: NavGraph, problem: Problem) -> None:
    """Refuse a station whose heading no vehicle of a type can come in. Raises ScenarioError."""
    assert file.scenario.tasks is not None
    fleet, graph = problem.fleet, problem.graph
    for name, station in file.scenario.tasks.stations.items():
        if station.heading_deg is None:
            continue
        at = file.at("tasks", "stations", name, "heading_deg")
        if not fleet.vehicle_of_kind:
            raise ScenarioError(f"{at}: has no effect, as no robot has kinematics of a vehicle that cannot turn in place")
        for place in station.places:
            for kind, faces in _headings_at(problem, int(graph.vertex_of_station[nav.vertex_of_name[place]])):
                if not _comes(faces, math.radians(station.heading_deg)):
                    fitting = ", ".join(f"{angle:g}" for angle in np.unique(np.round(np.degrees(faces[~np.isnan(faces)]) % 360) % 360))
                    raise ScenarioError(
                        f"{at}: found {station.heading_deg:g}, but '{fleet.types[kind].name}' cannot come to '{place}' so, "
                        + (f"expected one of {fitting}" if fitting else "nor in another")
                    )


def map_heading(problem: Problem, vertex: int) -> float | None:
    """The heading in rad that the map gives at a vertex, where all vehicles can come in it."""
    theta_rad = problem.graph.vertex_options[vertex].get("theta_rad")
    if theta_rad is None or not problem.fleet.vehicle_of_kind:
        return None
    heading = math.remainder(float(theta_rad), 2 * math.pi)
    return heading if all(_comes(faces, heading) for _, faces in _headings_at(problem, vertex)) else None


def headings_not_kept(problem: Problem, sources: Sequence[TaskSource]) -> tuple[str, ...]:
    """A line on the stations of tasks at which the map has a heading in which a type of vehicles cannot come."""
    graph, lines = problem.graph, list[str]()
    stations = {station.name: station for source in sources for station in source.stations()} if problem.fleet.vehicle_of_kind else {}
    for v in dict.fromkeys(v for station in stations.values() if station.heading_rad is None for v in station.places):
        if (theta_rad := graph.vertex_options[v].get("theta_rad")) is None:
            continue
        wrong = [problem.fleet.types[kind].name for kind, faces in _headings_at(problem, v) if not _comes(faces, float(theta_rad))]
        if wrong:
            heading = f"{np.degrees(theta_rad):g} degrees, as the map has it"
            lines.append(f"'{wrong[0]}' cannot come to '{graph.known_as(v)}' at {heading}")
    more = f", nor to {len(lines) - 1} more stations" if len(lines) > 1 else ""
    return (f"{lines[0]}{more}",) if lines else ()


def _comes(faces: FloatArray, heading_rad: float) -> bool:
    """True if one of the headings in which a vehicle can come is about the one that is wanted."""
    return bool((off_rad(faces, heading_rad) <= MAY_STAND_RAD).any())


def _headings_at(problem: Problem, vertex: int) -> Iterator[tuple[int, FloatArray]]:
    """Types of vehicles, and the headings in which each can come to a vertex from where most of its moves are."""
    moves = move_graph(problem.graph, problem.fleet, problem.barred)
    component = strong_components(moves.num_vertices, moves.tail, moves.head)
    for kind in np.unique(problem.fleet.kind[problem.fleet.is_vehicle]).tolist():
        under_way = moves.states[kind].at[UNDER_WAY]
        reached = under_way[under_way >= 0]
        main = int(reached[np.argmax(np.bincount(component[reached])[component[reached]])])
        ends = arrivals_at(moves, kind, vertex)
        yield kind, ends.heading_rad[np.isfinite(ends.length_m[:, main])]


def _without_traps(problem: Problem) -> BoolArray | None:
    """[K, L] the lanes barred to each type, those included from which a vehicle would never come back to where most can go round."""
    graph, fleet = problem.graph, problem.fleet
    barred = np.zeros((fleet.num_kinds, graph.num_lanes), np.bool_) if problem.barred is None else problem.barred.copy()
    moves = move_graph(graph, fleet, problem.barred)
    component = strong_components(moves.num_vertices, moves.tail, moves.head)
    for kind, states in enumerate(moves.states):
        if not fleet.types[kind].is_vehicle:
            continue
        reached = states.at[UNDER_WAY][states.at[UNDER_WAY] >= 0]
        returns = component == np.bincount(component[reached]).argmax()
        while (more := returns[moves.head] & ~returns[moves.tail]).any():
            returns[moves.tail[more]] = True
        barred[kind] |= ~(returns[states.at[UNDER_WAY]] & (states.at[UNDER_WAY] >= 0)).any(1)
    return frozen(barred) if barred.any() else None


def _closed_to(graph: PlanGraph, *lanes: tuple[str, frozenset[tuple[int, int]]]) -> PlanGraph:
    """The plan graph with lanes that types of vehicles never take."""
    return replace(graph, closed_to=dict(lanes))


def _closed(problem: Problem) -> dict[str, frozenset[tuple[int, int]]]:
    """Lanes that types of vehicles never take, with a load or without, by their ends."""
    graph, types, barred = problem.graph, problem.fleet.types, problem.barred
    closed: dict[str, frozenset[tuple[int, int]]] = {}
    for kind, each in enumerate(types if barred is not None else ()):
        if barred is not None and each.is_vehicle and barred[kind].any():
            lanes = frozenset(zip(graph.tail[barred[kind]].tolist(), graph.head[barred[kind]].tolist()))
            closed[each.name] = closed.get(each.name, lanes) & lanes
    return closed


def _along_lanes(problem: Problem) -> FloatArray:
    """[R] headings at starts: those that are given, and of vehicles that of the lane by which they leave.

    That is one along which they can drive forward, that does not end in a dead end, and that goes straight on from a lane to the start.
    """
    graph, fleet, heading = problem.graph, problem.fleet, problem.heading_at_start.copy()
    out, into = course_rad(graph).T
    for r in np.flatnonzero(fleet.is_vehicle & np.isnan(heading) & (fleet.behind_m == 0)).tolist():
        v, turns = int(problem.start[r]), turns_of(graph, fleet.types[int(fleet.kind[r])])
        came = into[graph.head == v]
        ranked = []
        for lane in range(int(graph.first[v]), int(graph.first[v + 1])):
            ends = bool((graph.head[graph.first[graph.head[lane]] : graph.first[graph.head[lane] + 1]] == v).all())
            bent = not (off_rad(came, float(out[lane])) <= MAY_STAND_RAD).any()
            ranked += [(gear, ends, bent, lane) for gear in (FORWARD, BACKWARD) if turns.gears[lane, gear] and turns.stands[lane, 0]]
        if ranked:
            gear, _, _, lane = min(ranked)
            heading[r] = wrapped(out[lane] + gear * np.pi)
    return heading
