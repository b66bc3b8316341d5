"""The page of a capacity study: the answer in a sentence, then the curve, what binds, what would help, and how to repeat it.

One HTML file without scripts that needs no network, in light and dark; printed, it is two sheets of A4. The same answer gives the same
bytes.
"""

import html
import json
from collections.abc import Sequence
from pathlib import Path

from mrp_sumo import __version__
from mrp_sumo.experiments.identity import library_versions
from mrp_sumo.io.results import write_whole
from mrp_sumo.reports.capacity.charts import floor, flow, parts, service, success, throughput
from mrp_sumo.reports.charts.chart import Chart
from mrp_sumo.reports.page import document
from mrp_sumo.reports.replay.page import write_replay
from mrp_sumo.sizing.answer import Answer, Gain
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

    Raises
    ------
    OSError
        As the system reports it.
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
        _tiles(answer),
        *_gaps(answer.notes),
        *(_lifelong(study, answer, replays) if answer.limits else _one_shot(answer)),
        *_confirmed(answer.confirmed),
        *_small_print(study, answer),
        "</main>",
    ]
    return document(f"{scenario.name}: how many robots fit", "mrp-sumo capacity", body, STYLE_SHEET)


def _lifelong(study: Study, answer: Answer, replays: Sequence[tuple[ReplayedRun, str]]) -> list[str]:
    reasons = answer.at_peak
    lines = [*(_charts([throughput(answer)]) if answer.points else []), *_table(answer)]
    if limit := answer.limit:
        lines += ["<h2>What binds</h2>", f"<p>{_text(_sentence(in_words(limit)))}</p>"]
    if reasons:
        if reasons.worst:
            lines.append(f"<p>With {reasons.robots} robot{'s' * (reasons.robots > 1)} most time is lost to:</p>")
            lines.append('<ol class="places">' + "".join(f"<li>{_text(in_words(place))}</li>" for place in reasons.worst) + "</ol>")
        lines += _charts([parts(answer.points), floor(study.setup, reasons)])
    if replays:
        links = (f'<a href="{_text(path)}#t={run.at_s:.0f}">at the {run.name}, {run.robots} robots</a>' for run, path in replays)
        lines.append(f"<p>Replays, from the slowest minute on: {', '.join(links)}.</p>")
    if answer.points:
        lines.append('<h2 class="second">How it got there</h2>')
        lines += _charts([chart for chart in (service(answer), flow(answer.points)) if chart])
    if answer.gains:
        lines += ["<h2>What would help</h2>", *_help(answer.gains, reasons.robots if reasons else 0)]
    return lines


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _table(answer: Answer) -> list[str]:
    """The curve in figures: every size that was tried, also those that do not count."""
    rows = []
    for row in answer.document["answer"]["curve"]:
        limits = f"{row['low']:.0f} to {row['high']:.0f}" if row["low"] is not None and row["high"] is not None else ""
        per_h = f"{row['throughput_per_h']:.0f}" if row["throughput_per_h"] is not None else ""
        cells = (row["robots"], per_h, limits, row["replications"], f"{100 * row['unanswered_share']:.1f} %")
        numbers = "".join(f"<td class=number>{cell}</td>" for cell in cells)
        rows.append(
            f"<tr>{numbers}<td>{_text(_named(answer, row['robots']) if row['counts'] else 'not counted: ' + row['why_not'])}</td></tr>"
        )
    names = ("robots", "orders an hour", "95 % limits", "runs", "requests without a plan")
    head = "".join(f"<th class=number>{name}</th>" for name in names)
    return [f'<div class="scroll"><table class="help"><thead><tr>{head}<th></th></tr></thead><tbody>{"".join(rows)}</tbody></table></div>']


def _named(answer: Answer, robots: int) -> str:
    """What the answer calls a size."""
    assert answer.limits is not None
    limits = answer.limits
    named = (("knee", limits.knee), ("peak", limits.peak), ("collapse", limits.collapse))
    return ", ".join(name for name, bracket in named if bracket.estimate == robots)


def _one_shot(answer: Answer) -> list[str]:
    return _charts([success(answer)]) if answer.points else []


def _tiles(answer: Answer) -> str:
    limits, served = answer.limits, answer.served
    cells: list[tuple[str, str, str]] = []
    if limits:
        best = limits.curve.points[limits.curve.best].throughput if limits.curve.points else None
        cells.append(("most throughput", _bracketed(limits.peak), f"{best.value:.0f} orders an hour" if best else ""))
        cells.append(("95 % of it (knee)", _bracketed(limits.knee), ""))
        cells.append(("throughput falls (collapse)", _bracketed(limits.collapse), ""))
        if served:
            sheet = f"a planning sheet says {answer.spreadsheet:.0f}" if answer.spreadsheet else ""
            cells.append((f"for {answer.question.demand_per_h:.0f} orders an hour", _bracketed(served.smallest), sheet))
    elif served:
        cells.append(("largest fleet that succeeds", _bracketed(served.smallest), ""))
    tiles = (
        f"<div><dt>{_text(name)}</dt><dd>{_text(value)}{f' <small>{_text(detail)}</small>' if detail else ''}</dd></div>"
        for name, value, detail in cells
    )
    return f'<dl class="tiles">{"".join(tiles)}</dl>'


