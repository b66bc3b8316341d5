"""Plan a scenario, or a benchmark instance, without driving; print status, times, cost and bound, and write the plan.

Costs are in steps: the standard sum of costs. The lower bound is the planner's own; suboptimality is cost / bound.
OUT's suffix chooses its format: .json (this program's), .yaml (libMultiRobotPlanning), .txt (EECBS; see --format).
Exit code 0 with a valid plan, 1 without, 2 for bad input.
"""

import argparse
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mrp_sumo.core.plan import Plan
    from mrp_sumo.core.problem import Problem
    from mrp_sumo.formats.peers import Cells

DEFAULT_TIME_LIMIT_S = 60.0


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo plan`."""
    add = parser.add_argument
    add("scenario", nargs="?", metavar="SCENARIO", help="scenario file, or the name of a bundled scenario")
    add("--map", type=Path, metavar="FILE", help="MovingAI .map, or libMultiRobotPlanning YAML, instead of a scenario")
    add("--scen", type=Path, metavar="FILE", help="MovingAI .scen of the map; without one, starts and goals are drawn")
    add("--robots", type=int, metavar="N", help="the first N robots (default: all)")
    add("--planner", metavar="NAME", help="instead of the scenario's (default for an instance: lacam)")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="a parameter of the planner; may be repeated")
    add(
        "--command",
        metavar="TEMPLATE",
        help="an external planner, such as 'lacam3 -m {map} -i {scen} -N {agents} -t {time_limit} -o {out}'",
    )
    add("--assignment", metavar="NAME", help="assigner for an instance whose goals are free (default: linear_sum_assignment)")
    add("--time-limit", type=float, metavar="S", help="wall time of the planner in s (default: the scenario's, or 60)")
    add("--seed", type=int, metavar="N", help="of planner and draws (default: the scenario's, or 0)")
    add("--out", type=Path, metavar="PLAN", help="write the plan")
    add("--format", metavar="NAME", help="of OUT: json, yaml, paths, lacam or smart (default: by its suffix)")
    add("--json", action="store_true", help="print one JSON object instead of lines")


def run(options: argparse.Namespace) -> int:
    """Plan, judge, print, write."""
    from mrp_sumo.cli.plan_choice import kind_of, write
    from mrp_sumo.errors import MrpSumoError

    if (options.scenario is None) == (options.map is None):
        raise MrpSumoError("expected either a scenario or --map")
    if options.scenario and (options.scen or options.assignment):
        raise MrpSumoError("a scenario says itself who goes where: --scen and --assignment are for --map")
    if options.time_limit is not None and not (options.time_limit > 0 and math.isfinite(options.time_limit)):
        raise MrpSumoError(f"--time-limit is {options.time_limit:g}, expected a number of seconds above 0")
    if options.command and (options.planner or options.set):
        raise MrpSumoError("--command is a planner of its own: leave out --planner and --set")
    kind = kind_of(options.out, options.format) if options.out else ""
    told, problem, plan, cells = _scenario(options) if options.scenario else _instance(options)
    if options.out and plan is not None:
        write(options.out, kind, problem, plan, cells)
        told["plan"] = str(options.out)
    if options.json:
        print(json.dumps(told, allow_nan=False))
    else:
        for key, value in told.items():
            if value not in ("", None):
                print(f"{key}: {value:.6g}" if isinstance(value, float) else f"{key}: {value}")
    return 0 if told["valid"] else 1


def _scenario(options: argparse.Namespace) -> "tuple[dict[str, Any], Problem, Plan | None, Cells | None]":
    from mrp_sumo.experiments.map_cache import MapCache
    from mrp_sumo.experiments.run import solve
    from mrp_sumo.experiments.set_up import set_up
    from mrp_sumo.formats.peers import cells_of
    from mrp_sumo.io.scenario import find_scenario, read_scenario

    overrides: dict[tuple[str | int, ...], tuple[str, Any]] = {}
    if options.seed is not None:
        overrides[("seed",)] = ("--seed", options.seed)
    if options.robots is not None:
        overrides[("robots", "count")] = ("--robots", options.robots)
    if options.time_limit is not None:
        overrides[("planner", "time_limit_s")] = ("--time-limit", options.time_limit)
    if options.planner is not None or options.command or options.set:
        name, parameters = _planner(options)
        if name:
            overrides[("planner", "name")] = ("--planner", name)
        overrides[("planner", "parameters")] = ("--set", parameters)
    file = read_scenario(find_scenario(options.scenario), overrides)
    with MapCache() as maps:
        setup = set_up(file, maps)
        solution = solve(setup)
    told = _told(solution.problem, solution.result, file.scenario.planner.name, solution.verdict)
    return told, solution.problem, solution.result.plan, cells_of(solution.problem.graph)


def _instance(options: argparse.Namespace) -> "tuple[dict[str, Any], Problem, Plan | None, Cells | None]":
    from dataclasses import replace
    from time import perf_counter

    from mrp_sumo.formats.instances import read_instance
    from mrp_sumo.planning.answers import answer_of
    from mrp_sumo.planning.costs import cost_matrix
    from mrp_sumo.planning.registry import assigner, planner
    from mrp_sumo.search import distance
    from mrp_sumo.traffic.referee import judge

    name, parameters = _planner(options)
    chosen = planner(name or "lacam", parameters)
    solver = assigner(options.assignment or "linear_sum_assignment", {})
    instance = read_instance(options.map, options.scen, options.robots, options.seed or 0)
    problem = instance.problem
    time_limit_s = options.time_limit or DEFAULT_TIME_LIMIT_S
    begin_s = perf_counter()
    distance.prepare()
    chosen.prepare()
    prepare_time_s = perf_counter() - begin_s
    if not problem.is_assigned and not chosen.assigns:
        problem = problem.assigned(solver.assign(cost_matrix(problem.graph, problem.start, problem.goal, "path"), time_limit_s))
    result = replace(answer_of(chosen, problem, time_limit_s), prepare_time_s=prepare_time_s)
    if result.goal_of is not None:
        problem = problem.assigned(result.goal_of)
    verdict = judge(problem, result.plan) if result.plan is not None else None
    return _told(problem, result, name or "lacam", verdict), problem, result.plan, instance.cells


def _planner(options: argparse.Namespace) -> tuple[str, dict[str, Any]]:
    """Name, '' for the default, and parameters, whose values are YAML."""
    from mrp_sumo.errors import MrpSumoError
    from mrp_sumo.maps.yaml_text import Text, parse

    if options.command:
        return "external", {"command": options.command}
    parameters = {}
    for pair in options.set:
        key, equals, value = pair.partition("=")
        if not equals or not key:
            raise MrpSumoError(f"--set {pair}: expected KEY=VALUE")
        parameters[key] = parse(Text(Path("--set"), value))
    return options.planner or "", parameters


def _told(problem: "Problem", result: Any, name: str, verdict: Any) -> dict[str, Any]:
    """What is printed; numbers that are not finite become null."""
    plan = result.plan
    told: dict[str, Any] = {
        "status": str(result.status),
        "valid": bool(verdict and verdict.valid),
        "planner": name,
        "robots": problem.num_robots,
        "planning_time_s": result.planning_time_s,
        "prepare_time_s": result.prepare_time_s,
        "cost": None,
        "makespan": None,
        "lower_bound": result.lower_bound_steps,
        "suboptimality": None,
        "message": result.message or (verdict.summary(problem) if verdict and not verdict.valid else ""),
    }
    if plan is not None:
        end = plan.end_s / problem.step_s
        told["cost"] = round(float(end.sum()), 6)
        told["makespan"] = round(float(end.max(initial=0.0)), 6)
        if result.lower_bound_steps > 0:
            told["suboptimality"] = told["cost"] / result.lower_bound_steps
    told |= {f"stats.{key}": float(value) for key, value in result.stats.items()}
    return {key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in told.items()}
