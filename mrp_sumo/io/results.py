"""Results of a batch: one file per run, and tables of all of them.

    DIR/plan.json             what the batch is: suite, versions, the keys of its runs in order
    DIR/runs/ab/abcd....json  the record of a run, with its checksum; written whole, never changed but by a retry
    DIR/runs/ab/abcd....trace what metrics can be computed from later; see `io.trace`
    DIR/results.parquet, .csv one row per run; there only when they cover every record
    DIR/results.sha256        their checksums, as `sha256sum --check` reads them
    DIR/quarantine/           files of runs/ that could not be read

A record is complete when it is there: it is written under another name, synced, and renamed. Other files are left alone.
"""

import csv
import gc
import hashlib
import json
import os
import re
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from mrp_sumo.errors import BatchError, MrpSumoError, sentence
from mrp_sumo.files.folders import PLAN, require_batch
from mrp_sumo.files.reading import json_value, read_bytes, shortened
from mrp_sumo.files.writing import remove_parts, sync_folder, write_whole
from mrp_sumo.io.columns import SECTIONS, parameter_columns
from mrp_sumo.io.documents import in_words

if TYPE_CHECKING:
    import pandas
    import pyarrow

TABLE, CSV, SUMS = "results.parquet", "results.csv", "results.sha256"
MAX_ROWS = 10_000_000  # that a query gives
MAX_RECORD_BYTES, MAX_TABLE_BYTES = 2**26, 2**34
_LOCKED: dict[str, str | bool | int | float | list[str]] = {  # what SQL of a suite's views may do
    "enable_external_access": False,
    "autoinstall_known_extensions": False,
    "autoload_known_extensions": False,
    "allow_community_extensions": False,
    "python_enable_replacements": False,
    "memory_limit": "2GB",
    "temp_directory": "",
}
MACHINE_COLUMNS = ("attempts", "machine", "python", "run_wall_s", "run_cpu_s", "peak_memory_mb", "ended_at")  # differ from run to run
_HEAD, _TAIL = b'{"crc32":"%08x","record":', b"}\n"
_BEGIN = re.compile(rb'\{"key":"(\w+)","status":"(\w+)","attempts":(\d+),')

BatchRecord = dict[str, Any]


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True)


class _Group(_Strict):
    count: int | None = None
    starts: list[str] | None = None
    goals: list[str] | None = None


class _Robots(_Group):
    fleet: list[_Group] | None = None

    @model_validator(mode="after")
    def _counted(self) -> "_Robots":
        if any(group.count is None and group.starts is None and group.goals is None for group in self.fleet or [self]):
            raise ValueError("neither count nor starts")
        return self


class _Scenario(_Strict):
    robots: _Robots


class _Record(_Strict):
    """What all that reads records may rely on; other keys may hold anything."""

    key: str
    scenario_key: str
    status: str
    attempts: int
    success: bool
    reason: str
    scenario: _Scenario
    repeat: int
    until: str
    metrics: dict[str, Any]
    code: str
    libsumo: str
    ortools: str
    machine: str
    python: str
    run_wall_s: float | None
    run_cpu_s: float | None
    peak_memory_mb: float | None
    ended_at: str


def record_path(folder: Path, key: str) -> Path:
    return folder / "runs" / key[:2] / f"{key}.json"


def write_record(folder: Path, record: BatchRecord) -> None:
    """Write the record of a run, in place of an earlier one."""
    first = {name: record[name] for name in ("key", "status", "attempts")}  # where they are found without reading the rest
    body = json.dumps(first | record, separators=(",", ":")).encode()
    write_whole(record_path(folder, record["key"]), _HEAD % zlib.crc32(body) + body + _TAIL)


def read_record(path: Path) -> BatchRecord:
    """Read the record of a run. Raises BatchError when the file is not what was written."""
    record: BatchRecord = json.loads(_read_body(str(path), path.name))
    return record


def records_in(folder: Path, report: Callable[[str], None]) -> Iterator[BatchRecord]:
    """The records of a folder in arbitrary order. `report` is called with a line for each file that cannot be used."""
    for body in _bodies(folder, lambda path, reason: report(f"{reason}; left out")):
        yield json.loads(body)


def standings_in(folder: Path, report: Callable[[str], None], *, quarantine: bool = False) -> Iterator[tuple[str, str, int]]:
    """Key, status and number of attempts of every record of a folder, without reading the rest.

    `report` is called with a line for each file that cannot be used. For a batch, which makes their runs again, `quarantine` moves such
    files away, and removes what a killed process left.
    """

    def aside(path: Path, reason: str) -> None:
        if not quarantine:
            report(f"{reason}; left out")
            return
        (folder / "quarantine").mkdir(exist_ok=True)
        path.replace(folder / "quarantine" / path.name)
        report(f"{reason}; moved to quarantine, the run is made again")

    if quarantine:
        for written in (folder, folder / "floors", *folder.glob("runs/*")):
            remove_parts(written)
    for body in _bodies(folder, aside):
        begin = _BEGIN.match(body)
        assert begin  # its content was checked
        yield begin[1].decode(), begin[2].decode(), int(begin[3])


