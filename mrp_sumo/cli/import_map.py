"""Make a nav graph, a SUMO network and a picture of a map, and print its key facts.

FILE is an RMF building or nav graph, a LIF, an openTCS model, a route graph, a MovingAI .map or .scen, a ROS map_server YAML, a
plan of a floor (DXF with --layers and --unit, PNG, PDF or SVG with --scale), or the name of a bundled map. --out gets NAME.net.xml
(and NAME.poly.xml, what stands behind it in sumo-gui), one GRAPH.nav.yaml for each chosen graph (NAME.nav.yaml after repairs),
NAME.png, NAME.svg and facts.json, and of a plan NAME_map.yaml, which a scenario names as its map, and NAME.building.yaml, its walls
without a lane, to draw lanes on; whole or not at all. With --check only findings are printed, of the chosen part and after repairs,
and the exit code is 2 if the map is refused. Lanes and vertices where walls leave a robot no room are notes.

A FILE.jsonl is a recorded stream of VDA 5050 messages, `{"t_s":, "topic":, "payload": {}}` a line: --out gets a run folder, for `replay`,
`render`, `report` and `export`, with the audit of what was driven; --map says which map has its walls.

With --log, logs of a fleet (all that `calibrate` reads, several of one fleet as one) become a fleet log archive, a folder or a .zip;
--map puts the map into it. See docs/archive.md.
"""

import argparse
import json
import shlex
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.cli.map_choice import add_choice, chosen_map
from mrp_sumo.cli.option_rules import only_for
from mrp_sumo.cli.printing import plain_table, print_table, say, say_json
from mrp_sumo.errors import ChoiceError, MapError, sentence
from mrp_sumo.files.folders import is_replaceable

if TYPE_CHECKING:
    from mrp_sumo.core.robot_type import RobotType
    from mrp_sumo.maps.finding import MapFinding
    from mrp_sumo.maps.map import Map

DEFAULT_ROBOT = "turtlebot3"
NOTES = 4  # shown beside the findings
FACTS = "facts.json"  # written last: a folder with it was made by this command


def arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("file", metavar="FILE", nargs="?", help="a map file, or the name of a bundled map")
    parser.add_argument("--log", metavar="LOG", nargs="+", type=Path, help="logs of a fleet instead, which become an archive")
    parser.add_argument("--licence", metavar="TEXT", help="of --log: under which the archive may be used, such as CC-BY-4.0")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder for the results; one that an earlier import made is replaced")
    add_choice(parser)
    parser.add_argument(
        "--robot",
        metavar="TYPE",
        help="type of robot that needs room beside the walls, of robots/ or a YAML file (default: turtlebot3); --json then says so too",
    )
    parser.add_argument("--map", metavar="MAP", help="of a recorded stream or of --log: a map file or the name of a bundled map")
    parser.add_argument("--json", action="store_true", help="print the key facts as JSON; without --out nothing is written")
    parser.add_argument("--check", action="store_true", help="only report findings")


def run(options: argparse.Namespace) -> int:
    """Import, and print what came of it."""
    from mrp_sumo.maps.catalogue import find_map
    from mrp_sumo.maps.clearance import narrow
    from mrp_sumo.maps.facts import facts

    if options.log is not None:
        from mrp_sumo.cli.archive import import_logs

        return import_logs(options)
    only_for("--log", licence=options.licence)
    if options.file is None:
        raise MapError("expected a FILE, or --log LOG")
    if Path(options.file).suffix == ".jsonl":
        return _import_stream(options)
    only_for("a recorded stream, FILE.jsonl", map=options.map)
    if options.check:
        return _check(options)
    if options.out is None and not options.json:
        find_map(options.file, Path())  # that there is no such map comes before what to do with it
        raise MapError("say where to write with --out DIR, or use --json or --check to print only")
    if options.out is not None and not is_replaceable(options.out, FACTS):
        raise MapError(f"{options.out} exists and is no folder of an earlier import: choose another --out")
    model = _robot_type(options.robot)
    map_ = chosen_map(options.file, options)
    clearance = narrow(map_.nav, map_.building, model)
    room = {"robot": model.name, "lanes": len(clearance.lanes), "vertices": len(clearance.vertices), "notes": list(clearance.notes)}
    known = facts(map_, options.cell)
    written = {**known, "clearance": room}
    if options.out is not None:
        _write(map_, written, options.out)
    if options.json:
        say_json(written if options.robot else known, indent=2)
    else:
        _print(map_, written, options)
    return 0


