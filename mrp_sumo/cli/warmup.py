"""Compile all kernels into the cache ahead, so that no first run pays for it. Does nothing the second time.

Needed once after installing and after each update; any run would do it as well, for what it uses.
"""

import argparse
import multiprocessing
import os
import sys
import time

EXECUTION = "execution"


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo warmup`."""
    parser.add_argument("--quiet", action="store_true", help="print nothing")


def run(options: argparse.Namespace) -> int:
    """Compile, on all cores."""
    from mrp_sumo.planning.registry import planner_names

    began = time.perf_counter()
    names = [EXECUTION, *planner_names()]
    _warm(names[0])  # what the others share is compiled once
    workers = min(len(names) - 1, os.cpu_count() or 1)
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        for name in pool.imap_unordered(_warm, names[1:]):
            if not options.quiet and sys.stderr.isatty():
                print(f"{name} ready", file=sys.stderr)
    if not options.quiet:
        print(f"{len(names) - 1} planners and the controller are ready after {time.perf_counter() - began:.1f} s")
    return 0


def _warm(name: str) -> str:
    from mrp_sumo.planning import distance
    from mrp_sumo.planning.registry import planner
    from mrp_sumo.sim import warm

    distance.prepare()
    if name == EXECUTION:
        warm.prepare()
    else:
        planner(name, {}).prepare()
    return name
