"""Run one scenario: plan, judge, execute in SUMO, measure, and write the run folder.

Exit code 0 when all robots came within the tolerance of their goals and the audit found nothing, 1 when the run finished without
that, 2 for bad input.
"""

import argparse
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from mrp_sumo.cli import intervals, scenario_choice
from mrp_sumo.cli.option_rules import only_for, port_number, require_least
from mrp_sumo.cli.printing import plain_table, print_failure, print_table, say, say_json, warn_of_kernels
from mrp_sumo.errors import MrpSumoError

if TYPE_CHECKING:
    from mrp_sumo.experiments.error_bands import Bounds
    from mrp_sumo.experiments.result import RunResult
    from mrp_sumo.experiments.run import Watch
    from mrp_sumo.experiments.solve import StageReport
    from mrp_sumo.io.scenario.file import ScenarioFile


SET_AS = {"--planner": ("planner", "planner.name"), "--time-limit": ("planner.time_limit_s",)}  # keys that options stand for


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo run`."""
    add = parser.add_argument
    add("scenario", nargs="?", metavar="FILE", help="scenario or map file, or the name of a bundled one, such as office_9 or office")
    add("--plan", type=Path, metavar="FILE", help="drive this plan, in any format that `validate` reads, instead of planning")
    add("--map", type=Path, metavar="FILE", help="MovingAI .map instead of a scenario, with cells of 1 m")
    add("--scen", type=Path, metavar="FILE", help="MovingAI .scen of the map (default: starts and goals are the plan's)")
    add("--type", "--robot", dest="robot", metavar="NAME", help="another type of robot: a bundled one, or a YAML file")
    scenario_choice.scale_argument(parser)
    add("--out", metavar="DIR", help="run folder (default: runs/<scenario>)")
    scenario_choice.arguments(parser)
    add("--policy", metavar="NAME", help="another execution policy; FILE.py:CLASS for one of your own")
    add(
        "--metric",
        action="append",
        metavar="NAME",
        help="a metric of your own, FILE.py:FUNCTION, instead of the scenario's; may be repeated",
    )
    intervals.arguments(parser)
    add("--replay", action="store_true", help="write the replay page into the run folder")
    add("--live", action="store_true", help="show the run in a browser while it drives: pause, step, speed, what has been")
    add("--port", type=port_number, metavar="N", help="of --live (default: any free port) or --foxglove (default: 8765)")
    add("--foxglove", action="store_true", help="show the run in Foxglove while it drives, with its playback control: pause, seek, speed")
    add(
        "--rerun",
        nargs="?",
        const="",
        metavar="FILE",
        help="write the run for Rerun, FILE.rrd, or show it as it drives in a viewer that is open (default: on this machine)",
    )
    add("--dds", action="store_true", help="publish the run over DDS while it drives, as ROS 2 nodes do, in real time")
    add(
        "--speed",
        type=float,
        metavar="N",
        help="of --dds and --foxglove: simulated seconds a second (default: 1; that of --live is its page's)",
    )
    add("--domain", type=int, metavar="N", help="of --dds, as ROS_DOMAIN_ID says it (default: 0)")
    add("--interface", metavar="ADDRESS", help="of --dds: network interface (default: 127.0.0.1, this machine alone)")
    add("--gui", action="store_true", help="drive in sumo-gui")
    add("--json", action="store_true", help="print status, folder and metrics as a line of JSON instead of a table")
    add("-v", "--verbose", action="store_true", help="print every metric, and the traceback of a plug-in that failed")


def run(options: argparse.Namespace) -> int:
    """Run the scenario and print a table."""
    if (options.scenario is None) == (options.map is None):
        raise MrpSumoError("expected either a scenario or map file, or --map")
    if options.scenario is not None and options.scen is not None:
        raise MrpSumoError("a scenario says itself who goes where: --scen is for --map")
    file = scenario_choice.chosen_scenario(options)
    out = Path(options.out) if options.out else Path("runs") / file.scenario.name
    _check_watching(options)
    bounds = intervals.bounds_of(options, file)
    if bounds is not None:
        if options.live:
            raise MrpSumoError("--error-bands: with --live people may steer the run, which is not the same twice; leave one of them out")
        from mrp_sumo.experiments.map_cache import MapCache
        from mrp_sumo.experiments.run_bands import require_bounds

        with MapCache() as maps:
            require_bounds(file, bounds, maps)
    from mrp_sumo.experiments.run import PLUG_IN_FAILED  # with all that drives: after the scenario is known to be one

    warn_of_kernels()
    with ExitStack() as stack:
        watches = _watches(options, stack)
        result = _run(file, out, options, watches, bounds)
    print_run(result, out, as_json=options.json, verbose=options.verbose)
    if not options.json:
        if result.error_bands:
            say(f"error bands: {result.error_bands['sentence']}")
        _print_next(result, out, options)
    if options.replay and (out / "plan.json").is_file():
        from mrp_sumo.reports.replay.page import write_replay

        write_replay(out)
    if result.status in PLUG_IN_FAILED:
        print_failure(result.status.replace("_", " "), result.note, result.details if options.verbose else "")
    elif result.metric_faults:
        print_failure("metric failed", "; ".join(result.metric_faults), result.details if options.verbose else "")
    if result.status == "interrupted":
        return 130
    return 0 if result.status == "completed" and not result.metric_faults else 1


def _check_watching(options: argparse.Namespace) -> None:
    if not (options.live or options.foxglove):
        only_for("--live and --foxglove", port=options.port)
    if not options.dds:
        only_for("--dds", domain=options.domain, interface=options.interface)
    if not (options.dds or options.foxglove):
        only_for("--dds and --foxglove", speed=options.speed)
    if options.live:
        only_for("--dds and --foxglove without --live, whose page has a speed of its own", speed=options.speed)
    require_least("--speed", options.speed, 0.001)
    if options.rerun is not None:
        from mrp_sumo.wire.rerun_place import VIEWER, require_place

        require_place(options.rerun or VIEWER)


def _watches(options: argparse.Namespace, stack: ExitStack) -> "list[Watch]":
    """Who hears how the run is driven, besides the page of --live."""
    watches: list[Watch] = []
    if options.dds:
        from mrp_sumo.wire.dds import LOOPBACK, DdsView

        watches.append(stack.enter_context(DdsView(options.domain or 0, options.interface or LOOPBACK)).watch)
    if options.rerun is not None:
        from mrp_sumo.wire.rerun import RerunView
        from mrp_sumo.wire.rerun_place import VIEWER

        watches.append(stack.enter_context(RerunView(options.rerun or VIEWER)).watch)
    if options.foxglove:
        from mrp_sumo.wire.foxglove import PORT, FoxgloveView

        port = PORT if options.live or options.port is None else options.port
        foxglove = stack.enter_context(FoxgloveView(port, options.speed or 1.0))
        say(f"{foxglove.address}, in Foxglove: {foxglove.app} (Ctrl+C ends)")
        watches.append(foxglove.watch)
    elif options.dds and not options.live:
        from mrp_sumo.wire.pace import Pace, Paced

        watches.append(lambda *_: Paced(Pace(options.speed or 1.0)))
    return watches


def _run(file: "ScenarioFile", out: Path, options: argparse.Namespace, watches: "Sequence[Watch]", bounds: "Bounds | None") -> "RunResult":
    """Run it, with the page of --live where that is asked for."""
    from mrp_sumo.experiments.run import RunOptions, run_scenario

    if not options.live:
        with progress_bar() as progress:
            return run_scenario(file, out, RunOptions(gui=options.gui, progress=progress, watches=watches, bounds=bounds))
    import webbrowser

    from mrp_sumo.reports.live.watch import LiveView

    live = LiveView(options.port or 0)
    say(f"{live.address} (Ctrl+C ends)")
    webbrowser.open(live.address)
    try:
        how = RunOptions(gui=options.gui, progress=live.stage, watches=[*watches, live.watch, live.steer])
        result = run_scenario(file, out, how)
    except BaseException:
        live.close()
        raise
    live.finish(result)
    return result


@contextmanager
def progress_bar() -> "Iterator[StageReport]":
    """A progress bar on a terminal, nothing in a pipe."""
    from mrp_sumo.experiments.solve import silent

    if not sys.stderr.isatty():
        yield silent
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[clock]}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None, clock="")

        def show(stage: str, done: float, of: float) -> None:
            clock = f"{done:.0f} s simulated" if stage.startswith("driving") else ""
            bar.update(task, description=stage, completed=done, total=of or None, clock=clock)

        yield show


def print_run(result: "RunResult", out: Path, *, as_json: bool, verbose: bool = False) -> None:
    """Print what came of a run as a line of JSON, or a short table."""
    if as_json:
        said = {"status": result.status, "note": result.note, "folder": str(out), "metrics": result.metrics}
        say_json(said | ({"error_bands": result.error_bands} if result.error_bands else {}))
        return
    from rich.markup import escape

    from mrp_sumo.io.run_summary import CONFLICTS, NO_PLAN, run_summary

    summary, status = run_summary(result.result), result.status.replace("_", " ")
    colour = "red" if result.status != "completed" else "green" if result.metrics["plan_valid"] else "yellow"
    table = plain_table(title=escape(summary.title))
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for name, text in summary.rows:
        shown = escape(text)
        if name == "status":
            shown = f"[{colour}]{status}[/]{escape(text.removeprefix(status))}"
        if name == "planner":
            shown = shown.replace(NO_PLAN, f"[red]{NO_PLAN}[/]").replace(CONFLICTS, f"[yellow]{CONFLICTS}[/]")
        table.add_row(name, shown)
    table.add_row("files", escape(str(out)))
    print_table(table, 100)
    if verbose:
        detail = plain_table()
        for name, value in result.metrics.items():
            detail.add_row(name, escape(str(value)))
        print_table(detail, 100)


def _print_next(result: "RunResult", out: Path, options: argparse.Namespace) -> None:
    """The three commands that are most likely wanted now."""
    from mrp_sumo.io.remedy import other_planner

    folder = shlex.quote(str(out))
    if result.plan is None:
        chosen, lines = result.result["scenario"]["planner"], ["mrp-sumo list planners"]
        if result.status == "planning_timed_out":
            lines.insert(0, _again(options, "--time-limit", f"{max(300.0, 10 * chosen['time_limit_s']):g}"))
        if other := other_planner(chosen["name"]):
            lines.insert(0, _again(options, "--planner", other))
    else:
        lines = [f"mrp-sumo replay {folder} --serve", f"mrp-sumo render {folder} --video run.gif --to 20", f"mrp-sumo report {folder}"]
        if result.status == "deadlock":
            lines[2] = _again(options, "--set", "execution.on_deadlock=resolve")
    say(f"next: {lines[0]}", *(f"      {line}" for line in lines[1:]))


def _again(options: argparse.Namespace, option: str, value: str) -> str:
    """The command line of this run with an option that is other, also where `--set` said the same; `--set` comes besides what is set."""
    words: list[str] = []
    rest = iter(options.command_line)
    for word in rest:
        name, joined, said = word.partition("=")
        if name not in (option, "--set"):
            words.append(word)
            continue
        said = said if joined else next(rest)
        if option == "--set" or (name == "--set" and said.partition("=")[0] not in SET_AS[option]):
            words += [name, said]
    return shlex.join([*words, option, value])
