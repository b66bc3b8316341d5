"""Measures planners on benchmark instances, beside peers where their binaries are given.

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
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from statistics import mean, median

import bench

from mrp_sumo.core.plan import Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.formats.instances import read_instance
from mrp_sumo.maps.readers.movingai import read_problem_set
from mrp_sumo.maps.yaml_text import read_text
from mrp_sumo.planning.protocol import Planner
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.referee import judge

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


def made(text: str) -> Planner:
    """The planner of `name:key=value,...`."""
    kind, _, rest = text.partition(":")
    return planner(kind, {k: value(v) for k, _, v in (pair.partition("=") for pair in rest.split(",") if pair)})


def scens(folder: Path, name: str, robots: int) -> list[Path]:
    """The problem files of a map that have so many robots."""
    files = sorted([*folder.glob(f"{name}_n{robots}_s*.scen"), *folder.glob(f"{name}_i*.scen"), *folder.glob(f"{name}-random-1.scen")])
    return [path for path in files if len(read_problem_set(read_text(path)).start) >= robots]


def problem_of(folder: Path, name: str, scen: Path, robots: int) -> Problem | None:
    """The problem of the first robots of a file; None where it is refused."""
    try:
        return read_instance(folder / f"{name}.map", scen, robots).problem
    except MrpSumoError:
        return None


def value(text: str) -> object:
    """A parameter's value."""
    for make in (int, float):
        try:
            return make(text)
        except ValueError:
            continue
    return {"true": True, "false": False}.get(text, text)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Instances, planners, peers."""
    parser.add_argument("instances", type=Path)
    parser.add_argument("--only", default="", help="only maps and sizes, written like 'warehouse_0.4 9', that contain this text")
    parser.add_argument("--robots", type=int, action="append", metavar="N", help="instead of the usual sizes; may be repeated")
    parser.add_argument(
        "--planner", action="append", default=[], help="name, or name:key=value,...; may be repeated; 'none' for peers only"
    )
    parser.add_argument("--peer", action="append", default=[], metavar="NAME=COMMAND", help="may be repeated")
    parser.add_argument("--time-limit", type=float, default=60.0)
    parser.add_argument("--count", type=int, default=1000, metavar="N", help="instances a row at most")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each map, size and planner."""
    peers = {name: planner("external", {"command": command}) for name, _, command in (peer.partition("=") for peer in options.peer)}
    for name, sizes in (PAPER | BENCHMARK).items():
        for robots in options.robots or sizes:
            if options.only not in f"{name} {robots}":
                continue
            chosen = options.planner or [p for p in PLANNERS if name in PAPER or p not in SMALL_ONLY]
            planners = {text: made(text) for text in chosen if text != "none"} | peers
            yield from measure(planners, options.instances, name, robots, options.time_limit, options.count)


def measure(planners: dict[str, Planner], folder: Path, name: str, robots: int, time_limit_s: float, count: int) -> list[bench.Row]:
    """Ask the planners all instances of a size; nothing where there are none.

    Times are medians and maxima over the solved, the wall time, which the limit is held against, the maximum over all. `cost` and
    `first_cost`, of the first solution of those that go on, are means over the `common` instances that all solved, `bound` over the solved.
    `refused` are no problems at all, since two robots have one goal.
    """
    answers: dict[str, dict[int, bench.Row]] = {label: {} for label in planners}
    number = refused = 0
    for chosen in planners.values():
        chosen.prepare()
    for scen in scens(folder, name, robots)[:count]:
        number += 1
        if problem_of(folder, name, scen, robots) is None:
            refused += 1
            continue
        for label, chosen in planners.items():
            problem = problem_of(folder, name, scen, robots)  # on a graph of its own: no distance table is known before
            answers[label][number] = row = answered(chosen, problem, time_limit_s)
            if row["fault"] and chosen.guarantee != "no coordination":
                print(f"{label} on {scen.name}: {row['fault']}", file=sys.stderr)
                row["cost"] = None
    solved = {label: {k: row for k, row in of.items() if row["cost"] is not None} for label, of in answers.items()}
    common = set.intersection(*map(set, solved.values())) if solved else set()
    return [
        {
            "planner": label,
            "map": name,
            "robots": robots,
            "instances": number,
            "solved": len(of),
            "infeasible": sum(row["status"] == "infeasible" for row in answers[label].values()),
            "refused": refused,
            "own_median_s": over(of.values(), "own_s", median),
            "own_max_s": over(of.values(), "own_s", max),
            "cpu_median_s": over(of.values(), "cpu_s", median),
            "cpu_max_s": over(of.values(), "cpu_s", max),
            "wall_max_s": over(answers[label].values(), "wall_s", max),
            "first_median_s": over(of.values(), "first_s", median),
            "first_cost": over((of[k] for k in common), "first_cost", mean),
            "cost": over((of[k] for k in common), "cost", mean),
            "bound": over(of.values(), "bound", mean),
            "common": len(common),
        }
        for label, of in solved.items()
        if number
    ]


def over(rows: Iterable[bench.Row], key: str, of: Callable[[list[float]], float]) -> float | None:
    """A median, mean or maximum of a column, None without values."""
    values = [row[key] for row in rows if row[key] is not None]
    return of(values) if values else None


def answered(chosen: Planner, problem: Problem, time_limit_s: float) -> bench.Row:
    """A planner's answer to an instance, judged: `cost` is None without a plan, `fault` says why one is not valid.

    `own_s` is by the planner's own clock, `first_s` until its first solution; of a program `cpu_s` is that of its process.
    """
    result, cpu_s, wall_s = bench.timed(lambda: chosen.plan(problem, time_limit_s))
    stats, own_s = result.stats, result.stats.get("own_time_s", result.planning_time_s)
    row = {
        "status": str(result.status),
        "cost": None,
        "bound": result.lower_bound_steps,
        "own_s": own_s,
        "cpu_s": stats.get("cpu_s", cpu_s),
        "wall_s": wall_s,
        "first_s": stats.get("first_solution_time_s", own_s),
        "first_cost": stats.get("first_solution_cost"),
        "fault": "",
        **{key: stats.get(key) for key in ("expanded", "generated", "low_level_expansions")},
    }
    if result.status is Status.SOLVED and result.plan is not None:
        verdict = judge(problem, result.plan, result.goal_of)
        row |= {"cost": float(result.plan.end_s.sum()), "fault": "" if verdict.valid else verdict.summary(problem)}
    return row


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
