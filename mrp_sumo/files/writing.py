"""Files that are written whole or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A place beside `path` to write to, which replaces `path` at the end; after a fault nothing of it is left.

    Raises
    ------
    OSError
        As the system reports it.
    """
    part = path.with_name(f".part.{path.name}")
    try:
        yield part
        part.replace(path)
    finally:
        with suppress(OSError):  # such as a read-only disk, which has been reported
            part.unlink(missing_ok=True)
