"""The tasks of a scenario on the vertices of its plan graph, and what robots do between tasks.

Refuses tasks that no robot can do, places in lifts, and charging without batteries.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from mrp_sumo.core.arrivals import HOUR_S
from mrp_sumo.core.battery import start_shares
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import BoolArray, NavGraph, PlanGraph
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.core.shifts import opens_s, spans_of
from mrp_sumo.core.stream import TaskList, TaskSource
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.errors import ScenarioError
from mrp_sumo.experiments.staging.errands import unreachable
from mrp_sumo.experiments.staging.vehicles import map_heading
from mrp_sumo.formats.lorr import read_map
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.tasks import TaskNames, chargers_of, parking_of, sources_of
from mrp_sumo.maps.catalogue import find_map


def with_tasks(
    settings: ExecutionSettings, file: ScenarioFile, nav: NavGraph, problem: Problem, models: Sequence[RobotType]
) -> ExecutionSettings:
    """The settings with the tasks of the scenario, on the vertices of the plan graph, and with what robots do between tasks."""
    choice = file.scenario.tasks
    assert choice is not None
    without = next((model.name for model in models if model.battery is None), None)
    charging = next((name for name, station in choice.stations.items() if station.charges), None)
    if charging is not None and without is not None:
        raise ScenarioError(f"{file.at('tasks', 'stations', charging, 'charges')}: robot type '{without}' has no battery")
    if choice.charging is not None and without is not None:
        raise ScenarioError(f"{file.at('tasks', 'charging')}: robot type '{without}' has no battery, see robots/turtlebot3.yaml")
    shifts = {("stations", name): station.shifts for name, station in choice.stations.items()}
    for place, some in (shifts | ({("charging",): choice.charging.shifts} if choice.charging else {})).items():
        if (first_s := opens_s(spans_of(some), 0.0)) >= settings.time_limit_s:
            raise ScenarioError(
                f"{file.at('tasks', *place, 'shifts')}: the first begins at {first_s / HOUR_S:g} h, but the run "
                f"ends at {settings.time_limit_s / HOUR_S:g} h, expected one within it, or a longer execution.time_limit_s"
            )
    site = _site_of_tasks(file, nav, problem.graph, problem.fleet)
    return replace(
        settings,
        tasks=task_sources(file, nav, problem),
        charging=choice.charging,
        chargers=chargers_of(choice, site),
        parking=parking_of(choice, site),
        cancel=choice.cancel,
        retry=choice.retry,
        start_level=start_shares(choice.charging),
    )


def task_sources(file: ScenarioFile, nav: NavGraph, problem: Problem) -> tuple[TaskSource, ...]:
    """The streams of tasks of a scenario, on the vertices of the plan graph. Raises ScenarioError."""
    assert file.scenario.tasks is not None
    sources = sources_on(file, nav, problem.graph, problem.fleet, problem.step_s, partial(map_heading, problem))
    if wrong := unreachable(sources, problem):
        raise ScenarioError(f"{file.at('tasks')}: {wrong}")
    only_file = file.scenario.tasks.file is not None and not file.scenario.tasks.list and file.scenario.tasks.open is None
    return (TaskList(()), *sources) if only_file else sources  # what is added while robots drive is listed, before those of the file


def sources_on(
    file: ScenarioFile,
    nav: NavGraph,
    graph: PlanGraph,
    fleet: Fleet,
    step_s: float,
    heading_at: Callable[[int], float | None] = lambda vertex: None,
) -> tuple[TaskSource, ...]:
    """The streams of tasks of a scenario, on the vertices of a plan graph, whoever can come there. Raises ScenarioError.

    `heading_at` is the heading in rad in which vehicles stand at a vertex where the scenario says nothing.
    """
    assert file.scenario.tasks is not None
    site = replace(_site_of_tasks(file, nav, graph, fleet), heading_at=heading_at)
    return sources_of(file.scenario.tasks, site, file.scenario.seed, step_s, fleet.num_robots)


def _site_of_tasks(file: ScenarioFile, nav: NavGraph, graph: PlanGraph, fleet: Fleet) -> TaskNames:
    """What is known of the map to who reads tasks."""

    def vertex_of(name: str) -> int | None:
        if (known := nav.vertex_of_name.get(name)) is None:
            return None
        vertex = int(graph.vertex_of_station[known])
        if lift := graph.vertex_options[vertex].get("in_lift"):
            raise ScenarioError(f"{file.at('tasks')}: '{name}' is in lift '{lift}', where no robot can stay")
        return vertex

    def cells() -> BoolArray:
        path = find_map(file.scenario.map.file, file.folder)
        if path.suffix != ".map":
            raise ScenarioError(f"{file.at('tasks', 'file')}: .tasks count the cells of a MovingAI map, but the map is '{path.name}'")
        return read_map(path)

    return TaskNames(vertex_of, nav.vertex_name, file.at, file.folder, cells, fleet.type_name, fleet.robot_name, fleet.max_load_kg.tolist())
