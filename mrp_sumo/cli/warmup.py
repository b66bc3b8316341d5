"""Compile all kernels into the cache, so that the first plan and the first drive need not wait for it.

Takes a minute or two on a machine that has never done it, seconds afterwards. Needed again after an update.
"""

import argparse
import math
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

from mrp_sumo.cli.printing import say, say_json, warn

if TYPE_CHECKING:
    from mrp_sumo.experiments.map_cache import MapCache
    from mrp_sumo.experiments.worker import Answer, Job

EXECUTION = "execution"  # the kernels of the controller, the audit and the referee, beside the planners'
LOOK_S = 0.2


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo warmup`."""
    parser.add_argument("planner", nargs="*", help=f"planners to prepare, or '{EXECUTION}' (default: all)")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--quiet", action="store_true", help="print nothing")
    form.add_argument("--json", action="store_true", help="print the seconds that each took as JSON")


def run(options: argparse.Namespace) -> int:
    """Prepare them on all cores; one line each."""
    from mrp_sumo.planning.registry import planner_names
    from mrp_sumo.plugins.registry import find

    names = options.planner or [EXECUTION, *planner_names()]
    packages = ["" if name == EXECUTION else find("planners", name).module.rpartition(".")[0] for name in names]  # refuses unknown ones
    place = {name: packages[:k].count(packages[k]) for k, name in enumerate(names)}  # those of a package share kernels: in turn
    answers = _prepared(sorted(names, key=place.__getitem__), sys.stderr.isatty() and not options.quiet)
    for name in names:
        if reason := answers[name]["reason"]:  # one plug-in that fails must not keep the others cold
            warn(f"planner '{name}': {reason}")
    spent = {name: answers[name]["run_wall_s"] for name in names}
    if options.json:
        say_json({name: round(time_s, 3) for name, time_s in spent.items()}, indent=2)
    elif not options.quiet:
        for name, time_s in spent.items():
            say(f"{name:<12} {time_s:6.1f} s")
    return 0


def _prepared(names: list[str], is_shown: bool) -> dict[str, "Answer"]:
    """Prepare each in a worker process; what came of it, by name."""
    from mrp_sumo.experiments.processes import Processes

    processes = Processes(min(len(names), os.cpu_count() or 1), "mrp_sumo.cli.warmup:warm")
    answers: dict[str, Answer] = {}
    try:
        for name in names:
            processes.submit({"name": name, "wall_s": math.inf, "memory_mb": None})
        with _bar() if is_shown else nullcontext(lambda: None) as show:
            while processes.running:
                answers.update((job["name"], answer) for job, answer in processes.wait(LOOK_S))
                show()
    finally:
        processes.close()
    return answers


@contextmanager
def _bar() -> Iterator[Callable[[], None]]:
    """A bar that counts stored kernels whenever it is asked to."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from mrp_sumo.experiments.kernels import stored_kernels

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=stored_kernels()[1])

        def show() -> None:
            done, needed = stored_kernels()
            bar.update(task, completed=done, description=f"compiling kernels, once: {done} of {needed}")

        yield show


def warm(job: "Job", _: "MapCache") -> "Answer":
    """Prepare a planner, or the execution, in a worker process."""
    from mrp_sumo.drive import warm
    from mrp_sumo.errors import MrpSumoError, PlugInError
    from mrp_sumo.metrics import audit, referee_in_seconds
    from mrp_sumo.planning.registry import planner
    from mrp_sumo.search import distance

    name, reason = job["name"], ""
    distance.prepare()
    if name == EXECUTION:
        warm.prepare("kinematic")
        audit.prepare()
        referee_in_seconds.prepare()
    else:
        try:
            planner(name, {}).prepare()
        except PlugInError as error:
            reason = str(error)
        except MrpSumoError:  # an external program: it needs parameters, and has nothing to compile
            pass
    return {"status": "prepared", "success": not reason, "reason": reason, "metrics": {}}
