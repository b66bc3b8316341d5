"""Maps of several levels: runs through lifts that complete, and how far robots are off their plans.

    python tools/bench_levels.py                                  # the bundled hospital, on three levels
    python tools/bench_levels.py --maps FOLDER                    # and every building map in a folder whose levels lifts join
    python tools/bench_levels.py --planners lacam continuous
    python tools/bench_levels.py --mixed                          # fleets of two types, half and half
    python tools/bench_levels.py --engine sumo --json             # a line for each run

Robots start and end anywhere on the roadmap, doors open and close for them, and nothing disturbs them. A robot is off its plan by the most
that any of its visits is early or late.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import bench
import numpy as np
import yaml

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.maps.catalogue import bundled_maps
from mrp_sumo.maps.load import load_map

PLANNERS = ("astar", "prioritised", "cbs", "ecbs", "eecbs", "cbs_ta", "ecbs_ta", "pibt", "lacam", "lns2", "pbs", "continuous", "ccbs")
ROBOTS = (4, 8, 12, 20)
REPAIRS = ({}, {"join_short_m": 0.45}, {"join_short_m": 0.62})  # the first with which robots fit


def files(options: argparse.Namespace) -> Iterator[Path]:
    """Maps with rides."""
    for file in [*bundled_maps().values(), *(sorted(options.maps.rglob("*.building.yaml")) if options.maps else ())]:
        try:
            if load_map(file).nav.is_ride.any():
                yield file
        except MrpSumoError:
            continue


def driven(file: Path, robots: int, seed: int, planner: str, options: argparse.Namespace, maps: MapCache, scratch: Path) -> bench.Row:
    """A run from a scenario of its own; the first in which robots fit."""
    small = {
        "length_m": 0.35,
        "width_m": 0.3,
        "max_speed_mps": 0.5,
        "accel_mps2": 0.8,
        "decel_mps2": 0.8,
        "turn_rate_rad_s": 1.5,
        "gap_m": 0.04,
    }
    fleet = [{"type": "turtlebot3", "count": robots - robots // 2}, {"type": small, "count": robots // 2}]
    name, note = f"{file.parent.name}/{file.name.removesuffix('.building.yaml')}", ""
    about = {"map": name, "planner": planner, "robots": robots, "seed": seed}
    for repairs in REPAIRS:
        scenario = {
            "map": {"file": str(file), **repairs},
            "discretisation": {"kind": "roadmap", "cell_m": 0.6 if options.mixed else 0.4},
            "robots": {"fleet": fleet, "draw": "anywhere"} if options.mixed else {"count": robots, "draw": "anywhere"},
            "assignment": {"mode": "random"},
            "planner": {"name": planner, "time_limit_s": options.time_limit},
            "execution": {"engine": options.engine, "doors": "automatic"},
            "seed": seed,
            "record": {"bag": False},
        }
        path = scratch / "levels.yaml"
        path.write_text(yaml.safe_dump(scenario))
        try:
            result = carry_out(read_scenario(path), maps)
        except MrpSumoError as error:
            note = str(error).splitlines()[0].removeprefix(f"{path.name}:")
            if "not fit" in note or "fits" in note:
                continue
            break
        run, plan = result.execution, result.plan
        off_s = np.nan
        if run is not None and plan is not None:
            off_s = float(np.abs(run.arrived_s - plan.arrive_s).max()) if np.isfinite(run.arrived_s).all() else np.inf
        rides, overlaps = result.metrics["lift_rides"] or 0, result.metrics["num_overlaps"] or 0
        row = about | {"status": result.status, "rides": rides, "overlaps": overlaps, "off_s": round(off_s, 6)}
        return row | {"planning_s": result.solution.planning_time_s, "note": result.note}
    return about | {"status": "refused", "rides": 0, "overlaps": 0, "off_s": np.nan, "planning_s": 0.0, "note": note}


def table(rows: list[bench.Row], key: str) -> str:
    """By map or planner."""
    lines = [
        f"| {key} | runs driven | completed | with overlaps | rides | most off the plan, s | no plan | refused |",
        "|---|" + "---|" * 7,
    ]
    for name in dict.fromkeys(row[key] for row in rows):
        mine = [row for row in rows if row[key] == name]
        drove = [row for row in mine if not np.isnan(row["off_s"])]
        refused = sum(row["status"] == "refused" for row in mine)
        completed, overlaps = sum(row["status"] == "completed" for row in drove), sum(row["overlaps"] > 0 for row in drove)
        off_s = max((row["off_s"] for row in drove), default=np.nan)
        rides = sum(row["rides"] for row in drove)
        without = len(mine) - len(drove) - refused
        lines.append(f"| {name} | {len(drove)} | {completed} | {overlaps} | {rides} | {off_s:.3g} | {without} | {refused} |")
    return "\n".join(lines)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Maps, planners and fleets."""
    parser.add_argument("--maps", type=Path, help="a folder of *.building.yaml")
    parser.add_argument("--planners", nargs="+", default=PLANNERS, metavar="NAME")
    parser.add_argument("--robots", nargs="+", type=int, default=ROBOTS)
    parser.add_argument("--seeds", type=int, default=1, help="draws of each number of robots (default: 1)")
    parser.add_argument("--mixed", action="store_true", help="every other robot is a small AMR")
    parser.add_argument("--engine", choices=("kinematic", "sumo"), default="kinematic")
    parser.add_argument("--time-limit", type=float, default=10.0, metavar="S", help="of each plan (default: 10)")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each run."""
    with MapCache() as maps, tempfile.TemporaryDirectory() as scratch:
        for file in files(options):
            for robots, seed, planner in product(options.robots, range(options.seeds), options.planners):
                yield driven(file, robots, seed, planner, options, maps, Path(scratch))


def summary(rows: list[bench.Row], options: argparse.Namespace) -> str:
    """By map, and by planner."""
    return "\n\n".join(table(rows, key) for key in ("map", "planner"))


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
