"""Objects in a few lines, for people: as text, and as a table in notebooks."""

import html
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T")
ON_TIME_S = 1e-6


@dataclass(frozen=True)
class Summary:
    """A title and named lines; lines without text are left out."""

    title: str
    rows: tuple[tuple[str, str], ...]

    @property
    def text(self) -> str:
        """The title, and a line per row."""
        width = max((len(name) for name, _ in self.rows), default=0)
        return "\n".join([self.title, *(f"  {name:<{width}}  {value}" for name, value in self.rows)])

    @property
    def html(self) -> str:
        """A table; names and values cannot bring markup with them."""
        style = "text-align: left; vertical-align: top"
        rows = "".join(
            f'<tr><th style="{style}">{html.escape(name)}</th><td style="{style}">{html.escape(value)}</td></tr>'
            for name, value in self.rows
        )
        return f"<div><b>{html.escape(self.title)}</b><table>{rows}</table></div>"


def with_summary(described: type[T]) -> type[T]:
    """A class whose objects print as their `_summary`, and are shown by notebooks as its table."""
    shown: dict[str, Callable[[Any], str]] = {
        "__str__": lambda self: self._summary.text,
        "_repr_html_": lambda self: self._summary.html,
    }
    for name, text in shown.items():
        setattr(described, name, text)
    return described


def summary(title: str, rows: Iterable[tuple[str, object]]) -> Summary:
    """A summary of the rows that have a value."""
    return Summary(title, tuple((name, str(value)) for name, value in rows if value not in (None, "")))


def seconds(value: float | None) -> str:
    """A duration, in ms below half a second; empty for None."""
    if value is None:
        return ""
    return "0 s" if value == 0 else f"{value * 1000:.1f} ms" if abs(value) < 0.5 else f"{value:.1f} s"


def lateness(value: float | None) -> str:
    """A lateness in words; empty for None."""
    if value is None or abs(value) < ON_TIME_S:
        return "" if value is None else seconds(0)
    return f"{seconds(abs(value))} {'early' if value < 0 else 'late'}"
