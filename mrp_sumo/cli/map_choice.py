"""Arguments that all commands about a map file share: which part of it is used, and how it is repaired."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.cli.option_rules import above_0
from mrp_sumo.cli.printing import say
from mrp_sumo.cli.scenario_choice import scale_argument, trust_named
from mrp_sumo.errors import ChoiceError

if TYPE_CHECKING:
    from mrp_sumo.maps.map import Map


def add_choice(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--reader",
        metavar="NAME",
        type=_named,
        help="map reader; FILE.py:CLASS for one of your own (default: the one that recognises the file)",
    )
    add("--graph", metavar="N|N,N|all", type=_graph, help="graph of a building, or several united (default: the lowest)")
    add("--level", metavar="NAME", help="level of a building (default: all that the graph is on)")
    scale_argument(parser)
    add("--layers", metavar="NAME,NAME", type=_layers, help="of a DXF or SVG: the layers that hold its walls (default: all that are shown)")
    add("--unit", metavar="U", help="of a DXF: mm, cm, dm, m, in or ft (default: as it says)")
    add("--page", metavar="N", type=int, help="of a PDF: the page that holds the plan (default: 1)")
    add("--vehicle-type", metavar="NAME", help="of a LIF: only the edges for this type of vehicle (default: all)")
    add("--cell", metavar="M", type=above_0, default=0.4, help="side of a grid's cells (default: 0.4 m)")
    add("--robot-radius", metavar="M", type=above_0, help="room a robot needs on a ROS map (default: a TurtleBot3 Burger's, 0.1126 m)")
    add("--snap", metavar="M", type=above_0, help="repair: join ends that lie this close to a vertex or lane they are not on")
    add("--split-crossings", action="store_true", help="repair: put a vertex where lanes cross without one")
    add("--join-short", metavar="M", type=above_0, help="repair: join the ends of lanes shorter than this, where one end is unnamed")
    add("--largest-component", action="store_true", help="repair: keep the largest connected piece only")


def chosen_map(file: str, options: argparse.Namespace) -> "Map":
    """The map named on the command line, as chosen and repaired; repairs are reported on stderr."""
    from mrp_sumo.maps.catalogue import find_map
    from mrp_sumo.maps.repair import repair

    map_ = drawn_map(find_map(file, Path()), options, graph=options.graph, level=options.level)
    if options.snap is None and options.join_short is None and not options.split_crossings and not options.largest_component:
        return map_
    map_, changes = repair(
        map_,
        snap_m=options.snap,
        split_at_crossings=options.split_crossings,
        join_short_m=options.join_short,
        only_largest=options.largest_component,
    )
    for change in changes or ("nothing to repair",):
        say(f"repair: {change}", to_stderr=True)
    return map_


def drawn_map(path: Path, options: argparse.Namespace, **part: Any) -> "Map":
    """The map in a file, as it is drawn; `part` of it, as `load_map` has it."""
    from mrp_sumo.maps.load import load_map

    chosen = {name: getattr(options, name) for name in ("meters_per_pixel", "vehicle_type", "layers", "unit", "page")}
    if options.robot_radius is not None:
        chosen["robot_radius_m"] = options.robot_radius
    map_ = load_map(path, reader=options.reader, cell_m=options.cell, **chosen, **part)
    if options.robot_radius is not None and (map_.free is None or path.suffix in (".map", ".scen")):
        raise ChoiceError(f"{path.name}: --robot-radius is for occupancy maps and plans of a floor; --robot tells where it has no room")
    return map_


def _layers(text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise argparse.ArgumentTypeError(f"'{text}' names no layer")
    return names


def _named(reader: str) -> str:
    """A reader that the user names, and so trusts."""
    trust_named(reader)
    return reader


def _graph(text: str) -> int | tuple[int, ...] | str:
    if text == "all":
        return text
    if not all(part.isdecimal() for part in text.split(",")):
        raise argparse.ArgumentTypeError(f"'{text}' is neither a number nor 'all'")
    numbers = tuple(map(int, text.split(",")))
    return numbers if len(numbers) > 1 else numbers[0]
