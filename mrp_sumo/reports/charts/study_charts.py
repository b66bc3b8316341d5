"""The charts of many runs: success, planning time, cost, execution, clearance, by map, with one line or row per series.

At most twelve series are drawn; the tables hold all.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.experiments.statistics import wilson
from mrp_sumo.reports.charts.chart import (
    COLOURS,
    MANY_POINTS,
    MAX_SERIES,
    NARROW,
    Chart,
    around_zero,
    draw,
    file_name,
    key,
    key_columns,
    log_seconds,
    printable,
    series_style,
)
from mrp_sumo.reports.pictures.map_picture import INK, MUTED, PAPER
from mrp_sumo.reports.study import ReportedRuns, floats, numbers

OVER_RUNS = "Median over runs, with the middle half of them."
COUNTED = "Numbers of runs in brackets."
LATENESS = ("lateness", "Lateness", "mean lateness (s)"), "Median over runs of their mean lateness, with the middle half of them."
OF_TASKS = (  # metric, title, axis
    ("throughput_per_h", "Throughput", "orders done an hour"),
    ("lead_time_p95_s", "Lead time of orders", "release to done, 95 % below (s)"),
    ("tasks_open", "Orders not done at the end", "orders"),
)
OF_RUNS = "Box: middle half of the runs, line: median, whiskers: 5 to 95 %."
ROW_FILLED = 0.8  # of the height of a row, by the tallest bar
LEAST_PLANNING_S = 1e-6  # that is drawn on a logarithmic axis

Curve = tuple[str, FloatArray, FloatArray, FloatArray, FloatArray]  # series, x, y, low, high


@dataclass(frozen=True)
class Drawn:
    """Runs that are drawn together: those of a map, or all."""

    runs: pd.DataFrame
    series: tuple[str, ...]  # with runs here, at most MAX_SERIES
    tag: str  # in names of files
    where: str  # at the ends of titles
    outcome: str  # column that says whether a run did what was asked of it

    def of(self, series: str) -> pd.DataFrame:
        return self.runs[self.runs["_series"] == series]

    def values(self, column: str, scale: float = 1.0) -> list[tuple[str, FloatArray]]:
        """The series with values of a column; none where there are fewer than two values in all."""
        values = [(s, scale * numbers(self.of(s), column)) for s in self.series] if column in self.runs else []
        values = [(s, v) for s, v in values if len(v)]
        return values if sum(len(v) for _, v in values) > 1 else []


def study_charts(study: ReportedRuns) -> dict[str, list[Chart]]:
    """Charts by the section they belong to: 'success', 'planning', 'cost', 'execution', 'tasks'."""
    by_section: dict[str, list[Chart | None]] = {"success": [], "planning": [], "cost": [], "execution": [], "tasks": []}
    if not study.is_planned:
        return {}
    for i, (name, runs) in enumerate(study.by_map(), 1):
        here = tuple(s for s in study.series[:MAX_SERIES] if (runs["_series"] == s).any())
        drawn = Drawn(runs, here, file_name(i, name)[:40], f", {printable(name)}" if len(study.maps) > 1 else "", study.outcome)
        factors = [x for x in ("_robots", *study.factors) if runs[x].nunique() > 1]
        for x in factors:
            by_section["tasks"] += [_against(drawn, x, names[0], names, OVER_RUNS, lambda ax: ax.set_ylim(bottom=0)) for names in OF_TASKS]
            by_section["success"].append(_success(drawn, x))
            by_section["planning"].append(_planning_time(drawn, x))
            if study.is_executed and x != "_robots":
                by_section["execution"].append(_against(drawn, x, "lateness_mean_s", *LATENESS, _about_zero))
        if not factors and len(runs) > 1:
            by_section["success"].append(_success_rows(drawn))
        boxes = [(drawn.values(names[0]), names) for names in OF_TASKS]
        by_section["tasks"] += [_boxes(drawn, *of, f"{OF_RUNS} {COUNTED}", lambda ax: ax.set_xlim(0, None)) for of in boxes]
        by_section["planning"].append(_cactus(drawn))
        by_section["cost"].append(_suboptimality(drawn))
        if study.is_executed:
            by_section["cost"].append(_driven_planned(drawn))
            by_section["execution"] += [_lateness(drawn), _clearance(drawn)]
    return {section: [c for c in charts if c is not None] for section, charts in by_section.items()}


def _success(drawn: Drawn, x: str) -> Chart:
    def rate_of(group: pd.DataFrame) -> FloatArray:
        rate = wilson(int(group[drawn.outcome].sum()), len(group))
        return 100 * np.array([rate.value, rate.low, rate.high])

    curves = _curves(drawn, x, rate_of)
    what = "all robots reach their goals on a valid plan" if drawn.outcome == "_succeeded" else "a valid plan is found"

    def paint(figure: Figure) -> None:
        _curves_against(figure, curves, x, "success (%)").set_ylim(-3, 103)

    title = f"Success against {_factor(x)}{drawn.where}"
    caption = f"Share of all runs in which {what} within the time limit, with 95 % Wilson intervals."
    return draw(f"success_{file_name(x)}_{drawn.tag}", title, caption, paint, size=_with_key(drawn.series))


def _success_rows(drawn: Drawn) -> Chart:
    executed = drawn.outcome == "_succeeded"

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        for i, s in enumerate(drawn.series):
            of, colour = drawn.of(s), COLOURS[i % len(COLOURS)]
            for dy, column, face in ((-0.13, "_valid", PAPER), (0.13, drawn.outcome, None))[0 if executed else 1 :]:
                rate = wilson(int(of[column].sum()), len(of))
                ax.plot([100 * rate.low, 100 * rate.high], [i + dy] * 2, color=colour, lw=2.2, solid_capstyle="round")
                ax.plot([100 * rate.value], [i + dy], color=colour, marker="o", ms=6, mfc=face or colour, mew=1.5, clip_on=False)
        _rows(ax, drawn.series)
        ax.set(xlim=(-2, 102), xlabel="success (%)")

    caption = "Share of all runs that succeed, with 95 % Wilson intervals." + (
        " Hollow: a valid plan was found; filled: all robots then reached their goals." * executed
    )
    return draw(f"success_{drawn.tag}", f"Success{drawn.where}", caption, paint, size=_with_rows(drawn.series))


def _planning_time(drawn: Drawn, x: str) -> Chart | None:
    took_s = pd.to_numeric(drawn.runs["planning_time_s"]).clip(lower=LEAST_PLANNING_S)
    valid = replace(drawn, runs=drawn.runs.assign(planning_time_s=took_s)[drawn.runs["_valid"]])
    caption = (
        "Median planning time of runs with a valid plan, with the middle half of them. Compiled code is loaded before the clock starts."
    )

    def in_words(ax: Axes) -> None:
        ax.set_yscale("log")
        log_seconds(ax.yaxis)

    return _against(valid, x, "planning_time_s", ("planning_time", "Planning time", "planning time"), caption, in_words)


def _about_zero(ax: Axes) -> None:
    ax.set_ylim(around_zero(*ax.get_ylim()))


def _against(drawn: Drawn, x: str, column: str, names: tuple[str, str, str], caption: str, limit: Callable[[Axes], object]) -> Chart | None:
    """Medians of a column over a factor; `names` are those of the file, the title and the axis, to which `limit` gives its limits."""

    def quartiles_of(group: pd.DataFrame) -> FloatArray | None:
        there = numbers(group, column)
        return np.quantile(there, (0.5, 0.25, 0.75)) if len(there) else None

    curves = _curves(drawn, x, quartiles_of) if column in drawn.runs else []
    if not curves:
        return None
    file, title, label = names

    def paint(figure: Figure) -> None:
        limit(_curves_against(figure, curves, x, label))

    name = f"{file}_{file_name(x)}_{drawn.tag}"
    return draw(name, f"{title} against {_factor(x)}{drawn.where}", caption, paint, size=_with_key(drawn.series))


def _cactus(drawn: Drawn) -> Chart | None:
    lines = [(s, np.sort(numbers(of[of["_valid"]], "planning_time_s"))) for s in drawn.series for of in [drawn.of(s)]]
    if not any(len(t) > 1 for _, t in lines):
        return None

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        for i, (s, time) in enumerate(lines):
            if not len(time):
                continue
            style = series_style(i) | {"marker": None}
            count = np.arange(1, len(time) + 1)
            few = np.unique(np.linspace(0, len(time) - 1, min(len(time), 400)).astype(int))
            ax.plot(count[few], np.maximum(time[few], LEAST_PLANNING_S), label=printable(s), **style)  # type: ignore[arg-type]
            ax.plot(count[-1:], np.maximum(time[-1:], LEAST_PLANNING_S), color=style["color"], marker=series_style(i)["marker"])
        ax.set(xlabel="runs solved", ylabel="planning time", yscale="log", xlim=(0, None))
        log_seconds(ax.yaxis)
        key(figure, ax)

    caption = (
        "Runs that are solved by a valid plan when each may take the time on the left. Farther right and lower is better; marks are ends."
    )
    return draw(f"cactus_{drawn.tag}", f"Runs solved within a time{drawn.where}", caption, paint, size=_with_key(drawn.series))


def _suboptimality(drawn: Drawn) -> Chart | None:
    bound, cost = (floats(drawn.runs, column) for column in ("lower_bound_steps", "soc_steps"))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where((bound > 0) & drawn.runs["_valid"].to_numpy(np.bool_), cost / bound, np.nan)
    caption = (
        "Sum of costs of valid plans over the lower bound that the planner itself proved; 1 is optimal. Box: middle half, line: median, "
        f"whiskers: 5 to 95 %. {COUNTED}"
    )

    def limit(ax: Axes) -> None:
        high = max(ax.get_xlim()[1], 1.01)
        ax.set_xlim(1 - 0.04 * (high - 1), high)

    values = replace(drawn, runs=drawn.runs.assign(_ratio=ratio)).values("_ratio")
    return _boxes(drawn, values, ("suboptimality", "Cost over lower bound", "cost / lower bound"), caption, limit)


def _boxes(
    drawn: Drawn, values: list[tuple[str, FloatArray]], names: tuple[str, str, str], caption: str, limit: Callable[[Axes], object]
) -> Chart | None:
    """A row with a box for each series; the names are those of `_against`."""
    if not values:
        return None

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        for i, (_, v) in enumerate(values):
            _box(ax, i, v, COLOURS[i % len(COLOURS)], True, 0.5)
        _rows(ax, [f"{printable(s, 26)} ({len(v)})" for s, v in values])
        ax.set_xlabel(names[2])
        limit(ax)

    return draw(f"{names[0]}_{drawn.tag}", f"{names[1]}{drawn.where}", caption, paint, size=_with_rows(values))


def _driven_planned(drawn: Drawn) -> Chart | None:
    runs = drawn.runs
    done = runs[runs["_succeeded"] & runs["driven_makespan_s"].notna() & runs["makespan_s"].notna()]
    if len(done) < 2:
        return None

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        top = 0.0
        for i, s in enumerate(drawn.series):
            of = done[done["_series"] == s]
            if len(of):
                x, y = numbers(of, "makespan_s"), numbers(of, "driven_makespan_s")
                top = max(top, float(x.max()), float(y.max()))
                style = series_style(i)
                ax.plot(
                    x, y, ls="", marker=style["marker"], color=style["color"], ms=4, alpha=0.55, mew=0, label=printable(s),
                    rasterized=len(done) > MANY_POINTS,
                )  # fmt: skip
        ax.plot([0, top], [0, top], color=MUTED, lw=1, ls=(0, (4, 3)), zorder=1)
        ax.set(xlim=(0, top * 1.04), ylim=(0, top * 1.04), xlabel="planned makespan (s)", ylabel="driven makespan (s)")
        key(figure, ax)

    caption = (
        "Runs that succeeded. On the dashed line what was driven is what was planned; above it robots were late, below it early, as "
        "with plans that stay in steps, which allow every step a quarter turn."
    )
    title = f"Driven against planned makespan{drawn.where}"
    return draw(f"driven_planned_{drawn.tag}", title, caption, paint, size=_with_key(drawn.series))


def _lateness(drawn: Drawn) -> Chart | None:
    largest = drawn.values("lateness_max_s")
    if not largest:
        return None

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        for i, (s, v) in enumerate(largest):
            _box(ax, i - 0.17, numbers(drawn.of(s), "lateness_mean_s"), COLOURS[i % len(COLOURS)], True)
            _box(ax, i + 0.17, v, COLOURS[i % len(COLOURS)], False)
        ax.axvline(0, color=MUTED, lw=1, ls=(0, (4, 3)), zorder=1)
        _rows(ax, [f"{printable(s, 26)} ({len(numbers(drawn.of(s), 'lateness_mean_s'))})" for s, _ in largest])
        ax.set(xlabel="lateness (s)", xlim=around_zero(*ax.get_xlim()))

    caption = (
        f"Time at which vertices are reached minus planned time; negative is early. Filled: mean of a run; hollow: its largest. {OF_RUNS}"
    )
    return draw(f"lateness_{drawn.tag}", f"Lateness{drawn.where}", caption, paint, size=_with_rows(largest, 0.44))


def _clearance(drawn: Drawn) -> Chart | None:
    values = drawn.values("min_clearance_m", 100)
    if not values:
        return None
    together = np.concatenate([v for _, v in values])
    top = max(float(np.quantile(together, 0.9)), 1.0)
    bins = np.linspace(0, top, 25)

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()  # one for all series: axes take longest to draw
        floor = np.arange(len(values))[::-1] * 1.0
        for i, (_, v) in enumerate(values):
            counts, _ = np.histogram(np.minimum(v, top), bins)
            tall = floor[i] + ROW_FILLED * counts / counts.max()
            ax.stairs(tall, bins, baseline=floor[i], fill=True, color=COLOURS[i % len(COLOURS)], alpha=0.85)
            if (v <= 0).any():
                words, above = f"{int((v <= 0).sum())} with overlap", floor[i] + ROW_FILLED
                ax.annotate(words, (0, above), xytext=(12, -1), textcoords="offset points", fontsize=8, color=INK, va="top")
        ax.hlines(floor[:-1], 0, top, color=MUTED, lw=0.8)
        ax.set_yticks(floor + ROW_FILLED / 2, [printable(s, 22) for s, _ in values])
        ax.tick_params(axis="y", length=0)
        ax.grid(axis="y", visible=False)
        ax.spines["left"].set_visible(False)
        ax.set(xlim=(0, top), ylim=(0, len(values)), xlabel="least clearance of two robots in a run (cm)")

    caption = "Runs by the least distance between two footprints; 0 is an overlap. The last bin holds all that is farther."
    return draw(f"clearance_{drawn.tag}", f"Clearance{drawn.where}", caption, paint, size=(NARROW[0], max(2.3, 0.9 + 0.42 * len(values))))


def _curves(drawn: Drawn, x: str, point: Callable[[pd.DataFrame], FloatArray | None]) -> list[Curve]:
    """A curve for each series over x, where `point` has [3] y, low and high of runs."""
    curves: list[Curve] = []
    for s in drawn.series:
        points = [(float(value), *y) for value, group in drawn.of(s).groupby(x) if (y := point(group)) is not None]
        if points:
            curves.append((s, *map(np.array, zip(*points))))  # type: ignore[arg-type]
    return curves


def _curves_against(figure: Figure, curves: Sequence[Curve], x: str, label: str) -> Axes:
    """Axes with curves over a factor, their intervals side by side where they share an x, and the legend below."""
    ax = figure.add_subplot()
    places = np.unique(np.concatenate([c[1] for c in curves])) if curves else np.zeros(0)
    step = float(np.diff(places).min()) if len(places) > 1 else 1.0
    spread = min(0.5, 0.06 * len(curves)) * step
    for i, (s, values, y, low, high) in enumerate(curves):
        at = values + (i - (len(curves) - 1) / 2) * spread / max(1, len(curves) - 1)
        style = series_style(i)
        ax.vlines(at, low, high, color=style["color"], lw=1.2, alpha=0.6)
        ax.plot(at, y, label=printable(s), clip_on=False, **style)  # type: ignore[arg-type]
    if len(places) <= 10:
        ax.set_xticks(places, [f"{p:g}" for p in places])
    ax.set(xlabel=_factor(x), ylabel=label)
    key(figure, ax)
    return ax


def _box(ax: Axes, at: float, values: FloatArray, colour: str, filled: bool, height: float = 0.26) -> None:
    """A horizontal box plot: middle half, median, 5 to 95 %."""
    if not len(values):
        return
    low, first, middle, third, high = np.quantile(values, (0.05, 0.25, 0.5, 0.75, 0.95))
    ax.plot([low, high], [at, at], color=colour, lw=1.3)
    ax.barh(at, third - first, left=first, height=height, facecolor=colour if filled else PAPER, edgecolor=colour, lw=1.3)
    ax.plot([middle, middle], [at - height / 2, at + height / 2], color=INK, lw=1.8, solid_capstyle="butt")


def _rows(ax: Axes, names: Sequence[str]) -> None:
    ax.set_yticks(range(len(names)), [printable(n) for n in names])
    ax.set_ylim(len(names) - 0.5, -0.5)
    ax.grid(axis="y", visible=False)
    ax.tick_params(axis="y", length=0)


def _factor(column: str) -> str:
    """A scenario column in words: the last part of its key, the unit in brackets."""
    words = column.rsplit(".", 1)[-1].strip("_").split("_")
    unit = f" ({words.pop()})" if len(words) > 1 and words[-1] in ("s", "m", "mps") else ""
    return " ".join(words) + unit


def _with_key(series: Sequence[str]) -> tuple[float, float]:
    """A size with room for the legend."""
    return NARROW[0], NARROW[1] + 0.19 * -(-len(series) // key_columns([printable(s) for s in series], NARROW[0]))


def _with_rows(rows: Sequence[object], each: float = 0.34) -> tuple[float, float]:
    return NARROW[0], max(1.9, 0.85 + each * len(rows))
