"""Trajectories as Parquet: one long table of exact float64, the source of truth that every other log derives from.

Columns: `t_ns` int64, `robot` dictionary of names, `x_m`, `y_m`, `yaw_rad`, `speed_mps` float64. A robot that is not on the floor has no
row. Where robots change levels, `level` is a dictionary of names, too, and positions are in the frame of that level: what was added
to lay levels side by side is subtracted, and kept in the metadata. Row groups hold about half a million rows, robot by robot inside,
compressed with zstd after a byte-stream split. Equal executions give equal bytes. Refuses files of another schema.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.errors import MrpSumoError, first_line
from mrp_sumo.files.reading import require_regular
from mrp_sumo.io.arrow import numbers, texts

if TYPE_CHECKING:
    import pandas

SCHEMA_VERSION = 1
ROWS_PER_GROUP = 500_000
COLUMNS = ("x_m", "y_m", "yaw_rad", "speed_mps")
UNITS = {"t_ns": "ns of simulated time", "x_m": "m", "y_m": "m", "yaw_rad": "rad, counter-clockwise from +x", "speed_mps": "m/s"}


@dataclass(frozen=True, eq=False)
class Levels:
    """K levels that robots change between."""

    name: tuple[str, ...]  # [K]
    shift_m: FloatArray  # [K, 2] added to the positions on each, to lay them side by side


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
    levels: Levels | None = None

    @property
    def t_s(self) -> FloatArray:
        """[T] simulated time."""
        return self.t_ns / 1e9


def write_trajectory(
    path: Path, execution: Execution, robot_name: tuple[str, ...], metadata: Mapping[str, Any], levels: Levels | None = None
) -> None:
    """Write the table.

    Parameters
    ----------
    path
        To be written.
    execution
        T samples.
    robot_name
        [R]
    metadata
        JSON values to keep in the file: scenario, seed, versions.
    levels
        Of an execution in which robots change them.
    """
    t_ns = _ticks(execution)
    about = {
        "schema_version": SCHEMA_VERSION,
        "units": UNITS,
        "robots": list(robot_name),
        "t_ns": _stamps_document(t_ns),
        **metadata,
    }
    if levels:
        about |= {"levels": dict(zip(levels.name, levels.shift_m.tolist()))}
    schema = _schema(len(robot_name), levels).with_metadata(
        {"mrp_sumo": json.dumps(about, sort_keys=True, ensure_ascii=False, allow_nan=False)}
    )
    encoding = {"t_ns": "DELTA_BINARY_PACKED", **dict.fromkeys(COLUMNS, "BYTE_STREAM_SPLIT")}
    with pq.ParquetWriter(path, schema, compression="zstd", use_dictionary=["robot", "level"], column_encoding=encoding) as writer:
        for table in _tables(execution, robot_name, t_ns, levels):
            writer.write_table(table.replace_schema_metadata(schema.metadata), ROWS_PER_GROUP * 2)


def trajectory_of(execution: Execution, robot_name: tuple[str, ...]) -> Trajectory:
    """The trajectory as arrays, without metadata."""
    columns: dict[str, Any] = {name: getattr(execution, name) for name in COLUMNS}
    return Trajectory(_ticks(execution), robot_name, **columns, metadata={}, level=execution.level)


def trajectory_table(execution: Execution, robot_name: tuple[str, ...], levels: Levels | None = None) -> pa.Table:
    """The table in memory, without metadata."""
    return pa.concat_tables([_schema(len(robot_name), levels).empty_table(), *_tables(execution, robot_name, _ticks(execution), levels)])


def trajectory_frame(table: pa.Table) -> "pandas.DataFrame":
    """The table as a DataFrame with columns t_s, robot, x_m, y_m, yaw_rad, speed_mps, and level where robots change them."""
    frame: pandas.DataFrame = table.to_pandas()
    frame.insert(0, "t_s", frame.pop("t_ns") / 1e9)
    return frame


def _ticks(execution: Execution) -> IntArray:
    return np.rint(execution.t_s * 1e9).astype(np.int64)


def _schema(num_robots: int, levels: Levels | None) -> pa.Schema:
    robot = pa.dictionary(pa.from_numpy_dtype(_index(num_robots)), pa.string())
    fields = [pa.field("t_ns", pa.int64(), False), pa.field("robot", robot, False)]
    fields += [pa.field(name, pa.float64(), False) for name in COLUMNS]
    return pa.schema(fields + ([pa.field("level", pa.dictionary(pa.int16(), pa.string()), False)] if levels else []))


def _index(num_robots: int) -> type[np.signedinteger]:
    return np.int16 if num_robots < 2**15 else np.int32


def _tables(execution: Execution, robot_name: tuple[str, ...], t_ns: IntArray, levels: Levels | None) -> Iterator[pa.Table]:
    """The rows, half a million at a time, robot by robot in each."""
    num_samples, num_robots = execution.x_m.shape
    schema, names = _schema(num_robots, levels), texts(robot_name)
    ticks = max(1, ROWS_PER_GROUP // max(1, num_robots))
    for a in range(0, num_samples, ticks):
        rows = slice(a, min(a + ticks, num_samples))
        flat = [np.ascontiguousarray(getattr(execution, name)[rows].T).ravel() for name in COLUMNS]
        length = rows.stop - rows.start
        time, robot = np.tile(t_ns[rows], num_robots), np.repeat(np.arange(num_robots), length)
        if levels and execution.level is not None:
            flat.append(np.ascontiguousarray(execution.level[rows].T).ravel())
            flat[:2] = flat[0] - levels.shift_m[flat[-1], 0], flat[1] - levels.shift_m[flat[-1], 1]
        there = np.isfinite(flat[0]) & np.isfinite(flat[1])
        if not there.all():
            time, robot, flat = time[there], robot[there], [values[there] for values in flat]
        robots = pa.DictionaryArray.from_arrays(numbers(robot.astype(_index(num_robots))), names)
        columns = [numbers(time), robots, *map(numbers, flat[: len(COLUMNS)])]
        if levels:
            columns.append(pa.DictionaryArray.from_arrays(numbers(flat[-1].astype(np.int16)), texts(levels.name)))
        yield pa.Table.from_arrays(columns, schema=schema)


def read_trajectory(path: Path) -> Trajectory:
    """Read a table back.

    Raises
    ------
    MrpSumoError
        For a file that is missing, damaged, or of another schema.
    """
    require_regular(path)
    try:
        table = pq.read_table(path)
    except (pa.ArrowInvalid, OSError) as error:
        raise MrpSumoError(f"{path}: not a readable Parquet file: {first_line(error)}") from None
    about = json.loads((table.schema.metadata or {}).get(b"mrp_sumo", b"null"))
    if not isinstance(about, dict) or about.get("schema_version") != SCHEMA_VERSION:
        found = about.get("schema_version") if isinstance(about, dict) else "no trajectory"
        raise MrpSumoError(f"{path}: schema version {found}, expected {SCHEMA_VERSION}")
    names = about["robots"]
    t_ns = _stamps(about["t_ns"])
    row, robot = np.searchsorted(t_ns, table["t_ns"].to_numpy()), _indices(table["robot"], names)
    columns: dict[str, Any] = {}
    for name in COLUMNS:
        values = np.full((len(t_ns), len(names)), np.nan)
        values[row, robot] = table[name].to_numpy()
        columns[name] = values
    if "levels" not in about:
        return Trajectory(t_ns, tuple(names), **columns, metadata=about)
    levels = Levels(tuple(about["levels"]), np.array(list(about["levels"].values()), np.float64).reshape(-1, 2))
    level = np.zeros((len(t_ns), len(names)), np.int64)
    level[row, robot] = on = _indices(table["level"], list(levels.name))
    for k, axis in enumerate(COLUMNS[:2]):
        columns[axis][row, robot] += levels.shift_m[on, k]
    return Trajectory(t_ns, tuple(names), **columns, metadata=about, level=level, levels=levels)


def _stamps_document(t_ns: IntArray) -> dict[str, Any]:
    """The stamps in JSON: first, last and number where they are evenly spaced, else all of them."""
    if len(t_ns):
        evenly = {"first": int(t_ns[0]), "last": int(t_ns[-1]), "count": len(t_ns)}
        if np.array_equal(_stamps(evenly), t_ns):
            return evenly
    return {"all": t_ns.tolist()}


def _stamps(document: Mapping[str, Any]) -> IntArray:
    if "all" in document:
        return np.array(document["all"], np.int64)
    return np.rint(np.linspace(document["first"], document["last"], document["count"])).astype(np.int64)


def _indices(column: Any, names: list[str]) -> IntArray:
    """[N] index of each row's robot in the list of names."""
    chunks = column.chunks if isinstance(column, pa.ChunkedArray) else [column]
    at = {name: i for i, name in enumerate(names)}
    parts = [np.array([at[n] for n in c.dictionary.to_pylist()] or [0], np.int64)[c.indices.to_numpy()] for c in chunks]
    return np.concatenate([np.zeros(0, np.int64), *parts])
