"""States of robots as Parquet: `robot_states.parquet`, a row for each interval, by robot and time, of a run with tasks.

Columns: `robot`, `state` (`core.robot_states.ROBOT_STATES`), `begin_s`, `end_s`, `task` (row of the order in `tasks.parquet`, -1: none).
The intervals of a robot follow each other without a gap from 0 to the end of the run.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mrp_sumo.core.robot_states import ROBOT_STATES, RobotStateLog
from mrp_sumo.core.task import TaskLog
from mrp_sumo.io.arrow import dictionary, numbers, texts
from mrp_sumo.io.tables import read_table

ROBOT_STATES_TABLE = "robot_states.parquet"


def write_robot_states(path: Path, log: RobotStateLog, tasks: TaskLog, robot_name: Sequence[str]) -> None:
    """Write the table."""
    row = np.append(np.where(tasks.is_order, np.cumsum(tasks.is_order) - 1, -1), -1)  # of each task; the last is that of -1
    table = {
        "robot": texts([robot_name[r] for r in log.robot.tolist()]),
        "state": dictionary([ROBOT_STATES[k] for k in log.state.tolist()]),
        "begin_s": numbers(log.begin_s),
        "end_s": numbers(log.end_s),
        "task": pa.array(row[log.task], pa.int64()),
    }
    pq.write_table(pa.table(table), path, compression="zstd")


def read_robot_states(path: Path, robot_name: Sequence[str], num_tasks: int) -> RobotStateLog:
    """The intervals as they were written."""
    table = read_table(path)
    return RobotStateLog(
        table.indices("robot", robot_name),
        table.indices("state", ROBOT_STATES),
        table.numbers("begin_s"),
        table.numbers("end_s"),
        table.integers("task", -1, num_tasks - 1),
    )
