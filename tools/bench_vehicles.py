"""Measures how much longer it takes to plan for vehicles that cannot turn in place than for robots that can.

    tools/bench_vehicles.py [--robots N ...] [--planner NAME ...] [--map NAME ...] [--vehicle NAME ...] [--seeds N] [--first SEED]

The same starts and goals, the same roads: warehouse and plant that come with the program, and drawn squares of 12 x 12. `cart` turns in
place, `tricycle` may reverse, `car` may not, `tugger` has a trailer, for which there is room at all starts and goals then. Lanes are as
long as the largest of them needs. CPU seconds are medians over the seeds that both solved, of the least of three, after one plan on the
same map, which makes the tables of the map: `first_s` is that plan's. Every plan is judged.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from statistics import median

import bench
import numpy as np

TOOLS = Path(__file__).resolve().parent


def arguments(parser: argparse.ArgumentParser) -> None:
    """See the module."""
    parser.add_argument("--robots", type=int, nargs="+", default=[10, 30])
    parser.add_argument("--planner", nargs="+", default=["lacam", "eecbs", "continuous"])
    parser.add_argument("--map", nargs="+", default=["warehouse", "plant", "squares"])
    parser.add_argument("--vehicle", nargs="+", default=["tricycle", "car"])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=0, metavar="SEED")
    parser.add_argument("--time-limit", type=float, default=10.0, metavar="S")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each map, planner and number of robots."""
    from mrp_sumo.core.fleet import fleet_of
    from mrp_sumo.core.problem import Problem
    from mrp_sumo.core.robot_type import RobotType, Trailer, Wheels
    from mrp_sumo.maps.catalogue import bundled_maps
    from mrp_sumo.maps.load import load_map
    from mrp_sumo.maps.repair import join_short
    from mrp_sumo.maps.roadmap import cell_that_fits, cut_lanes
    from mrp_sumo.planning.answers import planned_by
    from mrp_sumo.planning.registry import planner
    from mrp_sumo.traffic.draw import uniform_draw
    from mrp_sumo.traffic.referee import judge
    from tests.vehicles import squares

    figures = {"length_m": 0.4, "width_m": 0.3, "max_speed_mps": 1.0, "accel_mps2": 0.5, "decel_mps2": 0.5, "gap_m": 0.1}
    wheels = {"wheelbase_m": 0.2, "steering_max_rad": 1.1}
    types = [
        RobotType("cart", turn_rate_rad_s=1.5, **figures),
        RobotType("tricycle", kinematics=Wheels(kind="tricycle", reverse=True, **wheels), **figures),
        RobotType("car", kinematics=Wheels(kind="ackermann", **wheels), **figures),
        RobotType(
            "tugger",
            kinematics=Wheels(kind="tugger", wheelbase_m=0.2, steering_max_rad=0.45),
            trailers=(Trailer(length_m=0.3, hitch_m=0.15),),
            **figures,
        ),
    ]
    types = [each for each in types if each.name in ("cart", *options.vehicle)]
    step_m = max(fleet_of(each, 1).separation_m for each in types)
    tugger = next((each for each in types if each.trailers), None)
    graphs = {}
    for name in options.map:
        if name != "squares":
            nav, _ = join_short(load_map(bundled_maps()[name]).nav, step_m)
            cell_m = cell_that_fits(nav.length_m[nav.length_m >= step_m], step_m)
        graphs[name] = squares(12, step_m) if name == "squares" else cut_lanes(nav, cell_m)
    for where, graph in graphs.items():
        for name in options.planner:
            chosen = planner(name, {})
            chosen.prepare()
            for count in options.robots:
                taken: dict[str, dict[int, float]] = {}
                for each in types:
                    for seed in range(options.first, options.first + options.seeds):
                        start, goal = uniform_draw(graph, count, seed, vehicle=tugger)
                        problem = Problem(
                            graph,
                            fleet_of(replace(each), count),
                            start,
                            goal,
                            np.arange(count),
                            2 * graph.cell_m + 1.5,
                            seed,
                            drivable=True,
                        )
                        if seed == options.first:
                            _, first_s, _ = bench.timed(lambda: planned_by(chosen, problem, options.time_limit))  # noqa: B023 it is called at once
                            taken.setdefault(f"{each.name}_first", {})[0] = first_s
                        answers = [bench.timed(lambda: planned_by(chosen, problem, options.time_limit)) for _ in range(3)]  # noqa: B023 it is called at once
                        result, cpu_s, _ = min(answers, key=lambda answer: answer[1])
                        if result.plan is not None:
                            assert judge(problem, result.plan, in_seconds="seconds" in chosen.supports).valid
                            taken.setdefault(each.name, {})[seed] = cpu_s
                row: bench.Row = {"map": where, "planner": name, "robots": count}
                for vehicle in options.vehicle:
                    both = sorted(taken.get("cart", {}).keys() & taken.get(vehicle, {}).keys())
                    mine, theirs = (median([taken[kind][seed] for seed in both] or [np.nan]) for kind in (vehicle, "cart"))
                    row |= {
                        f"{vehicle}_solved": len(taken.get(vehicle, {})),
                        f"{vehicle}_cpu_s": round(mine, 4),
                        f"{vehicle}_ratio": round(mine / theirs, 2),
                    }
                    row |= {f"{vehicle}_first_s": round(taken[f"{vehicle}_first"][0], 3)}
                yield row | {"cart_solved": len(taken.get("cart", {})), "cart_first_s": round(taken["cart_first"][0], 3)}


if __name__ == "__main__":
    sys.path.insert(0, str(TOOLS.parent))
    sys.exit(bench.main(__file__))
