"""Robots among people: speed of a run, in CPU seconds, with people and without; and people beside recordings of people.

    python tools/bench_people.py [--map airport] [--robots 50] [--people 200] [--seconds 120] [--engine sumo] [--seed 0] [--json]
    python tools/bench_people.py --data DIR [--json]

With --data, of a folder with the recordings that `recordings.py` names: *speed* of a crowd in one direction by its density, as recorded in
HERMES on every second file, on which the figures of a brisk crowd were chosen, and on the others; as Weidmann has it; here in a ring, with
the default and with that crowd. *Flow* through the exits of its corridors, by the same halves. *Gap* that people leave to a golf cart
(CITR): quantiles of the least distance of each person, recorded, and here round the same cart on the same ways. Without --data:

The loop's CPU time, as `result.json` has it: planning, reading the map and logs are left out, the people's own time is in. A row for the
run without people, one with them, and one with them and without robots' fields.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import mean

import bench
import numpy as np
import recordings
from crowds import bottleneck_flow_per_s, flow_per_s, gaps_m, least_gaps_m, ring_speed_mps
from recordings import corridor_m, corridors, exit_m, sightings, speed_mps

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.crowd.options import Group
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.io.scenario.read import scenario_of

DENSITIES = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0)
LEAST_SHARE = 0.25  # of people who walk either way, in recordings of both
BRISK = Group(speed_mps=1.55, spread_mps=0.15, headway_s=0.14, spacing_m=0.77)  # like HERMES; 1.55 m/s is its participants' own


def arguments(parser: argparse.ArgumentParser) -> None:
    """Floor, robots and people."""
    parser.add_argument("--map", default="airport")
    parser.add_argument("--robots", type=int, default=50)
    parser.add_argument("--people", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=120.0, help="simulated")
    parser.add_argument("--engine", default="sumo")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder with recordings of people")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """Recordings; or the run without people, with them, and with them and without robots' fields."""
    if options.data is not None:
        yield from recorded(options.data)
        return
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


def recorded(folder: Path) -> Iterator[bench.Row]:
    """Crowds here beside those of recordings. Raises ValueError for a folder without any."""
    files, encounters = corridors(folder), recordings.encounters(folder)
    if not files and not encounters:
        raise ValueError(f"--data {folder}: no recordings, expected uo-*.txt of HERMES or *_traj_veh_filtered.csv of CITR below it")
    if not files:
        yield {"measure": "speed", "skipped": "no uo-*.txt of HERMES"}
    else:
        yield from _speeds("speed_mps", files)
        if two_way := recordings.two_way_corridors(folder):
            yield from _speeds("two_way_speed_mps", two_way, two_way=True)
        yield from _flows(files)
    if not encounters:
        yield {"measure": "gap", "skipped": "no *_traj_veh_filtered.csv of CITR"}
    for kind, clips in encounters.items():
        yield _gaps(kind, clips)


def _speeds(measure: str, files: Sequence[Path], *, two_way: bool = False) -> Iterator[bench.Row]:
    share = LEAST_SHARE if two_way else 0.0
    chosen, others = (np.concatenate([sightings(file, share) for file in part]) for part in (files[::2], files[1::2]))
    for density in DENSITIES:
        there, at, _ = speed_mps(chosen, density)
        held_out, at_others, _ = speed_mps(others, density)
        brisk = [_ring_mps(each, BRISK, two_way) for each in (at, at_others)]
        yield {
            "measure": measure,
            "at": density,
            "recorded": round(there, 3),
            "held_out": round(held_out, 3),
            "weidmann": round(1.34 * (1 - float(np.exp(-1.913 * (1 / density - 1 / 5.4)))), 3),
            "default": round(_ring_mps(density, Group(), two_way), 3),
            "brisk": round(brisk[1], 3),
            "off_percent": round(100 * (brisk[0] / there - 1), 1),
            "off_held_out_percent": round(100 * (brisk[1] / held_out - 1), 1),
        }


def _ring_mps(density: float, group: Group, two_way: bool) -> float:
    return mean(ring_speed_mps(density, group, two_way=two_way, seed=seed) for seed in range(3))


def _flows(files: Sequence[Path]) -> Iterator[bench.Row]:
    for k, file in enumerate(files):
        if exit_m(file) < corridor_m(file):
            times = recordings.passed_s(file)
            flow = flow_per_s(times, len(times))
            row: bench.Row = {
                "measure": "flow_per_s",
                "at": file.stem,
                "recorded": None if k % 2 else flow,
                "held_out": flow if k % 2 else None,
            }
            for name, group in (("default", Group()), ("brisk", BRISK)):
                drawn = [bottleneck_flow_per_s(corridor_m(file), exit_m(file), group, seed) for seed in range(3)]
                flows = [each for each in drawn if each is not None]
                row[name] = mean(flows) if flows else None
            yield {name: round(cell, 2) if isinstance(cell, float) else cell for name, cell in row.items()}


def _gaps(kind: str, clips: Sequence[tuple[dict[int, FloatArray], FloatArray]]) -> bench.Row:
    there, here = list[float](), list[float]()
    for people, cart in clips:
        for track in people.values():
            at = np.clip(np.searchsorted(cart[:, 0], track[:, 0]), 0, len(cart) - 1)
            there.append(float(gaps_m(track[:, 1:], cart[at, 1:4], *recordings.CART_M).min()))
        here += least_gaps_m(people, cart, recordings.CART_M, recordings.CART_FRAME_S).values()
    quantiles = {
        f"{name}_p{q}_m": round(float(np.percentile(gaps, q)), 2)
        for name, gaps in (("recorded", there), ("here", here))
        for q in (10, 50, 90)
    }
    return {"measure": "gap_m", "at": kind, "people": len(there), **quantiles}


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
