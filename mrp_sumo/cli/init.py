"""Write a first scenario with work for a map: stations, orders, fleet, charging and parking, as far as the map says; the rest is guessed.

It asks nothing that it can read, says in comments what it guessed, and has driven what it writes for ten simulated minutes.
"""

import argparse
import json
import os
import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.cli.option_rules import require_within
from mrp_sumo.cli.printing import say, warn, warn_of_kernels
from mrp_sumo.cli.scenario_choice import folder_name, map_alone, scale_argument
from mrp_sumo.errors import MrpSumoError, listed
from mrp_sumo.files.writing import write_text

if TYPE_CHECKING:
    from mrp_sumo.experiments.proposal import Proposal, Wishes

SCENARIO, ORDERS = "scenario.yaml", "orders.csv"
WISHED = ("robot_type", "num_robots", "rate_per_h")  # of the wishes, those that have an option
BOUNDS = {
    "num_robots": ("--robots", 1, 100_000),
    "rate_per_h": ("--rate", 1e-3, 1e6),
    "service_s": ("seconds at a stop", 0, 1e5),
    "hours": ("hours of a run", 0.01, 1e4),
}
QUESTIONS = (  # wish, question: what matters most for an answer
    ("robot_type", "type of robots (turtlebot3, amr_600, tugger, forklift, or a YAML file)"),
    ("num_robots", "number of robots to begin with"),
    ("rate_per_h", "orders an hour"),
    ("service_s", "seconds that a robot is served at a stop"),
    ("hours", "hours of a run"),
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo init`."""
    parser.add_argument("map", metavar="FILE", help="map of any format that `mrp-sumo import` reads, or the name of a bundled one")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the scenario, or a .yaml file (default: the map's name)")
    parser.add_argument("--type", dest="robot_type", default="", metavar="NAME", help="type of robots (default: the largest that fits)")
    parser.add_argument("--robots", dest="num_robots", type=int, metavar="N", help="how many (default: by what fits)")
    parser.add_argument(
        "--rate", dest="rate_per_h", type=float, metavar="N", help="orders an hour (default: a quarter of what the fleet could)"
    )
    parser.add_argument("--orders", type=int, metavar="N", help=f"write {ORDERS} with N orders, too, to fill with your own")
    parser.add_argument("--interactive", action="store_true", help="ask the five questions that matter most")
    scale_argument(parser)


def run(options: argparse.Namespace) -> int:
    """Propose, try, write, and say what to do with it."""
    from mrp_sumo.maps.catalogue import find_map

    path = find_map(options.map, Path())
    from mrp_sumo.maps.readers.reader import map_name

    name = folder_name(map_name(path))
    out: Path = options.out or Path(name)
    scenario = out if out.suffix.lower() in (".yaml", ".yml") and not out.is_dir() else out / SCENARIO
    out = scenario.parent
    _require_free(scenario)
    require_within("--orders", options.orders, 1, 100_000)
    for key, (option, least, most) in BOUNDS.items():
        require_within(option, getattr(options, key, None), least, most)
    from mrp_sumo.experiments.proposal import propose  # with all that drives: after the options are sound

    warn_of_kernels()
    file = os.path.relpath(path.resolve(), out.resolve()) if Path(options.map).is_file() else options.map
    scale = {} if options.meters_per_pixel is None else {"meters_per_pixel": options.meters_per_pixel}
    wishes = _asked(options) if options.interactive else _wishes({key: getattr(options, key) for key in WISHED})
    if Path(wishes.robot_type or "").is_file():
        wishes = replace(wishes, robot_type=os.path.relpath(wishes.robot_type, out))  # as the scenario says it
    is_new = not out.exists()
    out.mkdir(parents=True, exist_ok=True)
    try:
        with map_alone(out.resolve() / file, options.map):
            proposal = propose({"file": file, **scale}, out.resolve(), name, wishes)
        if options.orders is not None:
            write_text(out / ORDERS, _orders(proposal, options.orders))
        write_text(scenario, text_of(proposal, path.name))
    except (MrpSumoError, KeyboardInterrupt):
        (out / ORDERS).unlink(missing_ok=True)
        if is_new and not any(out.iterdir()):
            out.rmdir()
        raise
    _print(proposal, scenario, name, options.orders)
    return 0


def _require_free(scenario: Path) -> None:
    """Refuse to replace what may be somebody's work."""
    if scenario.parent.exists() and not scenario.parent.is_dir():
        raise MrpSumoError(f"--out {scenario.parent}: is a file, expected a folder or a .yaml file")
    for path in (scenario, scenario.parent / ORDERS):
        if path.exists():
            raise MrpSumoError(f"{path}: is there already, and may be yours: choose another --out")


def _wishes(values: dict[str, Any]) -> "Wishes":
    from mrp_sumo.experiments.proposal import Wishes

    for key, (name, least, most) in BOUNDS.items():
        require_within(name, values.get(key), least, most)
    return Wishes(**values)


def _asked(options: argparse.Namespace) -> "Wishes":
    """The answers of the user; an empty one leaves the guess to the program."""
    values: dict[str, Any] = {key: getattr(options, key) for key in WISHED}
    for key, question in QUESTIONS:
        if values.get(key):
            continue
        try:
            answer = input(f"{question} [Enter: guess]: ").strip()
        except EOFError:
            raise MrpSumoError("--interactive: no answers on the standard input; leave it out to have all guessed") from None
        if answer:
            values[key] = answer if key == "robot_type" else _number(question, answer, whole=key == "num_robots")
    return _wishes(values)


def _number(question: str, answer: str, *, whole: bool) -> float:
    try:
        return int(answer) if whole else float(answer)
    except ValueError:
        raise MrpSumoError(f"{question}: found {answer!r:.40}, expected a {'whole ' * whole}number") from None


def text_of(proposal: "Proposal", map_file: str) -> str:
    """The scenario as YAML, with comments on what was read and what was guessed."""
    values, why = proposal.values, proposal.reasons
    tasks, robots, stream = values["tasks"], values["robots"], values["tasks"]["streams"][0]
    plain = json.dumps  # which is YAML, whatever the names hold
    lines = [
        f"# A first scenario for {map_file}, made by `mrp-sumo init`. Every key is explained in docs/scenario.md.",
        f"name: {plain(values['name'])}",
        f"map: {plain(values['map'], ensure_ascii=False)}",
        f"discretisation: {plain(values['discretisation'])}  # {why['cell']}",
        "robots:",
        f"  count: {robots['count']}  # {why['count']}",
        f"  type: {plain(robots['type'])}  # {why['type']}",
        "planner: auto",
        "tasks:",
        f"  groups:  # {why['groups']}",
        *(f"    {group}: {plain(names, ensure_ascii=False)}" for group, names in tasks["groups"].items()),
        "  streams:",
        f"    - name: {stream['name']}",
        f"      arrivals: {plain(stream['arrivals'])}  # {why['orders']}",
        f"      stops: {plain(stream['stops'])}",
        f"      service: {plain(stream['service'])}  # seconds at a stop; {why['service']}",
    ]
    if "charging" in tasks:
        lines.append(f"  charging: {plain(tasks['charging'])}  # {why['charging']}")
    if "parking" in tasks:
        lines.append("  parking: [parking]  # where robots without an order go")
    execution = values["execution"]
    lines += [
        "execution:",
        f"  dispatcher: {execution['dispatcher']}  # the oldest order first, to the nearest free robot; or: `mrp-sumo list dispatchers`",
        f"  time_limit_s: {execution['time_limit_s']:g}  # simulated",
    ]
    return "\n".join(lines) + "\n"


def _orders(proposal: "Proposal", count: int) -> str:
    """Orders as CSV, evenly at the proposal's rate, from stop to stop in turn."""
    stream, groups = proposal.values["tasks"]["streams"][0], proposal.values["tasks"]["groups"]
    (first, second), gap_s = (groups[name] for name in stream["stops"]), 3600 / stream["arrivals"]["rate_per_h"]
    rows = ["name,release_s,stops"]
    for i in range(count):
        a = first[i % len(first)]
        others = [name for name in second if name != a]
        rows.append(f"order_{i},{i * gap_s:.0f},{a} {others[i // len(first) % len(others)]}")
    return "\n".join(rows) + "\n"


def _print(proposal: "Proposal", path: Path, name: str, orders: int | None) -> None:
    """What was found, and three commands."""
    tasks, robots = proposal.values["tasks"], proposal.values["robots"]
    groups = ", ".join(f"{group} ({len(names)})" for group, names in tasks["groups"].items())
    stops, rate = " to ".join(tasks["streams"][0]["stops"]), tasks["streams"][0]["arrivals"]["rate_per_h"]
    scenario, folder = shlex.quote(str(path)), shlex.quote(str(Path("runs") / name))
    count, model = robots["count"], robots["type"]
    size = model if isinstance(model, str) else f"{model['length_m']:g} x {model['width_m']:g} m and {model['max_speed_mps']:g} m/s"
    kind = f"robot{'s' * (count > 1)} of {'type ' * isinstance(model, str)}{size}"
    say(f"{path}: {count} {kind}, {rate:g} order{'s' * (rate != 1)} an hour from {stops}")
    say(f"groups of places: {groups}")
    for doubt in proposal.doubts:
        warn(doubt)
    if proposal.unreached:
        say(f"left out, as robots cannot reach them and come back: {listed(proposal.unreached, 8)}")
    say("driven for 10 simulated minutes: it runs")
    if orders:
        say(f"your orders: fill {path.parent / ORDERS}, then mrp-sumo run {scenario} --set 'tasks.streams=[]' --set tasks.file={ORDERS}")
    say(f"next: mrp-sumo run {scenario}")
    say(f"      mrp-sumo capacity {scenario} --quick")
    say(f"      mrp-sumo replay {folder} --serve")
