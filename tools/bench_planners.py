#!/usr/bin/env python3
"""Measures planners on benchmark instances, beside peers where their binaries are given. Prints a table, or JSON lines.

    tools/bench_planners.py INSTANCES [--only TEXT] [--planner NAME ...] [--time-limit S] [--json] [--peer NAME=COMMAND ...]

INSTANCES is a folder with MovingAI files: `<map>.map`, and `<map>_n<robots>_s<seed>.scen` (the paper's draws) or
`<map>_i<number>.scen` (as many robots as wanted). All planners are asked an instance before the next one, so that they
share what the machine does meanwhile. Times are after warm-up, of one process on one thread: `own` by the solver's
own clock, `cpu` of the processor. Every plan is judged; `cost` is the mean over the instances that all planners solved.

A peer's COMMAND has places such as {map} {scen} {agents} {time_limit} {out}, see `mrp_sumo.planning.external`. Its `own`
is what its output says (else its process's wall time), its `cpu` that of its whole process, reading and writing too:
put `taskset -c 1` before this script, so that peers with threads have one core as well.
"""

import argparse
import json
import sys
from collections import Counter
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from statistics import mean, median
from time import perf_counter, process_time

import numpy as np

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.plan import Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.maps.readers.movingai import occupancy, read_problem_file, vertices_at
from mrp_sumo.maps.yaml_text import read_text
from mrp_sumo.planning.protocol import Planner
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.referee import judge

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
    """One planner on all instances of one size. Times are medians and maxima over the solved."""

    planner: str
    map: str
    robots: int
    instances: int
    solved: int
    infeasible: int
    refused: int  # two robots with one goal: no problem at all
    own_median_s: float
    own_max_s: float
    cpu_median_s: float
    cpu_max_s: float
    wall_max_s: float  # over all instances: what the limit is held against
    cost: float  # sum of costs, mean over the instances that all solved
    bound: float  # lower bound, mean over the solved
    common: int  # instances that all solved


@dataclass(frozen=True)
class Answer:
    """One planner on one instance that it solved."""

    own_s: float
    cpu_s: float
    cost: float
    bound: float


def main() -> int:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("instances", type=Path)
    parser.add_argument("--only", default="", help="only maps and sizes, written like 'warehouse_0.4 9', that contain this text")
    parser.add_argument(
        "--planner", action="append", default=[], help="name, or name:key=value,...; may be repeated; 'none' for peers only"
    )
    parser.add_argument("--peer", action="append", default=[], metavar="NAME=COMMAND", help="may be repeated")
    parser.add_argument("--time-limit", type=float, default=60.0)
    parser.add_argument("--count", type=int, default=1000, metavar="N", help="instances a row at most")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if not options.json:
        print(f"{'planner':<14} {'map':<22} robots  {'solved':<22} {'own ms: median / max':<23} {'cpu ms: median / max':<23} cost / bound")
    try:
        peers = {name: planner("external", {"command": command}) for name, _, command in (peer.partition("=") for peer in options.peer)}
        for name, sizes in (PAPER | BENCHMARK).items():
            for robots in sizes:
                if options.only not in f"{name} {robots}":
                    continue
                chosen = options.planner or [p for p in PLANNERS if name in PAPER or p not in SMALL_ONLY]
                asked = {text: made(text) for text in chosen if text != "none"} | peers
                for row in measure(asked, options.instances, name, robots, options.time_limit, options.count):
                    print(json.dumps(asdict(row)) if options.json else line(row), flush=True)
    except MrpSumoError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def made(text: str) -> Planner:
    """The planner of `name:key=value,...`."""
    kind, _, rest = text.partition(":")
    return planner(kind, {k: value(v) for k, _, v in (pair.partition("=") for pair in rest.split(",") if pair)})


