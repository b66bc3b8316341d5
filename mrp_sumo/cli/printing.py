"""Lines of the commands on the terminal. Names in them may be anybody's: nothing in them ends a line or moves the cursor.

All that a command prints goes through here; `tests/cli/test_shown.py` reads the sources and proves it.
"""

import sys
from collections.abc import Container, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

from mrp_sumo.errors import shown

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text


def say(*lines: object, to_stderr: bool = False) -> None:
    """Print each argument as one line."""
    for line in lines:
        print(shown(str(line)), file=sys.stderr if to_stderr else sys.stdout, flush=True)


def say_json(value: object, indent: int | None = None) -> None:
    """Print a value as JSON, on one line unless it is indented; what is not ASCII is escaped."""
    import json

    print(json.dumps(value, indent=indent), flush=True)


def say_either(as_json: bool, document: object, *lines: object, indent: int | None = None) -> None:
    """Print a document as JSON, or else its lines for people."""
    if as_json:
        say_json(document, indent)
    else:
        say(*lines)


def say_summary(summary: Mapping[str, object], as_json: bool) -> None:
    """Print a summary as JSON, or a line for each key whose value says something."""
    if as_json:
        say_json(summary)
        return
    for key, value in summary.items():
        if value not in ("", None):
            value = " ".join(map(str, value)) if isinstance(value, tuple) else value
            say(f"{key}: {value:.6g}" if isinstance(value, float) else f"{key}: {value}")


def say_progress(text: str, *, is_last: bool = False) -> None:
    """Print a line on a terminal that the next one is printed over, unless it is the last; nothing in a pipe."""
    if sys.stderr.isatty():
        print(shown(text), end="\n" if is_last else "\r", file=sys.stderr, flush=True)


def plain_table(*names: "str | Text", right: Container[int] = (), gap: int = 2, title: str = "", **of_columns: Any) -> "Table":
    """A table without lines: with these headings, or without any; some columns to the right, and options that hold for all."""
    from rich.table import Table

    table = Table(box=None, padding=(0, gap, 0, 0), show_header=bool(names), title=title or None, title_style="bold", title_justify="left")
    for k, name in enumerate(names):
        table.add_column(name, justify="right" if k in right else "left", **of_columns)
    return table


def print_table(table: "Table", width: int) -> None:
    """Print a table, as wide as the terminal or, in a pipe, at most `width` columns. A name such as `:bomb:` stays what it is."""
    from rich.console import Console
    from rich.segment import Segment, Segments

    console = Console(highlight=False, emoji=False, width=None if sys.stdout.isatty() else width)
    parts = (part if part.text == "\n" else Segment(shown(part.text), part.style, part.control) for part in console.render(table))
    console.print(Segments(parts), end="")


def warn(line: object) -> None:
    """Print a line to stderr, with the program's name before it."""
    say(f"mrp-sumo: {line}", to_stderr=True)


@cache
def warn_of_kernels() -> None:
    """Say so, once, where compiled kernels cannot be kept, before minutes go by in silence."""
    from mrp_sumo.experiments.kernels import why_not_kept

    if reason := why_not_kept():
        warn(reason)


def print_failure(what: str, line: str, details: str) -> None:
    """Print a line about a plug-in that failed to stderr, after the traceback if there is one to show."""
    say(*details.rstrip().split("\n") if details else (), to_stderr=True)
    warn(f"{what}: {line}")
