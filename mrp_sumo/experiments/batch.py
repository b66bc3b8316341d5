"""Batches: the runs of a suite, made by many workers, each result kept the moment it is there.

A batch that was ended by whatever means goes on where it was: a run with a record is done, a run without
one is made. A run that crashed is made again a stated number of times, over all sessions of the batch.
"""

import base64
import fcntl
import json
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path
from typing import IO

from mrp_sumo.errors import BatchError, sentence
from mrp_sumo.experiments.cluster import Cluster
from mrp_sumo.experiments.identity import code_version, library_versions
from mrp_sumo.experiments.processes import Makers, Processes
from mrp_sumo.experiments.suite import PlannedRun, SuiteFile, runs_of
from mrp_sumo.experiments.worker import BAD_INPUT, CRASHED, MEASURE, NO_ROOM, OUT_OF_MEMORY, OUT_OF_TIME, Answer, Job
from mrp_sumo.files.folders import PLAN
from mrp_sumo.files.reading import shortened
from mrp_sumo.files.writing import write_whole
from mrp_sumo.io.results import (
    BatchRecord,
    drop_tables,
    read_plan,
    read_record,
    record_path,
    records_in,
    standings_in,
    tables_are_whole,
    write_record,
    write_tables,
)
from mrp_sumo.io.trace import Trace, write_trace

BROKEN = (CRASHED, OUT_OF_TIME, OUT_OF_MEMORY, BAD_INPUT)  # runs that say nothing about planner or policy
OWN = ("batch.", "runs", "floors", "quarantine", "results.", "kept", "report", ".")  # what a batch without its plan may have left
LONG_DRIVE_S = 1800.0  # wall time for a drive whose limit follows from its plan: hours, simulated
GO_ON, FINISH, NOW = 0, 1, 2  # what `stop` asks for


class Watcher:
    """Callbacks of running batches, which count their runs."""

    num_runs = num_done = 0  # of the batch that is under way
    num_made = num_failed = 0  # since the first

    def begin(self, num_runs: int, num_done: int) -> None:
        """Called before the first run, and when more are known to be wanted."""
        self.num_runs, self.num_done = num_runs, num_done
        self.show()

    def ended(self, record: BatchRecord) -> None:
        """Called when a run has ended and is kept."""
        self.num_done += 1
        self.num_made += 1
        self.num_failed += not record["success"]
        self.show()

    def report(self, line: str) -> None:
        """Called with a line for the user."""

    def show(self) -> None:
        """Called when the counts have changed."""


@dataclass(frozen=True)
class Making:
    """By whom runs are made and within which limits."""

    workers: int  # processes on this machine
    scheduler: str | None = None  # address of a Dask scheduler, whose workers make the runs instead
    retries: int = 1  # how often a run that crashed is tried again
    wall_s: float | None = None  # limits of a run, instead of the suite's
    memory_mb: float | None = None
    stop: Callable[[], int] = lambda: GO_ON  # asked several times a second; FINISH: end after the runs under way, NOW: without them


@dataclass
class BatchFolder:
    """A suite's runs and the folder of their results."""

    file: SuiteFile
    folder: Path
    runs: list[PlannedRun]
    code: str
    status: dict[str, str] = field(default_factory=dict)  # of each run that has a record, by key
    attempts: dict[str, int] = field(default_factory=dict)
    num_foreign: int = 0  # records of runs that the suite does not have

    def todo(self, retries: int) -> list[PlannedRun]:
        """Runs without a record, then those that crashed and may be tried again."""
        fresh = [run for run in self.runs if run.key not in self.status]
        again = [run for run in self.runs if self.status.get(run.key) == CRASHED and self.attempts[run.key] <= retries]
        return fresh + again

    def counts(self) -> Counter[str]:
        """Numbers of runs by how they ended."""
        return Counter(self.status.values())


Lookup = Callable[[str], BatchRecord | None]  # the record of a run by its key, if the run is over
Chooser = Callable[[Lookup], Sequence[PlannedRun]]  # the runs that are wanted, as far as can be said by what is known; those made included


def open_batch(
    file: SuiteFile, folder: Path, report: Callable[[str], None], *, quarantine: bool = False, chosen: bool = False
) -> BatchFolder:
    """Plan a suite and see which of its runs are in the folder already. Programs of users run only with `quarantine`, before a batch.

    With `chosen`, runs are not those of the suite: they are added as they are chosen. Raises MrpSumoError for faults of the suite, and for
    the folder of another suite or of another version of the code.
    """
    batch = BatchFolder(file, folder, [] if chosen else runs_of(file, code_version(), run_programs=quarantine), code_version())
    if folder.exists():
        require_ours(folder, file.name, batch.code)
    keys = {run.key for run in batch.runs}
    for key, status, attempts in standings_in(folder, report, quarantine=quarantine):
        if chosen or key in keys:
            batch.status[key], batch.attempts[key] = status, attempts
        else:
            batch.num_foreign += 1
    return batch


