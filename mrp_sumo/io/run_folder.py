"""The run folder: everything one run leaves on disk, written whole or not at all.

It is written under a temporary name beside its place and renamed when complete; `result.json` is its last
file, so its presence means that the run is complete. Replaces run folders only: anything else that is
in the way is refused.
"""

import glob
import hashlib
import json
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version
from typing import TYPE_CHECKING, Any

import numpy as np

from mrp_sumo import __version__
from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import NavGraph
from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.zone_log import ZoneLog
from mrp_sumo.errors import MrpSumoError, sentence
from mrp_sumo.files.folders import RESULT
from mrp_sumo.files.reading import shortened
from mrp_sumo.formats.plan_json import write_plan
from mrp_sumo.io.floor_plan import write_floor
from mrp_sumo.traffic.referee import Conflict, Verdict

if TYPE_CHECKING:  # of scenarios, too: what reads run folders needs no model of them
    from mrp_sumo.io.scenario.model import ScenarioModel
    from mrp_sumo.maps.lifts import Shift

SCHEMA_VERSION = 1  # of it
LIBRARIES = ("libsumo", "numpy", "scipy", "numba", "ortools", "rosbags", "pyarrow")  # libraries that shape results
LISTED_CONFLICTS = 20
FIRST_LOOK = 0.5  # of its time limit: before, no planner does anything that depends on the clock


def check_replaceable(out: Path) -> None:
    """Refuse to replace anything but a run folder.

    Raises MrpSumoError when the place is neither free, nor an empty folder, nor a run folder; or below something that is no folder.
    """
    out = out.resolve()
    if not out.exists():
        above = next(parent for parent in out.parents if parent.exists())
        if not above.is_dir():
            raise MrpSumoError(f"{out}: {above} is not a folder")
        if not os.access(above, os.W_OK):
            raise MrpSumoError(f"{out}: no permission to write in {above}")
        return
    if not out.is_dir():
        raise MrpSumoError(f"{out}: is a file, expected a folder for the run")
    if any(out.iterdir()) and not _is_run(out):
        raise MrpSumoError(f"{out}: is not empty and not a run folder (no {RESULT} of a run), so it is not replaced; choose another place")


@dataclass(frozen=True, eq=False, kw_only=True)
class EndedRun:
    """A run as its folder has it. No plan: no `plan.json`; no execution: no trajectory, events and bag; no tasks: no operations audit."""

    status: str  # how it ended, for machines
    note: str  # and for people
    scenario: "ScenarioModel"  # as it was run, overrides applied
    problem: Problem
    result: PlanResult
    verdict: Verdict | None
    execution: Execution | None
    metrics: Mapping[str, Any]
    audit: Mapping[str, Any] | None
    operations_audit: Mapping[str, Any] | None = None
    error_bands: Mapping[str, Any] | None = None
    lanes: Mapping[str, float] | None = None  # how far robots drove off them
    zones: ZoneLog | None = None  # how occupied they were, where that is known
    nav: NavGraph | None  # the map as drawn
    levels: "Shift | None" = None  # where robots change them, as `Trajectory` has them


def write_run(out: Path, run: EndedRun, write_more: Callable[[Path], None] = lambda folder: None) -> dict[str, Any]:
    """Write the run folder. Raises MrpSumoError when `out` holds something else, or the disk refuses. Nothing half-written stays.

    Parameters
    ----------
    out
        Where; a run folder that is there already is replaced.
    run
        What is written.
    write_more
        Writes what else is to be in the folder that it is called with, such as the map and the bag.

    Returns
    -------
    dict
        What `result.json` holds.
    """
    check_replaceable(out)
    out = out.resolve()
    new = out.parent / f".{out.name}.new-{os.getpid()}"
    _clear_leftovers(out)
    from mrp_sumo.io.logs import ZONES, write_zones

    try:
        new.mkdir(parents=True)
        document = result_document(run)
        _write_evidence(new, run)
        write_more(new)
        if run.zones is not None:
            write_zones(new / ZONES, run.zones)
        document["files"] = files_in(new)
        (new / RESULT).write_text(laid_out(document) + "\n", encoding="utf-8")
        put_in_place(new, out)
    except OSError as error:
        raise MrpSumoError(f"{shortened(out)}: cannot be written: {sentence(error)}") from None
    finally:
        shutil.rmtree(new, ignore_errors=True)
    return document


