#!/usr/bin/env python3
"""Measures step-wise planners on lifelong problems beside published figures, or dispatchers on MAPD. Prints a table, or JSON lines.

    tools/bench_lifelong.py DATA [--only TEXT] [--planner NAME ...] [--steps N] [--seed N] [--set KEY=VALUE ...] [--json]
    tools/bench_lifelong.py --mapd [--robots N ...] [--dispatcher NAME ...] [--seeds N] [--frequency F] [--json]

DATA is a folder with `epibt_random` (a map of 819 free cells, robots in agents_0.csv to agents_7.csv, goals in tasks_one.csv: robot r
of R has the goals r, r + R, ...; 1,000 steps) and `lorr2024/example_problems` (three problems of the League of Robot Runners of 2024).
`done` counts goals or tasks; `published` is EPIBT's count (without guidance) or the best of the League; with other --steps it is not
printed. `cpu_ms` is the planner's CPU time a step on one core, kernels loaded; `max_ms` the slowest step's. Every solution is judged.

With `--mapd` the bundled scenario `mapd_lifelong` is run: 500 tasks, F a step (default: 1), robots at N of the 50 places without tasks,
drawn by the seed, every dispatcher with the same tasks. `makespan` is when the last task is done, `service` the mean time from a task's
release to its end, `p95` and `max` of the same (steps, which are seconds there); `empty` the mean way to a pick-up; `cpu_s` of the whole
run, the planner's and the checks' included.
"""

import argparse
import csv
import json
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from typing import Any

import numpy as np

import mrp_sumo as ms
from mrp_sumo.cli.scenario_choice import pairs
from mrp_sumo.core.step_wise import StepWiseProblem
from mrp_sumo.formats.lorr import read_map, read_problem
from mrp_sumo.maps.catalogue import bundled_folder
from mrp_sumo.planning.step_wise import run_step_wise
from mrp_sumo.plugins.registry import make
from mrp_sumo.traffic.step_wise_referee import judge_step_wise

EPIBT = {100: 2788, 200: 3823, 300: 3655, 400: 3349, 500: 3379, 600: 2632, 700: 2416, 800: 1658}  # robots -> goals in 1,000 steps
LEAGUE = {  # problem -> steps, tasks of the best entry
    "random.domain/random_32_32_20_100": (500, 1186),
    "city.domain/paris_1_256_250": (500, 456),
    "warehouse.domain/sortation_large_2000": (2000, 15508),
}
DISPATCHERS = ("nearest", "token_passing", "tpts", "regret", "central", "hungarian", "min_cost_flow")
MAPD_WIDTH = {"robots": 6, "dispatcher": 13, "seed": 4, "makespan": 8, "service": 8, "p95": 7, "max": 7, "empty": 6, "calls": 6, "cpu_s": 6}
WIDTH = {"problem": 22, "robots": 6, "planner": 8, "steps": 6, "done": 7, "published": 9, "ratio": 6, "cpu_ms": 8, "max_ms": 8, "valid": 6}


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, nargs="?")
    parser.add_argument("--mapd", action="store_true", help="compare dispatchers")
    parser.add_argument("--robots", type=int, action="append", metavar="N", help="may be repeated (default: 10, 20, 30, 40, 50)")
    parser.add_argument("--dispatcher", action="append", metavar="NAME", help="may be repeated (default: all)")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="0 to N - 1")
    parser.add_argument("--frequency", type=float, default=1.0, metavar="F", help="tasks a step")
    parser.add_argument("--only", default="", metavar="TEXT", help="problems whose name has it")
    parser.add_argument("--planner", action="append", metavar="NAME", help="may be repeated (default: epibt)")
    parser.add_argument("--steps", type=int, metavar="N", help="instead of those that are published")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a parameter of the planner")
    parser.add_argument("--json", action="store_true", help="print a JSON line per row")
    options = parser.parse_args()
    if options.mapd:
        return _mapd(options)
    if options.data is None:
        parser.error("DATA or --mapd is needed")
    if not options.json:
        print(" ".join(f"{key:>{width}}" for key, width in WIDTH.items()))
    faults = 0
    for robots, published in EPIBT.items():
        name = f"random_819_{robots}"
        if options.only in name:
            problem = _own_goals(options.data / "epibt_random", robots, name)
            for planner in options.planner or ["epibt"]:
                faults += not _measure(options, problem, planner, 1000, published, {"tasks": "in_turn"})
    for path, (steps, tasks) in LEAGUE.items():
        if options.only in path:
            problem = read_problem(options.data / "lorr2024" / "example_problems" / f"{path}.json")
            for planner in options.planner or ["epibt"]:
                faults += not _measure(options, problem, planner, steps, tasks, {})
    return 1 if faults else 0


