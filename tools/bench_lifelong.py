"""Measures step-wise planners on lifelong problems beside published figures, or dispatchers on MAPD.

    tools/bench_lifelong.py DATA [--only TEXT] [--planner NAME ...] [--steps N] [--seed N] [--set KEY=VALUE ...]
    tools/bench_lifelong.py --mapd [--robots N ...] [--dispatcher NAME ...] [--seeds N] [--frequency F]
    tools/bench_lifelong.py --kiva [--driven] [--type NAME ...] [--engine NAME ...] [--robots N ...] [--planner NAME ...] [--steps N]
    tools/bench_lifelong.py DATA --sopp [--robots N ...] [--planner NAME ...] [--steps N]
    tools/bench_lifelong.py --speed [--robots N ...] [--engine NAME ...] [--seconds S] [--planner NAME ...]

DATA is a folder with `epibt_random` (a map of 819 free cells, robots in agents_0.csv to agents_7.csv, goals in tasks_one.csv: robot r
of R has the goals r, r + R, ...; 1,000 steps) and `lorr2024/example_problems` (three problems of the League of Robot Runners of 2024).
`done` counts goals or tasks; `published` is EPIBT's count (without guidance) or the best of the League; with other --steps it is not
printed. `cpu_ms` is the planner's CPU time a step on one core, kernels loaded; `max_ms` the slowest step's. Every solution is judged.

With `--mapd` the bundled scenario `mapd_lifelong` is run: 500 tasks, F a step (default: 1), robots at N of the 50 places without tasks,
drawn by the seed, every dispatcher with the same tasks. `makespan` is when the last task is done, `lead_time` the mean time from a task's
release to its end, `p95` and `max` of the same (steps, which are seconds there); `empty` the mean way to a pick-up; `cpu_s` of the whole
run, the planner's and the checks' included.

With `--kiva` N robots (default: 60, 100, 140) go from goal to goal on the map of `kiva_lifelong`, drawn evenly from all endpoints, and are
planned every 5 steps for the next 20: `goals` a step over 1,000 steps, beside those of RHCR's paper (PBS, the same window and period), in
the model of that paper: a cell a step, all robots in step. `pbs` knows the goals after the next one, as RHCR does; others plan to each
robot's next one. `cpu_s` is the planner's and the checks'.

With `--kiva --driven` robots drive: `unit` ones of 0.4 m on cells of 1 m, at 1 m/s and turning in no time, or a type that `--type` names,
on cells that it fits in. They are planned as often, by the steps of their plans (`step_s` each), and `goals` is per such step, too.
`moving`, `turning` and `waiting` are shares of the robots' time, `detour` is what they drove over the shortest ways, and `cpu_s` that of
the whole run.

With `--sopp` DATA has a MovingAI map and pick-and-drops `*_tasks.m`, as FE-LAK/SOPP_SupplementaryData has them (a row each: from, to,
release, service at both, ...; cells are counted from 1, from the uppermost row on). N robots (default: 1,000) begin in the cells nearest to
the first one, from which all of theirs come; free ones and the tasks that are left are matched for the least ways, and those without
one go home. A cell a step, all robots in step, planned every step for the next 4; a stop takes its service after the arrival, and those who
are there stay until then: the others are planned without them, as in driven runs.
`makespan` is when the last task is done, within N steps (default: 4,000).

With `--speed` N TurtleBot3 (default: 100 and 1,000) drive for S seconds (default: 600) among shelves on a generated floor, and orders come
at a rate that keeps most of them busy: `times_real` is simulated time over wall time of the loop, planning included; `planning` the
share of it that the planner took; `peak_mb` the memory of the whole process, so that only the first row of a call says that of one run.
"""

import argparse
import csv
import json
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from tempfile import TemporaryDirectory
from typing import Any

import bench
import numpy as np
from scipy.optimize import linear_sum_assignment

