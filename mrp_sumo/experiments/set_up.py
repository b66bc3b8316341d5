"""From a scenario file to a problem that can be planned: map, robots, starts and goals, chosen planner and policy.

Refuses names the map does not have, robots that do not fit, goals that cannot be reached.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.fleet import Fleet, RobotType, batteries_of, fleet_of, fleet_of_types
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, NavGraph, Options, PlanGraph, frozen, with_lanes
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem, graphs_of_kinds
from mrp_sumo.core.stream import TaskList, TaskSource
from mrp_sumo.drive.dispatcher import NEAREST, ONE_SHOT, dispatcher_of
from mrp_sumo.drive.disturbances import Breakdown, Closure, Disturbances, Fire, Obstacle, Outage
from mrp_sumo.drive.facilities import door_names, lift_names
from mrp_sumo.drive.motion_plan import TURNS_RAD
from mrp_sumo.drive.policy import policy_of
from mrp_sumo.drive.settings import ExecutionSettings, Planning
from mrp_sumo.errors import MrpSumoError, ScenarioError, nearest
from mrp_sumo.experiments.errands import unreachable
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.people import people_of
from mrp_sumo.formats.lorr import read_map
from mrp_sumo.io.documents import Place
from mrp_sumo.io.scenario import (
    BreakdownChoice,
    DisturbanceChoice,
    FireChoice,
    ObstacleChoice,
    OutageChoice,
    RobotShape,
    Scenario,
    ScenarioFile,
    require_trust,
    robot_type,
)
from mrp_sumo.io.tasks import Site, charging_of, parking_of, sources_of
from mrp_sumo.maps.catalogue import bundled_folder, find_map
from mrp_sumo.maps.chains import chains_of
from mrp_sumo.maps.load import Map
from mrp_sumo.maps.repair import join_short
from mrp_sumo.maps.roadmap import cell_that_fits
from mrp_sumo.metrics.own import own_metric
from mrp_sumo.planning.costs import costs_of
from mrp_sumo.planning.protocol import Assigner, Planner
from mrp_sumo.planning.registry import assigner, planner
from mrp_sumo.plugins.registry import find
from mrp_sumo.plugins.source import place_in_file, resolved
from mrp_sumo.search.route import shortest_route
from mrp_sumo.traffic.draw import draw_by_type, mrp_bench_draw, uniform_draw

TIMES_MAKESPAN, LEAST_TIME_LIMIT_S = 1.5, 300.0  # of an execution without a stated limit
TASKS_TIME_LIMIT_S = 3600.0  # of one with tasks
ONE_WAY_CELLS = 1.1  # from a one-way's route within which lanes belong to it


@dataclass(frozen=True)
class SetUp:
    """A scenario with its map loaded and its problem drawn. Nothing is planned yet."""

    file: ScenarioFile
    map: Map
    problem: Problem
    assigner: Assigner
    planner: Planner
    settings: ExecutionSettings
    notes: tuple[str, ...] = ()  # what is worth knowing before it is planned, a line each

    @property
    def scenario(self) -> Scenario:
        return self.file.scenario


def set_up(file: ScenarioFile, maps: MapCache, *, run_programs: bool = True) -> SetUp:
    """Load the map, fit the robots, draw or look up starts and goals.

    Parameters
    ----------
    file
        The scenario.
    maps
        Where maps are made, once.
    run_programs
        Whether plug-in files may run. Without, there is no planning, and a map reader that is one is refused.

    Raises
    ------
    MrpSumoError
        One line a fault, naming file and key.
    """
    scenario = file.scenario
    models, chosen_planner, chosen_assigner, settings = choices(file, run_programs=run_programs)
    if not run_programs and place_in_file(scenario.map.reader or ""):
        raise ScenarioError(f"{file.at('map', 'reader')}: would run {scenario.map.reader}, but programs of users are not run here")
    cell_m = scenario.discretisation.cell_m
    one_of_each, radius_m = fleet_of_types(models, np.arange(len(models))), max(model.radius_m for model in models)
    map_ = _located(file, ("map",), lambda: maps.map(scenario.map, file.folder, cell_m, radius_m))
    graph = maps.graph(map_, scenario.discretisation, _doubled(file, map_.nav))
    _require_fit(file, map_.nav, graph, models)
    _require_brakes(file, graph, models)
    graph = _with_one_ways(file, map_.nav, _with_room(file, maps, map_, graph, models))
    graph = _with_mutex_groups(file, map_.nav, graph)
    step_s = scenario.planner.step_s or planned_step_s(graph, one_of_each, scenario.execution.step_length_s)
    graph = _in_service(file, graph)
    graph = maps.with_rides(map_, graph, step_s, radius_m)
    if scenario.execution.doors == "automatic":
        graph = maps.with_doors(map_, graph, radius_m)
    graph, shut = _without_shut_doors(file, graph)
    barred, narrow = _without_room(file, maps, map_, graph, models, chosen_planner)
    if scenario.robots.fleet is None:
        start, goal = _places(file, map_.nav, graph, one_of_each.separation_m)
        fleet = fleet_of_types(models, np.zeros(len(start), np.int64))
    else:
        kind = np.repeat(np.arange(len(models)), [group.size for group in scenario.robots.groups])
        start, goal = _places_by_type(file, map_.nav, graph, barred, kind, one_of_each.separation_m)
        fleet = fleet_of_types(models, kind)
    for i, breakdown in enumerate(scenario.execution.disturbances.breakdowns):
        if breakdown.robot >= len(start):
            place = file.at("execution", "disturbances", "breakdowns", i, "robot")
            raise ScenarioError(f"{place}: found {breakdown.robot}, but there are {len(start)} robots, counted from 0")
    for i, name in enumerate(scenario.record.robots):
        if name not in fleet.robot_name:
            raise ScenarioError(f"{file.at('record', 'robots', i)}: '{name}' is not a robot{nearest(name, fleet.robot_name)}")
    problem = _located(
        file,
        ("robots",),
        lambda: Problem(
            graph=graph,
            fleet=fleet,
            start=start,
            goal=goal,
            goal_of=np.full(len(start), -1) if scenario.tasks is None else np.arange(len(start)),
            step_s=step_s,
            seed=scenario.seed,
            start_heading_rad=_headings(scenario.robots.start_heading_deg, len(start)),
            goal_heading_rad=_goal_headings(scenario, graph, goal),
            effort=scenario.planner.budget or 0,
            barred=barred,
            goal_kind=None if scenario.robots.fleet is None else fleet.kind,
        ),
    )
    _require_headings(file, problem)
    if _named_places(scenario) and scenario.tasks is None and not scenario.execution.disturbances.outages:
        _require_reachable(file, problem)
    if scenario.tasks is not None:
        settings = _with_tasks(settings, file, map_.nav, problem, models)
    if scenario.people is not None:
        settings = replace(settings, people=people_of(file, map_, graph))
    return SetUp(file, map_, problem, chosen_assigner, chosen_planner, _with_closures(file, map_.nav, graph, settings), shut + narrow)


def planned_as(setup: SetUp, file: ScenarioFile) -> SetUp:
    """The same problem, for the planner of another scenario."""
    return replace(setup, file=file, planner=choices(file)[1])


def driven_as(setup: SetUp, file: ScenarioFile) -> SetUp:
    """The same problem, driven as another scenario says."""
    require_trust(file)
    settings = replace(_settings(file), people=people_of(file, setup.map, setup.problem.graph))
    return replace(setup, file=file, settings=_with_closures(file, setup.map.nav, setup.problem.graph, settings))


def with_time_limit(setup: SetUp, plan: Plan) -> SetUp:
    """The set-up with the time limit that follows from the plan, where the scenario states none."""
    scenario = setup.scenario
    if scenario.execution.time_limit_s is not None:
        return setup
    limit_s = (
        TASKS_TIME_LIMIT_S if scenario.tasks else max(LEAST_TIME_LIMIT_S, math.ceil(TIMES_MAKESPAN * float(plan.end_s.max(initial=0.0))))
    )
    execution = scenario.execution.model_copy(update={"time_limit_s": float(limit_s)})
    file = replace(setup.file, scenario=scenario.model_copy(update={"execution": execution}))
    return replace(setup, file=file, settings=replace(setup.settings, time_limit_s=float(limit_s)))


def choices(file: ScenarioFile, *, run_programs: bool = True) -> tuple[tuple[RobotType, ...], Planner, Assigner, ExecutionSettings]:
    """What a scenario chooses by name, apart from its map: the robots' types first; refused where that are programs which are not trusted.

    Raises
    ------
    MrpSumoError
        One line a fault, naming file and key.
    """
    scenario = file.scenario
    if run_programs:
        require_trust(file)
    for i, name in enumerate(scenario.record.metrics):
        read = own_metric if run_programs else partial(find, "metrics")
        _located(file, ("record", "metrics", i), partial(read, name, file.folder))
    parameters = scenario.planner.parameters
    if path := _plan_path(scenario, file.folder):
        parameters = {**parameters, "path": str(path)}
    return (
        robot_types(file),
        _planner(file, parameters),
        _plug_in(file, ("assignment", "solver"), "assigners", assigner, scenario.assignment.solver, scenario.assignment.parameters),
        _settings(file),
    )


def named_files(scenario: Scenario, folder: Path) -> list[Path]:
    """Files beside the map that a scenario names and that decide about its run: of robots, a plan, tasks.

    Parameters
    ----------
    folder
        Where relative paths begin.
    """
    found = []
    for group in scenario.robots.groups:
        if isinstance(group.type, str):
            bundled = bundled_folder("robots") / f"{group.type}.yaml"
            found.append(bundled if bundled.is_file() else folder / group.type)
    if path := _plan_path(scenario, folder):
        found.append(path)
    if scenario.tasks is not None and scenario.tasks.file is not None:
        found.append(folder / scenario.tasks.file)
    return found


def robot_types(file: ScenarioFile) -> tuple[RobotType, ...]:
    """The type of each group of robots; those that are written out are told apart by their numbers."""
    groups, found = file.scenario.robots.groups, []
    for i, group in enumerate(groups):
        read = partial(robot_type, group.type, bundled_folder("robots"), file.folder)
        model = _located(file, _type_at(file, i), read)
        found.append(replace(model, name=f"custom_{i}") if isinstance(group.type, RobotShape) and len(groups) > 1 else model)
    return tuple(found)


def _type_at(file: ScenarioFile, kind: int) -> Place:
    """Where a scenario says the type of its robots, or of a group of them."""
    return ("robots", "type") if file.scenario.robots.fleet is None else ("robots", "fleet", kind, "type")


def _named_places(scenario: Scenario) -> bool:
    """Whether a scenario names starts and goals."""
    return scenario.robots.starts is not None or any(group.starts and group.goals for group in scenario.robots.fleet or ())


def _plan_path(scenario: Scenario, folder: Path) -> Path | None:
    """The plan that is there already, if the scenario names one."""
    path = scenario.planner.parameters.get("path") if scenario.planner.name == "plan_file" else None
    return folder / path if isinstance(path, str) and path else None


def _plug_in(
    file: ScenarioFile, place: tuple[str, ...], kind: str, make: Callable[..., Any], name: str, parameters: Mapping[str, Any]
) -> Any:
    """The plug-in of a name; the code of those from outside is not executed yet. A wrong parameter is reported at its place."""
    _located(file, place, lambda: find(kind, name, file.folder))
    section = place if kind in ("policies", "dispatchers") else place[:-1]
    return _located(file, (*section, "parameters") if parameters else place, lambda: make(name, parameters, file.folder))


def _checked_policy(name: str, parameters: Mapping[str, Any], folder: Path) -> None:
    """Refuse wrong parameters of a policy of ours."""
    if find("policies", name, folder).ours:
        policy_of(name, parameters)


def _checked_dispatcher(name: str, parameters: Mapping[str, Any], folder: Path) -> None:
    """Refuse wrong parameters of a dispatcher of ours."""
    if find("dispatchers", name, folder).ours:
        dispatcher_of(name, parameters)


def planned_step_s(graph: PlanGraph, fleet: Fleet, step_length_s: float) -> float:
    """The time planned for a lane: the slowest robot drives the longest lane and turns by a right angle. Rides in lifts take several.

    Every step of a plan can then be kept, at rest or in motion. Rounded up to whole simulation steps.
    """
    speed = np.minimum(graph.speed_mps, fleet.max_speed_mps.min())
    drive = float((graph.length_m / speed).max(where=~graph.is_ride, initial=0.0))
    turn = math.pi / 2 / float(fleet.turn_rate_rad_s.min())
    return round(math.ceil((drive + turn) / step_length_s - 1e-9) * step_length_s, 9)


def _settings(file: ScenarioFile) -> ExecutionSettings:
    execution = file.scenario.execution
    _plug_in(file, ("execution", "policy"), "policies", _checked_policy, execution.policy.name, execution.policy.parameters)
    tasks = file.scenario.tasks
    dispatcher = execution.dispatcher.name or (ONE_SHOT if tasks is None else NEAREST)
    _plug_in(file, ("execution", "dispatcher"), "dispatchers", _checked_dispatcher, dispatcher, execution.dispatcher.parameters)
    recovery, replanner = execution.recovery, execution.recovery.replanner or ""
    if replanner:
        place = ("execution", "recovery", "replanner")
        _located(file, place, lambda: find("planners", replanner, file.folder))
        if execution.on_deadlock == "resolve":  # else it is not needed, and slow to load
            _plug_in(file, place, "planners", planner, replanner, {})
    settings: ExecutionSettings = _located(
        file,
        ("execution",),
        lambda: ExecutionSettings(
            engine=execution.engine,
            policy=resolved(execution.policy.name, file.folder),
            policy_parameters=execution.policy.parameters,
            dispatcher=resolved(dispatcher, file.folder),
            dispatcher_parameters=execution.dispatcher.parameters,
            step_length_s=execution.step_length_s,
            time_limit_s=execution.time_limit_s or (LEAST_TIME_LIMIT_S if tasks is None else TASKS_TIME_LIMIT_S),
            planning=Planning(**execution.planning.model_dump()) if tasks else Planning(),
            blocking_window_s=execution.blocking_window_s,
            goal_tolerance_m=execution.goal_tolerance_m,
            record_period_s=file.scenario.record.period_s,
            seed=file.scenario.seed if execution.disturbances.seed is None else execution.disturbances.seed,
            on_deadlock=execution.on_deadlock,
            give_way=recovery.give_way,
            planner=resolved(file.scenario.planner.name, file.folder),
            planner_parameters=file.scenario.planner.parameters,
            patience_s=recovery.patience_s,
            replanner=resolved(replanner, file.folder),
            disturbances=_disturbances(execution.disturbances),
        ),
    )
    return settings


def _planner(file: ScenarioFile, parameters: Mapping[str, Any]) -> Planner:
    """The planner; a window is refused where it plans to the end, a budget where it does not count what it does."""
    scenario, place = file.scenario, ("execution", "planning", "window_s")
    chosen: Planner = _plug_in(file, ("planner", "name"), "planners", planner, scenario.planner.name, parameters)
    if scenario.planner.budget and "effort" not in getattr(chosen, "supports", ()):
        expected = "expected one that does (cbs, continuous, ecbs, eecbs, lacam, lns2, pbs, pibt, prioritised), or no budget"
        raise ScenarioError(f"{file.at('planner', 'budget')}: planner '{scenario.planner.name}' does not count its labels, {expected}")
    if scenario.tasks and scenario.execution.planning.window_s and "window" not in getattr(chosen, "supports", ()):
        expected = "expected one that does (ecbs, lacam, lns2, pibt, prioritised), or 0"
        raise ScenarioError(f"{file.at(*place)}: planner '{scenario.planner.name}' does not plan in windows, {expected}")
    return chosen


def _disturbances(choice: DisturbanceChoice) -> Disturbances:
    """A duration that is not given is for good."""

    def parts(listed: Sequence[BreakdownChoice | ObstacleChoice | OutageChoice | FireChoice], kind: Callable[..., Any]) -> tuple[Any, ...]:
        return tuple(kind(**each.model_dump(exclude={"duration_s"}), duration_s=each.duration_s or math.inf) for each in listed)

    scalars = choice.model_dump(exclude={"name", "seed", "breakdowns", "obstacles", "closures", "outages", "fires"})
    return Disturbances(
        **scalars,
        breakdowns=parts(choice.breakdowns, Breakdown),
        obstacles=parts(choice.obstacles, Obstacle),
        outages=parts([o for o in choice.outages if not _from_the_start(o)], Outage),
        fires=parts(choice.fires, Fire),
    )


def _from_the_start(outage: OutageChoice) -> bool:
    """Whether a lift or a door is never in service, so that planners need not count on it."""
    return outage.begin_s == 0 and outage.duration_s is None


def _in_service(file: ScenarioFile, graph: PlanGraph) -> PlanGraph:
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
        if _from_the_start(outage):
            out.add(outage.lift)
    return with_lanes(graph, np.array([options.get("lift") not in out for options in graph.lane_options])) if out else graph


def _without_shut_doors(file: ScenarioFile, graph: PlanGraph) -> tuple[PlanGraph, tuple[str, ...]]:
    """The graph with the scenario's manual doors, without those through which robots never get; and lines about these.

    Refuses doors that no lane leads through.
    """
    execution, known = file.scenario.execution, door_names(graph)
    places: list[tuple[str, Place]] = [
        (execution.manual_doors[i], ("execution", "manual_doors", i)) for i in range(len(execution.manual_doors))
    ]
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
    shut = {outage.door: "locked" for _, outage in listed if _from_the_start(outage)}
    if not execution.disturbances.door_passages_per_h:
        shut = {str(o["door"]): "manual, and people never open it" for o in graph.lane_options if o.get("door_manual")} | shut
    if not shut:
        return graph, ()
    notes = tuple(f"door '{name}' is {why}: no way for robots" for name, why in sorted(shut.items()))
    return with_lanes(graph, np.array([options.get("door") not in shut for options in graph.lane_options])), notes


def _with_closures(file: ScenarioFile, nav: NavGraph, graph: PlanGraph, settings: ExecutionSettings) -> ExecutionSettings:
    """The settings with the stretches that are closed, which only the map can tell."""
    closures = closures_of(file, nav, graph)
    return replace(settings, disturbances=replace(settings.disturbances, closures=closures)) if closures else settings


def closures_of(file: ScenarioFile, nav: NavGraph, graph: PlanGraph) -> tuple[Closure, ...]:
    """Every lane of the stretches that are closed."""
    found = []
    for i, choice in enumerate(file.scenario.execution.disturbances.closures):
        key = ("execution", "disturbances", "closures", i)
        ends = _looked_up(file, nav, graph, (*key, "between"), choice.between).tolist()
        route = _way(file, graph, key, choice.between, ends)
        found += [Closure(a, b, choice.begin_s, choice.duration_s or math.inf) for a, b in pairwise(route)]
    return tuple(found)


def _way(file: ScenarioFile, graph: NavGraph, key: Place, names: Sequence[str], ends: Sequence[int]) -> list[int]:
    """Vertices of the shortest way between two, whose names are for people; refused where there is none."""
    route = shortest_route(graph, np.ones(graph.num_lanes, np.bool_), *ends)
    if route is None or len(route) < 2:
        raise ScenarioError(f"{file.at(*key)}: no way leads from '{names[0]}' to '{names[1]}'")
    return route


def _doubled(file: ScenarioFile, nav: NavGraph) -> frozenset[int]:
    """Lanes of the stretches that get a second track."""
    found: set[int] = set()
    for i, names in enumerate(file.scenario.discretisation.doubled):
        key = ("discretisation", "doubled", i)
        if isinstance(nav, PlanGraph):
            raise ScenarioError(f"{file.at(*key)}: '{nav.name}' is a grid, whose aisles are as wide as they are drawn")
        steps = set(pairwise(_way(file, nav, key, names, _as_drawn(file, nav, key, names))))
        found |= {k for k, step in enumerate(zip(nav.tail.tolist(), nav.head.tolist())) if step in steps}
    return frozenset(found)


def _with_one_ways(file: ScenarioFile, nav: NavGraph, graph: PlanGraph) -> PlanGraph:
    """The graph without the lanes that go against a one-way: those beside its route, too, where a lane is two cells wide."""
    open_ = np.ones(graph.num_lanes, np.bool_)
    for i, names in enumerate(file.scenario.execution.one_way):
        key = ("execution", "one_way", i)
        route = _way(file, graph, key, names, _looked_up(file, nav, graph, key, names).tolist())
        step = np.diff(graph.xy[route], axis=0)
        middle = graph.xy[route[:-1]] + step / 2
        lane_step, lane_middle = graph.xy[graph.head] - graph.xy[graph.tail], (graph.xy[graph.head] + graph.xy[graph.tail]) / 2
        away_m = np.hypot(*(lane_middle[:, None] - middle).transpose(2, 0, 1))
        nearest_step = away_m.argmin(1)
        against = (lane_step * step[nearest_step]).sum(1) < -1e-9
        same_level = (graph.level[graph.tail] == graph.level[route[0]]) & (graph.level[graph.head] == graph.level[route[0]])
        open_ &= ~(against & same_level & (away_m.min(1) < ONE_WAY_CELLS * graph.cell_m))
    return graph if open_.all() else with_lanes(graph, open_)


def _with_mutex_groups(file: ScenarioFile, nav: NavGraph, graph: PlanGraph) -> PlanGraph:
    """The graph with the scenario's groups in its options, as the map's are."""
    groups = file.scenario.execution.mutex_groups
    if not groups:
        return graph
    vertex_options: list[Options] = list(graph.vertex_options)
    lane_options: list[Options] = list(graph.lane_options)
    for name, vertices in groups.items():
        members = set(_looked_up(file, nav, graph, ("execution", "mutex_groups", name), vertices).tolist())
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
    found: list[int] = []
    for lane in lanes:
        of = {lane, int(nav.reverse[lane])}
        between = {v for v in range(graph.num_vertices) if int(graph.nav_lane[v]) in of} if len(graph.nav_lane) else set()
        ends = {int(graph.vertex_of_station[nav.tail[lane]]), int(graph.vertex_of_station[nav.head[lane]])}
        both = between | ends
        found += [k for k, (a, b) in enumerate(zip(graph.tail.tolist(), graph.head.tolist())) if a in both and b in both]
    return found


def _require_fit(file: ScenarioFile, nav: NavGraph, graph: PlanGraph, models: Sequence[RobotType]) -> None:
    """Every step is at least as long as any two robots' centres are apart."""
    kind, model = max(enumerate(models), key=lambda each: fleet_of(each[1], 1).separation_m)
    needed_m = fleet_of_types(models, np.arange(len(models))).separation_m
    shortest_m = float(graph.length_m.min(where=~graph.is_ride, initial=np.inf))
    if needed_m <= shortest_m + 1e-9:
        return
    chains = chains_of(nav)
    nav = chains.nav if chains else nav
    what = f"{file.at(*_type_at(file, kind))}: '{model.name}' does not fit: two of them need {needed_m:.3f} m between centres, "
    length_m = nav.length_m[~nav.is_ride] if graph.kind == "roadmap" else np.full(1, np.inf)
    if (short := np.flatnonzero(length_m < needed_m - 1e-9)).size:
        lane = int(short[np.argmin(length_m[short])])
        count = len({frozenset((int(nav.tail[k]), int(nav.head[k]))) for k in short})
        raise ScenarioError(
            f"{what}lane '{nav.label(int(nav.tail[lane]))}' - '{nav.label(int(nav.head[lane]))}' of '{nav.name}' is {length_m[lane]:.3f} m "
            + (f"and {count - 1} more are too short; " if count > 1 else "long; ")
            + _remedy(nav, graph.cell_m, needed_m)
        )
    cell_m = cell_that_fits(length_m, needed_m)
    raise ScenarioError(f"{what}the shortest step of '{graph.name}' is {shortest_m:.3f} m (discretisation.cell_m: {cell_m:g} would do)")


