"""Drives thousands of disturbed executions and lets the independent audit look for overlaps.

    python tools/campaign_execution.py --runs 2000
    python tools/campaign_execution.py --runs 500 --maps DIR     maps below DIR too (*.building.yaml)

Worlds are the bundled maps (grid and roadmap), random roadmaps with acute angles, crossings and short lanes, and
racks with aisles; policies, step lengths, disturbances, robots and their number are drawn from the run's number.
Prints every run with an overlap, a limit broken or a collision in SUMO, and a table at the end.
"""

import argparse
import collections
import sys
import tempfile
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.graph import NavGraph, PlanGraph, nav_graph
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import ExecutionError, MrpSumoError, PlanError
from mrp_sumo.maps.catalogue import bundled_maps
from mrp_sumo.maps.grid import grid_graph, paper_grid
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.roadmap import cut_lanes
from mrp_sumo.maps.sumo import build_network
from mrp_sumo.metrics.audit import audit
from mrp_sumo.planning.registry import planner
from mrp_sumo.sim.disturbances import Breakdown, Disturbances
from mrp_sumo.sim.loop import simulate
from mrp_sumo.sim.settings import ExecutionSettings

BURGER = RobotType("burger", 0.138, 0.178, 0.22, 2.5, 2.5, 2.84)
BOX = RobotType("box", 0.3, 0.2, 0.8, 0.6, 0.9, 1.2, 0.04)  # brakes harder than it speeds up, tight gap
POLICIES = ("adg", "adg_timed", "open_loop", "timed")
STEPS = (0.1, 0.2, 0.5, 1.0)
LARGEST = 6000  # vertices


def random_roadmap(rng: np.random.Generator) -> NavGraph:
    """Points in a square, most edges of their Delaunay triangulation, and some long lanes across it."""
    num = int(rng.integers(8, 30))
    xy = rng.uniform(0, 5.0, (num, 2))
    triangles = Delaunay(xy).simplices
    pairs = {tuple(sorted(p)) for t in triangles.tolist() for p in ((t[0], t[1]), (t[1], t[2]), (t[0], t[2]))}
    kept = [p for p in sorted(pairs) if rng.random() < 0.8]
    kept += [tuple(sorted(rng.choice(num, 2, replace=False).tolist())) for _ in range(3)]
    lanes = [lane for a, b in sorted(set(kept)) for lane in (((a, b), (b, a)) if rng.random() < 0.9 else ((a, b),))]
    return nav_graph(name="random", xy=xy, lanes=lanes)


def racks(rng: np.random.Generator) -> PlanGraph:
    """Racks with aisles one cell wide."""
    free = np.ones((int(rng.integers(7, 20)), int(rng.integers(10, 40))), np.bool_)
    for y in range(2, len(free) - 2, 3):
        for x in range(2, free.shape[1] - 5, 6):
            free[y : y + 2, x : x + 5] = False
    return grid_graph(free, 0.4, (0.0, 0.0), name="racks")


@cache
def loaded(path: Path, kind: str) -> PlanGraph | None:
    try:
        nav = load_map(path, graph="all").nav
        graph = cut_lanes(nav, 0.4) if kind == "roadmap" else paper_grid(nav, 0.4)
    except MrpSumoError:
        return None
    return graph if graph.num_vertices <= LARGEST and len(graph.level_names) == 1 else None


def world(rng: np.random.Generator, paths: list[Path]) -> PlanGraph | None:
    which = rng.random()
    if which < 0.35:
        return cut_lanes(random_roadmap(rng), float(rng.choice([0.4, 0.5, 5.0])))
    if which < 0.6:
        return racks(rng)
    return loaded(paths[int(rng.integers(len(paths)))], str(rng.choice(["roadmap", "grid"])))


def disturbed(rng: np.random.Generator, num_robots: int) -> Disturbances:
    if rng.random() < 0.2:
        return Disturbances()
    what = Disturbances(
        speed_spread=0.08, speed_noise=0.05, stops_per_s=1 / 120, start_delay_s=float(rng.choice([0.0, 5.0])), delay_probability=0.01
    )
    if rng.random() < 0.3:
        what = replace(what, latency_s=0.5, message_loss=0.1)
    if rng.random() < 0.2:
        what = replace(what, breakdowns=(Breakdown(int(rng.integers(num_robots)), 20.0, float(rng.choice([20.0, np.inf]))),))
    return what


