"""Grants of a run as Parquet: `t_s`, `robot` (name), `visit`, the last that it may drive to from then on, and
`enters`: it may also enter the lane to the next visit, short of which it waits for others.

Visits are counted from 0, the start, along the robot's whole way, replans included.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mrp_sumo.core.execution import GrantLog
from mrp_sumo.core.graph import IntArray
from mrp_sumo.io.arrow import numbers, texts
from mrp_sumo.io.tables import read_table


def write_grants(path: Path, grants: GrantLog, robot_name: Sequence[str]) -> None:
    """Write the table."""
    robot = pa.DictionaryArray.from_arrays(numbers(grants.robot.astype(np.int32)), texts(robot_name))
    table = pa.table({"t_s": numbers(grants.t_s), "robot": robot, "visit": numbers(grants.visit), "enters": pa.array(grants.enters)})
    pq.write_table(table, path, compression="zstd")


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
