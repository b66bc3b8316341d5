"""`mrp-sumo report`: a page about runs, its figures as SVG and PNG, its tables as CSV, Markdown and LaTeX.

    OUT/index.html               stands alone, needs no network
    OUT/figures/<name>.svg .png
    OUT/tables/<name>.csv .md .tex

Written beside its place and renamed when complete. The same results give the same bytes. Replaces reports
only: anything else in the way is refused.
"""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from mrp_sumo import __version__
from mrp_sumo.core.task import some_tasks
from mrp_sumo.errors import BatchError, MrpSumoError
from mrp_sumo.files.writing import new_folder, writing_to
from mrp_sumo.io.remedy import remedy
from mrp_sumo.io.run_reader import RunFolder
from mrp_sumo.reports.answer import answer
from mrp_sumo.reports.charts.chart import Chart, file_name
from mrp_sumo.reports.charts.run_charts import run_charts
from mrp_sumo.reports.charts.study_charts import study_charts
from mrp_sumo.reports.page import GENERATOR, Section, Tile, page
from mrp_sumo.reports.paper.charts import execution_violins, figure_5
from mrp_sumo.reports.paper.tables import table_1, table_2, table_3, table_4
from mrp_sumo.reports.study import ReportedRuns, read_study, short_key
from mrp_sumo.reports.tables import study_tables
from mrp_sumo.reports.tables.table import Cell, FileLink, ReportTable, whole

INDEX = "index.html"
MAX_RUNS = 4  # of a batch whose charts are drawn one by one
MANY_SERIES = 12


def write_report(source: Path, out: Path | None = None) -> Path:
    """Write the report of a batch, a run, run folders or a `results.parquet`; into `report` within it by default. Returns the page.

    Raises MrpSumoError when there is nothing to report on, or `out` holds something else, or cannot be written.
    """
    study = read_study(source)
    if out is None:
        out = (source if source.is_dir() else source.parent) / "report"
    out = out.resolve()
    _check_replaceable(out)
    one = len(study.frame) == 1 and len(study.folders) == 1
    with writing_to(out, BatchError), new_folder(out) as new:  # before anything is drawn: it may be refused
        title, sections = _of_run(study, out) if one else _of_study(study, out)
        text = page(title, study.description, _tiles(study, one), study.gaps, sections, _about(study), "" if one else answer(study))
        for section in sections:
            for part in section.parts:
                write_part(new, part)
        (new / INDEX).write_text(text, encoding="utf-8")
    return out / INDEX


def _of_study(study: ReportedRuns, out: Path) -> tuple[str, list[Section]]:
    charts, is_driven = study_charts(study), study.is_executed
    many = f"Charts show the first {MANY_SERIES} of {len(study.series)} series; the tables hold all." * (len(study.series) > MANY_SERIES)
    plans = "These runs end with the plan: they were not driven." * (study.is_planned and not is_driven)

    def section(name: str, title: str, *tables: ReportTable | None, more: Sequence[Chart] = (), **look: Any) -> Section:
        return Section(name, title, parts=[*charts.get(name, []), *more, *_there(*tables)], **look)

    # what is folded is not about how robots drove, the question; what is open fits on three screens
    return study.name, [
        section("overview", "Overview", study_tables.capacity(study), study_tables.statuses(study), study_tables.reasons(study), text=many),
        section("success", "Success", table_3(study), text=plans),
        section("planning", "Planning", table_2(study), more=figure_5(study), is_folded=is_driven),
        section("cost", "Cost", table_4(study), is_folded=is_driven),
        section("execution", "Execution", study_tables.main_figures(study), more=execution_violins(study)),
        section("tasks", "Orders"),
        section("compared", "Compared", study_tables.paired(study)),
        section("maps", "Maps", table_1(study), is_folded=True),
        section("runs", "Runs", study_tables.worst_runs(study, out), is_folded=True),
        *_kept_runs(study),
    ]


