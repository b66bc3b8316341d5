"""Options that override values of a scenario, shared by the commands that read one."""

import argparse
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.cli.option_rules import scale
from mrp_sumo.cli.printing import warn, warn_of_kernels
from mrp_sumo.errors import MrpSumoError, PlugInError, count

if TYPE_CHECKING:
    from mrp_sumo.io.scenario.file import ScenarioFile

HEAD = 1_000_000  # bytes in which a file says what it is
NAMES_A_MAP = re.compile(rb'^(?:\xef\xbb\xbf)?\{?\s*"?map"?\s*:', re.MULTILINE)
KEYS_OF_MAPS = re.compile(rb"^(?:levels|building_name|coordinate_system|image|resolution|nodes|links)\s*:", re.MULTILINE)
FIRST_PLAN_S = 3.0  # CPU time of the planner of a map alone, whose user wants to see it drive
INSTANCE_CELL_M = 1.0  # side of a cell where there is no scenario to say it

Override = tuple[str, Any]  # the option, for messages, and the value
Changes = Mapping[tuple[str | int, ...], Override]  # by place
NOTHING: Changes = {}


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments that change a scenario."""
    add = parser.add_argument
    add("--robots", type=int, metavar="N", help="the first N robots, or as many drawn")
    add("--planner", metavar="NAME", help="another planner, with its default parameters; FILE.py:CLASS for one of your own")
    set_argument(parser)
    add(
        "--command",
        metavar="TEMPLATE",
        help="an external planner, such as 'lacam3 -m {map} -i {scen} -N {agents} -t {time_limit} -o {out}'",
    )
    add("--trust", action="store_true", help="run the programs that the scenario names: plug-in files, external planners")
    add("--time-limit", type=float, metavar="S", help="CPU time of the planner in s")
    add("--seed", type=int, metavar="N", help="of planner, draws and disturbances")


def scale_argument(parser: argparse.ArgumentParser) -> None:
    """The scale of maps whose file does not say it."""
    parser.add_argument(
        "--scale",
        "--meters-per-pixel",
        "--metres-per-pixel",
        dest="meters_per_pixel",
        metavar="S",
        type=scale,
        help="of a picture of a floor, or of a building's drawing instead of its measurements: metres a pixel, such as 0.05, or two "
        "places in pixels and the metres between them, X,Y:X,Y=M, such as 120,80:920,80=20",
    )


def set_argument(parser: argparse.ArgumentParser) -> None:
    """`--set`, which `with_set` reads."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="any key of the scenario, such as execution.on_deadlock=stop, or a parameter of the planner, such as w=1.5; may be repeated",
    )


def chosen_scenario(options: argparse.Namespace) -> "ScenarioFile":
    """The scenario that the options name, with what they say instead.

    Raises MrpSumoError: one line a fault, with the option or the file and line.
    """
    from mrp_sumo.io.scenario.file import find_scenario
    from mrp_sumo.io.scenario.read import read_scenario
    from mrp_sumo.plugins.trust import trust_everything

    require_sound(options)
    trust_everything(options.trust)
    if options.scenario is None:
        return with_set(options, _of_instance(options), _named(options))
    if "meters_per_pixel" in options and is_map(options.scenario):
        return _of_map(options)
    if getattr(options, "meters_per_pixel", None) is not None:
        raise MrpSumoError("--scale is for a map; a scenario says it itself: map.meters_per_pixel")
    require_scenario(options.scenario)
    return with_set(options, read_scenario(find_scenario(options.scenario)), _named(options))


def require_scenario(name_or_path: str) -> None:
    """Refuse a file that is no scenario, and the name of a map, where a map alone does not do."""
    if is_map(name_or_path):
        raise MrpSumoError(f"{name_or_path}: no scenario, expected a file with `map` and `robots`; `mrp-sumo init` writes one for a map")


def is_map(name_or_path: str) -> bool:
    """True if a file is a map rather than a scenario, or a name that of a bundled map and of no bundled scenario."""
    from mrp_sumo.files.reading import read_head
    from mrp_sumo.maps.catalogue import bundled_folder, bundled_maps

    path = Path(name_or_path)
    if not path.is_file():
        return name_or_path in bundled_maps() and not (bundled_folder("scenarios") / f"{name_or_path}.yaml").is_file()
    head = read_head(path, HEAD, MrpSumoError)  # a scenario names a map, or is YAML with none of a map's keys
    return NAMES_A_MAP.search(head) is None and (path.suffix not in (".yaml", ".yml") or KEYS_OF_MAPS.search(head) is not None)


