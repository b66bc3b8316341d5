"""Programs of strangers that may run: plug-in files, and commands of external planners, that scenarios and suites name.

A program runs when the user has named it (on the command line, or in a call), when everything is trusted (`--trust`), or when the
file that names it lies in a folder that was trusted once. Worker processes trust what they are handed: who hands it out has asked.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mrp_sumo.errors import MrpSumoError, in_one_line
from mrp_sumo.files.reading import read_text
from mrp_sumo.files.writing import write_whole, writing_to

MAX_BYTES = 1_000_000  # of the list of folders
_named: set["Program"] = set()
_everything = False


@dataclass(frozen=True)
class Program:
    """A plug-in's file, or a command."""

    path: Path | None  # resolved; None for a command
    command: str = ""

    @property
    def shown(self) -> str:
        """The program in one line."""
        return in_one_line((str(self.path) if self.path else self.command)[:300])


def trust(program: Program) -> None:
    """Trust a program that the user has named, until this process ends."""
    _named.add(program)


def trust_everything(wanted: bool = True) -> None:
    """Trust all programs, until this process ends, where that is wanted."""
    global _everything
    _everything = _everything or wanted


@contextmanager
def everything_trusted(wanted: bool) -> Iterator[None]:
    """Trust all programs within a context, where that is wanted."""
    global _everything
    before = _everything
    trust_everything(wanted)
    try:
        yield
    finally:
        _everything = before


def is_trusted(program: Program) -> bool:
    """True for a program that may run."""
    return _everything or program in _named


def require_trusted(program: Program) -> None:
    """The last gate, where a plug-in's file would be executed. Raises MrpSumoError when it may not."""
    if not is_trusted(program):
        raise MrpSumoError(f"would run {program.shown}, which is not trusted: name it on the command line, or add --trust")


def in_trusted_folder(folder: Path) -> bool:
    """True for a folder that was trusted once, or is in one that was."""
    place = folder.resolve()
    return any(place.is_relative_to(trusted) for trusted in trusted_folders())


def trusted_folders() -> tuple[Path, ...]:
    """The folders that were trusted once, sorted. Raises MrpSumoError when the list cannot be read."""
    path = _list_file()
    return tuple(Path(line) for line in read_text(path, MAX_BYTES).splitlines() if line.startswith("/")) if path.exists() else ()


def trust_folder(folder: Path) -> Path:
    """Trust the programs that files of a folder, and of folders in it, name.

    Raises MrpSumoError when it is no folder, or the list cannot be written.
    """
    place = folder.resolve()
    if not place.is_dir():
        raise MrpSumoError(f"{folder}: {'is a file, expected a folder' if place.exists() else 'no such folder'}")
    if not str(place).isprintable():
        raise MrpSumoError(f"{str(place)!r}: a folder with such a name cannot be kept in the list of trusted ones")
    _write({*trusted_folders(), place})
    return place


def forget_folder(folder: Path) -> Path:
    """Trust a folder no longer. Raises MrpSumoError when it was not trusted, or the list cannot be written."""
    place, known = folder.resolve(), trusted_folders()
    if place not in known:
        above = next((trusted for trusted in known if place.is_relative_to(trusted)), None)
        raise MrpSumoError(f"{place}: is not in the list of trusted folders" + (f", but {above} above it is" if above else ""))
    _write(set(known) - {place})
    return place


def _list_file() -> Path:
    home = os.environ.get("XDG_CONFIG_HOME", "")
    return (Path(home) if home.startswith("/") else Path.home() / ".config") / "mrp-sumo" / "trusted"


def _write(folders: set[Path]) -> None:
    path = _list_file()
    with writing_to(path):
        write_whole(path, "".join(f"{folder}\n" for folder in sorted(folders)).encode())
