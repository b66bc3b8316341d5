"""Runs, capacity studies, batches, their workers and Dask schedulers killed at random times: nothing lost or doubled, the same results.

A trial makes a batch of fake runs (tests/fake_runs.py), kills it, one of its workers or its scheduler some times with SIGKILL, and goes on
each time. Local batches also meet power cuts: all their processes are killed, and of the folder only that stays which was synced, by the
strict reading of tests/power_cut.py. At the end the records are those of a batch that nobody disturbed. Runs and studies are real ones,
killed with their workers and begun again; what they write in the end has the bytes of those that nobody disturbed.
"""

import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from typing import Any

from campaigns.driver import Trial
from campaigns.fuzz import LIFELONG, ROBOT
from power_cut import cut

from mrp_sumo.cli.main import main
from mrp_sumo.core.children import kill_family
from mrp_sumo.io.results import CSV, TABLE, records_in, tables_are_whole
from mrp_sumo.maps.generate import GENERATORS

TESTS = Path(__file__).resolve().parents[1]
SUITE = "base: office_5\ngrid_search: {robots.count: [1, 2], seed: 0..19}\n"
NUM_RUNS = 40
MATERIAL = ("small.building.yaml", "lifelong.yaml", "cart.yaml")


COMMANDS = {  # a command that is killed, and what it writes the same each time
    "run": (
        ("run", "lifelong.yaml", "--out", "out"),
        ("plan.json", "trajectory.parquet", "visits.parquet", "tasks.parquet", "events.jsonl"),
    ),
    "capacity": (
        (
            "capacity",
            "lifelong.yaml",
            "--quick",
            "--robots",
            "1..2",
            "--horizon",
            "1min",
            "--budget",
            "30min",
            "--workers",
            "1",
            "--out",
            "out",
        ),
        ("answer.json",),
    ),
}


