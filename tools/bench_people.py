#!/usr/bin/env python3
"""Robots among people: how many times real time a run is simulated, in CPU seconds, with people and without.

    python tools/bench_people.py [--map airport] [--robots 50] [--people 200] [--seconds 120] [--engine sumo] [--seed 0] [--json]

The loop's CPU time, as `result.json` has it: planning, reading the map and logs are left out, the people's own time is in. A row for the
run without people, one with them, and one with them and without robots' fields.
"""

import argparse
import json
from pathlib import Path

from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.io.scenario.read import scenario_of


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--map", default="airport")
    options.add_argument("--robots", type=int, default=50)
    options.add_argument("--people", type=int, default=200)
    options.add_argument("--seconds", type=float, default=120.0, help="simulated")
    options.add_argument("--engine", default="sumo")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--json", action="store_true", help="a line of JSON per row")
    chosen = options.parse_args()
    if not chosen.json:
        print(f"{chosen.map}, {chosen.robots} robots, {chosen.engine}\n")
        print("| people | fields | simulated | CPU | x real time | stops | contacts |")
        print("|---|---|---|---|---|---|---|")
    with MapCache() as maps:
        for count, fields in ((0, {}), (chosen.people, {}), (chosen.people, {"active": False})):
            document = {
                "map": chosen.map,
                "robots": {"count": chosen.robots, "draw": "anywhere"},
                "planner": "lacam",
                "seed": chosen.seed,
                "execution": {"engine": chosen.engine, "time_limit_s": chosen.seconds},
                "record": {"bag": False},
                "people": {"count": count, "fields": fields} if count else None,
            }
            result = carry_out(scenario_of(document, Path(), "bench"), maps)
            metrics, execution = result.metrics, result.execution
            if execution is None:
                raise SystemExit(f"{result.status}: {result.note}")
            log = execution.people
            row = {
                "people": count,
                "fields": "" if not count else "off" if fields else "on",
                "simulated_s": metrics["sim_time_s"],
                "cpu_s": round(metrics["cpu_time_s"], 2),
                "times_real_time": round(metrics["sim_time_s"] / metrics["cpu_time_s"], 1),
                "stops": len(log.stop_s) if log else 0,
                "contacts": metrics["num_person_contacts"] or 0,
            }
            cells = [f"{row['simulated_s']:g} s", f"{row['cpu_s']} s", row["times_real_time"], row["stops"], row["contacts"]]
            print(json.dumps(row) if chosen.json else f"| {count} | {row['fields']} | {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    main()
