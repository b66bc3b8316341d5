"""Options of error bands, shared by the commands that state them."""

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

from mrp_sumo.cli.option_rules import only_for
from mrp_sumo.errors import MrpSumoError

if TYPE_CHECKING:
    from mrp_sumo.io.scenario.file import ScenarioFile

NUMBER = r"([+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)"


def arguments(parser: argparse.ArgumentParser) -> None:
    """`--error-bands`, `--interval` and `--intervals`, which `bounds_of` reads."""
    parser.add_argument(
        "--error-bands",
        action="store_true",
        help="say how much the answer moves when speed, acceleration, stops and the times at stations move within their intervals "
        "(10%% up and down where none is known), and which of them matters most; a handful of runs more",
    )
    parser.add_argument(
        "--interval",
        action="append",
        default=[],
        metavar="KEY=LOW:HIGH",
        help="of --error-bands: what a number of the scenario may be, such as robots.type.max_speed_mps=0.9:1.1, or KEY=5%% up and down; "
        "tasks.service_factor.NAME is the time at a station; may be repeated",
    )
    parser.add_argument("--intervals", type=Path, metavar="FILE", help="of --error-bands: YAML with a line `KEY: [LOW, HIGH]` for each")


def bounds_of(options: argparse.Namespace, file: "ScenarioFile") -> dict[str, tuple[float, float]] | None:
    """Intervals that the options give; None where no error bands are wanted. Raises MrpSumoError: one line."""
    if not options.error_bands:
        only_for("--error-bands", interval=options.interval or None, intervals=options.intervals)
        return None
    bounds = dict(_of_file(options.intervals)) if options.intervals else {}
    for text in options.interval:
        key, equals, span = (part.strip() for part in text.partition("="))
        between, share = re.fullmatch(rf"{NUMBER}\s*:\s*{NUMBER}", span), re.fullmatch(rf"{NUMBER}\s*%", span)
        if not equals or not key or not (between or share):
            raise MrpSumoError(f"--interval {text}: expected KEY=LOW:HIGH or KEY=5%, such as robots.type.max_speed_mps=0.9:1.1")
        if between:
            bounds[key] = float(between[1]), float(between[2])
            continue
        assert share is not None
        from mrp_sumo.experiments.error_bands import value_of

        value, part = value_of(file, key), float(share[1]) / 100
        if part >= 1:
            raise MrpSumoError(f"--interval {text}: found {share[1]} %, expected less than 100: up and down")
        bounds[key] = value * (1 - part), value * (1 + part)
    return bounds


def _of_file(path: Path) -> dict[str, tuple[float, float]]:
    from mrp_sumo.io.documents import read_document

    document, bounds = read_document(path), {}
    for key, span in document.content.items():
        numbers = [value for value in span if isinstance(value, float | int)] if isinstance(span, list) else []
        if len(numbers) != 2 or len(span) != 2:
            raise MrpSumoError(f"{document.at((key,))}: found {span!r:.60}, expected [low, high]")
        bounds[str(key)] = float(numbers[0]), float(numbers[1])
    return bounds
