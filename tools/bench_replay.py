"""The replay page and videos of a run: time and memory to make them, size; in headless Chromium the time to load a page and its frames.

    python tools/bench_replay.py [--robots 1000] [--duration 600] [--keep DIR]
    python tools/bench_replay.py --video --robots 100 --duration 60    # 1080 lines, 30 frames a second

The run is made up: robots walk at random over
a warehouse grid, wait at random, and reach every vertex some seconds after the plan. Without
Chromium and playwright-core (tools/browser.sh installs them) only the first figures are measured.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import bench
import numpy as np

from mrp_sumo.core.execution import Event, Execution, Outcome
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import IntArray, PlanGraph
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.formats.plan_json import write_plan
from mrp_sumo.io.events import write_events
from mrp_sumo.io.floor_plan import write_floor
from mrp_sumo.io.run_folder import plain
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.io.trajectory import write_trajectory
from mrp_sumo.io.visits import write_visits
from mrp_sumo.maps.grid import grid_graph

CELL_M = 0.8
STEP_S = 2.0
PERIOD_S = 0.1
MODEL = RobotType("carrier", 0.62, 0.48, 0.8, 1.0, 1.0, 2.0)
MODULES = Path(__file__).resolve().parents[1] / ".venv" / "node" / "node_modules"
BROWSER = Path(__file__).with_name("bench_replay.mjs")


def make_run(folder: Path, num_robots: int, duration_s: float) -> None:
    """Write the files of a run folder that the page is made of."""
    rng = np.random.default_rng(7)
    graph = _warehouse(num_robots)
    steps = int(duration_s / STEP_S)
    start = rng.choice(graph.num_vertices, num_robots, replace=False)
    path, moving = _walks(graph, start, steps, rng)
    first, vertex, arrive, depart, arrived = [0], [], [], [], []
    for r in range(num_robots):
        begin = np.flatnonzero(np.append(True, moving[:, r]))
        late = np.cumsum(rng.random(len(begin)) < 0.08) * rng.integers(1, 4) * 1.0
        vertex.append(path[begin, r])
        arrive.append(begin * STEP_S)
        depart.append(np.append((begin[1:] - 1) * STEP_S, np.inf))
        arrived.append(np.where(begin * STEP_S + late <= duration_s, begin * STEP_S + late, np.nan))
        first.append(first[-1] + len(begin))
    plan = Plan(np.array(first), np.concatenate(vertex), np.concatenate(arrive), np.concatenate(depart))
    fleet = fleet_of(MODEL, num_robots)
    problem = Problem(graph, fleet, start, np.array([], np.int64), np.full(num_robots, -1), STEP_S)
    t_s = np.arange(int(duration_s / PERIOD_S) + 1) * PERIOD_S
    x, y, yaw = (np.zeros((len(t_s), num_robots)) for _ in range(3))
    events = []
    for r in range(num_robots):
        there = np.isfinite(arrived[r])
        at, xy = arrived[r][there], graph.xy[vertex[r][there]]
        leave = np.maximum(np.append(at[1:] - STEP_S, at[-1]), at)
        when = np.column_stack((at, leave)).ravel()
        x[:, r], y[:, r] = (np.interp(t_s, when, np.repeat(c, 2)) for c in xy.T)
        moves = np.diff(xy, axis=0)
        course = np.unwrap(np.arctan2(moves[:, 1], moves[:, 0])) if len(moves) else np.zeros(1)
        yaw[:, r] = np.interp(t_s, np.maximum(leave[: len(course)], 0), course)
        for k in np.flatnonzero(leave - at > STEP_S)[:40]:
            kind = "blocked" if leave[k] - at[k] > 4 else "waited"
            events.append(Event(float(at[k]), kind, r, int(vertex[r][k]), int(rng.integers(num_robots)), float(leave[k] - at[k])))
    speed = np.vstack([np.zeros(num_robots), np.hypot(np.diff(x, axis=0), np.diff(y, axis=0)) / PERIOD_S])
    goal_s = np.where(rng.random(num_robots) < 0.3, duration_s * rng.uniform(0.8, 1.0, num_robots), np.nan)
    events += [Event(float(t), "goal", r, int(plan.last_vertex[r])) for r, t in enumerate(goal_s) if np.isfinite(t)]
    execution = Execution(
        t_s, x, y, yaw, speed, np.concatenate(arrived), goal_s, Outcome.TIME_LIMIT, "adg", duration_s, 1.0, 1.0, tuple(events)
    )  # fmt: skip
    write_floor(folder / "floor.json", graph, fleet, None)
    write_plan(folder / "plan.json", problem, plan)
    write_trajectory(folder / "trajectory.parquet", execution, fleet.robot_name, {})
    write_visits(folder / "visits.parquet", problem, plan, execution)
    write_events(folder / "events.jsonl", execution, fleet, graph)
    scenario = ScenarioModel.model_validate(
        {
            "name": f"bench_{num_robots}",
            "map": "warehouse",
            "discretisation": {"kind": "grid", "cell_m": CELL_M},
            "robots": {"count": num_robots},
            "planner": "made_up",
        }
    )
    result = {
        "status": "time_limit",
        "outcome": "time_limit",
        "policy": "adg",
        "note": "",
        "seed": 7,
        "scenario": scenario.model_dump(mode="json"),
        "metrics": {"sim_time_s": duration_s, "wall_time_s": 1.0, "cpu_time_s": 1.0},
        "robots": [{"name": n, "goal": graph.label(int(v)), "goal_s": t} for n, v, t in zip(fleet.robot_name, plan.last_vertex, goal_s)],
        "findings": [],
    }
    (folder / "result.json").write_text(json.dumps(plain(result)))


def shown(page: Path) -> dict[str, object]:
    """Load and play the page in a browser without a graphics card, which is far slower than a laptop's."""
    chromium, node = shutil.which("chromium"), shutil.which("node")
    if not chromium or not node:
        return {"browser": "none found"}
    output = subprocess.run(
        [node, BROWSER, chromium, page.resolve()], capture_output=True, text=True, env={"NODE_PATH": str(MODULES), **os.environ}
    )
    if output.returncode:
        return {"browser": next((line for line in output.stderr.splitlines() if "Error" in line), "failed")}
    return dict(json.loads(output.stdout.splitlines()[-1]))