class Kills:
    """Runs and capacity studies nine times in ten; of batches local workers three times in four, else a Dask cluster."""

    size = None

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._undisturbed: dict[str, tuple[dict[str, bytes], float]] = {}  # what a command writes, and how many seconds it takes

    def trial(self, number: int, folder: Path) -> Trial:
        chance = random.Random(f"{self._seed} {number}")
        if chance.random() < 0.9:
            return self._command(chance.choice(sorted(COMMANDS)), chance, folder)
        (folder / "study.yaml").write_text(SUITE)
        out = folder / "out"
        dask = chance.random() < 0.25
        faults: list[str] = []
        rest: set[str] = set()
        kills = cuts = 0
        wanted = chance.randint(2, 5)
        for _ in range(60):
            with _scheduler(folder, chance.randint(1, 2)) if dask else _nobody() as cluster:
                address, servants = cluster
                batch = _started(folder, "2", *address)
                victim = chance.choice(["batch", "batch", "worker", "scheduler"] if dask else ["batch", "worker", "power"])
                if kills < wanted:
                    with suppress(subprocess.TimeoutExpired):
                        batch.wait(chance.uniform(0.5, 2.5))
                    if batch.poll() is None:
                        kills += _kill(victim, batch, servants, chance)
                with suppress(subprocess.TimeoutExpired):
                    batch.wait(90)
                if batch.poll() is None:
                    faults.append("the batch hangs after a kill")
                _end(batch)
                if victim == "power" and batch.returncode == -signal.SIGKILL and out.is_dir():
                    before = _keys(out)
                    cut(out, folder / "power")
                    cuts += 1
                    if len(lost := before - _keys(out)) > 1:  # one may have been under way
                        faults.append(f"{len(lost)} results were lost in a power cut")
            if batch.returncode != 0 and chance.random() < 0.4:
                _leave_parts(out, chance)
            there = _keys(out)
            if len(lost := rest - there) > (victim == "power"):
                faults.append(f"{len(lost)} results were lost")
            rest = there
            if faults or (batch.returncode == 0 and len(there) == NUM_RUNS and tables_are_whole(out)):
                break
        else:
            faults.append("the batch does not end")
        faults += _faults_of(out)
        kind = "with Dask" if dask else "local workers"
        return Trial(
            f"{kind}, power cuts" if cuts else kind, f"{kills} kills", tuple(faults), "python tests/drive_batch.py study.yaml out 2"
        )

    def _command(self, name: str, chance: random.Random, folder: Path) -> Trial:
        """Kill a command and all its processes some times, let it end, and compare what it wrote."""
        words, files = COMMANDS[name]
        if name not in self._undisturbed:
            whole = _make_lifelong(folder / "undisturbed")
            with chdir(whole), redirect_stdout(StringIO()), redirect_stderr(StringIO()):
                main(words)  # here, so that those to be killed begin with all that it loads
            whole, began = _make_lifelong(folder / "again"), time.monotonic()
            os.waitpid(_forked(words, whole), 0)
            self._undisturbed[name] = {file: (whole / "out" / file).read_bytes() for file in files}, time.monotonic() - began
        expected, took_s = self._undisturbed[name]
        place, kills, faults = _make_lifelong(folder / "killed"), 0, []
        for _ in range(chance.randint(1, 8)):
            pid = _forked(words, place)
            until, ended = time.monotonic() + chance.uniform(0.0, took_s), 0
            while time.monotonic() < until and not ended:
                time.sleep(0.005)
                ended = os.waitpid(pid, os.WNOHANG)[0]
            if not ended:
                kills += 1
                kill_family(pid)
                os.waitpid(pid, 0)
            if name == "run" and (place / "out").is_dir() and not (place / "out" / "result.json").is_file():
                faults.append("half a run folder is left")
        code = os.waitstatus_to_exitcode(os.waitpid(_forked(words, place), 0)[1])
        if code not in (0, 1):
            faults.append(f"exit code {code}")
        faults += [
            f"{file} is not what it is undisturbed"
            for file, data in expected.items()
            if not (place / "out" / file).is_file() or (place / "out" / file).read_bytes() != data
        ]
        faults += [f"left behind: {path.name}" for path in place.iterdir() if path.name not in (*MATERIAL, "out")]
        return Trial(name, f"{kills} kills", tuple(faults), f"mrp-sumo {' '.join(words)}")


def _forked(words: tuple[str, ...], place: Path) -> int:
    """A process of its own that runs a command in a folder, with the libraries and kernels that this one has loaded."""
    if pid := os.fork():
        return pid
    code = 3
    try:
        os.setsid()
        os.chdir(place)
        quiet = os.open(os.devnull, os.O_RDWR)
        for stream in (1, 2):
            os.dup2(quiet, stream)
        code = main(words)
    finally:
        os._exit(code)


def _make_lifelong(folder: Path) -> Path:
    """A folder with a small scenario with work."""
    folder.mkdir()
    GENERATORS["grid"](9).write(folder / "small.building.yaml")
    (folder / "lifelong.yaml").write_text(LIFELONG)
    (folder / "cart.yaml").write_text(ROBOT)
    return folder


def _keys(out: Path) -> set[str]:
    """Of the records that are there."""
    return {record["key"] for record in records_in(out, lambda line: None)}


def _faults_of(out: Path) -> Iterator[str]:
    """Each run once, each with the result that its seed has; nothing half written is left."""
    records = list(records_in(out, lambda line: None))
    keys = [record["key"] for record in records]
    if len(keys) != NUM_RUNS or len(set(keys)) != NUM_RUNS:
        yield f"{len(keys)} records of {len(set(keys))} runs, expected {NUM_RUNS}"
    for record in records:
        seed, count = record["scenario"]["seed"], record["scenario"]["robots"]["count"]
        crashed = record["status"] == "crashed"  # its worker was killed twice
        if not crashed and record["metrics"].get("soc_steps") != 10 * seed + count:
            yield f"{record['key']}: another result: {record['status']}, {record['metrics'].get('soc_steps')}"
    if left := [path.name for path in out.rglob(".*")]:
        yield f"left behind: {left}"
    rows = (out / CSV).read_text().splitlines() if (out / CSV).is_file() else []
    if len(rows) != NUM_RUNS + 1:
        yield f"{CSV} has {len(rows)} lines"


