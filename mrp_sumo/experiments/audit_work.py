"""The operations audit of a run: one that has just been driven, or one in a folder, whose scenario is read again.

Both are judged by the same logs and terms. Refuses folders whose scenario names files that are not there any more.
"""

from pathlib import Path

import numpy as np

from mrp_sumo.core.battery import start_shares
from mrp_sumo.core.fleet import fleet_of_types
from mrp_sumo.core.graph import FloatArray, NavGraph, PlanGraph
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.result import RunResult
from mrp_sumo.experiments.staging.tasks import sources_on
from mrp_sumo.io.outline import outline_of
from mrp_sumo.io.run_reader import RunFolder
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.names import robot_types
from mrp_sumo.io.scenario.read import scenario_of
from mrp_sumo.metrics.operations.evidence import Logs, Terms

NO_DOORS = np.zeros((0, 2, 2))


def logs_of(run: RunResult) -> Logs:
    """Logs of a run with tasks that has just been driven, for the operations audit."""
    building, problem, execution = run.setup.map.building, run.solution.problem, run.execution
    assert execution is not None
    doors_xy = outline_of(building, run.nav.level_names).doors if building else NO_DOORS
    terms = _terms(run.setup.file, run.graph, run.nav, run.fleet.num_robots, problem.step_s, doors_xy)
    return Logs(execution, run.fleet, run.graph, terms, run.plan, run.metrics)


def logs_in(run: RunFolder) -> Logs | None:
    """Logs of the run in a folder, read from its tables, for the operations audit; None without tasks.

    Raises MrpSumoError when a file is lost or damaged, also one that the scenario names.
    """
    if run.result["scenario"].get("tasks") is None or not run.executed:
        return None
    record = run.record
    if record.nav is None or record.execution.tasks is None or record.execution.stops is None:
        raise MrpSumoError(f"{run.folder}: lacks its map or its tables of tasks")
    file = scenario_of(run.result["scenario"], Path.cwd(), record.name)
    doors_xy = run.outline.doors if run.outline else NO_DOORS
    terms = _terms(file, run.graph, record.nav, run.fleet.num_robots, run.result["plan"]["step_s"], doors_xy)
    return Logs(record.execution, run.fleet, run.graph, terms, run.plan, run.metrics)


def _terms(file: ScenarioFile, graph: PlanGraph, nav: NavGraph, num_robots: int, step_s: float, doors_xy: FloatArray) -> Terms:
    models = robot_types(file)
    kind = np.repeat(np.arange(len(models)), [group.size for group in file.scenario.robots.groups])[:num_robots]
    tasks, planning = file.scenario.tasks, file.scenario.execution.planning
    assert tasks is not None
    fleet = fleet_of_types(models, kind)
    return Terms(
        sources=sources_on(file, nav, graph, fleet, step_s),
        fleet=fleet,
        seed=file.scenario.seed,
        swap_s=tasks.charging.swap_s if tasks.charging else None,
        charges=frozenset(name for name, station in tasks.stations.items() if station.charges),
        start_level=start_shares(tasks.charging),
        waits_s=planning.budget_s + planning.least_period_s(num_robots, step_s),
        doors_xy=doors_xy,
    )