def _of_map(options: argparse.Namespace) -> "ScenarioFile":
    """The scenario of a map alone: as many robots as fit, goals drawn, everything else by default."""
    from mrp_sumo.io.scenario.read import scenario_of
    from mrp_sumo.maps.catalogue import bundled_maps
    from mrp_sumo.maps.readers.reader import map_name

    path = Path(options.scenario)
    file = str(path.absolute()) if path.is_file() else options.scenario
    scale = {} if options.meters_per_pixel is None else {"meters_per_pixel": options.meters_per_pixel}
    values = {
        "map": {"file": file, **scale},
        "robots": {"count": 1},
        "assignment": {"cost": "path"},
        "planner": {"time_limit_s": FIRST_PLAN_S},
    }
    name = folder_name(map_name(path if path.is_file() else bundled_maps()[options.scenario]))
    named = _named(options)
    chosen = with_set(options, scenario_of(values, Path.cwd(), name), named)
    changes, robots = {**named, **_set(options, chosen)}, chosen.scenario.robots
    if robots.fleet or robots.starts or chosen.scenario.planner.name in ("plan_file", "external"):
        return chosen
    wanted = robots.count if ("robots", "count") in changes else None
    from mrp_sumo.experiments.first_fleet import with_first_fleet  # with all that plans: after all names are known to be right

    warn_of_kernels()
    with map_alone(Path(file), options.scenario):
        first, refused = with_first_fleet(chosen, wanted, chosen.scenario.seed if ("seed",) in changes else None)
    if refused:
        warn(f"{count(first.scenario.robots.size, 'robot')}, as more are refused: {refused.rpartition('robots.type: ')[2]}")
    return first


@contextmanager
def map_alone(path: Path, typed: str) -> Iterator[None]:
    """Refusals within the block name the map's file as it was typed, and no place in a scenario that the user has not written."""
    try:
        yield
    except PlugInError:
        raise
    except MrpSumoError as error:
        lines = (line.removeprefix("scenario: map: ").removeprefix("scenario: ") for line in str(error).splitlines())
        raise type(error)(*(line.replace(str(path), typed) for line in lines)) from None


def folder_name(name: str) -> str:
    """A name made of those characters that a run's folder may have."""
    return re.sub(r"[^\w.+-]+", "_", name).strip("._") or "map"


def with_set(options: argparse.Namespace, file: "ScenarioFile", named: Changes = NOTHING) -> "ScenarioFile":
    """The scenario with what `--set` says instead, and at the same time what options with a name of their own say.

    Raises MrpSumoError: one line a fault, with the option; and for names in the scenario that are not there.
    """
    from mrp_sumo.io.scenario.names import require_known
    from mrp_sumo.io.scenario.read import changed

    of_planner = {place: value for place, value in named.items() if place[0] == "planner"}  # of whose parameters `--set` speaks
    file = changed(file, of_planner)
    chosen = changed(file, {place: value for place, value in named.items() if place not in of_planner} | _set(options, file))
    require_known(chosen)
    return chosen


def _of_instance(options: argparse.Namespace) -> "ScenarioFile":
    """The scenario that drives a MovingAI instance: of `--map`, and of `--scen` or the plan that is to be driven."""
    from mrp_sumo.errors import PlanError
    from mrp_sumo.formats.instances import problem_of_places, read_instance
    from mrp_sumo.formats.peers import read_places
    from mrp_sumo.formats.plan_files import is_json, text_of
    from mrp_sumo.io.scenario.read import scenario_of

    if options.scen is not None:
        problem = read_instance(options.map, options.scen, options.robots).problem
        if options.robots is None and options.plan is not None and not is_json(text := text_of(options.plan)):
            num_planned = len(read_places(text, None, options.plan.name))
            if num_planned < problem.num_robots:  # files of starts and goals are for up to so many
                problem = read_instance(options.map, options.scen, num_planned).problem
    elif options.plan is None or is_json(text := text_of(options.plan)):
        raise PlanError("--map: no starts and goals, expected --scen, or --plan with paths of cells")
    else:
        problem = problem_of_places(read_instance(options.map, None, 0), read_places(text, None, options.plan.name), options.plan.name)
    values = {
        "map": str(options.map.absolute()),
        "discretisation": {"kind": "grid", "cell_m": INSTANCE_CELL_M},
        "robots": {key: [f"v{v}" for v in of.tolist()] for key, of in (("starts", problem.start), ("goals", problem.target))},
        "assignment": {"mode": "fixed"},
        "planner": "lacam",
    }
    return scenario_of(values, Path.cwd(), (options.scen or options.plan or options.map).stem)


def chosen_planner(options: argparse.Namespace, default: str) -> tuple[str, dict[str, Any]]:
    """Name and parameters of the planner where there is no scenario. Raises MrpSumoError for a key that is no parameter of the planner."""
    from mrp_sumo.planning.registry import parameter_names

    require_sound(options)
    if options.command:
        return "external", {"command": options.command}
    name = options.planner or default
    trust_named(name)
    parameters = {}
    for key, value in pairs(options):
        if "." in (word := key.removeprefix("planner.parameters.")):
            raise MrpSumoError(f"--set {key}: an instance has no such key, expected a parameter of the planner")
        _require_parameter(word, name, parameter_names(name))
        parameters[word] = value
    return name, parameters


