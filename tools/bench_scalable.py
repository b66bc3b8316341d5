#!/usr/bin/env python3
"""Measures PIBT, LaCAM and LNS2 with many robots, beside peers where their binaries are given. Prints a table, or JSON lines.

    tools/bench_scalable.py INSTANCES [--only TEXT] [--count N] [--anytime S] [--json] [--peer NAME=COMMAND ...]
    tools/bench_scalable.py --large [ROBOTS]

INSTANCES is a folder with MovingAI's random-32-32-20, random-32-32-10 and warehouse-10-20-10-2-1; where a map has fewer
scenarios than --count, others are drawn. Times are after
warm-up: `first` until the first solution and `own` until the answer by the solver's own clock, `cpu` of the processor for the whole
answer. All planners are asked an instance before the next one. Every plan is judged; `cost` is the mean over the instances that all
solved, `first_cost` that of the first solution where the planner tells it.

A peer's COMMAND has places, see `mrp_sumo.planning.external`; `own` is then what its output says, `cpu` that of its process. For
lacam3 on one thread: --peer 'lacam3=lacam3 -m {map} -i {scen} -N {agents} -t {time_limit} -o {out} --no-star --no-multi-thread', and
`taskset -c 1` before this script. Without a peer the table ends with lacam3's figures as published beside the instances (its first
solution on another machine), for orientation. --large draws robots on a 500 x 500 grid with 10 % obstacles.
"""

import argparse
import json
import resource
import sys
from collections import Counter
from functools import partial
from pathlib import Path
from statistics import mean, median
from time import process_time

import numpy as np

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.formats.instances import POINT, read_instance
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.draw import uniform_draw
from mrp_sumo.traffic.referee import judge

LACAM3 = {  # map -> robots -> (search s, cost) of the first solution
    "random-32-32-20": {100: (0.031, 2544), 200: (0.188, 6571), 300: (0.263, 13642), 400: (0.506, 25101)},
    "random-32-32-10": {100: (0.021, 2215), 200: (0.085, 4996), 300: (0.201, 9258)},
    "warehouse-10-20-10-2-1": {200: (0.28, 17221), 500: (1.49, 52529), 750: (3.29, 98413), 1000: (4.93, 158838)},
}
PLANNERS = ("pibt", "lacam", "lns2")
WIDTH = {"map": 24, "robots": 6, "planner": 14, "solved": 6, "invalid": 7, "common": 6}  # of columns


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("instances", nargs="?", type=Path)
    parser.add_argument("--only", default="", metavar="TEXT", help="maps whose name has it")
    parser.add_argument("--robots", type=int, metavar="N", help="only this many")
    parser.add_argument("--planner", action="append", metavar="NAME", help="may be repeated (default: all)")
    parser.add_argument("--count", type=int, default=5, metavar="N", help="instances a row at most (default: 5)")
    parser.add_argument("--anytime", type=float, metavar="S", help="let lacam and lns2 improve for S seconds")
    parser.add_argument("--time-limit", type=float, default=60.0, metavar="S")
    parser.add_argument(
        "--peer", action="append", default=[], metavar="NAME=COMMAND", help="another program, measured too; may be repeated"
    )
    parser.add_argument("--large", type=int, nargs="?", const=10_000, metavar="ROBOTS")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    try:
        rows = _large(options.large, options.planner or ["lacam", "pibt"]) if options.large else _rows(options)
        for number, row in enumerate(rows):
            if not number and not options.json:
                print(_heading(row))
            print(json.dumps(row) if options.json else _line(row), flush=True)
    except MrpSumoError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _rows(options):
    if options.instances is None:
        raise MrpSumoError("expected the folder of the instances")
    asked = {name: _made(name, bool(options.anytime)) for name in options.planner or PLANNERS}
    peers = dict(peer.partition("=")[::2] for peer in options.peer)
    asked |= {name: planner("external", {"command": command}) for name, command in peers.items()}
    for map_name, sizes in LACAM3.items():
        if options.only not in map_name:
            continue
        scens = sorted(options.instances.glob(f"{map_name}[_-]*.scen"))[: options.count]
        for num_robots, (peer_s, peer_cost) in sizes.items():
            if options.robots not in (None, num_robots):
                continue
            makers = [partial(_problem, options.instances / f"{map_name}.map", scen, num_robots) for scen in scens]
            for row in _measured(asked, makers, options.anytime or options.time_limit):
                published = {} if peers else {"lacam3_s": peer_s, "lacam3_cost": peer_cost}
                yield {"map": map_name, "robots": num_robots, **row, **published}


def _large(num_robots, names):
    free = np.random.default_rng(7).random((500, 500)) >= 0.1
    graph = grid_graph(free, 1.0, (0.0, 0.0), name="500x500")
    problem = _drawn(graph, num_robots, 1)
    for name in names:
        for row in _measured({name: _made(name, False)}, [lambda: problem], 60.0):
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
            yield {"map": "500x500", "robots": num_robots, **row, "peak_gb": round(peak, 2)}


def _problem(map_path, scen, num_robots):
    return read_instance(map_path, scen, num_robots).problem


def _made(name, anytime):
    return planner(name, {"anytime": True} if anytime and name in ("lacam", "lns2") else {})


def _drawn(graph, num_robots, seed):
    start, goal = uniform_draw(graph, num_robots, seed)
    return Problem(graph, fleet_of(POINT, num_robots), start, goal, np.arange(num_robots), 1.0)


def _measured(asked, makers, time_limit_s):
    """A row a planner; each is given a problem on a graph of its own, so that no distance table is known before."""
    answers = {name: {} for name in asked}
    cpus = {name: [] for name in asked}
    invalid = Counter()
    for chosen in asked.values():
        chosen.prepare()
    for number, make in enumerate(makers):
        for name, chosen in asked.items():
            problem = make()
            began = process_time()
            result = chosen.plan(problem, time_limit_s)
            cpus[name].append(result.stats.get("cpu_s", process_time() - began))
            if result.plan is None:
                continue
            if not judge(problem, result.plan, result.goal_of).valid:
                invalid[name] += 1
                continue
            own_s = result.stats.get("own_time_s", result.planning_time_s)
            answers[name][number] = {
                "own_s": own_s,
                "first_s": result.stats.get("first_solution_time_s", own_s),
                "first_cost": result.stats.get("first_solution_cost"),
                "cost": float(result.plan.end_s.sum() / problem.step_s),
            }
    common = set.intersection(*(set(solved) for solved in answers.values()))
    for name, solved in answers.items():
        first_costs = [a["first_cost"] for k, a in solved.items() if k in common and a["first_cost"] is not None]
        yield {
            "planner": name,
            "solved": f"{len(solved)}/{len(makers)}",
            "invalid": invalid[name],
            "first_s": median([a["first_s"] for a in solved.values()]) if solved else None,
            "own_s": median([a["own_s"] for a in solved.values()]) if solved else None,
            "cpu_s": median(cpus[name]),
            "first_cost": mean(first_costs) if first_costs else None,
            "cost": mean(solved[k]["cost"] for k in common) if common else None,
            "common": len(common),
        }


def _heading(row):
    return " ".join(f"{key:>{WIDTH.get(key, 11)}}" for key in row)


def _line(row):
    return " ".join(f"{_text(key, value):>{WIDTH.get(key, 11)}}" for key, value in row.items())


def _text(key, value):
    if isinstance(value, float):
        return f"{value:.0f}" if key.endswith("cost") else f"{value:.4g}"
    return "-" if value is None else str(value)


if __name__ == "__main__":
    raise SystemExit(main())
