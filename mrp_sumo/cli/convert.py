"""Convert a map or a plan to another format; the suffix of DST chooses.

Maps: .nav.yaml (Open-RMF nav graph), .map (MovingAI), .geojson, .net.xml (SUMO), .lif.json (VDMA LIF 1.0) or .xml (openTCS plant
model); what the format cannot hold is listed.
Plans: .json (this program's; needs --map), .yaml (libMultiRobotPlanning), .txt (EECBS, or as --format says).
"""

import argparse
from pathlib import Path

from mrp_sumo.cli.map_choice import add_choice, chosen_map
from mrp_sumo.cli.option_rules import only_for
from mrp_sumo.cli.printing import say, say_json
from mrp_sumo.errors import MrpSumoError


def arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("source", metavar="SRC", help="a map file, the name of a bundled map, or a plan file")
    parser.add_argument("destination", metavar="DST", type=Path, help="the file to write")
    parser.add_argument("--map", type=Path, metavar="FILE", help="of a plan: the grid or roadmap it is on (.map or YAML)")
    parser.add_argument("--format", metavar="NAME", help="of a plan: json, yaml, paths, lacam or smart (default: by the suffix)")
    parser.add_argument("--json", action="store_true", help="print what was written and lost as JSON")
    add_choice(parser)


def run(options: argparse.Namespace) -> int:
    """Convert, and tell what was lost."""
    from mrp_sumo.cli.plan_choice import is_plan
    from mrp_sumo.io.map_files import write_map

    if options.destination.exists() and Path(options.source).exists() and options.destination.samefile(options.source):
        raise MrpSumoError(f"{options.destination}: is what is converted, expected another file to write")
    if is_plan(Path(options.source)):
        only_for("maps", **{name: getattr(options, name) for name in ("graph", "level", "snap", "join_short", "reader", "robot_radius")})
        _convert_plan(Path(options.source), options.destination, options.format, options.map)
        losses = []
    else:
        only_for("plans", map=options.map, format=options.format)
        losses = write_map(chosen_map(options.source, options), options.destination, options.cell)
    if options.json:
        say_json({"written": str(options.destination), "lost": losses}, indent=2)
        return 0
    say(f"{options.destination}: written", *(f"lost: {loss}" for loss in losses))
    return 0


def _convert_plan(source: Path, destination: Path, chosen: str | None, map_path: Path | None) -> None:
    """Cells are copied as they are; between cells and this program's vertices the map is needed."""
    from dataclasses import replace

    from mrp_sumo.cli.plan_choice import kind_of, step_of, write
    from mrp_sumo.errors import PlanError
    from mrp_sumo.files.writing import write_text
    from mrp_sumo.formats.instances import problem_of_places, read_instance
    from mrp_sumo.formats.peers import print_places, read_places
    from mrp_sumo.formats.plan_files import is_json, read_plan_file, require_on_graph, text_of
    from mrp_sumo.formats.plan_json import read_plan

    text, kind = text_of(source), kind_of(destination, chosen)
    if not is_json(text) and kind != "json":
        write_text(destination, print_places(read_places(text, None, source.name), kind))
        return
    if map_path is None:
        raise PlanError(f"{source.name}: to turn {'vertices' if is_json(text) else 'cells'} into others takes the map: add --map")
    instance = read_instance(map_path, None, 0)
    if is_json(text):
        plan = read_plan(source)
        require_on_graph(plan, instance.problem.graph, source.name, map_path.name)
        write(destination, kind, replace(instance.problem, step_s=step_of(text)), plan, instance.cells)
        return
    problem = problem_of_places(instance, read_places(text, None, source.name), source.name)
    write(destination, kind, problem, read_plan_file(source, problem, instance.cells)[0], instance.cells)
