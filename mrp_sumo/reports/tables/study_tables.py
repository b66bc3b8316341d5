"""The tables of a report that are not the paper's: the main figures, how runs ended, paired differences, the worst runs."""

import math
import os
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd

from mrp_sumo.experiments.statistics import bootstrap_mean, holm, mcnemar, wilcoxon
from mrp_sumo.reports.study import ReportedRuns, floats, numbers, short_key
from mrp_sumo.reports.tables.table import Cell, FileLink, ReportTable, percent, scaled, table_of, whole

MAX_PAIRS = 45  # pairs of series that are compared
WORST = 12  # runs
REASONS = 15
ENOUGH = 0.95  # share of runs that have to succeed


def capacity(study: ReportedRuns) -> ReportTable | None:
    """The largest fleet up to which a series succeeded often enough, by map."""
    if not study.is_executed or len(study.robots) < 2:
        return None
    rows: list[list[Cell]] = []
    rates = study.frame.groupby(["_map", "_series", "_robots"], sort=False)["_succeeded"].mean()
    for series in study.series:
        row: list[Cell] = [series]
        for name in study.maps:
            most, tried = 0, [n for n in study.robots if (name, series, n) in rates.index]
            for n in tried:
                if rates[(name, series, n)] < ENOUGH:
                    break
                most = n
            row.append(None if not tried else "none" if not most else f"{most}" if most < tried[-1] else f"≥ {most}")
        rows.append(row)
    return ReportTable(
        "capacity",
        f"Largest fleet up to which at least {100 * ENOUGH:g} % of the runs succeed",
        ("planner", *study.maps),
        rows,
        f"Of the fleets that were tried: {', '.join(map(str, study.robots))} robots. ≥: no larger one was tried.",
    )


def statuses(study: ReportedRuns) -> ReportTable:
    order = {status: i for i, status in enumerate(("completed", "planned", "loaded"))}
    ended = study.frame["status"].astype(str).value_counts(sort=False)
    names = sorted(ended.index, key=lambda s: (order.get(s, len(order)), -ended[s], s))
    counts = study.frame.groupby(["_series", "status"], sort=False).size()
    rows: list[list[Cell]] = [[s, *(int(counts.get((s, status), 0)) for status in names)] for s in study.series]
    if len(rows) > 1:
        rows.append(["all", *(int(ended[status]) for status in names)])
    return ReportTable("statuses", "How the runs ended", ("planner", *(n.replace("_", " ") for n in names)), rows)


def reasons(study: ReportedRuns) -> ReportTable | None:
    """The most frequent reasons of runs that did not succeed."""
    failed = study.frame[~study.frame["_succeeded"]]
    if "reason" not in failed or not len(failed):
        return None
    failed = failed.assign(reason=failed["reason"].fillna("").astype(str).str.slice(0, 160))
    grouped = failed.groupby(["status", "reason"], sort=False).agg(
        count=("status", "size"), example=("key" if "key" in failed else "status", "first")
    )
    grouped = grouped.sort_values("count", ascending=False, kind="stable").head(REASONS)
    rows: list[list[Cell]] = [
        [status.replace("_", " "), why or "no reason is given", int(row["count"]), short_key(str(row["example"]))]
        for (status, why), row in grouped.iterrows()
    ]
    return ReportTable("reasons", "Why runs did not succeed", ("status", "reason", "runs", "such as"), rows, labels=1, folded=len(rows) > 6)


def main_figures(study: ReportedRuns) -> ReportTable | None:
    """Execution in numbers, one row per map, fleet and series."""
    if not study.is_executed:
        return None
    rows: list[dict[str, Cell]] = []
    for labels, runs in study.blocks():
        done = runs[runs["_succeeded"]]
        driven_s, planned_s = (floats(done, column) for column in ("driven_makespan_s", "makespan_s"))
        ratio = driven_s[planned_s > 0] / planned_s[planned_s > 0]
        ratio = ratio[np.isfinite(ratio)]
        clearance, overlaps = numbers(runs, "min_clearance_m"), numbers(runs, "num_overlaps")
        rows.append(
            {
                **labels,
                "succeeded": len(done),
                "execution time s": bootstrap_mean(numbers(done, "execution_time_s")),
                "blocked s": bootstrap_mean(numbers(done, "blocked_s")),
                "mean lateness s": bootstrap_mean(numbers(done, "lateness_mean_s")),
                "driven / planned": float(np.median(ratio)) if len(ratio) else None,
                "least clearance cm": 100 * float(clearance.min()) if len(clearance) else None,
                "runs with overlap": int((overlaps > 0).sum()) if len(overlaps) else None,
            }
        )
    return table_of(
        "execution",
        "Execution",
        rows,
        "Means with 95 % bootstrap intervals over the runs that succeeded; driven over planned makespan is a median. Least clearance and "
        "overlaps are of all runs. Blocked: without progress by a cell, as the events say. "
        "A retimed plan is driven as planned where nothing disturbs the run. A plan that stays in steps allows every step a quarter turn, "
        "so its robots are early (negative lateness) where the way is free.",
        labels=3,
        digits=dict.fromkeys(("execution time s", "blocked s", "mean lateness s", "least clearance cm"), 1) | {"driven / planned": 2},
    )