import mrp_sumo as ms
from mrp_sumo.cli.scenario_choice import pairs
from mrp_sumo.core.execution import BOOKINGS
from mrp_sumo.core.plan import paths_of_plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.request import Request, one_shot
from mrp_sumo.core.step_wise import StepWiseProblem
from mrp_sumo.formats.lorr import read_map, read_problem
from mrp_sumo.maps.catalogue import bundled_folder
from mrp_sumo.planning.protocol import Planner
from mrp_sumo.planning.step_wise import run_step_wise
from mrp_sumo.plugins.registry import make
from mrp_sumo.search.distance import UNREACHABLE, Distances, distances, steps_to_targets
from mrp_sumo.traffic.referee import judge
from mrp_sumo.traffic.step_wise_referee import judge_step_wise

EPIBT = {100: 2788, 200: 3823, 300: 3655, 400: 3349, 500: 3379, 600: 2632, 700: 2416, 800: 1658}  # robots -> goals in 1,000 steps
EVERY, WINDOW = 5, 20  # steps
AHEAD = 4  # steps of pick-and-drops that are planned, of which one is made
RHCR = {60: 2.33, 100: 3.56, 140: 4.55}  # robots -> goals a step
LEAGUE = {  # problem -> steps, tasks of the best entry
    "random.domain/random_32_32_20_100": (500, 1186),
    "city.domain/paris_1_256_250": (500, 456),
    "warehouse.domain/sortation_large_2000": (2000, 15508),
}
DISPATCHERS = ("nearest", "token_passing", "tpts", "regret", "central", "hungarian", "min_cost_flow")
CELL_M = {"unit": 1.0, "turtlebot3": 0.4, "amr_600": 1.2}


