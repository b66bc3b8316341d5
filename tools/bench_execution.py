"""Measures execution: robot-seconds simulated a second of CPU time, trajectory recording on, one process.

    python tools/bench_execution.py                        50 to 1,000 robots in a warehouse of 161 x 63 cells
    python tools/bench_execution.py --robots 5000 --grid 200 --dt 0.2 --seconds 60
    python tools/bench_execution.py --json                 a line a case, for machines

The warehouse has the layout of the MovingAI benchmark's warehouse-10-20-10-2-1: 10 x 20 racks of 10 x 2 cells,
aisles one cell wide. CPU time is that of the loop; planning, the network and the start of SUMO are told apart.
"""

import argparse
import json
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.graph import PlanGraph
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.schedule import order_of, vertex_needs, waiting_cycle
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.maps.sumo import build_network
from mrp_sumo.planning.registry import planner
from mrp_sumo.sim.loop import simulate
from mrp_sumo.sim.settings import ExecutionSettings

ROBOTS = {
    "burger": (RobotType("turtlebot3_burger", 0.138, 0.178, 0.22, 2.5, 2.5, 2.84), 0.4, 2.5),  # cell, planned step
    "amr": (RobotType("amr", 0.6, 0.5, 1.0, 0.5, 0.5, 1.5), 1.0, 3.0),
}


def warehouse() -> np.ndarray:
    """[63, 161] free cells."""
    free = np.zeros((63, 161), np.bool_)
    free[1:-1, 1:-1] = True
    for x in range(26, 26 + 11 * 10, 11):
        for y in range(2, 62, 3):
            free[y : y + 2, x : x + 10] = False
    return free


def draw(graph: PlanGraph, num_robots: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng([seed, num_robots])
    return rng.permutation(graph.num_vertices)[:num_robots], rng.permutation(graph.num_vertices)[:num_robots]


def executable(plan: Plan, num_vertices: int) -> np.ndarray:
    """Robots whose plans together can be executed in order: one of every rotation is left out."""
    robots = np.arange(plan.num_robots)
    while True:
        part = of_robots(plan, robots)
        cycle = waiting_cycle(part, order_of(part, vertex_needs(part, num_vertices)))
        if not len(cycle):
            return robots
        robots = np.delete(robots, part.robot[cycle[0]])


def of_robots(plan: Plan, robots: np.ndarray) -> Plan:
    visits = np.concatenate([np.arange(plan.first[r], plan.first[r + 1]) for r in robots])
    first = np.concatenate([[0], np.cumsum(np.diff(plan.first)[robots])])
    return Plan(first, plan.vertex[visits], plan.arrive_s[visits], plan.depart_s[visits])


def measure(graph: PlanGraph, network: Path, num_robots: int, options: argparse.Namespace) -> dict:
    """Plan and drive one case."""
    robot, _, step_s = ROBOTS[options.robot]
    spare = num_robots // 10 if num_robots > 300 else 0  # dense plans rotate without a gap, which no order can execute
    start, goal = draw(graph, num_robots + spare, options.seed)
    problem = Problem(graph, fleet_of(robot, num_robots + spare), start, goal, np.arange(num_robots + spare), step_s)
    method = planner(options.planner, {})
    method.prepare()
    begun = time.perf_counter()
    plan = method.plan(problem, 120.0).plan
    planning_s = time.perf_counter() - begun
    if plan is None:
        raise MrpSumoError(f"{options.planner} found no plan for {num_robots} robots")
    robots = executable(plan, graph.num_vertices)[:num_robots]
    plan = of_robots(plan, robots)
    problem = Problem(graph, fleet_of(robot, len(robots)), start[robots], goal[robots], np.arange(len(robots)), step_s)
    limit_s = min(options.seconds, float(plan.end_s.max()) * 4 + 60)
    settings = ExecutionSettings(options.policy, options.dt, limit_s, record_period_s=max(options.dt, options.record))
    begun = time.perf_counter()
    run = simulate(problem, plan, settings, network)
    return {
        "robots": len(robots),
        "policy": options.policy,
        "dt_s": options.dt,
        "planning_s": round(planning_s, 2),
        "makespan_s": float(plan.end_s.max()),
        "sim_s": run.sim_time_s,
        "outcome": str(run.outcome),
        "goals": int(np.isfinite(run.goal_s).sum()),
        "cpu_s": round(run.cpu_time_s, 2),
        "around_s": round(time.perf_counter() - begun - run.wall_time_s, 2),
        "robot_s_per_cpu_s": round(len(robots) * run.sim_time_s / run.cpu_time_s),
        "us_per_robot_step": round(run.cpu_time_s / (len(robots) * run.sim_time_s / options.dt) * 1e6, 2),
        "real_time_factor": round(run.sim_time_s / run.cpu_time_s, 2),
        "rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }


def warm_up(problem_plan: tuple[Problem, Plan], network: Path, policy: str) -> None:
    """Compile the kernels."""
    simulate(*problem_plan, ExecutionSettings(policy, time_limit_s=0.2), network)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, nargs="+", default=[50, 100, 200, 500, 1000])
    parser.add_argument("--grid", type=int, help="an empty grid of this many cells a side instead of the warehouse")
    parser.add_argument("--robot", choices=ROBOTS, default="burger")
    parser.add_argument("--planner", default="lacam")
    parser.add_argument("--policy", default="adg")
    parser.add_argument("--dt", type=float, default=0.1)
    parser.add_argument("--record", type=float, default=0.1, help="recording period, s (not below dt)")
    parser.add_argument("--seconds", type=float, default=120.0, help="simulated, at most")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    cell_m = ROBOTS[options.robot][1]
    free = np.ones((options.grid, options.grid), np.bool_) if options.grid else warehouse()
    graph = grid_graph(free, cell_m, (0.0, 0.0), name="grid" if options.grid else "warehouse")
    with tempfile.TemporaryDirectory() as folder:
        network = build_network(graph, Path(folder) / "bench.net.xml")
        start, goal = draw(graph, 1, 0)
        problem = Problem(graph, fleet_of(ROBOTS[options.robot][0], 1), start, goal, np.arange(1), ROBOTS[options.robot][2])
        plan = planner("pibt", {}).plan(problem, 10.0).plan
        assert plan is not None
        warm_up((problem, plan), network, options.policy)
        header = False
        for num_robots in options.robots:
            found = measure(graph, network, num_robots, options)
            if options.json:
                print(json.dumps(found), flush=True)
                continue
            if not header:
                print("  ".join(found))
                header = True
            print("  ".join(f"{value!s:>{len(key)}}" for key, value in found.items()), flush=True)


if __name__ == "__main__":
    main()
