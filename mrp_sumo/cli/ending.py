"""Signals that end a command: Ctrl-C with exit code 130, SIGTERM with 143. What is under way is kept or removed, temporary files go.

An interrupt that Python could not pass on, since it came within a callback of a library, such as numba's compiler, is sent again.
"""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Timer
from types import FrameType

from mrp_sumo.cli.printing import say

ENDED = "ended by SIGTERM"
AGAIN_S = 0.05  # by then a callback is over


@dataclass
class StopRequest:
    """End of a command with many runs, as signals ask for it: 0 not yet, 1 after the runs under way, 2 now."""

    num_signals: int = 0
    exit_code: int = 0  # of the last signal

    def __call__(self) -> int:
        return min(self.num_signals, 2)

    def note(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        self.num_signals += 1
        self.exit_code = 128 + number
        if self.num_signals == 1:
            say("", "mrp-sumo: ending after the runs under way; once more to stop now", to_stderr=True)


@contextmanager
def stoppable() -> Iterator[StopRequest]:
    """Ctrl-C or SIGTERM once: finish what runs; twice: stop now."""
    stop = StopRequest()
    before = {number: signal.signal(number, stop.note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def until_ctrl_c() -> Iterator[None]:
    """Ctrl-C ends the block and nothing else; SIGTERM ends the command."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        if exit_code(interrupt) != 128 + signal.SIGINT:
            raise
        say("")


@dataclass
class _Lost:
    """The interrupt that was lost last, and the timer that sends it again."""

    interrupt: KeyboardInterrupt | None = None
    timer: Timer | None = None


_lost = _Lost()


def heed_signals() -> None:
    """Let SIGTERM end this process as Ctrl-C does, and let neither be lost."""
    signal.signal(signal.SIGTERM, _end)
    sys.unraisablehook = _note_lost


def without_loss(command: Callable[[], int]) -> int:
    """The exit code of a command; what fails since an interrupt was lost ends as that interrupt does."""
    try:
        return command()
    except Exception:
        if _lost.interrupt:
            raise KeyboardInterrupt(*_lost.interrupt.args) from None
        raise
    finally:
        if _lost.timer:
            _lost.timer.cancel()


def exit_code(interrupt: KeyboardInterrupt) -> int:
    """128 and the number of the signal, as shells have it."""
    return 128 + (signal.SIGTERM if str(interrupt) == ENDED else signal.SIGINT)


def _end(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt(ENDED)


def _note_lost(unraisable: "sys.UnraisableHookArgs") -> None:
    if not isinstance(unraisable.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(unraisable)
        return
    _lost.interrupt = unraisable.exc_value
    _lost.timer = Timer(AGAIN_S, os.kill, (os.getpid(), exit_code(unraisable.exc_value) - 128))
    _lost.timer.daemon = True
    _lost.timer.start()