def _require_brakes(file: ScenarioFile, graph: PlanGraph, models: Sequence[RobotType]) -> None:
    """Robots may brake over several lanes, which they then hold; over more than the whole map none would ever come to its speed."""
    for kind, model in enumerate(models):
        top = min(model.max_speed_mps, float(graph.speed_mps.max(initial=0.0)))
        across_m = float(np.hypot(*np.ptp(graph.xy, axis=0))) if graph.num_lanes else np.inf
        braking_m = top**2 / (2 * model.decel_mps2)
        if braking_m > across_m:
            slower = _rounded(math.sqrt(2 * across_m * model.decel_mps2), math.floor)
            raise ScenarioError(
                f"{file.at(*_type_at(file, kind))}: '{model.name}' cannot stop: from {top:g} m/s at {model.decel_mps2:g} m/s2 it takes "
                f"{braking_m:.4g} m, and '{graph.name}' is {across_m:.4g} m across (decel_mps2: "
                f"{_rounded(top**2 / (2 * across_m), math.ceil)} or max_speed_mps: {slower} would do)"
            )


def _rounded(value: float, towards: Callable[[float], int]) -> str:
    """Two digits, rounded up or down."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{towards(value / unit) * unit:.6g}"


def _remedy(nav: NavGraph, cell_m: float, needed_m: float) -> str:
    """What helps against lanes shorter than two robots' centres are apart."""
    millimetres = math.ceil(1000 * needed_m - 1e-6) / 1000
    joined, _ = join_short(nav, millimetres)
    left = np.flatnonzero(joined.length_m < needed_m - 1e-9)
    if not left.size:
        found = f"map.join_short_m: {millimetres:g} would join its ends"
        step_m = joined.length_m / np.maximum(np.rint(joined.length_m / cell_m), 1)
        if step_m.min(initial=np.inf) >= needed_m - 1e-9:
            return found
        return f"{found}, with discretisation.cell_m: {cell_that_fits(joined.length_m, needed_m):g}"
    lane = int(left[0])
    ends = f"'{joined.label(int(joined.tail[lane]))}' - '{joined.label(int(joined.head[lane]))}'"
    return f"{ends} cannot be joined, as both ends have a name or properties: lengthen it in the map, or choose smaller robots"


