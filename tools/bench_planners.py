#!/usr/bin/env python3
"""Measures planners on benchmark instances, beside peers where their binaries are given. Prints a table, or JSON lines.

    tools/bench_planners.py INSTANCES [--only TEXT] [--planner NAME ...] [--time-limit S] [--json] [--peer NAME=COMMAND ...]

INSTANCES is a folder with MovingAI files: `<map>.map`, and `<map>_n<robots>_s<seed>.scen` (the paper's draws) or
`<map>_i<number>.scen` (as many robots as wanted). Solver time is after warm-up, one process, one thread: wall time
by the planner's own clock, and processor time, which other programs on the machine disturb less. Every plan is
judged. A peer's COMMAND has {map} {scen} {agents} {time_limit} {out}; its time is that of its process.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import mean, median
from time import process_time

import numpy as np

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.plan import Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.referee import judge
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.maps.movingai import occupancy, read_problem_file, vertices_at
from mrp_sumo.maps.yaml_text import read_text
from mrp_sumo.planning.registry import planner

ROBOT = RobotType("cell", 0.3, 0.3, 1.0, 1.0, 1.0, 1.0)
PAPER = {
    "office_0.4": (9,),
    "warehouse_0.4": (5, 9),
    "airport_terminal_0.4": (9, 20, 50),
}
BENCHMARK = {
    "random-32-32-20": (50, 100, 150, 200),
    "random-32-32-10": (100, 200, 300),
    "warehouse-10-20-10-2-1": (50, 100, 200, 300, 500, 750),
}
PLANNERS = ("cbs", "ecbs", "eecbs", "cbs_ta", "ecbs_ta", "lacam")
SMALL_ONLY = {"cbs", "cbs_ta", "ecbs_ta", "prioritised", "astar"}  # not asked the benchmark maps unless named


@dataclass
class Row:
    """One planner on all instances of one size."""

    planner: str
    map: str
    robots: int
    instances: int
    solved: int
    infeasible: int
    refused: int  # two robots with one goal: no problem at all
    wall_median_s: float
    wall_max_s: float
    cpu_median_s: float
    cpu_max_s: float
    cost: float  # sum of costs, mean over the solved
    bound: float  # lower bound, mean over the solved


def main() -> int:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("instances", type=Path)
    parser.add_argument("--only", default="", help="only maps and sizes, written like 'warehouse_0.4 9', that contain this text")
    parser.add_argument("--planner", action="append", default=[], help="name, or name:key=value,...; may be repeated")
    parser.add_argument("--peer", action="append", default=[], metavar="NAME=COMMAND")
    parser.add_argument("--time-limit", type=float, default=60.0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if not options.json:
        print(f"{'planner':<12} {'map':<24} robots  solved  wall median / max s      cpu median / max s       cost / bound")
    try:
        for name, sizes in (PAPER | BENCHMARK).items():
            for robots in sizes:
                if options.only not in f"{name} {robots}":
                    continue
                chosen = options.planner or [p for p in PLANNERS if name in PAPER or p not in SMALL_ONLY]
                for text in [*chosen, *(f"external:{peer}" for peer in options.peer)]:
                    row = measure(text, options.instances, name, robots, options.time_limit)
                    if row is None:
                        continue
                    print(json.dumps(asdict(row)) if options.json else _line(row), flush=True)
    except MrpSumoError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def measure(text: str, folder: Path, name: str, robots: int, time_limit_s: float) -> Row | None:
    """Ask a planner, written `name:key=value,...`, all instances of a size; None where there are none."""
    kind, _, rest = text.partition(":")
    if kind == "external":
        label, _, command = rest.partition("=")
        made = planner("external", {"command": command})
    else:
        label = text
        made = planner(kind, {k: _value(v) for k, _, v in (pair.partition("=") for pair in rest.split(",") if pair)})
    made.prepare()
    walls, cpus, costs, bounds = [], [], [], []
    number = solved = infeasible = refused = 0
    for problem in problems(folder, name, robots):
        number += 1
        if problem is None:
            refused += 1
            continue
        began = process_time()
        result = made.plan(problem, time_limit_s)
        cpu = process_time() - began
        infeasible += result.status is Status.INFEASIBLE
        if result.status is not Status.SOLVED or result.plan is None:
            continue
        verdict = judge(problem, result.plan, result.goal_of)
        if not verdict.valid and made.guarantee != "no coordination":
            print(f"{label} on {name} {robots}: {verdict.summary(problem)}", file=sys.stderr)
            continue
        solved += 1
        walls.append(result.planning_time_s)
        cpus.append(cpu)
        costs.append(float(result.plan.end_s.sum()))
        bounds.append(result.lower_bound_steps)
    if not number:
        return None
    nothing = [float("nan")]
    return Row(
        planner=label,
        map=name,
        robots=robots,
        instances=number,
        solved=solved,
        infeasible=infeasible,
        refused=refused,
        wall_median_s=median(walls or nothing),
        wall_max_s=max(walls or nothing),
        cpu_median_s=median(cpus or nothing),
        cpu_max_s=max(cpus or nothing),
        cost=mean(costs or nothing),
        bound=mean(bounds or nothing),
    )


def problems(folder: Path, name: str, robots: int) -> Iterator[Problem | None]:
    """The problems of a map and size, each on a graph of its own, so that no distance table is known before."""
    free = occupancy(read_text(folder / f"{name}.map"))
    for path in sorted([*folder.glob(f"{name}_n{robots}_s*.scen"), *folder.glob(f"{name}_i*.scen"), *folder.glob(f"{name}-random-1.scen")]):
        rows = read_problem_file(path)
        if len(rows.start) < robots:
            continue
        graph = grid_graph(free, 1.0, (0.0, 0.0), name=name)
        try:
            yield Problem(
                graph=graph,
                fleet=fleet_of(ROBOT, robots),
                start=vertices_at(graph, rows.start[:robots], rows.height),
                goal=vertices_at(graph, rows.goal[:robots], rows.height),
                goal_of=np.arange(robots),
                step_s=1.0,
            )
        except MrpSumoError:
            yield None


def _value(text: str) -> object:
    for make in (int, float):
        try:
            return make(text)
        except ValueError:
            continue
    return {"true": True, "false": False}.get(text, text)


def _line(row: Row) -> str:
    solved = f"{row.solved}/{row.instances}" + (f" ({row.infeasible + row.refused} impossible)" if row.infeasible + row.refused else "")
    return (
        f"{row.planner:<12} {row.map:<24} {row.robots:>6}  {solved:<10} {row.wall_median_s:9.4f} / {row.wall_max_s:<9.4f} "
        f"{row.cpu_median_s:9.4f} / {row.cpu_max_s:<9.4f} {row.cost:9.1f} / {row.bound:.1f}"
    )


if __name__ == "__main__":
    raise SystemExit(main())
