"""What became of the tasks of a run, as Parquet: `tasks.parquet`, a row for each task that was known, by release.

Columns: `task` (name), `robot` (null: nobody had it), `released_s`, `assigned_s`, `opened_s` (its first stop was reached), `done_s` (null:
not yet), `state` (`revealed`, `assigned`, `open`, `done`).
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mrp_sumo.core.graph import frozen
from mrp_sumo.core.task import NOBODY, TaskLog
from mrp_sumo.io.arrow import dictionary, numbers, texts

TIMES = ("released_s", "assigned_s", "opened_s", "done_s")


def write_tasks(path: Path, tasks: TaskLog, robot_name: Sequence[str]) -> None:
    """Write the table."""
    columns = {name: getattr(tasks, name) for name in TIMES}
    robot = pa.array([robot_name[r] if r != NOBODY else None for r in tasks.robot.tolist()], pa.string())
    table = {
        "task": texts(tasks.name),
        "robot": robot,
        **{name: numbers(column, np.isfinite(column)) for name, column in columns.items()},
        "state": dictionary(list(tasks.state)),
    }
    pq.write_table(pa.table(table), path, compression="zstd")


def read_tasks(path: Path, robot_name: Sequence[str]) -> TaskLog:
    """The tasks as they were written."""
    table = pq.read_table(path)
    number = {name: r for r, name in enumerate(robot_name)}
    times = {name: frozen(np.array([np.nan if t is None else t for t in table[name].to_pylist()], np.float64)) for name in TIMES}
    robot = [NOBODY if name is None else number[name] for name in table["robot"].to_pylist()]
    return TaskLog(tuple(table["task"].to_pylist()), frozen(np.array(robot, np.int64)), **times)
