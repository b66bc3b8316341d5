"""The page of a capacity study: the answer in a sentence, then the curve, what binds, what would help, and how to repeat it.

One HTML file without scripts that needs no network, in light and dark; printed, it is two sheets of A4. The same answer gives the same
bytes.
"""

import html
import json
import math
from collections.abc import Sequence
from pathlib import Path

from mrp_sumo import __version__
from mrp_sumo.experiments.identity import library_versions
from mrp_sumo.files.writing import write_whole
from mrp_sumo.reports.capacity.charts import floor, flow, parts, service, success, throughput
from mrp_sumo.reports.page import Tile, chart_row, document, gap_list, grid, rows_of, tile_list
from mrp_sumo.reports.replay.page import write_replay
from mrp_sumo.sizing.answer import Answer, Gain
from mrp_sumo.sizing.bands import Bands
from mrp_sumo.sizing.confirmation import Confirmation
from mrp_sumo.sizing.question import BACKLOG, CORES
from mrp_sumo.sizing.reasons import in_words
from mrp_sumo.sizing.replays import ReplayedRun
from mrp_sumo.sizing.search import Bracket
from mrp_sumo.sizing.study import Study

PAGE, DOCUMENT = "capacity.html", "answer.json"
STYLE_SHEET = Path(__file__).with_name("page.css")


def write_capacity_page(study: Study, answer: Answer, folder: Path, made: Sequence[ReplayedRun] = ()) -> Path:
    """Write the page, and the answer as JSON, into the folder of a study; replay pages of the runs that are kept, which it links.

    Raises OSError as the system reports it.
    """
    write_whole(folder / DOCUMENT, (json.dumps(answer.document, indent=2) + "\n").encode())
    replays = [(run, write_replay(run.folder).relative_to(folder).as_posix()) for run in made]
    write_whole(folder / PAGE, capacity_page(study, answer, replays).encode())
    return folder / PAGE


def capacity_page(study: Study, answer: Answer, replays: Sequence[tuple[ReplayedRun, str]] = ()) -> str:
    """The whole page; `replays` are kept runs and where their replay pages are, seen from here."""
    scenario = study.question.file.scenario
    body = [
        f'<header><p class="question">How many robots fit? {_text(scenario.name)}</p><h1>{_text(answer.sentence)}</h1></header>',
        "<main>",
        tile_list(_tiles(answer)),
        gap_list([note for note in answer.notes if not (answer.limits and note in answer.notes_of_curve)]),  # the table has these
        *(_lifelong(study, answer, replays) if answer.limits else chart_row([success(answer)]) if answer.points else []),
        *(_bands(answer.bands) if answer.bands else []),
        *_confirmed(answer.confirmed),
        *_small_print(study, answer),
        "</main>",
    ]
    return document(f"{scenario.name}: how many robots fit", "mrp-sumo capacity", body, STYLE_SHEET)


def _lifelong(study: Study, answer: Answer, replays: Sequence[tuple[ReplayedRun, str]]) -> list[str]:
    reasons = answer.at_peak
    lines = [*(chart_row([throughput(answer)]) if answer.points else []), *_table(answer)]
    if limit := answer.limit:
        words = in_words(limit, study.nav)
        is_listed = bool(reasons and reasons.worst and in_words(reasons.worst[0], study.nav) == words)
        lines += ["<h2>What binds</h2>", *([] if is_listed else [f"<p>{_text(words[0].upper() + words[1:])}.</p>"])]
    if reasons:
        if reasons.worst:
            lines.append(f"<p>With {reasons.robots} robot{'s' * (reasons.robots > 1)} most time is lost to:</p>")
            lines.append(
                '<ol class="places">' + "".join(f"<li>{_text(in_words(place, study.nav))}</li>" for place in reasons.worst) + "</ol>"
            )
        lines += chart_row([parts(answer.points), floor(study.setup, reasons)])
    if replays:
        links = (f'<a href="{_text(path)}#t={run.at_s:.0f}">at the {run.name}, {run.robots} robots</a>' for run, path in replays)
        lines.append(f"<p>Replays, from the slowest minute on: {', '.join(links)}.</p>")
    if answer.points:
        lines.append('<h2 class="second">How it got there</h2>')
        lines += chart_row([chart for chart in (service(answer), flow(answer.points)) if chart])
    if answer.gains:
        lines += ["<h2>What would help</h2>", *_help(answer.gains, reasons.robots if reasons else 0)]
    return lines


