"""Check a plan against an instance or a scenario: starts, goals, lanes, times, vertex and edge conflicts.

A plan without these is valid. With a scenario, which says how robots move, it is also said whether the plan is drivable: whether robots
can be at their visits at its times, and none comes too close to another. A plan in steps of one length seldom is; of a retimed one, the
steps are judged to be valid, and the times to be drivable.

A solution of a lifelong problem of the League of Robot Runners is judged by the League's rules (--problem), up to its first fault.

A log of VDA 5050 messages (--vda5050) is judged by the standard: headers, orders and their updates, states. See docs/logs.md.

A fleet log archive, a folder with manifest.json or a .zip, is judged by its format, and by what no fleet does. See docs/archive.md.

Reads this program's JSON, libMultiRobotPlanning's YAML, EECBS's paths.txt, lacam's result.txt and SMART's paths. Exit
code 0 for a valid plan, 1 for one with faults or conflicts (the first are printed), 2 for bad input.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mrp_sumo.cli import step_wise
from mrp_sumo.cli.option_rules import only_for, require_least
from mrp_sumo.cli.printing import say, say_either, say_json, warn
from mrp_sumo.errors import count

if TYPE_CHECKING:
    from mrp_sumo.core.problem import Problem
    from mrp_sumo.formats.peers import Cells

LOGS = (".csv", ".tsv", ".jsonl", ".ndjson", ".mcap", ".db3", ".bag")


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo validate`."""
    add = parser.add_argument
    add("plan", type=Path, metavar="PLAN", nargs="?", help="the plan file, or a fleet log archive")
    add("--vda5050", type=Path, metavar="FILE", help="a log of VDA 5050 messages instead, a JSON object with t_s, topic and payload a line")
    add("--map", type=Path, metavar="FILE", help="MovingAI .map, or libMultiRobotPlanning YAML")
    add("--scen", type=Path, metavar="FILE", help="MovingAI .scen of the map")
    add("--scenario", metavar="FILE", help="a scenario instead; robots may be at any of its goals")
    add("--problem", type=Path, metavar="FILE", help="LoRR problem (.json), for a solution in the League's format")
    add("--robots", type=int, metavar="N", help="the first N robots (default: as many as in the plan)")
    add("--seed", type=int, metavar="N", help="instead of the scenario's, or of the draw where there is no .scen")
    add("--limit", type=int, default=5, metavar="N", help="conflicts, and hindrances, to print (default: 5)")
    add("--following", action="store_true", help="following conflicts make the plan invalid too")
    add("--json", action="store_true", help="print one JSON object instead of lines")


def run(options: argparse.Namespace) -> int:
    """Judge, print."""
    from mrp_sumo.core.plan import as_planned_in_steps
    from mrp_sumo.formats.peers import goals_reached
    from mrp_sumo.formats.plan_files import read_plan_file
    from mrp_sumo.metrics.referee_in_seconds import describe_meeting, judge_in_seconds
    from mrp_sumo.traffic.referee import describe, judge

    require_least("--limit", options.limit, 0)
    if options.vda5050 is not None:
        return _messages(options)
    if options.plan is not None and (options.plan.suffix.lower() == ".zip" or options.plan.is_dir()):
        from mrp_sumo.cli.archive import validate_archive

        return validate_archive(options)
    _check_sources(options)
    if options.problem is not None:
        return step_wise.validate(options)
    problem, cells, step_length_s = _question(options)
    plan, note = read_plan_file(options.plan, problem, cells)
    if note:
        warn(note)
    goal_of = None if problem.is_assigned else goals_reached(problem, plan)
    in_steps = as_planned_in_steps(plan, problem.step_s)
    verdict = judge(problem, plan, goal_of, in_seconds=in_steps is None)
    judged = judge_in_seconds(problem, plan, step_length_s) if step_length_s and not verdict.faults else None
    hindrances = [*judged.faults, *(describe_meeting(m, problem) for m in judged.meetings)] if judged else []
    valid = verdict.valid and not (options.following and verdict.following)
    conflicts = [*verdict.conflicts, *(verdict.following if options.following else ())]
    lines = [*verdict.faults, *(describe(c, problem) for c in sorted(conflicts, key=lambda c: c.t_s))]
    cost = float((in_steps or plan).end_s.sum() / problem.step_s) if not verdict.faults else None
    if options.json:
        summary = {
            "valid": valid,
            "faults": list(verdict.faults),
            "conflicts": lines[len(verdict.faults) :][: options.limit],
            "num_vertex": verdict.count("vertex"),
            "num_edge": verdict.count("edge"),
            "num_following": verdict.count("following"),
            "cost": cost,
            "robots": plan.num_robots,
            "drivable": judged.drivable if judged else None,
            "hindrances": hindrances[: options.limit],
        }
        say_json(summary)
        return 0 if valid else 1
    if valid:
        say(f"valid: {count(plan.num_robots, 'robot')}, sum of costs {cost:g}, {verdict.count('following')} following conflicts")
    else:
        _print_some(lines, options.limit)
    if judged and judged.drivable:
        say(f"drivable: the last robot arrives at {plan.end_s.max(initial=0.0):.2f} s")
    elif judged:
        say("not drivable at these times:")
        _print_some(hindrances, options.limit)
    return 0 if valid else 1