def paired(study: ReportedRuns) -> ReportTable | None:
    """Differences of series on the same instances."""
    if len(study.series) < 2 or not study.is_planned:
        return None
    outcome, of = study.outcome, study.by_instance
    time = "execution_time_s" if study.is_executed else "planning_time_s"
    results = []
    for a, b in list(combinations(study.series, 2))[:MAX_PAIRS]:
        shared = of[a].index.intersection(of[b].index)
        if not len(shared):
            continue
        one, two = of[a].loc[shared], of[b].loc[shared]
        both = (one[outcome] & two[outcome]).to_numpy(np.bool_)
        rate = mcnemar(one[outcome].to_numpy(np.bool_), two[outcome].to_numpy(np.bool_))
        values = wilcoxon(floats(one[both], time), floats(two[both], time))
        results.append((a, b, rate, values))
    if not results:
        return None
    p_rate, p_time = holm([r.p_value for _, _, r, _ in results]), holm([v.p_value for *_, v in results])
    scale, unit = (1.0, "s") if study.is_executed else (1e3, "ms")
    what = "execution time" if study.is_executed else "planning time"
    rows: list[dict[str, Cell]] = [
        {
            "first": a,
            "second": b,
            "instances": rate.count,
            "success, points": percent(rate.difference),
            "p": _p(p1),
            "both": values.count,
            f"{what} {unit}": scaled(values.difference, scale),
            "effect": values.rank_biserial,
            "p of time": _p(p2),
        }
        for (a, b, rate, values), p1, p2 in zip(results, p_rate, p_time)
    ]
    return table_of(
        "paired",
        "Paired differences on the same instances, second minus first",
        rows,
        f"Success: percentage points with Newcombe's interval, McNemar's exact test. {what.capitalize()}: mean difference where both "
        "succeeded with bootstrap interval, Wilcoxon's signed-rank test; effect is the rank-biserial correlation, -1: the second is "
        "always faster. p values are adjusted after Holm.",
        labels=2,
        folded=len(rows) > 6,
        digits={"success, points": 1, "effect": 2},
    )


def worst_runs(study: ReportedRuns, page: Path) -> ReportTable | None:
    """Runs that did not arrive, then those on invalid plans, then by the time blocked; with links to what is kept of them."""
    if not study.is_executed or len(study.frame) < 2:
        return None
    frame = study.frame
    blocked = floats(frame, "blocked_s")
    ended = frame["_arrived"].to_numpy(np.int64) + frame["_succeeded"].to_numpy(np.int64)
    order = np.lexsort((np.arange(len(frame)), -np.nan_to_num(blocked), ended))
    linked = [i for i in order if str(frame["key"].iloc[i]) in study.folders] if "key" in frame else []
    chosen = list(dict.fromkeys([*order[:WORST], *linked[: WORST // 2]]))
    rows: list[dict[str, Cell]] = []
    for i in chosen:
        row = frame.iloc[i]
        link: Cell = None
        if (run := study.folders.get(str(row.get("key", "")))) is not None:
            replay = run.folder / "replay.html"
            target = replay if replay.is_file() else run.folder
            link = FileLink("replay" if replay.is_file() else "folder", Path(os.path.relpath(target.resolve(), page.resolve())).as_posix())
        rows.append(
            {
                "run": short_key(str(row.get("key", i))),
                "status": str(row["status"]).replace("_", " "),
                "map": row["_map"],
                "robots": whole(row["_robots"]),
                "planner": row["_series"],
                "seed": None if pd.isna(row["seed"]) else int(row["seed"]),
                "goals reached": _value(row["goals_reached"]),
                "blocked s": _value(row["blocked_s"]),
                "largest lateness s": _value(row["lateness_max_s"]),
                "kept": link,
            }
        )
    return table_of(
        "worst_runs",
        "The worst runs",
        rows,
        "Runs that did not arrive first, then those on invalid plans, then by the time that robots were blocked."
        + ("" if linked else " No run folders or replay pages are kept beside these results."),
        folded=len(rows) > 15,
        digits={"blocked s": 1, "largest lateness s": 1},
    )


def _value(value: object) -> float | int | None:
    if value is None or pd.isna(value):
        return None
    number = float(value)  # type: ignore[arg-type]
    return int(number) if number.is_integer() and math.isfinite(number) else number


def _p(value: float) -> str:
    return "< 0.001" if value < 0.001 else f"{value:.3f}"
