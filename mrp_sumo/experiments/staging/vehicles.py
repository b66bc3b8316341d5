"""Vehicles that cannot turn in place, at their starts: which way they face, and which lanes they would never come back from.

Refuses starts without room for trailers, and headings that no lane has.
"""

from dataclasses import replace

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.digraph import strong_components
from mrp_sumo.core.graph import BoolArray, FloatArray, NavGraph, frozen
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError, ScenarioError
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.traffic.courses import course_rad
from mrp_sumo.traffic.moves import BOUND, UNDER_WAY, arrivals_at, move_graph, off_rad, standing_at_starts
from mrp_sumo.traffic.turns import BACKWARD, FORWARD, MAY_STAND_RAD, turns_of


def with_vehicles(file: ScenarioFile, problem: Problem) -> Problem:
    """The problem, in which vehicles that wait for tasks face along a lane. Raises ScenarioError where one cannot stand at its start."""
    if file.scenario.tasks is not None:
        problem = replace(problem, barred=_without_traps(problem))
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
        moves = move_graph(graph, fleet, problem.barred)
        component = strong_components(moves.num_vertices, moves.tail, moves.head)
        for place, kind in ((each, k) for each in station.places for k in np.unique(fleet.kind[fleet.is_vehicle]).tolist()):
            under_way = moves.states[kind].at[UNDER_WAY]
            reached = under_way[under_way >= 0]
            main = int(reached[np.argmax(np.bincount(component[reached])[component[reached]])])
            ends = arrivals_at(moves, kind, int(graph.vertex_of_station[nav.vertex_of_name[place]]))
            faces = ends.heading_rad[np.isfinite(ends.length_m[:, main])]
            if not (off_rad(faces, np.radians(station.heading_deg)) <= MAY_STAND_RAD).any():
                fitting = ", ".join(f"{angle:g}" for angle in np.unique(np.round(np.degrees(faces[~np.isnan(faces)]) % 360) % 360))
                raise ScenarioError(
                    f"{at}: found {station.heading_deg:g}, but '{fleet.types[kind].name}' cannot come to '{place}' so, "
                    + (f"expected one of {fitting}" if fitting else "nor in another")
                )


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
