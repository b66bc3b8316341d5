"""`plan` and `validate` for step-wise lifelong problems of the League of Robot Runners."""

import argparse
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from mrp_sumo.cli.printing import say, say_progress, say_summary
from mrp_sumo.errors import MrpSumoError

if TYPE_CHECKING:
    from mrp_sumo.planning.step_wise import StepPlanner

MAX_STEPS = 1_000_000
DEFAULT, PROGRAM = "epibt", "program"


def is_problem(name: str | None) -> bool:
    """True if the name given for a scenario is that of a problem of the League."""
    path = Path(name or "")
    if path.suffix != ".json" or not path.is_file():
        return False
    from mrp_sumo.files.reading import read_text

    text = read_text(path, 2**24)
    return '"mapFile"' in text or '"teamSize"' in text


def plan(options: argparse.Namespace) -> int:
    """Plan step by step, judge, print, write; exit code 0 for a valid solution that does not stall."""
    from mrp_sumo.files.writing import write_text
    from mrp_sumo.formats.lorr import print_solution, read_problem
    from mrp_sumo.planning.step_wise import run_step_wise
    from mrp_sumo.traffic.step_wise_referee import judge_step_wise, pace_of

    _require_sound(options)
    name, planner = _chosen(options)
    problem = read_problem(Path(options.scenario))
    planner.prepare()
    run = run_step_wise(problem, planner, options.steps, options.seed or 0, _show if sys.stderr.isatty() else None)
    verdict, pace = judge_step_wise(problem, run.solution), pace_of(problem, run.solution)
    stalled = pace.stalled_since_step is not None
    summary: dict[str, object] = {
        "status": "stalled" if verdict.valid and stalled else "completed" if verdict.valid else "invalid",
        "valid": verdict.valid,
        "planner": name,
        "robots": problem.num_robots,
        "steps": run.solution.num_steps,
        "tasks_done": verdict.tasks_done,
        "errands_done": verdict.errands_done,
        "tasks_per_step": verdict.tasks_done / run.solution.num_steps,
        "planning_cpu_s": run.planning_cpu_s,
        "begin_cpu_s": run.begin_time_s,
        "mean_step_cpu_s": sum(run.plan_time_s) / len(run.plan_time_s),
        "max_step_cpu_s": max(run.plan_time_s),
        **asdict(pace),
        "message": verdict.fault or (f"no errand is done after step {pace.stalled_since_step}" if stalled else ""),
    }
    if options.out:
        write_text(options.out, print_solution(problem, run.solution, run.plan_time_s))
        summary["plan"] = str(options.out)
    say_summary(summary, options.json)
    return 0 if verdict.valid and not stalled else 1


def validate(options: argparse.Namespace) -> int:
    """Judge a solution; exit code 0 when it is valid, 1 with its first fault."""
    from mrp_sumo.formats.lorr import read_problem, read_solution
    from mrp_sumo.traffic.step_wise_referee import judge_step_wise

    problem = read_problem(options.problem)
    solution = read_solution(options.plan, problem)
    verdict = judge_step_wise(problem, solution)
    if options.json:
        summary = {"valid": verdict.valid, "robots": problem.num_robots, "steps": solution.num_steps}
        say_summary(summary | {"tasks_done": verdict.tasks_done, "errands_done": verdict.errands_done, "message": verdict.fault}, True)
    elif verdict.valid:
        say(f"valid: {problem.num_robots} robots, {solution.num_steps} steps, {verdict.tasks_done} tasks done")
    else:
        say(verdict.fault)
    return 0 if verdict.valid else 1


def _require_sound(options: argparse.Namespace) -> None:
    refused = [f"--{key}" for key in ("map", "scen", "assignment", "robots", "format") if getattr(options, key) is not None]
    if refused or options.time_limit is not None:
        raise MrpSumoError(f"{(refused or ['--time-limit'])[0]} is not for problems that are planned step by step")
    if options.steps is None:
        raise MrpSumoError(f"{options.scenario}: --steps is missing: a problem of the League does not say how long it lasts")
    if not 1 <= options.steps <= MAX_STEPS:
        raise MrpSumoError(f"--steps is {options.steps}, expected 1 to {MAX_STEPS}")
    if (options.seed or 0) < 0:
        raise MrpSumoError(f"the seed is {options.seed}, expected 0 or more")
    if options.out and options.out.suffix != ".json":
        raise MrpSumoError(f"{options.out.name}: a solution of a LoRR problem is JSON, expected a name that ends in .json")


def _chosen(options: argparse.Namespace) -> "tuple[str, StepPlanner]":
    from typing import cast

    from mrp_sumo.cli.scenario_choice import pairs, trust_named
    from mrp_sumo.plugins import registry

    name, parameters = options.planner or (PROGRAM if options.command else DEFAULT), dict(pairs(options))
    if options.command:
        if name != PROGRAM:
            raise MrpSumoError(f"--command is for planner '{PROGRAM}', found '{name}'")
        parameters["command"] = options.command
    trust_named(name)
    return name, cast("StepPlanner", registry.make("step_planners", name, parameters))


def _show(now: int, num_done: int) -> None:
    say_progress(f"step {now}: {num_done} orders done ")
