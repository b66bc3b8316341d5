"""Measures optimal conflict-based search where it is hard, on maps of the kinds that the literature uses.

    tools/bench_cbs.py [--kind NAME=ROBOTS ...] [--seeds N] [--planner NAME ...] [--time-limit S] [--json]

Kinds: `large`, 256 x 256 with irregular obstacles, three fifths free, as den520d; `random`, 64 x 64 with a fifth blocked; `room`,
64 x 64 in rooms of 7 x 7 with a door in each wall; `warehouse`, 163 x 63 with shelves of 10 x 2;
`huge`, 500 x 500 with a tenth blocked, for scalable planners. Maps, starts and goals are drawn from the
seed, so that anybody has the same instances without a download; any other name is a file with a MovingAI map. CPU seconds are after
warm-up; every plan is judged. With --json each instance is a line.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import mean, median

import bench
import numpy as np
from bench_planners import answered, made, over

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.problem import Problem
from mrp_sumo.formats.instances import POINT
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.maps.readers.movingai import occupancy
from mrp_sumo.maps.yaml_text import read_text
from mrp_sumo.traffic.draw import uniform_draw

DEFAULT = ("large=50", "random=60", "room=20", "warehouse=60")


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


def huge(rng: np.random.Generator) -> np.ndarray:
    """Each cell for itself, few of them blocked."""
    return rng.random((500, 500)) >= 0.1


KINDS = {"large": large, "random": random, "room": room, "warehouse": warehouse, "huge": huge}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Kinds of maps, and planners."""
    parser.add_argument("--kind", action="append", metavar="NAME=ROBOTS", help=f"default: {', '.join(DEFAULT)}")
    parser.add_argument("--planner", action="append", help="name, or name:key=value,...; may be repeated (default: cbs)")
    parser.add_argument("--seeds", type=int, default=12, metavar="N", help="instances of each kind (default: 12)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--time-limit", type=float, default=10.0, metavar="S", help="of an instance (default: 10)")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each instance and planner."""
    planners = {name: made(name) for name in options.planner or ["cbs"]}
    for chosen in planners.values():
        chosen.prepare()
    for kind in options.kind or DEFAULT:
        name, robots = kind.rsplit("=", 1)
        for seed in range(options.first, options.first + options.seeds):
            problem = problem_of(name, int(robots), seed)
            for planner, chosen in planners.items():
                row = answered(chosen, problem, options.time_limit)
                if fault := row.pop("fault"):
                    raise ValueError(f"seed {seed}: {fault}")
                yield {"planner": planner, "kind": kind, "seed": seed, **row}


def summary(rows: list[bench.Row], options: argparse.Namespace) -> str:
    """A line for each kind and planner."""
    lines = []
    for planner, kind in dict.fromkeys((row["planner"], row["kind"]) for row in rows):
        mine = [row for row in rows if (row["planner"], row["kind"]) == (planner, kind)]
        solved = [row for row in mine if row["cost"] is not None]
        text = f"{planner:24} {Path(kind).name:20} solved {len(solved):3} of {len(mine):3}"
        if solved:
            cpu_s = [row["cpu_s"] for row in solved]
            text += f"   CPU s median {median(cpu_s):8.3f}  mean {mean(cpu_s):8.3f}  max {max(cpu_s):8.3f}"
            text += f"   nodes {over(solved, 'expanded', median) or 0:8g}"
        lines.append(f"{text}   longest {max(row['own_s'] for row in mine):.2f} s")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