def record_files(folder: Path) -> Iterator[tuple[str, str]]:
    """Path and name of every record of a folder. These are strings: there may be 100,000."""
    if not (folder / "runs").is_dir():
        return
    for shard in sorted(entry.path for entry in os.scandir(folder / "runs") if entry.is_dir()):
        for name in sorted(entry.name for entry in os.scandir(shard) if entry.is_file()):
            if not name.startswith(".") and name.endswith(".json"):  # one being written, or left by a killed process; a stranger's
                yield f"{shard}/{name}", name


def _bodies(folder: Path, spoiled: Callable[[Path, str], None]) -> Iterator[bytes]:
    """The records of a folder as JSON, their checksums checked."""
    for path, name in record_files(folder):
        try:
            body = _read_body(path, name)
        except BatchError as error:
            spoiled(Path(path), str(error))
            continue
        yield body


def _read_body(path: str, name: str) -> bytes:
    data = read_bytes(Path(path), MAX_RECORD_BYTES, BatchError)
    size = len(_HEAD % 0)
    body = data[size : -len(_TAIL)]
    if data[:size] != _HEAD % zlib.crc32(body) or not data.endswith(_TAIL) or not (begin := _BEGIN.match(body)):
        raise BatchError(f"{name}: {len(data)} bytes, not a whole record")
    if begin[1].decode() + ".json" != name:
        raise BatchError(f"{name}: the record of another run, {begin[1].decode()}")
    try:  # a checksum says that a file is what was written, not that a batch wrote it
        _Record.__pydantic_validator__.validate_json(body)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        place = ".".join(map(str, first["loc"])) or "it"
        raise BatchError(f"{name}: not a record: {place}: {in_words(first['msg'])}") from None
    return body


def read_plan(folder: Path) -> dict[str, Any]:
    """Plan of the batch in a folder. Raises BatchError when the folder is not one of a batch."""
    path = folder / PLAN
    try:
        require_batch(folder)
        plan = json_value(read_bytes(path, error=BatchError))
        if plan["format"] != 1:
            raise BatchError(f"{path}: format {plan['format']!r:.20}, expected 1")
        texts = [plan[key] for key in ("suite", "description", "code", "until")]
        if not all(isinstance(text, str) for text in (*texts, *plan["keys"], *chain(*plan["views"].items()))):
            raise TypeError
    except OSError as error:
        raise BatchError(f"{shortened(path)}: {sentence(error)}") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        hint = "; move it away and start the batch again, no result is lost" if (path.parent / "runs").is_dir() else ""
        raise BatchError(f"{path}: not the plan of a batch{hint}") from None
    return dict(plan)


def row_of(record: BatchRecord) -> dict[str, Any]:
    """A record as a row: status, parameters, metrics, and how and where it was made."""
    robots = record["scenario"]["robots"]
    groups = robots.get("fleet") or [robots]
    return {
        **{name: record[name] for name in ("key", "scenario_key", "status", "success", "reason", "repeat")},
        **parameter_columns(record["scenario"]),
        "num_robots": sum(group["count"] or len(group["starts"] or group["goals"]) for group in groups),  # also for a run without metrics
        **record["metrics"],
        **{name: record[name] for name in ("code", "libsumo", "ortools", *MACHINE_COLUMNS)},
    }


def write_tables(folder: Path, records: Iterable[BatchRecord]) -> None:
    """Write results.parquet and results.csv, one row per record."""
    import io

    import pyarrow.parquet as pq

    table = _table(records)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.column_names)
    columns = [[json.dumps(v) if isinstance(v, list) else v for v in column.to_pylist()] for column in table.columns]
    writer.writerows(zip(*columns, strict=True))
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd")
    contents = {CSV: text.getvalue().encode(), TABLE: sink.getvalue()}
    for name, content in contents.items():
        write_whole(folder / name, content)
    write_whole(folder / SUMS, b"".join(_sum(name, content) for name, content in contents.items()))


def tables_are_whole(folder: Path) -> bool:
    """True if the tables are there as they were written."""
    return all(_is_whole(folder, name) for name in (CSV, TABLE))


def _is_whole(folder: Path, name: str) -> bool:
    try:
        return _sum(name, read_bytes(folder / name, MAX_TABLE_BYTES)) in read_bytes(folder / SUMS, MAX_RECORD_BYTES)
    except MrpSumoError:
        return False


def _sum(name: str, content: bytes) -> bytes:
    return f"{hashlib.sha256(content).hexdigest()}  {name}\n".encode()


def drop_tables(folder: Path) -> None:
    """Remove the tables, before there is a record that they do not cover."""
    for name in (SUMS, TABLE, CSV):
        (folder / name).unlink(missing_ok=True)
    sync_folder(folder)  # or they come back with the power


