"""Files that are written whole or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from mrp_sumo.errors import MrpSumoError, sentence
from mrp_sumo.files.reading import shortened


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


@contextmanager
def written_for_user(path: Path) -> Iterator[Path]:
    """As `written_whole`, for a place that a user has named. Raises MrpSumoError where it cannot be written."""
    try:
        with written_whole(path) as part:
            yield part
    except OSError as error:
        raise MrpSumoError(f"{shortened(path)}: cannot be written: {sentence(error)}") from None


def write_text(path: Path, text: str) -> None:
    """Write a file, whole or not at all. Raises MrpSumoError where it cannot be written."""
    with written_for_user(path) as part:
        part.write_text(text, encoding="utf-8")
