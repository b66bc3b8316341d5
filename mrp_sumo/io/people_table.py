"""Positions of people as Parquet: `people.parquet`, person by person, at the times of the trajectory's samples.

Columns: `t_ns` int64, `person` int32, `x_m`, `y_m` float32; where robots change levels `level`, too, and positions are in its frame,
as in the trajectory. The file's metadata hold what belongs to no sample: radius, each person's level and how long it stood before
robots, what people cost each robot, stops, and the figures of the fields.
"""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mrp_sumo.core.graph import FloatArray, IntArray, frozen
from mrp_sumo.core.people import PeopleLog
from mrp_sumo.io.arrow import KEY, numbers, texts
from mrp_sumo.io.tables import read_table

if TYPE_CHECKING:
    from mrp_sumo.maps.lifts import Shift

PEOPLE = "people.parquet"
ROWS_PER_GROUP = 1_000_000
LISTED = {  # in the metadata, in their order: those of people, of robots, and of stops
    **{"level": np.int64, "waited_s": np.float64, "lost_s": np.float64},
    **{"stop_robot": np.int64, "stop_s": np.float64, "stop_duration_s": np.float64, "stop_in_motion": np.bool_},
}
FIGURES = ("radius_m", "extra_m", "reaction_s", "side_m", "slowest_mps")


def write_people(path: Path, log: PeopleLog, t_s: FloatArray, levels: "Shift | None") -> None:
    """Write the table. `t_s` [T]: the times of the samples."""
    t_ns = np.repeat(np.rint(t_s * 1e9).astype(np.int64), np.diff(log.first))
    order = np.lexsort((t_ns, log.person))
    person, x_m, y_m = log.person[order], log.x_m[order], log.y_m[order]
    columns = {"t_ns": numbers(t_ns[order]), "person": numbers(person)}
    if levels:
        on = log.level[person]
        shift_m = np.array(list(levels.values()))[on].astype(np.float32)
        x_m, y_m = (column - shift_m[:, k] for k, column in enumerate((x_m, y_m)))
        columns["level"] = pa.DictionaryArray.from_arrays(numbers(on.astype(np.int16)), texts(levels))
    columns |= {"x_m": numbers(x_m), "y_m": numbers(y_m)}
    about = {name: getattr(log, name).tolist() for name in LISTED}
    about |= {name: value if np.isfinite(value := getattr(log, name)) else None for name in FIGURES}
    table = pa.table(columns).replace_schema_metadata({KEY: json.dumps(about, allow_nan=False)})
    encoding = {"t_ns": "DELTA_BINARY_PACKED", "person": "DELTA_BINARY_PACKED", "x_m": "BYTE_STREAM_SPLIT", "y_m": "BYTE_STREAM_SPLIT"}
    pq.write_table(table, path, row_group_size=ROWS_PER_GROUP, compression="zstd", use_dictionary=["level"], column_encoding=encoding)


def read_people(path: Path, t_ns: IntArray, levels: "Shift | None", num_robots: int) -> PeopleLog:
    """The log as it was written. `t_ns` [T]: the times of the samples."""
    table = read_table(path)
    listed = {name: table.about_numbers(name) for name in ("level", "stop_robot")}
    num_people, num_stops = len(listed["level"]), len(listed["stop_robot"])
    for name in LISTED:
        count = num_robots if name == "lost_s" else num_stops if name.startswith("stop_") else num_people
        listed[name] = table.about_numbers(name, count)
    for name, most in (("level", len(levels) if levels else 1), ("stop_robot", num_robots)):
        if not np.isin(listed[name], np.arange(most)).all():
            raise table.fault(f"its metadata '{name}' hold a number that is none of {most}")
    time, person = table.integers("t_ns"), table.integers("person", 0, num_people - 1).astype(np.int32)
    if not np.isin(time, t_ns).all():
        raise table.fault("a person is somewhere at a time of no sample")
    x_m, y_m = (table.numbers(name).astype(np.float32) for name in ("x_m", "y_m"))
    order = np.lexsort((person, time))
    if ((np.diff(time[order]) == 0) & (np.diff(person[order]) == 0)).any():
        raise table.fault("a person is at two places at once")
    level = listed["level"].astype(np.int64)
    if levels:
        on = level[person]
        shift_m = np.array(list(levels.values()))[on].astype(np.float32)
        x_m, y_m = (column + shift_m[:, k] for k, column in enumerate((x_m, y_m)))
    first = np.searchsorted(time[order], t_ns)
    columns: dict[str, Any] = {name: frozen(listed[name].astype(kind)) for name, kind in LISTED.items()}
    figures: dict[str, Any] = {name: table.about_number(name, missing=np.nan) for name in FIGURES}
    return PeopleLog(
        first=frozen(np.append(first, len(time)).astype(np.int64)),
        person=frozen(person[order]),
        x_m=frozen(x_m[order]),
        y_m=frozen(y_m[order]),
        **columns,
        **figures,
    )
