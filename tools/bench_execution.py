"""Measures execution: robot-seconds simulated a second of CPU time, recording on, one process.

    python tools/bench_execution.py                        50 to 1,000 robots in a warehouse of 161 x 63 cells
    python tools/bench_execution.py --grid                 5,000 and 10,000 robots on a grid of 200 x 200 cells; the goals
                                                           of 10,000 are within blocks of 20 x 20, and they drive to the end
    python tools/bench_execution.py --startup              from a plan to the first step, for every bundled map
    python tools/bench_execution.py --schedule             the order of 1,000 robots' passages
    python tools/bench_execution.py --retime               the times of real motion for plans of 100 to 10,000 robots, and
                                                           how far from them SUMO and the kinematic engine drive 100 and 300
    python tools/bench_execution.py --memory               200 runs in one process
    python tools/bench_execution.py --robots 300 --dt 0.2 --seconds 60
    python tools/bench_execution.py --against DIR          here and in another checkout, in turn: medians and ratios

The warehouse has the layout of the MovingAI benchmark's warehouse-10-20-10-2-1: 10 x 20 racks of 10 x 2 cells,
aisles one cell wide. `robot_s_per_cpu_s` is of the loop with recording, `with_all` also counts the schedule, the
start of SUMO, the trajectory, the audit and the metrics; planning and netconvert are left out. Kernels are loaded before the first
case.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import bench
import numpy as np

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import PlanGraph
from mrp_sumo.core.plan import Plan, PlanResult
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive import warm
from mrp_sumo.drive.listeners import ProgressReport
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.motion_plan import lanes_along
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.maps.catalogue import bundled_maps
from mrp_sumo.maps.grid import grid_graph, paper_grid
from mrp_sumo.maps.load import load_map
from mrp_sumo.metrics.audit import audit
from mrp_sumo.metrics.evaluate import evaluate
from mrp_sumo.metrics.metric import Evidence
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.referee import judge
from mrp_sumo.traffic.resources import needs_of, resources_of
from mrp_sumo.traffic.schedule import schedule_of

ROBOTS = {
    "burger": (RobotType("turtlebot3", 0.138, 0.178, 0.22, 2.5, 2.5, 2.84), 0.4, 2.5),  # cell, planned step
    "amr": (RobotType("amr", 0.6, 0.5, 1.0, 0.5, 0.5, 1.5), 1.0, 3.0),
}
WAREHOUSE = (50, 100, 200, 500, 1000)
GRID = ((5000, 0.2, 120.0, None), (10000, 0.5, np.inf, 20))  # robots, step length, simulated seconds at most, goals within
RUNS = 200

Row = bench.Row


def warehouse() -> np.ndarray:
    """[63, 161] free cells."""
    free = np.zeros((63, 161), np.bool_)
    free[1:-1, 1:-1] = True
    for x in range(26, 26 + 11 * 10, 11):
        for y in range(2, 62, 3):
            free[y : y + 2, x : x + 10] = False
    return free


def draw(graph: PlanGraph, num_robots: int, seed: int, within: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Starts, and goals anywhere or in the start's block of `within` x `within` cells."""
    rng = np.random.default_rng([seed, num_robots])
    start, goal = rng.permutation(graph.num_vertices)[:num_robots], rng.permutation(graph.num_vertices)[:num_robots]
    if within is not None:
        block = np.floor(graph.xy / (within * graph.length_m.min()) + 1e-9).astype(int) @ (1, 10_000)
        for each in np.unique(block[start]):
            (here,) = np.nonzero(block[start] == each)
            goal[here] = rng.permutation(np.flatnonzero(block == each))[: len(here)]
    return start, goal


def planned(graph: PlanGraph, num_robots: int, within: int | None, options: argparse.Namespace) -> tuple[Problem, Plan, float]:
    """A problem, a plan whose order can be kept, and how long the planner took."""
    robot, _, step_s = ROBOTS[options.robot]
    start, goal = draw(graph, num_robots, options.seed, within)
    problem = Problem(graph, fleet_of(robot, num_robots), start, goal, np.arange(num_robots), step_s, drivable=True)
    method = planner(options.planner or ("pibt" if num_robots > 2000 else "lacam"), {})
    method.prepare()
    begun = time.perf_counter()
    plan = method.plan(problem, 120.0).plan
    if plan is None:
        raise MrpSumoError(f"no plan for {num_robots} robots")
    return problem, plan, time.perf_counter() - begun


