"""Charts: drawn with matplotlib's objects, as SVG and PNG files, and as SVG inside a page whose colours they follow.

The same data give the same bytes. Lines and marks differ in shape as well as colour; the colours are those of Okabe and
Ito, which people with any colour vision can tell apart. Names of maps, planners and robots are text: neither markup nor formulas.
"""

import io
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.reports.pictures.map_picture import BLUE, GREEN, INK, MUTED, ORANGE, PAPER, PURPLE, SKY, VERMILION

GRID, SOFT = "#d9dce1", "#eceef1"
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, INK)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
LINES = ("-", (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (5, 1.4, 1.2, 1.4)))
MAX_SERIES = 12  # in one chart
MANY_POINTS = 1500  # in one chart, beyond which marks are pixels inside the SVG

ON_PAGE = {  # colour in the file -> CSS variable on the page, which has another value in the dark
    INK: "--ink",
    MUTED: "--muted",
    PAPER: "--paper",
    GRID: "--grid",
    SOFT: "--soft",
    BLUE: "--blue",
    VERMILION: "--vermilion",
    GREEN: "--green",
    PURPLE: "--purple",
    ORANGE: "--orange",
    SKY: "--sky",
}
STYLE: Any = {
    "axes.axisbelow": True,
    "axes.edgecolor": MUTED,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.labelsize": 9,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 9.5,
    "axes.unicode_minus": True,
    "figure.facecolor": PAPER,
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.7,
    "lines.markersize": 5,
    "svg.fonttype": "none",
    "svg.hashsalt": "mrp_sumo",
    "text.color": INK,
    "text.parse_math": False,
    "xtick.color": MUTED,
    "xtick.labelcolor": INK,
    "xtick.labelsize": 8.5,
    "ytick.color": MUTED,
    "ytick.labelcolor": INK,
    "ytick.labelsize": 8.5,
}
NARROW = (4.7, 3.15)  # inches: two side by side on a desk, one readable on a phone
LEAST_S = 0.5
PNG_DPI = 180
DOTS_DPI = 100  # of what is pixels inside an SVG
PAD_INCH = 0.042  # around labels


@dataclass(frozen=True)
class Chart:
    """A drawn chart."""

    name: str  # of its files
    title: str
    caption: str  # what is shown and how to read it, one or two sentences
    svg: bytes
    png: bytes
    wide: bool = False  # takes the whole width of the page

    def on_page(self) -> str:
        """The SVG as an element of an HTML page: no prolog, names of its own, colours of the page."""
        text = self.svg.decode()
        text = text[text.index("<svg") :]
        text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
        text = re.sub(r'\bid="([^"]+)"', rf'id="{self.name}-\1"', text)
        text = re.sub(r'href="#([^"]+)"', rf'href="#{self.name}-\1"', text)
        text = re.sub(r"url\(#([^)]+)\)", rf"url(#{self.name}-\1)", text)
        for colour, variable in ON_PAGE.items():
            text = re.sub(rf"(?<=: ){colour}\b", f"var({variable})", text, flags=re.IGNORECASE)
        opening = text[: text.index(">") + 1]
        width = float(re.search(r'width="([\d.]+)pt"', opening)[1]) * 96 / 72  # type: ignore[index]
        view = re.search(r'viewBox="[^"]+"', opening)[0]  # type: ignore[index]
        bound = "" if self.wide else f' style="max-width:{width:.0f}px"'
        new = f'<svg {view} role="img" aria-labelledby="{self.name}-title"{bound}>'
        return new + text[len(opening) :]


def draw(
    name: str,
    title: str,
    caption: str,
    paint: Callable[[Figure], None],
    *,
    size: tuple[float, float] = NARROW,
    wide: bool = False,
) -> Chart:
    """Draw a chart: `paint` draws on an empty figure of a size in inches; a wide one takes the whole width of the page."""
    svg, png = io.BytesIO(), io.BytesIO()
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing")  # a name in a script that the font lacks
        figure = Figure(figsize=size, dpi=PNG_DPI)
        canvas = FigureCanvasAgg(figure)
        paint(figure)
        if figure.get_layout_engine() is None:
            _fit(figure, canvas.get_renderer())
        # not `savefig`, which draws twice, first to lay it out
        fast = {"compress_level": 2}  # a tenth larger, in two thirds of the time
        canvas.print_png(png, metadata={"Software": None}, pil_kwargs=fast)
        figure.set_layout_engine("none")  # its result stays
        figure.dpi = DOTS_DPI
        FigureCanvasSVG(figure).print_svg(svg, metadata={"Date": None, "Creator": None})
    return Chart(name, title, caption, svg.getvalue(), png.getvalue(), wide)


