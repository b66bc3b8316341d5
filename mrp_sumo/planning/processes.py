"""Processes that can be killed with all that came of them: programs of others, and the code of plug-ins.

A plug-in's process loads it, checks its face, and answers one call at a time over a socket. It ends with its parent. Whatever the
plug-in does there (raises, hangs, ends its process), the caller gets an answer, a PlugInError or an Overtime.
"""

import os
import pickle
import select
import signal
import weakref
from collections.abc import Callable, Mapping
from contextlib import suppress
from math import ceil
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from mrp_sumo.core import children
from mrp_sumo.errors import PlugInError
from mrp_sumo.plugins.limit import LIMIT_S
from mrp_sumo.plugins.source import Source, definition, require_source

if TYPE_CHECKING:
    import subprocess
    from multiprocessing.connection import Connection


SHORTEST_S = 0.01  # that is waited for a process at a time


class Overtime(Exception):
    """A call that was not answered within its time; its process was killed."""


class PlugInProcess:
    """A plug-in in a process of its own.

    Raises MrpSumoError for a file that is not trusted, and for parameters that it does not have, and PlugInError when it cannot be loaded
    or made, or lacks what its kind needs.

    Parameters
    ----------
    kind
        Of `plugins.kinds.KINDS`.
    source, parameters
        Which plug-in, and how it is made.
    first
        'load', which makes it, or 'describe', which only says what it is.
    """

    def __init__(self, kind: str, source: Source, parameters: Mapping[str, Any], first: str = "load") -> None:
        require_source(source)
        self._where = definition(source)
        self._process, self._connection = children.start("mrp_sumo.planning.plug_in_process:main", output=2)  # not into our own output
        self.close = weakref.finalize(self, _end, self._process, self._connection)
        self.facts: dict[str, Any] = {}
        self.facts = self.ask(first, (kind, source, dict(parameters)), LIMIT_S)[0]

    @property
    def alive(self) -> bool:
        """True if it can be asked."""
        return self.close.alive and self._process.poll() is None

    def ask(self, call: str, arguments: tuple[Any, ...], limit_s: float) -> tuple[Any, float]:
        """The answer to a call, and how many seconds it took.

        Raises Overtime after the limit and 5 % (at least 0.1 s) on top. The process is dead then. Raises PlugInError, ScenarioError,
        MrpSumoError, MemoryError as the plug-in's process says. The limit counts from when the call has arrived, without the time in which
        its process waited for a processor.
        """
        where = self.facts.get("places", {}).get(call, self._where)
        try:
            self._connection.send((call, *arguments))
            self._connection.recv()  # it has arrived
            if not ends_within(self._process.pid, limit_s + max(0.1, 0.05 * limit_s), self._connection.poll):
                self.close()
                raise Overtime
            answer, error, time_s = self._connection.recv()
        except (EOFError, OSError, pickle.UnpicklingError):
            raise PlugInError(f"{where}: {self._ending()} during {call}()") from None
        if error is not None:
            raise error
        return answer, float(time_s)

    def _ending(self) -> str:
        import subprocess

        with suppress(subprocess.TimeoutExpired):
            self._process.wait(2)  # it closes its socket a moment before it ends
        code = self._process.poll()
        self.close()
        if code is None:
            return "closed its connection"
        return f"its process was killed by {signal.Signals(-code).name}" if code < 0 else f"ended its process with exit code {code}"


def _end(process: "subprocess.Popen[bytes]", connection: "Connection") -> None:
    connection.close()
    if process.poll() is None:
        children.kill_family(process.pid)
        process.wait()


def ends_within(pid: int, limit_s: float, ended: Callable[[float], bool]) -> bool:
    """True if something ends before a process has had its time: wall time, without what its first thread has waited for a processor.

    `ended` waits for so many seconds, and says whether it has ended.
    """
    began_s = perf_counter() - _starved_s(pid)
    while (left_s := limit_s - (perf_counter() - _starved_s(pid) - began_s)) > 0:
        if ended(max(left_s, SHORTEST_S)):
            return True
    return ended(0.0)


def _starved_s(pid: int) -> float:
    """Seconds for which a process's first thread was ready to run and no processor was; 0 where the system does not say."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9
    except (OSError, ValueError, IndexError):
        return 0.0


def await_end(pid: int, limit_s: float) -> bool:
    """True if a child ends within its limit, see `ends_within`. Its end is seen at once, where `Popen.wait` looks every 50 ms."""
    watch = os.pidfd_open(pid)
    try:
        poll = select.poll()
        poll.register(watch, select.POLLIN)
        return ends_within(pid, limit_s, lambda wait_s: bool(poll.poll(ceil(1000 * wait_s))))
    finally:
        os.close(watch)
