"""Draw a run at a moment as a picture: PNG or SVG, without a screen."""

import argparse
import math
from pathlib import Path


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo render`."""
    parser.add_argument("run", help="run folder, as `mrp-sumo run --out` makes it")
    parser.add_argument("--at", type=float, required=True, metavar="T", help="simulated time in s")
    parser.add_argument("--out", required=True, metavar="FILE", help="the picture, .png or .svg")
    parser.add_argument("--dpi", type=float, default=150.0, metavar="N", help="of a PNG (default: 150)")


def run(options: argparse.Namespace) -> int:
    """Draw the picture."""
    from mrp_sumo.errors import MrpSumoError
    from mrp_sumo.io.run_reader import load_run
    from mrp_sumo.reports.pictures.still import render_still

    if not (math.isfinite(options.dpi) and 10 <= options.dpi <= 1200):
        raise MrpSumoError(f"--dpi {options.dpi:g}: expected 10 to 1200")
    print(render_still(load_run(options.run), options.at, Path(options.out), dpi=options.dpi))
    return 0
