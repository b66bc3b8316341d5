"""Tables I to IV of the MRP-Bench paper for any runs: beside the paper's numbers, in its words, where it prints any for them."""

import math
from typing import Any

import numpy as np
import pandas as pd

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.statistics import bootstrap_mean, par2, success_rates, wilson
from mrp_sumo.reports.paper.printed import map_of_paper, printed
from mrp_sumo.reports.study import ReportedRuns, floats, numbers
from mrp_sumo.reports.tables.table import Cell, ReportTable, percent, table_of, whole

QUANTITIES = ("vertices", "edges", "width_m", "height_m", "cells", "free_cells")  # of Table I


def is_of_paper(study: ReportedRuns) -> bool:
    """True if the paper prints figures for a map and planner of these runs."""
    planners = study.frame["planner"].unique()
    return any(printed("table_2", map_of_paper(name), str(planner)) is not None for name in study.maps for planner in planners)


def titled(study: ReportedRuns, place: str, title: str) -> str:
    """A title with its place in the paper, such as 'Table I', for runs that stand beside it."""
    return f"{place}: {title}" if is_of_paper(study) else title[0].upper() + title[1:]


def table_1(study: ReportedRuns) -> ReportTable | None:
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
        theirs = [printed("table_1", map_of_paper(name), quantity) for quantity in QUANTITIES]
        if counted and any(theirs):
            rows.append([f"{name}, paper", 0.4, *theirs[:2], None, *theirs[2:]])
    if not rows:
        return None
    return ReportTable(
        "table_1_maps",
        titled(study, "Table I", "the maps"),
        ("map", "cell m", "vertices", "edges", "components", "width m", "height m", "cells", "free cells"),
        rows,
        "Vertices and undirected edges of the nav graph, extent of lanes and walls, cells of the occupancy grid.",
        digits={"cell m": 2, "width m": 2, "height m": 2},
    )


def _facts(study: ReportedRuns, runs: pd.DataFrame, cell_m: float) -> list[Cell] | None:
    keys = ("num_vertices", "num_edges", "num_components", "extent_x_m", "extent_y_m", "num_cells_total", "num_cells_free")
    if study.until == "map":
        map_facts = runs[runs["_succeeded"]]
        if not len(map_facts) or any(k not in map_facts for k in keys):
            return None
        values = [float(map_facts.iloc[0][k]) for k in keys]
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
            map_facts = facts(load_map(path, graph=index, level=None if pd.isna(level) else level), cell_m)
        except (MrpSumoError, ValueError):
            return None
        grid = map_facts["grid"] or {}
        values = [map_facts[k] for k in ("vertices", "edges", "components")] + list(map_facts["extent_m"])
        values += [float(grid.get(k, math.nan)) for k in ("total", "free")]
    return [float(v) if i in (3, 4) or not math.isfinite(v) else int(v) for i, v in enumerate(values)]


def table_2(study: ReportedRuns) -> ReportTable | None:
    """Planning success and time."""
    if not study.is_planned:
        return None
    rows: list[dict[str, Cell]] = []
    of_paper = is_of_paper(study)
    for labels, runs in study.blocks():
        valid = runs["_valid"].to_numpy(np.bool_)
        time_s = floats(runs, "planning_time_s")
        solved_s = time_s[valid & np.isfinite(time_s)]
        limit_s = float(runs["planner.time_limit_s"].max())
        rows.append(
            {
                **labels,
                "runs": len(runs),
                "success %": percent(wilson(int(valid.sum()), len(runs))),
                "MRP-Bench success %": 100 * float(runs["_planned"].mean()) if of_paper else None,
                "paper %": printed("table_2", map_of_paper(labels["map"]), _planner(runs)),
                "mean ms": bootstrap_mean(solved_s * 1e3),
                "median ms": float(np.median(solved_s) * 1e3) if len(solved_s) else None,
                "longest ms": float(solved_s.max() * 1e3) if len(solved_s) else None,
                "PAR2 s": par2(time_s, valid, limit_s) if math.isfinite(limit_s) else None,
            }
        )
    return table_of(
        "table_2_planning",
        titled(study, "Table II", "planning success and time"),
        rows,
        "Success: a valid plan within the time limit. Times are of runs with one. PAR2: mean time in which a run without one counts as "
        "twice the limit." + of_paper * " MRP-Bench success: any plan, valid or not, which is what MRP-Bench and the paper count. "
        "The paper's rates are of plans within 60 s, over 5 and 9 robots together.",
        labels=3,
        digits={"success %": 0, "MRP-Bench success %": 0, "paper %": 0},
    )


