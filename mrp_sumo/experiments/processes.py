"""Worker processes of this machine: each makes one run at a time, and is killed with its children when it takes too much.

A worker that dies is replaced; its run ends as `crashed`, with the last line it wrote. A worker serves
many runs, so that libraries and compiled kernels are loaded once.
"""

import json
import os
import signal
import subprocess
import time
from collections import deque
from contextlib import suppress
from multiprocessing.connection import wait
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import IO, Protocol

from mrp_sumo.core import children
from mrp_sumo.errors import BatchError
from mrp_sumo.experiments.worker import CRASHED, OUT_OF_MEMORY, OUT_OF_TIME, Answer, Job, failure, machine

POLL_S = 0.1
SINGLE_THREADED = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class Makers(Protocol):
    """Makers of runs: processes here, or a cluster."""

    @property
    def running(self) -> int:
        """Runs handed over that have not come back."""

    @property
    def free(self) -> int:
        """Number of further runs that can be taken on."""

    def submit(self, job: Job) -> None:
        """Hand over a run."""

    def wait(self, timeout_s: float) -> list[tuple[Job, Answer]]:
        """Runs that have ended; waits for the first. Raises BatchError when runs cannot be made at all."""

    def close(self) -> None:
        """End it, runs under way included."""


class Processes:
    """Worker processes on this machine."""

    def __init__(self, count: int, function: str) -> None:
        self._function = function
        self._queue: deque[Job] = deque()
        self._workers = [_Worker(function) for _ in range(count)]

    @property
    def running(self) -> int:
        return len(self._queue) + sum(worker.job is not None for worker in self._workers)

    @property
    def free(self) -> int:
        return len(self._workers) - self.running

    def submit(self, job: Job) -> None:
        self._queue.append(job)
        self._hand_out()

    def wait(self, timeout_s: float) -> list[tuple[Job, Answer]]:
        until = time.monotonic() + timeout_s
        while True:
            ended = []
            heard = wait([w.connection for w in self._workers], min(POLL_S, timeout_s))
            for i, worker in enumerate(self._workers):
                answer = worker.hear() if worker.connection in heard else worker.over_limit()
                if answer is None:
                    continue
                job, worker.job = worker.job, None
                assert job is not None
                again = answer["status"] == OUT_OF_MEMORY and worker.num_runs > 1
                if not worker.alive:
                    self._workers[i] = _Worker(self._function)
                if again:  # what the runs before left behind is not this run's fault
                    self._queue.appendleft(job)
                else:
                    ended.append((job, answer))
            self._hand_out()
            if ended or time.monotonic() >= until or not self.running:
                return ended

    def close(self) -> None:
        for worker in self._workers:
            worker.kill()

    def _hand_out(self) -> None:
        for worker in self._workers:
            if self._queue and worker.ready and worker.job is None:
                worker.take(self._queue.popleft())


class _Worker:
    """A process, the socket to it, and the run it is making."""

    def __init__(self, function: str) -> None:
        self._scratch = TemporaryDirectory(prefix="mrp_sumo_worker_")  # its temporary files go with it, however it ends
        self._log: IO[bytes] = TemporaryFile()  # noqa: SIM115  closed with the worker
        variables = {**dict.fromkeys(SINGLE_THREADED, "1"), "PYTHONUNBUFFERED": "1", "TMPDIR": self._scratch.name}
        self._process, self.connection = children.start(
            "mrp_sumo.experiments.worker:main", function, output=self._log, environment=variables
        )
        self.job: Job | None = None
        self.ready = False
        self.alive = True
        self.num_runs = 0
        self._until = 0.0
        self._began = 0.0

    def take(self, job: Job) -> None:
        """Begin a run."""
        self.job = job
        self.num_runs += 1
        self._began = time.monotonic()
        self._until = self._began + job["wall_s"]
        self._log.seek(0)
        self._log.truncate()
        with suppress(OSError):  # it has died; `hear` will know
            self.connection.send_bytes(json.dumps(job).encode())

    def hear(self) -> Answer | None:
        """Message of the process: the answer of its run, None for being ready."""
        try:
            said = self.connection.recv_bytes()
        except (EOFError, OSError):
            return self._died()
        if said == b"ready":
            self.ready = True
            return None
        return dict(json.loads(said))

    def over_limit(self) -> Answer | None:
        """Kill a run that takes too much; None when it does not."""
        if self.job is None:
            return None
        if time.monotonic() > self._until:
            return self._ended(failure(OUT_OF_TIME, f"killed after {self.job['wall_s']:g} s"))
        limit_mb = self.job["memory_mb"]
        if limit_mb and (used_mb := resident_mb(self._process.pid)) > limit_mb:
            return self._ended(failure(OUT_OF_MEMORY, f"killed at {used_mb:.0f} MB, {limit_mb:g} MB allowed"))
        return None

    def kill(self) -> None:
        """End the process and its children."""
        self.alive = False
        children.kill_family(self._process.pid)  # external planners and plug-ins have sessions of their own
        self._process.wait()
        self.connection.close()
        self._log.close()
        self._scratch.cleanup()

    def _died(self) -> Answer:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(2)  # it closes its socket a moment before it ends
        code = self._process.poll()
        how = "closed its socket" if code is None else f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        if self.job is None:
            line = self._last_line()
            self.kill()
            raise BatchError(f"a worker process cannot start: {line or how}")
        line = self._last_line()
        return self._ended(failure(CRASHED, f"worker {how}{': ' if line else ''}{line}"))

    def _ended(self, answer: Answer) -> Answer:
        took = {"run_wall_s": time.monotonic() - self._began, "run_cpu_s": None, "peak_memory_mb": None}
        self.kill()
        return {**answer, **took, **machine()}

    def _last_line(self) -> str:
        size = self._log.seek(0, os.SEEK_END)
        self._log.seek(max(0, size - 4000))
        lines = self._log.read().decode(errors="replace").split("\n")
        return next((line.strip()[:300] for line in reversed(lines) if line.strip()), "")


def resident_mb(pid: int) -> float:
    """Resident memory of a process and its children, 0 where the system does not tell."""
    total, seen = 0, [pid]
    for process in seen:
        folder = Path("/proc", str(process))
        try:
            total += int((folder / "statm").read_text().split()[1])
            seen += [int(child) for task in (folder / "task").iterdir() for child in (task / "children").read_text().split()]
        except (OSError, IndexError):
            continue
    return total * os.sysconf("SC_PAGESIZE") / 2**20
