"""Making a run or a batch again from what it left behind, and saying what is not the same.

Clocks, machines and versions may differ; everything else, byte for byte, may not.
"""

import json
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrp_sumo.core.execution import RECORDED
from mrp_sumo.errors import MapError, MrpSumoError
from mrp_sumo.experiments.identity import code_version
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import RunOptions, carry_out, run_scenario
from mrp_sumo.files.folders import RESULT
from mrp_sumo.files.reading import shortened
from mrp_sumo.io.documents import Document, validated
from mrp_sumo.io.results import BatchRecord
from mrp_sumo.io.run_folder import files_in, versions
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.maps.catalogue import find_map
from mrp_sumo.metrics.registry import MACHINE_DEPENDENT

CLOCKS = ("versions", "files", "machine")  # of result.json, beside metrics of the machine
OF_CLOCKS = ("_time_s", "cpu_s", "wall_s")  # ends of names of a planner's statistics
CLOCK_LIMITED = ("planning_timed_out", "out_of_time", "out_of_memory")  # statuses that another machine need not come to


@dataclass(frozen=True)
class Reproduction:
    """Outcome of making a run or a batch again."""

    equal: int  # files of a run, runs of a batch
    differences: tuple[str, ...]  # a line each
    causes: tuple[str, ...]  # what may be behind them

    @property
    def same(self) -> bool:
        return not self.differences


def reproduce_run(folder: Path, base: Path) -> Reproduction:
    """Make a run again, in a folder that is removed, and compare it file by file.

    Raises MrpSumoError for a folder that is no run's, and a scenario that cannot be run, such as one whose map is not there.
    """
    before = load_run(folder).result
    for name, about in before.get("files", {"": None}).items():
        if not (isinstance(about, dict) and "sha256" in about):
            raise MrpSumoError(f"{folder}: not a run folder: {RESULT} has no SHA-256 of its file '{name[:40]}'")
    if before.get("policy") == RECORDED:
        raise MrpSumoError(f"{folder}: was read from a log, not driven here: `mrp-sumo import` makes it again")
    scenario = validated(Document(folder / RESULT, before["scenario"], {}), ScenarioModel)
    file = ScenarioFile(scenario, Document(base / RESULT, before["scenario"], {}), {})
    try:
        find_map(scenario.map.file, base)
    except MapError as error:
        raise MrpSumoError(f"{shortened(folder)}: {error}; --base says where the paths of its scenario begin, now {base}") from None
    with tempfile.TemporaryDirectory(prefix="mrp_sumo_") as place:
        again = Path(place) / "run"
        run_scenario(file, again, RunOptions())
        after = json.loads((again / RESULT).read_text())
        digests = {name: about["sha256"] for name, about in files_in(folder).items() if name in before["files"]}
        lines = [f"{name}: was changed after the run" for name, digest in digests.items() if digest != before["files"][name]["sha256"]]
        lines += list(_files_that_differ(before["files"], after["files"], folder, again))
    lines += [f"{RESULT}: {line}" for line in _differences(_without_clocks(before), _without_clocks(after))]
    causes = [
        f"made with {name} {version}, here is {versions()[name]}"
        for name, version in before.get("versions", {}).items()
        if version != versions().get(name, version)
    ]
    if any((result.get("plan") or {}).get("clock_limited") for result in (before, after)):
        causes.append("planning took so much of its time limit that the clock may have shaped the plan; planner.budget counts work instead")
    return Reproduction(len(after["files"]) + 1 - len({line.partition(":")[0] for line in lines}), tuple(lines), tuple(causes))


def reproduce_batch(records: list[BatchRecord], base: Path) -> Reproduction:
    """Make runs of a batch again, one after the other, and compare status and metrics."""
    lines: list[str] = []
    differ, codes = 0, {record["code"] for record in records} - {code_version()}
    with MapCache() as maps:
        for record in records:
            what = Document(base / "suite", record["scenario"], {})
            file = ScenarioFile(validated(what, ScenarioModel), what, {})
            outcome = carry_out(file, maps, RunOptions(execute=record["until"] == "execution"))
            before = {"status": record["status"], **_timeless(record["metrics"])}
            after = {"status": outcome.status, **_timeless(outcome.metrics)}
            differing = list(_differences(before, json.loads(json.dumps(after))))
            lines += [f"{record['key']}: {line}" for line in differing]
            differ += bool(differing)
    causes = [f"made with mrp_sumo {version}, here is {code_version()}" for version in sorted(codes)]
    if any(record["status"] in CLOCK_LIMITED for record in records):
        causes.append("some runs ended with the clock's limit, which another machine or load may not reach")
    return Reproduction(len(records) - differ, tuple(lines), tuple(causes))


def _files_that_differ(before: Mapping[str, Any], after: Mapping[str, Any], old: Path, new: Path) -> Iterator[str]:
    for name in sorted({*before, *after}):
        if name not in after:
            yield f"{name}: is not written any more"
        elif name not in before:
            yield f"{name}: was not written"
        elif before[name]["sha256"] != after[name]["sha256"]:
            yield f"{name}: {_first_difference(old / name, new / name)}"


def _without_clocks(result: dict[str, Any]) -> dict[str, Any]:
    plan = {key: value for key, value in (result.get("plan") or {}).items() if key != "clock_limited"}
    stats = plan.get("stats")
    if isinstance(stats, dict):
        stats = {key: value for key, value in stats.items() if not key.endswith(OF_CLOCKS)}
    same = {key: value for key, value in result.items() if key not in CLOCKS}
    return {**same, "metrics": _timeless(result["metrics"]), "plan": {**plan, "stats": stats}}


def _timeless(metrics: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in metrics.items() if name not in MACHINE_DEPENDENT}


def _differences(before: Any, after: Any, place: str = "") -> Iterator[str]:
    """Where two documents differ, a line each."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in sorted({*before, *after}):
            yield from _differences(before.get(key), after.get(key), f"{place}.{key}" if place else key)
    elif before != after:
        yield f"{place} is {json.dumps(after)[:60]}, was {json.dumps(before)[:60]}"


def _first_difference(old: Path, new: Path) -> str:
    """In words, how the bytes of two files differ: the first value of a table or line of a text, the sizes of others."""
    if not old.is_file():
        return "is missing"
    if old.suffix == ".parquet":
        from mrp_sumo.io.tables import read_table

        a, b = read_table(old).content, read_table(new).content
        if a.column_names != b.column_names or a.num_rows != b.num_rows:
            return f"{a.num_rows} rows of {len(a.column_names)} columns became {b.num_rows} of {len(b.column_names)}"
        for name in a.column_names:
            for row, (x, y) in enumerate(zip(a[name].to_pylist(), b[name].to_pylist())):
                if repr(x) != repr(y):
                    return f"{name} in row {row} is {y}, was {x}"
    if old.suffix in (".json", ".jsonl", ".yaml", ".xml"):
        for number, (x, y) in enumerate(zip(old.read_bytes().splitlines(), new.read_bytes().splitlines()), 1):
            if x != y:
                return f"line {number} differs"
    return f"{old.stat().st_size} bytes became {new.stat().st_size}"
