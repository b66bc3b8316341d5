"""Many instances planned in one process, from a list that has a line of arguments for each.

Every line is read before the first instance is planned. What cannot be planned is a line of the output and does not stop the others.
Refuses lists that name programs, unless the command line trusts them.
"""

import argparse
import shlex
import sys
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any, NoReturn

from mrp_sumo.cli import step_wise
from mrp_sumo.cli.printing import say, say_json, warn
from mrp_sumo.cli.scenario_choice import pairs
from mrp_sumo.errors import MrpSumoError, count

MAX_BYTES = 2**24  # of a list


def run(
    options: argparse.Namespace,
    arguments: Callable[[argparse.ArgumentParser], None],
    planned: Callable[[argparse.Namespace], dict[str, Any]],
) -> int:
    """Plan what is listed; the exit code is the worst of all.

    The options of the command line hold for all lines; `arguments` adds those of one instance to a parser, and `planned` plans one.
    """
    code = 0
    for place, of_line in list(_listed(options, arguments)):
        try:
            summary = planned(of_line)
        except MrpSumoError as error:
            summary = {"status": "refused", "valid": False, "message": " ".join(str(error).split())}
        refused = summary["status"] == "refused"
        code = max(code, 2 if refused else 0 if summary["valid"] else 1)
        if options.json:
            say_json({"line": place, **summary})
        elif refused:
            warn(f"{place}: {summary['message']}")
        else:
            say(_in_a_line(place, summary))
    return code


def _listed(options: argparse.Namespace, arguments: Callable[[argparse.ArgumentParser], None]) -> Iterator[tuple[str, argparse.Namespace]]:
    """Places in the list, and what each instance is planned with. Raises MrpSumoError: one line, with the place."""
    from mrp_sumo.files.reading import read_text, shortened

    if options.scenario is not None or options.out is not None:
        raise MrpSumoError("--many: its lines say what is planned and where plans go; leave SCENARIO and --out to them")
    path = Path(options.many)
    text = sys.stdin.read() if options.many == "-" else read_text(path, MAX_BYTES)
    parser = _Parser(add_help=False)
    arguments(parser)
    if not text.strip():
        raise MrpSumoError(f"--many {options.many}: found nothing, expected a line for each plan, such as '--map room.map --scen few.scen'")
    for number, line in enumerate(text.splitlines(), 1):
        place = f"{'standard input' if options.many == '-' else shortened(path)}:{number}"
        try:
            if words := shlex.split(line, comments=True):
                of_line = parser.parse_args(words, deepcopy(options))
                _require_plain(of_line, options)
                yield place, of_line
        except (MrpSumoError, ValueError) as error:
            raise MrpSumoError(f"{place}: {error}") from None


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise MrpSumoError(message)


def _require_plain(of_line: argparse.Namespace, options: argparse.Namespace) -> None:
    """Refuse what a line cannot ask."""
    from mrp_sumo.plugins.source import program_of

    if of_line.many != options.many or of_line.json != options.json:
        raise MrpSumoError("--many and --json are for the command line")
    if (of_line.scenario is None) == (of_line.map is None):
        raise MrpSumoError("expected either a scenario or --map")
    if of_line.steps is not None or step_wise.is_problem(of_line.scenario):
        raise MrpSumoError("a problem of the League of Robot Runners is planned alone, without --many")
    if options.trust:
        return
    own = pairs(of_line)[len(options.set) :]  # those of the command line come first
    mine = (options.planner, options.assignment)
    named = [*(name for name in (of_line.planner, of_line.assignment) if name and name not in mine), *(str(value) for _, value in own)]
    programs = any(program_of(name, Path()) for name in named)
    if of_line.trust or of_line.command != options.command or programs or any(key.endswith("command") for key, _ in own):
        raise MrpSumoError("names a program to run, which a list may not unless --trust stands on the command line")


def _in_a_line(place: str, summary: dict[str, Any]) -> str:
    cost, flowtime_s, cpu_s = (summary[key] for key in ("cost", "flowtime_s", "planning_cpu_s"))
    sum_of_costs = f"cost {cost:g}" if cost is not None else f"flowtime {flowtime_s:.6g} s" if flowtime_s is not None else "no plan"
    times = f"{summary['planning_time_s']:.3g} s" + ("" if cpu_s is None else f", {cpu_s:.3g} s CPU")
    robots = count(summary["robots"], "robot")
    words = (place, summary["planner"], robots, summary["status"], sum_of_costs, times, summary["message"])
    return "  ".join(word for word in words if word)
