"""Why our numbers differ from the paper's: runs from which a supposed cause was taken away, beside those with it."""

from collections.abc import Mapping, Sequence

import numpy as np

from mrp_sumo.experiments.statistics import bootstrap_mean, wilson
from mrp_sumo.reports.paper.beside import ORDERED, REPLANNING, YIELDING, BesidePaper, arrivals
from mrp_sumo.reports.paper.printed import map_of_paper, printed
from mrp_sumo.reports.study import ReportedRuns, numbers
from mrp_sumo.reports.tables.table import Cell, ReportTable, percent

SCENARIOS = 39  # of the paper's Table IV
DRAWS = 10_000


def causes(studies: Mapping[str, ReportedRuns], table_3: Sequence[BesidePaper], table_2: Sequence[BesidePaper]) -> ReportTable:
    """The experiments, a row for each number that they change; `studies` by the names of their suites."""
    rows: list[list[Cell]] = []
    if study := studies.get("paper_no_yielding"):
        rows += _without_yielding(study, table_3)
    if study := studies.get("paper_slow_cbs"):
        rows += _slow(study, table_2)
    if study := studies.get("paper_other_seeds"):
        rows += _other_seeds(study, studies["paper_table_4"])
    return ReportTable(
        "causes",
        "Experiments that take a cause away",
        ("what was changed", "number", "runs", "changed", "as in the tables", "paper", "what it shows"),
        rows,
        "All with CBS. Intervals of 95 %.",
        labels=2,
    )


def _without_yielding(study: ReportedRuns, table_3: Sequence[BesidePaper]) -> list[list[Cell]]:
    rows: list[list[Cell]] = []
    for name in study.maps:
        runs = study.frame[study.frame["_map"] == name]
        alone = wilson(int(arrivals(runs).sum()), len(runs))
        of = {
            row.labels["execution"]: row
            for row in _together(table_3, name)
            if row.labels["planner"] == "cbs" and row.quantity == "overall_percent"
        }
        base, theirs, what = of[YIELDING], printed("table_3", "overall", map_of_paper(name), "cbs"), f"arrived %, {name}"
        gain = base.ours.value - 100 * alone.value
        rows.append(["nobody yields", what, len(runs), percent(alone), base.ours, theirs, f"yielding is worth {gain:.0f} points"])
        for how, change in ((REPLANNING, "lacam where yielding does not help"), (ORDERED, "the plan's order is kept")):
            more = of[how].ours.value - base.ours.value
            rows.append([change, what, len(runs), of[how].ours, base.ours, theirs, f"worth {more:.0f} points more"])
    return rows


def _slow(study: ReportedRuns, table_2: Sequence[BesidePaper]) -> list[list[Cell]]:
    rows: list[list[Cell]] = []
    (name,) = study.maps
    (base,) = (row for row in _together(table_2, name) if row.labels["planner"] == "cbs")
    theirs = printed("table_2", map_of_paper(name), "cbs")
    stripped = study.frame["planner.parameters.heuristic"].eq(False).fillna(False).to_numpy(np.bool_)
    hasty = (study.frame["planner.time_limit_s"] < 1).to_numpy(np.bool_)
    for chosen, change in ((hasty & ~stripped, "0.2 s in place of 60 s"), (hasty & stripped, "and no heuristic, symmetries, bypass")):
        runs = study.frame[chosen]
        rate = wilson(int(runs["_planned"].sum()), len(runs))
        shows = "not the cause" if 100 * rate.low > (theirs or 0) else "may be the cause"
        rows.append([change, f"planned %, {name}", len(runs), percent(rate), base.ours, theirs, shows])
    return rows


def _other_seeds(study: ReportedRuns, costs: ReportedRuns) -> list[list[Cell]]:
    rows: list[list[Cell]] = []
    rng = np.random.default_rng(0)
    for column, quantity in (("makespan_steps", "makespan_cells"), ("cost_steps", "cost_cells")):
        values = numbers(study.frame[study.frame["_planned"]], column)
        ours = bootstrap_mean(numbers(costs.frame[costs.frame["planner"] == "cbs"], column))
        theirs = printed("table_4", quantity, "cbs") or 0.0
        share = 100 * float((rng.choice(values, (DRAWS, SCENARIOS)).mean(1) >= theirs).mean())
        shows = f"{share:.1f} % of draws of {SCENARIOS} seeds have a mean of at least the paper's"
        new = bootstrap_mean(values)
        rows.append([f"{len(values)} other seeds", quantity.replace("_", " "), len(values), new, ours, theirs, shows])
    return rows


def _together(rows: Sequence[BesidePaper], name: str) -> list[BesidePaper]:
    """Those on a map of all numbers of robots together."""
    return [row for row in rows if row.labels["map"] == name and " and " in row.labels["robots"]]
