"""Convert a map, a plan or a type of robots to another format; the suffix of DST chooses.

Maps: .nav.yaml (Open-RMF nav graph), .map (MovingAI), .geojson, .net.xml (SUMO), .lif.json (VDMA LIF 1.0) or .xml (openTCS plant
model); what the format cannot hold is listed.
Plans: .json (this program's; needs --map), .yaml (libMultiRobotPlanning), .txt (EECBS, or as --format says).
Types of robots: .json (a factsheet of VDA 5050) or .yaml (as in robots/), from a factsheet, a name of `list robots`, a file of that form,
or .yaml from a vehicle of an openTCS plant model; what was guessed and what the format cannot hold is listed.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mrp_sumo.cli.map_choice import add_choice, chosen_map
from mrp_sumo.cli.option_rules import only_for
from mrp_sumo.cli.printing import say_either
from mrp_sumo.errors import MrpSumoError, OptionError, ScenarioError, nearest

if TYPE_CHECKING:
    from mrp_sumo.maps.map import Map

OF_MAPS = ("graph", "level", "snap", "join_short", "reader", "robot_radius", "robot")
MOST_BYTES = 1_000_000  # of files of types
TYPE_KEYS = {
    "length_m",
    "width_m",
    "max_speed_mps",
    "accel_mps2",
    "decel_mps2",
}  # one of which a file of a type has, whatever else is wrong with it


def arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("source", metavar="SRC", help="a map file, the name of a bundled map, a plan file, or a type of robots")
    parser.add_argument("destination", metavar="DST", type=Path, help="the file to write")
    parser.add_argument("--map", type=Path, metavar="FILE", help="of a plan: the grid or roadmap it is on (.map or YAML)")
    parser.add_argument("--format", metavar="NAME", help="of a plan: json, yaml, paths, lacam or smart (default: by the suffix)")
    parser.add_argument(
        "--robot", metavar="TYPE", action="append", default=[], help="of LIF and openTCS: write it for this type; repeatable"
    )
    parser.add_argument("--vda5050", metavar="VERSION", help="of a factsheet: 2.1 or 3.0 (the default, which has rates of turning, too)")
    parser.add_argument("--json", action="store_true", help="print what was written and lost as JSON")
    add_choice(parser)


def run(options: argparse.Namespace) -> int:
    """Convert, and tell what was lost."""
    from mrp_sumo.cli.plan_choice import is_plan
    from mrp_sumo.formats.vda.factsheet import is_factsheet

    source, destination = Path(options.source), options.destination
    if destination.exists() and source.exists() and destination.samefile(source):
        raise MrpSumoError(f"{destination}: is what is converted, expected another file to write")
    notes: list[str] = []
    losses: list[str] = []
    if is_factsheet(source) or _names_type(options.source):
        only_for("maps", **{name: getattr(options, name) for name in OF_MAPS})
        only_for("plans", map=options.map, format=options.format)
        losses, notes = _convert_type(options.source, destination, options.vda5050)
    elif is_plan(source):
        only_for("maps", **{name: getattr(options, name) for name in OF_MAPS})
        only_for("types of robots", vda5050=options.vda5050)
        _convert_plan(source, destination, options.format, options.map)
    else:
        only_for("plans", map=options.map, format=options.format)
        only_for("types of robots", vda5050=options.vda5050)
        losses, notes = _convert_map(options)
    document = {"written": str(destination), "lost": losses} | ({"notes": notes} if notes else {})
    say_either(options.json, document, f"{destination}: written", *(f"lost: {loss}" for loss in losses), *notes, indent=2)
    return 0


def _convert_map(options: argparse.Namespace) -> tuple[list[str], list[str]]:
    """Write a map, or a vehicle that it lists as a type of robots; returns what is lost, and notes on what was guessed."""
    from mrp_sumo.io.map_files import write_map
    from mrp_sumo.io.scenario.robots import robot_type
    from mrp_sumo.maps.catalogue import bundled_folder, find_map
    from mrp_sumo.maps.load import load_map

    if options.destination.suffix.lower() in (".yaml", ".yml") and not options.destination.name.endswith(".nav.yaml"):
        map_ = load_map(find_map(options.source, Path()), reader=options.reader)
        if map_.vehicles or map_.vehicle_types:
            return [], _write_vehicle(map_, options.vehicle_type, options.destination)
    robots = [robot_type(name, bundled_folder("robots"), Path()) for name in options.robot]
    return write_map(chosen_map(options.source, options), options.destination, options.cell, robots), []


def _write_vehicle(map_: "Map", wanted: str | None, destination: Path) -> list[str]:
    """Write a vehicle that a map lists, the longest by default, as a type of robots; returns what was guessed and left out."""
    from dataclasses import replace

    from mrp_sumo.experiments.proposal import type_like, type_of
    from mrp_sumo.files.writing import write_text
    from mrp_sumo.io.scenario.robots import text_of_type

    name = map_.path.name
    if not map_.vehicles:
        kinds = ", ".join(map_.vehicle_types)
        raise MrpSumoError(f"{name}: has no sizes of vehicles: convert the factsheet of {kinds}, or write a type with that as vehicle_type")
    known = {each.name: each for each in map_.vehicles}
    if wanted is not None and wanted not in known:
        raise MrpSumoError(f"--vehicle-type: no vehicle '{wanted[:60]}' in {name}{nearest(wanted, known)}")
    vehicle = map_.longest_vehicle if wanted is None else known[wanted]
    if vehicle is None or min(vehicle.length_m, vehicle.max_speed_mps) <= 0:
        raise MrpSumoError(f"{name}: vehicle '{wanted or next(iter(known))}' has no length or no maxVelocity, expected both")
    try:
        if (written := type_of(vehicle)) is not None:
            write_text(destination, text_of_type(written))
            return []
        like = type_like(vehicle)
    except ScenarioError as error:
        raise MrpSumoError(f"{name}: {error}") from None
    except OptionError as error:
        raise MrpSumoError(f"{name}: vehicle '{vehicle.name}': {error}") from None
    robot, is_said = replace(like, source=f"vehicle {vehicle.name} of {name}", battery=None), vehicle.clear_m > like.radius_m
    if is_said:
        robot = replace(robot, gap_m=round(2 * (vehicle.clear_m - robot.radius_m), 6))
    more = "".join(f"{key}, " for key, is_guessed in (("width_m", vehicle.width_m is None), ("gap_m", not is_said)) if is_guessed)
    notes = [f"guessed: {more}accelerations and rate of turning, those of the bundled type '{like.name}'; that it turns in place"]
    if vehicle.reverse_mps not in (0.0, vehicle.max_speed_mps):
        notes.append(f"left out: maxReverseVelocity, {vehicle.reverse_mps:g} m/s, which types that turn in place do not have")
    write_text(destination, text_of_type(robot, notes))
    return notes


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
