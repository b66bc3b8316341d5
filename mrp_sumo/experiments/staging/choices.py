"""Choices of a scenario by name, apart from its map: robots, planner, assigner, policy and the settings of its execution.

Refuses names that are not there, wrong parameters, and programs that are not trusted.
"""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from mrp_sumo.core.driving import DrivingOptions
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive.dispatchers import NEAREST, ONE_SHOT
from mrp_sumo.drive.policy import policy_of
from mrp_sumo.drive.settings import AT_ONCE, ExecutionSettings, check_period
from mrp_sumo.errors import ScenarioError
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.io.scenario.names import require_known, robot_types
from mrp_sumo.io.scenario.programs import require_trust
from mrp_sumo.maps.catalogue import bundled_folder
from mrp_sumo.planning.protocol import Assigner, Planner
from mrp_sumo.planning.registry import assigner, planner, planners_that
from mrp_sumo.plugins.registry import find
from mrp_sumo.plugins.registry import make as make_plug_in
from mrp_sumo.plugins.source import resolved

TIMES_MAKESPAN, LEAST_TIME_LIMIT_S = 1.5, 300.0  # of an execution without a stated limit
TASKS_TIME_LIMIT_S = 3600.0  # of one with tasks


def choices(file: ScenarioFile, *, run_programs: bool = True) -> tuple[tuple[RobotType, ...], Planner, Assigner | None, ExecutionSettings]:
    """Choices of a scenario by name, apart from its map: the robots' types first; refused where that are programs which are not trusted.

    Raises MrpSumoError: one line a fault, naming file and key.
    """
    scenario = file.scenario
    if run_programs:
        require_trust(file)
    require_known(file)
    for i, name in enumerate(scenario.record.metrics if run_programs else ()):  # else nobody can tell
        from mrp_sumo.metrics.own import own_metric  # loads all metrics

        with file.located("record", "metrics", i):
            own_metric(name, file.folder)
    parameters = scenario.planner.parameters
    if path := _plan_path(scenario, file.folder):
        parameters = {**parameters, "path": str(path)}
    return robot_types(file), _planner(file, parameters), _assigner(file), settings_of(file)


def named_files(scenario: ScenarioModel, folder: Path) -> list[Path]:
    """Files beside the map that a scenario names and that decide about its run: of robots, a plan, tasks."""
    paths = []
    for group in scenario.robots.groups:
        if isinstance(group.type, str):
            bundled = bundled_folder("robots") / f"{group.type}.yaml"
            paths.append(bundled if bundled.is_file() else folder / group.type)
    if path := _plan_path(scenario, folder):
        paths.append(path)
    if scenario.tasks is not None and scenario.tasks.file is not None:
        paths.append(folder / scenario.tasks.file)
    return paths


def _plan_path(scenario: ScenarioModel, folder: Path) -> Path | None:
    path = scenario.planner.parameters.get("path") if scenario.planner.name == "plan_file" else None
    return folder / path if isinstance(path, str) and path else None


def _located(
    file: ScenarioFile, section: tuple[str, ...], name: tuple[str, ...], parameters: Mapping[str, Any]
) -> AbstractContextManager[None]:
    """Where a wrong choice of a section is reported: at its parameters, where it has some."""
    return file.located(*section, *(("parameters",) if parameters else name))


def settings_of(file: ScenarioFile) -> ExecutionSettings:
    """Settings of a scenario's execution, apart from those that only its map can tell."""
    execution, tasks = file.scenario.execution, file.scenario.tasks
    policy, parameters = execution.policy, execution.dispatcher.parameters
    with _located(file, ("execution", "policy"), (), policy.parameters):
        if find("policies", policy.name, file.folder).ours:  # the code of those from outside is not executed yet
            policy_of(policy.name, policy.parameters)
    dispatcher = execution.dispatcher.name or (ONE_SHOT if tasks is None else NEAREST)
    with _located(file, ("execution", "dispatcher"), (), parameters):
        if find("dispatchers", dispatcher, file.folder).ours and parameters:
            make_plug_in("dispatchers", dispatcher, parameters)
    disturbances, replanner = execution.disturbances, execution.recovery.replanner or ""
    if replanner and execution.on_deadlock == "resolve":  # else it is not needed, and slow to load
        with file.located("execution", "recovery", "replanner"):
            planner(replanner, {}, file.folder)
    record = file.scenario.record
    with file.located(*(("record", "period_s") if "period_s" in record.model_fields_set else ("execution", "step_length_s"))):
        check_period(record.period_s, execution.step_length_s)
    with file.located("execution"):
        options: dict[str, Any] = {each.name: getattr(execution, each.name) for each in fields(DrivingOptions)} | {
            "planning": execution.planning if tasks else AT_ONCE,
            "recovery": replace(execution.recovery, replanner=resolved(replanner, file.folder) or None),
            "disturbances": replace(disturbances, outages=tuple(each for each in disturbances.outages if not each.is_from_the_start)),
        }
        return ExecutionSettings(
            **options,
            policy=resolved(execution.policy.name, file.folder),
            policy_parameters=execution.policy.parameters,
            dispatcher=resolved(dispatcher, file.folder),
            dispatcher_parameters=parameters,
            time_limit_s=execution.time_limit_s or (LEAST_TIME_LIMIT_S if tasks is None else TASKS_TIME_LIMIT_S),
            goal_tolerance_m=execution.goal_tolerance_m,
            record_period_s=record.period_s,
            seed=file.scenario.seed if disturbances.seed is None else disturbances.seed,
            planner=resolved(file.scenario.planner.name, file.folder),
            planner_parameters=file.scenario.planner.parameters,
        )


def _planner(file: ScenarioFile, parameters: Mapping[str, Any]) -> Planner:
    """The planner; a window is refused where it plans to the end, a budget where it does not count what it does."""
    scenario, place = file.scenario, ("execution", "planning", "window_s")
    with _located(file, ("planner",), ("name",), parameters):
        chosen = planner(scenario.planner.name, parameters, file.folder)
    if scenario.planner.budget and "effort" not in getattr(chosen, "supports", ()):
        expected = f"expected one that does ({planners_that('effort')}), or no budget"
        raise ScenarioError(f"{file.at('planner', 'budget')}: planner '{scenario.planner.name}' does not count its labels, {expected}")
    if scenario.tasks and scenario.execution.planning.window_s and "window" not in getattr(chosen, "supports", ()):
        expected = f"expected one that does ({planners_that('window')}), or 0"
        raise ScenarioError(f"{file.at(*place)}: planner '{scenario.planner.name}' does not plan in windows, {expected}")
    return chosen


def _assigner(file: ScenarioFile) -> Assigner | None:
    """Who assigns goals that are free; None where they are not, unless there are parameters to check."""
    choice = file.scenario.assignment
    if not choice.parameters and (choice.mode != "optimal" or file.scenario.tasks is not None):
        return None
    with _located(file, ("assignment",), ("solver",), choice.parameters):
        return assigner(choice.solver, choice.parameters, file.folder)
