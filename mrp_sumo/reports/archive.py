"""Run folders and replay pages of a batch's worst runs: DIR/kept/KEY, where `mrp-sumo report` finds them.

A batch keeps figures, not logs. Runs are made again here, which gives the same run: results do not depend
on when and where it is made, but for planners that use up their time limit. Refuses nothing; what cannot be
kept is told.
"""

from collections.abc import Callable
from pathlib import Path

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.batch import GO_ON, NOW, Batch, job_of
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.processes import Processes
from mrp_sumo.experiments.worker import BAD_INPUT, Answer, Job, failure
from mrp_sumo.io.results import Record, records_in

KEPT = "kept"
REPLAY = "replay.html"


def worst(batch: Batch, count: int) -> list[Record]:
    """Records of the driven runs that did not succeed, then of those that were blocked longest."""
    driven = [r for r in records_in(batch.folder, lambda line: None) if r["metrics"].get("time_blocked_total_s") is not None]
    ours = [r for r in driven if r["key"] in batch.status]
    return sorted(ours, key=lambda r: (r["success"], -r["metrics"]["time_blocked_total_s"], r["key"]))[:count]


def keep_worst(batch: Batch, count: int, told: Callable[[str], None], *, workers: int, stop: Callable[[], int] = lambda: GO_ON) -> int:
    """Make the worst runs of a batch again, with run folder and replay page; those that are there stay.

    Parameters
    ----------
    batch
        A batch whose runs have ended.
    count
        How many.
    told
        Called with a line about each run that could not be kept, or ended otherwise than before.
    workers
        Processes on this machine.
    stop
        As for `run_batch`.

    Returns
    -------
    int
        How many of them are kept.
    """
    chosen = {record["key"]: record for record in worst(batch, count)}
    places = {key: (batch.folder / KEPT / key).resolve() for key in chosen}
    todo = [run for run in batch.runs if run.key in chosen and not (places[run.key] / REPLAY).is_file()]
    num_kept = len(chosen) - len(todo)
    if not todo:
        return num_kept
    makers = Processes(min(workers, len(todo)), f"{__name__}:make_kept")
    try:
        while (todo or makers.running) and stop() != NOW:
            while todo and makers.free and stop() == GO_ON:
                run = todo.pop(0)
                makers.submit({**job_of(batch, run), "kept": str(places[run.key])})
            if not makers.running:
                break
            for job, answer in makers.wait(0.2):
                key, before = job["key"], chosen[job["key"]]["status"]
                if not (places[key] / REPLAY).is_file():
                    told(f"{key}: cannot be kept: {answer['reason']}")
                    continue
                num_kept += 1
                if answer["status"] != before:
                    told(f"{key}: ended as {answer['status']}, in the batch as {before}")
    finally:
        makers.close()
    return num_kept


def make_kept(job: Job, maps: MapCache) -> Answer:
    """Make a run with its run folder and replay page. Called in worker processes."""
    from mrp_sumo.experiments.run import run_scenario
    from mrp_sumo.experiments.worker import scenario_of
    from mrp_sumo.reports.replay.page import write_replay

    place = Path(job["kept"])
    try:
        result = run_scenario(scenario_of(job), place)
        write_replay(place)
    except MrpSumoError as error:
        return failure(BAD_INPUT, "; ".join(str(error).splitlines()))
    return {"status": result.status, "success": result.status == "completed", "reason": result.note, "metrics": {}}
