"""Measures whether planners keep their time limits, on instances that are too hard for most.

    tools/bench_limits.py INSTANCES [--planner NAME ...] [--limit S ...] [--only TEXT] [--json]

INSTANCES is a folder with MovingAI's random-32-32-20 and warehouse-10-20-10-2-1, and the airport's grid. A planner is late where it
works for more than 5 % of its limit (at least 0.1 s) after the limit, in processor time: on a machine with other work the wall
time says more about that. `peak` is the memory of the process. `failed` is being late; exit code 1 when one is. Linux only.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from math import inf
from pathlib import Path
from time import perf_counter, process_time

import bench
import numpy as np

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.problem import Problem
from mrp_sumo.formats.instances import POINT, read_instance
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.planning.registry import planner, planner_names
from mrp_sumo.traffic.referee import judge

LIMITS_S = (0.2, 1.0, 2.0, 5.0)
HARD = {  # name -> (map, scen, robots)
    "random 400": ("random-32-32-20", "random-32-32-20_i1", 400),
    "warehouse 1000": ("warehouse-10-20-10-2-1", "warehouse-10-20-10-2-1-random-1", 1000),
    "airport 50": ("airport_terminal_0.4", "airport_terminal_0.4_n50_s3001", 50),
    "dead-end swap": ("", "", 2),
}


def tolerance_s(limit_s: float) -> float:
    """The time after its limit at which an answer still counts."""
    return max(0.1, 0.05 * limit_s)


def watched(words: list[str], limit_s: float) -> dict[str, object]:
    """The answer of a process of `ask`, and how long it worked after its limit."""
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    began = process.stdout.readline()
    if began:
        time.sleep(max(0.0, float(began) + limit_s - perf_counter()))
    at_limit_s = cpu_of(process.pid)
    rest = process.communicate()[0]
    if process.returncode:
        return {"status": f"ended with {process.returncode}", "late_cpu_s": inf}
    row = json.loads(rest)
    ended_s = row.pop("cpu_at_end_s")
    return {**row, "late_cpu_s": max(0.0, ended_s - at_limit_s) if row["wall_s"] > limit_s else 0.0}


def cpu_of(pid: int) -> float:
    """Processor time of a living process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def ask(folder: Path, name: str, hard: str, limit: str) -> dict[str, object]:
    """One planner, one instance, one limit."""
    problem, chosen = problem_of(folder, hard), planner(name, {})
    chosen.prepare()
    began, cpu_began = perf_counter(), process_time()
    print(began, flush=True)
    result = chosen.plan(problem, float(limit))
    wall_s, cpu_at_end_s = perf_counter() - began, process_time()
    valid = None if result.plan is None else judge(problem, result.plan, result.goal_of).valid
    return {
        "status": str(result.status),
        "valid": valid,
        "wall_s": wall_s,
        "cpu_s": cpu_at_end_s - cpu_began,
        "cpu_at_end_s": cpu_at_end_s,
        "bound": result.lower_bound_steps,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000,
    }


def problem_of(folder: Path, hard: str) -> Problem:
    """Two robots that change ends of a corridor; others from their files."""
    map_name, scen, robots = HARD[hard]
    if map_name:
        return read_instance(folder / f"{map_name}.map", folder / f"{scen}.scen", robots).problem
    graph = grid_graph(np.ones((1, 6), np.bool_), 1.0, (0.0, 0.0), name=hard)
    return Problem(graph, fleet_of(POINT, 2), np.array([0, 5]), np.array([5, 0]), np.array([0, 1]), 1.0)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Instances, planners, limits."""
    parser.add_argument("instances", type=Path)
    parser.add_argument("--planner", action="append", metavar="NAME", help="may be repeated (default: all)")
    parser.add_argument("--limit", action="append", type=float, metavar="S", help=f"may be repeated (default: {LIMITS_S})")
    parser.add_argument("--only", default="", metavar="TEXT", help=f"of {', '.join(HARD)}: those with this text")
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each planner, instance and limit, each in a process of its own."""
    if options.one:
        yield ask(options.instances, *options.one)
        return
    for name in options.planner or [n for n in planner_names() if n != "external"]:
        for hard in (h for h in HARD if options.only in h):
            for limit_s in options.limit or LIMITS_S:
                words = [sys.executable, __file__, str(options.instances), "--json", "--one", name, hard, str(limit_s)]
                row = {"planner": name, "instance": hard, "limit_s": limit_s, **watched(words, limit_s)}
                yield row | {"failed": row["late_cpu_s"] > tolerance_s(limit_s)}


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
