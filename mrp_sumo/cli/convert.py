"""Convert a map to another format; the suffix of DST chooses: .nav.yaml (Open-RMF nav graph), .map (MovingAI),
.geojson or .net.xml (SUMO). What the format cannot hold is listed.
"""

import argparse
from pathlib import Path

from mrp_sumo.cli.map_choice import add_choice, chosen_map


def arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("source", metavar="SRC", help="a map file, or the name of a bundled map")
    parser.add_argument("destination", metavar="DST", type=Path, help="the file to write")
    add_choice(parser)


def run(options: argparse.Namespace) -> int:
    """Convert, and tell what was lost."""
    from mrp_sumo.maps.write import write_map

    map_ = chosen_map(options.source, options)
    losses = write_map(map_, options.destination, options.cell)
    print(f"{options.destination}: written")
    for loss in losses:
        print(f"lost: {loss}")
    return 0