def _with_room(file: ScenarioFile, maps: MapCache, map_: Map, graph: PlanGraph, models: Sequence[RobotType]) -> PlanGraph:
    """The graph, or what is left of it where walls leave the robots no room; refused, where the scenario says so.

    Of several types each has lanes of its own, see `_without_room`.
    """
    choice = file.scenario.discretisation.clearance
    if choice == "ignore":
        return graph
    if choice == "prune" and len(models) > 1:
        return graph
    for narrow in (maps.narrow(map_, graph, model) for model in models):
        if choice == "prune":
            return _located(file, ("discretisation", "clearance"), partial(maps.pruned, graph, narrow))  # type: ignore[no-any-return]
        if not narrow.notes:
            continue
        fits = "; clearance: prune leaves them out"
        if (radius_m := narrow.radius_that_fits_m) > 0:
            fits = f"; a robot that needs no more than {radius_m:.2f} m around its centre would fit{fits}"
        raise ScenarioError(f"{file.at('discretisation', 'clearance')}: '{graph.name}': {', '.join(narrow.notes)}{fits}")
    return graph


def _without_room(
    file: ScenarioFile, maps: MapCache, map_: Map, graph: PlanGraph, models: Sequence[RobotType], chosen_planner: Planner
) -> tuple[BoolArray | None, tuple[str, ...]]:
    """[K, L] lanes on which walls leave each of several types no room, None where all have room everywhere; and lines about them."""
    if len(models) == 1:
        return None, ()
    barred, notes = np.zeros((len(models), graph.num_lanes), np.bool_), []
    for kind, model in enumerate(models):
        narrow = maps.narrow(map_, graph, model)
        barred[kind] = narrow.is_barred & ~graph.is_ride  # cabins have walls of their own
        if barred[kind].all():
            raise ScenarioError(f"{file.at(*_type_at(file, kind))}: no lane of '{graph.name}' leaves '{model.name}' room beside the walls")
        if barred[kind].any():
            lane = int(np.flatnonzero(barred[kind])[np.argmin(narrow.lane_m[barred[kind]])])
            ends = f"'{graph.label(int(graph.tail[lane]))}' - '{graph.label(int(graph.head[lane]))}'"
            where = f"the narrowest {ends}: {narrow.lane_m[lane]:.2f} m to a wall"
            notes.append(f"'{model.name}' has no room on {np.count_nonzero(barred[kind])} of {graph.num_lanes} lanes, {where}")
    supports = getattr(chosen_planner, "supports", ())
    if "types" not in supports:
        lanes = ", on lanes with room for all types" if notes and "reach" not in supports else ""
        notes.append(f"'{file.scenario.planner.name}' plans for all robots as for the slowest and largest{lanes}")
    return (barred if barred.any() else None), tuple(notes)