def drive(
    case: str, graph: PlanGraph, network: Path, num_robots: int, dt: float, seconds: float, within: int | None, options: argparse.Namespace
) -> Row:
    """Plan, drive and measure one case."""
    problem, plan, planning_s = planned(graph, num_robots, within, options)
    limit_s = min(seconds, float(plan.end_s.max()) * 4 + 60)
    settings = ExecutionSettings(policy=options.policy, step_length_s=dt, time_limit_s=limit_s, record_period_s=max(dt, options.record))
    cpu = time.process_time()
    run = simulate(problem, plan, settings, network)
    driven = time.process_time()
    verdict = audit(run, problem.fleet)
    audited = time.process_time()
    evaluate(Evidence(problem, PlanResult("solved", plan), None, run, verdict, 0.0, 0.1, limit_s))
    done, robot_s = time.process_time(), problem.num_robots * run.sim_time_s
    return {
        "case": case,
        "robots": problem.num_robots,
        "policy": options.policy,
        "dt_s": dt,
        "planning_s": round(planning_s, 2),
        "makespan_s": float(plan.end_s.max()),
        "sim_s": run.sim_time_s,
        "outcome": str(run.outcome),
        "at_goal": int(np.isfinite(run.goal_s).sum()),
        "overlaps": verdict["num_overlaps"],
        "passed": verdict["passed"],
        "loop_cpu_s": round(run.cpu_time_s, 2),
        "around_cpu_s": round(driven - cpu - run.cpu_time_s, 2),
        "audit_cpu_s": round(audited - driven, 2),
        "metrics_cpu_s": round(done - audited, 2),
        "robot_s_per_cpu_s": round(robot_s / run.cpu_time_s),
        "with_all": round(robot_s / (done - cpu)),
        "us_per_robot_step": round(run.cpu_time_s / (robot_s / dt) * 1e6, 2),
        "real_time_factor": round(run.sim_time_s / run.cpu_time_s, 2),
        "peak_rss_mb": memory_mb("VmHWM"),
    }


def rows_of_drives(options: argparse.Namespace) -> Iterator[Row]:
    """The warehouse, or the grid."""
    free = np.ones((200, 200), np.bool_) if options.grid else warehouse()
    case = "grid" if options.grid else "warehouse"
    graph = grid_graph(free, ROBOTS[options.robot][1], (0.0, 0.0), name=case)
    cases = list(GRID) if options.grid else [(n, 0.1, 120.0, None) for n in WAREHOUSE]
    if options.robots:
        known = {case[0]: case for case in cases}
        cases = [known.get(n, (n, *cases[0][1:])) for n in options.robots]
    with tempfile.TemporaryDirectory() as folder:
        network = build_network(graph, Path(folder) / "bench.net.xml")
        drive(case, graph, network, 20, 0.1, 20.0, None, options)  # whatever the first case alone would pay for
        for num_robots, dt, seconds, within in cases:
            yield drive(case, graph, network, num_robots, options.dt or dt, options.seconds or seconds, within, options)


def rows_of_starts(options: argparse.Namespace) -> Iterator[Row]:
    """From a map file to the end of the first step of nine robots, in a process that has loaded its libraries."""
    robot = ROBOTS["burger"][0]
    for name, path in [*sorted(bundled_maps().items())] * 2:
        with tempfile.TemporaryDirectory() as folder:
            begun = spent_s()
            graph = paper_grid(load_map(path).nav, 0.4)
            loaded = spent_s()
            network = build_network(graph, Path(folder) / "bench.net.xml")
            built = spent_s()
            served = np.unique(graph.tail)
            served = served[graph.component[served] == np.bincount(graph.component[served]).argmax()]
            start, goal = np.random.default_rng(options.seed).permutation(served)[:18].reshape(2, 9)
            problem = Problem(graph, fleet_of(robot, 9), start, goal, np.arange(9), 2.5)
            plan = planner("lacam", {}).plan(problem, 10.0).plan
            assert plan is not None
            stepped: list[float] = []
            settings = ExecutionSettings(policy="open_loop", step_length_s=1.0, time_limit_s=2.0, record_period_s=1.0)
            planned_at = spent_s()
            each_second = ProgressReport(lambda t_s, at_goal, stepped=stepped: stepped.append(spent_s()))
            simulate(problem, plan, settings, network, listeners=[each_second])
            started_s = stepped[0] - planned_at
        yield {
            "case": "startup",
            "map": name,
            "vertices": graph.num_vertices,
            "map_cpu_s": round(loaded - begun, 3),
            "network_cpu_s": round(built - loaded, 3),
            "start_cpu_s": round(started_s, 3),
            "sum_cpu_s": round(built - begun + started_s, 3),
            "target": 1.0,
        }


def spent_s() -> float:
    """CPU time of this process and of programs it has run: netconvert."""
    return sum(os.times()[:4])


def rows_of_schedules(options: argparse.Namespace) -> Iterator[Row]:
    """The order at vertices and zones, proven acyclic."""
    graph = grid_graph(warehouse(), ROBOTS[options.robot][1], (0.0, 0.0), name="warehouse")
    for num_robots in options.robots or (1000,):
        problem, plan, _ = planned(graph, num_robots, None, options)
        for _ in range(2):  # the second without the loading of code
            begun = time.process_time()
            resources = resources_of(graph, problem.fleet.separation_m)
            needs = needs_of(graph, plan, lanes_along(problem.graph, plan)[0], resources, problem.fleet.kind)
            needed = time.process_time()
            schedule = schedule_of(problem, plan, needs)
            done = time.process_time()
        yield {
            "case": "schedule",
            "robots": problem.num_robots,
            "visits": plan.num_visits,
            "passages": schedule.num_passages,
            "needs_cpu_s": round(needed - begun, 2),
            "schedule_cpu_s": round(done - needed, 2),
            "target": 2.0,
            "valid": judge(problem, plan).valid,
        }


