"""Run the MRP-Bench paper's studies and write docs/paper.md: our Tables I to IV and Figure 5 beside the paper's.

    python tools/paper_page.py --out runs/paper [--map-folder MRP_BENCH] [--workers N]

Runs the bundled suites of Tables I to III (Table IV and Figure 5 are of the runs of Table II) on the bundled maps and, with the path
of an MRP-Bench checkout, on its maps. Started again, it goes on where it was. Of docs/paper.md only what stands
between the lines `<!-- table ... -->` and `<!-- end -->` is written anew.
"""

import argparse
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from mrp_sumo.reports.charts.chart import Chart
from mrp_sumo.reports.paper import commonly_solved, execution_violins, figure_5, table_1, table_2, table_3, table_4
from mrp_sumo.reports.study import Study, read_study
from mrp_sumo.reports.tables.table import Table

PROJECT = Path(__file__).resolve().parents[1]
PAGE = PROJECT / "docs" / "paper.md"
STUDIES = ("paper_table_1", "paper_table_2", "paper_table_3")
MRP_BENCH = {"office": "office", "warehouse": "warehouse", "airport": "airport_terminal"}  # our map -> file of theirs
BUNDLED, THEIRS = "bundled", "mrp_bench"


def main() -> None:
    """Run what is not there yet, then write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the results")
    parser.add_argument("--map-folder", type=Path, metavar="DIR", help="an MRP-Bench checkout, or a folder with its *.building.yaml files")
    parser.add_argument("--workers", type=int, default=2, metavar="N")
    parser.add_argument("--only-write", action="store_true", help="run nothing, write the page of what is there")
    options = parser.parse_args()
    maps = {BUNDLED: None} | ({THEIRS: _maps_in(options.map_folder)} if options.map_folder else {})
    options.out.mkdir(parents=True, exist_ok=True)
    if not options.only_write:
        for study in STUDIES:
            for origin, files in maps.items():
                _run(study, files, options.out / f"{origin}_{study}", options.workers)
    blocks: dict[str, str] = {}
    for origin in (BUNDLED, THEIRS):
        blocks |= _blocks(options.out, origin)
    _write(blocks)


def _maps_in(folder: Path) -> dict[str, str]:
    """Files of MRP-Bench's maps by our names."""
    found = {}
    for ours, theirs in MRP_BENCH.items():
        files = sorted(folder.rglob(f"{theirs}.building.yaml"))
        if not files:
            sys.exit(f"{folder}: there is no {theirs}.building.yaml in it")
        found[ours] = str(files[0].resolve())
    return found


def _run(study: str, maps: dict[str, str] | None, out: Path, workers: int) -> None:
    """A bundled suite, on other maps where they are given."""
    suite: Any = yaml.safe_load((PROJECT / "scenarios" / "suites" / f"{study}.yaml").read_text(encoding="utf-8"))
    grid = suite["grid_search"]
    files = [maps[name] if maps else name for name in grid["map"]]
    # the paper unites the graphs of its airport's fleets; all other maps have one
    united = {name for name in grid["map"] if maps and name == "airport"}
    grid["map"] = [{"file": file, "graph": "all"} if name in united else {"file": file} for name, file in zip(grid["map"], files)]
    path = out.with_suffix(".yaml")
    path.write_text(yaml.safe_dump(suite, sort_keys=False), encoding="utf-8")
    code = "import sys; from mrp_sumo.cli.main import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "batch", str(path), "--out", str(out), "--workers", str(workers)]
    if subprocess.run(command).returncode not in (0, 1):
        sys.exit(f"{study}: did not come to its end")


def _blocks(out: Path, origin: str) -> dict[str, str]:
    """The tables of one origin of maps, as Markdown."""
    found: dict[str, str] = {}

    def study(name: str) -> Study | None:
        folder = out / f"{origin}_{name}"
        return read_study(folder) if (folder / "results.parquet").is_file() else None  # there when all runs are

    one, two, three = (study(name) for name in STUDIES)
    if one is not None and (table := table_1(one)):
        found[f"1 {origin}"] = _markdown(table)
    if two is not None:
        if table := table_2(two):
            found[f"2 {origin}"] = _markdown(table)
        if table := table_4(_only(two, (two.frame["_map"] == "warehouse") & (two.frame["_robots"] == 9))):
            found[f"4 {origin}"] = _markdown(table)
        found[f"5 {origin}"] = _planning_times(_only(two, two.frame["_map"] == "warehouse"), origin)
        found[f"instances {origin}"] = _instances(two)
    if three is not None:
        if table := table_3(three):
            found[f"3 {origin}"] = _markdown(table)
        found[f"execution {origin}"] = _execution_times(three, origin)
    return found


