"""`mrp-sumo paper`: the paper's tables and figures with our numbers beside it, of the runs that `experiments.paper` made.

DIR/index.html               stands alone, needs no network
DIR/paper.json               every number, with its interval and the paper's
DIR/figures/<name>.svg .png
DIR/tables/<name>.csv .md .tex
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mrp_sumo import __version__
from mrp_sumo.experiments.identity import code_version, library_versions
from mrp_sumo.experiments.paper import SUITES, Campaign, Kinds, Made, kinds_of
from mrp_sumo.files.folders import PLAN
from mrp_sumo.files.writing import write_whole
from mrp_sumo.reports.charts.chart import Chart
from mrp_sumo.reports.page import Section, Tile, page
from mrp_sumo.reports.paper import beside
from mrp_sumo.reports.paper import tables as plain_tables
from mrp_sumo.reports.paper.beside import ORDERED, REPLANNING, YIELDING, BesidePaper, Ordered
from mrp_sumo.reports.paper.causes import causes
from mrp_sumo.reports.paper.charts import arrivals_chart, execution_violins, figure_5
from mrp_sumo.reports.paper.printed import numbers_of_paper
from mrp_sumo.reports.report import write_part
from mrp_sumo.reports.study import PLANNER_NAMES, read_study
from mrp_sumo.reports.tables.table import Cell, ReportTable, scaled

PAGE, DOCUMENT, MARKDOWN = "index.html", "paper.json", "paper.md"
TITLE = "Beside the MRP-Bench paper"


@dataclass(frozen=True)
class PaperComparison:
    """Every number of the paper beside ours, and what is drawn of them."""

    rows: dict[str, list[BesidePaper]]  # by table or figure
    order: list[Ordered]
    sections: list[Section]

    @property
    def compared(self) -> list[BesidePaper]:
        """Numbers that the paper prints, too."""
        return [row for rows in self.rows.values() for row in rows if row.agrees is not None]


def compare_with_paper(campaign: Campaign) -> PaperComparison:
    """Read the runs of a campaign and set them beside the paper. Raises MrpSumoError when runs are missing or cannot be read."""
    studies = {name: read_study(campaign.results(name)) for name in SUITES if (campaign.results(name) / PLAN).exists()}
    maps, plans, driven, costs, times, single = (studies[name] for name in SUITES[:6])
    kinds = kinds_of(driven.frame)
    rows = {
        "table_1": beside.table_1(maps),
        "table_2": beside.table_2(plans),
        "table_3": beside.table_3(driven),
        "table_4": beside.table_4(costs),
        "figure_5": beside.figure_5(times),
        "replicability": beside.replicability(single, studies.get("replicability_five"), kinds),
    }
    order = beside.order(driven, costs)
    yielding = dict(beside.ways(driven)).get(YIELDING)
    one = plain_tables.table_1(maps)
    sections = [
        Section("maps", "Table I: maps", parts=[replace(one, title="Table I", note="")] if one else []),
        Section("planning", "Table II: planning", parts=[_table_2(rows["table_2"])]),
        Section("execution", "Table III: execution", parts=[*arrivals_charts(rows["table_3"]), _table_3(rows["table_3"])]),
        Section("times", "Figure 5: planning time", parts=[*figure_5(times), _figure_5(rows["figure_5"])]),
        Section("cost", "Table IV: makespan and cost", parts=[_table_4(rows["table_4"])]),
        Section("replicability", "Replicability", _kinds_in_words(kinds), [_replicability(rows["replicability"])]),
        Section("causes", "Why numbers differ", parts=[causes(studies, rows["table_3"], rows["table_2"])]),
        Section("order", "The order of the planners", parts=[_order(order)]),
        Section("blocked", "Execution and blocked time", parts=[*(execution_violins(yielding) if yielding else [])]),
    ]
    return PaperComparison(rows, order, sections)


def write_paper(campaign: Campaign, comparison: PaperComparison, made: Made) -> Path:
    """Write page, document, tables and figures into the folder of a campaign. Returns the page. Raises OSError as the system reports it."""
    for section in comparison.sections:
        for part in section.parts:
            write_part(campaign.folder, part)
    write_whole(campaign.folder / DOCUMENT, (json.dumps(_document(campaign, comparison, made), indent=1) + "\n").encode())
    write_whole(campaign.folder / MARKDOWN, _markdown(comparison.sections).encode())
    source = " ".join(numbers_of_paper()["source"].split())
    where = "MRP-Bench’s own maps" if campaign.maps else "our drawings of its maps"
    lead = f"{source}. Its numbers beside ours, on {where}; ours with intervals of 95 %."
    few = f"Only the first {campaign.num_seeds} seeds of every study were run: intervals are wide."
    gaps = [] if campaign.num_seeds is None else [few]
    about = [
        f"mrp_sumo {code_version()}, {', '.join(f'{name} {v}' for name, v in library_versions().items())}",
        f"Written by mrp-sumo {__version__}.",
    ]
    write_whole(campaign.folder / PAGE, page(TITLE, lead, _tiles(comparison, made), gaps, comparison.sections, about).encode())
    return campaign.folder / PAGE


def _document(campaign: Campaign, comparison: PaperComparison, made: Made) -> dict[str, Any]:
    return {
        "source": " ".join(numbers_of_paper()["source"].split()),
        "maps": "mrp_bench" if campaign.maps else "bundled",
        "num_seeds": campaign.num_seeds,
        "runs": made.num_runs,
        "runs_made": made.num_made,
        "seconds": round(made.seconds, 1),
        "code": code_version(),
        **{name: [row.document for row in rows] for name, rows in comparison.rows.items()},
        "order": [row.document for row in comparison.order],
    }


def _markdown(sections: Sequence[Section]) -> str:
    """The page as Markdown, without its head."""
    lines: list[str] = []
    for section in sections:
        lines += [f"### {section.title}", *([section.text] if section.text else [])]
        for part in section.parts:
            if isinstance(part, Chart):
                lines.append(f"![{part.title}](figures/{part.name}.svg)")
            else:
                lines += [part.without_empty().to_markdown().rstrip().replace("\\[", "[").replace("\\]", "]"), part.note]
    return "\n\n".join(line for line in lines if line) + "\n"


def _tiles(comparison: PaperComparison, made: Made) -> list[Tile]:
    agree = sum(bool(row.agrees) for row in comparison.compared)
    order = [row for row in comparison.order if row.paper_difference is not None]
    against = sum(row.verdict == "the other way round" for row in order)
    return [
        Tile("runs", f"{made.num_runs:,}"),
        Tile("of the paper's numbers in our intervals", f"{agree} of {len(comparison.compared)}"),
        Tile("pairs of planners in another order", f"{against} of {len(order)}", mood="bad" if against else "good"),
    ]


def arrivals_charts(rows: Sequence[BesidePaper]) -> list[Chart]:
    """Table III drawn, a chart for each map."""
    names = dict.fromkeys(row.labels["map"] for row in rows)
    return [
        arrivals_chart(name, [row for row in rows if row.labels["map"] == name and row.quantity == "overall_percent"]) for name in names
    ]


def _name(planner: str) -> str:
    return PLANNER_NAMES.get(planner, planner)


def _verdict(*rows: BesidePaper | None) -> str | None:
    """'yes' if the paper's numbers lie in our intervals, else 'no'; None: nothing can be said."""
    verdicts = [row.agrees for row in rows if row and row.agrees is not None]
    return None if not verdicts else "yes" if all(verdicts) else "no"


