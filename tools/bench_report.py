"""Reports of batches: time, memory and size.

    python tools/bench_report.py [--runs 10000] [--json]

Makes up results of the wanted number of runs (three maps, six planners, nine fleets), writes their report in a process of
its own.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import bench
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


def arguments(parser: argparse.ArgumentParser) -> None:
    """Sizes."""
    parser.add_argument("--runs", type=int, nargs="+", default=[1000, 10_000], metavar="N")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each number of runs."""
    for num_runs in options.runs:
        with tempfile.TemporaryDirectory() as folder:
            table, report = Path(folder) / "results.parquet", Path(folder) / "report"
            results(num_runs).to_parquet(table)
            figures = bench.process([*bench.COMMAND, "report", table])
            yield {
                "runs": num_runs,
                **figures,
                "page_mb": (report / "index.html").stat().st_size / 1e6,
                "all_mb": sum(p.stat().st_size for p in report.rglob("*") if p.is_file()) / 1e6,
                "figures": len(list((report / "figures").glob("*.svg"))),
            }


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
