"""How long reports take, how much memory they need, and how large they are.

    python tools/bench_report.py [--runs 10000] [--json]

Makes up results of the wanted number of runs (three maps, six planners, nine fleets), writes their report in a process of
its own, and prints wall time, CPU time, peak memory and size. --json prints an object a line.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

MAPS = ("office", "warehouse", "airport")
PLANNERS = ("astar", "cbs", "ecbs", "eecbs", "lacam", "pibt")
ROBOTS = (2, 5, 9, 14, 20, 30, 40, 60, 80)


def results(num_runs: int) -> pd.DataFrame:
    """Made-up results as a batch writes them: larger fleets take longer and fail more often."""
    rng = np.random.default_rng(0)
    index = np.arange(num_runs)
    planner, robots = index % len(PLANNERS), np.array(ROBOTS)[index // len(PLANNERS) % len(ROBOTS)]
    map_ = index // (len(PLANNERS) * len(ROBOTS)) % len(MAPS)
    seed = index // (len(PLANNERS) * len(ROBOTS) * len(MAPS))
    planned = rng.random(num_runs) < np.exp(-robots / (60 * (1 + planner)))
    arrived = planned & (rng.random(num_runs) < np.exp(-robots / 300))
    makespan = rng.gamma(9, 3 + map_) + robots / 3
    cost = robots * rng.gamma(9, 2 + map_)

    def where(mask: np.ndarray, values: np.ndarray | float) -> np.ndarray:
        return np.where(mask, values, np.nan)

    return pd.DataFrame(
        {
            "key": [f"{i:016x}" for i in index],
            "status": np.where(arrived, "completed", np.where(planned, "time_limit", "planning_timed_out")),
            "success": arrived,
            "reason": np.where(arrived, "", "not in time"),
            "repeat": 0,
            "seed": seed,
            "map": np.array(MAPS)[map_],
            "discretisation": "grid",
            "discretisation.cell_m": 0.4,
            "robots.count": robots,
            "planner": np.array(PLANNERS)[planner],
            "planner.time_limit_s": 60.0,
            "execution.policy": "adg",
            "execution.time_limit_s": 300.0,
            "num_robots": robots,
            "plan_success": planned,
            "plan_valid": planned & (planner > 0),
            "planning_time_s": np.where(planned, rng.lognormal(-6 + robots / 15, 1), 60.0),
            "makespan_steps": where(planned, np.round(makespan)),
            "cost_steps": where(planned, np.round(cost)),
            "soc_steps": where(planned, np.round(cost) - robots),
            "lower_bound_steps": where(planned, (np.round(cost) - robots) / rng.uniform(1, 1.2, num_runs)),
            "makespan_s": where(planned, 2.4 * makespan),
            "execution_time_s": where(planned, np.where(arrived, 2 * makespan + rng.gamma(2, 2, num_runs), 300.0)),
            "goals_reached": where(planned, np.where(arrived, robots, robots // 2)),
            "time_blocked_total_s": where(planned, rng.gamma(2, 3, num_runs) * robots),
            "min_clearance_m": where(planned, rng.gamma(8, 0.03, num_runs)),
            "num_overlaps": where(planned, 0.0),
            "lateness_mean_s": where(planned, rng.normal(-3, 2, num_runs)),
            "lateness_p95_s": where(planned, rng.normal(2, 2, num_runs)),
            "lateness_max_s": where(planned, rng.normal(6, 3, num_runs)),
            "sim_time_s": where(planned, 2 * makespan),
            "code": "made up",
        }
    )


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, nargs="+", default=[1000, 10_000], metavar="N")
    parser.add_argument("--json", action="store_true", help="an object a line")
    options = parser.parse_args()
    for num_runs in options.runs:
        with tempfile.TemporaryDirectory() as folder:
            table = Path(folder) / "results.parquet"
            results(num_runs).to_parquet(table)
            began, before = time.perf_counter(), os.times()
            code = "import sys; from mrp_sumo.cli.main import main; sys.exit(main(sys.argv[1:]))"
            subprocess.run([sys.executable, "-c", code, "report", str(table)], check=True, stdout=subprocess.DEVNULL)
            wall_s, after = time.perf_counter() - began, os.times()
            report = Path(folder) / "report"
            figures = {
                "runs": num_runs,
                "wall_s": round(wall_s, 2),
                "cpu_s": round(after.children_user + after.children_system - before.children_user - before.children_system, 2),
                "peak_mb": round(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024, 1),
                "page_mb": round((report / "index.html").stat().st_size / 1e6, 2),
                "all_mb": round(sum(p.stat().st_size for p in report.rglob("*") if p.is_file()) / 1e6, 2),
                "figures": len(list((report / "figures").glob("*.svg"))),
            }
        if options.json:
            print(json.dumps(figures), flush=True)
        else:
            print("  ".join(f"{key} {value}" for key, value in figures.items()), flush=True)


if __name__ == "__main__":
    main()
