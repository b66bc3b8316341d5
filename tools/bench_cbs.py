#!/usr/bin/env python3
"""Measures optimal conflict-based search where it is hard, on maps of the kinds that the literature uses. Prints a table, or JSON lines.

    tools/bench_cbs.py [--kind NAME=ROBOTS ...] [--seeds N] [--planner NAME ...] [--time-limit S] [--json]

Kinds: `large`, 256 x 256 with irregular obstacles, three fifths free, as den520d; `random`, 64 x 64 with a fifth blocked; `room`,
64 x 64 in rooms of 7 x 7 with a door in each wall; `warehouse`, 163 x 63 with shelves of 10 x 2. Maps, starts and goals are drawn from the
seed, so that anybody has the same instances without a download; any other name is a file with a MovingAI map. CPU seconds are after
warm-up; every plan is judged. With --json each instance is a line.
"""

import argparse
import json
import sys
from pathlib import Path
from statistics import mean, median
from time import process_time

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from bench_planners import made

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.plan import Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.formats.instances import POINT
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.maps.readers.movingai import occupancy
from mrp_sumo.maps.yaml_text import read_text
from mrp_sumo.traffic.draw import uniform_draw
from mrp_sumo.traffic.referee import judge

DEFAULT = ("large=50", "random=60", "room=20", "warehouse=60")


def main() -> int:
    """Read the command line, and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", action="append", metavar="NAME=ROBOTS", help=f"default: {', '.join(DEFAULT)}")
    parser.add_argument("--planner", action="append", help="name, or name:key=value,...; may be repeated (default: cbs)")
    parser.add_argument("--seeds", type=int, default=12, metavar="N", help="instances of each kind (default: 12)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--time-limit", type=float, default=10.0, metavar="S", help="of an instance (default: 10)")
    parser.add_argument("--json", action="store_true", help="a line of JSON for each instance")
    options = parser.parse_args()
    try:
        planners = {name: made(name) for name in options.planner or ["cbs"]}
        for asked in planners.values():
            asked.prepare()
        for kind in options.kind or DEFAULT:
            name, robots = kind.rsplit("=", 1)
            rows = []
            for seed in range(options.first, options.first + options.seeds):
                problem = problem_of(name, int(robots), seed)
                for planner, asked in planners.items():
                    rows.append(measured(asked, problem, options.time_limit) | {"planner": planner, "kind": kind, "seed": seed})
                    if options.json:
                        print(json.dumps(rows[-1]), flush=True)
            if not options.json:
                for planner in planners:
                    show([row for row in rows if row["planner"] == planner])
    except (MrpSumoError, ValueError) as error:
        print(f"bench_cbs.py: {error}", file=sys.stderr)
        return 2
    return 0


def problem_of(name: str, robots: int, seed: int) -> Problem:
    """An instance of a kind, or of a map in a file."""
    rng = np.random.default_rng([seed, 520])
    graph = grid_graph(KINDS[name](rng) if name in KINDS else occupancy(read_text(Path(name))), 1.0, (0.0, 0.0))
    start, goal = uniform_draw(graph, robots, seed)
    return Problem(graph, fleet_of(POINT, robots), start, goal, np.arange(robots), 1.0, seed)


def large(rng: np.random.Generator) -> np.ndarray:
    """Noise of several sizes, summed and cut: halls, islands and ragged walls."""
    size, total = 256, np.zeros((256, 256))
    for cells, weight in ((8, 4.0), (16, 2.0), (32, 1.0), (64, 0.5)):
        noise = rng.random((cells + 1, cells + 1))
        at = np.arange(size) * cells / size
        low, part = at.astype(int), at - at.astype(int)
        rows = noise[low] * (1 - part)[:, None] + noise[low + 1] * part[:, None]
        total += weight * (rows[:, low] * (1 - part) + rows[:, low + 1] * part)
    return total < np.quantile(total, 0.6)


def random(rng: np.random.Generator) -> np.ndarray:
    """Each cell for itself."""
    return rng.random((64, 64)) > 0.2


def room(rng: np.random.Generator) -> np.ndarray:
    """Walls every eighth cell, with a door between rooms side by side."""
    free = np.ones((64, 64), bool)
    free[7::8], free[:, 7::8] = False, False
    for wall in range(7, 63, 8):
        for begin in range(0, 64, 8):
            free[wall, begin + rng.integers(7)] = True
            free[begin + rng.integers(7), wall] = True
    return free


def warehouse(rng: np.random.Generator) -> np.ndarray:
    """Shelves with aisles of one cell between them, and open floor at both ends."""
    free = np.ones((63, 163), bool)
    for row in range(2, 60, 3):
        for column in range(26, 136, 11):
            free[row : row + 2, column : column + 10] = False
    return free


KINDS = {"large": large, "random": random, "room": room, "warehouse": warehouse}


def measured(asked: object, problem: Problem, time_limit_s: float) -> dict[str, object]:
    """What a planner makes of an instance."""
    began = process_time()
    result = asked.plan(problem, time_limit_s)
    row = {
        "status": str(result.status.value),
        "cost": None,
        "lower": result.lower_bound_steps,
        "cpu_s": round(process_time() - began, 3),
        "wall_s": round(result.planning_time_s, 3),
        **{key: result.stats.get(key) for key in ("expanded", "generated", "low_level_expansions")},
    }
    if result.status is Status.SOLVED:
        verdict = judge(problem, result.plan)
        if not verdict.valid:
            raise ValueError(f"seed {problem.seed}: {verdict.summary(problem)}")
        row["cost"] = round(float(result.plan.end_s.sum()))
    return row


def show(rows: list[dict]) -> None:
    """A line of the table."""
    solved = [row for row in rows if row["cost"] is not None]
    text = f"{rows[0]['planner']:24} {Path(rows[0]['kind']).name:20} solved {len(solved):3} of {len(rows):3}"
    if solved:
        cpu_s = [row["cpu_s"] for row in solved]
        nodes = median(row["expanded"] for row in solved)
        text += f"   CPU s median {median(cpu_s):8.3f}  mean {mean(cpu_s):8.3f}  max {max(cpu_s):8.3f}   nodes {nodes:8g}"
    print(f"{text}   longest {max(row['wall_s'] for row in rows):.2f} s", flush=True)


if __name__ == "__main__":
    sys.exit(main())
