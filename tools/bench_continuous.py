"""Measures planning in continuous time: CPU time, and what plans cost beside the bound without others.

    python tools/bench_continuous.py                           9 robots on the warehouse's roadmap, 50 seeds; 50 and 100 in the
                                                               layout of warehouse-10-20-10-2-1, with starts and goals drawn
    python tools/bench_continuous.py --map M.map --scen S.scen the same on a map and a scenario of the MovingAI benchmark
    python tools/bench_continuous.py --planner pbs --robots 9  another planner, other numbers of robots
    python tools/bench_continuous.py --json                    a line a case, for machines

Robots in the second case are 0.6 m square, drive at 2 m/s, accelerate and brake at 0.5 m/s2 and turn by a right angle in 1 s, on cells of
1 m. Kernels are loaded before the first case. `cost` is the sum of the times at which robots come to stand at their goals.
"""

import argparse
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from bench_execution import draw, warehouse

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.problem import Problem
from mrp_sumo.maps.catalogue import bundled_maps
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.roadmap import cut_lanes
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.draw import uniform_draw

BURGER = RobotType("turtlebot3", 0.138, 0.178, 0.22, 2.5, 2.5, 2.84)
SMART = RobotType("smart", 0.6, 0.6, 2.0, 0.5, 0.5, np.pi / 2)
WANTED_S = {9: 0.03, 50: 1.0, 100: 3.0}


def roadmap_problems(num_robots: int, seeds: int) -> Iterator[Problem]:
    """Starts and goals on the bundled warehouse."""
    graph = cut_lanes(load_map(bundled_maps()["warehouse"]).nav, 0.4)
    for seed in range(seeds):
        start, goal = uniform_draw(graph, num_robots, seed, BURGER.radius_m * 2 + BURGER.gap_m)
        yield Problem(graph, fleet_of(BURGER, num_robots), start, goal, np.arange(num_robots), 3.0, seed)


def grid_problem(num_robots: int, options: argparse.Namespace) -> Problem:
    """Starts and goals of a scenario's first robots, or drawn."""
    if options.map is None:
        graph = grid_graph(warehouse(), 1.0, (0.0, 0.0))
        start, goal = draw(graph, num_robots, 0, None)
    else:
        rows = [row for row in options.map.read_text().split("\n")[4:] if row]
        free = np.array([[cell in ".G" for cell in row] for row in rows])
        graph, number = grid_graph(free, 1.0, (0.0, 0.0)), np.cumsum(free.ravel()).reshape(free.shape) - 1
        columns = [line.split("\t") for line in options.scen.read_text().split("\n")[1 : num_robots + 1]]
        start, goal = (np.array([number[int(c[y]), int(c[x])] for c in columns]) for x, y in ((4, 5), (6, 7)))
    return Problem(graph, fleet_of(SMART, num_robots), start, goal, np.arange(num_robots), 3.0)


def measured(case: str, problems: Iterator[Problem], options: argparse.Namespace) -> dict[str, Any]:
    """One row of the table."""
    chosen = planner(options.planner, {})
    chosen.prepare()
    cpu_s, ratio, makespan_s = [], [], []
    for problem in problems:
        begun = time.process_time()
        result = chosen.plan(problem, options.time_limit)
        cpu_s.append(time.process_time() - begun)
        if result.plan is not None:
            ratio.append(result.stats["cost_s"] / max(result.stats["lower_bound_s"], 1e-9))
            makespan_s.append(float(result.plan.end_s.max(initial=0.0)))
    return {
        "case": case,
        "planner": options.planner,
        "robots": problem.num_robots,
        "solved": f"{len(ratio)} of {len(cpu_s)}",
        "cpu_s": round(float(np.median(cpu_s)), 3),
        "wanted_s": WANTED_S.get(problem.num_robots),
        "cost_by_bound": round(float(np.mean(ratio)), 3) if ratio else None,
        "makespan_s": round(float(np.median(makespan_s)), 1) if makespan_s else None,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--planner", default="continuous")
    parser.add_argument("--robots", type=int, nargs="*", default=[9, 50, 100])
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--time-limit", type=float, default=30.0)
    parser.add_argument("--map", type=Path)
    parser.add_argument("--scen", type=Path)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if (options.map is None) != (options.scen is None):
        parser.error("--map and --scen go together")
    for k, num_robots in enumerate(options.robots):
        if num_robots <= 20:
            row = measured("warehouse roadmap", roadmap_problems(num_robots, options.seeds), options)
        else:
            row = measured("warehouse grid", iter([grid_problem(num_robots, options)]), options)
        if options.json:
            print(json.dumps(row), flush=True)
            continue
        if k == 0:
            print("  ".join(f"{key:>17}" for key in row))
        print("  ".join(f"{'-' if value is None else value!s:>17}" for value in row.values()), flush=True)


if __name__ == "__main__":
    main()
