"""Compile all kernels into the cache, so that the first plan and the first drive need not wait for it.

Takes a minute or two on a machine that has never done it, seconds afterwards. Needed again after an update.
"""

import argparse
import json
import multiprocessing
import os
import sys
from time import perf_counter

EXECUTION = "execution"  # the kernels of the controller, the audit and the referee, beside the planners'
ROOMS = ("mrp_sumo/drive", "mrp_sumo/metrics", "mrp_sumo/search", "planners")
LOOK_S = 0.2


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo warmup`."""
    parser.add_argument("planner", nargs="*", help=f"planners to prepare, or '{EXECUTION}' (default: all)")
    parser.add_argument("--quiet", action="store_true", help="print nothing")
    parser.add_argument("--json", action="store_true", help="print the seconds that each took as JSON")


def run(options: argparse.Namespace) -> int:
    """Prepare them on all cores; one line each."""
    from mrp_sumo.planning.registry import planner_names
    from mrp_sumo.plugins.registry import find

    for name in options.planner:
        if name != EXECUTION:
            find("planners", name)  # an unknown name is refused before anything is compiled
    names = options.planner or [EXECUTION, *planner_names()]
    with multiprocessing.get_context("spawn").Pool(min(len(names), os.cpu_count() or 1)) as pool:
        preparing = pool.map_async(_warm, names, chunksize=1)
        if sys.stderr.isatty() and not options.quiet:
            _show_until(preparing)
        spent = preparing.get()
    if options.json:
        print(json.dumps({name: round(time_s, 3) for name, time_s in zip(names, spent)}, indent=2))
    elif not options.quiet:
        for name, time_s in zip(names, spent):
            print(f"{name:<12} {time_s:6.1f} s")
    return 0


def _show_until(preparing: "multiprocessing.pool.MapResult[float]") -> None:
    """A bar that counts stored kernels until all are ready."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from mrp_sumo.search import _kernel

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=sum(_kernel.num_defined(room) for room in ROOMS))
        while not preparing.ready():
            done = sum(_kernel.num_stored(room) for room in ROOMS)
            bar.update(task, completed=done, description=f"compiling kernels, once: {done} of {bar.tasks[0].total:.0f}")
            preparing.wait(LOOK_S)


def _warm(name: str) -> float:
    """Prepare a planner, or the execution; the time it took in s."""
    from mrp_sumo.drive import warm
    from mrp_sumo.errors import MrpSumoError, PlugInError
    from mrp_sumo.metrics import audit, referee_in_seconds
    from mrp_sumo.planning.registry import planner
    from mrp_sumo.search import distance

    began = perf_counter()
    distance.prepare()
    if name == EXECUTION:
        warm.prepare("kinematic")
        audit.prepare()
        referee_in_seconds.prepare()
    else:
        try:
            chosen = planner(name, {})
        except MrpSumoError:  # an external program: it needs parameters, and has nothing to compile
            return 0.0
        try:
            chosen.prepare()
        except PlugInError as error:  # one plug-in that fails must not keep the others cold
            print(f"mrp-sumo: planner '{name}': {error}", file=sys.stderr)
    return perf_counter() - began
