"""Ways that robots were sent while they drove, as Parquet: `replans.parquet`, a row for each visit that was appended to the ledger.

Columns: `replan` (0 is the first after the plan), `t_s`, `reason` (`give_way`, `detour`, `replan`), `text`, `robot`, `visit` (its
number along the robot's way, which goes on from the visits it keeps), `vertex` (name; null where the robot was told to stay after
the visit before), `x_m`, `y_m`, `arrive_s`, `depart_s` (as planned; null where the robot stays), `arrived_s` (null: not reached).
There is no file where nothing was replanned.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from mrp_sumo.core.csr import ranges
from mrp_sumo.core.execution import Reply
from mrp_sumo.core.graph import IntArray, PlanGraph, frozen
from mrp_sumo.io.arrow import dictionary, numbers, texts
from mrp_sumo.io.tables import read_table

REPLANS = "replans.parquet"
ROWS_AT_ONCE = 200_000  # about, of a long run's table


def write_replans(path: Path, replies: Sequence[Reply], graph: PlanGraph, robot_name: Sequence[str]) -> None:
    """Write the table of at least one reply, some replies at a time: those of a long run would take a lot of memory at once."""
    size = np.cumsum([len(reply.vertex) for reply in replies])
    begins = np.searchsorted(size, np.arange(ROWS_AT_ONCE, int(size[-1]), ROWS_AT_ONCE), side="right")
    begins = np.unique(np.append(0, begins[begins < len(replies)]))
    parts = [(a, b) for a, b in zip(begins.tolist(), [*begins.tolist()[1:], len(replies)])]
    first = replans_table(replies[: parts[0][1]], graph, robot_name)
    if len(parts) == 1:
        pq.write_table(first, path, compression="zstd")
        return
    with pq.ParquetWriter(path, first.schema, compression="zstd") as writer:
        writer.write_table(first)
        for begin, end in parts[1:]:
            writer.write_table(replans_table(replies[begin:end], graph, robot_name, begin).cast(first.schema))


def replans_table(replies: Sequence[Reply], graph: PlanGraph, robot_name: Sequence[str], begin: int = 0) -> pa.Table:
    """The table in memory; `begin` is the number of the first reply."""
    columns: dict[str, list[NDArray[Any]]] = {}
    for number, reply in enumerate(replies):
        count = np.diff(reply.first)
        rows = np.maximum(count, 1)  # a robot that stays has a row, too
        whose = np.repeat(np.arange(len(reply.robot)), rows)
        nth = ranges(0, rows)
        there = count[whose] > 0
        visit = np.where(there, reply.first[whose] + nth, -1)
        parts: dict[str, NDArray[Any]] = {
            "replan": np.full(len(whose), number),
            "robot": reply.robot[whose],
            "visit": reply.since[whose] + 1 + nth,
            "vertex": _taken(reply.vertex, visit, -1),
            **{name: _taken(getattr(reply, name), visit, np.nan) for name in ("arrive_s", "depart_s", "arrived_s")},
        }
        for name, part in parts.items():
            columns.setdefault(name, []).append(part)
    replan, robot, visit, vertex, *times = (np.concatenate(parts) for parts in columns.values())
    there = vertex >= 0
    names = dictionary([graph.label(v) if v >= 0 else "" for v in vertex.tolist()])
    xy = graph.xy[np.maximum(vertex, 0)]
    return pa.table(
        {
            "replan": numbers(replan + begin),
            "t_s": numbers(np.array([reply.t_s for reply in replies])[replan]),
            "reason": dictionary([replies[k].reason for k in replan.tolist()]),
            "text": dictionary([replies[k].text for k in replan.tolist()]),
            "robot": pa.DictionaryArray.from_arrays(numbers(robot.astype(np.int32)), texts(robot_name)),
            "visit": numbers(visit),
            "vertex": pa.DictionaryArray.from_arrays(
                pa.Array.from_buffers(pa.int32(), len(vertex), [numbers(vertex, there).buffers()[0], names.indices.buffers()[1]]),
                names.dictionary,
            ),
            "x_m": numbers(xy[:, 0], there),
            "y_m": numbers(xy[:, 1], there),
            **{name: numbers(column, np.isfinite(column)) for name, column in zip(("arrive_s", "depart_s", "arrived_s"), times)},
        }
    )


def read_replans(path: Path, graph: PlanGraph, robot_name: Sequence[str]) -> tuple[Reply, ...]:
    """Replies as they were written."""
    table = read_table(path)
    replan, visit = table.integers("replan", 0), table.integers("visit", 0)
    robot, vertex = table.indices("robot", robot_name), table.indices("vertex", graph.vertex_of_name, missing=-1)
    arrive_s, depart_s, arrived_s = (
        table.numbers(name, missing) for name, missing in (("arrive_s", np.nan), ("depart_s", np.inf), ("arrived_s", np.nan))
    )
    t_s, reason, text = table.numbers("t_s"), table.texts("reason"), table.texts("text")
    ends = np.append(np.flatnonzero(np.diff(replan)) + 1, len(replan)).tolist() if len(replan) else []
    if len(replan) and not np.array_equal(replan[[0, *ends[:-1]]], np.arange(len(ends))):
        raise table.fault("column 'replan': expected 0, 1, 2, ... in rows that follow each other")
    replies = []
    for begin, end in zip([0, *ends], ends):
        rows = np.arange(begin, end)
        robots, first_row = np.unique(robot[rows], return_index=True)
        there = rows[vertex[rows] >= 0]
        count = np.bincount(np.searchsorted(robots, robot[there]), minlength=len(robots))
        replies.append(
            Reply(
                t_s=float(t_s[begin]),
                reason=reason[begin],
                text=text[begin],
                robot=frozen(robots),
                first=frozen(np.concatenate([[0], np.cumsum(count)]).astype(np.int64)),
                since=frozen(visit[rows[first_row]] - 1),
                vertex=frozen(vertex[there]),
                arrive_s=frozen(arrive_s[there]),
                depart_s=frozen(depart_s[there]),
                arrived_s=frozen(arrived_s[there]),
            )
        )
    return tuple(replies)


def _taken(values: NDArray[Any], at: IntArray, otherwise: float) -> NDArray[Any]:
    """The values at some places, another where the place is -1."""
    if not len(values):
        return np.full(len(at), otherwise, values.dtype)
    return np.where(at >= 0, values[np.maximum(at, 0)], np.array(otherwise, values.dtype))
