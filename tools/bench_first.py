"""Measures first solutions and polished ones on any grid map, beside lacam3 where its program is given.

    tools/bench_first.py MAPS [--on NAME=ROBOTS,... ...] [--seeds N] [--planner NAME ...] [--time-limit S] [--lacam3 FILE] [--memory]

MAPS is a folder of MovingAI maps; no scenario files are needed, since starts and goals are drawn from the seed. A NAME is a map of
the folder or one of the kinds that `tools/bench_cbs.py` draws. Each instance is asked of all planners in turn before the next one;
every plan is judged. A cell has the mean cost as a multiple of the sum of shortest ways, over the seeds that all who solved anything
solved, and the mean seconds.

Seconds are CPU time after warm-up; of lacam3 those of its own clock, which are wall time, so let nothing else run, or build it with
CLOCK_PROCESS_CPUTIME_ID as its clock. It is asked twice: `first` is its first solution on one thread (--no-star --no-multi-thread),
`same time` its answer, with its defaults on one core, after as many whole seconds (one at least) as the last of our planners took.

--memory asks each in a process of its own and shows that process's peak instead of seconds. Ours has Python, its libraries and the
kernels of the planners asked in it; with --json, `base_mb` says how much these are, and no program is seen to take less.
"""

import argparse
import json
import math
import os
import resource
import shlex
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from statistics import mean
from time import process_time

import bench
from bench_cbs import KINDS, problem_of
from bench_planners import made

from mrp_sumo.core.plan import Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.planning.protocol import Planner
from mrp_sumo.planning.registry import planner
from mrp_sumo.search.distance import distances
from mrp_sumo.traffic.referee import judge

DEFAULT = {
    "Berlin_1_256": (100, 300, 600, 900),
    "Paris_1_256": (100, 300, 600, 1000),
    "Boston_0_256": (100, 300, 600, 1000),
    "large": (100, 300, 600, 1000),
    "random-32-32-10": (100, 200, 300),
    "random-32-32-20": (100, 200, 300),
    "room-32-32-4": (50, 100),
    "room-64-64-8": (100, 300),
    "room-64-64-16": (100, 300),
    "maze-32-32-4": (30, 60),
    "maze-128-128-10": (100, 300),
    "warehouse-10-20-10-2-1": (100, 300, 500),
    "airport_terminal_0.4": (9, 20, 50),
    "warehouse_0.4": (9,),
}
PLANNERS = ("lacam:polish=0", "lacam")
FIRST, SAME_TIME = "lacam3, first", "lacam3, same time"
FIRST_LIMIT_S = 60.0  # of lacam3
AFTERWARDS_S = 600.0  # for lacam3 to check and to write its plan, and for a loaded machine


def _sizes(texts: list[str] | None, maps: Path) -> list[tuple[str, int]]:
    """Maps and numbers of robots: those asked for, or those of the table that are there."""
    if texts is None:
        there = [name for name in DEFAULT if name in KINDS or (maps / f"{name}.map").is_file()]
        return [(name, robots) for name in there for robots in DEFAULT[name]]
    sizes = [(text.partition("=")[0], text.partition("=")[2].split(",")) for text in texts]
    return [(name, int(robots)) for name, many in sizes for robots in many]


def _asked(
    ours: dict[str, Planner], options: argparse.Namespace, name: str, robots: int, seed: int
) -> Iterator[tuple[str, dict[str, float | bool]]]:
    """Label and answer of each planner in turn, each on a graph of its own, so that no distance table is known before."""
    where = name if name in KINDS else str(options.maps / f"{name}.map")
    measured = _in_a_process if options.memory else _measured
    if options.lacam3:
        first = _lacam3(options.lacam3, "--no-star --no-multi-thread", FIRST_LIMIT_S)
        yield FIRST, measured(first, where, robots, seed, FIRST_LIMIT_S + AFTERWARDS_S)
    seconds = 0.0
    for label, chosen in ours.items():
        answer = measured(chosen, where, robots, seed, options.time_limit)
        seconds = answer["cpu_s"]
        yield label, answer
    if options.lacam3:
        limit_s = max(1.0, math.ceil(seconds))
        yield SAME_TIME, measured(_lacam3(options.lacam3, "", limit_s), where, robots, seed, 2 * limit_s + AFTERWARDS_S)


def _lacam3(program: Path, flags: str, limit_s: float) -> Planner:
    core = min(os.sched_getaffinity(0))
    place = shlex.quote(str(program.resolve()))
    command = f"taskset -c {core} {place} -m {{map}} -i {{scen}} -N {{agents}} -s {{seed}} -o {{out}} -t {limit_s:.0f} {flags}"
    return planner("external", {"command": command})


