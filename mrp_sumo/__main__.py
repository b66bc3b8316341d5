"""`python -P -m mrp_sumo` is the command `mrp-sumo`. Without `-P`, Python itself imports from the current folder before we are asked."""

import atexit
import os
import sys
from contextlib import suppress

from mrp_sumo.cli.start import main


def _leave(codes: list[int]) -> None:
    """End this process: Python would end a module by SIGINT, whatever its exit code, where an interrupt came while it ran a text."""
    if codes:
        with suppress(OSError, ValueError):
            sys.stdout.flush()
        os._exit(codes[0])


if __name__ == "__main__":
    codes: list[int] = []
    atexit.register(_leave, codes)  # first, so that it is called last
    codes.append(main())
    sys.exit(codes[0])
