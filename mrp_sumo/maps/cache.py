"""Maps and networks that were made are kept in the user's cache folder, by content: the same bytes in, the same thing out.

The folder is `$XDG_CACHE_HOME/mrp-sumo` or `~/.cache/mrp-sumo`; it may be deleted at any time. Reading a pickle runs what it says, so
the same holds as for stored kernels: only a folder that nobody else can write to is used, entries are the user's own and begin with their
checksum, and the least recently used go first. Without such a folder nothing is kept, silently.
"""

import contextlib
import gc
import hashlib
import os
import pickle
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from mrp_sumo import __version__
from mrp_sumo.files.writing import written_whole

T = TypeVar("T")

MAX_BYTES = 2**28  # of all entries
CHECKSUM_BYTES = 4


def remembered(kind: str, content: bytes, make: Callable[[], T]) -> T:
    """The result of `make`; from the cache if it was made of the same content before.

    The content is everything that the result depends on besides this program; the result must pickle.
    """
    folder = _folder()
    if folder is None:
        return make()
    path = folder / f"{kind}-{hashlib.sha256(_program() + content).hexdigest()[:40]}.pickle"
    hit, value = _read(path)
    if hit:
        stored: T = value
        return stored
    made = make()
    _keep(path, made)
    return made


def _folder() -> Path | None:
    """The folder of entries; None where there is none that this user alone can write to."""
    base = os.environ.get("XDG_CACHE_HOME")
    folder = (Path(base) if base else Path.home() / ".cache") / "mrp-sumo"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        status = folder.stat()
    except OSError:
        return None
    return folder if status.st_uid == os.getuid() and not status.st_mode & 0o022 else None


def _program() -> bytes:
    """The program's version, and the state of the files that make maps and networks: another program makes other things."""
    package = Path(__file__).parents[1]
    files = sorted(file for room in ("core", "maps", "engines") for file in (package / room).rglob("*.py"))
    state = [(file.name, (s := file.stat()).st_mtime_ns, s.st_size) for file in files]
    return f"{__version__} {state}".encode()


def _read(path: Path) -> tuple[bool, Any]:
    was_collecting = gc.isenabled()
    try:
        with path.open("rb") as file:
            if os.fstat(file.fileno()).st_uid != os.getuid():
                return False, None  # a pickle of somebody else's is a program of somebody else's
            checksum, content = file.read(CHECKSUM_BYTES), file.read()
        if checksum != _checksum(content):
            return False, None
        gc.disable()
        value = pickle.loads(content)
        with contextlib.suppress(OSError):
            os.utime(path)
        return True, value
    except Exception:  # missing, cut off, or of another version: make it again
        return False, None
    finally:
        if was_collecting:
            gc.enable()


def _checksum(content: bytes) -> bytes:
    return zlib.crc32(content).to_bytes(CHECKSUM_BYTES)


def _keep(path: Path, value: Any) -> None:
    content = pickle.dumps(value, protocol=5)
    with contextlib.suppress(OSError):
        with written_whole(path) as part:
            part.write_bytes(_checksum(content) + content)
        _prune(path.parent)


def _prune(folder: Path) -> None:
    total = 0
    entries = [(entry.stat(), entry) for entry in folder.iterdir() if entry.is_file()]  # drafts of killed processes, too
    for stat, entry in sorted(entries, key=lambda e: e[0].st_mtime, reverse=True):
        total += stat.st_size
        if total > MAX_BYTES:
            entry.unlink(missing_ok=True)
