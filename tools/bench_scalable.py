#!/usr/bin/env python3
"""Measures PIBT, LaCAM and LNS2 with many robots, beside figures of lacam3. Prints a table, or JSON lines.

    tools/bench_scalable.py INSTANCES [--only TEXT] [--count N] [--anytime S] [--json] [--peer COMMAND]
    tools/bench_scalable.py --large [ROBOTS]

INSTANCES is a folder with MovingAI's random-32-32-20, random-32-32-10 and warehouse-10-20-10-2-1. Times are after
warm-up: wall time by the planner's own clock, and processor time, which other programs on the machine disturb less.
`lacam3` columns are its first solution with one thread as published beside the instances (2.x GHz core), for orientation;
give its binary as --peer 'lacam3 -m {map} -i {scen} -N {agents} -t {time_limit} -o {out}' to measure both in one run.
--large draws robots on a 500 x 500 grid with 10 % obstacles. Every plan is judged.
"""

import argparse
import json
import resource
import sys
from pathlib import Path
from statistics import mean, median
from time import process_time

import numpy as np

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.plan import Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.referee import judge
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.io.instances import POINT, read_instance
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.planning.draw import uniform_draw
from mrp_sumo.planning.registry import planner

TIME_LIMIT_S = 60.0
LACAM3 = {  # map -> robots -> (search s, cost) of the first solution
    "random-32-32-20": {100: (0.031, 2544), 200: (0.188, 6571), 300: (0.263, 13642), 400: (0.506, 25101)},
    "random-32-32-10": {100: (0.021, 2215), 200: (0.085, 4996), 300: (0.201, 9258)},
    "warehouse-10-20-10-2-1": {200: (0.28, 17221), 500: (1.49, 52529), 750: (3.29, 98413), 1000: (4.93, 158838)},
}
PLANNERS = ("pibt", "lacam", "lns2")


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("instances", nargs="?", type=Path)
    parser.add_argument("--only", default="", metavar="TEXT", help="maps whose name has it")
    parser.add_argument("--robots", type=int, metavar="N", help="only this many")
    parser.add_argument("--planner", action="append", metavar="NAME", help="may be repeated (default: all)")
    parser.add_argument("--count", type=int, default=5, metavar="N", help="instances a row at most (default: 5)")
    parser.add_argument("--anytime", type=float, metavar="S", help="let lacam and lns2 improve for S seconds")
    parser.add_argument("--peer", metavar="COMMAND", help="another program, measured too")
    parser.add_argument("--large", type=int, nargs="?", const=10_000, metavar="ROBOTS")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    try:
        rows = _large(options.large, options.planner or ["lacam", "pibt"]) if options.large else _rows(options)
        for row in rows:
            _print(row, options.json)
    except MrpSumoError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _rows(options):
    if options.instances is None:
        raise MrpSumoError("expected the folder of the instances")
    names = [*(options.planner or PLANNERS), *(["peer"] if options.peer else [])]
    for map_name, sizes in LACAM3.items():
        if options.only not in map_name:
            continue
        scens = sorted(options.instances.glob(f"{map_name}[_-]*.scen"))[: options.count]
        for num_robots, (peer_s, peer_cost) in sizes.items():
            if options.robots not in (None, num_robots):
                continue
            problems = [read_instance(options.instances / f"{map_name}.map", scen, num_robots).problem for scen in scens]
            for name in names:
                row = _measured(name, problems, options)
                yield {"map": map_name, "robots": num_robots, **row, "lacam3_s": peer_s, "lacam3_cost": peer_cost}


def _large(num_robots, names):
    free = np.random.default_rng(7).random((500, 500)) >= 0.1
    graph = grid_graph(free, 1.0, (0.0, 0.0), name="500x500")
    start, goal = uniform_draw(graph, num_robots, 1)
    problem = Problem(graph, fleet_of(POINT, num_robots), start, goal, np.arange(num_robots), 1.0)
    for name in names:
        row = _measured(name, [problem], None)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        yield {"map": "500x500", "robots": num_robots, **row, "peak_gb": round(peak, 2)}


def _measured(name, problems, options):
    anytime = options.anytime if options and name in ("lacam", "lns2") else None
    parameters = {"command": options.peer} if name == "peer" else {"anytime": True} if anytime else {}
    made = planner("external" if name == "peer" else name, parameters)
    made.prepare()
    wall, cpu, first, cost, solved, invalid = [], [], [], [], 0, 0
    for problem in problems:
        began = process_time()
        result = made.plan(problem, anytime or TIME_LIMIT_S)
        cpu.append(process_time() - began)
        wall.append(result.planning_time_s)
        if result.status is Status.SOLVED:
            solved += 1
            invalid += not judge(problem, result.plan).valid
            cost.append(float(result.plan.end_s.sum() / problem.step_s))
            first.append(result.stats.get("first_solution_time_s", result.planning_time_s))
    return {
        "planner": name,
        "solved": f"{solved}/{len(problems)}",
        "invalid": invalid,
        "wall_s": median(wall),
        "cpu_s": median(cpu),
        "first_s": median(first) if first else None,
        "cost": mean(cost) if cost else None,
    }


def _print(row, as_json):
    if as_json:
        print(json.dumps(row), flush=True)
        return
    told = " ".join(f"{key}={value:.4g}" if isinstance(value, float) and key != "cost" else f"{key}={value}" for key, value in row.items())
    print(told, flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