def _mapd(options: argparse.Namespace) -> int:
    """A row for each fleet, seed and dispatcher."""
    if not options.json:
        print(" ".join(f"{key:>{width}}" for key, width in MAPD_WIDTH.items()))
    base = ms.Scenario.read("mapd_lifelong")
    lines = (bundled_folder("networks") / "mapd" / "mapd.map.pd").read_text().split()[::-1]  # from the lowest row
    letters = [letter for line in lines for letter in line if letter in "se."]  # those of free cells, which are numbered so
    home = [f"v{v}" for v, letter in enumerate(letters) if letter == "e"]
    task = {**base.values["tasks"]["streams"][0], "arrivals": {"per_step": options.frequency}}
    for robots in options.robots or range(10, 51, 10):
        for seed in range(options.seeds):
            starts = [home[k] for k in np.random.default_rng([seed, robots]).choice(len(home), robots, replace=False)]
            fleet = base.replace(robots={"starts": starts}, seed=seed, tasks={"streams": [task]}, record={"bag": False})
            for name in options.dispatcher or DISPATCHERS:
                before = getrusage(RUSAGE_SELF)
                run = ms.run(fleet.replace(execution={"dispatcher": name}))
                after = getrusage(RUSAGE_SELF)
                cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
                _print_mapd(options, run, robots, name, seed, cpu_s)
    return 0


def _print_mapd(options: argparse.Namespace, run: ms.Run, robots: int, name: str, seed: int, cpu_s: float) -> None:
    tasks, metrics = run.kept.execution.tasks, run.metrics
    row = {
        "robots": robots,
        "dispatcher": name,
        "seed": seed,
        "makespan": round(float(tasks.done_s.max()), 1),
        "service": round(float(tasks.service_time_s.mean()), 1),
        "p95": round(float(np.quantile(tasks.service_time_s, 0.95)), 1),
        "max": round(float(tasks.service_time_s.max()), 1),
        "empty": round(metrics["cycle_empty_travel_s"], 1),
        "calls": metrics["planner_calls"],
        "cpu_s": round(cpu_s, 1),
    }
    if options.json:
        print(json.dumps(row), flush=True)
    else:
        print(" ".join(f"{row[key]!s:>{width}}" for key, width in MAPD_WIDTH.items()), flush=True)


def _own_goals(folder: Path, robots: int, name: str) -> StepWiseProblem:
    free = read_map(folder / "map.txt")
    with (folder / f"agents_{robots // 100 - 1}.csv").open() as file:
        start = np.array([int(row["row"]) * free.shape[1] + int(row["col"]) for row in csv.DictReader(file)])
    goals = np.array([int(word) for word in (folder / "tasks_one.csv").read_text().split()[1:]])
    return StepWiseProblem(name, free, start, np.arange(len(goals) + 1), goals, len(goals))


def _measure(
    options: argparse.Namespace, problem: StepWiseProblem, name: str, steps: int, published: int | None, parameters: dict[str, Any]
) -> bool:
    planner = make("step_planners", name, parameters | dict(pairs(options)))
    planner.prepare()
    run = run_step_wise(problem, planner, options.steps or steps, options.seed)
    verdict = judge_step_wise(problem, run.solution)
    published = None if options.steps and options.steps != steps else published
    row = {
        "problem": problem.name,
        "robots": problem.num_robots,
        "planner": name,
        "steps": run.solution.num_steps,
        "done": verdict.tasks_done,
        "published": published,
        "ratio": round(verdict.tasks_done / published, 3) if published else None,
        "cpu_ms": round(1000 * run.planning_cpu_s / run.solution.num_steps, 2),
        "max_ms": round(1000 * max(run.plan_time_s), 2),
        "valid": verdict.valid,
    }
    if options.json:
        print(json.dumps(row), flush=True)
    else:
        print(" ".join(f"{'-' if row[key] is None else row[key]!s:>{width}}" for key, width in WIDTH.items()), flush=True)
    return verdict.valid


if __name__ == "__main__":
    raise SystemExit(main())
