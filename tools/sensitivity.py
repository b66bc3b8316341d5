#!/usr/bin/env python3
"""How much our headlines depend on what was chosen: length of the step, angle from which robots turn in place, gap that they keep.

    tools/sensitivity.py [--seeds N] [--engine sumo|kinematic] [--json]

The warehouse with nine robots, plans by CBS. *Arrived*: share of runs on a grid in which all robots arrive, driven without the plan's
order and yielding to each other, as in Table III of the MRP-Bench paper. *Driven*: mean makespan with the plan's order kept (adg), on a
grid and on a roadmap. *Off*: the farthest that a driven makespan is from the planned one. *Clearance*: the least between two bodies of
all runs.
"""

import argparse
import json
from statistics import mean
from typing import Any

import mrp_sumo as ms
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive import motion_plan
from mrp_sumo.io.scenario.robots import robot_type
from mrp_sumo.maps.catalogue import bundled_folder

FIRST_SEED = 3000
STEPS_S = (0.05, 0.1, 0.2, 0.5, 1.0)
TURNS_RAD = (0.05, 0.2, 0.5, 1.0)
GAPS_M = (0.05, 0.1, 0.14)
YIELDING = {"policy": "open_loop", "on_deadlock": "resolve", "recovery": {"replanner": None}, "time_limit_s": 300}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10, metavar="N")
    parser.add_argument("--engine", choices=("sumo", "kinematic"), default="sumo")
    parser.add_argument("--json", action="store_true", help="a line a row")
    options = parser.parse_args()
    if not options.json:
        print("| changed | to | arrived % | driven s, grid | driven s, roadmap | off s | clearance m |\n|---|---|---|---|---|---|---|")
    usual = robot_type("turtlebot3", bundled_folder("robots"), bundled_folder("robots"))
    for name, values in (("step_length_s", STEPS_S), ("turn threshold, rad", TURNS_RAD), ("gap_m", GAPS_M)):
        for value in values:
            motion_plan.TURNS_RAD = value if name.startswith("turn") else 0.2
            row = measured(value if name == "step_length_s" else 0.1, value if name == "gap_m" else usual.gap_m, usual, options)
            print(json.dumps({"changed": name, "to": value, **row}) if options.json else line(name, value, row), flush=True)


def measured(step_s: float, gap_m: float, usual: RobotType, options: argparse.Namespace) -> dict[str, float]:
    """The headlines of a setting."""
    shape = {key: getattr(usual, key) for key in ("length_m", "width_m", "max_speed_mps", "accel_mps2", "decel_mps2", "turn_rate_rad_s")}
    result: dict[str, list[Any]] = {"yielding": [], "grid": [], "roadmap": []}
    for seed in range(FIRST_SEED, FIRST_SEED + options.seeds):
        for name, runs in result.items():
            scenario = ms.Scenario(
                map="warehouse",
                discretisation="roadmap" if name == "roadmap" else "grid",
                robots={"count": 9, "draw": "mrp_bench", "type": {**shape, "gap_m": gap_m}},
                seed=seed,
                planner={"name": "cbs", "retime": name != "yielding"},
                execution={"engine": options.engine, "step_length_s": step_s} | (YIELDING if name == "yielding" else {}),
                record={"period_s": step_s},
            )
            runs.append(ms.run(scenario).metrics)
    ordered = [run for name in ("grid", "roadmap") for run in result[name] if run["driven_makespan_s"] is not None]
    return {
        "arrived_percent": 100 * mean(bool(run["all_goals_reached"]) for run in result["yielding"]),
        "grid_s": mean(run["driven_makespan_s"] for run in result["grid"] if run["driven_makespan_s"] is not None),
        "roadmap_s": mean(run["driven_makespan_s"] for run in result["roadmap"] if run["driven_makespan_s"] is not None),
        "off_s": max(abs(run["driven_makespan_s"] - run["makespan_s"]) for run in ordered),
        "clearance_m": min(run["min_clearance_m"] for runs in result.values() for run in runs if run["min_clearance_m"] is not None),
    }


def line(name: str, value: float, row: dict[str, float]) -> str:
    """A row of the table."""
    numbers = (f"{row['arrived_percent']:.0f}", f"{row['grid_s']:.1f}", f"{row['roadmap_s']:.1f}", f"{row['off_s']:.2f}")
    return f"| {name} | {value:g} | {' | '.join(numbers)} | {row['clearance_m']:.3f} |"


if __name__ == "__main__":
    main()