def result_document(run: EndedRun) -> dict[str, Any]:
    """The content of `result.json` without its list of files."""
    scenario, problem, execution = run.scenario, run.problem, run.execution
    document: dict[str, Any] = plain(
        {
            "schema_version": SCHEMA_VERSION,
            "status": run.status,
            "note": run.note,
            "policy": execution.policy if execution else None,
            "engine": scenario.execution.engine if execution else None,
            "outcome": str(execution.outcome) if execution else None,
            "scenario": scenario.model_dump(mode="json"),
            "seed": scenario.seed,
            "versions": versions(),
            "metrics": run.metrics,
            "audit": run.audit,
            **({} if run.operations_audit is None else {"operations_audit": run.operations_audit}),
            **({} if run.error_bands is None else {"error_bands": run.error_bands}),
            "discretisation": {"kind": problem.graph.kind, "cell_m": problem.graph.cell_m},
            "lanes": run.lanes,
            "plan": _answers(problem, run.result, run.verdict) | {"clock_limited": _clock_limited(scenario, run.result)},
            **_portfolio(scenario, run.result, execution),
            "robots": _robots(problem, execution, has_goals=scenario.tasks is None),
            "findings": list(execution.findings) if execution else [],
        }
    )
    return document


def versions() -> dict[str, str]:
    """Versions of Python, of this package and of the libraries that shape results."""
    versions_of = {"python": python_version(), "mrp_sumo": __version__}
    for name in LIBRARIES:
        try:
            versions_of[name] = version(name)
        except PackageNotFoundError:
            continue
    return versions_of


