"""Tables: one content, written as HTML, CSV, Markdown and LaTeX.

A cell is text or a number; missing is None. Text is escaped for each form, so that names stay names.
"""

import csv
import html
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from mrp_sumo.experiments.statistics import Interval

_LATEX = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "{": r"\{",
        "}": r"\}",
        "$": r"\$",
        "&": r"\&",
        "#": r"\#",
        "%": r"\%",
        "_": r"\_",
        "^": r"\textasciicircum{}",
        "~": r"\textasciitilde{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "±": r"$\pm$",
        "–": "--",
        "−": r"$-$",
        "×": r"$\times$",
        "≤": r"$\leq$",
        "≥": r"$\geq$",
        "…": r"\dots{}",
        "[": "{[}",
        "]": "{]}",
    }
)


@dataclass(frozen=True)
class FileLink:
    """Text that leads to a file beside the page; plain text elsewhere."""

    text: str
    target: str


def scaled(interval: Interval, scale: float) -> Interval:
    """An interval in the unit of its column."""
    return Interval(scale * interval.value, scale * interval.low, scale * interval.high, interval.count)


def percent(rate: Interval) -> Interval:
    """The interval of a rate, in percent."""
    return scaled(rate, 100.0)


def whole(value: Any) -> int | None:
    """A number that may be missing as a cell."""
    return None if str(value) in ("None", "nan", "<NA>") else int(value)


Cell = str | float | int | Interval | FileLink | None


@dataclass(frozen=True)
class ReportTable:
    """A table with one heading per column."""

    name: str  # of its files
    title: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[Cell]]
    note: str = ""
    labels: int = 1  # how many columns at the left name the row
    folded: bool | None = None  # closed on the page until clicked; by default if it is long
    digits: dict[str, int] = field(default_factory=dict)  # column -> digits after the point; three significant ones by default

    def __post_init__(self) -> None:
        assert all(len(row) == len(self.columns) for row in self.rows)

    @property
    def is_folded(self) -> bool:
        return len(self.rows) > LONG if self.folded is None else self.folded

    def without_empty(self) -> "ReportTable":
        columns = [i for i in range(len(self.columns)) if i < self.labels or any(row[i] is not None for row in self.rows)]
        return replace(self, columns=tuple(self.columns[i] for i in columns), rows=[[row[i] for i in columns] for row in self.rows])

    def to_html(self) -> str:
        """A `table` element."""
        lines = [f'<table aria-label="{html.escape(self.title, quote=True)}">', "<thead><tr>"]
        is_text = [i < self.labels or any(isinstance(row[i], str | FileLink) for row in self.rows) for i in range(len(self.columns))]
        lines += [f'<th scope="col"{"" if text else NUMERIC}>{_heading(name)}</th>' for name, text in zip(self.columns, is_text)]
        lines.append("</tr></thead><tbody>")
        above: Sequence[Cell] | None = None
        for row in self.rows:
            cells = []
            same = 0 if above is None else next((i for i in range(self.labels) if row[i] != above[i]), self.labels)
            for i, cell in enumerate(row):
                text = self._html(i, cell)
                if i < self.labels:
                    cells.append(f'<th scope="row"{AGAIN if i < min(same, self.labels - 1) else ""}>{text}</th>')
                else:
                    cells.append(f"<td{'' if is_text[i] else NUMERIC}>{text}</td>")
            is_block = above is not None and self.labels > 2 and same < self.labels - 1
            lines.append(f"<tr{BLOCK if is_block else ''}>{''.join(cells)}</tr>")
            above = row
        lines.append("</tbody></table>")
        return "\n".join(lines)

    def to_csv(self) -> str:
        """All digits; an interval takes three columns."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        wide = [any(isinstance(row[i], Interval) for row in self.rows) for i in range(len(self.columns))]
        writer.writerow(name + end for name, is_wide in zip(self.columns, wide) for end in ("", " low", " high")[: 3 if is_wide else 1])
        for row in self.rows:
            line: list[str | int] = []
            for cell, is_wide in zip(row, wide):
                three = (cell.value, cell.low, cell.high) if isinstance(cell, Interval) else (cell, None, None)
                line += map(_exact, three[: 3 if is_wide else 1])
            writer.writerow(line)
        return out.getvalue()

    def to_markdown(self) -> str:
        """A table as GitHub and mkdocs read it, without its title."""
        rule = ["---" if i < self.labels else "---:" for i in range(len(self.columns))]
        rows = [[_markdown(name) for name in self.columns], rule]
        rows += [[_markdown(self.text(i, cell)) for i, cell in enumerate(row)] for row in self.rows]
        return "".join(f"| {' | '.join(row)} |\n" for row in rows)

    def to_latex(self) -> str:
        """A `table` with a `tabular` of booktabs' rules."""
        kinds = "l" * self.labels + "r" * (len(self.columns) - self.labels)
        lines = [
            r"% \usepackage{booktabs}",
            r"\begin{table}",
            r"  \centering",
            rf"  \caption{{{latex(self.title)}}}",
            rf"  \label{{tab:{self.name.replace('_', '-')}}}",
            rf"  \begin{{tabular}}{{{kinds}}}",
            r"    \toprule",
            "    " + " & ".join(latex(name) for name in self.columns) + r" \\",
            r"    \midrule",
        ]
        lines += ["    " + " & ".join(latex(self.text(i, cell)) for i, cell in enumerate(row)) + r" \\" for row in self.rows]
        return "\n".join([*lines, r"    \bottomrule", r"  \end{tabular}", r"\end{table}"]) + "\n"

    def text(self, column: int, cell: Cell) -> str:
        """A cell as people read it."""
        if isinstance(cell, Interval):
            ends = (cell.value, cell.low, cell.high)
            if not all(map(math.isfinite, ends)):
                return self._number(column, cell.value)
            digits = self.digits.get(self.columns[column], _decimals(cell.value))  # the value's for all three
            return "{} [{}, {}]".format(*(_short(end, digits) for end in ends))
        if isinstance(cell, FileLink):
            return cell.text
        return cell if isinstance(cell, str) else self._number(column, cell)

    def _number(self, column: int, cell: float | int | None) -> str:
        if cell is None or not math.isfinite(cell):
            return "–"
        if isinstance(cell, int):
            return str(cell)
        return _short(cell, self.digits.get(self.columns[column], _decimals(cell)))

    def _html(self, column: int, cell: Cell) -> str:
        if isinstance(cell, FileLink):
            return f'<a href="{html.escape(cell.target, quote=True)}">{html.escape(cell.text)}</a>'
        text = html.escape(self.text(column, cell))
        value, _, interval = text.partition(" [") if isinstance(cell, Interval) else (text, "", "")
        return f'{value} <span class="interval">[{interval}</span>' if interval else text


