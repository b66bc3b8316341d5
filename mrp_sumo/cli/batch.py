"""Make the runs of a suite: in parallel, resumable, with one result per run.

Started again with the same suite and folder, it goes on where it was. Ctrl-C ends it after the runs under
way, a second Ctrl-C at once. Exit code 0 when every run has a result, 1 when some crashed, took too much or
cannot be run, or --keep-worst kept none, 2 for bad input, 130 or 143 when it was interrupted by Ctrl-C or SIGTERM.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.cli.ending import stoppable
from mrp_sumo.cli.option_rules import only_for, require_least
from mrp_sumo.cli.printing import say, say_either, warn, warn_of_kernels
from mrp_sumo.core.children import num_workers
from mrp_sumo.errors import BatchError, duration, shown

if TYPE_CHECKING:
    from mrp_sumo.experiments.batch import BatchFolder, Watcher
    from mrp_sumo.experiments.suite import SuiteFile

SAY_EVERY_S = 30.0


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo batch`."""
    add = parser.add_argument
    add("suite", help="suite file, or the name of a bundled suite such as paper_comparison")
    add("--out", metavar="DIR", help="folder of the results (default: runs/<suite>)")
    add("--workers", type=int, metavar="N", help="processes (default: one a core)")
    add("--dry-run", action="store_true", help="print how many runs, which, and roughly how long; run nothing")
    add("--scheduler", metavar="ADDRESS", help="let the workers of this Dask scheduler make the runs, such as tcp://host:8786")
    add("--retries", type=int, default=1, metavar="N", help="how often a run that crashed is tried again (default: 1)")
    add("--time-limit", type=float, metavar="S", help="wall time of a run, instead of the suite's limit")
    add("--memory-limit", type=float, metavar="MB", help="memory of a run, instead of the suite's limit")
    add(
        "--keep-worst", type=int, default=0, metavar="N", help="make the N worst runs again with run folder and replay page, for the report"
    )
    add("--metric", action="append", metavar="NAME", help="measure this too, a bundled metric or FILE.py:FUNCTION; may be repeated")
    add("--trust", action="store_true", help="run the programs that the suite names: plug-in files, external planners")
    add("--json", action="store_true", help="print the counts as a line of JSON in the end")
    add("-v", "--verbose", action="store_true", help="with --dry-run: list every run")


def run(options: argparse.Namespace) -> int:
    """Run the batch, or say what it would do."""
    from mrp_sumo.experiments.suite import find_suite, read_suite
    from mrp_sumo.plugins.trust import trust_everything

    workers = workers_of(options)
    require_least("--retries", options.retries, 0)
    require_least("--keep-worst", options.keep_worst, 0)
    for name, limit in (("--time-limit", options.time_limit), ("--memory-limit", options.memory_limit)):
        if limit is not None and not limit > 0:
            raise BatchError(f"{name}: found {limit:g}, expected more than 0")
    if not options.dry_run:
        only_for("--dry-run", verbose=options.verbose)
    elif options.json:
        raise BatchError("--dry-run runs nothing, and --json prints how runs ended: leave out one of the two")
    trust_everything(options.trust)
    file = read_suite(find_suite(options.suite))
    from mrp_sumo.cli.analyze import measure_named, named_metrics
    from mrp_sumo.experiments.archive import ARCHIVE, archive_worst  # with all that runs: after the suite is known to be one
    from mrp_sumo.experiments.batch import BROKEN, Making, run_batch, summary

    folder = Path(options.out) if options.out else Path("runs") / file.name
    if options.metric:
        named_metrics(options.metric)  # what is none is refused before anything runs
    if options.dry_run:
        _print_plan(file, folder, workers, options)
        return 0
    warn_of_kernels()
    kept_none = False
    with stoppable() as stop, watcher() as shown:
        making = Making(workers, options.scheduler, options.retries, options.time_limit, options.memory_limit, stop)
        batch = run_batch(file, folder, shown, making)
        if options.keep_worst and len(batch.status) == len(batch.runs):
            page = "mrp_sumo.reports.replay.page:write_replay"
            num_kept = archive_worst(batch, options.keep_worst, shown.report, making, write_page=page)
            kept_none = not num_kept
            if num_kept:
                shown.report(f"the worst {'run is' if num_kept == 1 else f'{num_kept} runs are'} kept in {folder / ARCHIVE}")
    if len(batch.status) < len(batch.runs):
        return stop.interrupted(options.command_line, summary(batch))
    counts = {"suite": file.name, "folder": str(folder), "runs": len(batch.runs), "statuses": dict(batch.counts())}
    say_either(options.json, counts, f"{file.name}: {summary(batch)}; {folder}/results.parquet, {folder}/results.csv")
    failed = measure_named(folder, options.metric, quiet=options.json) if options.metric else 0
    return 1 if failed or kept_none or any(batch.counts()[status] for status in BROKEN) else 0