def run_batch(
    file: SuiteFile, folder: Path, watcher: Watcher, making: Making, *, function: str = MEASURE, chooser: Chooser | None = None
) -> BatchFolder:
    """Make all runs of a suite that have no result yet, and the tables of all, by a function `module:name`.

    A chooser says which runs are wanted, instead of the suite: it is called at first, and again whenever a run has ended, until no more
    are. Raises MrpSumoError for a suite, folder or cluster that cannot be used, and when results cannot be written. Results written so far
    stay.
    """
    if folder.exists():  # before there is a lock in a folder of others
        require_ours(folder, file.name, code_version())
    with _locked(folder):
        batch = open_batch(file, folder, watcher.report, quarantine=True, chosen=chooser is not None)
        log = (folder / "batch.log").open("a", encoding="utf-8")
        try:
            if chooser is None or not (folder / PLAN).exists():
                _write_plan(batch)
            if batch.num_foreign:
                watcher.report(f"{folder}: {batch.num_foreign} results are of runs that the suite does not have (any more); left alone")
            todo = deque(batch.todo(making.retries))
            grow = partial(_grow, batch, todo, chooser, making.retries)
            grow()
            watcher.begin(len(batch.runs), len(batch.runs) - len(todo))
            where = f"on {making.scheduler}" if making.scheduler else f"{making.workers} workers"
            _note(log, f"{len(todo)} of {len(batch.runs)} runs to make, {where}, {batch.code}")
            if todo:
                drop_tables(folder)
                makers: Makers = (
                    Cluster(making.scheduler, function)
                    if making.scheduler
                    else Processes(making.workers if chooser else min(making.workers, len(todo)), function)
                )
                try:
                    _make(batch, todo, makers, watcher, log, making, grow)
                finally:
                    makers.close()
            if chooser is not None:
                _write_plan(batch)
            if all(run.key in batch.status for run in batch.runs) and not tables_are_whole(folder):
                write_tables(folder, (read_record(record_path(folder, run.key)) for run in batch.runs))
            _note(log, ", ".join(f"{count} {status}" for status, count in sorted(batch.counts().items())))
        except OSError as error:
            raise BatchError(f"{folder}: {sentence(error)}; {_kept(batch)}") from None
        finally:
            log.close()
    return batch


def summary(batch: BatchFolder) -> str:
    """State of a batch, in a line."""
    counts = batch.counts()
    broken = [f"{counts[status]} {status.replace('_', ' ')}" for status in BROKEN if counts[status]]
    return ", ".join([f"{len(batch.status)} of {len(batch.runs)} runs done", *broken])


def estimate_s(batch: BatchFolder, workers: int, retries: int) -> tuple[float, str]:
    """Roughly how long the rest takes, and where that comes from."""
    todo = batch.todo(retries)
    all_s = (record["run_wall_s"] for record in records_in(batch.folder, lambda line: None))
    known = list(islice((wall_s for wall_s in all_s if wall_s is not None), 1000))
    each = sum(known) / len(known) if known else {"map": 0.1, "plan": 0.2, "execution": 0.6}[batch.file.suite.until]
    source = f"from {len(known)} runs in the folder" if known else "a guess for small maps and few robots"
    return len(todo) * each / workers, source


def _kept(batch: BatchFolder) -> str:
    return f"{len(batch.status)} of {len(batch.runs)} results are kept, start again to go on"


def _make(
    batch: BatchFolder, todo: deque[PlannedRun], makers: Makers, watcher: Watcher, log: IO[str], making: Making, grow: Callable[[], bool]
) -> None:
    """The loop: hand out runs, keep what comes back."""
    stop = making.stop
    under_way: dict[str, PlannedRun] = {}

    def hand_out() -> None:
        for _ in range(makers.free if todo and stop() == GO_ON else 0):
            if todo:
                run = todo.popleft()
                under_way[run.key] = run
                makers.submit(job_of(batch, run, making))

    hand_out()
    while (under_way or todo) and stop() != NOW:
        if stop() == FINISH and not under_way:
            break
        ended = makers.wait(0.2)
        finished = [(under_way.pop(job["key"]), answer) for job, answer in ended]
        hand_out()  # before the results are written: workers need not wait for the disk
        for run, answer in sorted(finished, key=lambda each: bool(each[1]["status"] == NO_ROOM)):
            if answer["status"] == NO_ROOM:
                raise BatchError(f"{batch.folder}: files of a run cannot be written: {answer['reason']}; {_kept(batch)}")
            attempts = batch.attempts.get(run.key, 0) + 1
            record = _record(batch, run, answer, attempts)
            if parts := answer.get("trace"):
                write_trace(batch.folder, run.key, Trace(*(base64.b64decode(part) for part in parts)))
            write_record(batch.folder, record)
            batch.status[run.key], batch.attempts[run.key] = record["status"], attempts
            _note(log, f"{run.key} {record['status']} {record['reason']}")
            if record["status"] == CRASHED and attempts <= making.retries:
                todo.append(run)
            else:
                watcher.ended(record)
        if finished:
            if grow():
                watcher.begin(len(batch.runs), len(batch.runs) - len(todo) - len(under_way))
            hand_out()


