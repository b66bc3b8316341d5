"""The same scenario gives the same bytes: on 1, 2 and 8 workers, with another hash seed, locale, time zone and kernels cold and
warm, in another folder.

A trial draws a scenario and runs it twice in processes of their own, which differ in all of these but what is compared: the run folder,
but for what clocks and machines say, and the records of a batch.
"""

import hashlib
import json
import os
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import yaml
from campaigns.driver import Trial

from mrp_sumo.drive.policy import policies
from mrp_sumo.io.results import MACHINE_COLUMNS, records_in
from mrp_sumo.maps.generate import GENERATORS
from mrp_sumo.metrics.registry import MACHINE_DEPENDENT

MAP = "small.building.yaml"
PLANNERS = ("astar", "cbs", "ecbs", "pibt", "prioritised")  # which end before their time limit
SURROUNDINGS = (
    {"PYTHONHASHSEED": "1", "LC_ALL": "C", "TZ": "UTC"},
    {"PYTHONHASHSEED": "2", "LC_ALL": "C.UTF-8", "TZ": "Asia/Kolkata"},
    {"PYTHONHASHSEED": "random", "LC_ALL": "tr_TR.UTF-8", "TZ": "America/St_Johns"},
)
COLD_SHARE = 0.02  # of the trials: compiling all kernels takes minutes


class Repeat:
    """Runs and batches by turns."""

    size = None

    def __init__(self, seed: int) -> None:
        self._seed = seed

    def trial(self, number: int, folder: Path) -> Trial:
        chance = random.Random(f"{self._seed} {number}")
        a, b = folder / "a", folder / "b with ü"
        scenario = drawn(chance)
        surroundings = chance.sample(SURROUNDINGS, 2)
        for place in (a, b):
            place.mkdir()
            GENERATORS["grid"](20).write(place / MAP)
        if number % 2:
            return self._run(scenario, a, b, surroundings, cold=chance.random() < COLD_SHARE)
        return self._batch(scenario, a, b, surroundings, chance.sample((1, 2, 8), 2))

    def _run(self, scenario: dict[str, Any], a: Path, b: Path, surroundings: list[dict[str, str]], *, cold: bool) -> Trial:
        for place, context in zip((a, b), surroundings):
            (place / "case.yaml").write_text(yaml.safe_dump(scenario, allow_unicode=True))
            extra = {"NUMBA_CACHE_DIR": str(place / "kernels")} if cold and place == b else {}
            code, error = started(["run", "case.yaml", "--out", "out"], place, context | extra)
            if code not in (0, 1):
                return Trial("run", f"exit code {code}", (f"exit code {code}: {error}",), f"cd '{place.name}' && mrp-sumo run case.yaml")
        first, second = (digests(place / "out") for place in (a, b))
        odd = sorted(name for name in first.keys() | second.keys() if first.get(name) != second.get(name))
        faults = tuple(f"{name} differs" for name in odd)
        return Trial("run, cold kernels" if cold else "run", "same" if not odd else "other", faults, "diff -r a/out 'b with ü/out'")

    def _batch(self, scenario: dict[str, Any], a: Path, b: Path, surroundings: list[dict[str, str]], workers: list[int]) -> Trial:
        suite = {"base": {**scenario, "name": ""}, "grid_search": {"seed": [0, 1, 2], "robots.count": [2, 4]}}
        output = []
        for place, context, count in zip((a, b), surroundings, workers):
            (place / "study.yaml").write_text(yaml.safe_dump(suite, allow_unicode=True))
            code, error = started(["batch", "study.yaml", "--out", "out", "--workers", str(count)], place, context)
            if code != 0:
                return Trial(
                    "batch", f"exit code {code}", (f"exit code {code}: {error}",), f"cd '{place.name}' && mrp-sumo batch study.yaml"
                )
            output.append(records(place / "out"))
        same = output[0] == output[1]
        return Trial("batch", "same" if same else "other", () if same else ("records differ",), "diff -r a/out/runs 'b with ü/out/runs'")


def drawn(chance: random.Random) -> dict[str, Any]:
    """A small scenario with noise."""
    return {
        "name": "night",
        "map": MAP,
        "seed": chance.randrange(1000),
        "robots": {"count": chance.randint(2, 5)},
        "discretisation": {"kind": chance.choice(["grid", "roadmap"])},
        "planner": {"name": chance.choice(PLANNERS), "time_limit_s": 30.0},
        "execution": {
            "policy": chance.choice(policies()),
            "time_limit_s": 90.0,
            "disturbances": {
                "speed_noise": chance.choice([0.0, 0.1]),
                "stops_per_s": chance.choice([0.0, 0.02]),
                "message_loss": chance.choice([0.0, 0.2]),
                "localisation_m": chance.choice([0.0, 0.05]),
                "breakdowns": chance.choice([[], [{"robot": 0, "begin_s": 3.0, "duration_s": 5.0}]]),
            },
        },
        "record": {"storage": chance.choice(["mcap", "sqlite3"])},
    }


def started(command: list[str], folder: Path, surroundings: dict[str, str]) -> tuple[int, str]:
    """Exit code and last words of a command in a process of its own."""
    root = Path(__file__).resolve().parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root), **surroundings}
    done = subprocess.run([sys.executable, "-m", "mrp_sumo", *command], cwd=folder, env=environment, capture_output=True, text=True)
    return done.returncode, done.stderr[-500:]


def digests(folder: Path) -> dict[str, str]:
    """Of each file of a run; what clocks say is left out of result.json."""
    outcome = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            data = path.read_bytes()
            if path.name == "result.json":
                data = json.dumps(without_clocks(json.loads(data)), sort_keys=True).encode()
            outcome[str(path.relative_to(folder))] = hashlib.sha256(data).hexdigest()
    return outcome


def without_clocks(result: dict[str, Any]) -> dict[str, Any]:
    """The result of a run without clocks, versions and machine."""
    metrics = {name: value for name, value in result["metrics"].items() if name not in MACHINE_DEPENDENT}
    clocks = ("metrics", "timing", "files", "machine", "versions", "created", "began_at", "ended_at")
    return {**{key: value for key, value in result.items() if key not in clocks}, "metrics": metrics}


def records(folder: Path) -> dict[str, Any]:
    """What a batch's records say but for clocks and machines, by scenario."""
    outcome = {}
    for record in records_in(folder, print):
        metrics = {name: value for name, value in record["metrics"].items() if name not in MACHINE_DEPENDENT}
        outcome[record["key"]] = {**{k: v for k, v in record.items() if k not in MACHINE_COLUMNS}, "metrics": metrics}
    return outcome