def _drawn(file: ScenarioFile, graph: PlanGraph, separation_m: float) -> tuple[IntArray, IntArray]:
    robots, seed = file.scenario.robots, file.scenario.seed
    anywhere = robots.draw == "anywhere"
    drawn: tuple[IntArray, IntArray] = _located(
        file, ("robots", "count"), lambda: uniform_draw(graph, robots.count or 0, seed, separation_m, anywhere=anywhere)
    )
    return drawn


def _places(file: ScenarioFile, nav: NavGraph, graph: PlanGraph, separation_m: float) -> tuple[IntArray, IntArray]:
    """Plan vertices of starts and goals, not assigned yet; with tasks, robots have no goals but their starts."""
    robots = file.scenario.robots
    if file.scenario.tasks is not None:
        if robots.starts is not None:
            start = _looked_up(file, nav, graph, ("robots", "starts"), robots.starts[: robots.count])
        else:
            start, _ = _drawn(file, graph, separation_m)
        return start, start
    if robots.starts is not None and robots.goals is not None:
        start = _looked_up(file, nav, graph, ("robots", "starts"), robots.starts[: robots.count])
        fixed = file.scenario.assignment.mode == "fixed"
        goal = _looked_up(file, nav, graph, ("robots", "goals"), robots.goals[: len(start)] if fixed else robots.goals)
        values, times = np.unique(goal, return_counts=True)
        if (times > 1).any():
            i, j = np.flatnonzero(goal == values[times > 1][0])[:2]
            raise ScenarioError(
                f"{file.at('robots', 'goals', int(j))}: '{robots.goals[j]}' is the goal of two robots, as '{robots.goals[i]}' is"
            )
        if fixed and len(goal) < len(start):
            raise ScenarioError(f"{file.at('robots', 'goals')}: {len(goal)} goals for {len(start)} robots with a fixed assignment")
        return start, goal
    assert robots.count is not None
    where = ("robots", "count")
    if robots.draw != "mrp_bench":
        return _drawn(file, graph, separation_m)
    start, goal = _located(file, where, lambda: mrp_bench_draw(len(graph.vertex_of_station), robots.count or 0, file.scenario.seed))
    return graph.vertex_of_station[start], graph.vertex_of_station[goal]