def _table(answer: Answer) -> list[str]:
    """The curve in figures: every size that was tried, also those that do not count."""
    rows = []
    for row in answer.document["answer"]["curve"]:
        limits = f"{row['low']:.0f} to {row['high']:.0f}" if row["low"] is not None and row["high"] is not None else ""
        per_h = f"{row['throughput_per_h']:.0f}" if row["throughput_per_h"] is not None else ""
        word = _named(answer, row["robots"]) if row["counts"] else "not counted: " + row["why_not"]
        rows.append((f"{row['robots']}", per_h, limits, f"{row['replications']}", f"{100 * row['unanswered_share']:.1f} %", _text(word)))
    head = ("robots", "orders an hour", "95 % limits", "runs", "requests without a plan", "")
    return [grid(head, rows_of(rows, range(5)), range(5))]


def _named(answer: Answer, robots: int) -> str:
    assert answer.limits is not None
    limits = answer.limits
    named = (("knee", limits.knee), ("peak", limits.peak), ("collapse", limits.collapse))
    return ", ".join(name for name, bracket in named if bracket.estimate == robots)


def _tiles(answer: Answer) -> list[Tile]:
    limits, served = answer.limits, answer.served
    if not limits:
        return [Tile("largest fleet that succeeds", _bracketed(served.smallest))] if served else []
    best = limits.curve.points[limits.curve.best].throughput if limits.curve.points else None
    tiles = [
        Tile("most throughput", _bracketed(limits.peak), f"{best.value:.0f} orders an hour" if best else ""),
        Tile("95 % of it (knee)", _bracketed(limits.knee)),
        Tile("throughput falls (collapse)", _bracketed(limits.collapse)),
    ]
    if served:
        sheet = f"a planning sheet says {answer.spreadsheet:.0f}" if answer.spreadsheet else ""
        tiles.append(Tile(f"for {answer.question.demand_per_h:.0f} orders an hour", _bracketed(served.smallest), sheet))
    return tiles


def _bracketed(bracket: Bracket) -> str:
    """An interval, and its best guess where they differ."""
    if bracket.estimate is None:
        return "not found" if bracket.low is None else f"{bracket.low} or more" if bracket.high is None else "not found"
    low, high = bracket.low, bracket.high
    if low is None and high is None:
        return f"{bracket.estimate} robot{'s' * (bracket.estimate > 1)}"
    span = f"{low} or more" if high is None else f"up to {high}" if low is None else f"{low} to {high}" if low < high else f"{low}"
    return f"{span} robot{'s' * (span != '1')}"


def _help(gains: Sequence[Gain], robots: int) -> list[str]:
    rows = []
    for gain in gains:
        change = f"<code>{_text(gain.change)}</code>"
        if gain.share is None:
            rows.append(f'<tr><th>{change}</th><td colspan="4">cannot be: {_text(gain.refusal)}</td></tr>')
            continue
        mean, base = gain.difference.difference, gain.difference.first
        limits = f"{100 * mean.low / base:+.0f} to {100 * mean.high / base:+.0f} %" if base else ""
        verdict = "not certain" if gain.p_value >= 0.05 else "helps" if mean.value > 0 else "does harm"
        rows.append(rows_of([(change, f"{100 * gain.share:+.1f} %", limits, f"{mean.value:+.1f}", verdict)], (1, 2, 3)))
    return [
        f"<p>Each change alone, with {robots} robots, on the same orders as without it. Verdicts allow for how many were tried.</p>",
        grid(("change", "throughput", "95 % limits", "orders an hour", ""), "".join(rows), (1, 2, 3)),
    ]