def _print_plan(file: "SuiteFile", folder: Path, workers: int, options: argparse.Namespace) -> None:
    from mrp_sumo.experiments.batch import estimate_s, open_batch

    batch = open_batch(file, folder, warn)
    todo = batch.todo(options.retries)
    say(f"{file.name}: {len(batch.runs)} runs, {len(batch.runs) - len(todo)} done, {len(todo)} to make")
    if file.suite.description:
        say(" ".join(file.suite.description.split()))
    for key, values in file.axes:
        listed = [_shown(value) for value in values]
        say(f"  {key}: {', '.join(listed if len(listed) <= 8 else [*listed[:3], '...', listed[-1]])} ({len(listed)})")
    if file.suite.repeat > 1:
        say(f"  each {file.suite.repeat} times")
    shown = batch.runs if options.verbose or len(batch.runs) <= 12 else [*batch.runs[:5], None, *batch.runs[-2:]]
    for planned in shown:
        say(f"    {planned.key}  {_differs(batch, planned)}" if planned else "    ... (-v lists all)")
    seconds, source = estimate_s(batch, workers, options.retries)
    say(f"about {duration(seconds)} on {workers} workers ({source}); into {folder}")


def _differs(batch: "BatchFolder", planned: Any) -> str:
    """The values of a run that the suite varies."""
    from mrp_sumo.io.columns import parameter_columns

    columns = parameter_columns(json.loads(planned.scenario))
    parts = []
    for key, _ in batch.file.axes:
        parts += [f"{name}={value}" for name, value in columns.items() if name == key]
        parts += [f"{name.rsplit('.', 1)[-1]}={value}" for name, value in columns.items() if name.startswith(f"{key}.parameters.")]
    return " ".join(parts + ([f"repeat={planned.repeat}"] if batch.file.suite.repeat > 1 else []))


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_shown(inner)}" for key, inner in value.items()) + "}"
    return str(value)


def workers_of(options: argparse.Namespace) -> int:
    """Processes that make runs, by default one a core."""
    workers = num_workers("--workers", options.workers)
    if options.workers is not None and getattr(options, "scheduler", None) is not None:
        raise BatchError("--workers is for this machine: a Dask scheduler has workers of its own; leave out one of the two")
    return workers


@contextmanager
def watcher() -> "Iterator[Watcher]":
    """A progress bar on a terminal, a line now and then in a pipe."""
    from mrp_sumo.experiments.batch import Watcher

    class Quiet(Watcher):
        said = time.monotonic()

        def begin(self, num_runs: int, num_done: int) -> None:
            super().begin(num_runs, num_done)
            if num_done:
                self.report(f"going on: {num_done} of {num_runs} runs done")

        def report(self, line: str) -> None:
            warn(line)

        def show(self) -> None:
            if time.monotonic() - self.said > SAY_EVERY_S:
                self.said = time.monotonic()
                self.report(f"{self.num_done} of {self.num_runs} runs done, {self.num_failed} without success")

    if not sys.stderr.isatty():
        yield Quiet()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        TextColumn("runs"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[failures]}"),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("", total=None, rate="", failures="")

        class Shown(Watcher):
            def begin(self, num_runs: int, num_done: int) -> None:
                super().begin(num_runs, num_done)
                if num_done:
                    bar.console.print(f"going on: {num_done} of {num_runs} runs done")

            def show(self) -> None:
                elapsed = bar.tasks[task].elapsed or 0.0
                rate = f"{self.num_made / elapsed:.1f}/s" if elapsed and self.num_made else ""
                failures = f"[yellow]{self.num_failed} without success[/]" if self.num_failed else ""
                bar.update(task, total=self.num_runs, completed=self.num_done, rate=rate, failures=failures)

            def report(self, line: str) -> None:
                bar.console.print(shown(line), style="yellow", highlight=False, markup=False)

        yield Shown()
