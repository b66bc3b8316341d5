"""States of charge of a run as Parquet: `battery.parquet`, a row for each robot every ten seconds.

Columns: `t_s`, `robot`, `battery_percent` (0 to 100, as in Open-RMF's RobotState). What robots drew and were given in all (J), and the
level at which they go to charge, stand in the file's metadata.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mrp_sumo.core.battery import BatteryLog
from mrp_sumo.core.graph import frozen
from mrp_sumo.io.arrow import dictionary, numbers
from mrp_sumo.io.tables import KEY, read_table


def write_batteries(path: Path, log: BatteryLog, robot_name: Sequence[str]) -> None:
    """Write the table."""
    num_times = len(log.t_s)
    table = pa.table(
        {
            "t_s": numbers(np.repeat(log.t_s, len(robot_name))),
            "robot": dictionary(list(robot_name) * num_times),
            "battery_percent": numbers(np.round(100 * log.level.reshape(-1), 4)),
        }
    )
    sums = {"used_j": log.used_j.tolist(), "charged_j": log.charged_j.tolist(), "critical": log.critical}
    pq.write_table(table.replace_schema_metadata({KEY: json.dumps(sums)}), path, compression="zstd")


def read_batteries(path: Path, num_robots: int) -> BatteryLog:
    """The states of charge as they were written."""
    table = read_table(path)
    if not table.num_rows or table.num_rows % num_robots:
        raise table.fault(f"found {table.num_rows} rows, expected one a time for each of {num_robots} robots")
    level = np.round(table.numbers("battery_percent").reshape(-1, num_robots) / 100, 6)  # exactly the log's
    t_s = table.times("t_s")[::num_robots].copy()
    used_j, charged_j = (table.about_numbers(key, num_robots) for key in ("used_j", "charged_j"))
    return BatteryLog(frozen(t_s), frozen(level), used_j, charged_j, table.about_number("critical"))
