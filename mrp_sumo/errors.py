"""The expected failures: what the command line prints in one line, with exit code 2.

Every error carries one finished sentence for a person: the file or key, what was found, what was
expected and, where it helps, the nearest right name. Nothing else in the package prints or exits.
"""

import errno
import re
from collections.abc import Iterable, Sequence
from difflib import get_close_matches

_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")  # what moves a cursor, ends a line or turns text round


def shown(text: str) -> str:
    """A text that may be anybody's, for a line on a terminal: with what a terminal would obey written out, such as `\\x1b`."""
    return _CONTROL.sub(lambda match: repr(match[0])[1:-1], text)


def duration(seconds: float) -> str:
    """A time for people: '90 s', '20 min', '2 h 35 min'."""
    minutes = round(seconds / 60)
    if minutes < 1 or (seconds < 120 and round(seconds) % 60):
        return f"{seconds:.0f} s"
    hours, rest = divmod(minutes, 60)
    return " ".join([*([f"{hours} h"] if hours else []), *([f"{rest} min"] if rest or not hours else [])])


def count(number: int, one: str, more: str = "") -> str:
    """`1 robot`, `9 robots`."""
    return f"{number:,} {one if number == 1 else more or one + 's'}"


def listed(names: Sequence[object], most: int) -> str:
    """`a, b and 4 more`."""
    return ", ".join(map(str, names[:most])) + (f" and {len(names) - most} more" if len(names) > most else "")


def in_one_line(text: str) -> str:
    """A text with a question mark for each character that cannot be printed."""
    return "".join(c if c.isprintable() else "?" for c in text)


class MrpSumoError(Exception):
    """Bad input, or a request that cannot be met. `str(error)` is the line to show."""

    def __init__(self, line: object = "") -> None:
        super().__init__(shown(str(line)))


class ScenarioError(MrpSumoError):
    """A scenario file that cannot be used; one line per fault in `lines`."""

    def __init__(self, *lines: str) -> None:
        super().__init__()
        self.lines = tuple(shown(line) for line in lines)
        self.args = ("\n".join(self.lines),)


class MapError(MrpSumoError):
    """A map that is refused."""


class ChoiceError(MapError):
    """A part or a property of a map that is asked for, and that the map does not have."""


class PlanError(MrpSumoError):
    """A problem, plan or schedule that is refused."""


class ExecutionError(MrpSumoError):
    """An execution that is refused before the first step, or that SUMO ended."""


class OptionError(MrpSumoError, ValueError):
    """An option out of bounds, or one that contradicts another. What reads files names its place, as it does for any ValueError."""


class BatchError(MrpSumoError):
    """A batch or a folder of results that is refused, or a batch that cannot go on."""


class PlugInError(MrpSumoError):
    """A plug-in that breaks its contract: one line with its file and line. `details` is its traceback, for `-v`."""

    def __init__(self, line: str, details: str = "") -> None:
        super().__init__(line)
        self.details = details


class PlanningOverrun(PlugInError):
    """A planner that worked on an answer for so long that the run is given up."""


_SENTENCES = {
    errno.ENOENT: "no such file or directory",
    errno.ENOTDIR: "a part of the path is a file, expected a folder",
    errno.EISDIR: "is a folder, expected a file",
    errno.EEXIST: "is there already",
    errno.ENOTEMPTY: "the folder is not empty",
    errno.EACCES: "no permission",
    errno.EPERM: "no permission",
    errno.EROFS: "the file system is read-only",
    errno.ENAMETOOLONG: "the name is too long",
    errno.ELOOP: "its symbolic links lead in a circle",
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file would be larger than is allowed",
    errno.EMFILE: "too many files are open",
    errno.ENFILE: "too many files are open",
    errno.EIO: "the disk reports an error",
    errno.ENOMEM: "out of memory",
    errno.EXDEV: "lies on another disk",
}


def lack_of_room(error: BaseException | None) -> str:
    """The disk without room that an error came of, in words; '' where it came of something else."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            return sentence(error)
        error = error.__cause__ or error.__context__
    return ""


def sentence(error: OSError) -> str:
    """An error of the system in words for people; where a message is about a path, it goes before."""
    if error.errno is None:
        return " ".join(str(error).split()) or type(error).__name__
    return _SENTENCES.get(error.errno, (error.strerror or str(error)).lower())


def first_line(error: Exception) -> str:
    """The text of a library's error in a line: its kind where it says nothing."""
    return next(iter(str(error).splitlines()), type(error).__name__)


def nearest(name: str, known: Iterable[str], limit: int = 5) -> str:
    """The end of a message about an unknown name: the likeliest meant, else what is known.

    Parameters
    ----------
    name
        What the user wrote.
    known
        The right names, in any order.
    limit
        How many known names to list when none is close; 0 lists none.
    """
    names = list(known)
    close = get_close_matches(name, names, n=1, cutoff=0.6)
    if not close:  # 'Dock4' for 'dock_4': compare without case and punctuation
        plain = {"".join(c for c in other.lower() if c.isalnum()): other for other in names}
        close = [plain[k] for k in get_close_matches("".join(c for c in name.lower() if c.isalnum()), plain, n=1, cutoff=0.75)]
    if close:
        return f" (did you mean '{close[0]}'?)"
    if not names or not limit:
        return ""
    listed = ", ".join(names[:limit]) + (", ..." if len(names) > limit else "")
    return f" (known: {listed})"