def _import_stream(options: argparse.Namespace) -> int:
    from mrp_sumo.cli.run import print_run
    from mrp_sumo.errors import MrpSumoError
    from mrp_sumo.experiments.map_cache import MapCache
    from mrp_sumo.experiments.recorded import recorded_run
    from mrp_sumo.io.run_folder import check_replaceable
    from mrp_sumo.metrics import audit

    if options.check:
        raise MrpSumoError(f"--check is for maps; a stream is judged by `mrp-sumo validate --vda5050 {options.file}`")
    if options.out is None:
        raise MrpSumoError("say where to write with --out DIR")
    check_replaceable(options.out)
    audit.prepare()
    with MapCache() as maps:
        drawn = chosen_map(options.map, options) if options.map else None
        result = recorded_run(Path(options.file), _robot_type(options.robot), drawn)
        result.write(options.out, maps)
    print_run(result, options.out, as_json=options.json)
    return 0 if result.status == "completed" else 1


def _check(options: argparse.Namespace) -> int:
    from mrp_sumo.maps.catalogue import find_map
    from mrp_sumo.maps.check import findings_of
    from mrp_sumo.maps.clearance import narrow
    from mrp_sumo.maps.map import unused
    from mrp_sumo.maps.oddities import oddities

    if options.out is not None:
        raise MapError("--check writes nothing: leave out --out")
    path, model = find_map(options.file, Path()), _robot_type(options.robot)
    try:
        map_ = chosen_map(options.file, options)
        findings, notes, without_effect = map_.findings, oddities(map_.building) if map_.building else (), unused(map_)
        clearance = narrow(map_.nav, map_.building, model)
        room, lanes, turns = clearance.notes, clearance.lane_notes, _narrow_turns(map_, model)
    except ChoiceError:
        raise
    except MapError as error:
        findings, notes, room, lanes, turns, without_effect = findings_of(error), (), (), (), (), ""
    refused = any(finding.severity == "refuse" for finding in findings)
    if options.json:
        warnings = [finding.document() for finding in findings]
        document = {"file": path.name, "refused": refused, "warnings": warnings, "notes": notes, "unused": without_effect}
        say_json({**document, "clearance": room, "narrow_lanes": lanes, "narrow_turns": turns} if options.robot else document, indent=2)
    else:
        lines = [f"{finding.severity}: {finding.line}" for finding in findings]
        lines += [f"note: {note}" for note in (*notes, *room, *(lanes if len(lanes) > 1 else ()), *turns)]
        lines += [f"info: {without_effect}"] if without_effect else []
        say(*(f"{path.name}: {line}" for line in lines or ["nothing to report"]))
    return 2 if refused else 0


def _narrow_turns(map_: "Map", model: "RobotType") -> tuple[str, ...]:
    """Lines on turns and curves that walls leave a type no room for that cannot turn in place, with lanes as long as they are drawn."""
    from mrp_sumo.core.graph import PlanGraph
    from mrp_sumo.maps.clearance import standing_walls
    from mrp_sumo.maps.facts import driven_levels
    from mrp_sumo.maps.roadmap import cut_lanes
    from mrp_sumo.traffic.turns import narrow_turns

    if not model.is_vehicle or isinstance(map_.nav, PlanGraph):
        return ()
    graph = cut_lanes(map_.nav, cell_m=float(map_.nav.length_m.max()) + 1)
    walls = standing_walls(map_.building, driven_levels(map_.nav)) if map_.building else graph.walls
    return narrow_turns(replace(graph, walls=walls), model)


def _robot_type(name: str | None) -> "RobotType":
    from mrp_sumo.io.scenario.robots import robot_type
    from mrp_sumo.maps.catalogue import bundled_folder

    return robot_type(name or DEFAULT_ROBOT, bundled_folder("robots"), Path())