def _places_by_type(
    file: ScenarioFile, nav: NavGraph, graph: PlanGraph, barred: BoolArray | None, kind: IntArray, separation_m: float
) -> tuple[IntArray, IntArray]:
    """Plan vertices of starts and goals, group by group; those that are not named are drawn where the robots have room."""
    scenario, given = file.scenario, []
    for key in ("starts", "goals"):
        found = np.full(len(kind), -1)
        for k, group in enumerate(scenario.robots.groups):
            if names := getattr(group, key):
                found[kind == k] = _looked_up(file, nav, graph, ("robots", "fleet", k, key), names)
        values, times = np.unique(found[found >= 0], return_counts=True)
        if (times > 1).any():
            raise ScenarioError(f"{file.at('robots', 'fleet')}: '{graph.label(int(values[times > 1][0]))}' is the {key[:-1]} of two robots")
        given.append(found)
    graphs, anywhere = graphs_of_kinds(graph, barred, int(kind.max()) + 1), scenario.robots.draw == "anywhere"
    given_start, given_goal = given
    start, goal = _located(
        *(file, ("robots", "fleet")),
        lambda: draw_by_type(graphs, kind, given_start, given_goal, scenario.seed, separation_m, anywhere=anywhere),
    )
    return (start, start) if scenario.tasks is not None else (start, goal)


