"""Logs of a run's execution, written into its folder and read back: trajectory, events, and a table for each thing that was logged.

Larger tables have modules of their own; the small ones are here:

- `battery.parquet`, a row for each robot every ten seconds: `t_s`, `robot`, `battery_percent` (0 to 100, as in Open-RMF's RobotState). What
  robots drew and were given in all (J), and the level at which they go to charge, stand in the file's metadata.
- `grants.parquet`: `t_s`, `robot`, `visit`, the last that it may drive to from then on, and `enters`: it may also enter the lane to the
  next visit, short of which it waits for others. Visits are counted from 0, the start, along the robot's whole way, replans included.
- `robot_states.parquet`, a row for each interval, by robot and time, of a run with tasks: `robot`, `state`
  (`core.robot_states.ROBOT_STATES`), `begin_s`, `end_s`, `task` (row of the order in `tasks.parquet`, -1: none). The intervals of a robot
  follow each other without a gap from 0 to the end of the run.
- `zones.parquet`, a row for each zone that robots were in, the busiest first: `zone` (name), `kind` (`crossing`, `aisle`, `door`, `lift` or
  `area`), `occupied_share` of the time, `robots_mean`, `robots_max`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from mrp_sumo.core.battery import BatteryLog
from mrp_sumo.core.execution import Execution, GrantLog, as_believed, let_go_of_samples
from mrp_sumo.core.graph import IntArray, frozen
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_states import ROBOT_STATES, RobotStateLog
from mrp_sumo.core.task import TaskLog
from mrp_sumo.core.zone_log import ZoneLog
from mrp_sumo.io.arrow import dictionary, numbers, texts, write_table
from mrp_sumo.io.events import write_events
from mrp_sumo.io.facilities import write_facilities
from mrp_sumo.io.people_table import PEOPLE, write_people
from mrp_sumo.io.replans import REPLANS, write_replans
from mrp_sumo.io.tables import read_table
from mrp_sumo.io.tasks_table import STOPS, write_stops, write_tasks
from mrp_sumo.io.trajectory import write_trajectory
from mrp_sumo.io.visits import VISITS, write_visits

if TYPE_CHECKING:
    from mrp_sumo.maps.lifts import Shift

BATTERY, GRANTS, STATES, ZONES = "battery.parquet", "grants.parquet", "robot_states.parquet", "zones.parquet"


def write_logs(
    folder: Path, problem: Problem, plan: Plan | None, execution: Execution, levels: "Shift | None", about: Mapping[str, Any]
) -> None:
    """Write what was logged of an execution; `about` is for the metadata of trajectories."""
    names, graph = problem.fleet.robot_name, problem.graph
    write_trajectory(folder / "trajectory.parquet", execution, names, about, levels)
    let_go_of_samples(execution)
    if execution.believed is not None:
        write_trajectory(folder / "believed.parquet", as_believed(execution), names, about, levels)
    if plan is not None:
        write_visits(folder / VISITS, problem, plan, execution)
    if execution.grants is not None:
        write_grants(folder / GRANTS, execution.grants, names)
    if execution.replies:
        write_replans(folder / REPLANS, execution.replies, graph, names)
    if execution.tasks is not None:
        write_tasks(folder, execution.tasks, names)
        if execution.stops is not None:
            write_stops(folder / STOPS, execution.stops, execution.tasks, names, graph.label)
        if execution.robot_states is not None:
            write_robot_states(folder / STATES, execution.robot_states, execution.tasks, names)
    if execution.batteries is not None:
        write_batteries(folder / BATTERY, execution.batteries, names)
    if execution.facilities is not None:
        write_facilities(folder, execution.facilities, names, graph.level_names)
    if execution.people is not None:
        write_people(folder / PEOPLE, execution.people, execution.t_s, levels)
    write_events(folder / "events.jsonl", execution, problem.fleet, graph)


def write_grants(path: Path, grants: GrantLog, robot_name: Sequence[str]) -> None:
    robot = pa.DictionaryArray.from_arrays(numbers(grants.robot.astype(np.int32)), texts(robot_name))
    write_table(path, {"t_s": numbers(grants.t_s), "robot": robot, "visit": numbers(grants.visit), "enters": numbers(grants.enters)})


def read_grants(path: Path, robot_name: Sequence[str], num_visits: IntArray) -> GrantLog:
    """The grants as they were written, of robots with these numbers of visits [R]."""
    table = read_table(path)
    robot, visit = table.indices("robot", robot_name), table.integers("visit", 0)
    if (beyond := visit >= num_visits[robot]).any():
        row = int(np.argmax(beyond))
        raise table.fault(
            f"column 'visit', row {row}: found {visit[row]}, but robot '{robot_name[robot[row]]}' has {num_visits[robot[row]]}"
        )
    return GrantLog(table.numbers("t_s"), robot, visit, table.flags("enters"))


def write_robot_states(path: Path, log: RobotStateLog, tasks: TaskLog, robot_name: Sequence[str]) -> None:
    row = np.append(np.where(tasks.is_order, np.cumsum(tasks.is_order) - 1, -1), -1)  # of each task; the last is that of -1
    columns = {
        "robot": texts([robot_name[r] for r in log.robot.tolist()]),
        "state": dictionary([ROBOT_STATES[k] for k in log.state.tolist()]),
        "begin_s": numbers(log.begin_s),
        "end_s": numbers(log.end_s),
        "task": numbers(row[log.task].astype(np.int64)),
    }
    write_table(path, columns)


def read_robot_states(path: Path, robot_name: Sequence[str], num_tasks: int) -> RobotStateLog:
    """The intervals as they were written."""
    table = read_table(path)
    robot, state = table.indices("robot", robot_name), table.indices("state", ROBOT_STATES)
    return RobotStateLog(robot, state, table.numbers("begin_s"), table.numbers("end_s"), table.integers("task", -1, num_tasks - 1))


def write_batteries(path: Path, log: BatteryLog, robot_name: Sequence[str]) -> None:
    """Write the table of states of charge."""
    columns = {
        "t_s": numbers(np.repeat(log.t_s, len(robot_name))),
        "robot": dictionary(list(robot_name) * len(log.t_s)),
        "battery_percent": numbers(np.round(100 * log.level.reshape(-1), 4)),
    }
    write_table(path, columns, {"used_j": log.used_j.tolist(), "charged_j": log.charged_j.tolist(), "critical": log.critical})


def read_batteries(path: Path, num_robots: int) -> BatteryLog:
    """The states of charge as they were written."""
    table = read_table(path)
    if not table.num_rows or table.num_rows % num_robots:
        raise table.fault(f"found {table.num_rows} rows, expected one a time for each of {num_robots} robots")
    level = np.round(table.numbers("battery_percent").reshape(-1, num_robots) / 100, 6)  # exactly the log's
    t_s = table.times("t_s")[::num_robots].copy()
    used_j, charged_j = (table.about_numbers(key, num_robots) for key in ("used_j", "charged_j"))
    return BatteryLog(frozen(t_s), frozen(level), used_j, charged_j, table.about_number("critical"))


def write_zones(path: Path, zones: ZoneLog) -> None:
    figures = {name: numbers(getattr(zones, name)) for name in ("occupied_share", "robots_mean", "robots_max")}
    write_table(path, {"zone": texts(zones.name), "kind": dictionary(zones.kind), **figures})