def measure(asked: dict[str, Planner], folder: Path, name: str, robots: int, time_limit_s: float, count: int) -> list[Row]:
    """Ask the planners all instances of a size; nothing where there are none."""
    answers: dict[str, dict[int, Answer]] = {label: {} for label in asked}
    infeasible, wall_max_s = Counter[str](), Counter[str]()
    number = refused = 0
    for chosen in asked.values():
        chosen.prepare()
    for scen in scens(folder, name, robots)[:count]:
        number += 1
        if problem_of(folder, name, scen, robots) is None:
            refused += 1
            continue
        for label, chosen in asked.items():
            problem = problem_of(folder, name, scen, robots)  # on a graph of its own: no distance table is known before
            began, cpu_began = perf_counter(), process_time()
            result = chosen.plan(problem, time_limit_s)
            cpu_s = result.stats.get("cpu_s", process_time() - cpu_began)
            wall_max_s[label] = max(wall_max_s[label], perf_counter() - began)
            infeasible[label] += result.status is Status.INFEASIBLE
            if result.status is not Status.SOLVED or result.plan is None:
                continue
            verdict = judge(problem, result.plan, result.goal_of)
            if not verdict.valid and chosen.guarantee != "no coordination":
                print(f"{label} on {scen.name}: {verdict.summary(problem)}", file=sys.stderr)
                continue
            own_s = result.stats.get("own_time_s", result.planning_time_s)
            answers[label][number] = Answer(own_s, cpu_s, float(result.plan.end_s.sum()), result.lower_bound_steps)
    common = set.intersection(*(set(solved) for solved in answers.values())) if answers else set()
    nothing = [float("nan")]
    rows = []
    for label, solved in answers.items() if number else ():
        own, cpu = [a.own_s for a in solved.values()] or nothing, [a.cpu_s for a in solved.values()] or nothing
        rows.append(
            Row(
                planner=label,
                map=name,
                robots=robots,
                instances=number,
                solved=len(solved),
                infeasible=infeasible[label],
                refused=refused,
                own_median_s=median(own),
                own_max_s=max(own),
                cpu_median_s=median(cpu),
                cpu_max_s=max(cpu),
                wall_max_s=wall_max_s[label],
                cost=mean([solved[k].cost for k in common] or nothing),
                bound=mean([a.bound for a in solved.values()] or nothing),
                common=len(common),
            )
        )
    return rows


def scens(folder: Path, name: str, robots: int) -> list[Path]:
    """The problem files of a map that have so many robots."""
    found = sorted([*folder.glob(f"{name}_n{robots}_s*.scen"), *folder.glob(f"{name}_i*.scen"), *folder.glob(f"{name}-random-1.scen")])
    return [path for path in found if len(read_problem_file(path).start) >= robots]


def problem_of(folder: Path, name: str, scen: Path, robots: int) -> Problem | None:
    """The problem of the first robots of a file; None where it is refused."""
    rows = read_problem_file(scen)
    graph = grid_graph(free_cells(folder / f"{name}.map"), 1.0, (0.0, 0.0), name=name)
    try:
        return Problem(
            graph=graph,
            fleet=fleet_of(ROBOT, robots),
            start=vertices_at(graph, rows.start[:robots], rows.height),
            goal=vertices_at(graph, rows.goal[:robots], rows.height),
            goal_of=np.arange(robots),
            step_s=1.0,
        )
    except MrpSumoError:
        return None


@cache
def free_cells(path: Path) -> np.ndarray:
    """[H, W] of a map."""
    return occupancy(read_text(path))


def value(text: str) -> object:
    """A parameter's value."""
    for make in (int, float):
        try:
            return make(text)
        except ValueError:
            continue
    return {"true": True, "false": False}.get(text, text)


def line(row: Row) -> str:
    """A row of the table."""
    solved = f"{row.solved}/{row.instances}" + (f" ({row.infeasible + row.refused} impossible)" if row.infeasible + row.refused else "")
    own, cpu = f"{1000 * row.own_median_s:.1f} / {1000 * row.own_max_s:.1f}", f"{1000 * row.cpu_median_s:.1f} / {1000 * row.cpu_max_s:.1f}"
    cost = f"{row.cost:.1f} / {row.bound:.1f}" + (f" ({row.common} common)" if row.common < row.solved else "")
    return f"{row.planner:<14} {row.map:<22} {row.robots:>6}  {solved:<22} {own:<23} {cpu:<23} {cost}"


if __name__ == "__main__":
    raise SystemExit(main())
