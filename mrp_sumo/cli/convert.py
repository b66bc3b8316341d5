"""Convert a map, a plan or a type of robots to another format; the suffix of DST chooses.

Maps: .nav.yaml (Open-RMF nav graph), .map (MovingAI), .geojson, .net.xml (SUMO), .lif.json (VDMA LIF 1.0) or .xml (openTCS plant
model); what the format cannot hold is listed.
Plans: .json (this program's; needs --map), .yaml (libMultiRobotPlanning), .txt (EECBS, or as --format says).
Types of robots: .json (a factsheet of VDA 5050) or .yaml (as in robots/), from a factsheet, a name of `list robots` or a file of that form;
what was guessed and what the format cannot hold is listed.
"""

import argparse
from pathlib import Path

from mrp_sumo.cli.map_choice import add_choice, chosen_map
from mrp_sumo.cli.option_rules import only_for
from mrp_sumo.cli.printing import say, say_json
from mrp_sumo.errors import MrpSumoError

OF_MAPS = ("graph", "level", "snap", "join_short", "reader", "robot_radius")
MOST_BYTES = 1_000_000  # of files of types
TYPE_KEYS = {"length_m", "width_m", "max_speed_mps", "accel_mps2", "decel_mps2"}  # of files of types; the first of them none else has


def arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("source", metavar="SRC", help="a map file, the name of a bundled map, a plan file, or a type of robots")
    parser.add_argument("destination", metavar="DST", type=Path, help="the file to write")
    parser.add_argument("--map", type=Path, metavar="FILE", help="of a plan: the grid or roadmap it is on (.map or YAML)")
    parser.add_argument("--format", metavar="NAME", help="of a plan: json, yaml, paths, lacam or smart (default: by the suffix)")
    parser.add_argument("--vda5050", metavar="VERSION", help="of a factsheet: 2.1 or 3.0 (the default, which has rates of turning, too)")
    parser.add_argument("--json", action="store_true", help="print what was written and lost as JSON")
    add_choice(parser)


def run(options: argparse.Namespace) -> int:
    """Convert, and tell what was lost."""
    from mrp_sumo.cli.plan_choice import is_plan
    from mrp_sumo.formats.vda.factsheet import is_factsheet
    from mrp_sumo.io.map_files import write_map

    if options.destination.exists() and Path(options.source).exists() and options.destination.samefile(options.source):
        raise MrpSumoError(f"{options.destination}: is what is converted, expected another file to write")
    notes: list[str] = []
    is_type = is_factsheet(Path(options.source)) or _names_type(options.source)
    if not is_type:
        only_for("types of robots", vda5050=options.vda5050)
    if is_type:
        only_for("maps", **{name: getattr(options, name) for name in OF_MAPS})
        only_for("plans", map=options.map, format=options.format)
        losses, notes = _convert_type(options.source, options.destination, options.vda5050)
    elif is_plan(Path(options.source)):
        only_for("maps", **{name: getattr(options, name) for name in OF_MAPS})
        _convert_plan(Path(options.source), options.destination, options.format, options.map)
        losses = []
    else:
        only_for("plans", map=options.map, format=options.format)
        losses = write_map(chosen_map(options.source, options), options.destination, options.cell)
    if options.json:
        say_json({"written": str(options.destination), "lost": losses} | ({"notes": notes} if is_type else {}), indent=2)
        return 0
    say(f"{options.destination}: written", *(f"lost: {loss}" for loss in losses), *notes)
    return 0


def _names_type(source: str) -> bool:
    """True for a type of robots by name, and a YAML file of one."""
    from mrp_sumo.maps.catalogue import bundled_folder

    path = Path(source)
    if not path.exists():
        return (bundled_folder("robots") / f"{source}.yaml").is_file()
    if path.suffix.lower() not in (".yaml", ".yml") or not path.is_file() or path.stat().st_size > MOST_BYTES:
        return False
    text = path.read_text(encoding="utf-8", errors="replace")
    return any(line.partition(":")[0] in TYPE_KEYS for line in text.splitlines())


def _convert_type(source: str, destination: Path, version: str | None) -> tuple[list[str], list[str]]:
    """Write a type as a factsheet or as a file of robots/; returns what is lost, and notes on what was guessed."""
    from mrp_sumo.files.writing import write_text
    from mrp_sumo.formats.vda.factsheet import factsheet_file, is_factsheet, lost, read_factsheet
    from mrp_sumo.formats.vda.messages import Dialect
    from mrp_sumo.io.scenario.robots import robot_type, text_of_type
    from mrp_sumo.maps.catalogue import bundled_folder

    kind = destination.suffix.lower()
    if kind not in (".json", ".yaml", ".yml"):
        raise MrpSumoError(f"{destination.name}: found '{kind}', expected .json (a factsheet) or .yaml for a type of robots")
    if is_factsheet(Path(source)):
        robot, notes = read_factsheet(Path(source))
    else:
        robot, notes = robot_type(source, bundled_folder("robots"), Path()), []
    if kind != ".json":
        only_for("factsheets: a DST that ends in .json", vda5050=version)
        write_text(destination, text_of_type(robot, notes))
        return [], notes
    version = version or "3.0"
    write_text(destination, factsheet_file(robot, version))
    losses = lost(robot, Dialect(version))
    return [losses] if losses else [], notes


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