def _headings(degrees: float | list[float | None] | None, count: int) -> FloatArray | None:
    """[N] in radians, NaN where none is given; None where none are."""
    if degrees is None:
        return None
    each = degrees[:count] if isinstance(degrees, list) else [degrees] * count
    return frozen(np.radians(np.array([np.nan if heading is None else heading for heading in each], np.float64)))


def _goal_headings(scenario: Scenario, graph: PlanGraph, goal: IntArray) -> FloatArray | None:
    """[G] as the scenario says, else as the map does, where robots can face so without turning aside from all lanes."""
    if scenario.robots.goal_heading_deg is not None or scenario.tasks is not None:
        return _headings(scenario.robots.goal_heading_deg, len(goal))
    found = np.array([float(graph.vertex_options[v].get("theta_rad", np.nan)) for v in goal.tolist()])
    for i in np.flatnonzero(~np.isnan(found)).tolist():
        if not _along_a_lane(graph, int(goal[i]), found[i]):
            found[i] = np.nan
    return None if np.isnan(found).all() else frozen(found)


def _along_a_lane(graph: PlanGraph, vertex: int, heading_rad: float) -> bool:
    """Whether robots at a vertex face so on a lane that leads to it or away from it."""
    there = graph.heading_rad[(graph.head == vertex) | (graph.tail == vertex)]
    return bool((np.abs((there - heading_rad + np.pi) % (2 * np.pi) - np.pi) <= TURNS_RAD).any())