def _kept_runs(study: ReportedRuns) -> list[Section]:
    """Sections about run folders that are kept with the results, the worst first."""
    keys = [str(k) for k in study.frame["key"]] if "key" in study.frame else []
    drawn = [k for k in keys if k in study.folders]
    blocked = dict(zip(keys, study.frame["time_blocked_total_s"].to_numpy(np.float64, na_value=0.0)))
    succeeded = dict(zip(keys, study.frame["_succeeded"]))
    chosen = sorted(drawn, key=lambda k: (bool(succeeded[k]), -blocked[k], k))[:MAX_RUNS]
    sections = []
    for n, key in enumerate(chosen, 2):
        run, tag = study.folders[key], f"run_{n}_{file_name(key)[:24]}"
        text = f"{run.result['status'].replace('_', ' ')}. {run.result.get('note', '')}".strip()
        parts: list[ReportTable | Chart] = []
        try:
            parts += run_charts(run, tag)
        except MrpSumoError as error:
            text = f"{text} Cannot be drawn: {error}"
        sections.append(Section(tag, _title_of(study, key), text, parts, is_folded=True))
    return sections


def _title_of(study: ReportedRuns, key: str) -> str:
    """What a run is, in words: "office, 9 robots, CBS, seed 3004"."""
    if short_key(key) == key:  # a folder that somebody named
        return f"Run {key}"
    row = study.frame.iloc[list(study.frame["key"]).index(key)]
    seed = "" if pd.isna(row["seed"]) else f", seed {int(row['seed'])}"
    return f"{row['_map']}, {whole(row['_robots'])} robots, {row['_series']}{seed}"


def _of_run(study: ReportedRuns, out: Path) -> tuple[str, list[Section]]:
    (run,) = study.folders.values()
    robots: list[list[Cell]] = [
        [str(r["name"]), _known_as(run, r["start"]), _known_as(run, r["goal"]), r["goal_s"]]
        for r in run.result.get("robots", ())
        if isinstance(r, dict)
    ]
    if run.metrics.get("tasks_done") is not None:  # nobody has a goal of its own
        robots = []
    metrics = [[k, _cell(v)] for k, v in run.metrics.items() if not isinstance(v, list)]
    head, digits = ("robot", "start", "goal", "at its goal s"), {"at its goal s": 1}
    tables = _there(
        ReportTable("metrics", "Metrics", ("metric", "value"), metrics, folded=True),
        ReportTable("robots", "Robots", head, robots, folded=len(robots) > 30, digits=digits),
        *_task_tables(run),
    )
    note = str(run.result.get("note", ""))
    if bands := run.result.get("error_bands"):
        note = f"{note} {bands['sentence']}".strip()
    if (replay := run.folder / "replay.html").is_file():
        link = FileLink("Replay", Path(os.path.relpath(replay.resolve(), out)).as_posix())
        tables.append(ReportTable("replay", "Replay", ("page",), [[link]], labels=0))
    charts: list[ReportTable | Chart] = list(run_charts(run))
    if not charts:
        note = f"{note} The run was not driven ({run.result['status'].replace('_', ' ')}), so there is nothing to draw.".strip()
    return study.name, [Section("run", "The run", note, charts), Section("numbers", "Numbers", parts=tables)]


def _known_as(run: RunFolder, label: Any) -> str:
    """The name by which people know a vertex that a file names."""
    vertex = run.graph.vertex_of_name.get(str(label))
    return str(label) if vertex is None else run.graph.known_as(vertex)


def _task_tables(run: RunFolder) -> Iterator[ReportTable]:
    if run.metrics.get("tasks_done") is None or (tasks := run.record.execution.tasks) is None:
        return
    for name, title, word, wanted in (
        ("tasks", "Orders", "order", tasks.is_order),
        ("charges", "Charging", "charge", ~tasks.is_order),
    ):
        some = some_tasks(tasks, wanted)
        times = [
            [None if np.isnan(t) else float(t) for t in column] for column in (some.released_s, some.assigned_s, some.opened_s, some.done_s)
        ]
        robots = ["" if r < 0 else run.fleet.robot_name[r] for r in some.robot.tolist()]
        rows: list[list[Cell]] = [list(row) for row in zip(some.name, robots, *times, some.status, some.reason)]
        head = (word, "robot", "released s", "assigned s", "opened s", "done s", "status", "reason")
        if rows or word == "order":
            yield ReportTable(name, title, head, rows, labels=2, folded=len(rows) > 30, digits=dict.fromkeys(head[2:6], 1))


