"""Make a run again from its folder, or runs of a batch from their records, and say whether all is the same, byte for byte.

Of a run every file is compared, of a batch status and metrics. Clocks, machines and versions are left out. Programs that the scenario names
run only when they are trusted. Exit code 0 when all is the same, 1 with a line per difference, 2 for bad input.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mrp_sumo.cli.printing import say, say_json, warn
from mrp_sumo.cli.result_folder import result_folder
from mrp_sumo.errors import MrpSumoError, count

if TYPE_CHECKING:
    from mrp_sumo.io.results import BatchRecord


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo reproduce`."""
    add = parser.add_argument
    add("folder", type=result_folder, metavar="RUN|BATCH", help="folder of a run or a batch")
    add("--base", type=Path, default=Path(), metavar="DIR", help="where the scenario's relative paths begin (default: here)")
    add("--runs", type=int, metavar="N", help="so many runs of a batch, spread over it (default: all)")
    add("--json", action="store_true", help="print what was found as a line of JSON")
    add("--trust", action="store_true", help="run the programs that the scenario names: plug-in files, external planners")


def run(options: argparse.Namespace) -> int:
    """Make it again, print what differs."""
    from mrp_sumo.plugins.trust import trust_everything

    trust_everything(options.trust)
    if not options.base.is_dir():
        raise MrpSumoError(f"--base {options.base}: no such folder")
    folder = options.folder = Path(options.folder)
    from mrp_sumo.files.folders import is_batch, require_run

    if not (of_batch := is_batch(folder)):
        require_run(folder)
    if options.runs is not None and (not of_batch or options.runs < 1):
        raise MrpSumoError(f"--runs: found {options.runs}, expected 1 or more runs of a batch")
    from mrp_sumo.experiments.reproduce import reproduce_batch, reproduce_run  # with all that drives: after the folder is known to be one

    if of_batch:
        comparison, what = reproduce_batch(_records(options), options.base), "run"
    else:
        comparison, what = reproduce_run(folder, options.base), "file"
    if options.json:
        say_json({"same": comparison.same, "equal": comparison.equal, "of": what, "differences": list(comparison.differences)})
        return 0 if comparison.same else 1
    for line in comparison.differences:
        say(line)
    if not comparison.same:
        for line in comparison.causes or ("nothing is known that would explain it",):
            warn(line)
        return 1
    every = "every byte is the same" if what == "file" else "every result is the same"
    say(f"{folder}: {every}, {count(comparison.equal, what)}")
    return 0


def _records(options: argparse.Namespace) -> "list[BatchRecord]":
    """The records of a batch, or so many of them, spread over it."""
    from mrp_sumo.io.results import records_in

    records = sorted(records_in(options.folder, warn), key=lambda record: record["key"])
    if not records:
        raise MrpSumoError(f"{options.folder}: no run has a result")
    if options.runs is not None and options.runs > len(records):
        raise MrpSumoError(f"--runs: found {options.runs}, expected 1 to {len(records)}, the runs of {options.folder}")
    step = max(1, len(records) // options.runs) if options.runs else 1
    return records[::step][: options.runs]
