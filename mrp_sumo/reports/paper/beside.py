"""Numbers of the paper beside ours, each of ours with its interval of 95 %."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from mrp_sumo.experiments.paper import Kinds
from mrp_sumo.experiments.statistics import Interval, bootstrap_deviation, bootstrap_mean, holm, mcnemar, pairs, wilcoxon, wilson
from mrp_sumo.reports.paper.printed import map_of_paper, numbers_of_paper, printed
from mrp_sumo.reports.paper.tables import commonly_solved
from mrp_sumo.reports.study import PLANNER_NAMES, ReportedRuns, floats, numbers
from mrp_sumo.reports.tables.table import percent

YIELDING, REPLANNING, ORDERED = "local yielding", "local yielding, then lacam", "the plan's order"  # ways to drive
COUNTED = ("num_vertices", "num_edges", "extent_x_m", "extent_y_m", "num_cells_total", "num_cells_free", "num_cells_blocked")
PRINTED = ("vertices", "edges", "width_m", "height_m", "cells", "free_cells", "blocked_cells")  # the same of Table I


@dataclass(frozen=True)
class BesidePaper:
    """A number of ours, and the paper's where it prints one."""

    labels: dict[str, Any]  # what it is of
    quantity: str  # with its unit
    ours: Interval  # a fact has itself as its limits
    paper_value: float | None = None

    @property
    def agrees(self) -> bool | None:
        """True where the paper's number lies in the interval of ours, as far as the digits go that it prints; None without both."""
        if self.paper_value is None or math.isnan(self.ours.low):
            return None
        decimals = len(f"{self.paper_value:.6f}".rstrip("0").partition(".")[2])
        half = 0.5 * 10.0**-decimals
        return bool(self.ours.low - half <= self.paper_value <= self.ours.high + half)

    @property
    def document(self) -> dict[str, Any]:
        compared = {"paper_value": self.paper_value, "agrees": self.agrees}
        return {**self.labels, "quantity": self.quantity, **_document(self.ours), **compared}


@dataclass(frozen=True)
class Ordered:
    """Two planners on the same runs, and which the paper puts first."""

    labels: dict[str, Any]
    first: str
    second: str
    difference: Interval  # second minus first
    p_value: float  # of no difference, adjusted for the number of pairs in its table
    paper_difference: float | None

    @property
    def verdict(self) -> str:
        """The test's verdict on the paper's order."""
        if self.paper_difference is None:
            return ""
        if self.p_value >= 0.05:
            return "too close to tell"
        if not self.paper_difference:
            return "differ here, equal in the paper"
        return "as in the paper" if self.paper_difference * self.difference.value > 0 else "the other way round"

    @property
    def document(self) -> dict[str, Any]:
        verdict = {"p_value": self.p_value, "paper_difference": self.paper_difference, "verdict": self.verdict}
        return {**self.labels, "first": self.first, "second": self.second, **_document(self.difference), **verdict}


def _document(ours: Interval) -> dict[str, Any]:
    value, low, high = (v if math.isfinite(v) else None for v in (ours.value, ours.low, ours.high))
    return {"ours": value, "low": low, "high": high, "runs": ours.count}


def table_1(study: ReportedRuns) -> list[BesidePaper]:
    """Facts of the maps; the paper's are of cells of 0.4 m."""
    rows = []
    for name in study.maps:
        runs = study.frame[(study.frame["_map"] == name) & study.frame["_succeeded"]]
        for _, run in runs.iterrows():
            cell_m = float(run["discretisation.cell_m"])
            for column, quantity in zip(COUNTED, PRINTED):
                value = float(run[column])
                theirs = printed("table_1", map_of_paper(name), quantity) if cell_m == 0.4 else None
                rows.append(BesidePaper({"map": name, "cell_m": cell_m}, quantity, Interval(value, value, value, 1), theirs))
    return rows


def table_2(study: ReportedRuns) -> list[BesidePaper]:
    """Share of the experiments with a plan, valid or not, within the limit; the paper's are of 5 and 9 robots together."""
    rows = []
    for labels, runs, together in _experiments(study):
        rate = wilson(int(runs["_planned"].sum()), len(runs))
        theirs = printed("table_2", map_of_paper(labels["map"]), labels["planner"]) if together else None
        rows.append(BesidePaper(labels, "planned_percent", percent(rate), theirs))
    return rows


