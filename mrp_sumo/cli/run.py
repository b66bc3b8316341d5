"""Run one scenario: plan, judge, execute in SUMO, measure, and write the run folder.

Exit code 0 when all robots reached their goals, 1 when the run finished without that, 2 for bad input.
"""

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.cli import scenario_choice
from mrp_sumo.cli.failure import print_failure

if TYPE_CHECKING:
    from mrp_sumo.experiments.run import Progress, RunResult


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo run`."""
    parser.add_argument("scenario", help="scenario file, or the name of a bundled scenario such as office_9")
    parser.add_argument("--out", metavar="DIR", help="run folder (default: runs/<scenario>)")
    scenario_choice.arguments(parser)
    parser.add_argument("--policy", metavar="NAME", help="another execution policy; FILE.py:CLASS for one of your own")
    parser.add_argument("--replay", action="store_true", help="write the replay page into the run folder")
    parser.add_argument("--gui", action="store_true", help="drive in sumo-gui")
    parser.add_argument("-v", "--verbose", action="store_true", help="print every metric, and the traceback of a plug-in that failed")


def run(options: argparse.Namespace) -> int:
    """Run the scenario and print a table."""
    from mrp_sumo.experiments.run import PLUG_IN_FAILED, run_scenario

    file = scenario_choice.chosen_scenario(options)
    out = Path(options.out) if options.out else Path("runs") / file.scenario.name
    with _progress_bar() as progress:
        result = run_scenario(file, out, progress=progress, gui=options.gui)
    if options.replay and (out / "plan.json").is_file():
        from mrp_sumo.reports.replay.page import write_replay

        write_replay(out)
    _print(result, out, options.verbose)
    if result.status in PLUG_IN_FAILED:
        print_failure(result.status.replace("_", " "), result.note, result.details if options.verbose else "")
    return 0 if result.status == "completed" else 1


@contextmanager
def _progress_bar() -> "Iterator[Progress | None]":
    """A progress bar on a terminal, nothing in a pipe."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[clock]}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None, clock="")

        def show(stage: str, done: float, of: float) -> None:
            clock = f"{done:.0f} s simulated" if of else ""
            bar.update(task, description=stage, completed=done, total=of or None, clock=clock)

        yield show


def _print(result: "RunResult", out: Path, verbose: bool) -> None:
    """A short table a person likes to read."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    m, scenario, execution = result.metrics, result.setup.scenario, result.execution
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 100)
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0), title=escape(scenario.name), title_style="bold", title_justify="left")
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")

    def row(name: str, *parts: str) -> None:
        if told := ", ".join(p for p in parts if p):
            table.add_row(name, told)

    colour = "red" if result.status != "completed" else "green" if m["plan_valid"] else "yellow"
    row("status", f"[{colour}]{result.status.replace('_', ' ')}[/]", escape(result.note))
    row("map", f"{scenario.map.file}, {m['num_robots']} robots, seed {scenario.seed}")
    row("planner", scenario.planner.name, _validity(m))
    row("planning time", _seconds(m["planning_time_s"]), _given("assignment", _seconds(m["assignment_time_s"])))
    row("makespan", _seconds(m["makespan_s"]), _count(m["makespan_steps"], "cells (paper's count)"))
    row(
        "cost",
        _count(m["soc_steps"], "steps (sum of costs)"),
        _count(m["cost_steps"], "cells (paper's count)"),
        _count(m["lower_bound_steps"] or None, "steps lower bound"),  # 0: the planner proves nothing
    )
    if execution is not None:
        row("goals reached", f"{m['goals_reached']} of {m['num_robots']}", f"policy {execution.policy}")
        row("execution time", _seconds(m["execution_time_s"]), "timed out" if m["execution_timed_out"] else "")
        row(
            "minimum distance",
            _metres(m["min_distance_m"]),
            _given("clearance", _metres(m["min_clearance_m"])),
            f"{m['num_overlaps']} overlaps",
        )
        row("blocked time", _seconds(m["blocked_s"]), _given("MRP-Bench's count", _seconds(m["time_blocked_total_s"])))
        row("lateness", _given("mean", _lateness(m["lateness_mean_s"])), _given("maximum", _lateness(m["lateness_max_s"])))
        row("real-time factor", f"{m['real_time_factor']:.0f}", f"{m['robot_seconds_per_cpu_second']:.0f} robot-seconds a CPU-second")
    row("files", str(out))
    console.print(table)
    if verbose:
        detail = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
        for name, value in m.items():
            detail.add_row(name, str(value))
        console.print(detail)


def _validity(m: dict[str, Any]) -> str:
    if not m["plan_success"]:
        return "[red]no plan[/]"
    return "plan valid" if m["plan_valid"] else "[yellow]plan has conflicts[/]"


def _given(name: str, value: str) -> str:
    return f"{name} {value}".strip() if value else ""


def _seconds(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value * 1000:.1f} ms" if abs(value) < 0.5 else f"{value:.1f} s"


def _lateness(value: float | None) -> str:
    return "" if value is None else f"{_seconds(abs(value))} {'early' if value < 0 else 'late'}"


def _metres(value: float | None) -> str:
    return "" if value is None else f"{value:.3f} m"


def _count(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:.0f} {unit}"
