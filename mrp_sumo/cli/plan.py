"""Plan a scenario, or a benchmark instance, without driving; print status, times, cost and bound, and write the plan.

Costs are in steps: the standard sum of costs. The lower bound is the planner's own; suboptimality is cost / bound.
OUT's suffix chooses its format: .json (this program's), .yaml (libMultiRobotPlanning), .txt (EECBS; see --format).

A problem of the League of Robot Runners (.json) is planned step by step for --steps, by a step-wise planner
(`mrp-sumo list step_planners`); OUT is then a solution in the League's format.

--many LIST plans many instances in one process, which loads and compiles once: LIST (- for standard input) has a line of arguments for
each, as they stand on this command line, and those of the command line hold for all. A line is printed for each as it is there.
Exit code 0 with a valid plan, 1 without (with --many: of any), 2 for bad input.
"""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.cli import plan_list, scenario_choice, step_wise
from mrp_sumo.cli.option_rules import only_for
from mrp_sumo.cli.printing import print_failure, say_summary, warn_of_kernels
from mrp_sumo.errors import MrpSumoError, PlugInError

if TYPE_CHECKING:
    from mrp_sumo.core.plan import PlanResult
    from mrp_sumo.core.problem import Problem
    from mrp_sumo.formats.peers import Cells
    from mrp_sumo.traffic.referee import Verdict

    Planned = tuple[str, Problem, PlanResult, Verdict | None, Cells | None]  # beginning with the planner's name