def _find(rows: Sequence[BesidePaper], quantity: str, **labels: Any) -> BesidePaper | None:
    return next((r for r in rows if r.quantity == quantity and all(r.labels.get(k) == v for k, v in labels.items())), None)


def _table_2(rows: Sequence[BesidePaper]) -> ReportTable:
    lines: list[list[Cell]] = []
    for row in rows:
        if " and " in row.labels["robots"]:
            of = [_find(rows, row.quantity, **{**row.labels, "robots": n}) for n in row.labels["robots"].split(" and ")]
            ours: list[Cell] = [row.ours.count, row.ours, *(r.ours.value if r else None for r in of)]
            lines.append([row.labels["map"], _name(row.labels["planner"]), *ours, row.paper_value, _verdict(row)])
    head = ("map", "planner", "runs", "ours %", "5 robots %", "9 robots %", "paper %", "paper in ours")
    note = "Any plan counts, valid or not, as in the paper. 54 seeds with 5 and 54 with 9 robots."
    return ReportTable("table_2", "Table II: experiments with a plan within 60 s", head, lines, note, labels=2, digits=_no_digits(head))


def _table_3(rows: Sequence[BesidePaper]) -> ReportTable:
    lines: list[list[Cell]] = []
    for row in rows:
        at = {key: row.labels[key] for key in ("map", "planner", "robots")}
        if row.labels["execution"] == YIELDING and row.quantity == "overall_percent" and " and " in at["robots"]:
            normalised = _find(rows, "normalised_percent", execution=YIELDING, **at)
            others = [_find(rows, "overall_percent", execution=how, **at) for how in (REPLANNING, ORDERED)]
            theirs = normalised.paper_value if normalised else None
            ours: list[Cell] = [row.ours.count, normalised.ours if normalised else None, theirs, row.ours, row.paper_value]
            lines.append(
                [at["map"], _name(at["planner"]), *ours, _verdict(normalised, row), *(other.ours if other else None for other in others)]
            )
    head = ("map", "planner", "runs", "normalised %", "paper %", "overall %", "paper %", "paper in ours", "then lacam %", "plan's order %")
    return ReportTable(
        "table_3",
        "Table III: experiments in which all robots reach their goals within 300 s",
        head,
        lines,
        "All robots at their goals, whatever the plan, as in the paper. Robots drive their paths first come, first served, and one of a "
        "ring that waits for each other gives way (normalised, overall). Then lacam: where that does not help, lacam plans anew. "
        "Plan's order: who is planned first passes first (adg); plans with conflicts have no order and are driven without one.",
        labels=2,
        digits=_no_digits(head),
    )


