"""Files and folders that are written whole or not at all."""

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from mrp_sumo.errors import MrpSumoError, sentence
from mrp_sumo.files.reading import shortened


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A place beside `path` to write to, which replaces `path` at the end; after a fault nothing of it is left.

    A device or pipe, such as /dev/null, is written to as it is: who may replace it would take it from everybody. Raises OSError as the
    system reports it.
    """
    if _is_special(path):
        yield path
        return
    part = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield part
        part.replace(path)
    finally:
        with suppress(OSError):  # such as a read-only disk, which has been reported
            part.unlink(missing_ok=True)


def remove_parts(folder: Path) -> None:
    """Remove what a process that was killed has left of files that `written_whole` was to write into a folder."""
    for part in folder.glob(".[0-9]*.*"):
        if part.name.split(".")[1].isdigit():
            part.unlink(missing_ok=True)


@contextmanager
def writing_to(path: Path, error: type[MrpSumoError] = MrpSumoError) -> Iterator[None]:
    """Within the block, faults of the system are about a place that a user has named. Raises `error` for them."""
    try:
        yield
    except OSError as fault:
        raise error(f"{shortened(path)}: cannot be written: {sentence(fault)}") from None


@contextmanager
def written_for_user(path: Path) -> Iterator[Path]:
    """As `written_whole`, for a place that a user has named. Raises MrpSumoError where it cannot be written."""
    with writing_to(path), written_whole(path) as part:
        yield part


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """A folder beside `out` to write to, which replaces `out` at the end; after a fault nothing of it is left.

    Raises OSError as the system reports it, and for a device or pipe.
    """
    if _is_special(out):
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(out))
    new, old = (out.parent / f".{out.name}.{age}-{os.getpid()}" for age in ("new", "old"))
    try:
        new.mkdir(parents=True)
        yield new
        if out.exists():
            out.rename(old)
        try:
            new.rename(out)
        except OSError:
            if old.exists():
                old.rename(out)
            raise
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(new, ignore_errors=True)


def _is_special(path: Path) -> bool:
    return path.exists() and not path.is_file() and not path.is_dir()


def write_text(path: Path, text: str) -> None:
    """Write a file, whole or not at all. Raises MrpSumoError where it cannot be written."""
    with written_for_user(path) as part:
        part.write_text(text, encoding="utf-8")


def write_whole(path: Path, data: bytes) -> None:
    """Write a file whole or not at all, even when the power fails.

    Raises OSError as the system reports it; nothing of the file is left then.
    """
    new = [folder for folder in path.parents if not folder.exists()]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as part, part.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        if error.errno is not None:
            error.filename = str(path)  # a full disk names no file, and the other name is nobody's business
        raise
    for folder in (path.parent, *(folder.parent for folder in new)):  # a folder is there for good once the one above is synced
        sync_folder(folder)


def sync_folder(folder: Path) -> None:
    """Have the disk keep which files are in a folder."""
    opened = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)
