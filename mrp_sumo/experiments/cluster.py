"""Runs on an existing Dask cluster. Each thread of a Dask worker keeps a process of its own for runs.

So a run may crash, take too long or too much memory there as here, and the Dask worker lives on. The
machines need the same version of mrp_sumo, and maps that are files at the same path.
"""

import logging
import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any

from mrp_sumo.errors import BatchError
from mrp_sumo.experiments.identity import code_version
from mrp_sumo.experiments.processes import Processes
from mrp_sumo.experiments.worker import CRASHED, Answer, Job, failure, machine

PATIENCE_S = 10.0  # for the scheduler to answer
WITHOUT_WORKERS_S = 60.0  # after which a batch ends
_WRONG_VERSION = "wrong_version"

_here: dict[int, Processes] = {}  # of each thread of a Dask worker


class Cluster:
    """A Dask cluster that makes runs. Raises BatchError when there is no scheduler at the address, or dask.distributed is not installed."""

    def __init__(self, address: str, function: str) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise BatchError("--scheduler needs dask.distributed: pip install 'mrp-sumo[cluster]'") from None
        for name in list(logging.root.manager.loggerDict):  # what goes wrong is reported below, in one line
            if name.startswith("distributed"):
                logging.getLogger(name).setLevel(logging.CRITICAL)
        connect: Any = Client
        try:
            self._client = connect(address, timeout=PATIENCE_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise BatchError(f"no Dask scheduler at '{address}': {_line(error)}") from None
        try:
            self._client.wait_for_workers(1, timeout=PATIENCE_S)
        except TimeoutError:
            self._client.close(timeout=2)
            raise BatchError(f"the Dask scheduler at '{address}' has no workers") from None
        self._address = address
        self._function = function
        self._under_way: dict[Any, Job] = {}
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._count = 0
        self._next_look_s = self._worker_seen_s = monotonic()

    @property
    def running(self) -> int:
        return len(self._under_way)

    @property
    def free(self) -> int:
        with self._answering():
            workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        return 2 * sum(int(worker["nthreads"]) for worker in workers) - self.running  # the next is there when one ends

    def submit(self, job: Job) -> None:
        self._count += 1
        name = f"{job['key']}-{self._count}"
        with self._answering():
            future: Any = self._client.submit(make_here, job, self._function, code_version(), key=name, pure=False)
            self._under_way[name] = job
            future.add_done_callback(self._ended.put)

    def wait(self, timeout_s: float) -> list[tuple[Job, Answer]]:
        ended = []
        with self._answering():
            try:
                ended.append(self._answer(self._ended.get(timeout=timeout_s)))
                while True:
                    ended.append(self._answer(self._ended.get_nowait()))
            except queue.Empty:
                pass
            if not ended and self._client.status != "running":
                raise self._gone()
            if not ended:
                self._require_workers(monotonic())
        return ended

    def _require_workers(self, now_s: float) -> None:
        """Runs of workers that are lost wait for others, which may never come."""
        if now_s < self._next_look_s:
            return
        self._next_look_s = now_s + 1.0
        if self._client.scheduler_info(n_workers=1)["workers"]:
            self._worker_seen_s = now_s
        elif now_s > self._worker_seen_s + WITHOUT_WORKERS_S:
            raise BatchError(f"the Dask scheduler at '{self._address}' has no workers any more; start again to go on")

    def close(self) -> None:
        if self._client.status == "running":
            self._client.run(_close_here)
        self._client.close(timeout=2)

    @contextmanager
    def _answering(self) -> Iterator[None]:
        """Whatever goes wrong in a client without a scheduler: the scheduler is gone."""
        try:
            yield
        except BatchError:
            raise
        except Exception as error:
            if self._client.status == "running" and not isinstance(error, OSError):
                raise
            raise self._gone() from None

    def _gone(self) -> BatchError:
        return BatchError(f"the Dask scheduler at '{self._address}' is gone; start again to go on")

    def _answer(self, future: Any) -> tuple[Job, Answer]:
        job = self._under_way.pop(future.key)
        if future.status == "finished":
            answer: Answer = future.result()
            if answer["status"] == _WRONG_VERSION:
                raise BatchError(answer["reason"])
            return job, answer
        if future.status == "cancelled":
            raise self._gone()
        took = {"run_wall_s": None, "run_cpu_s": None, "peak_memory_mb": None}
        return job, {**failure(CRASHED, f"Dask: {_line(future.exception())}"), **took, **machine()}


def make_here(job: Job, function: str, code: str) -> Answer:
    """Make a run on this thread of a Dask worker."""
    if code != code_version():
        reason = f"{machine()['machine']}: has mrp_sumo {code_version()}, the batch {code}; install the same on all machines"
        return failure(_WRONG_VERSION, reason)
    thread = threading.get_ident()
    if thread not in _here:
        _here[thread] = Processes(1, function)
    _here[thread].submit(job)
    while True:
        if ended := _here[thread].wait(1.0):
            return dict(ended[0][1])


def _close_here() -> None:
    """End the processes of a Dask worker, but for those that make runs of another batch."""
    for thread, process in list(_here.items()):
        if not process.running:
            del _here[thread]
            process.close()


def _line(error: BaseException | None) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
