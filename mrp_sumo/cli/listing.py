"""List by name what a scenario can name, with parameters and their defaults.

Planners, assigners, dispatchers, policies, metrics and readers are those of this program and of installed packages; maps, robots,
scenarios, suites, logs of fleets and sets of disturbances are those that come with this program. Exit code 1 when a plug-in of a package
cannot be loaded.
"""

import argparse
import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from typing import Any

from mrp_sumo.cli.printing import plain_table, print_table, say, say_json, warn
from mrp_sumo.errors import MrpSumoError, PlugInError, nearest
from mrp_sumo.plugins.kinds import KINDS

COMES_WITH_IT = ("maps", "robots", "scenarios", "suites", "logs", "disturbances")
Entry = dict[str, Any]  # name, summary, parameters: {name: {type, default}}, meanings: {name: sentence}, and what else is known of it


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo list`."""
    parser.add_argument("what", metavar="WHAT", help=", ".join((*KINDS, *COMES_WITH_IT)))
    parser.add_argument("--json", action="store_true", help="print a JSON list of objects")


def run(options: argparse.Namespace) -> int:
    """Print a table, or JSON."""
    known = (*KINDS, *COMES_WITH_IT)
    if options.what not in known:
        raise MrpSumoError(f"cannot list '{options.what}'{nearest(options.what, known, limit=len(known))}")
    faults: list[str] = []
    entries = _plug_ins(options.what, faults) if options.what in KINDS else _come_with_it(options.what)
    if options.json:
        say_json(entries, indent=2)
    elif options.what == "robots":
        _print_robots(entries)
    elif entries:
        _print(entries)
    else:
        say(f"no {options.what}")
    if options.what == "maps" and not options.json:
        from mrp_sumo.plugins.registry import make, names

        readers = [make("readers", name, {}) for name in names("readers")]
        say("Other maps are read from files: " + ", ".join(f"{reader.name} ({' '.join(reader.suffixes)})" for reader in readers))
    for line in faults:
        warn(line)
    return 1 if faults else 0


def _plug_ins(kind: str, faults: list[str]) -> list[Entry]:
    """The plug-ins of a kind; those that cannot be loaded are faults."""
    from mrp_sumo.planning.outside import described
    from mrp_sumo.plugins.registry import names

    entries: list[Entry] = []
    for name in names(kind):
        try:
            one = described(kind, name)
        except PlugInError as error:
            faults.append(f"{KINDS[kind].one} '{name}': {error}")
            continue
        parameters = {key: {"type": type_, "default": default} for key, type_, default, _ in one.parameters}
        meanings = {key: says for key, *_, says in one.parameters if says}
        entry = {"name": name, "summary": one.summary, **one.attributes, "parameters": parameters, "source": one.source}
        entries.append(entry | ({"meanings": meanings} if meanings else {}))
    return entries


def _come_with_it(what: str) -> list[Entry]:
    from mrp_sumo.core.disturbances import NAMED_DISTURBANCES
    from mrp_sumo.maps.catalogue import bundled_folder, bundled_maps

    if what == "disturbances":
        return [{"name": name, **values} for name, values in NAMED_DISTURBANCES.items()]
    if what == "maps":
        return [{"name": name, "file": str(path)} for name, path in bundled_maps().items()]
    if what == "logs":
        from mrp_sumo.calibration.archive import manifest_in

        archives = {path.stem: manifest_in(path) for path in sorted(bundled_folder("logs").glob("*.zip"))}
        return [
            {"name": name, "map": of["map"]["bundled"], "vehicles": len(of["vehicles"]), "licence": of["licence"], "truth": of["truth"]}
            for name, of in archives.items()
        ]
    folder = bundled_folder("robots") if what == "robots" else bundled_folder("scenarios")
    files = sorted((folder / "suites" if what == "suites" else folder).glob("*.yaml"))
    if what == "robots":
        from mrp_sumo.io.scenario.robots import robot_type

        types = [robot_type(path.stem, folder, folder) for path in files]
        return [
            {"name": one.name, **{key: value for key, value in asdict(one).items() if key != "source"}, "summary": one.source}
            for one in types
        ]
    if what == "suites":
        from mrp_sumo.experiments.suite import read_suite

        suites = [read_suite(path) for path in files]
        return [{"name": suite.name, "summary": " ".join(suite.suite.description.split())} for suite in suites]
    from mrp_sumo.io.scenario.read import read_scenario

    scenarios = [read_scenario(path).scenario for path in files]
    return [{"name": one.name, "map": one.map.file, "robots": one.robots.size, "planner": one.planner.name} for one in scenarios]


def _print(entries: list[Entry]) -> None:
    from rich.text import Text

    table = plain_table()
    table.add_column(no_wrap=True, style="bold")
    table.add_column(overflow="fold", ratio=1)
    for entry in entries:
        table.add_row(Text(entry["name"]), Text("\n".join(_lines(entry))))
    print_table(table, 120)


ROBOT_COLUMNS: Mapping[str, Callable[[Entry], str]] = {
    "type": lambda one: str(one["name"]),
    "m": lambda one: f"{one['length_m']:.2f} x {one['width_m']:.2f}",
    "m/s": lambda one: f"{one['max_speed_mps']:g}",
    "kinematics": lambda one: _wheels(one["kinematics"]),
    "loaded": lambda one: _loaded(one),
    "loads": lambda one: str(one["capacity"]),
    "tows": lambda one: str(len(one["trailers"]) or ""),
    "MTBF/MTTR": lambda one: f"{one['mtbf_h']:g}/{one['mttr_h']:g} h" if one.get("mtbf_h") and one.get("mttr_h") else "",
}


def _print_robots(entries: list[Entry]) -> None:
    """One row per type: what it is beside the figures that `--json` has."""
    columns = {title: [text(one) for one in entries] for title, text in ROBOT_COLUMNS.items()}
    shown = {title: texts for title, texts in columns.items() if any(texts)}
    table = plain_table(*shown, gap=1, no_wrap=True, header_style="")
    table.columns[0].style = "bold"
    for row in zip(*shown.values()):
        table.add_row(*row)
    print_table(table, 120)
    say("Sizes, also with a load, and least radius in m, speeds in m/s. --json has all figures and where they come from.")


def _wheels(wheels: Entry) -> str:
    """Wheels of a type, in words."""
    parts = [str(wheels["kind"])]
    if wheels["wheelbase_m"] and wheels["steering_max_rad"]:
        parts.append(f"r {wheels['wheelbase_m'] / math.tan(wheels['steering_max_rad']):.2f}")
    return " ".join([*parts, "back"] if wheels["reverse"] else parts)


def _loaded(one: Entry) -> str:
    loaded = {key: value for key, value in (one["loaded"] or {}).items() if value is not None}
    length_m, width_m = loaded.get("length_m", one["length_m"]), loaded.get("width_m", one["width_m"])
    larger = [f"{length_m:.2f} x {width_m:.2f}"] if "length_m" in loaded or "width_m" in loaded else []
    return ", ".join([f"{loaded['speed_mps']:g}", *larger] if "speed_mps" in loaded else larger)


def _lines(entry: Entry) -> Iterable[str]:
    if entry.get("summary"):
        yield entry["summary"]
    rest = {
        key: value for key, value in entry.items() if key not in ("name", "summary", "parameters", "meanings") and value not in ("", None)
    }
    if rest:
        yield ", ".join(f"{key} {_shown(value)}" for key, value in rest.items())
    if entry.get("parameters"):
        parts = (f"{key} ({_shown(of['default'])})" for key, of in entry["parameters"].items())
        yield f"parameters: {', '.join(parts)}"


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return f"({', '.join(f'{key} {_shown(inner)}' for key, inner in value.items() if inner is not None)})"
    return json.dumps(value) if value is None or isinstance(value, bool | list) else "''" if value == "" else str(value)