def apart(graph: PlanGraph, rng: np.random.Generator, num: int, distance: float) -> np.ndarray:
    """Up to `num` vertices with lanes in one component, at least `distance` apart."""
    served = np.unique(np.concatenate([graph.tail, graph.head]))
    served = served[graph.component[served] == np.bincount(graph.component[served]).argmax()]
    chosen: list[int] = []
    for v in rng.permutation(served).tolist():
        if not chosen or cKDTree(graph.xy[chosen]).query(graph.xy[v])[0] >= distance:
            chosen.append(v)
        if len(chosen) == num:
            break
    return np.array(chosen, np.int64)


def one(number: int, paths: list[Path], network: Path) -> tuple[str, str, str]:
    """Drive run `number`: what was driven, how it ended, and what is wrong with it."""
    rng = np.random.default_rng([number, 77])
    graph = world(rng, paths)
    robot = BOX if rng.random() < 0.4 else BURGER
    num = int(np.exp(rng.uniform(np.log(2), np.log(60))))
    policy, dt = str(rng.choice(POLICIES)), float(rng.choice(STEPS))
    if graph is None:
        return policy, "no such map", ""
    distance = fleet_of(robot, 1).separation_m
    start, goal = apart(graph, rng, num, distance), apart(graph, rng, num, distance)
    num = min(len(start), len(goal))
    if num < 2:
        return policy, "no room", ""
    fleet = fleet_of(robot, num)
    step_s = graph.cell_m / robot.max_speed_mps + 1.0
    problem = Problem(graph, fleet, start[:num], goal[:num], np.arange(num), step_s)
    plan = planner("prioritised" if rng.random() < 0.5 else "lacam", {}).plan(problem, 5.0).plan
    if plan is None:
        return policy, "no plan", ""
    settings = ExecutionSettings(
        policy,
        dt,
        150.0,
        record_period_s=dt,
        seed=number,
        disturbances=disturbed(rng, num),
        on_deadlock=str(rng.choice(["report", "resolve"])),
    )
    build_network(graph, network)
    try:
        run = simulate(problem, plan, settings, network)
    except PlanError:
        return policy, "order refused", ""
    except ExecutionError as error:
        return policy, "refused", "" if "do not fit" in str(error) else str(error)
    found = audit(run, fleet)
    wrong = [] if found["passed"] else [f"audit { ({k: v for k, v in found.items() if k.startswith('num')}) } {found['violations'][:1]}"]
    wrong += run.findings[:2]
    if abs(run.booked_s.sum(1) - run.sim_time_s).max() > 1e-6:
        wrong.append("bookings do not add up")
    if policy.startswith("adg") and any(e.kind == "deadlock" for e in run.events):
        wrong.append("deadlock in plan order")
    nearest = min((cKDTree(np.c_[x, y]).query(np.c_[x, y], k=2)[0][:, 1].min() for x, y in zip(run.x_m, run.y_m)), default=np.inf)
    if nearest < distance - 0.004:
        wrong.append(f"{nearest:.4f} m apart, expected {distance:.4f}")
    what = f"{graph.name} {graph.kind} cell {graph.cell_m:g}, {num} {robot.name}, dt {dt}, {settings.on_deadlock}"
    return policy, str(run.outcome), f"{what}: {'; '.join(wrong)}" if wrong else ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--maps", type=Path)
    options = parser.parse_args()
    paths = sorted(bundled_maps().values()) + (sorted(options.maps.rglob("*.building.yaml")) if options.maps else [])
    table: collections.Counter[tuple[str, str]] = collections.Counter()
    wrong, begun = 0, time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        for number in range(options.first, options.first + options.runs):
            policy, ended, complaint = one(number, paths, Path(folder) / "campaign.net.xml")
            table[policy, ended] += 1
            if complaint:
                wrong += 1
                print(f"run {number}, {policy}, {ended}: {complaint}", flush=True)
    endings = sorted({ended for _, ended in table})
    print(f"{'policy':<12}" + "".join(f"{ended:>15}" for ended in endings))
    for policy in POLICIES:
        print(f"{policy:<12}" + "".join(f"{table[policy, ended]:>15}" for ended in endings))
    print(f"{options.runs} runs in {time.perf_counter() - begun:.0f} s, {wrong} with something wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