def _bracketed(bracket: Bracket) -> str:
    """An interval, and its best guess where they differ."""
    if bracket.estimate is None:
        return "not found" if bracket.low is None else f"above {bracket.low - 1}" if bracket.high is None else "not found"
    low, high = bracket.low, bracket.high
    if low is None and high is None:
        return f"{bracket.estimate} robot{'s' * (bracket.estimate > 1)}"
    span = f"{low} or more" if high is None else f"up to {high}" if low is None else f"{low} to {high}" if low < high else f"{low}"
    return f"{span} robot{'s' * (span != '1')}"


def _gaps(notes: Sequence[str]) -> list[str]:
    return ['<ul class="gaps">' + "".join(f"<li>{_text(note)}</li>" for note in notes) + "</ul>"] if notes else []


def _help(gains: Sequence[Gain], robots: int) -> list[str]:
    rows = []
    for gain in gains:
        if gain.share is None:
            rows.append(f'<tr><th><code>{_text(gain.change)}</code></th><td colspan="4">cannot be: {_text(gain.refusal)}</td></tr>')
            continue
        mean, base = gain.difference.difference, gain.difference.first
        limits = f"{100 * mean.low / base:+.0f} to {100 * mean.high / base:+.0f} %" if base else ""
        verdict = "not certain" if gain.p_value >= 0.05 else "helps" if mean.value > 0 else "does harm"
        rows.append(
            f"<tr><th><code>{_text(gain.change)}</code></th><td class=number>{100 * gain.share:+.1f} %</td><td class=number>{limits}</td>"
            f"<td class=number>{mean.value:+.1f}</td><td>{verdict}</td></tr>"
        )
    numbers = "".join(f"<th class=number>{name}</th>" for name in ("throughput", "95 % limits", "orders an hour"))
    head = f"<tr><th>change</th>{numbers}<th></th></tr>"
    return [
        f"<p>Each change alone, with {robots} robots, on the same orders as without it. Verdicts allow for how many were tried.</p>",
        f'<div class="scroll"><table class="help"><thead>{head}</thead><tbody>{"".join(rows)}</tbody></table></div>',
    ]


def _confirmed(sizes: Sequence[Confirmation]) -> list[str]:
    if not sizes:
        return []
    rows = []
    for size in sizes:
        mean, share = size.difference.difference, size.measure != "throughput_per_h"
        names = {"throughput_per_h": "orders an hour", "on_time": "orders on time", "succeeded": "draws that succeed"}

        def shown(value: float, sign: str = "", share: bool = share) -> str:
            return f"{100 * value:{sign}.1f} %" if share else f"{value:{sign}.1f}"

        rows.append(
            f"<tr><th>{_text(size.name)}, {size.robots} robots</th><td>{names[size.measure]}</td>"
            f"<td class=number>{shown(size.difference.first)}</td><td class=number>{shown(size.difference.second)}</td>"
            f"<td class=number>{shown(mean.low, '+')} to {shown(mean.high, '+')}</td><td>{'yes' if size.agrees else 'no'}</td></tr>"
        )
    numbers = "".join(f"<th class=number>{name}</th>" for name in ("kinematic", "SUMO", "95 % limits of the difference"))
    head = f"<tr><th></th><th></th>{numbers}<th>agree</th></tr>"
    return [
        "<h2>Confirmed in SUMO</h2>",
        "<p>The sizes that the answer names, driven by both engines on the same orders.</p>",
        f'<div class="scroll"><table class="help"><thead>{head}</thead><tbody>{"".join(rows)}</tbody></table></div>',
    ]


def _small_print(study: Study, answer: Answer) -> list[str]:
    question, scenario = answer.question, study.question.file.scenario
    effort, setup = question.effort, study.setup
    points = answer.points
    robot = setup.problem.fleet
    kind = setup.scenario.discretisation
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
        rows.append(
            ("always work waiting", f"{BACKLOG:g} orders a robot are open, in the scenario's mix; starts are drawn anywhere on the map")
        )
        rows.append(("warm-up left out", f"by MSER-5, minutes for each number of robots: {warm}"))
        rows.append(("runs of each number of robots", ", ".join(f"{point.robots}: {len(point.records)}" for point in points)))
        rows.append(("limits", "95 %, Student's, over runs with seeds of their own; fleets are compared on the same seeds"))
    rows += [
        (
            "budget",
            f"{answer.spent_s / 60:.1f} of {effort.budget_s / 60:g} min on {CORES} cores, as predicted, so that it buys the same anywhere",
        ),
        ("versions", ", ".join([f"mrp_sumo {__version__}", *(f"{name} {v}" for name, v in library_versions().items())])),
        ("to repeat it", question.command),
    ]
    table = "".join(f"<tr><th>{_text(name)}</th><td>{_text(value)}</td></tr>" for name, value in rows)
    return ["<h2>Small print</h2>", f'<div class="small"><div class="scroll"><table><tbody>{table}</tbody></table></div></div>']


def _charts(charts: Sequence[Chart]) -> list[str]:
    figures = [
        f'<figure{" class=wide" if chart.wide else ""}>\n<h3 id="{chart.name}-title">{_text(chart.title)}</h3>\n'
        f'<div class="scroll">{chart.on_page()}</div>\n<figcaption>{_text(chart.caption)}</figcaption>\n</figure>'
        for chart in charts
    ]
    return ['<div class="charts">', *figures, "</div>"]


def _text(text: str) -> str:
    return html.escape(text)
