"""Compare finishing times with those of SMART, another author's simulator, for the same plans and the same kinematics.

    python tools/beside_smart.py DIR --map warehouse-10-20-10-2-1.map              a table
    python tools/beside_smart.py DIR --map F.map --engine kinematic --json         a line of JSON per plan
    python tools/beside_smart.py DIR --map F.map --picture docs/pictures/beside_smart.png

DIR has `planN.txt`, paths of N robots in SMART's format, and `finish_N.csv`, with the columns `robot` and `smart_finish_s`. The robots are
SMART's: 2 m/s, 0.5 m/s2, a quarter turn a second in place.
"""

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.formats.instances import problem_of_places, read_instance
from mrp_sumo.formats.peers import read_paths, read_places

ROBOT = RobotType("smart", 0.3, 0.3, 2.0, 0.5, 0.5, 1.57, 0.0757)
STEP_S = 2.0  # planned for a cell of 1 m: shorter than a start, a drive and a turn from rest to rest
SETTINGS = ExecutionSettings(time_limit_s=5000.0)


def finishing_times(map_path: Path, plan_path: Path, engine: str) -> np.ndarray:
    """[R] when each robot of a plan comes to its goal, in s, driven by an engine; all of it."""
    instance, text = read_instance(map_path, None, 0), plan_path.read_text()
    problem = problem_of_places(instance, read_places(text, None, plan_path.name), plan_path.name)
    problem = replace(problem, fleet=fleet_of(ROBOT, problem.num_robots), step_s=STEP_S)
    plan = retime(problem, read_paths(text, problem, instance.cells, plan_path.name), SETTINGS)
    with tempfile.TemporaryDirectory() as folder:
        network = build_network(problem.graph, Path(folder) / "beside.net.xml")
        return simulate(problem, plan, replace(SETTINGS, engine=engine), network).goal_s


def compared(ours: np.ndarray, theirs: np.ndarray) -> dict[str, Any]:
    """How far two simulators agree: correlation, ratio of sums, and how many of the latest tenth are the same robots."""
    tenth = len(ours) // 10
    latest = [set(np.argsort(column, kind="stable")[-tenth:].tolist()) for column in (ours, theirs)]
    return {
        "robots": len(ours),
        "pearson": round(float(np.corrcoef(ours, theirs)[0, 1]), 5),
        "ours_to_smart": round(float(ours.sum() / theirs.sum()), 4),
        "latest_tenth": f"{len(latest[0] & latest[1])} of {tenth}",
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--map", type=Path, required=True)
    parser.add_argument("--engine", choices=("sumo", "kinematic"), default="sumo")
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    times = []
    for path in sorted(options.folder.glob("finish_*.csv")):
        number = path.stem.removeprefix("finish_")
        head, *rows = (line.split(",") for line in path.read_text().splitlines())
        theirs = np.array([float(row[head.index("smart_finish_s")]) for row in rows])
        ours = finishing_times(options.map, options.folder / f"plan{number}.txt", options.engine)
        times.append((ours, theirs))
        row = {"engine": options.engine, **compared(ours, theirs)}
        print(json.dumps(row) if options.json else "  ".join(f"{key} {value}" for key, value in row.items()), flush=True)
    if options.picture:
        draw(options.picture, times)


def draw(out: Path, times: list[tuple[np.ndarray, np.ndarray]]) -> None:
    """A dot per robot, and the line on which both agree."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(times), figsize=(4.2 * len(times), 4.0), squeeze=False, layout="constrained")
    for axis, (ours, theirs) in zip(axes[0], times):
        most = 1.04 * max(ours.max(), theirs.max())
        axis.plot([0, most], [0, most], color="#7d838c", linewidth=0.8, zorder=1)
        axis.scatter(theirs, ours, s=14 if len(ours) < 200 else 6, color="#2b6ca8", linewidths=0, zorder=2)
        axis.set(xlim=(0, most), ylim=(0, most), aspect="equal", xlabel="at the goal in SMART (s)", ylabel="at the goal here (s)")
        axis.set_title(f"{len(ours)} robots, correlation {compared(ours, theirs)['pearson']:.4f}", fontsize=10)
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(out, dpi=150)


if __name__ == "__main__":
    main()
