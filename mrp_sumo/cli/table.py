"""Printing of tables."""

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table


def print_table(table: "Table", width: int) -> None:
    """Print a table, as wide as the terminal or, in a pipe, at most `width` columns. A name such as `:bomb:` stays what it is."""
    from rich.console import Console

    Console(highlight=False, emoji=False, width=None if sys.stdout.isatty() else width).print(table)