def _fit(figure: Figure, renderer: RendererAgg) -> None:
    """Fit axes that stand one above the other, and the legend below them, into the figure.

    Labels are measured once and stay where they are; matplotlib's constrained layout measures all of them twice, and again
    in every drawing.
    """
    axes, pad = figure.axes, PAD_INCH * figure.dpi
    width, height = figure.bbox.size
    below = sum(legend.get_window_extent(renderer).height + 3 * pad for legend in figure.legends)
    # first a guess, so close that the axes keep their ticks
    figure.subplots_adjust(0.18, (below + 0.45 * figure.dpi) / height, 0.97, 0.97, 0.0)
    room = [ax.get_position(original=True).transformed(figure.transFigure) for ax in axes]
    needed = [ax.get_tightbbox(renderer, for_layout_only=True) or box for ax, box in zip(axes, room)]  # None: nothing is drawn
    away = [
        (ax.xaxis.label.get_position()[1] - ax.bbox.y0, ax.yaxis.label.get_position()[0] - ax.bbox.x0) for ax in axes
    ]  # px, of the labels
    left = pad + max(max(box.x0 - inked.x0, 0) for box, inked in zip(room, needed))
    right = pad + max(max(inked.x1 - box.x1, 0) for box, inked in zip(room, needed))
    under = [pad + max(box.y0 - inked.y0, 0) for box, inked in zip(room, needed)]
    over = [pad + max(inked.y1 - box.y1, 0) for box, inked in zip(room, needed)]
    gap = max((a + b for a, b in zip(under, over[1:])), default=0.0)
    tall = (height - below - under[-1] - over[0] - gap * (len(axes) - 1)) / len(axes)
    figure.subplots_adjust(left / width, (below + under[-1]) / height, 1 - right / width, 1 - over[0] / height, hspace=gap / max(tall, 1))
    for ax, (x_label, y_label) in zip(axes, away):
        ax.apply_aspect()
        ax.xaxis.set_label_coords(0.5, x_label / ax.bbox.height)
        ax.yaxis.set_label_coords(y_label / ax.bbox.width, 0.5)


def series_style(i: int) -> dict[str, object]:
    """Colour, mark and line of the i-th series."""
    return {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)], "linestyle": LINES[i % len(LINES)]}


def printable(name: str, limit: int = 34) -> str:
    """A name that can be drawn: printable, of bounded length, and not mistaken for one that legends leave out."""
    text = "".join(c if c.isprintable() else "�" for c in name)
    text = text if len(text) <= limit else text[: limit - 1] + "…"
    return "\u2009" + text if text.startswith("_") else text


def key(figure: Figure, ax: Axes) -> None:
    """The legend, below the chart."""
    handles, labels = ax.get_legend_handles_labels()
    if len(labels) < 2 and not (labels and figure.axes.index(ax) > 0):
        return
    columns = key_columns(labels, figure.get_figwidth())
    figure.legend(handles, labels, loc="outside lower left", ncols=columns, handlelength=2.6, columnspacing=1.4)


def key_columns(labels: Sequence[str], width_in: float) -> int:
    """Number of columns of labels in the legend of a chart of a width."""
    longest_pt = max(map(len, labels), default=1) * 5.0 + 34
    return max(1, min(len(labels), int(width_in * 72 / longest_pt)))


def spread(count: int, most: int) -> IntArray:
    """At most so many of the numbers below `count`, evenly, first and last included."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


def distribution(figure: Figure, values: FloatArray, unit: str, second_colour: str = INK) -> Axes:
    """Axes with a histogram of [N] values, their median and what 95 % of them are below, and the legend."""
    ax = figure.add_subplot()
    counts, edges = np.histogram(values, bins=min(40, max(8, len(values) // 12)))
    ax.stairs(counts, edges, fill=True, color=BLUE, alpha=0.85)
    for q, name, line, colour in ((0.5, "median", (0, (5, 2)), INK), (0.95, "95 % are below", (0, (1.5, 1.5)), second_colour)):
        value = float(np.quantile(values, q))
        ax.axvline(value, color=colour, lw=1.3, ls=line, label=f"{name}: {unit.format(value)}")
    key(figure, ax)
    return ax


def around_zero(low: float, high: float) -> tuple[float, float]:
    """Limits of an axis of seconds with zero on it and half a second on both sides, so that rounding errors are not drawn large."""
    return min(low, -LEAST_S), max(high, LEAST_S)


def log_seconds(axis: Axis) -> None:
    """A logarithmic axis of seconds, in words."""

    def in_words(value: float, _: object) -> str:
        for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
            if value >= size * 0.999 or unit == "µs":
                return f"{value / size:g} {unit}"
        return ""

    axis.set_major_formatter(FuncFormatter(in_words))
    axis.set_minor_locator(LogLocator(subs=(2, 5)))
    axis.set_minor_formatter(NullFormatter())


def file_name(*parts: object) -> str:
    """A file name made of other names."""
    return re.sub(r"_+", "_", "_".join(re.sub(r"[^a-z0-9]+", "_", str(part).lower()) for part in parts)).strip("_") or "chart"
