"""Start of the command `mrp-sumo`: a signal ends it in one line from the first moment, while its libraries are being loaded."""

import os
import signal
from types import FrameType


def main() -> int:
    """Load and run the command line; returns the exit code."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:  # as `nohup` has it
            signal.signal(number, _end)
    from mrp_sumo.cli.main import main as command

    for number, handler in before.items():
        signal.signal(number, handler)
    return command()


def _end(number: int, frame: FrameType | None) -> None:
    """End this process at once: nothing is begun."""
    os.write(2, b"mrp-sumo: ended by SIGTERM\n" if number == signal.SIGTERM else b"mrp-sumo: interrupted\n")
    os._exit(128 + number)
