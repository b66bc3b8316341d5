"""Trajectories as Parquet: one long table of exact float64, the source of truth that every other log derives from.

Columns: `t_ns` int64, `robot` dictionary of names, `x_m`, `y_m`, `yaw_rad`, `speed_mps` float64. A robot that is not on the floor has no
row. Where vehicles tow trailers, `hitch_1_rad` and so on are the angles of each to what is in front of it, 0 where there is none. `loaded`
int8, the number of loads on board, is there where robots may have several, or are others with one. Where robots change levels, `level` is
a dictionary of names, too, and positions are in the frame of that level: what was added
to lay levels side by side is subtracted, and kept in the metadata. Row groups hold about half a million rows, robot by robot inside,
compressed with zstd after a byte-stream split. Equal executions give equal bytes. Refuses files of another schema.
"""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count, takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.io.arrow import numbers, texts
from mrp_sumo.io.tables import Table, read_table

if TYPE_CHECKING:
    import pandas

    from mrp_sumo.maps.lifts import Shift

SCHEMA_VERSION = 1
ROWS_PER_GROUP = 500_000
MAX_PLACES = 2**29  # samples of all robots
COLUMNS = ("x_m", "y_m", "yaw_rad", "speed_mps")
UNITS = {"t_ns": "ns of simulated time", "x_m": "m", "y_m": "m", "yaw_rad": "rad, counter-clockwise from +x", "speed_mps": "m/s"}


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Time-major positions of R robots at T samples, NaN where a robot is not on the floor; levels lie side by side."""

    t_ns: IntArray  # [T]
    robot_name: tuple[str, ...]  # [R]
    x_m: FloatArray  # [T, R]
    y_m: FloatArray  # [T, R]
    yaw_rad: FloatArray  # [T, R]
    speed_mps: FloatArray  # [T, R]
    metadata: Mapping[str, Any]  # as given to the writer, with schema_version and units
    level: IntArray | None = None  # [T, R] in `levels`
    levels: "Shift | None" = None  # (x, y) in m added to the positions on each by name, to lay them side by side
    hitch_rad: Mapping[str, FloatArray] = field(default_factory=dict)  # [T, R] by column
    loads: IntArray | None = None  # [T, R] on board

    @property
    def t_s(self) -> FloatArray:
        """[T] simulated time."""
        return self.t_ns / 1e9


def write_trajectory(
    path: Path, execution: Execution, robot_name: tuple[str, ...], metadata: Mapping[str, Any], levels: "Shift | None" = None
) -> None:
    """Write the table, with more metadata in JSON's types, and levels as `Trajectory` has them where robots change them."""
    t_ns = _ticks(execution)
    about = {"schema_version": SCHEMA_VERSION, "units": UNITS, "robots": list(robot_name), "t_ns": _stamps_document(t_ns), **metadata}
    about |= {"levels": dict(levels)} if levels else {}
    schema = _schema(execution, levels).with_metadata({"mrp_sumo": json.dumps(about, sort_keys=True, ensure_ascii=False, allow_nan=False)})
    encoding = {"t_ns": "DELTA_BINARY_PACKED", **dict.fromkeys((*COLUMNS, *execution.hitch_rad), "BYTE_STREAM_SPLIT")}
    with pq.ParquetWriter(path, schema, compression="zstd", use_dictionary=["robot", "level"], column_encoding=encoding) as writer:
        for table in _tables(execution, robot_name, t_ns, levels):
            writer.write_table(table.replace_schema_metadata(schema.metadata), ROWS_PER_GROUP * 2)


def trajectory_of(execution: Execution, robot_name: tuple[str, ...]) -> Trajectory:
    """The trajectory as arrays, without metadata."""
    columns: dict[str, Any] = {name: getattr(execution, name) for name in COLUMNS}
    more: dict[str, Any] = {"level": execution.level, "hitch_rad": execution.hitch_rad, "loads": execution.loads}
    return Trajectory(_ticks(execution), robot_name, **columns, metadata={}, **more)


def trajectory_table(execution: Execution, robot_name: tuple[str, ...], levels: "Shift | None" = None) -> pa.Table:
    """The table in memory, without metadata."""
    return pa.concat_tables([_schema(execution, levels).empty_table(), *_tables(execution, robot_name, _ticks(execution), levels)])


def trajectory_frame(table: pa.Table) -> "pandas.DataFrame":
    """The table as a DataFrame with columns t_s, robot, x_m, y_m, yaw_rad, speed_mps, and level where robots change them."""
    frame: pandas.DataFrame = table.to_pandas()
    frame.insert(0, "t_s", frame.pop("t_ns") / 1e9)
    return frame


def _ticks(execution: Execution) -> IntArray:
    return np.rint(execution.t_s * 1e9).astype(np.int64)


def _schema(execution: Execution, levels: Collection[str] | None) -> pa.Schema:
    robot = pa.dictionary(pa.from_numpy_dtype(_index(execution.x_m.shape[1])), pa.string())
    fields = [pa.field("t_ns", pa.int64(), False), pa.field("robot", robot, False)]
    fields += [pa.field(name, pa.float64(), False) for name in (*COLUMNS, *execution.hitch_rad)]
    fields += [pa.field("loaded", pa.int8(), False)] if execution.loads is not None else []
    return pa.schema(fields + ([pa.field("level", pa.dictionary(pa.int16(), pa.string()), False)] if levels else []))


def _index(num_robots: int) -> type[np.signedinteger]:
    return np.int16 if num_robots < 2**15 else np.int32