def _leave_parts(out: Path, chance: random.Random) -> None:
    """Files under other names, written in part or not at all."""
    shards = [path for path in (out / "runs").glob("*") if path.is_dir()]
    for _ in range(chance.randint(1, 3)):
        place = chance.choice([out, *shards])
        name = f".77.{chance.choice([TABLE, CSV, 'plan.json'])}" if place == out else f".77.{place.name}{chance.randrange(10**6)}.json"
        (place / name).write_bytes(b'{"crc32":"'[: chance.randrange(11)]) if place.is_dir() else None


def _kill(victim: str, batch: "subprocess.Popen[bytes]", servants: list["subprocess.Popen[bytes]"], chance: random.Random) -> int:
    target = batch.pid
    if victim == "power":
        targets = [*_children(batch.pid), batch.pid]
        for pid in reversed(targets):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        return 1
    if victim == "worker":
        workers = [servant.pid for servant in servants[1:]] or _children(batch.pid)
        if not workers:
            return 0
        target = chance.choice(workers)
    elif victim == "scheduler" and servants:
        target = servants[0].pid
    with suppress(ProcessLookupError):
        os.kill(target, signal.SIGKILL)
    if victim == "scheduler" or (victim == "worker" and servants):
        with suppress(subprocess.TimeoutExpired):
            batch.wait(10)  # it may end by itself, or wait for workers: then it is ended too
        _end(batch)
    return 1


def _children(pid: int) -> list[int]:
    """Processes that a process of ours started."""
    result = []
    with suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            result += [int(child) for child in (task / "children").read_text().split()]
    return result


def _started(folder: Path, *arguments: str) -> "subprocess.Popen[bytes]":
    environment = os.environ | {
        "PYTHONPATH": f"{TESTS}:{TESTS.parent}",
        "FAKE_SLEEP": "0.15",
        "FAKE_NOTES": str(folder),
        "POWER_LOG": str(folder / "power"),
    }
    command = [sys.executable, str(TESTS / "drive_batch.py"), str(folder / "study.yaml"), str(folder / "out"), *arguments]
    with (folder / "batch.err").open("ab") as errors:
        return subprocess.Popen(command, env=environment, stderr=errors)


def _end(process: Any) -> None:
    if process.poll() is None:
        process.kill()
    process.wait()


@contextmanager
def _nobody() -> Iterator[tuple[list[str], list[Any]]]:
    yield [], []


@contextmanager
def _scheduler(folder: Path, num_workers: int) -> Iterator[tuple[list[str], list[Any]]]:
    """A Dask scheduler and its workers, in processes of their own."""
    environment = os.environ | {"PYTHONPATH": f"{TESTS}:{TESTS.parent}", "FAKE_SLEEP": "0.15", "FAKE_NOTES": str(folder)}
    log = folder / "scheduler.log"
    with log.open("wb") as errors:
        command = [sys.executable, "-m", "dask", "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
        servants = [subprocess.Popen(command, env=environment, stderr=errors, cwd=folder)]
        address = ""
        until = time.monotonic() + 30
        while not address and time.monotonic() < until:
            time.sleep(0.1)
            result = re.search(r"tcp://127\.0\.0\.1:\d+", log.read_text())
            address = result[0] if result else ""
        for _ in range(num_workers):
            command = [sys.executable, "-m", "dask", "worker", address, "--nworkers", "1", "--nthreads", "1", "--no-dashboard"]
            command += ["--preload", str(TESTS / "drive_batch.py")]
            servants.append(subprocess.Popen(command, env=environment, stderr=errors, cwd=folder))
        try:
            yield [address], servants
        finally:
            for servant in servants:
                _end(servant)
