"""Time and size of the logs of a big run: 1000 robots, 10 Hz, 600 s by default.

    python tools/bench_logs.py [--robots 1000] [--seconds 600] [--out DIR]

The robots are invented: each drives up and down its own corridor at changing speed. A row a log.
"""

import argparse
import resource
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import mkdtemp

import bench
import numpy as np

from mrp_sumo.bags.writer import BagOptions, write_bag
from mrp_sumo.core.execution import Event, Execution, Outcome
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.plan import plan_of_paths
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.io.record import RunRecord
from mrp_sumo.io.trajectory import read_trajectory, write_trajectory
from mrp_sumo.metrics.audit import audit
from mrp_sumo.metrics.mrp_bench import execution_metrics

CELLS = 20  # of 1 m in a corridor
TURN = np.array([[np.cos(0.5), np.sin(0.5)], [-np.sin(0.5), np.cos(0.5)]])  # corridors lie askew: x and y both change
CART = RobotType("cart", 0.6, 0.4, max_speed_mps=1.5, accel_mps2=2.0, decel_mps2=2.0, turn_rate_rad_s=2.0)


def invented(num_robots: int, seconds: float) -> RunRecord:
    """Robots in corridors, ten side by side and so on."""
    row, column = np.divmod(np.arange(num_robots), 10)
    corner = np.column_stack((column * (CELLS + 1.0), row * 1.0))
    xy = (corner[:, None] + np.column_stack((np.arange(CELLS), np.zeros(CELLS)))).reshape(-1, 2) @ TURN
    tail = (np.arange(num_robots)[:, None] * CELLS + np.arange(CELLS - 1)).ravel()
    nav = nav_graph(name="corridors", xy=xy, lanes=np.concatenate((np.column_stack((tail, tail + 1)), np.column_stack((tail + 1, tail)))))
    graph = plan_graph(nav, kind="grid", cell_m=1.0)
    steps = int(seconds)
    there = np.abs((np.arange(steps) + CELLS - 1) % (2 * CELLS - 2) - (CELLS - 1))
    plan = plan_of_paths([r * CELLS + there for r in range(num_robots)], 1.0)
    rng = np.random.default_rng(0)
    t = np.arange(round(seconds * 10) + 1) * 0.1
    pace = 0.8 + 0.2 * np.sin(t[:, None] * rng.uniform(0.2, 0.5, num_robots) + rng.uniform(0, 6, num_robots))
    driven = np.cumsum(pace, 0) * 0.1
    back = driven % (2 * CELLS - 2) >= CELLS - 1
    along = np.where(back, 2 * CELLS - 2 - driven % (2 * CELLS - 2), driven % (2 * CELLS - 2))
    start = corner @ TURN
    x, y = start[:, 0] + along * TURN[0, 0], start[:, 1] + along * TURN[0, 1]
    yaw = 0.5 + np.where(back, np.pi, 0.0) + 0.01 * np.sin(3 * t[:, None] + np.arange(num_robots))
    events = tuple(
        Event(float(s), "blocked", int(r), int(r) * CELLS, (int(r) + 1) % num_robots, 2.0)
        for s in range(5, int(seconds), 5)
        for r in rng.integers(0, num_robots, 3)
    )
    nan = np.full(num_robots, np.nan)
    execution = Execution(t, x, y, yaw, pace, plan.arrive_s, nan, Outcome.TIME_LIMIT, "adg", seconds, 1.0, 1.0, events)
    target = np.arange(num_robots) * CELLS
    return RunRecord("corridors", 0, fleet_of(CART, num_robots), graph, target, plan, execution, nav, None)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Size of the run."""
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--out", type=Path, help="keep the files here (default: a temporary folder, removed)")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row a log; peaks of memory are those so far."""
    folder = options.out or Path(mkdtemp(prefix="bench_logs_"))
    folder.mkdir(parents=True, exist_ok=True)
    record = invented(options.robots, options.seconds)
    execution, table = record.execution, folder / "trajectory.parquet"
    x, y, goals = execution.x_m[::5], execution.y_m[::5], record.graph.xy[record.target]
    t_ns = np.rint(execution.t_s[::5] * 1e9).astype(np.int64)
    in_sqlite3 = BagOptions(storage="sqlite3")
    works: tuple[tuple[str, Path | None, Callable[[], object]], ...] = (
        ("the run in memory", None, lambda: None),
        ("parquet", table, lambda: write_trajectory(table, execution, record.fleet.robot_name, {})),
        ("parquet, reading", None, lambda: read_trajectory(table)),
        ("bag, mcap", folder / "bag", lambda: write_bag(folder / "bag", record)),
        ("bag, sqlite3", folder / "bag_sqlite3", lambda: write_bag(folder / "bag_sqlite3", record, in_sqlite3)),
        ("audit", None, lambda: audit(execution, record.fleet)),
        ("MRP-Bench's metrics", None, lambda: execution_metrics(t_ns, x, y, goals, goals)),
    )
    for name, path, work in works:
        _, cpu_s, wall_s = bench.timed(work)
        files = [path] if path and path.is_file() else path.rglob("*") if path else ()
        size_mb = sum(f.stat().st_size for f in files if f.is_file()) / 1e6
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        yield {"log": name, "robots": options.robots, "samples": len(execution.t_s), "cpu_s": cpu_s, "wall_s": wall_s} | {
            "size_mb": size_mb,
            "peak_mb": peak_mb,
        }
    if not options.out:
        shutil.rmtree(folder)


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