def table_of(name: str, title: str, rows: Sequence[Mapping[str, Cell]], note: str = "", **how: Any) -> ReportTable | None:
    """The table whose columns are the keys of its rows; None without rows."""
    return ReportTable(name, title, tuple(rows[0]), [tuple(row.values()) for row in rows], note, **how) if rows else None


LONG = 80  # rows
NUMERIC, AGAIN, BLOCK = ' class="number"', ' class="again"', ' class="block"'


def _heading(name: str) -> str:
    """A heading whose unit is not parted from its last word."""
    text, _, unit = name.rpartition(" ")
    return f"{html.escape(text)}&nbsp;{unit}" if text and unit in ("s", "ms", "m", "cm", "%") else html.escape(name)


def latex(text: str) -> str:
    """Text that LaTeX prints as it is."""
    return text.translate(_LATEX)


def _markdown(text: str) -> str:
    for c in "\\`*_[]<>|":
        text = text.replace(c, "\\" + c) if c not in "<>" else text.replace(c, "&lt;" if c == "<" else "&gt;")
    return " ".join(text.split())


def _decimals(value: float) -> int:
    """Digits after the point for three significant ones."""
    size = math.floor(math.log10(abs(value))) if value else 0
    return max(0, min(6, 2 - size))


def _short(value: float, digits: int) -> str:
    text = f"{value:.{digits}f}"
    text = text.lstrip("-") if float(text) == 0 else text
    return text.replace("-", "−")


def _exact(cell: str | float | int | FileLink | None) -> str | int:
    if isinstance(cell, float):
        return "" if not math.isfinite(cell) else str(int(cell)) if cell.is_integer() else repr(float(cell))
    return cell.text if isinstance(cell, FileLink) else "" if cell is None else cell
