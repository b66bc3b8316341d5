"""Run folders and replay pages of a batch's worst runs: DIR/kept/KEY, where `mrp-sumo report` finds them.

A batch keeps figures, not logs, so runs are repeated here. A repeated run is the same run: results depend neither on
time nor on place, except where a planner uses up its time limit. A run that cannot be archived is reported.
"""

import importlib
from collections.abc import Callable
from pathlib import Path

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.batch import GO_ON, NOW, BatchFolder, Making, job_of
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.processes import Processes
from mrp_sumo.experiments.worker import BAD_INPUT, Answer, Job, failure
from mrp_sumo.io.results import BatchRecord, records_in

ARCHIVE = "kept"  # folder of a batch
REPLAY = "replay.html"


def worst(batch: BatchFolder, count: int) -> list[BatchRecord]:
    """Records of the executed runs that did not succeed, then of those that were blocked longest."""
    driven = [r for r in records_in(batch.folder, lambda line: None) if isinstance(r["metrics"].get("time_blocked_total_s"), int | float)]
    ours = [r for r in driven if r["key"] in batch.status]
    return sorted(ours, key=lambda r: (r["success"], -r["metrics"]["time_blocked_total_s"], r["key"]))[:count]


def archive_worst(batch: BatchFolder, count: int, report: Callable[[str], None], making: Making, *, write_page: str) -> int:
    """Repeat the worst runs of a batch that has ended, with run folder and replay page; returns how many of them there are then.

    Runs that are archived already are left alone; processes of this machine repeat the others, within the suite's limits.
    `write_page` is `module:function` that writes REPLAY into a run folder, for worker processes to import. `report` gets a line for each
    run that could not be archived, or ended otherwise than before.
    """
    chosen = {record["key"]: record for record in worst(batch, count)}
    places = {key: (batch.folder / ARCHIVE / key).resolve() for key in chosen}
    if not chosen:
        report("no run was driven, so there is none to keep")
    todo = [run for run in batch.runs if run.key in chosen and not (places[run.key] / REPLAY).is_file()]
    num_archived = len(chosen) - len(todo)
    if not todo:
        return num_archived
    processes = Processes(min(making.workers, len(todo)), f"{__name__}:repeat")
    try:
        while (todo or processes.running) and making.stop() != NOW:
            while todo and processes.free and making.stop() == GO_ON:
                run = todo.pop(0)
                processes.submit({**job_of(batch, run, Making(making.workers)), "archive": str(places[run.key]), "write_page": write_page})
            if not processes.running:
                break
            for job, answer in processes.wait(0.2):
                key, before = job["key"], chosen[job["key"]]["status"]
                if not (places[key] / REPLAY).is_file():
                    report(f"{key}: cannot be kept: {answer['reason']}")
                    continue
                num_archived += 1
                if answer["status"] != before:
                    report(f"{key}: ended as {answer['status']}, in the batch as {before}")
    finally:
        processes.close()
    return num_archived


def repeat(job: Job, maps: MapCache) -> Answer:
    """Repeat a run with its run folder and replay page. Called in worker processes."""
    from mrp_sumo.experiments.run import run_scenario
    from mrp_sumo.experiments.worker import scenario_of

    place = Path(job["archive"])
    module, _, name = job["write_page"].partition(":")
    try:
        result = run_scenario(scenario_of(job), place)
        getattr(importlib.import_module(module), name)(place)
    except MrpSumoError as error:
        return failure(BAD_INPUT, "; ".join(str(error).splitlines()))
    return {"status": result.status, "success": result.status == "completed", "reason": result.note, "metrics": {}}