def _tiles(study: ReportedRuns, one: bool) -> list[Tile]:
    frame = study.frame
    if one:
        return _run_tiles(study)
    tiles = [Tile("runs", f"{len(frame):,}")]
    names = [study.maps, study.series]
    tiles += [Tile(word, str(len(of))) for word, of in zip(("maps", "planners and variants"), names) if len(of) > 1]
    if not study.is_planned:
        return tiles
    planned = float(frame["_valid"].mean())
    tiles.append(Tile("valid plans", f"{100 * planned:.1f} %", mood="good" if planned > 0.95 else ""))
    if study.is_executed:
        share = float(frame["_succeeded"].mean())
        tiles.append(Tile("succeeded: valid plan, all robots at their goals", f"{100 * share:.1f} %", mood="good" if share > 0.95 else ""))
        overlaps = frame["num_overlaps"].fillna(0).to_numpy(np.float64) > 0
        if frame["num_overlaps"].notna().any():
            tiles.append(Tile("runs in which robots overlapped", f"{int(overlaps.sum()):,}", mood="bad" if overlaps.any() else "good"))
    return tiles


def _run_tiles(study: ReportedRuns) -> list[Tile]:
    row, (run,) = study.frame.iloc[0], study.folders.values()
    to_change, chosen = remedy(run.result), (run.result.get("planner") or {}).get("chosen")  # by `auto`
    tiles = [
        Tile(
            "status",
            str(row["status"]).replace("_", " "),
            f"to change: {to_change}" if to_change else "",
            mood="good" if row["_succeeded"] else "bad",
        ),
        Tile("map", str(row["_map"])),
        Tile("robots", "–" if pd.isna(row["_robots"]) else str(int(row["_robots"]))),
        Tile("planner", str(row["_series"]), f"chose {chosen}" if chosen else ""),
    ]
    for label, column, scale, unit in (
        ("planning time", "planning_time_s", 1e3, "ms"),
        ("planning time, CPU", "planning_cpu_s", 1e3, "ms"),
        ("planned makespan", "makespan_s", 1, "s"),
        ("driven makespan", "driven_makespan_s", 1, "s"),
        ("blocked, all robots", "blocked_s", 1, "s"),
        ("least clearance", "min_clearance_m", 100, "cm"),
        ("orders done an hour", "throughput_per_h", 1, ""),
        ("mean lead time of orders", "lead_time_mean_s", 1, "s"),
        ("lead time, 95 % below", "lead_time_p95_s", 1, "s"),
        ("way saved by bundling orders", "bundled_saved_share", 100, "%"),
    ):
        if column in row and not pd.isna(row[column]):
            tiles.append(Tile(label, f"{scale * float(row[column]):.1f}", unit))
    return tiles


def _about(study: ReportedRuns) -> list[str]:
    lines = []
    for column, word in (("code", "mrp_sumo"), ("libsumo", "SUMO"), ("machine", "Made on")):
        if column in study.frame:
            values = list(dict.fromkeys(map(str, study.frame[column].dropna())))
            if values:
                lines.append(f"{word} {'; '.join(values[:4])}{' and others' if len(values) > 4 else ''}")
    lines.append(f"Written by mrp-sumo {__version__}. Colours after Okabe and Ito; intervals are of 95 %.")
    return lines


def _there(*tables: ReportTable | None) -> list[ReportTable | Chart]:
    return [t.without_empty() for t in tables if t is not None and t.rows]


def _cell(value: Any) -> Cell:
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    return value if isinstance(value, int) else float(value)


def write_part(folder: Path, part: ReportTable | Chart) -> None:
    """Write a figure or a table in all its forms into `figures` or `tables` of a folder."""
    if isinstance(part, Chart):
        files: dict[str, bytes] = {f"figures/{part.name}.svg": part.svg, f"figures/{part.name}.png": part.png}
    else:
        texts = {"csv": part.to_csv(), "md": part.to_markdown(), "tex": part.to_latex()}
        files = {f"tables/{part.name}.{kind}": text.encode() for kind, text in texts.items()}
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def _check_replaceable(out: Path) -> None:
    """Refuse to replace anything but a report."""
    if out.is_file():
        raise MrpSumoError(f"{out}: is a file, expected a folder for the report")
    if out.is_dir() and any(out.iterdir()):
        try:
            with (out / INDEX).open(encoding="utf-8") as file:
                ours = GENERATOR in file.read(2000)
        except (OSError, ValueError):
            ours = False
        if not ours:
            raise MrpSumoError(f"{out}: is not empty and not a report, so it is not replaced; choose another --out")
