"""End of a command by a signal: Ctrl-C with exit code 130, SIGTERM with 143. What is under way is kept or removed, temporary files go."""

import shlex
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from mrp_sumo.cli.printing import say, warn
from mrp_sumo.core.interrupts import exit_code, lost


@dataclass
class StopRequest:
    """End of a command with many runs, as signals ask for it: 0 not yet, 1 after the runs under way, 2 now."""

    num_signals: int = 0
    exit_code: int = 0  # of the last signal

    def __call__(self) -> int:
        return min(self.num_signals, 2)

    def interrupted(self, command_line: Sequence[str], standing: str = "") -> int:
        """Print how to go on; returns the exit code."""
        warn(f"interrupted{standing and f': {standing}'}; to go on: {shlex.join(command_line)}")
        return self.exit_code

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


def without_loss(command: Callable[[], int]) -> int:
    """The exit code of a command; what fails since an interrupt was lost ends as that interrupt does."""
    try:
        return command()
    except Exception:
        if lost.interrupt:
            raise KeyboardInterrupt(*lost.interrupt.args) from None
        raise
    finally:
        if lost.timer:
            lost.timer.cancel()