def trust_named(name: str | None) -> None:
    """Trust a plug-in's file that an option names."""
    from mrp_sumo.plugins.source import program_of
    from mrp_sumo.plugins.trust import trust

    if program := program_of(name or "", Path()):
        trust(program)


def require_sound(options: argparse.Namespace) -> None:
    """Refuse options that contradict each other or are out of range. Raises MrpSumoError: one line."""
    if options.time_limit is not None and not (options.time_limit > 0 and math.isfinite(options.time_limit)):
        raise MrpSumoError(f"--time-limit is {options.time_limit:g}, expected a number of seconds above 0")
    if options.command == "":
        raise MrpSumoError("--command: found nothing, expected a command line, such as 'lacam3 -m {map} -i {scen} -o {out}'")
    if options.command and (options.planner or options.set):
        raise MrpSumoError("--command is a planner of its own: leave out --planner and --set")
    if getattr(options, "plan", None):
        for name, value in (("--planner", options.planner), ("--command", options.command), ("--time-limit", options.time_limit)):
            if value is not None:
                raise MrpSumoError(f"--plan is a plan that is there already: leave out {name}")
        if any(key == "planner" or key.startswith("planner.") for key, _ in pairs(options)):
            raise MrpSumoError("--plan is a plan that is there already: leave out --set of the planner")


def _named(options: argparse.Namespace) -> dict[tuple[str | int, ...], Override]:
    from mrp_sumo.plugins.source import resolved

    robot, plan, policy, metrics = (getattr(options, name, None) for name in ("robot", "plan", "policy", "metric"))
    said = {
        ("seed",): ("--seed", options.seed),
        ("robots", "count"): ("--robots", options.robots),
        ("robots", "type"): ("--type", robot and _robot(robot)),
        ("planner", "name"): ("--planner", options.planner and resolved(options.planner, Path())),
        ("planner", "time_limit_s"): ("--time-limit", options.time_limit),
        ("execution", "policy"): ("--policy", policy and resolved(policy, Path())),
        ("record", "metrics"): ("--metric", [resolved(name, Path()) for name in metrics] if metrics else None),
    }
    if options.command:
        said["planner", "name"] = ("--command", "external")
        said["planner", "parameters", "command"] = ("--command", options.command)
    if plan:
        said["planner", "name"] = ("--plan", "plan_file")
        said["planner", "parameters"] = ("--plan", {"path": str(Path(plan).absolute())})
    return {place: (option, value) for place, (option, value) in said.items() if value is not None}


def _robot(name: str) -> str:
    """A bundled type as it is, a file wherever the scenario lies."""
    return str(Path(name).absolute()) if Path(name).suffix in (".yaml", ".yml") else name


def _set(options: argparse.Namespace, file: "ScenarioFile") -> dict[tuple[str | int, ...], Override]:
    """What `--set` says: keys of the scenario, and parameters of its planner.

    Raises MrpSumoError for an unknown key, with the nearest right one.
    """
    from mrp_sumo.io.scenario.keys import unknown_key
    from mrp_sumo.io.scenario.model import SECTIONS
    from mrp_sumo.io.scenario.programs import is_plug_in
    from mrp_sumo.plugins.source import resolved

    said: dict[tuple[str | int, ...], Override] = {}
    for key, value in pairs(options):
        option = f"--set {key}"
        if "." not in key and key not in SECTIONS:
            from mrp_sumo.planning.registry import parameter_names  # with what planners need

            name = file.scenario.planner.name
            _require_parameter(key, name, parameter_names(name))
            said["planner", "parameters", key] = (option, value)
            continue
        if wrong := unknown_key(key):
            raise MrpSumoError(f"{option}: {wrong}")
        said[tuple(key.split("."))] = (option, resolved(value, Path()) if is_plug_in(key) and isinstance(value, str) else value)
    return said


def pairs(options: argparse.Namespace) -> list[tuple[str, Any]]:
    """Keys and values, which are YAML."""
    from mrp_sumo.maps.yaml_text import Text, parse

    changes = []
    for pair in options.set:
        key, equals, value = pair.partition("=")
        key = key.strip()
        if not equals or not key:
            raise MrpSumoError(f"--set {pair}: expected KEY=VALUE")
        changes.append((key, parse(Text(Path("--set"), value))))
    return changes


def _require_parameter(key: str, planner: str, known: tuple[str, ...] | None) -> None:
    """Refuse what is neither a parameter of the planner nor a key of scenarios."""
    from mrp_sumo.io.scenario.keys import nearest_key

    if known is not None and key not in known:
        raise MrpSumoError(
            f"--set {key}: neither a key of scenarios (`mrp-sumo schema`) nor a parameter of '{planner}'{nearest_key(key, known)}"
        )
