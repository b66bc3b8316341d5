"""The page of a report: one HTML file without scripts, which needs no network.

Everything from outside (names, reasons, paths) is text and is escaped here.
"""

import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

from mrp_sumo.reports.charts.chart import Chart
from mrp_sumo.reports.tables.table import ReportTable

GENERATOR = "mrp-sumo report"
STYLE_SHEET = Path(__file__).with_name("page.css")


@dataclass(frozen=True)
class Tile:
    """A number at the top of the page."""

    label: str
    value: str
    detail: str = ""
    mood: str = ""  # 'good', 'bad' or neither


@dataclass
class Section:
    """A part of the page with its own heading."""

    name: str  # of its place in the page
    title: str
    text: str = ""
    parts: list[ReportTable | Chart] = field(default_factory=list)
    is_folded: bool = False  # opens at a click, by its link at the top, and on paper


def page(
    title: str,
    lead: str,
    tiles: Sequence[Tile],
    gaps: Sequence[str],
    sections: Sequence[Section],
    about: Sequence[str],
    answer: str = "",
) -> str:
    """The whole page: tiles have numbers, `gaps` say what is missing, `answer` what it comes to; sections without parts are left out."""
    sections = [s for s in sections if s.parts or s.text]
    lines = [
        f"<header><h1>{html.escape(title)}</h1>",
        f'<p class="lead">{html.escape(lead)}</p>' if lead else "",
        f'<p class="answer">{html.escape(answer)}</p>' if answer else "",
        "</header>",
        '<nav aria-label="Sections"><ul>',
        *(f'<li><a href="#{s.name}">{html.escape(s.title)}</a></li>' for s in sections),
        "</ul></nav>",
        "<main>",
        tile_list(tiles),
        gap_list(gaps),
    ]
    for section in sections:
        name, heading = section.name, html.escape(section.title)
        head, end = f'<section aria-labelledby="{name}">\n<h2 id="{name}">{heading}</h2>', "</section>"
        if section.is_folded:  # a link to what is inside opens it
            head = f'<section class="folded" aria-label="{heading}">\n<details><summary><h2>{heading}</h2></summary>\n<div id="{name}">'
            end = "</div></details>\n</section>"
        text = f'<p class="lead">{html.escape(section.text)}</p>' if section.text else ""
        lines += [head, text, *_parts(section.parts), end]
    lines += ["</main>", f"<footer>{''.join(f'<p>{html.escape(line)}</p>' for line in about)}</footer>"]
    return document(title, GENERATOR, lines)


def document(title: str, generator: str, body: Sequence[str], *style_sheets: Path) -> str:
    """A page that stands alone, without scripts and network."""
    style = "".join(path.read_text(encoding="utf-8") for path in (STYLE_SHEET, *style_sheets))
    lines = [
        "<!DOCTYPE html>",
        '<html lang="en">',
        "<head>",
        '<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f'<meta name="generator" content="{generator}">',
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; img-src data:\">",
        f"<title>{html.escape(title)}</title>",
        f"<style>\n{style}</style>",
        "</head>",
        "<body>",
        *body,
        "</body>\n</html>\n",
    ]
    return "\n".join(line for line in lines if line)


def tile_list(tiles: Sequence[Tile]) -> str:
    """Numbers at the top as HTML; '' where there are none."""
    cells = []
    for tile in tiles:
        detail = f" <small>{html.escape(tile.detail)}</small>" if tile.detail else ""
        value = html.escape(tile.value).replace("_", "_<wbr>")  # where long names may break
        mood = f' class="{tile.mood}"' if tile.mood else ""
        cells.append(f"<div{mood}><dt>{html.escape(tile.label)}</dt><dd>{value}{detail}</dd></div>")
    return f'<dl class="tiles">{"".join(cells)}</dl>' if cells else ""


def gap_list(gaps: Sequence[str]) -> str:
    """Notes on what is missing as HTML; '' where there are none."""
    return '<ul class="gaps">' + "".join(f"<li>{html.escape(line)}</li>" for line in gaps) + "</ul>" if gaps else ""


def grid(head: Sequence[str], rows: str, numbers: Sequence[int]) -> str:
    """A plain table that scrolls, of a head and of rows that are HTML."""
    above = rows_of([head], numbers, "th")
    return f'<div class="scroll"><table class="help"><thead>{above}</thead><tbody>{rows}</tbody></table></div>'


def rows_of(rows: Sequence[Sequence[str]], numbers: Sequence[int] = (), tag: str = "td") -> str:
    """Rows of a plain table, whose cells are HTML; the first cell is a heading, unless it is one of the columns of numbers."""

    def cell(k: int, text: str) -> str:
        name = "th" if k == 0 and k not in numbers else tag
        return f"<{name}{' class=number' if k in numbers else ''}>{text}</{name}>"

    return "".join(f"<tr>{''.join(cell(k, text) for k, text in enumerate(row))}</tr>" for row in rows)


def chart_row(charts: Sequence[Chart], *, files: bool = False) -> list[str]:
    """Charts side by side as HTML, with links to their files."""
    return ['<div class="charts">', *(_chart(chart, files=files) for chart in charts), "</div>"]


def _parts(parts: Sequence[ReportTable | Chart]) -> list[str]:
    """Consecutive charts stand side by side."""
    lines: list[str] = []
    for _, some in groupby(parts, type):
        group = list(some)
        charts = [part for part in group if isinstance(part, Chart)]
        lines += chart_row(charts, files=True) if charts else [_table(part) for part in group if isinstance(part, ReportTable)]
    return lines


def _chart(chart: Chart, *, files: bool) -> str:
    links = " ".join(f'<a href="figures/{chart.name}.{kind}">{kind.upper()}</a>' for kind in ("svg", "png"))
    shown = f' <span class="files">{links}</span>' if files else ""
    return (
        f'<figure{" class=wide" if chart.wide else ""}>\n<h3 id="{chart.name}-title">{html.escape(chart.title)}</h3>\n'
        f'<div class="scroll">{chart.on_page()}</div>\n'
        f"<figcaption>{html.escape(chart.caption)}{shown}</figcaption>\n</figure>"
    )


def _table(table: ReportTable) -> str:
    files = " ".join(
        f'<a href="tables/{table.name}.{kind}">{name}</a>' for kind, name in (("csv", "CSV"), ("md", "Markdown"), ("tex", "LaTeX"))
    )
    head = f"<h3>{html.escape(table.title)}</h3>\n"
    note = f'<p class="note">{html.escape(table.note)} <span class="files">{files}</span></p>'
    body = f'<div class="scroll" tabindex="0">{table.to_html()}</div>\n{note}'
    return f"<details><summary>{html.escape(table.title)}</summary>\n{body}</details>" if table.is_folded else head + body
