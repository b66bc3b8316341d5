"""See what there is in a minute: nine robots in an office, orders in a warehouse, two planners compared, all on one page.

Everything is made on this machine as `run`, `replay`, `render`, `batch` and `report` make it; each command is printed before its work.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.cli.printing import say, say_json
from mrp_sumo.errors import MrpSumoError

if TYPE_CHECKING:
    from mrp_sumo.experiments.result import RunResult
    from mrp_sumo.reports.tour import TourPage

MADE = ("office", "warehouse", "planners", "planners.yaml", "index.html")
SUITE = "base: office_5\ngrid_search:\n  planner: [cbs, lacam]\n  seed: 1..3\n"


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo demo`."""
    parser.add_argument("--out", metavar="DIR", default="runs/demo", help="where everything goes (default: runs/demo)")
    parser.add_argument("--no-open", action="store_true", help="do not open the page in a browser")
    parser.add_argument("--json", action="store_true", help="print what was made as a line of JSON, the rest as messages, and open nothing")


def run(options: argparse.Namespace) -> int:
    """Make it, and open the page."""
    out = Path(options.out)
    if out.is_dir() and (others := sorted(path.name for path in out.iterdir() if path.name not in MADE and ".partial" not in path.name)):
        raise MrpSumoError(f"--out {out}: holds '{others[0]}', which is not of a demo; give another folder")
    out.mkdir(parents=True, exist_ok=True)
    import webbrowser  # and all that runs and draws: after there is a place for it

    from mrp_sumo.cli.batch import watcher
    from mrp_sumo.cli.ending import stoppable
    from mrp_sumo.experiments.batch import Making, run_batch
    from mrp_sumo.experiments.suite import read_suite
    from mrp_sumo.reports.replay.page import write_page
    from mrp_sumo.reports.report import write_report
    from mrp_sumo.reports.tour import tour_page

    _say(f"\nnine robots cross an office\n  $ mrp-sumo run office_9 --out {out / 'office'} --replay", options)
    office = _run("office_9", out / "office", at_s=15.0)
    _say(f"  {office.status}", options)
    command = f"run warehouse_lifelong --set execution.time_limit_s=300 --out {out / 'warehouse'} --replay"
    _say(f"\norders come in while nine robots work\n  $ mrp-sumo {command}", options)
    warehouse = _run("warehouse_lifelong", out / "warehouse", at_s=200.0, limit_s=300.0)
    _say(f"  {warehouse.status}", options)
    suite = out / "planners.yaml"
    suite.write_text(SUITE, encoding="utf-8")
    _say(f"\ntwo planners on the same draws\n  $ mrp-sumo batch {suite} --out {out / 'planners'}", options)
    with stoppable() as stop, watcher() as shown:
        batch = run_batch(read_suite(suite), out / "planners", shown, Making(2, stop=stop))
    if len(batch.status) < len(batch.runs):
        return stop.interrupted(options.command_line)
    _say(f"\nwho is better, and is it certain?\n  $ mrp-sumo report {out / 'planners'}", options)
    write_report(out / "planners", None)
    page = write_page(tour_page(_stops(out, office, warehouse, len(batch.runs))), out / "index.html")
    if options.json:
        folders = {name: str(out / name) for name in ("office", "warehouse", "planners")}
        say_json({"page": str(page), **folders, "runs": 2 + len(batch.runs)})
        return 0
    say(page)
    if not options.no_open:
        webbrowser.open(page.resolve().as_uri())
    return 0


def _stops(out: Path, office: "RunResult", warehouse: "RunResult", num_runs: int) -> tuple["TourPage", ...]:
    from mrp_sumo.reports.tour import TourPage

    done = warehouse.metrics
    return (
        TourPage(
            "Nine robots in an office",
            f"Planned and driven: all at their goals after {office.metrics['driven_makespan_s']:.1f} s, and no two of them touched.",
            "office/replay.html",
            "office/still.png",
            f"mrp-sumo replay {out / 'office'} --serve",
        ),
        TourPage(
            "Orders in a warehouse",
            f"In five minutes {done['tasks_done']} orders were done, {done['throughput_per_h']:.0f} an hour; "
            f"{done['tasks_open']} were open in the end.",
            "warehouse/replay.html",
            "warehouse/still.png",
            f"mrp-sumo render {out / 'warehouse'} --video warehouse.mp4",
        ),
        TourPage(
            "Two planners compared",
            f"CBS and LaCAM on the same draws, {num_runs} runs. So few say little: the report says what is certain.",
            "planners/report/index.html",
            "",
            "mrp-sumo batch paper_comparison --dry-run",
        ),
    )


def _say(text: str, options: argparse.Namespace) -> None:
    """Tell people what is being done, beside what is printed for machines."""
    say(*text.split("\n"), to_stderr=options.json)


def _run(name: str, out: Path, *, at_s: float, limit_s: float | None = None) -> "RunResult":
    from mrp_sumo.cli.run import progress_bar
    from mrp_sumo.experiments.run import RunOptions, run_scenario
    from mrp_sumo.io.scenario.file import find_scenario
    from mrp_sumo.io.scenario.read import read_scenario
    from mrp_sumo.reports.pictures.still import render_still
    from mrp_sumo.reports.replay.page import write_replay

    overrides: dict[tuple[str | int, ...], tuple[str, Any]] = {("execution", "time_limit_s"): ("--set", limit_s)} if limit_s else {}
    with progress_bar() as progress:
        result = run_scenario(read_scenario(find_scenario(name), overrides), out, RunOptions(progress=progress))
    write_replay(out)
    render_still(result, min(at_s, result.metrics["sim_time_s"]), out / "still.png", dpi=80)
    return result