def _write(map_: "Map", known: dict[str, Any], out: Path) -> None:
    """Write everything, whole or not at all."""
    from mrp_sumo.engines.sumo.network import build_network
    from mrp_sumo.files.writing import new_folder
    from mrp_sumo.io.floor_plan import write_costmap, write_walls
    from mrp_sumo.maps.readers.nav_graph import write_nav_graph
    from mrp_sumo.reports.pictures.map_picture import draw_map

    try:
        with new_folder(out) as work:
            with ThreadPoolExecutor(1) as beside:  # netconvert is another process: draw meanwhile
                network = beside.submit(build_network, map_.nav, work / f"{map_.name}.net.xml", map_.building)
                for name, document in _nav_graphs(map_).items():
                    write_nav_graph(document, work / f"{name}.nav.yaml")
                draw_map(map_, work / f"{map_.name}.png", work / f"{map_.name}.svg")
                if map_.floor is not None:
                    write_costmap(work, f"{map_.name}_map", map_.floor)
                    write_walls(map_, work)
                network.result()
            (work / FACTS).write_text(json.dumps({**known, **_frame(map_)}, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise MapError(f"{out}: {sentence(error)}") from None


def _nav_graphs(map_: "Map") -> dict[str, Any]:
    """Documents by file name: one a graph as in the file, or one for the whole map once it was repaired."""
    from mrp_sumo.maps.readers.nav_graph import document_of_map

    if map_.changes or not map_.documents:
        return {map_.name: document_of_map(map_)}
    return {str(graph): document for graph, document in map_.documents.items()}


def _frame(map_: "Map") -> dict[str, Any]:
    """How coordinates of the network came from the file's, and what was repaired."""
    return {
        "origin_m": list(map_.origin_m),  # subtracted
        "level_shift_m": {name: list(by) for name, by in map_.level_shift_m.items()},  # added, to lay levels out on one plane
        "repairs": list(map_.changes),
    }


def _run_command(map_: "Map", out: Path, options: argparse.Namespace) -> list[str]:
    """What drives robots on the map as it was imported; on a plan of a floor, on the map that was made of it."""
    if map_.floor is not None:
        return ["mrp-sumo", "run", str(out / f"{map_.name}_map.yaml")]
    keys = {"snap": "snap_m", "join_short": "join_short_m"}  # of scenarios, where the option has another name
    command = ["mrp-sumo", "run", options.file]
    if options.meters_per_pixel is not None:
        command += ["--meters-per-pixel", f"{options.meters_per_pixel:g}"]
    for name in ("graph", "level", "vehicle_type", "reader", "snap", "join_short", "split_crossings", "largest_component"):
        value = getattr(options, name)
        if value is not None and value is not False:  # graph 0 is one
            command += ["--set", f"map.{keys.get(name, name)}={json.dumps(value)}"]
    return command


def _print(map_: "Map", known: dict[str, Any], options: argparse.Namespace) -> None:
    from rich.markup import escape

    from mrp_sumo.maps.map import unused
    from mrp_sumo.maps.oddities import oddities

    table = plain_table(title=escape(map_.name))
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")

    def row(name: str, text: str) -> None:
        table.add_row(name, escape(text))

    row("file", str(map_.path))
    row("level", ", ".join(known["levels"]))
    if map_.level_shift_m:
        row("", "levels: " + ", ".join(f"{name} at {x:+g}, {y:+g} m" for name, (x, y) in map_.level_shift_m.items()))
    chosen, graphs = (", ".join(map(str, numbers)) for numbers in (map_.chosen, map_.graphs))
    row("graph", chosen if chosen == graphs else f"{chosen} of {graphs}; --graph chooses")
    row("extent", "{:.2f} x {:.2f} m, lanes {:.2f} x {:.2f} m".format(*known["extent_m"], *known["lane_extent_m"]))
    bends = int(map_.nav.having("is_bend").sum())
    row("vertices", f"{known['vertices'] - bends}" + (f", and {bends} bends of curves" if bends else ""))
    row("edges", str(known["edges"] - bends))
    row("components", str(known["components"]))
    if grid := known["grid"]:
        row("grid", "{width} x {height} cells of {cell_m:g} m, {free} of {total} free".format(**grid))
    for finding in map_.findings:
        table.add_row(*_shown(finding))
    for note in (*known["clearance"]["notes"], *filter(None, (unused(map_),))):
        table.add_row("note", f"[dim]{escape(note)}[/]")
    notes = oddities(map_.building) if map_.building else ()
    more = [f"and {len(notes) - NOTES} more; --check lists them"] * (len(notes) > NOTES)
    for note in (*notes[:NOTES], *more):
        table.add_row("note", f"[dim]{escape(note)}[/]")
    out: Path = options.out
    row("files", str(out))
    row("next", shlex.join(_run_command(map_, out, options)))
    print_table(table, 120)


def _shown(finding: "MapFinding") -> tuple[str, str]:
    from rich.markup import escape

    colour = "yellow" if finding.severity == "warn" else "dim"
    return ("warning" if finding.severity == "warn" else "note"), f"[{colour}]{escape(finding.line)}[/]"
