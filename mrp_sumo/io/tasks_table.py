"""What became of the tasks of a run, as Parquet: `tasks.parquet`, a row for each task that was known, by release.

Columns: `task` (name), `robot` (null: nobody had it), `released_s`, `assigned_s`, `opened_s` (its first stop was reached), `done_s` (null:
not yet, or never), `ended_s` (it was done, failed or cancelled; null: not yet), `status` (`core.task.TASK_STATES`, at the end of the run),
`reason` (why it failed, was cancelled or handed over). Robots that went to charge have rows of the same columns in `charges.parquet`.

`stops.parquet` has the stops that were made, by task. Columns: `task`, `robot`, `station`, `vertex`, `since_s` (when the robot set out for
it), `begin_s` and `end_s` of the service, `stood_s` and `queued_s` (s for which it stood on its way, and at a place to wait), `due_s` of
the task (null: never).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mrp_sumo.core.graph import frozen
from mrp_sumo.core.task import CHARGE, NOBODY, ORDER, TASK_TIMES, StopLog, TaskLog, log_of_times, some_tasks
from mrp_sumo.io.arrow import dictionary, numbers, texts

TASKS, CHARGES = "tasks.parquet", "charges.parquet"
STOP_TIMES = ("since_s", "begin_s", "end_s", "stood_s", "queued_s", "due_s")


def write_tasks(folder: Path, tasks: TaskLog, robot_name: Sequence[str]) -> None:
    """Write `tasks.parquet`, and `charges.parquet` where robots went to charge."""
    _write(folder / TASKS, some_tasks(tasks, tasks.is_order), robot_name)
    if not tasks.is_order.all():
        _write(folder / CHARGES, some_tasks(tasks, ~tasks.is_order), robot_name)


def _write(path: Path, tasks: TaskLog, robot_name: Sequence[str]) -> None:
    columns = {name: getattr(tasks, name) for name in TASK_TIMES}
    robot = pa.array([robot_name[r] if r != NOBODY else None for r in tasks.robot.tolist()], pa.string())
    table = {
        "task": texts(tasks.name),
        "robot": robot,
        **{name: numbers(column, np.isfinite(column)) for name, column in columns.items()},
        "status": dictionary(list(tasks.status)),
        "reason": texts(tasks.reason),
    }
    pq.write_table(pa.table(table), path, compression="zstd")


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
    table = pq.read_table(path)
    number = {name: r for r, name in enumerate(robot_name)}
    there = [name for name in TASK_TIMES if name in table.column_names]
    times: dict[str, Any] = {
        name: frozen(np.array([np.nan if t is None else t for t in table[name].to_pylist()], np.float64)) for name in there
    }
    robot = frozen(np.array([NOBODY if name is None else number[name] for name in table["robot"].to_pylist()], np.int64))
    task = tuple(table["task"].to_pylist())
    if "status" not in table.column_names:  # runs of before have none
        return log_of_times(task, robot, **times)
    status, reason = (tuple(table[key].to_pylist()) for key in ("status", "reason"))
    return TaskLog(task, robot, **times, status=status, reason=reason)


def write_stops(path: Path, stops: StopLog, tasks: TaskLog, robot_name: Sequence[str], vertex_name: Callable[[int], str]) -> None:
    """Write the table of stops; vertices by name."""
    table = {
        "task": texts([tasks.name[k] for k in stops.task.tolist()]),
        "robot": texts([robot_name[r] for r in stops.robot.tolist()]),
        "station": texts(stops.station),
        "vertex": texts([vertex_name(v) for v in stops.vertex.tolist()]),
        **{name: numbers(column, np.isfinite(column)) for name in STOP_TIMES for column in [getattr(stops, name)]},
    }
    pq.write_table(pa.table(table), path, compression="zstd")


def read_stops(path: Path, tasks: TaskLog, robot_name: Sequence[str], vertex_of_name: Mapping[str, int]) -> StopLog:
    """The stops as they were written."""
    table = pq.read_table(path)
    columns = [
        [names[name] for name in table[key].to_pylist()]
        for key, names in (
            ("task", {name: k for k, name in enumerate(tasks.name)}),
            ("robot", {name: r for r, name in enumerate(robot_name)}),
            ("vertex", vertex_of_name),
        )
    ]
    task, robot, vertex = (frozen(np.array(column, np.int64)) for column in columns)
    times = [frozen(np.array([np.inf if t is None else t for t in table[name].to_pylist()], np.float64)) for name in STOP_TIMES]
    return StopLog(task, robot, tuple(table["station"].to_pylist()), vertex, *times)