def _no_digits(head: Sequence[str]) -> dict[str, int]:
    """Shares in whole percent."""
    return {name: 0 for name in head if name.endswith("%")}


def _table_4(rows: Sequence[BesidePaper]) -> ReportTable:
    lines: list[list[Cell]] = []
    for planner in dict.fromkeys(row.labels["planner"] for row in rows):
        makespan, cost = (_find(rows, quantity, planner=planner) for quantity in ("makespan_cells", "cost_cells"))
        assert makespan and cost
        cells = [cell for row in (makespan, cost) for cell in (row.ours, row.paper_value)]
        lines.append([_name(planner), makespan.ours.count, *cells, _verdict(makespan, cost)])
    head = ("planner", "scenarios", "makespan cells", "paper's makespan", "cost cells", "paper's cost", "paper in ours")
    note = "Means over the scenarios that every planner solved within 600 s, in cells with the start included; the paper's over 39."
    return ReportTable("table_4", "Table IV: warehouse, 9 robots", head, lines, note, digits=dict.fromkeys(head[2:6], 1))


def _figure_5(rows: Sequence[BesidePaper]) -> ReportTable:
    lines: list[list[Cell]] = []
    for planner in dict.fromkeys(row.labels["planner"] for row in rows):
        mean, spread = (_find(rows, quantity, planner=planner) for quantity in ("mean_s", "standard_deviation_s"))
        assert mean and spread
        ms: list[Cell] = [None if value is None else 1e3 * value for value in mean.labels["five_numbers_s"] or [None] * 5]
        ms += [scaled(row.ours, 1e3) for row in (mean, spread)]
        solved = f"{mean.labels['solved']} of {mean.labels['scenarios']}"
        lines.append([_name(planner), solved, *ms, mean.paper_value, spread.paper_value])
    says: dict[str, list[str]] = {}
    for planner, what in numbers_of_paper()["figure_5"]["says"].items():
        says.setdefault(what, []).append(_name(planner))
    words = "; ".join(f"{' and '.join(planners)}: {what}" for what, planners in says.items())
    return ReportTable(
        "figure_5",
        "Figure 5: planning time, warehouse",
        ("planner", "solved", "least", "25 %", "median", "75 %", "longest ms", "mean ms", "deviation ms", "paper's mean s", "deviation s"),
        lines,
        f"17 scenarios with 5 robots and 17 with 9, limit 600 s. The paper draws its times; in its text it says: {words}.",
        labels=2,
        digits={"paper's mean s": 2, "deviation s": 2},
    )


