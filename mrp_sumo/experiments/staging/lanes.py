"""Changes of a scenario to the lanes of its map: tracks, one-ways, mutex groups, closures, lifts and doors out of service.

Refuses names that the map does not have, and ways that do not exist.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from mrp_sumo.core.disturbances import ClosedLane
from mrp_sumo.core.facilities import door_names, lift_names
from mrp_sumo.core.graph import NavGraph, PlanGraph, Properties, with_lanes
from mrp_sumo.errors import ScenarioError, nearest
from mrp_sumo.experiments.staging.places import as_drawn, looked_up
from mrp_sumo.io.documents import Place
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.search.route import shortest_route

ONE_WAY_CELLS = 1.1  # from a one-way's route within which lanes belong to it


def doubled(file: ScenarioFile, nav: NavGraph) -> frozenset[int]:
    """Lanes of the stretches that get a second track."""
    lanes: set[int] = set()
    for i, names in enumerate(file.scenario.discretisation.doubled):
        key = ("discretisation", "doubled", i)
        if isinstance(nav, PlanGraph):
            raise ScenarioError(f"{file.at(*key)}: '{nav.name}' is a grid, whose aisles are as wide as they are drawn")
        steps = set(pairwise(_way(file, nav, key, names, as_drawn(file, nav, key, names))))
        lanes |= {k for k, step in enumerate(zip(nav.tail.tolist(), nav.head.tolist())) if step in steps}
    return frozenset(lanes)


def with_one_ways(file: ScenarioFile, nav: NavGraph, graph: PlanGraph) -> PlanGraph:
    """The graph without the lanes that go against a one-way: those beside its route, too, where a lane is two cells wide."""
    open_ = np.ones(graph.num_lanes, np.bool_)
    for i, names in enumerate(file.scenario.execution.one_way):
        key = ("execution", "one_way", i)
        route = _way(file, graph, key, names, looked_up(file, nav, graph, key, names).tolist())
        step = np.diff(graph.xy[route], axis=0)
        middle = graph.xy[route[:-1]] + step / 2
        lane_step, lane_middle = graph.xy[graph.head] - graph.xy[graph.tail], (graph.xy[graph.head] + graph.xy[graph.tail]) / 2
        away_m = np.hypot(*(lane_middle[:, None] - middle).transpose(2, 0, 1))
        nearest_step = away_m.argmin(1)
        against = (lane_step * step[nearest_step]).sum(1) < -1e-9
        same_level = (graph.level[graph.tail] == graph.level[route[0]]) & (graph.level[graph.head] == graph.level[route[0]])
        open_ &= ~(against & same_level & (away_m.min(1) < ONE_WAY_CELLS * graph.cell_m))
    return graph if open_.all() else with_lanes(graph, open_)


def with_mutex_groups(file: ScenarioFile, nav: NavGraph, graph: PlanGraph) -> PlanGraph:
    """The graph with the scenario's groups in its options, as the map's are."""
    groups = file.scenario.execution.mutex_groups
    if not groups:
        return graph
    vertex_options: list[Properties] = list(graph.vertex_options)
    lane_options: list[Properties] = list(graph.lane_options)
    for name, vertices in groups.items():
        members = set(looked_up(file, nav, graph, ("execution", "mutex_groups", name), vertices).tolist())
        for v in members:
            vertex_options[v] = {**vertex_options[v], "mutex": name}
        own = nav.vertex_of_name
        lanes = {(own[a], own[b]) for a in vertices for b in vertices}
        inside = [k for k, pair in enumerate(zip(nav.tail.tolist(), nav.head.tolist())) if pair in lanes]
        for lane in _steps_of(nav, graph, inside):
            lane_options[lane] = {**lane_options[lane], "mutex": name}
    return replace(graph, vertex_options=tuple(vertex_options), lane_options=tuple(lane_options))


def _steps_of(nav: NavGraph, graph: PlanGraph, lanes: list[int]) -> list[int]:
    """The lanes of a plan graph that these lanes of its nav graph were cut into; of a grid none but direct ones."""
    doubled: list[int] = []
    for lane in lanes:
        of = {lane, int(nav.reverse[lane])}
        between = {v for v in range(graph.num_vertices) if int(graph.nav_lane[v]) in of} if len(graph.nav_lane) else set()
        ends = {int(graph.vertex_of_station[nav.tail[lane]]), int(graph.vertex_of_station[nav.head[lane]])}
        both = between | ends
        doubled += [k for k, (a, b) in enumerate(zip(graph.tail.tolist(), graph.head.tolist())) if a in both and b in both]
    return doubled


def in_service(file: ScenarioFile, graph: PlanGraph) -> PlanGraph:
    """The graph without lifts that are out of service from the start for good. Refuses lifts that the map does not have."""
    known = lift_names(graph)
    out = set()
    what = file.scenario.execution.disturbances
    for key in ("fires", "lift_rides_per_h"):
        if getattr(what, key) and not known:
            raise ScenarioError(f"{file.at('execution', 'disturbances', key)}: no lift joins levels of '{graph.name}'")
    for i, outage in enumerate(what.outages):
        if outage.door:
            continue
        if outage.lift not in known:
            place = file.at("execution", "disturbances", "outages", i, "lift")
            raise ScenarioError(f"{place}: '{outage.lift}' is no lift that joins levels of '{graph.name}'{nearest(outage.lift, known)}")
        if outage.is_from_the_start:
            out.add(outage.lift)
    return with_lanes(graph, np.array([options.get("lift") not in out for options in graph.lane_options])) if out else graph


def without_shut_doors(file: ScenarioFile, graph: PlanGraph) -> tuple[PlanGraph, tuple[str, ...]]:
    """The graph with the scenario's manual doors, without those through which robots never get; and lines about these.

    Refuses doors that no lane leads through.
    """
    execution, known = file.scenario.execution, door_names(graph)
    places: list[tuple[str, Place]] = [(name, ("execution", "manual_doors", i)) for i, name in enumerate(execution.manual_doors)]
    listed = [(i, outage) for i, outage in enumerate(execution.disturbances.outages) if outage.door]
    places += [(outage.door, ("execution", "disturbances", "outages", i, "door")) for i, outage in listed]
    if execution.disturbances.door_passages_per_h and not known:
        places.append(("", ("execution", "disturbances", "door_passages_per_h")))
    for name, place in places:
        if execution.doors == "open":
            raise ScenarioError(f"{file.at(*place)}: doors stand open, expected execution.doors: automatic")
        if name not in known:
            which = f"'{name}' is no door that a lane of '{graph.name}' leads through{nearest(name, known)}"
            raise ScenarioError(f"{file.at(*place)}: {which if name else f'no lane of {graph.name!r} leads through a door'}")
    manual = set(execution.manual_doors)
    if manual:
        options = [{**o, "door_manual": True} if o.get("door") in manual else o for o in graph.lane_options]
        graph = replace(graph, lane_options=tuple(options))
    shut = {outage.door: "locked" for _, outage in listed if outage.is_from_the_start}
    if not execution.disturbances.door_passages_per_h:
        shut = {str(o["door"]): "manual, and people never open it" for o in graph.lane_options if o.get("door_manual")} | shut
    if not shut:
        return graph, ()
    notes = tuple(f"door '{name}' is {why}: no way for robots" for name, why in sorted(shut.items()))
    graph = with_lanes(graph, np.array([options.get("door") not in shut for options in graph.lane_options]))
    beside = [{key: value for key, value in o.items() if key != "door"} if o.get("door") in shut else o for o in graph.vertex_options]
    return replace(graph, vertex_options=tuple(beside)), notes


def closed_lanes(file: ScenarioFile, nav: NavGraph, graph: PlanGraph) -> tuple[ClosedLane, ...]:
    """Every lane of the stretches that are closed."""
    closed = []
    for i, choice in enumerate(file.scenario.execution.disturbances.closures):
        key = ("execution", "disturbances", "closures", i)
        ends = looked_up(file, nav, graph, (*key, "between"), choice.between).tolist()
        route = _way(file, graph, key, choice.between, ends)
        closed += [ClosedLane(a, b, choice.begin_s, choice.duration_s) for a, b in pairwise(route)]
    return tuple(closed)


def _way(file: ScenarioFile, graph: NavGraph, key: Place, names: Sequence[str], ends: Sequence[int]) -> list[int]:
    """Vertices of the shortest way between two, whose names are for people; refused where there is none."""
    route = shortest_route(graph, np.ones(graph.num_lanes, np.bool_), *ends)
    if route is None or len(route) < 2:
        raise ScenarioError(f"{file.at(*key)}: no way leads from '{names[0]}' to '{names[1]}'")
    return route