def rows_of_retiming(options: argparse.Namespace) -> Iterator[Row]:
    """Plans in steps, given the times of real motion; small ones driven by both engines, all the way."""
    cell_m = ROBOTS[options.robot][1]
    with tempfile.TemporaryDirectory() as folder:
        for num_robots in options.robots or (100, 300, 1000, 10_000):
            free, within = (np.ones((200, 200), np.bool_), 20) if num_robots > 2000 else (warehouse(), None)
            graph = grid_graph(free, cell_m, (0.0, 0.0), name="bench")
            problem, plan, _ = planned(graph, num_robots, within, options)
            spent, begun = [], time.process_time()
            for _ in range(2):  # the second with the resources of the graph at hand
                retimed = retime(problem, plan, ExecutionSettings(step_length_s=options.dt or 0.1))
                spent.append(round(time.process_time() - begun, 2))
                begun = time.process_time()
            row = {
                "case": "retime",
                "robots": num_robots,
                "in_steps_s": float(plan.end_s.max()),
                "retimed_s": round(float(retimed.end_s.max()), 1),
                "first_cpu_s": spent[0],
                "again_cpu_s": spent[1],
                "target": 1.0 if num_robots <= 1000 else 15.0,
            }
            for engine in ("sumo", "kinematic") if num_robots <= 300 else ():
                limit_s = float(retimed.end_s.max()) + 60.0
                settings = ExecutionSettings(engine=engine, time_limit_s=limit_s, step_length_s=options.dt or 0.1)
                network = build_network(graph, Path(folder) / "bench.net.xml")
                run = simulate(problem, retimed, settings, network)
                row[f"{engine}_off_by_s"] = float(np.abs(run.arrived_s - retimed.arrive_s).max())
                row[f"{engine}_robot_s_per_cpu_s"] = round(problem.num_robots * run.sim_time_s / run.cpu_time_s)
            yield row


def rows_of_memory(options: argparse.Namespace) -> Iterator[Row]:
    """Many runs in one process: map, plan, drive, audit."""
    robot, graph = ROBOTS["burger"][0], paper_grid(load_map(bundled_maps()["office"]).nav, 0.4)
    rng, early = np.random.default_rng(options.seed), 0
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        network = build_network(graph, Path(folder) / "bench.net.xml")
        for number in range(RUNS):
            start, goal = rng.permutation(graph.num_vertices)[:18].reshape(2, 9)
            problem = Problem(graph, fleet_of(robot, 9), start, goal, np.arange(9), 2.5)
            plan = planner("lacam", {}).plan(problem, 1.0).plan
            assert plan is not None
            settings = ExecutionSettings(policy="open_loop", time_limit_s=300.0, seed=number, on_deadlock="stop")
            run = simulate(problem, plan, settings, network)
            audit(run, problem.fleet)
            if number == RUNS // 10:
                early = memory_mb("VmRSS")
    late = memory_mb("VmRSS")
    spent = round(time.perf_counter() - begun, 1)
    yield {"case": "memory", "runs": RUNS, f"after_{RUNS // 10}_mb": early, "after_all_mb": late, "grown_mb": late - early, "wall_s": spent}


def memory_mb(which: str) -> int:
    """Of this process, as Linux tells."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(which)) // 1024


MODES = {
    "grid": rows_of_drives,
    "startup": rows_of_starts,
    "schedule": rows_of_schedules,
    "retime": rows_of_retiming,
    "memory": rows_of_memory,
}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Measures, fleets, policy, steps."""
    what = parser.add_mutually_exclusive_group()
    for name in MODES:
        what.add_argument(f"--{name}", action="store_true")
    parser.add_argument("--robots", type=int, nargs="+")
    parser.add_argument("--robot", choices=ROBOTS, default="burger")
    parser.add_argument("--planner", help="lacam; pibt beyond 2,000 robots")
    parser.add_argument("--policy", default="adg")
    parser.add_argument("--dt", type=float, help="step length, s")
    parser.add_argument("--record", type=float, default=0.1, help="recording period, s (not below dt)")
    parser.add_argument("--seconds", type=float, help="simulated, at most")
    parser.add_argument("--seed", type=int, default=1)


def rows(options: argparse.Namespace) -> Iterator[Row]:
    """A row a case."""
    warm.prepare("kinematic")
    mode = next((made for name, made in MODES.items() if getattr(options, name)), rows_of_drives)
    yield from mode(options)


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
