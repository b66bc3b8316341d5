"""Signals that end a command: each raises a KeyboardInterrupt, and none is lost within a callback of a library.

Where a library in C calls Python, it goes on whatever is raised there. The compiler would go on without the machine code that it asked
for, and crash: a signal within such a callback is sent again when that is over, as is one that was lost in another's.
"""

import os
import signal
import sys
from dataclasses import dataclass
from threading import Timer
from types import FrameType

ENDED = "ended by SIGTERM"
AGAIN_S = 0.05  # by then a callback is over


@dataclass
class Lost:
    """The interrupt that was lost last, and the timer that sends it again."""

    interrupt: KeyboardInterrupt | None = None
    timer: Timer | None = None


lost = Lost()


def heed_signals() -> None:
    """Let SIGTERM end this process as Ctrl-C does, and let neither be lost."""
    signal.signal(signal.SIGTERM, end)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not with `nohup`
        signal.signal(signal.SIGINT, end)
    sys.unraisablehook = _note_lost


def end(number: int, frame: FrameType | None) -> None:
    """Handle a signal: raise an interrupt, at once or when a callback of the compiler is over."""
    interrupt = KeyboardInterrupt(ENDED) if number == signal.SIGTERM else KeyboardInterrupt()
    while frame is not None:
        if frame.f_code.co_name.startswith("_raw_object_cache") and frame.f_globals.get("__name__") == "llvmlite.binding.executionengine":
            _send_again(interrupt)
            return
        frame = frame.f_back
    raise interrupt


def exit_code(interrupt: KeyboardInterrupt) -> int:
    """128 and the number of the signal, as shells have it."""
    return 128 + (signal.SIGTERM if str(interrupt) == ENDED else signal.SIGINT)


def _note_lost(unraisable: "sys.UnraisableHookArgs") -> None:
    if isinstance(unraisable.exc_value, KeyboardInterrupt):
        _send_again(unraisable.exc_value)
    else:
        sys.__unraisablehook__(unraisable)


def _send_again(interrupt: KeyboardInterrupt) -> None:
    lost.interrupt = interrupt
    lost.timer = Timer(AGAIN_S, os.kill, (os.getpid(), exit_code(interrupt) - 128))
    lost.timer.daemon = True
    lost.timer.start()