DEFAULT_TIME_LIMIT_S = 60.0
DEFAULT_ASSIGNER = "linear_sum_assignment"


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo plan`."""
    add = parser.add_argument
    add("scenario", nargs="?", metavar="SCENARIO", help="scenario file, name of a bundled scenario, or LoRR problem (.json)")
    add("--steps", type=int, metavar="N", help="of a LoRR problem")
    add("--many", metavar="LIST", help="plan one instance after another, a line of arguments each")
    add("--map", type=Path, metavar="FILE", help="MovingAI .map, or libMultiRobotPlanning YAML, instead of a scenario")
    add("--scen", type=Path, metavar="FILE", help="MovingAI .scen of the map; without one, starts and goals are drawn")
    add("--assignment", metavar="NAME", help=f"assigner for an instance whose goals are free (default: {DEFAULT_ASSIGNER})")
    scenario_choice.arguments(parser)
    add("--out", type=Path, metavar="PLAN", help="write the plan")
    add("--format", metavar="NAME", help="of OUT: json, yaml, paths, lacam or smart (default: by its suffix)")
    add("--json", action="store_true", help="print one JSON object instead of lines")
    add("-v", "--verbose", action="store_true", help="with a plug-in that fails: print its traceback")


def run(options: argparse.Namespace) -> int:
    """Plan, judge, print, write."""
    if options.many is not None:
        return plan_list.run(options, arguments, _planned)
    if (options.scenario is None) == (options.map is None):
        raise MrpSumoError("expected either a scenario or --map")
    is_named_so = options.steps is not None and Path(options.scenario or "").suffix == ".json"  # what is wrong with it is said of it
    if is_named_so or step_wise.is_problem(options.scenario):
        return step_wise.plan(options)
    only_for("problems of the League of Robot Runners (.json)", steps=options.steps)
    summary = _planned(options)
    say_summary(summary, options.json)
    return 0 if summary["valid"] else 1


def _planned(options: argparse.Namespace) -> dict[str, Any]:
    """Plan, judge and write; what is printed."""
    from mrp_sumo.cli.plan_choice import kind_of, write

    if options.scenario is not None and (options.scen or options.assignment):
        raise MrpSumoError("a scenario says itself who goes where: --scen and --assignment are for --map")
    scenario_choice.require_sound(options)
    if options.out is None:
        only_for("--out", format=options.format)
    kind = kind_of(options.out, options.format) if options.out else ""
    name, problem, result, verdict, cells = _scenario(options) if options.scenario is not None else _instance(options)
    from mrp_sumo.core.plan import Status

    summary = _summary(problem, result, name, verdict)
    if options.out and result.plan is not None:
        write(options.out, kind, problem, result.plan, cells)
        summary["plan"] = str(options.out)
    if result.status is Status.PLANNER_FAILED:
        print_failure("planner failed", result.message, result.details if options.verbose else "")
    return summary


def _scenario(options: argparse.Namespace) -> "Planned":
    file = scenario_choice.chosen_scenario(options)
    from mrp_sumo.experiments.map_cache import MapCache  # with all that plans: after the scenario is known to be one
    from mrp_sumo.experiments.solve import solve
    from mrp_sumo.experiments.staging.set_up import set_up
    from mrp_sumo.formats.peers import cells_of

    warn_of_kernels()
    with MapCache() as maps:
        solution = solve(set_up(file, maps))
    return file.scenario.planner.name, solution.problem, solution.result, solution.verdict, cells_of(solution.problem.graph)


def _instance(options: argparse.Namespace) -> "Planned":
    from dataclasses import replace
    from time import perf_counter

    import numpy as np

    from mrp_sumo.formats.instances import read_instance
    from mrp_sumo.planning.answers import answer_of
    from mrp_sumo.planning.costs import cost_matrix
    from mrp_sumo.planning.outside import failed
    from mrp_sumo.planning.registry import assigner, planner
    from mrp_sumo.search import distance
    from mrp_sumo.traffic.referee import judge

    name, parameters = scenario_choice.chosen_planner(options, "lacam")
    chosen = planner(name, parameters)
    scenario_choice.trust_named(options.assignment)
    solver = assigner(options.assignment, {}) if options.assignment else None
    instance = read_instance(options.map, options.scen, options.robots, options.seed or 0)
    problem = instance.problem
    time_limit_s = options.time_limit or DEFAULT_TIME_LIMIT_S
    begin_s = perf_counter()
    try:
        distance.prepare()
        chosen.prepare()
        prepare_time_s = perf_counter() - begin_s
        if chosen.assigns:  # a planner that assigns is asked for that, whatever the instance says
            problem = problem.assigned(np.full(problem.num_robots, -1))
        elif not problem.is_assigned:
            solver = solver or assigner(DEFAULT_ASSIGNER, {})
            problem = problem.assigned(solver.assign(cost_matrix(problem.graph, problem.start, problem.goal, "path"), time_limit_s))
    except PlugInError as error:
        return name, problem, failed(error), None, instance.cells
    result = replace(answer_of(chosen, problem, time_limit_s), prepare_time_s=prepare_time_s)
    if result.goal_of is not None:
        problem = problem.assigned(result.goal_of)
    verdict = judge(problem, result.plan) if result.plan is not None else None
    return name, problem, result, verdict, instance.cells


def _summary(problem: "Problem", result: "PlanResult", name: str, verdict: "Verdict | None") -> dict[str, Any]:
    """What is printed; numbers that are not finite become null. Cost and makespan are in steps."""
    from mrp_sumo.core.plan import as_planned_in_steps

    plan = result.plan
    summary: dict[str, Any] = {
        "status": str(result.status),
        "valid": bool(verdict and verdict.valid),
        "planner": name,
        **({"planner.chosen": result.chosen, "planner.why": result.why} if result.chosen else {}),
        "robots": problem.num_robots,
        "planning_time_s": result.planning_time_s,
        "planning_cpu_s": result.planning_cpu_s,
        "prepare_time_s": result.prepare_time_s,
        "cost": None,
        "makespan": None,
        "makespan_s": None,
        "flowtime_s": None,
        "lower_bound": result.lower_bound_steps,
        "suboptimality": None,
        "message": result.message or (verdict.summary(problem) if verdict and not verdict.valid else ""),
    }
    if plan is not None:
        summary |= {"makespan_s": float(plan.end_s.max(initial=0.0)), "flowtime_s": float(plan.end_s.sum())}
        in_steps = as_planned_in_steps(plan, problem.step_s)
        if in_steps is not None:
            end = in_steps.end_s / problem.step_s
            summary |= {"cost": round(float(end.sum()), 6), "makespan": round(float(end.max(initial=0.0)), 6)}
        if result.lower_bound_steps > 0 and in_steps is not None:
            summary["suboptimality"] = summary["cost"] / result.lower_bound_steps
    summary |= {f"stats.{key}": float(value) for key, value in result.stats.items()}
    return {key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in summary.items()}