def load_results(path: str | Path, report: Callable[[str], None] | None = None) -> "pandas.DataFrame":
    """The results of a batch, one row per run, in the order of its suite.

    Columns: `key`, `scenario_key` (of the scenario alone, equal in other versions of the code), `status`,
    `success`, `reason`, `repeat`, all scenario keys (dotted; `map`, `planner`, `discretisation` for their
    main keys), all metrics, versions and machine. Missing is NA.

    Parameters
    ----------
    path
        Folder of a batch, finished or not, or a `results.parquet`.
    report
        Called with a line for each file that cannot be used.

    Raises
    ------
    BatchError
        When there are no results.
    """
    import pandas as pd
    import pyarrow as pa

    table = _load_table(Path(path), report or (lambda line: None))
    frame: pd.DataFrame = table.to_pandas(types_mapper={pa.bool_(): pd.BooleanDtype()}.get)
    return frame


def query(path: str | Path, sql: str, report: Callable[[str], None] | None = None) -> "pandas.DataFrame":
    """Query the results of a batch, the table `results`, in SQL.

    Views come with suites, so nobody's SQL is trusted: it sees the results and nothing else, neither files nor extensions nor the program's
    variables, in bounded memory. Raises BatchError when there are no results, or the query is refused.
    """
    import duckdb

    results = _load_table(Path(path), report or (lambda line: None))
    with duckdb.connect(config=_LOCKED) as connection:
        connection.register("results", results)
        connection.execute("set lock_configuration = true")
        try:
            relation = connection.sql(sql)
            if relation is None:
                raise BatchError("the query selects nothing; expected select ...")
            frame: pandas.DataFrame = relation.limit(MAX_ROWS + 1).df()
        except duckdb.Error as error:
            line = " ".join(str(error).split("LINE 1:")[0].splitlines()[0].split())
            raise BatchError(f"query: {line}") from None
    if len(frame) > MAX_ROWS:
        raise BatchError(f"query: selects more than {MAX_ROWS} rows; add a limit")
    return frame


def _load_table(path: Path, report: Callable[[str], None]) -> "pyarrow.Table":
    import pyarrow as pa

    from mrp_sumo.io.tables import read_table

    file = path / TABLE if path.is_dir() else path
    damaged = path.is_dir() and (path / SUMS).exists() and not _is_whole(path, TABLE)
    if not path.exists():
        raise BatchError(f"{shortened(path)}: no such folder")
    if not path.is_dir() or (file.exists() and not damaged):
        try:
            table = read_table(file, max_bytes=MAX_TABLE_BYTES, error=BatchError)
            for name in ("key", "scenario_key", "status"):
                if table.has(name):
                    table.texts(name)
            if table.has("success"):
                table.flags("success")
            for field in table.schema:
                if field.name.split(".")[0] in SECTIONS and pa.types.is_nested(field.type):
                    raise table.fault(f"column '{field.name[:40]}' holds {str(field.type)[:40]}, expected texts, numbers or yes and no")
            return table.as_written()
        except BatchError:
            if not path.is_dir():
                raise
    order = {key: i for i, key in enumerate(read_plan(path)["keys"])}
    with _no_collection():
        records = sorted((r for r in records_in(path, report) if r["key"] in order), key=lambda record: order[record["key"]])
        if not records:
            raise BatchError(f"{path}: no run has ended yet")
        return _table(records)


@contextmanager
def _no_collection() -> Iterator[None]:
    """No garbage collection among 100,000 records that all stay: it would be a third of the time of reading them."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def _table(records: Iterable[BatchRecord]) -> "pyarrow.Table":
    import pyarrow as pa

    columns: dict[str, list[Any]] = {}
    for i, record in enumerate(records):  # one at a time: there may be many
        row = row_of(record)
        for name, value in row.items():
            column = columns.get(name)
            if column is None:
                column = columns[name] = [None] * i
            column.append(value)
        if len(row) < len(columns):
            for column in columns.values():
                if len(column) == i:
                    column.append(None)
    return pa.table({name: _column(columns[name]) for name in _ordered(columns)})


def _ordered(names: Iterable[str]) -> list[str]:
    """Columns that only some rows have, such as parameters of one planner, go to their section."""
    listed = list(names)
    late = [name for name in listed if name.startswith(("planner.parameters.", "assignment.parameters."))]
    rest = [name for name in listed if name not in late]
    for name in sorted(late, reverse=True):
        section = name.split(".")[0]
        at = max((i for i, other in enumerate(rest) if other.split(".")[0] == section and other not in late), default=len(rest) - 1)
        rest.insert(at + 1, name)
    return rest


def _column(values: list[Any]) -> "pyarrow.Array":
    import pyarrow as pa

    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float} and float in kinds:
        return pa.array(values, pa.float64())
    if len(kinds) > 1 and not kinds <= {int, float}:  # such as nav graph 0 and 'all'
        return pa.array([v if v is None or isinstance(v, str) else json.dumps(v) for v in values], pa.string())
    if not kinds:
        return pa.array(values, pa.float64())
    try:
        return pa.array(values)
    except (pa.ArrowException, OverflowError):  # lists of several kinds, numbers beyond 64 bits
        return pa.array([None if v is None else json.dumps(v) for v in values], pa.string())