def _require_headings(file: ScenarioFile, problem: Problem) -> None:
    """Robots stay at a goal along one of its lanes, as they came or turned round; a heading between these is a mistake."""
    graph, wanted, degrees = problem.graph, problem.goal_heading_rad, file.scenario.robots.goal_heading_deg
    if wanted is None or degrees is None:
        return
    for goal in np.flatnonzero(~np.isnan(wanted)).tolist():
        v = problem.goal[goal]
        if _along_a_lane(graph, int(v), float(wanted[goal])):
            continue
        there = graph.heading_rad[(graph.head == v) | (graph.tail == v)]
        place: Place = ("robots", "goal_heading_deg", goal) if isinstance(degrees, list) else ("robots", "goal_heading_deg")
        fitting = ", ".join(f"{angle:g}" for angle in np.unique(np.round(np.degrees(there), 1) % 360))
        raise ScenarioError(
            f"{file.at(*place)}: found {np.degrees(wanted[goal]):g}, but no lane leads to '{graph.label(int(v))}' or away from it in that "
            f"heading, expected one of {fitting}"
        )


def _looked_up(file: ScenarioFile, nav: NavGraph, graph: PlanGraph, key: tuple[str | int, ...], names: Sequence[str]) -> IntArray:
    """[N] plan vertices by the names of stations."""
    return np.array(graph.vertex_of_station[_as_drawn(file, nav, key, names)], np.int64)


