"""Time and size of the logs of a big run: 1000 robots, 10 Hz, 600 s by default.

    python tools/bench_logs.py [--robots 1000] [--seconds 600] [--out DIR]

The robots are invented: each drives up and down its own corridor at changing speed. Prints a line a log,
with seconds, seconds of CPU, megabytes and the peak of resident memory so far.
"""

import argparse
import resource
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from mrp_sumo.bags.writer import BagOptions, write_bag
from mrp_sumo.core.execution import Event, Execution, Outcome
from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.plan import plan_of_paths
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--out", type=Path, help="keep the files here (default: a temporary folder, removed)")
    options = parser.parse_args()
    folder = options.out or Path(mkdtemp(prefix="bench_logs_"))
    folder.mkdir(parents=True, exist_ok=True)
    record = invented(options.robots, options.seconds)
    execution = record.execution
    print(f"{options.robots} robots, {len(execution.t_s)} samples; memory before: {_memory_mb():.0f} MB")

    def measure(name: str, work: Callable[[], object], path: Path | None = None) -> None:
        began, worked = time.perf_counter(), time.process_time()
        work()
        spent, cpu = time.perf_counter() - began, time.process_time() - worked
        files = [path] if path and path.is_file() else path.rglob("*") if path else ()
        size = sum(f.stat().st_size for f in files if f.is_file()) / 1e6
        print(f"{name:24} {spent:7.2f} s {cpu:7.2f} s CPU {size:8.1f} MB   peak {_memory_mb():6.0f} MB", flush=True)

    table, x, y = folder / "trajectory.parquet", execution.x_m[::5], execution.y_m[::5]
    t_ns = np.rint(execution.t_s[::5] * 1e9).astype(np.int64)
    measure("parquet", lambda: write_trajectory(table, execution, record.fleet.robot_name, {}), table)
    measure("parquet, reading", lambda: read_trajectory(table))
    measure("bag, mcap", lambda: write_bag(folder / "bag", record), folder / "bag")
    measure("bag, sqlite3", lambda: write_bag(folder / "bag_sqlite3", record, BagOptions(storage="sqlite3")), folder / "bag_sqlite3")
    measure("audit", lambda: audit(execution, record.fleet))
    goals = record.graph.xy[record.target]
    measure("MRP-Bench's metrics", lambda: execution_metrics(t_ns, x, y, goals, goals))
    if not options.out:
        shutil.rmtree(folder)


def _memory_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