def _grow(batch: BatchFolder, todo: deque[PlannedRun], chooser: Chooser | None, retries: int) -> bool:
    """Add the runs that are chosen by what is known. Returns whether there were any."""
    if chooser is None:
        return False

    def again(key: str) -> bool:
        return batch.status[key] == CRASHED and batch.attempts[key] <= retries

    def lookup(key: str) -> BatchRecord | None:
        return read_record(record_path(batch.folder, key)) if key in batch.status and not again(key) else None

    have = {run.key for run in batch.runs}
    more = [run for run in chooser(lookup) if run.key not in have]
    batch.runs += more
    todo.extend(run for run in more if run.key not in batch.status or again(run.key))
    return bool(more)


def job_of(batch: BatchFolder, run: PlannedRun, making: Making) -> Job:
    """A run as it is handed out, with what it may take."""
    scenario, limits = json.loads(run.scenario), batch.file.suite.limits
    driving_s = scenario["execution"]["time_limit_s"] or LONG_DRIVE_S
    generous = 60 + 2 * scenario["planner"]["time_limit_s"] + 2 * driving_s
    return {
        "key": run.key,
        "scenario": run.scenario,
        "repeat": run.repeat,
        "plug_ins": run.plug_ins,
        "until": batch.file.suite.until,
        "folder": str(batch.file.folder),
        "wall_s": making.wall_s or limits.wall_s or generous,
        "memory_mb": making.memory_mb or limits.memory_mb,
    }


def _record(batch: BatchFolder, run: PlannedRun, answer: Answer, attempts: int) -> BatchRecord:
    return {
        "key": run.key,
        "scenario_key": run.scenario_key,
        "status": answer["status"],
        "success": answer["success"],
        "reason": answer["reason"],
        "scenario": json.loads(run.scenario),
        "repeat": run.repeat,
        "until": batch.file.suite.until,
        "metrics": answer["metrics"],
        "code": batch.code,
        **library_versions(),
        "attempts": attempts,
        "ended_at": _now(),
        **{name: answer[name] for name in ("machine", "python", "run_wall_s", "run_cpu_s", "peak_memory_mb")},
        **({"observed": answer["observed"]} if "observed" in answer else {}),
    }


def _write_plan(batch: BatchFolder) -> None:
    suite = batch.file.suite
    plan = {
        "format": 1,
        "suite": batch.file.name,
        "description": suite.description,
        "until": suite.until,
        "code": batch.code,
        "axes": {key: list(values) for key, values in batch.file.axes},
        "repeat": suite.repeat,
        "views": suite.views,
        "keys": [run.key for run in batch.runs],
    }
    data = json.dumps(plan).encode()
    path = batch.folder / PLAN
    if not path.is_file() or path.read_bytes() != data:
        drop_tables(batch.folder)  # they may tell of other runs
        write_whole(path, data)


def require_ours(folder: Path, suite: str, code: str) -> None:
    """Refuse a folder that is there and holds anything but runs of a suite, made by this code."""
    if not folder.is_dir():
        raise BatchError(f"{folder} is not a folder; give another --out")
    if not (folder / PLAN).exists():
        if any(not entry.name.startswith(OWN) for entry in folder.iterdir()):
            raise BatchError(f"{folder}: holds files, but is not the folder of a batch; give another --out")
        return
    plan = read_plan(folder)
    if plan["suite"] != suite:
        raise BatchError(f"{folder}: holds the batch '{plan['suite']}', not '{suite}'; give another --out")
    if plan["code"] != code:
        raise BatchError(f"{folder}: made by mrp_sumo {plan['code']}, this is {code}; give another --out, or go on with that version")


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """One batch a folder at a time; the lock goes with the process, however it ends."""
    try:
        made, was_locked = not folder.exists(), (folder / "batch.lock").exists()
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / "batch.lock").open("a")
    except OSError as error:
        raise BatchError(f"{shortened(folder)}: cannot be written to: {sentence(error)}") from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise BatchError(f"{folder}: another batch is under way there") from None
        try:
            yield
        finally:
            if not was_locked and not (folder / PLAN).exists():  # refused: leave nothing behind
                (folder / "batch.lock").unlink(missing_ok=True)
                if made:
                    (folder / "batch.log").unlink(missing_ok=True)
                    folder.rmdir()


def is_under_way(folder: Path) -> bool:
    """True while a batch is writing to the folder."""
    try:
        with (folder / "batch.lock").open("rb") as lock:  # not to make one
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _now() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


def _note(log: IO[str], line: str) -> None:
    """Append a line with the time."""
    log.write(f"{_now()} {' '.join(line.split())}\n")
    log.flush()
