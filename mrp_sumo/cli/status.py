"""Print the state of a batch: how many runs ended how, and whether it is under way.

Exit code 0 when every run has a result, 1 when some are missing, 2 for bad input.
"""

import argparse
import time
from collections import Counter
from contextlib import closing
from pathlib import Path

from mrp_sumo.cli.ending import until_ctrl_c
from mrp_sumo.cli.option_rules import only_for, port_number
from mrp_sumo.cli.printing import say, say_json, warn
from mrp_sumo.cli.result_folder import batch_folder
from mrp_sumo.errors import MrpSumoError

EVERY_S = 1.0  # looks at the folder


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo status`."""
    parser.add_argument("folder", metavar="DIR", type=batch_folder, help="folder of a batch")
    parser.add_argument("--json", action="store_true", help="print a line of JSON")
    parser.add_argument("--live", action="store_true", help="show it in a browser, as runs end, until Ctrl+C")
    parser.add_argument("--port", type=port_number, metavar="N", help="of --live (default: any free port)")


def run(options: argparse.Namespace) -> int:
    """Print a line about the batch, and one about each status."""
    from mrp_sumo.experiments.batch import is_under_way
    from mrp_sumo.io.results import read_plan, records_in

    folder = Path(options.folder)
    if not options.live:
        only_for("--live", port=options.port)
    elif options.json:
        raise MrpSumoError("--live shows the batch in a browser: leave out --json")
    if options.live:
        _watch(folder, options.port or 0)
    plan = read_plan(folder)
    keys = set(plan["keys"])
    statuses: Counter[str] = Counter()
    reasons: dict[str, str] = {}
    wall_s = 0.0
    for record in records_in(folder, warn):
        if record["key"] in keys:
            statuses[record["status"]] += 1
            wall_s += record["run_wall_s"] or 0.0
            if not record["success"] and record["reason"]:
                reasons.setdefault(record["status"], f"{record['key']}: {record['reason']}")
    done = statuses.total()
    state = "under way" if is_under_way(folder) else "complete" if done == len(keys) else "not under way"
    if options.json:
        say_json({"suite": plan["suite"], "runs": len(keys), "done": done, "state": state, "statuses": dict(statuses)})
        return 0 if done == len(keys) else 1
    say(f"{plan['suite']}: {done} of {len(keys)} runs done, {state} (mrp_sumo {plan['code']})")
    for status, count in statuses.most_common():
        example = f"  such as {reasons[status]}" if status in reasons else ""
        say(f"  {count:>7}  {status.replace('_', ' ')}{example}")
    if done:
        say(f"  {wall_s / done:.2f} s a run on average")
    quarantined = len(list((folder / "quarantine").glob("*"))) if (folder / "quarantine").is_dir() else 0
    if quarantined:
        say(f"  {quarantined} result files in quarantine")
    return 0 if done == len(keys) else 1


def _watch(folder: Path, port: int) -> None:
    """Show the batch in a browser until Ctrl+C."""
    import webbrowser

    from mrp_sumo.reports.live.batch import BatchView

    view = BatchView(folder, port)
    with closing(view), until_ctrl_c():
        say(f"{view.server.address} (Ctrl+C ends)")
        webbrowser.open(view.server.address)
        while True:
            view.look(warn)
            time.sleep(EVERY_S)