def plain(value: Any) -> Any:
    """The value in JSON's types: arrays as lists, numbers that are not finite as null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def laid_out(value: Any, depth: int = 0) -> str:
    """JSON with a line for each key and for each object of a list, and arrays of numbers in one line."""
    inner, outer = "\n" + "  " * (depth + 1), "\n" + "  " * depth
    if isinstance(value, dict) and value:
        rows = (f"{json.dumps(key, ensure_ascii=False)}: {laid_out(item, depth + 1)}" for key, item in value.items())
        return "{" + inner + f",{inner}".join(rows) + outer + "}"
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        return "[" + inner + f",{inner}".join(json.dumps(item, ensure_ascii=False, allow_nan=False) for item in value) + outer + "]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def write_trace_files(folder: Path, run: EndedRun) -> None:
    """Write what metrics are computed from into a folder: a run folder without what its map alone gives, and without a bag."""
    document = result_document(run)
    _write_evidence(folder, run)
    document["files"] = {path.name: {} for path in sorted(folder.iterdir())}
    (folder / RESULT).write_text(json.dumps(document, ensure_ascii=False, allow_nan=False), encoding="utf-8")


def _write_evidence(folder: Path, run: EndedRun) -> None:
    """Graphs, fleet, plan and logs."""
    write_floor(folder / "floor.json", run.problem.graph, run.problem.fleet, run.nav)
    if run.result.plan is not None:
        write_plan(folder / "plan.json", run.problem, run.result.plan, has_goals=run.scenario.tasks is None)
    if run.execution is not None:
        from mrp_sumo.io.logs import write_logs

        about = {"scenario": run.scenario.name, "seed": run.scenario.seed, "versions": versions()}
        write_logs(folder, run.problem, run.result.plan, run.execution, run.levels, about)


def _answers(problem: Problem, result: PlanResult, verdict: Verdict | None) -> dict[str, Any]:
    def conflict(c: Conflict) -> dict[str, Any]:
        names, graph = problem.fleet.robot_name, problem.graph
        conflict = {"kind": c.kind, "robots": [names[c.robot], names[c.other]], "vertex": graph.label(c.vertex), "t_s": c.t_s}
        return conflict | ({"next_vertex": graph.label(c.next_vertex)} if c.next_vertex >= 0 else {})

    return {
        "status": str(result.status),
        "message": result.message,
        "stats": dict(result.stats),
        "step_s": problem.step_s,
        "summary": verdict.summary(problem) if verdict else None,
        "faults": list(verdict.faults) if verdict else [],
        "conflicts": [conflict(c) for c in verdict.conflicts[:LISTED_CONFLICTS]] if verdict else [],
    }


def _portfolio(scenario: "ScenarioModel", result: PlanResult, execution: Execution | None) -> dict[str, Any]:
    """Who answered of a portfolio, and why: of the plan, or most often while robots drove. Nothing for other planners."""
    calls = execution.calls if execution else None
    if calls is not None and scenario.planner.name == "auto":
        most = max(calls.plans_of, key=lambda name: (calls.plans_of[name], name), default="")
        return {
            "planner": {
                "chosen": most,
                "why": "most plans while robots drove" if most else "",
                "plans": dict(sorted(calls.plans_of.items())),
            }
        }
    return {"planner": {"chosen": result.chosen, "why": result.why}} if result.chosen else {}


def _clock_limited(scenario: "ScenarioModel", result: PlanResult) -> bool:
    """True if the time limit may have shaped the answer, so that another machine need not give it again."""
    used_s = result.planning_time_s if result.planning_cpu_s is None else result.planning_cpu_s
    if scenario.planner.budget:
        return used_s >= scenario.planner.time_limit_s
    return result.status is Status.TIMED_OUT or used_s >= FIRST_LOOK * scenario.planner.time_limit_s


def _robots(problem: Problem, execution: Execution | None, has_goals: bool) -> list[dict[str, Any]]:
    """Each robot's name, start, goal (None where tasks come instead) and when it came to stand there."""
    graph, goal_s = problem.graph, execution.goal_s.tolist() if execution else [None] * problem.num_robots
    ends = zip(problem.fleet.robot_name, problem.start.tolist(), problem.target.tolist(), goal_s)
    return [{"name": name, "start": graph.label(a), "goal": graph.label(b) if has_goals else None, "goal_s": t} for name, a, b, t in ends]


def files_in(folder: Path) -> dict[str, dict[str, Any]]:
    """Size and SHA-256 of every file, by its path in the folder."""
    files = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        with path.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        files[path.relative_to(folder).as_posix()] = {"bytes": path.stat().st_size, "sha256": digest}
    return files


def _is_run(folder: Path) -> bool:
    try:
        document = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(document, dict) and {"status", "scenario", "metrics"} <= set(document)


def _clear_leftovers(out: Path) -> None:
    """Remove leftovers of processes that were killed while they wrote this folder."""
    for path in out.parent.glob(f".{glob.escape(out.name)}.*-*"):
        kind, _, process = path.name.removeprefix(f".{out.name}.").partition("-")
        if kind not in ("new", "old") or not process.isdecimal() or _is_alive(int(process)):
            continue
        if kind == "old" and not out.exists():  # killed between the two renames: the old run is the last good one
            path.rename(out)
        else:
            shutil.rmtree(path, ignore_errors=True)


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        return True
    return True


def put_in_place(new: Path, out: Path) -> None:
    """Rename `new` to `out`; what was there goes once the new one stands."""
    old = out.parent / f".{out.name}.old-{os.getpid()}"
    if out.exists():
        out.rename(old)
    try:
        new.rename(out)
    except OSError:
        if old.exists():
            old.rename(out)
        raise
    shutil.rmtree(old, ignore_errors=True)
