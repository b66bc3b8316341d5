"""Digests of what runs write, so that a change of the code can be shown to change no byte.

    python tools/digests.py OUT.json                       the bundled scenarios with all planners, runs with work, and disturbed runs
    python tools/digests.py OUT.json --maps DIR [DIR ...]  runs on 30 maps below each DIR too (*.building.yaml), grid and roadmap
    python tools/digests.py OUT.json --only disturbed      those whose name begins so
    python tools/digests.py OUT.json --processes 2
    python tools/digests.py --compare BEFORE.json AFTER.json

Runs are made by the command line alone, in spawned processes, with the package that Python finds first: with PYTHONPATH set to
another checkout, another version's. Digests are those of the run folders: SHA-256 of the plan, the tables, the events and the bag.
Planners that work until the clock stops them are given as much as they can use.
"""

import argparse
import contextlib
import io
import json
import multiprocessing
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

SCENARIOS = Path(__file__).resolve().parents[1] / "scenarios"
BUNDLED = ("office_5", "office_9", "warehouse_5", "warehouse_9", "airport_5", "airport_9")
PLANNERS = ("astar", "prioritised", "cbs", "ecbs", "eecbs", "cbs_ta", "ecbs_ta", "pibt", "lacam", "lns2")
POLICIES = ("adg", "adg_timed", "timed", "open_loop")
NUM_CORPUS, NUM_DISTURBED = 30, 30
WORK_S = 240  # simulated, of each run with work
FILES = ("plan.json", "events.jsonl")  # and tables, and the bag

Run = tuple[str, dict[str, Any]]  # name, scenario


def bundled_runs() -> Iterator[Run]:
    """Six scenarios, ten planners."""
    for scenario in BUNDLED:
        map_, count = scenario.split("_")
        for planner in PLANNERS:
            robots = {"count": int(count), "draw": "mrp_bench"}
            what = {"map": map_, "robots": robots, "seed": 3000, "planner": planner, "execution": {"time_limit_s": 300}}
            yield f"bundled {scenario} {planner}", what


def work_runs() -> Iterator[Run]:
    """Bundled scenarios with orders, lifts, doors, people and mixed fleets, shortened, with two planners and both engines."""
    for path in sorted(SCENARIOS.glob("*.yaml")):
        scenario = yaml.safe_load(path.read_text())
        if not any(key in scenario for key in ("tasks", "people")) and "doors" not in scenario.get("execution", {}):
            continue
        if isinstance(scenario["map"], str) and (file := path.parent / scenario["map"]).is_file():
            scenario["map"] = str(file.resolve())
        for planner, engine in (("prioritised", "sumo"), ("lacam", "kinematic")):
            execution = {**scenario.get("execution", {}), "time_limit_s": WORK_S, "engine": engine}
            yield f"work {path.stem} {planner}", {**scenario, "planner": planner, "execution": execution}


