"""From a scenario file to a problem that can be planned: map, robots, starts and goals, chosen planner and policy.

Each stage refuses what it cannot take, in one line that names file and key.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrp_sumo.core.fleet import Fleet, fleet_of_types
from mrp_sumo.core.graph import BoolArray, IntArray, NavGraph, PlanGraph
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.errors import ScenarioError, nearest
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.staging.choices import LEAST_TIME_LIMIT_S, TASKS_TIME_LIMIT_S, TIMES_MAKESPAN, choices, settings_of
from mrp_sumo.experiments.staging.discretisation import as_discretised, loaded_cell_m, with_drawn_one_ways
from mrp_sumo.experiments.staging.errands import oddities
from mrp_sumo.experiments.staging.fit import (
    by_class,
    by_load,
    by_vehicle_type,
    require_brakes,
    require_cabins,
    require_fit,
    with_room,
    without_room,
)
from mrp_sumo.experiments.staging.lanes import closed_lanes, doubled, in_service, with_mutex_groups, with_one_ways, without_shut_doors
from mrp_sumo.experiments.staging.people import with_people
from mrp_sumo.experiments.staging.places import (
    goal_headings,
    headings,
    named_places,
    places,
    places_by_type,
    require_headings,
    require_reachable,
)
from mrp_sumo.experiments.staging.tasks import with_tasks
from mrp_sumo.experiments.staging.vehicles import headings_not_kept, require_station_headings, with_vehicles
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.io.scenario.programs import require_trust
from mrp_sumo.maps.clearance import standing_walls
from mrp_sumo.maps.doors import with_doors
from mrp_sumo.maps.facts import driven_levels
from mrp_sumo.maps.lifts import with_rides
from mrp_sumo.maps.load import Map
from mrp_sumo.planning.protocol import Assigner, Planner
from mrp_sumo.plugins.source import place_in_file
from mrp_sumo.traffic.turns import idle_docking, with_swings


@dataclass(frozen=True)
class SetUp:
    """A scenario with its map loaded and its problem drawn. Nothing is planned yet."""

    file: ScenarioFile
    map: Map
    problem: Problem
    assigner: Assigner | None  # of goals that are free
    planner: Planner
    settings: ExecutionSettings
    notes: tuple[str, ...] = ()  # what is worth knowing before it is planned, a line each

    @property
    def scenario(self) -> ScenarioModel:
        return self.file.scenario


def set_up(file: ScenarioFile, maps: MapCache, *, run_programs: bool = True) -> SetUp:
    """Load the map, fit the robots, draw or look up starts and goals. Raises MrpSumoError: one line a fault, naming file and key.

    Without `run_programs`, plug-in files do not run: there is no planning, and a map reader that is one is refused.
    """
    scenario = file.scenario
    models, chosen_planner, chosen_assigner, settings = choices(file, run_programs=run_programs)
    if not run_programs and place_in_file(scenario.map.reader or ""):
        raise ScenarioError(f"{file.at('map', 'reader')}: would run {scenario.map.reader}, but programs of users are not run here")
    with file.located("map"):
        driven, radius_m = tuple(model.in_layouts for model in models), max(model.radius_m for model in models)
        map_ = maps.map(scenario.map, file.folder, loaded_cell_m(scenario.discretisation, models), radius_m, driven)
    is_auto, file = scenario.discretisation.kind == "auto", as_discretised(file, map_, models)
    scenario = file.scenario
    graph, step_s, notes = _graph(file, maps, map_, models, is_auto=is_auto)
    barred, narrow = without_room(file, maps, map_, graph, models, chosen_planner)
    barred = by_vehicle_type(map_, graph, barred, models)
    fleet, start, goal = _fleet_at(file, map_.nav, graph, models, barred)
    barred, with_load = by_load(file, graph, barred, len(models))
    fleet = fleet_of_types(models, fleet.kind, by_load=True) if with_load else fleet
    _require_robots(file, fleet)
    with file.located("robots"):
        problem = Problem(
            graph=graph,
            fleet=fleet,
            start=start,
            goal=goal,
            goal_of=np.full(len(start), -1) if scenario.tasks is None else np.arange(len(start)),
            step_s=step_s,
            seed=scenario.seed,
            start_heading_rad=headings(scenario.robots.start_heading_deg, len(start)),
            goal_heading_rad=goal_headings(scenario, graph, goal, bool(fleet.vehicle_of_kind)),
            effort=scenario.planner.budget or 0,
            barred=barred,
            goal_kind=None if scenario.robots.fleet is None else fleet.kind,
        )
    if fleet.vehicle_of_kind:
        problem = with_vehicles(file, maps, problem)
    require_headings(file, problem)
    if named_places(scenario) and scenario.tasks is None and not scenario.execution.disturbances.outages:
        require_reachable(file, problem)
    if scenario.tasks is not None:
        settings = with_tasks(settings, file, map_.nav, problem, models)
        require_station_headings(file, map_.nav, problem)
        narrow += headings_not_kept(problem, settings.tasks)
        narrow += oddities(settings.tasks, problem, settings.time_limit_s)
    settings = with_people(settings, file, map_, graph, fleet)
    settings = replace(settings, closed_lanes=closed_lanes(file, map_.nav, graph))
    return SetUp(file, map_, problem, chosen_assigner, chosen_planner, settings, map_.doubts + notes + narrow)


def _graph(
    file: ScenarioFile, maps: MapCache, map_: Map, models: Sequence[RobotType], *, is_auto: bool
) -> tuple[PlanGraph, float, tuple[str, ...]]:
    """The plan graph as the scenario changes it and the types fit on it, the time planned for a lane, and lines on what is left out."""
    scenario, is_driven = file.scenario, any(model.is_vehicle for model in models)
    graph = maps.graph(map_, scenario.discretisation, doubled(file, map_.nav), curved=is_driven)
    require_fit(file, map_.nav, graph, models, is_auto=is_auto)
    require_brakes(file, graph, models)
    graph, by_lane = by_class(maps, graph, models)
    graph, left_out = with_room(file, maps, map_, graph, models)
    graph, broken = with_drawn_one_ways(map_.nav, graph)
    graph = with_one_ways(file, map_.nav, graph)
    graph = with_mutex_groups(file, map_.nav, graph)
    one_of_each, radius_m = fleet_of_types(models, np.arange(len(models))), max(model.radius_m for model in models)
    step_s = scenario.planner.step_s or planned_step_s(graph, one_of_each, scenario.execution.step_length_s)
    graph = maps.of(_with_rides, in_service(file, graph), map_, step_s, radius_m)  # rides are as many lanes as they take steps
    require_cabins(file, map_, graph, models)
    if scenario.execution.doors == "automatic":
        graph = maps.of(with_doors, graph, map_.building, radius_m)
    graph, shut = without_shut_doors(file, graph)
    if is_driven and scenario.discretisation.clearance != "ignore":
        graph = maps.of(_with_walls, graph, map_)
    if is_driven:
        graph = maps.of(with_swings, graph, tuple(models))
    docks = tuple(filter(None, (idle_docking(graph, model) for model in models)))
    return graph, step_s, left_out + by_lane + broken + shut + docks


def _with_rides(graph: PlanGraph, map_: Map, step_s: float, radius_m: float) -> PlanGraph:
    return with_rides(graph, step_s, radius_m, map_.building, map_.level_shift_m)


def _with_walls(graph: PlanGraph, map_: Map) -> PlanGraph:
    """The plan graph with the walls of its levels, which turns of vehicles have to keep clear of."""
    building = map_.building
    return replace(graph, walls=standing_walls(building, driven_levels(map_.nav))) if building else graph


def _fleet_at(
    file: ScenarioFile, nav: NavGraph, graph: PlanGraph, models: Sequence[RobotType], barred: BoolArray | None
) -> tuple[Fleet, IntArray, IntArray]:
    """The robots, of one type or several, and the vertices of their starts and goals."""
    robots, separation_m = file.scenario.robots, fleet_of_types(models, np.arange(len(models))).separation_m
    if robots.fleet is None:
        start, goal = places(file, nav, graph, models[0], separation_m)
        return fleet_of_types(models, np.zeros(len(start), np.int64)), start, goal
    kind = np.repeat(np.arange(len(models)), [group.size for group in robots.groups])
    start, goal = places_by_type(file, nav, graph, models, barred, kind, separation_m)
    return fleet_of_types(models, kind), start, goal


def _require_robots(file: ScenarioFile, fleet: Fleet) -> None:
    """The robots that break down and those that are recorded are there."""
    for i, breakdown in enumerate(file.scenario.execution.disturbances.breakdowns):
        if breakdown.robot >= fleet.num_robots:
            place = file.at("execution", "disturbances", "breakdowns", i, "robot")
            raise ScenarioError(f"{place}: found {breakdown.robot}, but there are {fleet.num_robots} robots, counted from 0")
    for i, name in enumerate(file.scenario.record.robots):
        if name not in fleet.robot_name:
            raise ScenarioError(f"{file.at('record', 'robots', i)}: '{name}' is not a robot{nearest(name, fleet.robot_name)}")


def planned_as(setup: SetUp, file: ScenarioFile) -> SetUp:
    """The same problem, for the planner of another scenario."""
    return replace(setup, file=file.having(discretisation=setup.scenario.discretisation), planner=choices(file)[1])


def driven_as(setup: SetUp, file: ScenarioFile) -> SetUp:
    """The same problem, driven as another scenario says."""
    require_trust(file)
    file = file.having(discretisation=setup.scenario.discretisation)
    settings = with_people(settings_of(file), file, setup.map, setup.problem.graph, setup.problem.fleet)
    closed = closed_lanes(file, setup.map.nav, setup.problem.graph)
    return replace(setup, file=file, settings=replace(settings, closed_lanes=closed))


def with_time_limit(setup: SetUp, plan: Plan) -> SetUp:
    """The set-up with the time limit that follows from the plan, where the scenario states none."""
    scenario = setup.scenario
    if scenario.execution.time_limit_s is not None:
        return setup
    limit_s = (
        TASKS_TIME_LIMIT_S if scenario.tasks else max(LEAST_TIME_LIMIT_S, math.ceil(TIMES_MAKESPAN * float(plan.end_s.max(initial=0.0))))
    )
    execution = replace(scenario.execution, time_limit_s=float(limit_s))
    return replace(setup, file=setup.file.having(execution=execution), settings=replace(setup.settings, time_limit_s=float(limit_s)))


def planned_step_s(graph: PlanGraph, fleet: Fleet, step_length_s: float) -> float:
    """The time planned for a lane: the slowest robot drives the longest lane and turns by a right angle. Rides in lifts take several.

    Every step of a plan can then be kept, at rest or in motion. Rounded up to whole simulation steps.
    """
    slowest = fleet.loaded or fleet
    speed = np.minimum(graph.speed_mps, slowest.max_speed_mps.min())
    drive = float((graph.length_m / speed).max(where=~graph.is_ride, initial=0.0))
    turn = math.pi / 2 / float(min(fleet.turn_rate_rad_s.min(), slowest.turn_rate_rad_s.min()))
    return round(math.ceil((drive + turn) / step_length_s - 1e-9) * step_length_s, 9)
