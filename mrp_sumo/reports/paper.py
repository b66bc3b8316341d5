"""Tables I to IV and Figure 5 of the MRP-Bench paper for our runs, beside the paper's printed numbers.

Schaefer, Palmieri, Heuer, Dillmann, Koenig, Kleiner: A Benchmark for Multi-Robot Planning in Realistic, Complex and Cluttered
Environments, ICRA 2023. Where the paper prints no number, the table says `–`.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.statistics import bootstrap_mean, par2, success_rates, wilson
from mrp_sumo.reports.charts.chart import COLOURS, MAX_SERIES, Chart, draw, log_seconds, printable
from mrp_sumo.reports.pictures.map_picture import INK, PAPER
from mrp_sumo.reports.study import Study, numbers
from mrp_sumo.reports.tables.table import Cell, Table, between, percent, whole


@dataclass(frozen=True)
class MapFacts:
    """A row of Table I."""

    vertices: int
    edges: int
    extent_m: tuple[float, float]
    cells: int  # of the grid at 0.4 m
    free: int


PAPER_MAPS = {
    "office": MapFacts(29, 32, (21.53, 12.05), 1025, 333),
    "warehouse": MapFacts(54, 59, (22.16, 27.07), 3009, 788),
    "airport": MapFacts(210, 211, (282.22, 64.35), 105700, 7645),
}
ALSO = {"airport_terminal": "airport"}  # MRP-Bench's file names
PAPER_PLANNING = {  # Table II: % of 108 experiments, 5 and 9 robots together, with a plan within 60 s
    ("office", "A*"): 100,
    ("office", "CBS"): 99,
    ("office", "ECBS"): 100,
    ("office", "EECBS"): 100,
    ("warehouse", "A*"): 100,
    ("warehouse", "CBS"): 83,
    ("warehouse", "ECBS"): 97,
    ("warehouse", "EECBS"): 100,
}
PAPER_EXECUTION = {  # Table III: % normalised and overall, of 108 experiments, 5 and 9 robots together, within 300 s
    ("office", "A*"): (95, 95),
    ("office", "CBS"): (93, 92),
    ("office", "ECBS"): (95, 95),
    ("office", "EECBS"): (95, 95),
    ("warehouse", "A*"): (81, 77),
    ("warehouse", "CBS"): (84, 70),
    ("warehouse", "ECBS"): (89, 85),
    ("warehouse", "EECBS"): (84, 78),
}
PAPER_COST = {  # Table IV: makespan and cost in cells, start included, over 39 scenarios
    "A*": (65.3, 227.1),
    "CBS": (65.6, 233.5),
    "ECBS": (65.6, 234.1),
    "EECBS": (66.3, 234.2),
    "CBS-TA": (59.3, 213.5),
    "ECBS-TA": (66.2, 227.3),
}


def map_of_paper(name: str) -> str:
    """What the paper calls a map."""
    base = name.split(", ", 1)[0]
    return ALSO.get(base, base)


def paper_planner(series: str) -> str:
    """The planner of a series as the paper writes it."""
    return series.split(", ", 1)[0]


def table_1(study: Study) -> Table | None:
    """Map facts, counted by the runs themselves or, for bundled maps, now."""
    cells = "discretisation.cell_m" in study.frame
    rows: list[list[Cell]] = []
    for name in study.maps:
        runs = study.frame[study.frame["_map"] == name]
        counted = False
        for cell_m in sorted(runs["discretisation.cell_m"].dropna().unique(), reverse=True) if cells else (0.4,):
            facts = _facts(study, runs[runs["discretisation.cell_m"] == cell_m] if cells else runs, float(cell_m))
            if facts is not None:
                rows.append([name, float(cell_m), *facts])
                counted = True
        of = PAPER_MAPS.get(map_of_paper(name))
        if of is not None and counted:
            rows.append([f"{name}, paper", 0.4, of.vertices, of.edges, None, *of.extent_m, of.cells, of.free])
    if not rows:
        return None
    return Table(
        "table_1_maps",
        "Table I: the maps",
        ("map", "cell m", "vertices", "edges", "components", "width m", "height m", "cells", "free cells"),
        rows,
        "Vertices and undirected edges of the nav graph, extent of lanes and walls, cells of the occupancy grid.",
        digits={"cell m": 2, "width m": 2, "height m": 2},
    )


def _facts(study: Study, runs: pd.DataFrame, cell_m: float) -> list[Cell] | None:
    keys = ("num_vertices", "num_edges", "num_components", "extent_x_m", "extent_y_m", "num_cells_total", "num_cells_free")
    if study.until == "map":
        found = runs[runs["_succeeded"]]
        if not len(found) or any(k not in found for k in keys):
            return None
        values = [float(found.iloc[0][k]) for k in keys]
    else:
        from mrp_sumo.maps.catalogue import bundled_maps
        from mrp_sumo.maps.facts import facts
        from mrp_sumo.maps.load import load_map

        row = runs.iloc[0]
        path = bundled_maps().get(str(row["map"]))
        if path is None:
            return None
        graph, level = row.get("map.graph"), row.get("map.level")
        index: Any = None if pd.isna(graph) else "all" if graph == "all" else int(graph)
        try:
            found = facts(load_map(path, graph=index, level=None if pd.isna(level) else level), cell_m)
        except (MrpSumoError, ValueError):
            return None
        grid = found["grid"] or {}
        values = [found[k] for k in ("vertices", "edges", "components")] + list(found["extent_m"])
        values += [float(grid.get(k, math.nan)) for k in ("total", "free")]
    return [float(v) if i in (3, 4) or not math.isfinite(v) else int(v) for i, v in enumerate(values)]


def table_2(study: Study) -> Table | None:
    """Planning success and time."""
    if not study.is_planned:
        return None
    rows: list[list[Cell]] = []
    for (name, robots, series), runs in study.groups("_map", "_robots", "_series"):
        valid = runs["_valid"].to_numpy(np.bool_)
        time_s = runs["planning_time_s"].to_numpy(np.float64, na_value=np.nan)
        solved_s = time_s[valid & np.isfinite(time_s)]
        mean = bootstrap_mean(solved_s * 1e3)
        limit_s = float(runs["planner.time_limit_s"].max())
        rows.append(
            [
                name,
                whole(robots),
                series,
                len(runs),
                percent(wilson(int(valid.sum()), len(runs))),
                100 * float(runs["_planned"].mean()),
                PAPER_PLANNING.get((map_of_paper(name), paper_planner(series))),
                between(mean),
                float(np.median(solved_s) * 1e3) if len(solved_s) else None,
                float(solved_s.max() * 1e3) if len(solved_s) else None,
                par2(time_s, valid, limit_s) if math.isfinite(limit_s) else None,
            ]
        )
    return Table(
        "table_2_planning",
        "Table II: planning success and time",
        (
            "map",
            "robots",
            "planner",
            "runs",
            "success %",
            "MRP-Bench success %",
            "paper %",
            "mean ms",
            "median ms",
            "longest ms",
            "PAR2 s",
        ),
        rows,
        "Success: a valid plan within the time limit. MRP-Bench success: any plan, valid or not, which is what MRP-Bench and the paper "
        "count. Times are of runs with a valid plan. PAR2: mean time in which a run without one counts as twice the limit. "
        "The paper's rates are of plans within 60 s, over 5 and 9 robots together.",
        labels=3,
        digits={"success %": 0, "MRP-Bench success %": 0, "paper %": 0},
    )


def table_3(study: Study) -> Table | None:
    """Execution success within the time limit."""
    if not study.is_executed:
        return None
    rows: list[list[Cell]] = []
    for (name, robots, series), runs in study.groups("_map", "_robots", "_series"):
        normalised, overall = success_rates(runs["_valid"], runs["_succeeded"])
        time = bootstrap_mean(runs.loc[runs["_succeeded"], "execution_time_s"].to_numpy(np.float64, na_value=np.nan))
        share = runs["goals_reached"].to_numpy(np.float64, na_value=np.nan) / runs["num_robots"].to_numpy(np.float64, na_value=np.nan)
        rows.append(
            [
                name,
                whole(robots),
                series,
                len(runs),
                percent(normalised),
                percent(overall),
                100 * float(runs["all_goals_reached"].fillna(False).mean()),
                100 * float(np.nanmean(share)) if np.isfinite(share).any() else None,
                between(time),
                *PAPER_EXECUTION.get((map_of_paper(name), paper_planner(series)), (None, None)),
            ]
        )
    limits = sorted({f"{v:g}" for v in _time_limits(study.frame).dropna().unique()}, key=float)
    return Table(
        "table_3_execution",
        f"Table III: execution success within {' or '.join(limits) or '300'} s",
        (
            "map",
            "robots",
            "planner",
            "runs",
            "normalised %",
            "overall %",
            "MRP-Bench success %",
            "robots at goal %",
            "mean time s",
            "paper normalised %",
            "paper overall %",
        ),
        rows,
        "Success: a valid plan, all robots at their goals, and no two ever overlapping. Normalised: of the runs with a valid plan; "
        "overall: of all runs. MRP-Bench success: all robots at their goals, of all runs, whatever the plan. "
        "Mean time: of the runs that succeeded. The paper's rates are MRP-Bench's, over 5 and 9 robots together, driven by Nav2, which "
        "avoids others and keeps no order; its normalised ones are of the scenarios for which every planner found a plan.",
        labels=3,
        digits={
            "normalised %": 0,
            "overall %": 0,
            "MRP-Bench success %": 0,
            "robots at goal %": 0,
            "mean time s": 1,
            "paper normalised %": 0,
            "paper overall %": 0,
        },
    )


def _time_limits(frame: pd.DataFrame) -> "pd.Series[float]":
    """[N] of the executions: as stated, or as followed from the plan."""
    stated, used = (pd.to_numeric(frame[name], errors="coerce") for name in ("execution.time_limit_s", "execution_time_limit_s"))
    return stated.fillna(used)


def table_4(study: Study) -> Table | None:
    """Makespan and cost over the instances that every series solved."""
    if not study.is_planned:
        return None
    rows: list[list[Cell]] = []
    for (name, robots), runs in study.groups("_map", "_robots"):
        common, series = commonly_solved(runs)
        of = [(s, common[common["_series"] == s]) for s in study.series if s in series]
        for s, solved in of:
            makespan, cost = (bootstrap_mean(numbers(solved, k)) for k in ("makespan_steps", "cost_steps"))
            paper = PAPER_COST.get(paper_planner(s)) if map_of_paper(name) == "warehouse" and whole(robots) == 9 else None
            rows.append(
                [
                    name,
                    whole(robots),
                    s,
                    len(solved),
                    between(makespan),
                    between(cost),
                    paper[0] if paper else None,
                    paper[1] if paper else None,
                    _mean(solved, "makespan_smoothed_steps"),
                    _mean(solved, "cost_smoothed_steps"),
                    _mean(solved, "makespan_s"),
                ]
            )
    return Table(
        "table_4_cost",
        "Table IV: makespan and cost where every planner found a plan",
        (
            "map",
            "robots",
            "planner",
            "instances",
            "makespan",
            "cost",
            "paper makespan",
            "paper cost",
            "smoothed makespan",
            "smoothed cost",
            "makespan s",
        ),
        rows,
        "Means over the instances for which all series of the block found a plan, valid or not, in cells with the start included, as "
        "MRP-Bench counts; "
        "smoothed as it smooths. The paper's are over 39 scenarios of other seeds; they stand beside the warehouse with nine robots, "
        "where costs are of their size.",
        labels=3,
        digits=dict.fromkeys(("makespan", "cost", "paper makespan", "paper cost", "smoothed makespan", "smoothed cost", "makespan s"), 1),
    )


def commonly_solved(runs: pd.DataFrame) -> tuple[pd.DataFrame, set[str]]:
    """The runs of instances for which every series found a plan, valid or not, once for each series and instance; and the series."""
    solved = runs[runs["_planned"]].drop_duplicates(["_series", "_instance"])
    series = set(runs["_series"])
    count = solved.groupby("_instance")["_series"].transform("nunique")
    return solved[count == len(series)], series


def figure_5(study: Study) -> list[Chart]:
    """Planning time by planner on each map, all numbers of robots together, as a box plot."""
    if not study.is_planned:
        return []
    charts: list[Chart] = []
    by_map = len(study.maps) <= 6
    for name in study.maps if by_map else ("all maps",):
        runs = study.frame[study.frame["_map"] == name] if by_map else study.frame
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
        charts.append(draw(f"figure_5_{len(charts) + 1}", f"Figure 5: planning time{where}", caption, paint, size=_size(values)))
    return charts


def execution_violins(study: Study) -> list[Chart]:
    """Execution time and time blocked by planner, one violin per planner, as MRP-Bench's analysis script draws them."""
    if not study.is_executed:
        return []
    charts: list[Chart] = []
    by_map = len(study.maps) <= 6
    for name in study.maps if by_map else ("all maps",):
        runs = study.frame[study.frame["_map"] == name] if by_map else study.frame
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


def _mean(runs: pd.DataFrame, column: str) -> float | None:
    values = numbers(runs, column)
    return float(values.mean()) if len(values) else None
