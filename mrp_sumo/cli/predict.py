"""Hold a simulation against a fleet's log: calibrate robots on its first part, drive the orders of the rest, compare both.

SCENARIO is the site: its map, stations, planner and dispatcher, and types of robots as far as the log does not tell them. LOG is what
`calibrate` reads. Orders of the later part come from the log, or from a CSV with the columns release_s and stops, whose times are those of
the log. Compared are lead times, waits at stations, throughput and utilisation, each with a band of 90 % from seeds and from the
intervals of the calibrated figures. --out gets the page, the types, both as run folders, and a replay of both on one clock.
"""

import argparse
import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mrp_sumo.cli.option_rules import require_within, share
from mrp_sumo.cli.printing import plain_table, print_table, say, say_json, warn_of_kernels
from mrp_sumo.errors import MrpSumoError

if TYPE_CHECKING:
    from mrp_sumo.calibration.prediction import Prediction

RUNS, MOST_RUNS = 10, 1000


def arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("scenario", metavar="SCENARIO", help="scenario file of the site, or the name of a bundled scenario")
    parser.add_argument("--log", metavar="LOG", type=Path, required=True, help="what `calibrate` reads, with orders or actions")
    parser.add_argument(
        "--hold-out", metavar="SHARE", default="0.5", help="share of the log's time that is predicted, its end (default: 0.5; or 50%%)"
    )
    parser.add_argument("--orders", metavar="FILE.csv", type=Path, help="orders to drive instead of those that the log shows")
    parser.add_argument("--runs", metavar="N", type=int, default=RUNS, help=f"simulations for the band, 3 or more (default: {RUNS})")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder of the page (default: runs/predict_<scenario>)")
    parser.add_argument("--json", action="store_true", help="print the comparison as a line of JSON")


def run(options: argparse.Namespace) -> int:
    """Predict, compare, write, print."""
    from mrp_sumo.calibration.orders import matched, orders_of_file
    from mrp_sumo.calibration.prediction import predicted
    from mrp_sumo.calibration.reading import read_fleet
    from mrp_sumo.cli.run import progress_bar
    from mrp_sumo.cli.scenario_choice import require_scenario
    from mrp_sumo.experiments.map_cache import MapCache
    from mrp_sumo.files.folders import is_replaceable
    from mrp_sumo.files.writing import new_folder
    from mrp_sumo.io.scenario.file import find_scenario
    from mrp_sumo.io.scenario.names import require_known
    from mrp_sumo.io.scenario.read import read_scenario
    from mrp_sumo.reports.prediction import DOCUMENT, PAGE, write_prediction

    hold_out = share("--hold-out", options.hold_out, 0.05, 0.95)
    require_within("--runs", options.runs, 3, MOST_RUNS, expected=f"3 to {MOST_RUNS}: fewer make no band")
    require_scenario(options.scenario)
    file = read_scenario(find_scenario(options.scenario))
    require_known(file)
    out = (options.out or Path("runs") / f"predict_{file.scenario.name}").resolve()
    if not is_replaceable(out, DOCUMENT):
        raise MrpSumoError(f"--out {out}: exists and is no earlier prediction, choose another place")
    log = read_fleet(options.log)
    if options.orders is not None:
        log = replace(log, orders=matched(orders_of_file(options.orders), log.orders))
    warn_of_kernels()
    with new_folder(out) as new, MapCache() as maps, progress_bar() as progress:
        result = predicted(file, log, hold_out=hold_out, runs=options.runs, folder=new, maps=maps, report=progress)
        progress("writing", 0.0, 0.0)
        write_prediction(result, file.scenario.name, new, maps)
    if options.json:
        say_json(result.document | {"page": str(out / PAGE)})
    else:
        _print(result, out)
    return 0


def _print(result: "Prediction", out: Path) -> None:
    from mrp_sumo.reports.prediction import PAGE, figure_text

    held = result.held
    say(f"{held.log.source}: {held.log.kind}, {len(held.vehicles)} vehicles, cut at {held.cut_s:.0f} s, {held.span_s:.0f} s predicted")
    for note in result.notes:
        say(f"note: {note}")
    table = plain_table("", "log", "predicted", "error", "90 % band", "", right=range(1, 4))
    for each in result.figures:
        error = f"{100 * each.error:+.1f} %" if each.error == each.error else ""
        band = f"{figure_text(each.low)} to {figure_text(each.high)} {each.unit}"
        table.add_row(each.label, figure_text(each.logged), figure_text(each.predicted), error, band, "" if each.holds else "does not hold")
    print_table(table, 120)
    for name, both in result.drift.items():
        say(f"drift: {name}: {both}")
    say(f"written: {out / PAGE}", f"next: mrp-sumo replay {shlex.quote(str(out / 'log'))} {shlex.quote(str(out / 'simulation'))} --serve")
