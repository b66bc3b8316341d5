"""Measures `ccbs` on the literature's roadmaps, beside the published figures.

    python tools/bench_ccbs.py                             sparse, 25 robots, 25 tasks of 30 CPU-s, optimal
    python tools/bench_ccbs.py --w 1.05 --robots 20        within 5 %, 20 robots
    python tools/bench_ccbs.py --roadmap dense --tasks 1 2 another roadmap, some of its tasks
    python tools/bench_ccbs.py --json                      a line a task, for machines

The roadmaps are those of Andreychuk et al. (MIT licence): a zip of `<roadmap>/map.xml` and `<roadmap>/<k>_task.xml`, with `--zip`.
Robots are discs of 0.353553 m at unit speed. Solved is what takes no more CPU time than the limit; a run may take `SLACK` times as long by
the clock, so that other work on the machine changes little.
"""

import argparse
import io
import sys
import zipfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import bench
import numpy as np

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import IntArray, PlanGraph, nav_graph, plan_graph
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.planning.registry import planner

ROADMAPS = Path(__file__).resolve().parents[2] / "shared/reference/data/ccbs/roadmaps.zip"
DISC = RobotType("disc", 0.5, 0.5, 1.0, 1.0, 1.0, 1.0, 0.0)
RADIUS_M = 0.353553
LEAST_M = 1e-6  # two vertices are at one place
SLACK = 3.0
PUBLISHED = {"sparse": (25, 25, 23, 17, 6), "dense": (25, 25, 24, 19, 7), "super-dense": (25, 23, 14, 9, 1)}  # of 25, 5 to 25 robots


def read_roadmap(text: bytes) -> PlanGraph:
    """Vertices and lanes of a graphml file."""
    number: dict[str, int] = {}
    points: list[list[float]] = []
    edges: dict[tuple[int, int], None] = {}
    for _, element in ElementTree.iterparse(io.BytesIO(text)):
        kind = element.tag.rpartition("}")[2]
        if kind == "node":
            number[element.get("id", "")] = len(points)
            points.append([float(x) for x in element.findtext("{*}data", "").split(",")])
        elif kind == "edge":
            edges[number[element.get("source", "")], number[element.get("target", "")]] = None
        if kind in ("node", "edge"):
            element.clear()  # half a million would take 700 MB
    xy, lanes = np.array(points), np.array(list(edges))
    length_m = np.maximum(np.hypot(*(xy[lanes[:, 1]] - xy[lanes[:, 0]]).T), LEAST_M)
    return plan_graph(nav_graph(name="roadmap", xy=xy, lanes=lanes, length_m=length_m), kind="roadmap", cell_m=1.0)


def read_tasks(text: bytes, num_robots: int) -> IntArray:
    """[2, R] starts and goals of the first robots."""
    agents = ElementTree.fromstring(text).findall("agent")[:num_robots]
    return np.array([[int(agent.get(key, "")) for agent in agents] for key in ("start_id", "goal_id")], np.int64)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Roadmap, tasks and limits."""
    parser.add_argument("--zip", type=Path, default=ROADMAPS)
    parser.add_argument("--roadmap", choices=PUBLISHED, default="sparse")
    parser.add_argument("--robots", type=int, default=25)
    parser.add_argument("--tasks", type=int, nargs="*", default=range(1, 26))
    parser.add_argument("--w", type=float, default=1.0)
    parser.add_argument("--time-limit", type=float, default=30.0)


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row a task."""
    if not options.zip.exists():
        raise MrpSumoError(f"{options.zip} is not there; name the roadmaps with --zip")
    archive = zipfile.ZipFile(options.zip)
    graph = read_roadmap(archive.read(f"{options.roadmap}/map.xml"))
    chosen = planner("ccbs", {"motion": "unit", "radius_m": RADIUS_M, "w": options.w})
    chosen.prepare()
    for k in options.tasks:
        start, goal = read_tasks(archive.read(f"{options.roadmap}/{k}_task.xml"), options.robots)
        problem = Problem(graph, fleet_of(DISC, len(start)), start, goal, np.arange(len(start)), 1.0)
        result, cpu_s, _ = bench.timed(partial(chosen.plan, problem, SLACK * options.time_limit))
        stats = result.stats
        row = {"task": k, "status": str(result.status), "cost_s": stats.get("cost_s"), "bound_s": stats["lower_bound_s"]}
        yield row | {"nodes": stats["nodes"], "cpu_s": cpu_s}


def summary(rows: list[bench.Row], options: argparse.Namespace) -> str:
    """The solved, beside the published."""
    ratios = [row["cost_s"] / row["bound_s"] for row in rows if row["cost_s"] is not None and row["cpu_s"] <= options.time_limit]
    best = dict(zip(range(5, 26, 5), PUBLISHED[options.roadmap])).get(options.robots, "-")
    solved = f"solved {len(ratios)} of {len(rows)} in {options.time_limit:g} CPU-s; cost / bound at most {max(ratios, default=1.0):.4f}"
    return f"{solved}\nbest published, optimal, in 30 s: {best} of 25"


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
