"""The process that makes the runs of a batch, one after the other.

Its argument is the function that makes a run. It is handed runs as JSON over the socket that it inherits, answers with JSON, and
ends with its parent. Expected failures of a run are answers like any other; so is an
exception, which is a bug. The parent watches its time and memory.
"""

import base64
import importlib
import json
import os
import platform
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.core.children import connection_to_parent
from mrp_sumo.errors import MrpSumoError, ScenarioError, lack_of_room
from mrp_sumo.experiments.identity import plug_in_hash
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.plugins.trust import trust_everything

if TYPE_CHECKING:
    from mrp_sumo.experiments.result import RunResult
    from mrp_sumo.io.scenario.file import ScenarioFile

Job = dict[str, Any]  # of JSON: key, scenario, until, folder, code, and the limits
Answer = dict[str, Any]  # of JSON: status, success, reason, metrics, what else was observed and its trace, if any, and what the run took
Function = Callable[[Job, MapCache], Answer]

MEASURE = "mrp_sumo.experiments.worker:measure_and_trace"
CRASHED, OUT_OF_TIME, OUT_OF_MEMORY, BAD_INPUT = "crashed", "out_of_time", "out_of_memory", "bad_input"
NO_ROOM = "no_room"  # on the disk: says nothing of the run, and ends its batch


def measure(job: Job, maps: MapCache, observe: "Callable[[RunResult], Any] | None" = None) -> Answer:
    """Make a run as far as its suite says, and measure it; what `observe` makes of a run that was driven is kept beside its metrics."""
    answer, outcome = _made(job, maps)
    return answer if observe is None or outcome is None or not outcome.executed else {**answer, "observed": observe(outcome)}


def measure_and_trace(job: Job, maps: MapCache) -> Answer:
    """Make a run and measure it, with its trace, from which metrics can be computed later."""
    answer, outcome = _made(job, maps)
    trace = outcome.trace if outcome is not None else None
    if trace is None:
        return answer
    return {**answer, "trace": [base64.b64encode(part).decode() for part in (trace.archive, trace.floor)]}


def _made(job: Job, maps: MapCache) -> "tuple[Answer, RunResult | None]":
    from mrp_sumo.experiments.run import RunOptions, carry_out
    from mrp_sumo.metrics.evaluate import succeeded

    file = scenario_of(job)
    try:
        if job["until"] == "map":
            return {"status": "loaded", "success": True, "reason": "", "metrics": _map_facts(file, maps)}, None
        outcome = carry_out(file, maps, RunOptions(execute=job["until"] == "execution"))
        if plug_in_hash(file.scenario, file.folder) != job["plug_ins"]:  # its result would stand under the key of the source before
            return failure(BAD_INPUT, "a plug-in was edited while the batch ran; start the batch again"), None
    except MrpSumoError as error:
        if lack_of_room(error):
            raise
        lines = error.lines if isinstance(error, ScenarioError) else str(error).splitlines()
        return failure(BAD_INPUT, "; ".join(line.removeprefix("suite: ") for line in lines)), None
    success = succeeded(outcome.status, outcome.metrics)
    reason = outcome.note or ("" if success else _without_success(outcome))
    return {"status": outcome.status, "success": success, "reason": reason, "metrics": outcome.metrics}, outcome


def _without_success(outcome: "RunResult") -> str:
    """Reason of a run without a note of its own: faults of its plan, else how many robots came to their goals."""
    verdict, metrics = outcome.solution.verdict, outcome.metrics
    if verdict is not None and not verdict.valid:
        return verdict.summary(outcome.solution.problem)
    reached = metrics.get("goals_reached")
    return "" if reached is None else f"{reached} of {metrics['num_robots']} robots at their goals"


def scenario_of(job: Job) -> "ScenarioFile":
    """The scenario of a run, as if it were a file in the suite's folder."""
    from mrp_sumo.io.documents import Document
    from mrp_sumo.io.scenario.file import ScenarioFile
    from mrp_sumo.io.scenario.model import ScenarioModel

    return ScenarioFile(ScenarioModel.model_validate_json(job["scenario"]), Document(Path(job["folder"], "suite"), {}, {}), {})


def failure(status: str, reason: str) -> Answer:
    """The answer of a run that came to nothing."""
    return {"status": status, "success": False, "reason": reason, "metrics": {}}


@cache
def machine() -> dict[str, str]:
    """Machine on which runs are made."""
    model = platform.processor()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), model)
    except OSError:
        pass
    return {"machine": f"{platform.node()}, {model}, {os.cpu_count()} cores", "python": platform.python_version()}


def _map_facts(file: Any, maps: MapCache) -> dict[str, Any]:
    """What the paper's Table I counts."""
    from mrp_sumo.experiments.staging.choices import choices
    from mrp_sumo.maps.facts import facts

    scenario = file.scenario
    cell_m = scenario.discretisation.cell_m
    models = choices(file)[0]
    drawn = maps.map(scenario.map, file.folder, cell_m, max(model.radius_m for model in models), tuple(each.in_layouts for each in models))
    counted = facts(drawn, cell_m)
    grid = counted["grid"] or {}
    return {
        **{f"num_{name}": counted[name] for name in ("vertices", "edges", "components")},
        **dict(zip(("extent_x_m", "extent_y_m"), counted["extent_m"])),
        **{f"num_cells_{name}": grid.get(name) for name in ("total", "free", "blocked")},
        **{f"grid_{name}_cells": grid.get(name) for name in ("width", "height")},
    }


def main() -> None:
    """Make runs until there are no more."""
    trust_everything()  # the batch that hands out the runs has asked
    connection = connection_to_parent()
    module, _, name = sys.argv[1].partition(":")
    function: Function = getattr(importlib.import_module(module), name)
    connection.send_bytes(b"ready")
    from mrp_sumo.io.run_folder import plain  # with libraries that runs need, too

    with MapCache() as maps:
        while True:
            try:
                job = json.loads(connection.recv_bytes())
            except EOFError:
                return
            connection.send_bytes(json.dumps(plain(_timed(function, job, maps))).encode())


def _timed(function: Function, job: Job, maps: MapCache) -> Answer:
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")  # forgets the peak of memory
    wall, cpu = time.perf_counter(), os.times()
    try:
        answer = function(job, maps)
    except Exception as error:
        traceback.print_exc()  # to the log
        full = lack_of_room(error)
        place = traceback.extract_tb(error.__traceback__)[-1]
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        answer = failure(NO_ROOM, full) if full else failure(CRASHED, f"{reason} ({Path(place.filename).name}, line {place.lineno})")
    took = sum(b - a for a, b in zip(cpu[:4], os.times()[:4]))
    return {**answer, "run_wall_s": time.perf_counter() - wall, "run_cpu_s": took, "peak_memory_mb": _peak_memory_mb(), **machine()}


def _peak_memory_mb() -> float | None:
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM:")), None)
