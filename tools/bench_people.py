"""Robots among people: speed of a run, in CPU seconds, with people and without.

    python tools/bench_people.py [--map airport] [--robots 50] [--people 200] [--seconds 120] [--engine sumo] [--seed 0] [--json]

The loop's CPU time, as `result.json` has it: planning, reading the map and logs are left out, the people's own time is in. A row for the
run without people, one with them, and one with them and without robots' fields.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import bench

from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.io.scenario.read import scenario_of


def arguments(parser: argparse.ArgumentParser) -> None:
    """Floor, robots and people."""
    parser.add_argument("--map", default="airport")
    parser.add_argument("--robots", type=int, default=50)
    parser.add_argument("--people", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=120.0, help="simulated")
    parser.add_argument("--engine", default="sumo")
    parser.add_argument("--seed", type=int, default=0)


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """The run without people, with them, and with them and without robots' fields."""
    with MapCache() as maps:
        for count, fields in ((0, {}), (options.people, {}), (options.people, {"active": False})):
            document = {
                "map": options.map,
                "robots": {"count": options.robots, "draw": "anywhere"},
                "planner": "lacam",
                "seed": options.seed,
                "execution": {"engine": options.engine, "time_limit_s": options.seconds},
                "record": {"bag": False},
                "people": {"count": count, "fields": fields} if count else None,
            }
            result = carry_out(scenario_of(document, Path(), "bench"), maps)
            metrics, execution = result.metrics, result.execution
            if execution is None:
                raise ValueError(f"{result.status}: {result.note}")
            log = execution.people
            yield {
                "people": count,
                "fields": "" if not count else "off" if fields else "on",
                "simulated_s": metrics["sim_time_s"],
                "cpu_s": round(metrics["cpu_time_s"], 2),
                "times_real_time": round(metrics["sim_time_s"] / metrics["cpu_time_s"], 1),
                "stops": len(log.stop_s) if log else 0,
                "contacts": metrics["num_person_contacts"] or 0,
            }


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