def corpus_runs(folder: Path) -> Iterator[Run]:
    """Each map below a folder as a grid and as a roadmap, other planners and policies in turn."""
    maps = [path for path in sorted(folder.rglob("*.building.yaml")) if "mergeconflict" not in path.name]
    cases = [(path, kind) for path in maps for kind in ("grid", "roadmap")]
    step = max(1, len(cases) // NUM_CORPUS)
    for i, (path, kind) in enumerate(cases[::step][:NUM_CORPUS]):
        yield (
            f"{folder.name} {path.relative_to(folder)} {kind}",
            {
                "map": {"file": str(path.resolve()), "graph": "all"},
                "discretisation": {"kind": kind, "cell_m": 0.5},
                "robots": {"count": 2 + i % 5},
                "seed": i,
                "planner": PLANNERS[i % len(PLANNERS)],
                "execution": {"policy": POLICIES[i % len(POLICIES)], "time_limit_s": 120},
            },
        )


def disturbed_runs() -> Iterator[Run]:
    """All policies, every kind of disturbance, with and without recovery."""
    noise = {"speed_spread": 0.08, "speed_noise": 0.1, "stops_per_s": 0.02}
    kinds: tuple[dict[str, Any], ...] = (
        noise,
        {"start_delay_s": 5.0, "delay_probability": 0.05},
        {"latency_s": 0.5, "message_loss": 0.2, **noise},
        {"localisation_m": 0.05, "localisation_rad": 0.05, "localisation_tau_s": 1.0},
        {"breakdowns": [{"robot": 2, "begin_s": 15.0, "duration_s": 400.0}]},
        {"obstacles": [{"x_m": 6.0, "y_m": -5.0, "begin_s": 5.0, "duration_s": 30.0, "radius_m": 0.6}], **noise},
    )
    for i in range(NUM_DISTURBED):
        recovers = i % 3 > 0
        yield (
            f"disturbed {i}",
            {
                "map": ("office", "warehouse", "airport")[i % 5 % 3],
                "discretisation": ("grid", "roadmap")[i // 2 % 2],
                "robots": {"count": 9 + 3 * (i % 4)},
                "seed": 100 + i,
                "planner": "astar" if i % 4 == 3 else "ecbs",
                "execution": {
                    "policy": POLICIES[(i + i // 4) % 4],
                    "time_limit_s": 200,
                    "on_deadlock": "resolve" if recovers else "report",
                    "disturbances": kinds[i % len(kinds)],
                },
            },
        )


def digests(run: Run) -> tuple[str, dict[str, str]]:
    """Make one run, and read what its folder says of its files."""
    from mrp_sumo.cli.main import main

    name, scenario = run
    with tempfile.TemporaryDirectory() as scratch:
        file, out = Path(scratch, "scenario.yaml"), Path(scratch, "run")
        file.write_text(json.dumps(scenario))
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            code = main(["run", str(file), "--out", str(out)])
        if code == 2:
            return name, {"refused": said.getvalue().strip().replace(scratch, "")}
        result = json.loads((out / "result.json").read_text())
        hashes = {
            f: result["files"][f]["sha256"][:16]
            for f in sorted(result["files"])
            if f in FILES or f.endswith(".parquet") or f.startswith("bag/")
        }
    return name, {"status": result["status"], **hashes}


def compare(before: Path, after: Path) -> int:
    """Print what differs; how many runs do."""
    one, other = json.loads(before.read_text()), json.loads(after.read_text())
    names = [name for name in one if name in other]
    different = 0
    for name in names:
        keys = sorted(k for k in one[name].keys() | other[name].keys() if one[name].get(k) != other[name].get(k))
        different += bool(keys)
        if keys:
            status = {k: (one[name].get(k), other[name].get(k)) for k in ("status", "refused") if k in keys}
            print(f"{name}: {', '.join(keys)}{f'  {status}' if status else ''}")
    print(f"{len(names)} runs compared, {len(names) - different} the same bytes, {different} different")
    return different


def main() -> int:
    """See the head of the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, nargs="?")
    parser.add_argument("--maps", type=Path, nargs="+", default=[])
    parser.add_argument("--only", default="")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--compare", type=Path, nargs=2)
    options = parser.parse_args()
    if options.compare:
        return int(compare(*options.compare) > 0)
    if options.out is None:
        parser.error("give a file to write, or --compare")
    corpora = [run for folder in options.maps for run in corpus_runs(folder)]
    runs = [*bundled_runs(), *work_runs(), *corpora, *disturbed_runs()]
    runs = [run for run in runs if run[0].startswith(options.only)]
    written = {}
    with multiprocessing.get_context("spawn").Pool(options.processes, maxtasksperchild=40) as pool:
        for i, (name, digest) in enumerate(pool.imap(digests, runs)):
            written[name] = digest
            print(f"{i + 1}/{len(runs)} {name}: {digest.get('status') or digest['refused']}", file=sys.stderr)
    options.out.write_text(json.dumps(written, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