def _as_drawn(file: ScenarioFile, nav: NavGraph, key: tuple[str | int, ...], names: Sequence[str]) -> list[int]:
    """Vertices of the nav graph by their names."""
    faults, found = [], []
    for i, name in enumerate(names):
        vertex = nav.vertex_of_name.get(name)
        if vertex is None and (number := name.removeprefix("v")).isdecimal() and int(number) < nav.num_vertices:
            vertex = int(number) if nav.label(int(number)) == name else None  # of one without a name
        if vertex is None:
            known = [n for n in nav.vertex_name if n]
            faults.append(f"{file.at(*key, i)}: '{name}' is not a vertex of '{nav.name}'{nearest(name, known)}")
        else:
            found.append(vertex)
    if faults:
        raise ScenarioError(*faults)
    return found


def _with_tasks(
    settings: ExecutionSettings, file: ScenarioFile, nav: NavGraph, problem: Problem, models: Sequence[RobotType]
) -> ExecutionSettings:
    """The settings with the tasks of the scenario, on the vertices of the plan graph, and with what robots do between tasks."""
    choice = file.scenario.tasks
    assert choice is not None
    without = next((model.name for model in models if model.battery is None), None)
    if choice.charging is not None and without is not None:
        raise ScenarioError(f"{file.at('tasks', 'charging')}: robot type '{without}' has no battery, see robots/turtlebot3.yaml")
    start = choice.charging.start_level if choice.charging else (100.0, 100.0)
    site = _site_of_tasks(file, nav, problem)
    return replace(
        settings,
        tasks=task_sources(file, nav, problem),
        charging=charging_of(choice, site),
        parking=parking_of(choice, site),
        batteries=batteries_of(models),
        start_level=(start[0] / 100, start[1] / 100),
    )


def task_sources(file: ScenarioFile, nav: NavGraph, problem: Problem) -> tuple[TaskSource, ...]:
    """The streams of tasks of a scenario, on the vertices of the plan graph. Raises ScenarioError."""
    assert file.scenario.tasks is not None
    site = _site_of_tasks(file, nav, problem)
    sources = sources_of(file.scenario.tasks, site, file.scenario.seed, problem.step_s, problem.num_robots)
    if wrong := unreachable(sources, problem):
        raise ScenarioError(f"{file.at('tasks')}: {wrong}")
    only_file = file.scenario.tasks.file is not None and not file.scenario.tasks.list and file.scenario.tasks.open is None
    return (TaskList(()), *sources) if only_file else sources  # what is added while robots drive is listed, before those of the file


def _site_of_tasks(file: ScenarioFile, nav: NavGraph, problem: Problem) -> Site:
    """What is known of the map to who reads tasks."""

    def vertex_of(name: str) -> int | None:
        vertex = nav.vertex_of_name.get(name)
        return None if vertex is None else int(problem.graph.vertex_of_station[vertex])

    def cells() -> BoolArray:
        path = find_map(file.scenario.map.file, file.folder)
        if path.suffix != ".map":
            raise ScenarioError(f"{file.at('tasks', 'file')}: .tasks count the cells of a MovingAI map, but the map is '{path.name}'")
        return read_map(path)

    return Site(vertex_of, nav.vertex_name, file.at, file.folder, cells, problem.fleet.type_name)


def _require_reachable(file: ScenarioFile, problem: Problem) -> None:
    """Named starts and goals that can never meet are a mistake in the file, not a hard problem."""
    reach = np.isfinite(costs_of(problem, "path"))
    label, name = problem.graph.label, problem.fleet.robot_name
    if file.scenario.assignment.mode == "fixed":
        reach = reach[:, : problem.num_robots] & np.eye(problem.num_robots, dtype=bool)
    for robot in np.flatnonzero(~reach.any(1)) if len(problem.goal) >= problem.num_robots else ():
        raise ScenarioError(
            f"{file.at('robots', 'starts', int(robot))}: {name[robot]} cannot reach "
            + (f"its goal '{label(problem.goal[robot])}'" if file.scenario.assignment.mode == "fixed" else "any goal")
            + f" from '{label(problem.start[robot])}'"
        )
    for goal in np.flatnonzero(~reach.any(0)) if len(problem.goal) <= problem.num_robots else ():
        raise ScenarioError(f"{file.at('robots', 'goals', int(goal))}: no robot can reach '{label(problem.goal[goal])}'")


def _located(file: ScenarioFile, place: tuple[str | int, ...], make: Callable[[], Any]) -> Any:
    """What `make` makes; a refusal names file, line and key."""
    try:
        return make()
    except MrpSumoError as error:
        raise type(error)(*(f"{file.at(*place)}: {line}" for line in str(error).splitlines())) from None