def _mapd(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each fleet, seed and dispatcher."""
    base = ms.Scenario.read("mapd_lifelong")
    lines = (bundled_folder("networks") / "mapd" / "mapd.map.pd").read_text().split()[::-1]  # from the lowest row
    letters = [letter for line in lines for letter in line if letter in "se."]  # those of free cells, which are numbered so
    home = [f"v{v}" for v, letter in enumerate(letters) if letter == "e"]
    task = {**base.values["tasks"]["streams"][0], "arrivals": {"per_step": options.frequency}}
    for robots in options.robots or range(10, 51, 10):
        for seed in range(options.seeds):
            starts = [home[k] for k in np.random.default_rng([seed, robots]).choice(len(home), robots, replace=False)]
            fleet = base.replace(robots={"starts": starts}, seed=seed, tasks={"streams": [task]}, record={"bag": False})
            for name in options.dispatcher or DISPATCHERS:
                before = _cpu_s()
                run = ms.run(fleet.replace(execution={"dispatcher": name}))
                yield {"robots": robots, "dispatcher": name, "seed": seed, **_of_tasks(run), "cpu_s": _cpu_s() - before}


def _of_tasks(run: ms.Run) -> bench.Row:
    """Lead times of a run's tasks."""
    tasks, metrics = run.kept.execution.tasks, run.metrics
    took_s = tasks.lead_time_s
    row = {"makespan": float(tasks.done_s.max()), "lead_time": float(took_s.mean()), "p95": float(np.quantile(took_s, 0.95))}
    return row | {"max": float(took_s.max()), "empty": metrics["cycle_empty_travel_s"], "calls": metrics["planner_calls"]}


def _kiva(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each fleet, seed and planner, and for each type and engine where robots drive."""
    base = ms.Scenario.read("kiva_lifelong")
    rows = (bundled_folder("networks") / "kiva" / "kiva.map").read_text().splitlines()[4:][::-1]  # from the lowest row
    free = [(y, x) for y, row in enumerate(rows) for x, letter in enumerate(row) if letter != "@"]
    home = [v for v, (y, x) in enumerate(free) if y % 4 and (x in (1, 2, 4, 5) or x in (len(rows[0]) - k for k in (2, 3, 5, 6)))]
    endpoint = [int(v[1:]) for v in base.values["tasks"]["groups"]["endpoint"]]
    steps = options.steps or 1000
    for robots in options.robots or RHCR:
        for seed in range(options.seeds):
            rng = np.random.default_rng([seed, robots])
            start = rng.choice(home, robots, replace=False)
            drawn = [rng.choice(endpoint, steps // 8).tolist() for _ in range(robots)]  # more than anybody comes to
            goals = [[v for v, before in zip(ahead, [None, *ahead]) if v != before] for ahead in drawn]
            fleet = base.replace(
                robots={"starts": [f"v{v}" for v in start]},
                seed=seed,
                tasks=[{"stops": [f"v{v}" for v in ahead]} for ahead in goals],
                record={"bag": False},
            )
            for name in options.planner or ["pbs"]:
                if options.driven:
                    for kind in options.type or ["unit"]:
                        for engine in options.engine or ["kinematic"]:
                            yield _driven(fleet.replace(planner=name), kind, engine, steps)
                    continue
                problem, planner = ms.problem(_of_type(fleet, "unit").replace(planner=name)), make("planners", name, {})
                planner.prepare()
                before = _cpu_s()
                counts = _in_windows(replace(problem, step_s=1.0), planner, [list(ahead) for ahead in goals], steps)
                row = {"robots": robots, "planner": name, "seed": seed, "steps": steps, "goals": counts[0] / steps}
                row |= {"rhcr": RHCR.get(robots), "calls": counts[1], "calls_failed": counts[2], "cpu_s": _cpu_s() - before}
                yield row


def _of_type(fleet: ms.Scenario, kind: str) -> ms.Scenario:
    """The fleet with robots of a type, on cells of a size that suits it."""
    unit = ms.Scenario.read("mapd_lifelong").values["robots"]["type"]
    return fleet.replace(robots={"type": unit if kind == "unit" else kind}, discretisation={"cell_m": CELL_M[kind]})


def _driven(fleet: ms.Scenario, kind: str, engine: str, steps: int) -> bench.Row:
    """Have robots drive from goal to goal for so many steps of their plans."""
    fleet = _of_type(fleet, kind)
    problem = ms.problem(fleet)
    step_s, known = problem.step_s, distances(problem.graph)
    planning = {"budget_s": 0, "period_s": EVERY * step_s, "window_s": WINDOW * step_s}
    before = _cpu_s()
    run = ms.run(fleet.replace(execution={"engine": engine, "time_limit_s": steps * step_s, "planning": planning}))
    stops, booked = run.kept.execution.stops, run.kept.execution.booked_s
    share = dict(zip(BOOKINGS, (booked.sum(0) / booked.sum()).tolist()))
    same = np.diff(stops.task, prepend=-1) == 0
    before_it = np.where(same, np.roll(stops.vertex, 1), problem.start[stops.robot])
    least = sum(int(known.to(v)[a]) for a, v in zip(before_it.tolist(), stops.vertex.tolist()))
    cells = run.metrics["distance_m"] / CELL_M[kind]
    row = {"robots": problem.num_robots, "type": kind, "engine": engine, "planner": fleet.values["planner"]["name"], "seed": fleet.seed}
    row |= {"steps": steps, "step_s": step_s, "goals": len(stops.task) / steps, "per_h": 3600 * len(stops.task) / (steps * step_s)}
    row |= {"moving": share["moving"], "turning": share["turning"], "waiting": 1 - share["moving"] - share["turning"]}
    row |= {"detour": cells / least - 1, "calls": run.metrics["planner_calls"]}
    return row | {"calls_failed": run.metrics["planner_calls_failed"], "cpu_s": _cpu_s() - before}


def _in_windows(problem: Problem, planner: Planner, goals: list[list[int]], steps: int) -> tuple[int, int, int]:
    """Goals reached in so many steps, calls of the planner, and calls that failed: robots stand still then until the next."""
    at, known, reached, failed = problem.start.copy(), distances(problem.graph), 0, 0
    several = "stops" in getattr(planner, "supports", ())
    for begin in range(0, steps, EVERY):
        ahead = [_ahead(int(v), of_robot, known) if several else of_robot[:1] for v, of_robot in zip(at, goals)]
        window_problem = replace(problem, start=at.copy(), goal=np.array([stops[-1] for stops in ahead]), goal_of=np.arange(len(at)))
        window_problem = replace(
            window_problem, via=tuple(tuple(stops[:-1]) for stops in ahead), window_steps=WINDOW, seed=problem.seed + begin
        )
        plan = planner.plan(window_problem, 60.0).plan
        if plan is None:
            failed += 1
            continue
        ends = plan.vertex[plan.first[1:] - 1]
        if not judge(replace(window_problem, goal=ends), plan).valid:
            raise ValueError(f"the plan from step {begin} on has conflicts")
        for r, path in enumerate(paths_of_plan(plan, 1.0)):
            for v in path[1 : EVERY + 1].tolist():
                while v == goals[r][0]:
                    reached += 1
                    del goals[r][0]
            at[r] = path[min(EVERY, len(path) - 1)]
    return reached, steps // EVERY, failed


def _sopp(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each fleet and planner."""
    (map_path,), (path,) = options.data.glob("*.map"), options.data.glob("*tasks*.m")
    rows = map_path.read_text().splitlines()[4:]
    cell = [(y, x) for y, row in enumerate(rows) for x, letter in enumerate(row) if letter == "."]
    vertex = {c: v for v, c in enumerate(sorted(cell, key=lambda c: (-c[0], c[1])))}  # counted from the lower left
    numbers = [[int(word) for word in re.findall(r"\d+", line)] for line in path.read_text().splitlines() if re.match(r"\s*\d+,", line)]
    if [row[0] for row in numbers] == list(range(1, len(numbers) + 1)):  # some files count their tasks there
        numbers = [row[1:] for row in numbers]
    stops = np.array([[vertex[cell[n - 1]] for n in row[:2]] for row in numbers])
    unit = ms.Scenario.read("mapd_lifelong").values["robots"]["type"]
    grid = {"kind": "grid", "cell_m": 1.0, "clearance": "ignore"}
    corner = f"v{vertex[cell[0]]}"
    known = distances(ms.problem(ms.Scenario(map_path, {"type": unit, "starts": [corner], "goals": [corner]}, discretisation=grid)).graph)
    for robots in options.robots or (1000,):
        names = [f"v{v}" for v in np.argsort(known.to(vertex[cell[0]]), kind="stable")[:robots].tolist()]
        problem = ms.problem(ms.Scenario(map_path, {"type": unit, "starts": names, "goals": names}, discretisation=grid))
        for name in options.planner or ["pibt"]:
            planner = make("planners", name, {})
            planner.prepare()
            before = _cpu_s()
            row = _matched(replace(problem, step_s=1.0), planner, stops, numbers[0][3], options.steps or 4000)
            yield {"robots": robots, "planner": name, **row, "cpu_s": _cpu_s() - before}


def _matched(problem: Problem, planner: Planner, stops: np.ndarray, service: int, steps: int) -> bench.Row:
    """Have free robots matched to the tasks [K, 2] that are left, until all are done."""
    known, at, num = distances(problem.graph), problem.start.copy(), problem.num_robots
    to_pick = np.stack([known.to(v) for v in stops[:, 0].tolist()])
    left, task, made = np.arange(len(stops)), np.full(num, -1), np.zeros((2, num), np.int64)  # stops made; steps at the next one
    since, step, moves, done, failed = np.full(num, np.inf), 0, 0, 0, 0
    while done < len(stops) and step < steps:
        free = np.flatnonzero(task < 0)
        robots, tasks = linear_sum_assignment(to_pick[np.ix_(left, at[free])].T)
        task[free[robots]], since[free[robots]] = left[tasks], step
        left = np.delete(left, tasks)
        goal = np.where(task < 0, problem.start, stops[task, made[0]])
        window_problem = _beside(problem, at, goal, (task >= 0) & (at == goal), since)
        window_problem = replace(window_problem, window_steps=AHEAD, seed=problem.seed + step)
        plan = planner.plan(window_problem, 60.0).plan
        failed += plan is None
        if plan is not None and not judge(replace(window_problem, goal=plan.vertex[plan.first[1:] - 1]), plan).valid:
            raise ValueError(f"the plan from step {step} on has conflicts")
        step += 1
        before = at.copy()
        if plan is not None:
            at[np.isin(at, window_problem.start)] = [path[min(1, len(path) - 1)] for path in paths_of_plan(plan, 1.0)]
        moves += int((before != at).sum())
        made[1] = np.where((task >= 0) & (at == goal), made[1] + 1, 0)
        over = made[1] > service
        ends = over & (made[0] == 1)
        made[0, over], made[1, over], since[over] = 1 - made[0, over], 0, step
        task[ends], since[ends] = -1, np.inf
        done += int(ends.sum())
    return {"done": done, "makespan": step if done == len(stops) else None, "moves": moves, "calls_failed": failed}


def _beside(problem: Problem, at: np.ndarray, goal: np.ndarray, stays: np.ndarray, since: np.ndarray) -> Problem:
    """The problem of those robots that do not stay, which cannot come where the others stand; who is cut off from its goal waits."""
    moving = np.flatnonzero(~stays)
    closed = np.isin(problem.graph.head, at[stays])
    ends, arange = goal[moving], np.arange(len(moving) + 1)
    request = Request(0.0, problem, moving, at[moving], arange, ends, closed, since_s=since[moving])
    table = steps_to_targets(one_shot(request))
    cut_off = table[arange[:-1], request.start] >= UNREACHABLE
    return one_shot(replace(request, stop=np.where(cut_off, request.start, ends)))


def _ahead(at: int, goals: list[int], known: Distances) -> list[int]:
    """A robot's next goals, until they are further than a window."""
    far = np.cumsum([known.to(goal)[before] for before, goal in zip([at, *goals], goals[:WINDOW])])
    return goals[: int(np.searchsorted(far, WINDOW)) + 1]


def _speed(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each fleet, engine and planner."""
    for robots in options.robots or (100, 1000):
        with TemporaryDirectory() as folder:
            path = _floor(Path(folder), robots)
            for engine in options.engine or ("kinematic", "sumo"):
                for name in options.planner or ["lacam"]:
                    scenario = ms.Scenario.read(path).replace(
                        planner=name, execution={"engine": engine, "time_limit_s": options.seconds}, seed=options.seed
                    )
                    run = ms.run(scenario)
                    metrics = run.metrics
                    row = {"robots": robots, "engine": engine, "planner": name, "simulated_s": metrics["sim_time_s"]}
                    row |= {"wall_s": metrics["wall_time_s"], "cpu_s": metrics["cpu_time_s"], "times_real": metrics["real_time_factor"]}
                    row |= {"planning": metrics["planning_time_s"] / metrics["wall_time_s"], "done": metrics["tasks_done"]}
                    row |= {"open": metrics["tasks_open"], "peak_mb": round(getrusage(RUSAGE_SELF).ru_maxrss / 1000)}
                    yield row


def _floor(folder: Path, robots: int) -> Path:
    """A scenario on a floor of shelves, ten cells long in aisles two cells wide, with about ten free cells for each robot."""
    side = int(np.ceil(np.sqrt(14 * robots) / 12)) * 12
    shelf = [[y % 3 == 1 and x % 12 > 1 and 1 < y < side - 2 for x in range(side + 2)] for y in range(side + 1)]
    rows = ["".join("@" if there else "." for there in row) for row in shelf]
    (folder / "floor.map").write_text(f"type octile\nheight {len(rows)}\nwidth {len(rows[0])}\nmap\n" + "\n".join(rows) + "\n")
    num_free = sum(row.count(".") for row in rows)
    cells = [f"v{v}" for v in np.random.default_rng(0).choice(num_free, min(200, num_free // 4), replace=False).tolist()]
    document = {
        "map": "floor.map",
        "discretisation": {"kind": "grid", "cell_m": 0.4},
        "robots": {"count": robots, "draw": "anywhere"},
        "planner": "lacam",
        "tasks": {
            "groups": {"cell": cells},
            "streams": [{"arrivals": {"rate_per_h": 3600 * robots / (8 * side)}, "stops": ["cell", "cell"], "service": [5]}],
        },
        "execution": {"planning": {"period_s": 5}},
    }
    (folder / "speed.yaml").write_text(json.dumps(document))
    return folder / "speed.yaml"


def _cpu_s() -> float:
    used = getrusage(RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _own_goals(folder: Path, robots: int, name: str) -> StepWiseProblem:
    free = read_map(folder / "map.txt")
    with (folder / f"agents_{robots // 100 - 1}.csv").open() as file:
        start = np.array([int(row["row"]) * free.shape[1] + int(row["col"]) for row in csv.DictReader(file)])
    goals = np.array([int(word) for word in (folder / "tasks_one.csv").read_text().split()[1:]])
    return StepWiseProblem(name, free, start, np.arange(len(goals) + 1), goals, len(goals))


def arguments(parser: argparse.ArgumentParser) -> None:
    """Data, and what is compared."""
    parser.add_argument("data", type=Path, nargs="?")
    parser.add_argument("--mapd", action="store_true", help="compare dispatchers")
    parser.add_argument("--kiva", action="store_true", help="compare planners in windows")
    parser.add_argument("--driven", action="store_true", help="with --kiva: in seconds, not in steps")
    parser.add_argument("--type", action="append", choices=tuple(CELL_M), help="with --driven; may be repeated (default: unit)")
    parser.add_argument("--sopp", action="store_true", help="pick-and-drops of DATA")
    parser.add_argument("--speed", action="store_true", help="measure the speed of runs")
    parser.add_argument("--engine", action="append", choices=("kinematic", "sumo"), help="may be repeated (default: both)")
    parser.add_argument("--seconds", type=float, default=600.0, metavar="S")
    parser.add_argument("--robots", type=int, action="append", metavar="N", help="may be repeated (default of --mapd: 10, 20, 30, 40, 50)")
    parser.add_argument("--dispatcher", action="append", metavar="NAME", help="may be repeated (default: all)")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="0 to N - 1")
    parser.add_argument("--frequency", type=float, default=1.0, metavar="F", help="tasks a step")
    parser.add_argument("--only", default="", metavar="TEXT", help="problems whose name has it")
    parser.add_argument("--planner", action="append", metavar="NAME", help="may be repeated (default: epibt)")
    parser.add_argument("--steps", type=int, metavar="N", help="instead of those that are published")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a parameter of the planner")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """Rows of the problems in DATA, or of what an option names."""
    made = _mapd if options.mapd else _kiva if options.kiva else _sopp if options.sopp else _speed if options.speed else _published
    for row in made(options):
        yield {key: round(value, 3) if isinstance(value, float) else value for key, value in row.items()}


def _published(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each problem and planner; those that are not valid have failed."""
    if options.data is None:
        raise ValueError("DATA, --mapd, --kiva or --speed is needed")
    for robots, published in EPIBT.items():
        name = f"random_819_{robots}"
        if options.only in name:
            problem = _own_goals(options.data / "epibt_random", robots, name)
            for planner in options.planner or ["epibt"]:
                yield _measured(options, problem, planner, 1000, published, {"tasks": "in_turn"})
    for path, (steps, tasks) in LEAGUE.items():
        if options.only in path:
            problem = read_problem(options.data / "lorr2024" / "example_problems" / f"{path}.json")
            for planner in options.planner or ["epibt"]:
                yield _measured(options, problem, planner, steps, tasks, {})


def _measured(
    options: argparse.Namespace, problem: StepWiseProblem, name: str, steps: int, tasks: int, parameters: dict[str, Any]
) -> bench.Row:
    planner = make("step_planners", name, parameters | dict(pairs(options)))
    planner.prepare()
    run = run_step_wise(problem, planner, options.steps or steps, options.seed)
    verdict = judge_step_wise(problem, run.solution)
    published = None if options.steps and options.steps != steps else tasks
    return {
        "problem": problem.name,
        "robots": problem.num_robots,
        "planner": name,
        "steps": run.solution.num_steps,
        "done": verdict.tasks_done,
        "published": published,
        "ratio": verdict.tasks_done / published if published else None,
        "cpu_ms": 1000 * run.planning_cpu_s / run.solution.num_steps,
        "max_ms": 1000 * max(run.plan_time_s),
        "valid": verdict.valid,
        "failed": not verdict.valid,
    }


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