def _check_sources(options: argparse.Namespace) -> None:
    """Refuse options of which one alone, or none, makes sense."""
    from mrp_sumo.errors import MrpSumoError

    if options.plan is None:
        raise MrpSumoError("expected a PLAN, or --vda5050 FILE")
    if not options.plan.exists():
        raise MrpSumoError(f"{options.plan}: no such file or directory")
    if options.plan.suffix.lower() in LOGS:
        made = "--vda5050 for a log of VDA 5050, or an archive, which `mrp-sumo import --log` makes of any log"
        raise MrpSumoError(f"{options.plan}: found a log, expected a plan, {made}")
    if sum(source is not None for source in (options.map, options.scenario, options.problem)) != 1:
        raise MrpSumoError("expected either --map (with --scen), --scenario or --problem")
    if options.map is None:
        only_for("--map", scen=options.scen)
    if options.problem is not None:
        only_for("--map and --scenario", robots=options.robots, seed=options.seed, following=options.following)


def _question(options: argparse.Namespace) -> tuple["Problem", "Cells | None", float | None]:
    """The problem that the plan is for, its cells, and the time step of a scenario's simulation."""
    from mrp_sumo.formats.instances import read_instance
    from mrp_sumo.formats.peers import cells_of
    from mrp_sumo.formats.plan_files import text_of

    text_of(options.plan)  # a plan that cannot be read is reported before the map is loaded
    if options.map is None:
        problem, step_length_s = _of_scenario(options)
        return problem, cells_of(problem.graph), step_length_s
    num_robots = options.robots if options.robots is not None else _num_robots(options.plan)
    instance = read_instance(options.map, options.scen, num_robots, options.seed or 0)
    return instance.problem, instance.cells, None


def _print_some(lines: list[str], limit: int) -> None:
    for line in lines[:limit]:
        say(line)
    if len(lines) > limit:
        say(f"... and {len(lines) - limit} more")


def _messages(options: argparse.Namespace) -> int:
    from itertools import islice

    from mrp_sumo.errors import MrpSumoError
    from mrp_sumo.files.reading import require_regular, shortened
    from mrp_sumo.formats.vda.check import LONGEST_LINE, check

    if options.plan is not None or options.map is not None or options.scenario is not None or options.problem is not None:
        raise MrpSumoError("--vda5050 stands by itself: no PLAN, --map, --scenario or --problem")
    only_for("plans", scen=options.scen, robots=options.robots, seed=options.seed, following=options.following)
    require_regular(options.vda5050, 2**40)
    with options.vda5050.open(encoding="utf-8", errors="replace") as file:
        lines = iter(lambda: file.readline(LONGEST_LINE + 1), "")
        faults = check(lines)
        shown = list(islice(faults, options.limit))
        more = sum(1 for _ in faults)
    num_faults = len(shown) + more
    faulty = [{"line": fault.line, "topic": fault.topic, "text": fault.text} for fault in shown]
    said = f"{shortened(options.vda5050)}: " + (count(num_faults, "fault") if num_faults else "keeps the standard")
    document = {"valid": not num_faults, "faults": num_faults, "first": faulty}
    say_either(options.json, document, *(f"{options.vda5050.name}: {fault}" for fault in shown), said, indent=2)
    return 1 if num_faults else 0


def _num_robots(path: Path) -> int:
    from mrp_sumo.errors import PlanError
    from mrp_sumo.formats.peers import read_places
    from mrp_sumo.formats.plan_files import is_json, text_of
    from mrp_sumo.formats.plan_json import read_plan

    text = text_of(path)
    number = read_plan(path).num_robots if is_json(text) else len(read_places(text, None, path.name))
    if not number:
        raise PlanError(f"{path.name}: a plan for no robots: say --robots 0 if that is meant")
    return number


def _of_scenario(options: argparse.Namespace) -> tuple["Problem", float]:
    """What the plan is for, and in which steps of time robots drive."""
    from mrp_sumo.experiments.map_cache import MapCache
    from mrp_sumo.experiments.staging.set_up import set_up
    from mrp_sumo.io.scenario.file import find_scenario
    from mrp_sumo.io.scenario.read import read_scenario

    overrides: dict[tuple[str | int, ...], tuple[str, int]] = {}
    if options.seed is not None:
        overrides[("seed",)] = ("--seed", options.seed)
    if options.robots is not None:
        overrides[("robots", "count")] = ("--robots", options.robots)
    with MapCache() as maps:
        setup = set_up(read_scenario(find_scenario(options.scenario), overrides), maps, run_programs=False)
    return setup.problem, setup.settings.step_length_s