def _bands(bands: Bands) -> list[str]:
    rows = []
    for effect in bands.effects:
        share = 100 / as_is if (as_is := bands.throughput_per_h.value) > 0 else math.nan
        change, (_, low, high) = effect.change, effect.quantity.ends[0]
        limits = f"{share * change.low:+.0f} to {share * change.high:+.0f} %"
        spans = f"{low:.3g} to {high:.3g}" + ("" if effect.quantity.is_given else " (assumed)")
        rows.append((_text(effect.quantity.name), spans, f"{share * change.value:+.1f} %", limits, "" if effect.is_sure else "not certain"))
    return [
        "<h2>How sure the figures are</h2>",
        f"<p>{_text(bands.sentence)}</p>",
        f"<p>What the throughput of {bands.robots} robots gains as each quantity goes from the low end of its interval to the high one. "
        "Speeds, accelerations and times at stations are factors on those of the scenario.</p>",
        grid(("", "from, to", "throughput", "95 % limits", ""), rows_of(rows, (1, 2, 3)), (1, 2, 3)),
    ]


def _confirmed(sizes: Sequence[Confirmation]) -> list[str]:
    if not sizes:
        return []
    rows = []
    names = {"throughput_per_h": "orders an hour", "on_time": "orders on time", "succeeded": "draws that succeed"}
    for size in sizes:
        mean, share = size.difference.difference, size.measure != "throughput_per_h"
        means = [f"{100 * value:.1f} %" if share else f"{value:.1f}" for value in (size.difference.first, size.difference.second)]
        limits = " to ".join(f"{100 * value:+.1f} %" if share else f"{value:+.1f}" for value in (mean.low, mean.high))
        fleet = f"{_text(size.name)}, {size.robots} robots"
        rows.append((fleet, names[size.measure], *means, limits, "yes" if size.agrees else "no"))
    head = ("", "", "kinematic", "SUMO", "95 % limits of the difference", "agree")
    return [
        "<h2>Confirmed in SUMO</h2>",
        "<p>The sizes that the answer names, driven by both engines on the same orders.</p>",
        grid(head, rows_of(rows, (2, 3, 4)), (2, 3, 4)),
    ]


def _small_print(study: Study, answer: Answer) -> list[str]:
    question, scenario, setup, points = answer.question, study.question.file.scenario, study.setup, answer.points
    effort, robot, kind = question.effort, setup.problem.fleet, setup.scenario.discretisation
    runs = sum(len(point.records) for point in points)
    seeds = answer.document["answer"]["seeds"]
    rows = [
        ("map", f"{scenario.map.file}, {kind.kind} of {kind.cell_m:g} m cells"),
        ("robots", f"{', '.join(each.type if isinstance(each.type, str) else 'of their own type' for each in scenario.robots.groups)}, "
                   f"{2 * float(robot.radius_m.max()):.2f} m across, up to {float(robot.max_speed_mps.max()):.2f} m/s"),
        ("planner and policy", f"{answer.planner}, {scenario.execution.policy.name}"
                               + (f", dispatcher {scenario.execution.dispatcher.name or 'nearest'}" if scenario.tasks else "")),
        ("engine", question.engine),
        ("runs", f"{runs} of {effort.horizon_s / 60:.0f} simulated minutes, seeds {seeds[0]} to {seeds[-1]}; equal orders for every fleet"
                 if seeds else "none"),
    ]  # fmt: skip
    if scenario.tasks:
        warm = ", ".join(f"{point.robots}: {point.warm_up_s / 60:.0f}" for point in points)
        rows += [
            ("always work waiting", f"{BACKLOG:g} orders a robot are open, in the scenario's mix; starts are drawn anywhere on the map"),
            ("warm-up left out", f"by MSER-5, minutes for each number of robots: {warm}"),
            ("runs of each number of robots", ", ".join(f"{point.robots}: {len(point.records)}" for point in points)),
            ("limits", "95 %, Student's, over runs with seeds of their own; fleets are compared on the same seeds"),
        ]
    spent = f"{answer.spent_s / 60:.1f} of {effort.budget_s / 60:.3g} min on {CORES} cores"
    rows += [
        ("budget", f"{spent}, as predicted, so it buys the same anywhere"),
        ("versions", ", ".join([f"mrp_sumo {__version__}", *(f"{name} {v}" for name, v in library_versions().items())])),
        ("to repeat it", question.command),
    ]
    table = rows_of([(_text(name), _text(value)) for name, value in rows])
    return ["<h2>Small print</h2>", f'<div class="small"><div class="scroll"><table><tbody>{table}</tbody></table></div></div>']


def _text(text: str) -> str:
    return html.escape(text)
