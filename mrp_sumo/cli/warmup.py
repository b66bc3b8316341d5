"""Compile the kernels of all planners into the cache, so that the first plan of each starts at once.

Takes a minute or two on a machine that has never done it, seconds afterwards. Needed again after an update.
"""

import argparse
from time import perf_counter

from mrp_sumo.errors import MrpSumoError


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("planner", nargs="*", help="planners to prepare (default: all)")


def run(options: argparse.Namespace) -> int:
    """Prepare one planner after the other; one line each."""
    from mrp_sumo.planning.registry import planner, planner_class, planner_names

    for name in options.planner or planner_names():
        planner_class(name)  # an unknown name is refused before anything is compiled
        began = perf_counter()
        try:
            planner(name, {}).prepare()
        except MrpSumoError:
            if options.planner:
                raise
            continue  # needs parameters: an external program, with nothing to compile
        print(f"{name:<12} {perf_counter() - began:6.1f} s", flush=True)
    return 0
