"""Plans for roadmaps that can be driven in their order: of planners that know zones and groups, and as the rules of MAPF alone have it.

    python tools/bench_drivable.py                      # bundled maps
    python tools/bench_drivable.py --maps FOLDER        # and every building map in a folder, each of its levels
    python tools/bench_drivable.py --groups 3           # with three mutex groups on each map, of places around a vertex
    python tools/bench_drivable.py --classical          # planners do not know zones and groups
    python tools/bench_drivable.py --json               # a line for each question

Each level of each map is cut into steps of 0.4 and 0.5 m, and every planner is asked about the same draws of robots. A plan is
refused where `traffic.schedule` finds no order of passages for it, as the policy `adg` does.
"""

import argparse
import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import bench
import numpy as np

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import PlanGraph
from mrp_sumo.core.plan import Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive.motion_plan import lanes_along
from mrp_sumo.errors import MrpSumoError, PlanError
from mrp_sumo.maps.catalogue import bundled_maps
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.roadmap import cut_lanes
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.clashes import clashes_of
from mrp_sumo.traffic.draw import uniform_draw
from mrp_sumo.traffic.resources import needs_of, resources_of
from mrp_sumo.traffic.schedule import schedule_of

PLANNERS = ("prioritised", "cbs", "ecbs", "eecbs", "pibt", "lacam", "lns2")
ROBOT = RobotType("burger", 0.138, 0.178, 0.22, 2.5, 2.5, 2.84)
CELLS_M = (0.4, 0.5)
ROBOTS = (3, 5, 8, 12, 20)
MOST_VERTICES = 20_000


def graphs(options: argparse.Namespace) -> Iterator[tuple[str, str, PlanGraph]]:
    """Every level of every map, cut; maps that cannot be read or do not fit the robot are left out, as are equal ones."""
    files = [*bundled_maps().values(), *(sorted(options.maps.rglob("*.building.yaml")) if options.maps else ())]
    seen = set()
    for file in files:
        try:
            levels = load_map(file, graph="all").nav.level_names
        except MrpSumoError:
            continue
        for level in levels:
            for cell_m in CELLS_M:
                try:
                    graph = cut_lanes(load_map(file, graph="all", level=level).nav, cell_m)
                except MrpSumoError:
                    continue
                key = graph.xy.tobytes() + graph.head.tobytes()
                fits = fleet_of(ROBOT, 1).separation_m <= float(graph.length_m.min(initial=math.inf))
                if graph.num_lanes and fits and key not in seen and graph.num_vertices <= MOST_VERTICES:
                    seen.add(key)
                    name = file.parent.name + "/" + file.name.removesuffix(".building.yaml")
                    yield name, level, with_groups(graph, options.groups)


def with_groups(graph: PlanGraph, count: int) -> PlanGraph:
    """Mutex groups of all that lies within three steps of some vertices."""
    if not count:
        return graph
    rng = np.random.default_rng(graph.num_vertices)
    vertex_options, lane_options = list(graph.vertex_options), list(graph.lane_options)
    for group in range(count):
        near = np.hypot(*(graph.xy - graph.xy[int(rng.choice(graph.tail))]).T) <= 3.2 * graph.cell_m
        for v in np.flatnonzero(near).tolist():
            vertex_options[v] = {**vertex_options[v], "mutex": f"group_{group}"}
        for lane in np.flatnonzero(near[graph.tail] & near[graph.head]).tolist():
            lane_options[lane] = {**lane_options[lane], "mutex": f"group_{group}"}
    return replace(graph, vertex_options=tuple(vertex_options), lane_options=tuple(lane_options))


def problems(graph: PlanGraph, options: argparse.Namespace) -> Iterator[tuple[Problem, int, int]]:
    """The draws for which there is room."""
    for robots in options.robots:
        for seed in range(options.seeds):
            fleet = fleet_of(ROBOT, robots)
            try:
                start, goal = uniform_draw(graph, robots, seed, fleet.separation_m)
            except PlanError:
                continue
            yield Problem(graph, fleet, start, goal, np.arange(robots), 1.0, seed=seed, drivable=not options.classical), robots, seed


def answer(problem: Problem, name: str, options: argparse.Namespace) -> bench.Row:
    """A planner's answer: why no order can be kept for its plan, '' where one can; the sum of costs in steps, NaN without a plan."""
    clashes_of(problem)
    strict = {"rotations": False} if options.classical and name in ("pibt", "lacam", "lns2") else {}
    method = planner(name, strict)
    method.prepare()
    result = method.plan(problem, options.time_limit)
    refused, cost, graph = "", math.nan, problem.graph
    if result.status is Status.SOLVED and result.plan is not None:
        cost = float(result.plan.end_s.sum())
        resources = resources_of(graph, problem.fleet.separation_m)
        needs = needs_of(graph, result.plan, lanes_along(graph, result.plan)[0], resources, problem.fleet.kind)
        try:
            schedule_of(problem, result.plan, needs)
        except PlanError as error:
            refused = str(error)
    row = {"planner": name, "status": str(result.status), "refused": refused, "cost": cost}
    return row | {"time_s": result.planning_time_s, "message": result.message}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Maps, planners and fleets."""
    parser.add_argument("--maps", type=Path, help="a folder of *.building.yaml")
    parser.add_argument("--planners", nargs="+", default=PLANNERS, metavar="NAME")
    parser.add_argument("--robots", nargs="+", type=int, default=ROBOTS)
    parser.add_argument("--seeds", type=int, default=1, help="draws of each number of robots (default: 1)")
    parser.add_argument("--groups", type=int, default=0, help="mutex groups to add to each map (default: 0)")
    parser.add_argument("--time-limit", type=float, default=5.0, metavar="S", help="of each answer (default: 5)")
    parser.add_argument("--classical", action="store_true", help="let planners know vertices and lanes only")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each question and planner."""
    for name, level, graph in graphs(options):
        for problem, robots, seed in problems(graph, options):
            question = {"map": name, "level": level, "cell_m": graph.cell_m, "robots": robots, "seed": seed}
            for planner_name in options.planners:
                yield question | answer(problem, planner_name, options)


def summary(rows: list[bench.Row], options: argparse.Namespace) -> str:
    """By planner; costs are of the questions that all of them solved."""
    questions: dict[tuple[object, ...], dict[str, bench.Row]] = {}
    for row in rows:
        questions.setdefault(tuple(row[key] for key in ("map", "level", "cell_m", "robots", "seed")), {})[row["planner"]] = row
    shared = [q for q in questions.values() if all(r["status"] == "solved" for r in q.values())]
    lines = [f"{len(questions)} questions, {len(shared)} solved by all", ""]
    lines += ["| planner | plans | refused | infeasible | no answer | mean steps | median ms |", "|---|---|---|---|---|---|---|"]
    for name in options.planners:
        mine = [row for row in rows if row["planner"] == name]
        count = {status: sum(row["status"] == status for row in mine) for status in ("solved", "infeasible")}
        cost = np.mean([q[name]["cost"] / q[name]["robots"] for q in shared]) if shared else math.nan
        cells = [name, count["solved"], sum(bool(row["refused"]) for row in mine), count["infeasible"], len(mine) - sum(count.values())]
        lines.append(bench.line([*map(str, cells), f"{cost:.2f}", f"{1000 * np.median([row['time_s'] for row in mine]):.1f}"]))
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