def _measured(chosen: Planner, where: str, robots: int, seed: int, limit_s: float, whose: int | None = None) -> dict[str, float | bool]:
    """One answer, with the peak so far of the process or its children if it is asked `whose`. Its bound is the sum of shortest ways."""
    problem = problem_of(where, robots, seed)
    began = process_time()
    result = chosen.plan(problem, limit_s)
    cpu_s = process_time() - began
    peak = {} if whose is None else {"peak_mb": resource.getrusage(whose).ru_maxrss / 1024}  # the bound takes a table for each robot
    answer = peak | {
        "bound": _shortest(problem),
        "cpu_s": result.stats.get("own_time_s", result.stats.get("cpu_s", cpu_s)),
    }
    if result.status is not Status.SOLVED or result.plan is None:
        return answer | {"solved": False, "cost": None}
    verdict = judge(problem, result.plan, result.goal_of)
    if not verdict.valid:
        raise MrpSumoError(f"{where}, {robots} robots, seed {seed}: {verdict.summary(problem)}")
    return answer | {"solved": True, "cost": float(result.plan.end_s.sum())}


def _in_a_process(chosen: Planner, where: str, robots: int, seed: int, limit_s: float) -> dict[str, float | bool]:
    """The same in a child process, whose peak is that of this answer."""
    read, write = os.pipe()
    if (child := os.fork()) == 0:
        whose = resource.RUSAGE_CHILDREN if hasattr(chosen, "command") else resource.RUSAGE_SELF
        base_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        answer = _measured(chosen, where, robots, seed, limit_s, whose)
        os.write(write, json.dumps(answer | {"base_mb": base_mb}).encode())
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as said:
        text = said.read()
    os.waitpid(child, 0)
    if not text:
        raise MrpSumoError(f"{where}, {robots} robots, seed {seed}: the process ended without an answer")
    return json.loads(text)


def _shortest(problem: Problem) -> int:
    known = distances(problem.graph)
    return sum(int(known.to(goal)[start]) for start, goal in zip(problem.start.tolist(), problem.goal.tolist()))


def _cells(answers: list[dict[int, dict[str, float]]], memory: bool) -> list[str]:
    """Those of one size, a dictionary from seeds for each planner."""
    able = [by_seed for by_seed in answers if any(answer["solved"] for answer in by_seed.values())]
    common = [seed for seed in answers[0] if all(by_seed[seed]["solved"] for by_seed in able)]
    cells = []
    for by_seed in answers:
        cost = f"{mean(by_seed[seed]['cost'] / by_seed[seed]['bound'] for seed in common):.4f}" if common and by_seed in able else "–"
        spent = f"{max(a['peak_mb'] for a in by_seed.values()):.0f} MB" if memory else f"{mean(a['cpu_s'] for a in by_seed.values()):.3g} s"
        missing = sum(not answer["solved"] for answer in by_seed.values())
        cells.append(f"{cost}, {spent}" + (f" ({missing} of {len(by_seed)} not solved)" if missing else ""))
    return cells


def arguments(parser: argparse.ArgumentParser) -> None:
    """Maps, planners, limits."""
    parser.add_argument("maps", type=Path)
    parser.add_argument("--on", action="append", metavar="NAME=ROBOTS,...", help="may be repeated (default: fourteen maps)")
    parser.add_argument("--seeds", type=int, default=2, metavar="N", help="instances of each size (default: 2)")
    parser.add_argument("--planner", action="append", help=f"name, or name:key=value,...; may be repeated (default: {', '.join(PLANNERS)})")
    parser.add_argument("--lacam3", type=Path, metavar="FILE", help="its program")
    parser.add_argument("--time-limit", type=float, default=60.0, metavar="S", help="of each of our planners, wall time (default: 60)")
    parser.add_argument("--memory", action="store_true", help="peak memory of processes, too")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each answer."""
    if options.lacam3 and not options.lacam3.is_file():
        raise MrpSumoError(f"{options.lacam3}: no such program")
    ours = {name: made(name) for name in options.planner or PLANNERS}
    for chosen in ours.values():
        chosen.prepare()
    for name, robots in _sizes(options.on, options.maps):
        for seed in range(options.seeds):
            for label, answer in _asked(ours, options, name, robots, seed):
                yield {"map": name, "robots": robots, "seed": seed, "planner": label, **answer}


def summary(rows: list[bench.Row], options: argparse.Namespace) -> str:
    """A line for each size; a cell has the mean cost over the shortest ways, and the mean seconds or the peak memory."""
    sizes: dict[tuple[str, int], dict[str, dict[int, bench.Row]]] = defaultdict(lambda: defaultdict(dict))
    for row in rows:
        sizes[row["map"], row["robots"]][row["planner"]][row["seed"]] = row
    labels = list(dict.fromkeys(row["planner"] for row in rows))
    lines = [bench.line(["map", "robots", *labels]), bench.line(["---"] + ["---:"] * (1 + len(labels)))]
    for (name, robots), answers in sizes.items():
        lines.append(bench.line([name, str(robots), *_cells([answers[label] for label in labels], options.memory)]))
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
