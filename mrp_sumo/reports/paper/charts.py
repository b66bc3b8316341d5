"""Figure 5 of the MRP-Bench paper, planning time, for any runs; and execution time and time blocked as its analysis script draws them."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.reports.charts.chart import COLOURS, MAX_SERIES, Chart, draw, file_name, key, log_seconds, printable, series_style
from mrp_sumo.reports.paper.tables import commonly_solved, titled
from mrp_sumo.reports.pictures.map_picture import INK, PAPER
from mrp_sumo.reports.study import PLANNER_NAMES, ReportedRuns, numbers

if TYPE_CHECKING:
    from mrp_sumo.reports.paper.beside import BesidePaper


Values = list[tuple[str, FloatArray]]  # of series


def figure_5(study: ReportedRuns) -> list[Chart]:
    """Planning time by planner on each map, all numbers of robots together, as a box plot."""
    caption = (
        "Planning time of runs with a plan, valid or not, on a logarithmic axis. Line: median; box: middle half; whiskers: to the "
        "farthest within 1.5 boxes; dots: beyond."
    )
    charts: list[Chart] = []
    for name, runs in study.by_map() if study.is_planned else ():
        values = [(s, numbers(runs[(runs["_series"] == s) & runs["_planned"]], "planning_time_s")) for s in study.series]
        if values := [(s, v[v > 0]) for s, v in values if (v > 0).any()][:MAX_SERIES]:
            title = titled(study, "Figure 5", f"planning time{_where(study, name)}")
            charts.append(draw(f"figure_5_{len(charts) + 1}", title, caption, partial(_boxes, values), size=_size(values)))
    return charts


def execution_violins(study: ReportedRuns) -> list[Chart]:
    """Execution time and time blocked by planner, one violin per planner, as MRP-Bench's analysis script draws them."""
    charts: list[Chart] = []
    for name, runs in study.by_map() if study.is_executed else ():
        common, _ = commonly_solved(runs)
        arrived = common[common["_arrived"]]
        for column, what, of_all, more in (
            ("execution_time_s", "Execution time", "", ""),
            (
                "time_blocked_total_s",
                "Time blocked",
                " of all robots",
                " Blocked as MRP-Bench counts: without progress along the straight line to the goal, as on a detour.",
            ),
        ):
            values = [(s, numbers(arrived[arrived["_series"] == s], column)) for s in study.series]
            if values := [(s, v) for s, v in values if len(v) > 1][:MAX_SERIES]:
                caption = (
                    f"{what}{of_all}, in runs that every planner had a plan for and in which all robots arrived. Line: mean; "
                    f"box: middle half, its gap the median; the shape is the density.{more}"
                )
                paint = partial(_violins, values, f"{what.lower()} (s)")
                charts.append(draw(f"execution_{len(charts) + 1}", f"{what}{_where(study, name)}", caption, paint, size=_size(values)))
    return charts


def _where(study: ReportedRuns, name: str) -> str:
    return f", {name}" if len(study.maps) > 1 else ""


def _size(values: Values) -> tuple[float, float]:
    return (4.7, max(2.2, 0.9 + 0.42 * len(values)))


def _rows(ax: Axes, names: Sequence[str], label: str) -> None:
    """A row for each name, the first on top."""
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.set_xlabel(label)
    ax.grid(axis="y", visible=False)


def _boxes(values: Values, figure: Figure) -> None:
    ax = figure.add_subplot()
    for i, (_, v) in enumerate(values):
        colour = COLOURS[i % len(COLOURS)]
        ax.boxplot(
            [v],
            positions=[i],
            orientation="horizontal",
            widths=0.6,
            patch_artist=True,
            manage_ticks=False,
            boxprops={"facecolor": colour, "alpha": 0.35, "edgecolor": colour},
            medianprops={"color": INK, "lw": 1.6},
            whiskerprops={"color": colour},
            capprops={"color": colour},
            flierprops={"marker": ".", "ms": 4, "mfc": colour, "mec": "none"},
        )
    _rows(ax, [f"{printable(s)} ({len(v)})" for s, v in values], "planning time")
    ax.set_xscale("log")
    log_seconds(ax.xaxis)


def _violins(values: Values, label: str, figure: Figure) -> None:
    ax = figure.add_subplot()
    for i, (_, v) in enumerate(values):
        colour = COLOURS[i % len(COLOURS)]
        if np.ptp(v) > 0:
            drawn: Any = ax.violinplot([v], positions=[i], orientation="horizontal", widths=0.8, showextrema=False)
            (body,) = drawn["bodies"]
            body.set(facecolor=colour, alpha=0.35, edgecolor=colour)
        low, middle, high = np.quantile(v, (0.25, 0.5, 0.75))
        ax.plot([low, high], [i, i], color=colour, lw=5, solid_capstyle="butt")
        ax.plot([middle], [i], marker="|", color=PAPER, ms=5, mew=1.4)
        ax.plot([v.mean()] * 2, [i - 0.3, i + 0.3], color=INK, lw=1.6)
    _rows(ax, [f"{printable(s)} ({len(v)})" for s, v in values], label)
    ax.set_xlim(left=0)


def arrivals_chart(name: str, rows: "Sequence[BesidePaper]") -> Chart:
    """Table III on a map: shares of the experiments in which all robots arrive, by planner and way to drive, and the paper's."""
    together = [row for row in rows if " and " in row.labels["robots"]] or list(rows)
    planners = list(dict.fromkeys(row.labels["planner"] for row in together))
    ways = list(dict.fromkeys(row.labels["execution"] for row in together))

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        for k, policy in enumerate(ways):
            of = [row for row in together if row.labels["execution"] == policy]
            y = np.array([planners.index(row.labels["planner"]) for row in of]) + 0.2 * (k - (len(ways) - 1) / 2)
            value, low, high = (np.array([getattr(row.ours, end) for row in of]) for end in ("value", "low", "high"))
            style = series_style(k)
            ax.errorbar(value, y, xerr=(value - low, high - value), fmt=str(style["marker"]), color=style["color"], lw=1.4, label=policy)
        theirs = [(row.paper_value, planners.index(row.labels["planner"])) for row in together if row.paper_value is not None]
        if theirs:
            ax.plot(*zip(*theirs), marker="D", ls="none", mfc="none", mec=INK, ms=7, label="paper")
        _rows(ax, [PLANNER_NAMES.get(p, p) for p in planners], "all robots at their goals, % of experiments")
        key(figure, ax)

    caption = "Lines: 95 % intervals. Local yielding is what the paper's robots do."
    return draw(file_name("table_3", name), f"Table III, {name}", caption, paint, size=(4.7, 3.4))
