"""Planned against driven, visit by visit, as Parquet: the plan in one table, with the times at which it was kept.

Columns: `robot`, `visit` (0 is the start), `vertex` (name), `x_m`, `y_m`, `arrive_s`, `depart_s` (null at the
end, where the robot stays), `arrived_s` (null for a visit that was not reached).
"""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.io.arrow import dictionary, numbers, texts
from mrp_sumo.io.tables import read_table

VISITS = "visits.parquet"


def write_visits(path: Path, problem: Problem, plan: Plan, execution: Execution) -> None:
    pq.write_table(visits_table(problem, plan, execution), path, compression="zstd")


def visits_table(problem: Problem, plan: Plan, execution: Execution) -> pa.Table:
    """The table in memory."""
    graph = problem.graph
    arrived = execution.arrived_s if len(execution.arrived_s) == plan.num_visits else np.full(plan.num_visits, np.nan)
    names = texts(problem.fleet.robot_name)
    columns = {
        "robot": pa.DictionaryArray.from_arrays(numbers(plan.robot.astype(np.int32)), names),
        "visit": numbers(np.arange(plan.num_visits) - plan.first[plan.robot]),
        "vertex": dictionary([graph.label(v) for v in plan.vertex.tolist()]),
        "x_m": numbers(graph.xy[plan.vertex, 0]),
        "y_m": numbers(graph.xy[plan.vertex, 1]),
        "arrive_s": numbers(plan.arrive_s),
        "depart_s": numbers(plan.depart_s, np.isfinite(plan.depart_s)),
        "arrived_s": numbers(arrived, np.isfinite(arrived)),
    }
    return pa.table(columns)


def read_arrivals(path: Path) -> FloatArray:
    """[N] when each visit was reached, NaN if never."""
    return read_table(path).numbers("arrived_s", missing=np.nan)