def table_3(study: ReportedRuns) -> ReportTable | None:
    """Execution success within the time limit."""
    if not study.is_executed:
        return None
    rows: list[dict[str, Cell]] = []
    of_paper = is_of_paper(study)
    for labels, runs in study.blocks():
        normalised, overall = success_rates(runs["_valid"], runs["_succeeded"])
        time = bootstrap_mean(floats(runs[runs["_succeeded"]], "execution_time_s"))
        share = floats(runs, "goals_reached") / floats(runs, "num_robots")
        theirs = {rate: printed("table_3", rate, map_of_paper(labels["map"]), _planner(runs)) for rate in ("normalised", "overall")}
        rows.append(
            {
                **labels,
                "runs": len(runs),
                "normalised %": percent(normalised),
                "overall %": percent(overall),
                "MRP-Bench success %": 100 * float(runs["all_goals_reached"].fillna(False).mean()) if of_paper else None,
                "robots at goal %": 100 * float(np.nanmean(share)) if np.isfinite(share).any() else None,
                "mean time s": time,
                **{f"paper {rate} %": value for rate, value in theirs.items()},
            }
        )
    stated, used = (pd.to_numeric(study.frame[name], errors="coerce") for name in ("execution.time_limit_s", "execution_time_limit_s"))
    limits = sorted({f"{v:g}" for v in stated.fillna(used).dropna().unique()}, key=float)
    return table_of(
        "table_3_execution",
        titled(study, "Table III", f"execution success within {' or '.join(limits) or '300'} s"),
        rows,
        "Success: a valid plan, all robots at their goals, and no two ever overlapping. Normalised: of the runs with a valid plan; "
        "overall: of all runs. Mean time: of the runs that succeeded."
        + of_paper
        * " MRP-Bench success: all robots at their goals, of all runs, whatever the plan. The paper's rates are MRP-Bench's, over "
        "5 and 9 robots together, driven by Nav2, which avoids others and keeps no order; its normalised ones are of the scenarios for "
        "which every planner found a plan.",
        labels=3,
        digits={name: 0 for name in (rows[0] if rows else ()) if name.endswith("%")} | {"mean time s": 1},
    )


def table_4(study: ReportedRuns) -> ReportTable | None:
    """Makespan and cost over the instances that every series solved."""
    if not study.is_planned:
        return None
    rows: list[dict[str, Cell]] = []
    for (name, robots), runs in study.groups("_map", "_robots"):
        common, series = commonly_solved(runs)
        there = map_of_paper(name) == "warehouse" and whole(robots) == 9
        for s, solved in ((s, common[common["_series"] == s]) for s in study.series if s in series):
            planner = _planner(solved)
            rows.append(
                {
                    "map": name,
                    "robots": whole(robots),
                    "planner": s,
                    "instances": len(solved),
                    "makespan": bootstrap_mean(numbers(solved, "makespan_steps")),
                    "cost": bootstrap_mean(numbers(solved, "cost_steps")),
                    "paper makespan": printed("table_4", "makespan_cells", planner) if there else None,
                    "paper cost": printed("table_4", "cost_cells", planner) if there else None,
                    "smoothed makespan": _mean(solved, "makespan_smoothed_steps"),
                    "smoothed cost": _mean(solved, "cost_smoothed_steps"),
                    "makespan s": _mean(solved, "makespan_s"),
                }
            )
    return table_of(
        "table_4_cost",
        titled(study, "Table IV", "makespan and cost where every planner found a plan"),
        rows,
        "Means over the instances for which all series of the block found a plan, valid or not, in cells with the start included, as "
        "MRP-Bench counts; smoothed as it smooths."
        + is_of_paper(study)
        * " The paper's are over 39 scenarios of other seeds; they stand beside the warehouse with nine robots, where "
        "costs are of their size.",
        labels=3,
        digits=dict.fromkeys(list(rows[0])[4:] if rows else (), 1),
    )


def commonly_solved(runs: pd.DataFrame) -> tuple[pd.DataFrame, set[str]]:
    """The runs of instances for which every series found a plan, valid or not, once for each series and instance; and the series."""
    solved = runs[runs["_planned"]].drop_duplicates(["_series", "_instance"])
    series = set(runs["_series"])
    count = solved.groupby("_instance")["_series"].transform("nunique")
    return solved[count == len(series)], series


def _planner(runs: pd.DataFrame) -> str:
    return str(runs["planner"].iloc[0]) if len(runs) else ""


def _mean(runs: pd.DataFrame, column: str) -> float | None:
    values = numbers(runs, column)
    return float(values.mean()) if len(values) else None
