"""Traces of a batch's runs: what metrics are computed from, in a file of some ten kB a run, exact to the bit.

    DIR/runs/ab/abcd....trace  a ZIP archive: the files of a run folder but for its bag, its network and its map
    DIR/floors/HASH.json.gz    the graphs and the fleet that runs drove with, once for all runs that share them

Equal runs give equal bytes. A trace is taken apart into a folder that `io.run_reader` reads. Refuses damaged traces, and writes none
above 64 MB: of a run so long the folder itself is kept by `mrp-sumo run`.
"""

import gzip
import hashlib
import io
import zipfile
from dataclasses import dataclass
from pathlib import Path

from mrp_sumo.errors import BatchError, first_line
from mrp_sumo.files.reading import read_bytes
from mrp_sumo.files.writing import write_whole
from mrp_sumo.io.results import record_path

FLOOR = "floor.json"
FLOORS = "floors"
MAX_BYTES = 2**26
MAX_FILES_BYTES = 2**30  # of all files in a trace
_MARK = "floor"  # the member that says which floor
_TIME = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Trace:
    """A run in bytes, and the floor that it shares with others."""

    archive: bytes
    floor: bytes  # compressed


def trace_of(folder: Path) -> Trace | None:
    """The trace of what was written of a run into a folder; None for one that is too long to keep."""
    floor = gzip.compress((folder / FLOOR).read_bytes(), mtime=0)
    files = sorted(path for path in folder.iterdir() if path.is_file() and path.name != FLOOR)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        archive.writestr(zipfile.ZipInfo(_MARK, _TIME), _name(floor))
        for path in files:
            archive.writestr(zipfile.ZipInfo(path.name, _TIME), path.read_bytes(), zipfile.ZIP_DEFLATED, 9)
    return Trace(buffer.getvalue(), floor) if buffer.tell() <= MAX_BYTES else None


def trace_path(folder: Path, key: str) -> Path:
    """Path of the trace of a batch's run."""
    return record_path(folder, key).with_suffix(".trace")


def write_trace(folder: Path, key: str, trace: Trace) -> None:
    """Keep the trace of a run of a batch, in place of an earlier one."""
    floor = folder / FLOORS / _name(trace.floor)
    if not floor.is_file():
        write_whole(floor, trace.floor)
    write_whole(trace_path(folder, key), trace.archive)


def read_trace(folder: Path, key: str, into: Path) -> None:
    """Take the trace of a run of a batch apart, into an empty folder. Raises BatchError when it is missing or damaged."""
    path = trace_path(folder, key)
    data = read_bytes(path, MAX_BYTES, BatchError)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = archive.infolist()
            if sum(member.file_size for member in members) > MAX_FILES_BYTES:
                raise ValueError("its files are too large")
            for member in members:
                name = member.filename
                if name == _MARK:
                    floor = archive.read(member).decode()
                elif name != Path(name).name or name.startswith("."):
                    raise ValueError(f"a file called {name[:40]!r}")
                else:
                    (into / name).write_bytes(archive.read(member))
        if floor != Path(floor).name:
            raise ValueError(f"a floor called {floor[:40]!r}")
        packed = read_bytes(folder / FLOORS / floor, MAX_BYTES, BatchError)
        if _name(packed) != floor:
            raise ValueError(f"the floor {floor} is not what was written")
        with gzip.GzipFile(fileobj=io.BytesIO(packed)) as file:
            (into / FLOOR).write_bytes(file.read(MAX_FILES_BYTES))
    except BatchError:
        raise
    except Exception as error:  # zipfile and zlib raise anything on damaged files
        raise BatchError(f"{path}: not a whole trace: {first_line(error)}") from None


def _name(floor: bytes) -> str:
    return f"{hashlib.sha256(floor).hexdigest()[:32]}.json.gz"