def _warehouse(num_robots: int) -> PlanGraph:
    """Racks of 2 x 6 cells between aisles of 2, with about ten free cells a robot."""
    side = int(np.ceil(np.sqrt(16 * max(num_robots, 16)))) + 8
    row, column = np.indices((side, side))
    rack = (row % 4 > 1) & (column % 8 > 1) & (row > 3) & (row < side - 4) & (column > 3) & (column < side - 4)
    return grid_graph(~rack, CELL_M, (0.0, 0.0), name="warehouse")


def _walks(graph: PlanGraph, start: IntArray, steps: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """[steps + 1, R] vertices, and [steps, R] whether the robot moved; straight on where it can, a wait now and then."""
    target = np.full((graph.num_vertices, 4), -1)
    step = graph.xy[graph.head] - graph.xy[graph.tail]
    target[graph.tail, (np.rint(np.arctan2(step[:, 1], step[:, 0]) / (np.pi / 2)).astype(int)) % 4] = graph.head
    path, course = np.empty((steps + 1, len(start)), np.int64), rng.integers(0, 4, len(start))
    path[0] = start
    for k in range(steps):
        turn = rng.random(len(start)) < 0.12
        course = np.where(turn | (target[path[k], course] < 0), rng.integers(0, 4, len(start)), course)
        ahead = target[path[k], course]
        path[k + 1] = np.where((ahead < 0) | (rng.random(len(start)) < 0.15), path[k], ahead)
    return path, path[1:] != path[:-1]


def arguments(parser: argparse.ArgumentParser) -> None:
    """Size of the run."""
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--duration", type=float, default=600.0, help="seconds simulated")
    parser.add_argument("--keep", type=Path, help="leave the run folder and the page here")
    parser.add_argument("--video", action="store_true", help="videos at real time instead of the page")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """One row for the page, made as a user makes it, or one for each kind of video."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.keep or Path(scratch) / "run"
        folder.mkdir(parents=True, exist_ok=True)
        make_run(folder, options.robots, options.duration)
        about = {"robots": options.robots, "samples": int(options.duration / PERIOD_S) + 1}
        for kind in ("mp4", "gif", "webp") if options.video else ():
            out = Path(scratch) / f"out.{kind}"
            figures = bench.process([*bench.COMMAND, "render", folder, "--video", out, "--speed", "1"])
            yield {"video": kind, **about, **figures, "size_mb": out.stat().st_size / 1e6}
        if not options.video:
            figures = bench.process([*bench.COMMAND, "replay", folder])
            page = folder / "replay.html"
            yield {**about, **figures, "page_mb": page.stat().st_size / 1e6, **shown(page)}


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
