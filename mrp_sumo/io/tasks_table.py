"""Tasks of a run as Parquet: `tasks.parquet`, a row for each task that was known, by release.

Columns: `task` (name), `robot` (null: nobody had it), `released_s`, `assigned_s`, `opened_s` (its first stop was reached), `done_s` (null:
not yet, or never), `ended_s` (it was done, failed or cancelled; null: not yet), `status` (`core.task.TASK_STATES`, at the end of the run),
`reason` (why it failed, was cancelled or handed over). Robots that went to charge have rows of the same columns in `charges.parquet`.

`stops.parquet` has the stops that were made, by task. Columns: `task`, `robot`, `station`, `vertex`, `since_s` (when the robot set out for
it), `begin_s` and `end_s` of the service, `stood_s` and `queued_s` (s for which it stood on its way, giving way apart, and at a place to
wait), `due_s` of the task (null: never).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.graph import frozen
from mrp_sumo.core.task import CHARGE, NOBODY, ORDER, TASK_STATES, TASK_TIMES, StopLog, TaskLog, log_of_times, some_tasks
from mrp_sumo.io.arrow import dictionary, numbers, texts, write_table
from mrp_sumo.io.tables import read_table

TASKS, CHARGES, STOPS = "tasks.parquet", "charges.parquet", "stops.parquet"
STOP_TIMES = ("since_s", "begin_s", "end_s", "stood_s", "queued_s", "due_s")


def write_tasks(folder: Path, tasks: TaskLog, robot_name: Sequence[str]) -> None:
    """Write `tasks.parquet`, and `charges.parquet` where robots went to charge."""
    _write(folder / TASKS, some_tasks(tasks, tasks.is_order), robot_name)
    if not tasks.is_order.all():
        _write(folder / CHARGES, some_tasks(tasks, ~tasks.is_order), robot_name)


def _write(path: Path, tasks: TaskLog, robot_name: Sequence[str]) -> None:
    columns = {name: getattr(tasks, name) for name in TASK_TIMES}
    table = {
        "task": texts(tasks.name),
        "robot": texts(robot_name[r] if r != NOBODY else None for r in tasks.robot.tolist()),
        **{name: numbers(column, np.isfinite(column)) for name, column in columns.items()},
        "status": dictionary(list(tasks.status)),
        "reason": texts(tasks.reason),
    }
    write_table(path, table)


def read_tasks(folder: Path, robot_name: Sequence[str]) -> TaskLog:
    """The tasks as they were written, charging after the others."""
    orders = _read(folder / TASKS, robot_name)
    if not (folder / CHARGES).is_file():
        return orders
    charges = _read(folder / CHARGES, robot_name)
    kind = (ORDER,) * len(orders.name) + (CHARGE,) * len(charges.name)
    columns: dict[str, Any] = {key: frozen(np.concatenate([getattr(orders, key), getattr(charges, key)])) for key in ("robot", *TASK_TIMES)}
    texts = {key: getattr(orders, key) + getattr(charges, key) for key in ("name", "status", "reason")}
    return replace(orders, **columns, **texts, kind=kind)


def _read(path: Path, robot_name: Sequence[str]) -> TaskLog:
    table = read_table(path)
    robot, task = table.indices("robot", robot_name, missing=NOBODY), table.texts("task")
    times: dict[str, Any] = {name: table.numbers(name, missing=np.nan) for name in TASK_TIMES if table.has("status") or name != "ended_s"}
    if not table.has("status"):  # runs of before have none
        return log_of_times(task, robot, **times)
    status = tuple(TASK_STATES[k] for k in table.indices("status", TASK_STATES).tolist())
    return TaskLog(task, robot, **times, status=status, reason=table.texts("reason"))


def write_stops(path: Path, stops: StopLog, tasks: TaskLog, robot_name: Sequence[str], vertex_name: Callable[[int], str]) -> None:
    """Write the table of stops; vertices by name."""
    table = {
        "task": texts([tasks.name[k] for k in stops.task.tolist()]),
        "robot": texts([robot_name[r] for r in stops.robot.tolist()]),
        "station": texts(stops.station),
        "vertex": texts([vertex_name(v) for v in stops.vertex.tolist()]),
        **{name: numbers(column, np.isfinite(column)) for name in STOP_TIMES for column in [getattr(stops, name)]},
    }
    write_table(path, table)


def read_stops(path: Path, tasks: TaskLog, robot_name: Sequence[str], vertex_of_name: Mapping[str, int]) -> StopLog:
    table = read_table(path)
    task, robot, vertex = table.indices("task", tasks.name), table.indices("robot", robot_name), table.indices("vertex", vertex_of_name)
    return StopLog(task, robot, table.texts("station"), vertex, *(table.numbers(name, missing=np.inf) for name in STOP_TIMES))
