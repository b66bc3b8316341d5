"""Commands that a workbench starts: each is a `mrp-sumo` in a process of its own, which is watched, shown and ended.

A command works in the folder and writes there what it would write from a terminal; ended with the workbench, it is killed with all that
came of it.
"""

import json
import math
import os
import re
import shlex
import subprocess
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import IO, Any

from mrp_sumo.core.children import command, kill_family
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.kernels import stored_kernels

START = "mrp_sumo.cli.start:main"
ADDRESS = re.compile(r"http://127\.0\.0\.1:(\d+)/([\w-]+)/")
MOST_AT_A_TIME = 2
MOST_KEPT = 50
LAST_BYTES = 4000
NO_BROWSER = {"BROWSER": "true"}  # what Python opens pages with: a program that does nothing


class Job:
    """A command under way, or ended."""

    def __init__(self, number: int, words: Sequence[str], folder: Path, out: str) -> None:
        self.number, self.words, self.out = number, tuple(words), out
        self.is_stopped = False
        self._started, self._seconds = time.monotonic(), math.nan  # until it was seen to have ended
        self._stored, self._compiled = stored_kernels()[0], 0
        self._output: tuple[IO[bytes], IO[bytes]] = (tempfile.TemporaryFile(), tempfile.TemporaryFile())  # noqa: SIM115  see `forget`
        self._process = subprocess.Popen(
            command(START, *words),
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=self._output[0],
            stderr=self._output[1],
            start_new_session=True,
            env={**os.environ, **NO_BROWSER, "PYTHONUNBUFFERED": "1", "COLUMNS": "120"},
        )

    @property
    def state(self) -> str:
        code = self._process.poll()
        if code is None:
            return "running"
        return "stopped" if self.is_stopped else "done" if code == 0 else "failed"

    @property
    def address(self) -> str:
        """The address of its live view, '' where it has none."""
        match = ADDRESS.search(self.text())
        return match[0] if match and self.state == "running" else ""

    def text(self, number: int = 0) -> str:
        """The text that it has printed, 0, or reported, 1."""
        file = self._output[number]
        size = os.fstat(file.fileno()).st_size
        start = max(0, size - 2_000_000 if number == 0 else size - LAST_BYTES)
        return os.pread(file.fileno(), size - start, start).decode(errors="replace")

    def document(self) -> dict[str, Any]:
        state = self.state
        stored, needed = stored_kernels()
        if state == "running" or math.isnan(self._seconds):
            self._seconds, self._compiled = time.monotonic() - self._started, max(0, stored - self._stored)
        answer = None
        if state != "running":
            with suppress(ValueError):
                answer = json.loads(self.text()[self.text().find("{") :]) if "--json" in self.words else None
        return {
            "number": self.number,
            "command": shlex.join(["mrp-sumo", *self.words]),
            "what": self.words[0],
            "out": self.out,
            "state": state,
            "code": self._process.poll(),
            "reported": [line.split("\r")[-1] for line in self.text(1).splitlines() if line.strip()][-8:],
            "printed": [] if answer is not None else self.text()[-LAST_BYTES:].splitlines()[-20:],
            "answer": answer,
            "live": bool(self.address),
            "seconds": round(self._seconds, 1),
            "compiled": [self._compiled, needed],
        }

    def stop(self) -> None:
        """End it, and all that came of it."""
        if self._process.poll() is None:
            self.is_stopped = True
            kill_family(self._process.pid)
            self._process.wait()

    def forget(self) -> None:
        """Let go of what it said."""
        for file in self._output:
            file.close()


class Jobs:
    """The commands of a workbench."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._jobs: dict[int, Job] = {}
        self._lock = Lock()
        self._number = 0

    def start(self, words: Sequence[str], out: str) -> Job:
        """Start a command. Raises MrpSumoError while others are under way."""
        with self._lock:
            under_way = [job for job in self._jobs.values() if job.state == "running"]
            if len(under_way) >= MOST_AT_A_TIME:
                raise MrpSumoError(f"{len(under_way)} commands are under way: stop one, or wait for it")
            self._number += 1
            job = self._jobs[self._number] = Job(self._number, words, self._folder, out)
            for number in list(self._jobs)[:-MOST_KEPT]:
                if self._jobs[number].state != "running":
                    self._jobs.pop(number).forget()
        return job

    def of(self, number: str) -> Job:
        """A command by its number. Raises MrpSumoError for one that is not there."""
        job = self._jobs.get(int(number)) if number.isdecimal() else None
        if job is None:
            raise MrpSumoError(f"no command {number[:20]}")
        return job

    def documents(self) -> list[dict[str, Any]]:
        """All, newest first."""
        return [job.document() for job in reversed(list(self._jobs.values()))]

    def close(self) -> None:
        for job in list(self._jobs.values()):
            job.stop()
            job.forget()