def _replicability(rows: Sequence[BesidePaper]) -> ReportTable:
    lines: list[list[Cell]] = []
    for row in rows:
        if row.quantity != "success_percent":
            continue
        at = row.labels
        mean, spread, fastest = (_find(rows, quantity, **at) for quantity in ("mean_s", "standard_deviation_s", "fastest_s"))
        assert mean and spread and fastest
        name = "one robot, 45 cells of 0.35 m" if at["study"] == "one_robot" else f"{at['study']}: {at['robots']} robots, seed {at['seed']}"
        times: list[Cell] = [mean.ours, fastest.ours.value, fastest.paper_value, spread.ours, spread.paper_value]
        lines.append([name, _name(at.get("planner", "eecbs")), row.ours.count, row.ours, row.paper_value, *times])
    head = ("study", "planner", "runs", "arrived %", "paper %", "mean s", "fastest s", "paper s", "deviation s", "paper's deviation s")
    digits = {"arrived %": 0, "paper %": 0, "paper s": 0, "mean s": 1, "fastest s": 1, "deviation s": 2, "paper's deviation s": 1}
    return ReportTable(
        "replicability",
        "A hundred runs each, disturbed (nav2_like)",
        head,
        lines,
        "nav2_like is chosen so that one robot's times spread as in the paper, and used as it is in the others. "
        "Hard: a scenario that no planner's plan survives undisturbed; easy: one that most, or all, survive. Times: of runs that arrive.",
        labels=2,
        digits=digits,
    )


def _kinds_in_words(kinds: Kinds) -> str:
    counts = list(kinds.survivors.values())
    none, every = counts.count(0), counts.count(max(counts, default=0))
    return (
        f"Of {kinds.num_seeds} scenarios with {kinds.robots} robots on the warehouse, undisturbed, {none} survive with no planner's plan, "
        f"{every} with all, {len(counts) - none - every} with some."
    )


def _order(rows: Sequence[Ordered]) -> ReportTable:
    lines: list[list[Cell]] = []
    for row in rows:
        what = "Table III" if row.labels["table"] == "table_3" else "Table IV"
        quantity = {"overall_percent": "arrived %", "makespan_cells": "makespan cells", "cost_cells": "cost cells"}[row.labels["quantity"]]
        pair = [f"{what}, {row.labels['map']}, {quantity}", f"{_name(row.second)} less {_name(row.first)}"]
        p_value = f"{row.p_value:.2g}" if row.p_value >= 1e-4 else "< 0.0001"
        lines.append([*pair, row.difference.count, row.difference, p_value, row.paper_difference, row.verdict])
    return ReportTable(
        "order",
        "Two planners on the same runs",
        ("of", "pair", "runs", "difference", "p", "paper's", "verdict"),
        lines,
        "Differences of shares by McNemar's exact test, of means by Wilcoxon's signed-rank test; p is adjusted for the number of pairs "
        "(Holm). Table III with local yielding.",
        labels=2,
        folded=True,
        digits={"difference": 1, "paper's": 1},
    )
