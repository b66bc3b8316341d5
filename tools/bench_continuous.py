"""Measures planning in continuous time: CPU time, and what plans cost beside the bound without others.

    python tools/bench_continuous.py                           9 robots on the warehouse's roadmap, 50 seeds; 50 to 1,000 in the
                                                               layout of warehouse-10-20-10-2-1, with starts and goals drawn
    python tools/bench_continuous.py --map M.map --scen S.scen the same on a map and a scenario of the MovingAI benchmark
    python tools/bench_continuous.py --planner pbs --robots 9  another planner, other numbers of robots
    python tools/bench_continuous.py --drive --robots 100      drive the plans with both engines too
    python tools/bench_continuous.py --json                    a line a case, for machines

Robots in the second case are 0.6 m square, drive at 2 m/s, accelerate and brake at 0.5 m/s2 and turn by a right angle in 1 s, on cells of
1 m. They are kept 0.966 m apart, as squares of 0.8 m have to be one of which turns; circles around two such squares do not fit cells of
1 m. Kernels are loaded before the first case. Plans are retimed, as all plans are before they are driven; this is in `cpu_s`. `in_seconds`
counts plans that were not in steps. `cost` is the sum of the times at which robots come to stand at their goals, and its bound that of the
shortest ways without others. Driven plans are `off_by_s` from their times at most.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import bench
import numpy as np
from bench_execution import draw, warehouse

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.plan import Plan, as_planned_in_steps
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ENGINES, ExecutionSettings
from mrp_sumo.drive.warm import prepare_retime
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.maps.catalogue import bundled_maps
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.roadmap import cut_lanes
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.draw import uniform_draw
from planners.safe_interval.timetable import Timetable

SETTINGS = ExecutionSettings(policy="adg_timed")
BURGER = RobotType("turtlebot3", 0.138, 0.178, 0.22, 2.5, 2.5, 2.84)
SMART = RobotType("smart", 0.6, 0.6, 2.0, 0.5, 0.5, np.pi / 2, gap_m=0.966 - 0.6 * 2**0.5)
WANTED_S = {9: 0.03, 50: 1.0, 100: 3.0, 300: 5.0, 1000: 20.0}
STEP_S = 3.0  # of plans in steps: a start, a lane, a stop and a turn at most


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
    return Problem(graph, fleet_of(SMART, num_robots), start, goal, np.arange(num_robots), STEP_S, drivable=True)


def measured(case: str, problems: Iterator[Problem], options: argparse.Namespace) -> dict[str, Any]:
    """One row of the table."""
    chosen = planner(options.planner, {})
    chosen.prepare()
    prepare_retime()
    cpu_s, ratio, makespan_s, driven, singly = [], [], [], {}, 0
    for problem in problems:
        begun = time.process_time()
        plan = chosen.plan(problem, options.time_limit).plan
        in_steps = plan is not None and as_planned_in_steps(plan, problem.step_s) is not None
        if plan is not None:
            plan = retime(problem, plan, SETTINGS)
        cpu_s.append(time.process_time() - begun)
        if plan is not None:
            singly += not in_steps
            ratio.append(float(plan.end_s.sum()) / bound_s(problem))
            makespan_s.append(float(plan.end_s.max(initial=0.0)))
            if options.drive:
                driven = driven_by_both(problem, plan)
    return {
        "case": case,
        "planner": options.planner,
        "robots": problem.num_robots,
        "solved": f"{len(ratio)} of {len(cpu_s)}",
        "in_seconds": singly,
        "cpu_s": round(float(np.median(cpu_s)), 3),
        "wanted_s": WANTED_S.get(problem.num_robots),
        "cost_by_bound": round(float(np.mean(ratio)), 3) if ratio else None,
        "makespan_s": round(float(np.median(makespan_s)), 1) if makespan_s else None,
        **driven,
    }


def bound_s(problem: Problem) -> float:
    """The sum of the least times of all robots without others."""
    timetable = Timetable(problem, SETTINGS.step_length_s)
    for robot in range(problem.num_robots):
        timetable.look_back(robot)
    return max(float(timetable.alone.sum()) * SETTINGS.step_length_s, 1e-9)


def driven_by_both(problem: Problem, plan: Plan) -> dict[str, float]:
    """The driven makespan in each engine, and how far visits are from their times at most."""
    row = {}
    with tempfile.TemporaryDirectory() as folder:
        network = build_network(problem.graph, Path(folder) / "bench.net.xml")
        for engine in ENGINES:
            settings = replace(SETTINGS, engine=engine, time_limit_s=float(plan.end_s.max(initial=0.0)) + 60.0)
            run = simulate(problem, plan, settings, network)
            row[f"{engine}_s"] = round(float(run.goal_s.max(initial=0.0)), 2)
            row[f"{engine}_off_by_s"] = round(float(np.abs(run.arrived_s - plan.arrive_s).max(initial=0.0)), 3)
    return row


def arguments(parser: argparse.ArgumentParser) -> None:
    """Planner, fleets, map."""
    parser.add_argument("--planner", default="continuous")
    parser.add_argument("--robots", type=int, nargs="*", default=[9, 50, 100, 300, 1000])
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--time-limit", type=float, default=120.0)
    parser.add_argument("--drive", action="store_true")
    parser.add_argument("--map", type=Path)
    parser.add_argument("--scen", type=Path)


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each number of robots."""
    if (options.map is None) != (options.scen is None):
        raise ValueError("--map and --scen go together")
    for num_robots in options.robots:
        if num_robots <= 20:
            yield measured("warehouse roadmap", roadmap_problems(num_robots, options.seeds), options)
        else:
            yield measured("warehouse grid", iter([grid_problem(num_robots, options)]), options)


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
