"""Compile all kernels into the cache, so that no first plan and no first drive pays for it.

Takes a minute or two on a machine that has never done it, seconds afterwards. Needed again after an update.
"""

import argparse
import multiprocessing
import os
from time import perf_counter

EXECUTION = "execution"  # the kernels of the controller and the audit, beside the planners'


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo warmup`."""
    parser.add_argument("planner", nargs="*", help=f"planners to prepare, or '{EXECUTION}' (default: all)")
    parser.add_argument("--quiet", action="store_true", help="print nothing")


def run(options: argparse.Namespace) -> int:
    """Prepare them on all cores; one line each."""
    from mrp_sumo.planning.registry import planner_class, planner_names

    for name in options.planner:
        if name != EXECUTION:
            planner_class(name)  # an unknown name is refused before anything is compiled
    names = options.planner or [EXECUTION, *planner_names()]
    told = [_warm(names[0])]  # what the others share is compiled once
    with multiprocessing.get_context("spawn").Pool(min(len(names), os.cpu_count() or 1)) as pool:
        told += pool.imap_unordered(_warm, names[1:])
    if not options.quiet:
        for name, spent in told:
            print(f"{name:<12} {spent:6.1f} s")
    return 0


def _warm(name: str) -> tuple[str, float]:
    """The name, and how long it took."""
    from mrp_sumo.drive import warm
    from mrp_sumo.errors import MrpSumoError
    from mrp_sumo.metrics import audit
    from mrp_sumo.planning.registry import planner
    from mrp_sumo.search import distance

    began = perf_counter()
    distance.prepare()
    if name == EXECUTION:
        warm.prepare()
        audit.prepare()
    else:
        try:
            chosen = planner(name, {})
        except MrpSumoError:  # an external program: it needs parameters, and has nothing to compile
            return name, 0.0
        chosen.prepare()
    return name, perf_counter() - began
