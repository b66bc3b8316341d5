"""Printing: lines beside the output, and tables."""

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table


def print_table(table: "Table", width: int) -> None:
    """Print a table, as wide as the terminal or, in a pipe, at most `width` columns. A name such as `:bomb:` stays what it is."""
    from rich.console import Console

    Console(highlight=False, emoji=False, width=None if sys.stdout.isatty() else width).print(table)


def warn(line: str) -> None:
    """Print a line to stderr."""
    print(f"mrp-sumo: {line}", file=sys.stderr)


def print_failure(what: str, line: str, details: str) -> None:
    """Print a line about a plug-in that failed to stderr, after the traceback if there is one to show."""
    if details:
        print(details.rstrip(), file=sys.stderr)
    warn(f"{what}: {line}")