def table_3(study: ReportedRuns) -> list[BesidePaper]:
    """Share of the experiments in which all robots reach their goals; the paper's robots yield locally."""
    rows = []
    for how, driven in ways(study):
        for labels, runs, together in _experiments(driven):
            common, _ = commonly_solved(driven.frame[driven.frame["_map"] == labels["map"]])
            for rate, of in (("normalised", runs[runs.index.isin(common.index)]), ("overall", runs)):
                arrived = wilson(int((of["_planned"] & arrivals(of)).sum()), len(of))
                theirs = printed("table_3", rate, map_of_paper(labels["map"]), labels["planner"])
                theirs = theirs if together and how == YIELDING else None
                rows.append(BesidePaper({"execution": how, **labels}, f"{rate}_percent", percent(arrived), theirs))
    return rows


def table_4(study: ReportedRuns) -> list[BesidePaper]:
    """Mean makespan and cost of what every planner solved, in cells with the start included."""
    common, _ = commonly_solved(study.frame)
    rows = []
    for planner in _planners(study.frame):
        runs = common[common["planner"] == planner]
        for quantity, column in (("makespan_cells", "makespan_steps"), ("cost_cells", "cost_steps")):
            mean = bootstrap_mean(numbers(runs, column))
            rows.append(BesidePaper({"planner": planner}, quantity, mean, printed("table_4", quantity, planner)))
    return rows


def figure_5(study: ReportedRuns) -> list[BesidePaper]:
    """Planning time of the scenarios with a plan: mean and standard deviation; quartiles and what the paper says stand beside them."""
    rows = []
    for planner in _planners(study.frame):
        runs = study.frame[study.frame["planner"] == planner]
        time_s = numbers(runs[runs["_planned"]], "planning_time_s")
        five = [float(q) for q in np.quantile(time_s, (0, 0.25, 0.5, 0.75, 1))] if len(time_s) else None
        says = numbers_of_paper()["figure_5"]["says"].get(planner)
        labels = {"planner": planner, "scenarios": len(runs), "solved": len(time_s), "five_numbers_s": five, "paper_says": says}
        rows.append(BesidePaper(labels, "mean_s", bootstrap_mean(time_s), printed("figure_5", "mean_s", planner)))
        spread = printed("figure_5", "standard_deviation_s", planner)
        rows.append(BesidePaper(labels, "standard_deviation_s", bootstrap_deviation(time_s), spread))
    return rows


def replicability(single: ReportedRuns, five: ReportedRuns | None, kinds: Kinds) -> list[BesidePaper]:
    """The paper's three studies of a hundred runs each: one robot, and scenarios of its two kinds."""
    rows = _repeated(single.frame, {"study": "one_robot", "robots": 1}, "one_robot")
    if five is None:
        return rows
    for study, seeds in (("hard", kinds.hard), ("easy", kinds.easy)):
        for seed in seeds:
            of = five.frame[five.frame["seed"] == seed]
            for planner in _planners(of):
                labels = {"study": study, "robots": kinds.robots, "seed": seed, "planner": planner, "survivors": kinds.survivors[seed]}
                rows += _repeated(of[of["planner"] == planner], labels, study)
    return rows


def _repeated(runs: pd.DataFrame, labels: dict[str, Any], study: str) -> list[BesidePaper]:
    """Success, mean, fastest and spread of the runs of one plan."""
    arrived = arrivals(runs)
    time_s, planning_s = numbers(runs[arrived], "execution_time_s"), numbers(runs, "planning_time_s")
    fastest = float(time_s.min()) if len(time_s) else math.nan
    median = float(np.median(planning_s)) if len(planning_s) else math.nan
    theirs = numbers_of_paper()["replicability"][study]
    return [
        BesidePaper(labels, quantity, ours, theirs.get(quantity))
        for quantity, ours in (
            ("success_percent", percent(wilson(int(arrived.sum()), len(runs)))),
            ("mean_s", bootstrap_mean(time_s)),
            ("standard_deviation_s", bootstrap_deviation(time_s)),
            ("fastest_s", Interval(fastest, math.nan, math.nan, len(time_s))),
            ("median_planning_s", Interval(median, math.nan, math.nan, len(planning_s))),
        )
    ]


