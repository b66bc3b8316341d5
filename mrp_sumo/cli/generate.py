"""Make a map of any size for scale studies, as a building file that imports like any other."""

import argparse
from inspect import signature
from pathlib import Path

from mrp_sumo.cli.printing import say_either
from mrp_sumo.errors import MapError, count, sentence
from mrp_sumo.maps.generate import GENERATORS, VERTICES_A_ROBOT

SUFFIX = ".building.yaml"
OPTIONS = {"one_way": "--one-way", "cross_aisles": "--cross-aisles", "bays": "--bays", "spacing_m": "--spacing", "seed": "--seed"}


def arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("kind", choices=tuple(GENERATORS), help="rack warehouse, street grid, ring, or random road map")
    size = parser.add_mutually_exclusive_group(required=True)
    size.add_argument("--robots-for", type=int, metavar="N", help=f"room for N robots: {VERTICES_A_ROBOT} vertices each, or a few more")
    size.add_argument("--vertices", type=int, metavar="N", help="N vertices, or a few more to complete the last row or aisle")
    parser.add_argument("--one-way", action="store_true", default=None, help="one-way lanes, in alternating directions (not for random)")
    parser.add_argument("--cross-aisles", type=int, metavar="K", help="of a warehouse (default: what makes it about as deep as wide)")
    parser.add_argument("--bays", type=int, metavar="B", help="of a warehouse: bays in an aisle between two cross aisles (default: 8)")
    parser.add_argument("--spacing", dest="spacing_m", type=float, metavar="M", help="metres between vertices (grid, ring: 2; random: 4)")
    parser.add_argument("--seed", type=int, metavar="S", help="of a random map (default: 0)")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help=f"to write; ends in {SUFFIX}")
    parser.add_argument("--json", action="store_true", help="print how large it is as JSON")


def run(options: argparse.Namespace) -> int:
    """Draw the map, write it, and say how large it is."""
    path: Path = options.out
    if not path.name.endswith(SUFFIX) or path.name == SUFFIX:
        raise MapError(f"--out {path}: a building file ends in {SUFFIX}")
    draw = GENERATORS[options.kind]
    parameters = {key: getattr(options, key) for key in OPTIONS if getattr(options, key) is not None}
    for key in parameters:
        if key not in signature(draw).parameters:
            kinds = [kind for kind, other in GENERATORS.items() if key in signature(other).parameters]
            raise MapError(f"{OPTIONS[key]} is not for a map of kind '{options.kind}', only for {', '.join(kinds)}")
    if options.seed is not None and options.seed < 0:
        raise MapError(f"--seed {options.seed}: expected 0 or more")
    if options.robots_for is not None and options.robots_for < 1:
        raise MapError(f"--robots-for {options.robots_for}: expected 1 or more robots")
    num_vertices = options.vertices if options.vertices is not None else max(12, VERTICES_A_ROBOT * options.robots_for)
    drawing = draw(num_vertices, **parameters)
    drawing.name = path.name.removesuffix(SUFFIX)
    try:
        drawing.write(path)
    except OSError as error:
        raise MapError(f"--out {path}: {sentence(error)}") from None
    room = len(drawing.stations) // VERTICES_A_ROBOT
    facts = {
        "written": str(path),
        "vertices": len(drawing.stations),
        "edges": len(drawing.lanes),
        "width_m": round(drawing.width_m, 3),
        "height_m": round(drawing.height_m, 3),
        "room_for_robots": room,
    }
    words = "{written}: {vertices} vertices, {edges} edges, {width_m:.1f} x {height_m:.1f} m, room for {robots}"
    say_either(options.json, facts, words.format(**facts, robots=count(room, "robot")), indent=2)
    return 0
