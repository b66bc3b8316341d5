"""Answers of `auto` beside those of every single planner, on questions drawn over maps, graphs, types of robots and sizes of fleets.

    python tools/bench_portfolio.py --maps DIR --maps DIR --questions 500 --out answers.jsonl   # a line for each question and planner
    python tools/bench_portfolio.py --maps DIR --maps DIR --questions 500 --out answers.jsonl --planner auto   # one planner alone
    python tools/bench_portfolio.py --out answers.jsonl --report                                               # the tables

Questions with even numbers are for choosing rules, those with odd numbers for reporting. A question hangs on the maps, `--seed` and its
number; one that cannot be set up is no question. Costs are flow times in s of plans as they will be driven: valid, with the times of real
motion. Times and limits are CPU seconds of planning, each planner's on a copy of the graph of which nothing is known yet. The best time
is that of the quickest planner whose plan costs at most 2 % more than the cheapest of all. Planners that choose goals themselves are left
out: they answer another question. `astar` is, too: its plans are valid by chance.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import bench
import numpy as np

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.solve import solve
from mrp_sumo.experiments.staging.set_up import SetUp, planned_as, set_up
from mrp_sumo.io.scenario.read import changed, scenario_of
from mrp_sumo.maps.catalogue import bundled_maps

SINGLE = ("prioritised", "continuous", "pbs", "ccbs", "cbs", "ecbs", "eecbs", "pibt", "lacam", "lns2")
TYPES = ("turtlebot3", "amr_600", "forklift", "tugger", "pallet_truck", "counterbalance_forklift")
CELLS_M = (0.4, 0.5, 0.8, 1.0, 1.5, 2.0, 4.1, 6.0)  # the last for vehicles that cannot turn in place
MOST_VERTICES = 20_000
DEARER = 1.02  # than the cheapest, for the best time
HALVES = ("chosen on", "reported")
TRIES = 300  # draws of a question until one can be set up


def drawn(files: list[Path], options: argparse.Namespace, number: int, maps: MapCache) -> SetUp:
    """The question of a number, set up."""
    rng = np.random.default_rng([options.seed, number])
    for _ in range(TRIES):
        values = scenario(files[int(rng.integers(len(files)))], rng)
        try:
            setup = set_up(scenario_of(values, Path(), "question"), maps)
            if setup.problem.graph.num_vertices <= MOST_VERTICES:
                return setup
        except MrpSumoError:
            continue
    raise ValueError(f"question {number}: nothing of {TRIES} draws can be set up")


def scenario(file: Path, rng: np.random.Generator) -> dict[str, Any]:
    """A scenario drawn on a map."""
    grid = bool(rng.random() < 0.4)
    kind: dict[str, Any] = {"kind": "grid"} if grid else {"kind": "roadmap", "lanes": str(rng.choice(["single_track", "two_way"]))}
    return {
        "map": {"file": str(file.resolve())},
        "discretisation": {**kind, "cell_m": float(rng.choice(CELLS_M))},
        "robots": {
            "count": int(2 ** rng.uniform(1, 6.7)),
            "type": str(rng.choice(TYPES)),
            "draw": str(rng.choice(["uniform", "anywhere"])),
        },
        "assignment": {"mode": str(rng.choice(["fixed", "optimal"]))},
        "execution": {"policy": str(rng.choice(["adg", "adg_timed"]))},
        "planner": {"name": "lacam"},
        "seed": int(rng.integers(1000)),
    }


def about(setup: SetUp) -> dict[str, Any]:
    """Features of a question."""
    chosen, graph = setup.scenario, setup.problem.graph
    return {
        "map": Path(chosen.map.file).name.split(".")[0],
        "kind": chosen.discretisation.kind,
        "lanes": chosen.discretisation.lanes,
        "cell_m": chosen.discretisation.cell_m,
        "type": chosen.robots.type,
        "robots": setup.problem.num_robots,
        "vertices": graph.num_vertices,
        "policy": setup.settings.policy,
        "one_way": round(float((graph.reverse < 0).mean()), 3) if graph.num_lanes else 0.0,
    }


def answer(setup: SetUp, name: str, options: argparse.Namespace) -> dict[str, Any]:
    """The answer of a planner."""
    said: dict[Any, Any] = {("planner", "name"): ("--planner", name), ("planner", "time_limit_s"): ("--time-limit", options.time_limit)}
    problem = replace(setup.problem, graph=replace(setup.problem.graph))  # else tables of distances are a gift of who is asked before
    solution = solve(planned_as(replace(setup, problem=problem), changed(setup.file, said)))
    result = solution.result
    valid = solution.is_valid and result.plan is not None
    return {
        "planner": name,
        "status": str(result.status),
        "valid": valid,
        "cost_s": float(result.plan.end_s.sum()) if valid and result.plan else None,
        "cpu_s": result.planning_cpu_s,
        "bound_s": result.stats.get("lower_bound_s"),  # of planners in seconds
        "chosen": result.chosen,
        "message": result.message,
    }


def table(half: str, questions: list[dict[str, dict[str, Any]]]) -> str:
    """Answers of each planner, and beside the best of the others their cost and time."""
    solvable = [q for q in questions if any(row["valid"] for name, row in q.items() if name != "auto")]
    lines = [f"{half}: {len(questions)} questions, {len(solvable)} with an answer of a single planner"]
    lines += ["| planner | answers | within 2 % | cost, mean | p95 | time, median | p95 | over twice | all three |", "|" + "---|" * 9]
    for name in (*SINGLE, "auto"):
        mine = [q for q in solvable if name in q]
        valid = [q for q in mine if q[name]["valid"]]
        if not valid:
            continue
        dearer, slower = np.array([beside(q, name) for q in valid]).T
        good = ((dearer <= DEARER) & (slower <= 2)).sum() / len(mine)
        lines.append(
            f"| {name} | {len(valid)} of {len(mine)} | {np.mean(dearer <= DEARER):.1%} | {dearer.mean():.4f} "
            f"| {np.quantile(dearer, 0.95):.3f} | {np.median(slower):.2f} | {np.quantile(slower, 0.95):.2f} "
            f"| {np.mean(slower > 2):.1%} | {good:.1%} |"
        )
    return "\n".join(lines)


def beside(question: dict[str, dict[str, Any]], name: str) -> tuple[float, float]:
    """An answer's cost over the cheapest answer's, and its time over the best time."""
    others = [row for other, row in question.items() if other != "auto" and row["valid"]]
    cheapest_s = min(row["cost_s"] for row in others)
    best_s = min((row["cpu_s"] for row in others if row["cost_s"] <= DEARER * cheapest_s + 1e-9), default=math.nan)
    mine = question[name]
    cost = mine["cost_s"] / cheapest_s if cheapest_s > 0 else 1.0
    return cost, max(mine["cpu_s"], 1e-3) / max(best_s, 1e-3)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Maps, questions and planners."""
    parser.add_argument("--maps", type=Path, action="append", default=[], help="a folder of *.building.yaml, beside the bundled maps")
    parser.add_argument("--questions", type=int, default=500)
    parser.add_argument("--first", type=int, default=0, help="question, to go on")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--planner", action="append", metavar="NAME", help="default: all")
    parser.add_argument("--time-limit", type=float, default=2.0, metavar="S", help="of each answer (default: 2)")
    parser.add_argument("--out", type=Path, help="a file for lines of JSON, which are added to it")
    parser.add_argument("--report", action="store_true", help="the tables of what is in OUT")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each question and planner; with --report those of a file."""
    if options.report:
        yield from map(json.loads, options.out.read_text().splitlines())
        return
    files = sorted([*bundled_maps().values(), *Path("networks").glob("*/*.map")])
    files += sorted(file for folder in options.maps for file in folder.rglob("*.building.yaml"))
    for number in range(options.first, options.questions):
        with MapCache() as maps:
            question = drawn(files, options, number, maps)
            for name in options.planner or (*SINGLE, "auto"):
                row = {"question": number, **about(question), **answer(question, name, options)}
                if options.out:
                    with options.out.open("a") as out:
                        print(json.dumps(row), file=out)
                yield row


def summary(rows: list[bench.Row], options: argparse.Namespace) -> str:
    """Tables of both halves."""
    questions: dict[int, dict[str, dict[str, Any]]] = {}
    for row in rows:
        questions.setdefault(row["question"], {})[row["planner"]] = row
    return "\n\n".join(table(half, [q for number, q in questions.items() if number % 2 == k]) for k, half in enumerate(HALVES))


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
