"""The run folder: everything one run leaves on disk, written whole or not at all.

It is written under a temporary name beside its place and renamed when complete; `result.json` is its last
file, so its presence means that the run is complete. Replaces run folders only: anything else that is
in the way is refused.
"""

import glob
import hashlib
import json
import os
import shutil
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version
from typing import Any

import numpy as np

from mrp_sumo import __version__
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.folders import RESULT
from mrp_sumo.files.writing import new_folder, writing_to

SCHEMA_VERSION = 1  # of `result.json`
LIBRARIES = ("libsumo", "numpy", "scipy", "numba", "ortools", "rosbags", "pyarrow")  # libraries that shape results


def check_replaceable(out: Path) -> None:
    """Refuse to replace anything but a run folder.

    Raises MrpSumoError when the place is neither free, nor an empty folder, nor a run folder; or below something that is no folder.
    """
    out = out.resolve()
    if not out.exists():
        above = next(parent for parent in out.parents if parent.exists())
        if not above.is_dir():
            raise MrpSumoError(f"{out}: {above} is not a folder")
        if not os.access(above, os.W_OK):
            raise MrpSumoError(f"{out}: no permission to write in {above}")
        return
    if not out.is_dir():
        raise MrpSumoError(f"{out}: is a file, expected a folder for the run")
    if any(out.iterdir()) and not _is_run(out):
        raise MrpSumoError(f"{out}: is not empty and not a run folder (no {RESULT} of a run), so it is not replaced; choose another place")


def write_run(out: Path, document: Mapping[str, Any], write_files: Callable[[Path], None]) -> None:
    """Write the run folder: `result.json` of a document, with a list of the files, and what `write_files` writes into the folder.

    A run folder that is there already is replaced. Raises MrpSumoError when `out` holds something else, or the disk refuses; nothing
    half-written stays.
    """
    check_replaceable(out)
    out = out.resolve()
    _clear_leftovers(out)
    with writing_to(out), new_folder(out) as new:
        write_files(new)
        (new / RESULT).write_text(laid_out({**document, "files": files_in(new)}) + "\n", encoding="utf-8")


def versions() -> dict[str, str]:
    """Versions of Python, of this package and of the libraries that shape results."""
    versions_of = {"python": python_version(), "mrp_sumo": __version__}
    for name in LIBRARIES:
        try:
            versions_of[name] = version(name)
        except PackageNotFoundError:
            continue
    return versions_of


def plain(value: Any) -> Any:
    """The value in JSON's types: arrays as lists, numbers that are not finite as null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def laid_out(value: Any, depth: int = 0) -> str:
    """JSON with a line for each key and for each object of a list, and arrays of numbers in one line."""
    inner, outer = "\n" + "  " * (depth + 1), "\n" + "  " * depth
    if isinstance(value, dict) and value:
        rows = (f"{json.dumps(key, ensure_ascii=False)}: {laid_out(item, depth + 1)}" for key, item in value.items())
        return "{" + inner + f",{inner}".join(rows) + outer + "}"
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        return "[" + inner + f",{inner}".join(json.dumps(item, ensure_ascii=False, allow_nan=False) for item in value) + outer + "]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def files_in(folder: Path) -> dict[str, dict[str, Any]]:
    """Size and SHA-256 of every file, by its path in the folder."""
    files = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        with path.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        files[path.relative_to(folder).as_posix()] = {"bytes": path.stat().st_size, "sha256": digest}
    return files


def _is_run(folder: Path) -> bool:
    try:
        document = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(document, dict) and {"status", "scenario", "metrics"} <= set(document)


def _clear_leftovers(out: Path) -> None:
    """Remove leftovers of processes that were killed while they wrote this folder."""
    for path in out.parent.glob(f".{glob.escape(out.name)}.*-*"):
        kind, _, process = path.name.removeprefix(f".{out.name}.").partition("-")
        if kind not in ("new", "old") or not process.isdecimal() or _is_alive(int(process)):
            continue
        if kind == "old" and not out.exists():  # killed between the two renames: the old run is the last good one
            path.rename(out)
        else:
            shutil.rmtree(path, ignore_errors=True)


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        return True
    return True