def _tables(execution: Execution, robot_name: tuple[str, ...], t_ns: IntArray, levels: "Shift | None") -> Iterator[pa.Table]:
    """The rows, half a million at a time, robot by robot in each."""
    num_samples, num_robots = execution.x_m.shape
    schema, names = _schema(execution, levels), texts(robot_name)
    ticks = max(1, ROWS_PER_GROUP // max(1, num_robots))
    for a in range(0, num_samples, ticks):
        rows = slice(a, min(a + ticks, num_samples))
        values = *(getattr(execution, name) for name in COLUMNS), *execution.hitch_rad.values()
        flat = [np.ascontiguousarray(column[rows].T).ravel() for column in values]
        length = rows.stop - rows.start
        if execution.loads is not None:
            flat.append(np.ascontiguousarray(execution.loads[rows].T).ravel().astype(np.int8))
        time, robot = np.tile(t_ns[rows], num_robots), np.repeat(np.arange(num_robots), length)
        if levels and execution.level is not None:
            flat.append(np.ascontiguousarray(execution.level[rows].T).ravel())
            shift_m = np.array(list(levels.values()))[flat[-1]]
            flat[:2] = flat[0] - shift_m[:, 0], flat[1] - shift_m[:, 1]
        there = np.isfinite(flat[0]) & np.isfinite(flat[1])
        if not there.all():
            time, robot, flat = time[there], robot[there], [column[there] for column in flat]
        robots = pa.DictionaryArray.from_arrays(numbers(robot.astype(_index(num_robots))), names)
        columns = [numbers(time), robots, *map(numbers, flat[: len(values) + (execution.loads is not None)])]
        if levels:
            columns.append(pa.DictionaryArray.from_arrays(numbers(flat[-1].astype(np.int16)), texts(levels)))
        yield pa.Table.from_arrays(columns, schema=schema)


def read_trajectory(path: Path, level_names: Sequence[str] = ()) -> Trajectory:
    """Read a table back, its levels in the order of these names: metadata have them by the alphabet.

    Raises MrpSumoError for a file that is missing, damaged, of another schema, or of other levels.
    """
    table = read_table(path)
    about = table.about
    if not isinstance(about, dict) or about.get("schema_version") != SCHEMA_VERSION:
        version = about.get("schema_version") if isinstance(about, dict) else "no trajectory"
        raise table.fault(f"schema version {version}, expected {SCHEMA_VERSION}")
    names, t_ns = table.about_texts("robots"), _stamps(table, about)
    robot, time = table.indices("robot", names), table.integers("t_ns")
    row = np.searchsorted(t_ns, time)
    if not len(t_ns) * len(names) <= MAX_PLACES or not np.array_equal(t_ns[np.minimum(row, len(t_ns) - 1)] if len(t_ns) else [], time):
        raise table.fault("its rows are at other times than its metadata say")
    columns: dict[str, Any] = {}
    hitches = [*takewhile(table.has, (f"hitch_{k}_rad" for k in count(1)))]
    for name in (*COLUMNS, *hitches):
        values = np.full((len(t_ns), len(names)), np.nan)
        values[row, robot] = table.numbers(name)
        columns[name] = values
    columns["hitch_rad"] = {name: columns.pop(name) for name in hitches}
    loads = np.zeros((len(t_ns), len(names)), np.int64) if table.has("loaded") else None
    if loads is not None:
        loads[row, robot] = table.integers("loaded", 0, 127)
    if "levels" not in about:
        return Trajectory(t_ns, names, **columns, metadata=about, loads=loads)
    levels = _levels(table, about["levels"], level_names)
    level = np.zeros((len(t_ns), len(names)), np.int64)
    level[row, robot] = on = table.indices("level", tuple(levels))
    for k, axis in enumerate(COLUMNS[:2]):
        columns[axis][row, robot] += np.array(list(levels.values()))[on, k]
    return Trajectory(t_ns, names, **columns, metadata=about, level=level, levels=levels, loads=loads)


def _stamps_document(t_ns: IntArray) -> dict[str, Any]:
    """The stamps in JSON: first, last and number where they are evenly spaced, else all of them."""
    if len(t_ns):
        evenly = {"first": int(t_ns[0]), "last": int(t_ns[-1]), "count": len(t_ns)}
        if np.array_equal(_evenly(**evenly), t_ns):
            return evenly
    return {"all": t_ns.tolist()}


def _evenly(first: int, last: int, count: int) -> IntArray:
    return np.rint(np.linspace(first, last, count)).astype(np.int64)


def _stamps(table: Table, about: Mapping[str, Any]) -> IntArray:
    """[T] of the document in the table's metadata."""
    match about.get("t_ns"):
        case {"all": list(stamps)} if all(isinstance(t, int) and abs(t) < 2**62 for t in stamps):
            t_ns = np.array(stamps, np.int64)
        case {"first": int(first), "last": int(last), "count": int(count)} if 0 <= count <= MAX_PLACES and -(2**62) < first <= last < 2**62:
            t_ns = _evenly(first, last, count)
        case _:
            raise table.fault("its metadata 't_ns' are no times")
    if (np.diff(t_ns) <= 0).any():
        raise table.fault("its metadata 't_ns' are not in order")
    return t_ns


def _levels(table: Table, document: object, names: Sequence[str]) -> "Shift":
    """Names and shifts of the document in the table's metadata, in the order of these names."""
    pairs = list(document.values()) if isinstance(document, dict) else [None]
    if isinstance(document, dict) and all(isinstance(pair, list) and list(map(_is_length, pair)) == [True, True] for pair in pairs):
        if names and set(names) != set(document):
            raise table.fault(f"its levels are {', '.join(document)}, expected {', '.join(names)}")
        return {name: (float(document[name][0]), float(document[name][1])) for name in names or document}
    raise table.fault("its metadata 'levels' are not two metres for each level")


def _is_length(value: object) -> bool:
    return isinstance(value, int | float) and abs(value) < 1e9