def order(executed: ReportedRuns, costs: ReportedRuns) -> list[Ordered]:
    """Order of the planners, in the paper and here: every two on the same runs, Table III by McNemar's test, Table IV by Wilcoxon's."""
    rows: list[Ordered] = []
    if driven := dict(ways(executed)).get(YIELDING):
        for name in driven.maps:
            runs, theirs = driven.frame[driven.frame["_map"] == name], numbers_of_paper()["table_3"]["overall"].get(map_of_paper(name), {})
            rows += _ordered({"table": "table_3", "map": name, "quantity": "overall_percent"}, runs, _arrived_more, theirs)
    common, _ = commonly_solved(costs.frame)
    for quantity, column in (("makespan_cells", "makespan_steps"), ("cost_cells", "cost_steps")):
        labels, theirs = {"table": "table_4", "map": costs.maps[0], "quantity": quantity}, numbers_of_paper()["table_4"][quantity]
        rows += _ordered(labels, common, partial(_cost_more, column), theirs)
    return rows


def _arrived_more(first: pd.DataFrame, second: pd.DataFrame) -> tuple[Interval, float]:
    test = mcnemar(arrivals(first), arrivals(second))
    return percent(test.difference), test.p_value


def _cost_more(column: str, first: pd.DataFrame, second: pd.DataFrame) -> tuple[Interval, float]:
    test = wilcoxon(floats(first, column), floats(second, column))
    return test.difference, test.p_value


def _ordered(
    labels: dict[str, Any],
    runs: pd.DataFrame,
    test: Callable[[pd.DataFrame, pd.DataFrame], tuple[Interval, float]],  # how much more the second has, and how likely by chance
    theirs: dict[str, float],
) -> list[Ordered]:
    """Every two planners of one table, their p-values adjusted together."""
    both = list(combinations(_planners(runs), 2))
    tests = [test(*pairs(runs, "planner", first, second)) for first, second in both]
    rows = []
    for (first, second), (difference, _), p_value in zip(both, tests, holm([p for _, p in tests])):
        of_paper = round(theirs[second] - theirs[first], 6) if first in theirs and second in theirs else None
        rows.append(Ordered(labels, first, second, difference, p_value, of_paper))
    return rows


def ways(study: ReportedRuns) -> Iterator[tuple[str, ReportedRuns]]:
    """The runs of Table III by how they were driven."""
    frame = study.frame
    ordered = (frame["execution.policy"] == "adg").to_numpy(np.bool_)
    replans = frame["execution.recovery.replanner"].notna().to_numpy(np.bool_)
    for how, chosen in ((YIELDING, ~ordered & ~replans), (REPLANNING, ~ordered & replans), (ORDERED, ordered)):
        if chosen.any():
            runs = frame[chosen].copy()
            runs["_series"] = [PLANNER_NAMES.get(str(planner), str(planner)) for planner in runs["planner"]]
            series = tuple(dict.fromkeys(runs["_series"]))
            yield how, ReportedRuns(how, "", study.until, runs, study.maps, series, (), (), {})


def arrivals(runs: pd.DataFrame) -> Any:
    """[N] whether all robots reached their goals, whatever the plan."""
    return runs["all_goals_reached"].fillna(False).to_numpy(np.bool_)


def _experiments(study: ReportedRuns) -> Iterator[tuple[dict[str, Any], pd.DataFrame, bool]]:
    """(labels, runs, whether they are of all numbers of robots together) of every map and planner."""
    for name in study.maps:
        for planner in _planners(study.frame):
            runs = study.frame[(study.frame["_map"] == name) & (study.frame["planner"] == planner)]
            counts = sorted(int(n) for n in runs["_robots"].dropna().unique())
            groups: list[list[int]] = [counts, *([n] for n in counts)] if len(counts) > 1 else [counts]
            for some in groups:
                labels = {"map": name, "planner": planner, "robots": " and ".join(map(str, some))}
                yield labels, runs[runs["_robots"].isin(some)], len(some) > 1


def _planners(frame: pd.DataFrame) -> list[str]:
    """Planners of runs, in the order of the paper's tables."""
    there = set(frame["planner"].astype(str))
    return [name for name in PLANNER_NAMES if name in there]
