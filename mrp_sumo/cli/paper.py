"""Make everything of the MRP-Bench paper from nothing and set its numbers beside ours: Tables I to IV, Figure 5, replicability.

DIR gets paper.json, index.html, figures/ as SVG and PNG, tables/ as CSV, Markdown and LaTeX, and results/ with the runs. Started again,
it goes on where it was. Exit code 0 when every run has a result, 1 when some crashed, took too much or cannot be run, 2 for bad input,
130 or 143 when it was interrupted.
"""

import argparse
from pathlib import Path

from mrp_sumo.cli.batch import watcher, workers_of
from mrp_sumo.cli.ending import stoppable
from mrp_sumo.cli.option_rules import require_least
from mrp_sumo.cli.printing import say_either
from mrp_sumo.errors import duration


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo paper`."""
    add = parser.add_argument
    add("--out", default="runs/paper", metavar="DIR", help="folder of runs and page (default: runs/paper)")
    add("--seeds", type=int, metavar="N", help="only the first N seeds of every study, for a result sooner (default: all, 54 and 100)")
    add("--maps", type=Path, metavar="DIR", help="an MRP-Bench checkout: use its maps instead of our drawings of them")
    add("--workers", type=int, metavar="N", help="processes (default: one a core)")
    add("--json", action="store_true", help="print the page, how many numbers agree, and how many runs there were as a line of JSON")


def run(options: argparse.Namespace) -> int:
    """Make the runs, write the page, say how long it took."""
    workers = workers_of(options)
    require_least("--seeds", options.seeds, 1)
    from mrp_sumo.experiments.batch import Making
    from mrp_sumo.experiments.paper import Campaign, run_campaign  # with all that runs and draws: after the options are sound
    from mrp_sumo.reports.paper.page import compare_with_paper, write_paper

    campaign = Campaign(Path(options.out), options.maps, options.seeds)
    with stoppable() as stop, watcher() as shown:
        made = run_campaign(campaign, shown, Making(workers, stop=stop))
    if not made.finished:
        return stop.interrupted(options.command_line)
    comparison = compare_with_paper(campaign)
    page = write_paper(campaign, comparison, made)
    agree = sum(bool(row.agrees) for row in comparison.compared)
    say_either(
        options.json,
        {"file": str(page), "agree": agree, "compared": len(comparison.compared), "runs": made.num_runs, "broken": made.num_broken},
        f"{agree} of {len(comparison.compared)} numbers of the paper lie in our 95 % intervals",
        f"{page}; {made.num_runs} runs, {made.num_made} made now, in {duration(made.seconds)}",
    )
    return 1 if made.num_broken else 0
