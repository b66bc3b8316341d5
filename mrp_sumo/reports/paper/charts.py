"""Figure 5 of the MRP-Bench paper, planning time, for any runs; and execution time and time blocked as its analysis script draws them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.reports.charts.chart import COLOURS, MAX_SERIES, Chart, draw, file_name, key, log_seconds, printable, series_style
from mrp_sumo.reports.paper.tables import commonly_solved, titled
from mrp_sumo.reports.pictures.map_picture import INK, PAPER
from mrp_sumo.reports.study import PLANNER_NAMES, ReportedRuns, numbers

if TYPE_CHECKING:
    from mrp_sumo.reports.paper.beside import BesidePaper


def figure_5(study: ReportedRuns) -> list[Chart]:
    """Planning time by planner on each map, all numbers of robots together, as a box plot."""
    if not study.is_planned:
        return []
    charts: list[Chart] = []
    for name, runs in study.by_map():
        values = [(s, numbers(runs[(runs["_series"] == s) & runs["_planned"]], "planning_time_s")) for s in study.series]
        values = [(s, v[v > 0]) for s, v in values if (v > 0).any()][:MAX_SERIES]
        if not values:
            continue

        def paint(figure: Figure, values: list[tuple[str, FloatArray]] = values) -> None:
            _boxes(figure, values)

        caption = (
            "Planning time of runs with a plan, valid or not, on a logarithmic axis. Line: median; box: middle half; whiskers: to the "
            "farthest within 1.5 boxes; dots: beyond."
        )
        where = f", {name}" if len(study.maps) > 1 else ""
        title = titled(study, "Figure 5", f"planning time{where}")
        charts.append(draw(f"figure_5_{len(charts) + 1}", title, caption, paint, size=_size(values)))
    return charts


def execution_violins(study: ReportedRuns) -> list[Chart]:
    """Execution time and time blocked by planner, one violin per planner, as MRP-Bench's analysis script draws them."""
    if not study.is_executed:
        return []
    charts: list[Chart] = []
    for name, runs in study.by_map():
        common, _ = commonly_solved(runs)
        arrived = common[common["_arrived"]]
        for column, what in (("execution_time_s", "execution time"), ("time_blocked_total_s", "time blocked")):
            values = [(s, numbers(arrived[arrived["_series"] == s], column)) for s in study.series]
            values = [(s, v) for s, v in values if len(v) > 1][:MAX_SERIES]
            if not values:
                continue

            def paint(figure: Figure, values: list[tuple[str, FloatArray]] = values, what: str = what) -> None:
                _violins(figure, values, f"{what} (s)")

            caption = (
                f"{what.capitalize()}{' of all robots' if what == 'time blocked' else ''}, in runs that every planner had a plan for "
                "and in which all robots arrived. Line: mean; box: middle half, its gap the median; the shape is the density."
            )
            if what == "time blocked":
                caption += " Blocked as MRP-Bench counts: without progress along the straight line to the goal, as on a detour."
            where = f", {name}" if len(study.maps) > 1 else ""
            charts.append(draw(f"execution_{len(charts) + 1}", f"{what.capitalize()}{where}", caption, paint, size=_size(values)))
    return charts


def _size(values: list[tuple[str, FloatArray]]) -> tuple[float, float]:
    return (4.7, max(2.2, 0.9 + 0.42 * len(values)))


def _boxes(figure: Figure, values: list[tuple[str, FloatArray]]) -> None:
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
    ax.set_yticks(range(len(values)), [f"{printable(s)} ({len(v)})" for s, v in values])
    ax.invert_yaxis()
    ax.set_xscale("log")
    log_seconds(ax.xaxis)
    ax.set_xlabel("planning time")
    ax.grid(axis="y", visible=False)


def _violins(figure: Figure, values: list[tuple[str, FloatArray]], label: str) -> None:
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
    ax.set_yticks(range(len(values)), [f"{printable(s)} ({len(v)})" for s, v in values])
    ax.invert_yaxis()
    ax.set_xlim(left=0)
    ax.set_xlabel(label)
    ax.grid(axis="y", visible=False)


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
        ax.set_yticks(range(len(planners)), [PLANNER_NAMES.get(p, p) for p in planners])
        ax.invert_yaxis()
        ax.set_xlabel("all robots at their goals, % of experiments")
        ax.grid(axis="y", visible=False)
        key(figure, ax)

    caption = "Lines: 95 % intervals. Local yielding is what the paper's robots do."
    return draw(file_name("table_3", name), f"Table III, {name}", caption, paint, size=(4.7, 3.4))