def _only(study: Study, mask: "pd.Series[bool]") -> Study:
    return replace(study, frame=study.frame[mask.fillna(False)])


def _markdown(table: Table) -> str:
    return table.without_empty().to_markdown().replace("\\[", "[").replace("\\]", "]")


def _instances(study: Study) -> str:
    """Which runs have no plan, and why."""
    failed = study.frame[~study.frame["_planned"]]
    if not len(failed):
        return "Every run has a plan.\n"
    lines = []
    for (name, robots, seed, why), runs in failed.groupby(["_map", "_robots", "seed", "reason"], sort=True):
        who = "every planner" if len(runs) == len(study.series) else ", ".join(runs["_series"])
        lines.append(f"* {name}, {robots} robots, seed {seed}, {who}: {runs['status'].iloc[0].replace('_', ' ')}; {why}")
    return "\n".join(lines) + "\n"


def _planning_times(study: Study, origin: str) -> str:
    """Figure 5, of the warehouse with 5 and 9 robots: numbers, and the drawing beside the page."""
    study = replace(study, maps=("warehouse",))
    rows: list[list[Any]] = []
    for series in study.series:
        ms = 1e3 * study.frame.loc[(study.frame["_series"] == series) & study.frame["_planned"], "planning_time_s"].astype(float)
        rows.append([series, len(ms), *(float(ms.quantile(q)) for q in (0, 0.25, 0.5, 0.75, 1)), float(ms.mean()), float(ms.std())])
    head = ("planner", "runs", "least ms", "25 %", "median", "75 %", "longest", "mean", "standard deviation")
    return _markdown(Table("figure_5", "", head, rows)) + "\n" + _drawings(figure_5(study), f"{origin}_") + "\n"


def _drawings(charts: list[Chart], prefix: str) -> str:
    """The charts, written beside the page, as Markdown."""
    folder = PAGE.parent / "figures"
    folder.mkdir(exist_ok=True)
    for chart in charts:
        (folder / f"{prefix}{chart.name}.svg").write_bytes(chart.svg)
    return "\n".join(f"![{chart.title}](figures/{prefix}{chart.name}.svg)" for chart in charts)


def _execution_times(study: Study, origin: str) -> str:
    """Execution time and time blocked under `adg`: numbers, and the drawings beside the page."""
    adg = _only(study, study.frame["execution.policy"] == "adg")
    adg.frame["_series"] = adg.frame["_series"].str.removesuffix(", adg")
    adg = replace(adg, series=tuple(dict.fromkeys(s.removesuffix(", adg") for s in study.series if s.endswith(", adg"))))
    rows: list[list[Any]] = []
    for name in adg.maps:
        common, _ = commonly_solved(adg.frame[adg.frame["_map"] == name])
        done = common[common["_arrived"]]
        for series in adg.series:
            runs = done[done["_series"] == series]
            row: list[Any] = [name, series, len(runs)]
            for column in ("execution_time_s", "time_blocked_total_s"):
                row += [float(runs[column].quantile(q)) if len(runs) else None for q in (0.25, 0.5, 0.75)]
            rows.append(row)
    head = ("map", "planner", "runs", "time 25 %", "median", "75 % s", "blocked 25 %", "median ", "75 %  s")
    table = Table("execution", "", head, rows, labels=2, digits=dict.fromkeys(head[3:], 1))
    return _markdown(table) + "\n" + _drawings(execution_violins(adg), f"{origin}_") + "\n"


def _write(blocks: dict[str, str]) -> None:
    text = PAGE.read_text(encoding="utf-8")
    for name, block in blocks.items():
        pattern = re.compile(rf"(<!-- table {re.escape(name)} -->\n).*?(<!-- end -->)", re.DOTALL)
        text, count = pattern.subn(lambda found, block=block: found[1] + "\n" + block + "\n" + found[2], text)
        if not count:
            print(f"{PAGE.name} has no place for '{name}'", file=sys.stderr)
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
