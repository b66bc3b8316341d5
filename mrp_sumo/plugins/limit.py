"""A time limit for code of plug-ins that runs in our process: map readers, policies and metrics, and all that load.

An alarm ends Python code and waiting. Machine code that never returns to Python is not interrupted, and neither is anything outside the
main thread; planners and assigners run in a process of their own, which is killed.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

LIMIT_S = 600.0  # for a call, or for loading and compiling


class Overran(BaseException):
    """Raised in code that has not ended in time; no Exception, as plug-ins may catch those."""


@contextmanager
def limited() -> Iterator[None]:
    """Raise Overran in the code within after `LIMIT_S` of wall time."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def end(number: int, frame: object) -> NoReturn:
        raise Overran(f"has not ended after {LIMIT_S:g} s")

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
