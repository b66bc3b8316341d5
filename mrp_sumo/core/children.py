"""Python processes of ours, and what they and the command keep out: whatever happens to lie in the current folder.

A process imports from where its parent does. On its own, Python would look in the current folder first, which may be anybody's.
"""

import os
import sys
from contextlib import suppress

CONFIGURATIONS = frozenset({"matplotlibrc", ".numba_config.yaml"})  # that libraries look for in the current folder


def command(call: str, *words: str) -> list[str]:
    """The command of a process that makes a call.

    Parameters
    ----------
    call
        `MODULE:FUNCTION`, which is called without arguments.
    words
        What it has in `sys.argv[1:]`.
    """
    module, _, name = call.partition(":")
    code = f"import sys; sys.path[:] = {sys.path!r}; from mrp_sumo.core.children import read_no_configuration; read_no_configuration(); "
    return [sys.executable, "-P", "-c", f"{code}from {module} import {name}; {name}()", *words]


def leave_current_folder() -> None:
    """Have this process import nothing from the current folder, unless the program itself is there, and read no configuration there."""
    with suppress(OSError):  # there is no current folder any more
        here = os.path.realpath("")
        if here != os.path.realpath(f"{__file__}/../../.."):
            sys.path[:] = [place for place in sys.path if os.path.realpath(place) != here]
    read_no_configuration()


def read_no_configuration() -> None:
    """Have libraries find no configuration of theirs in the current folder; the user's own, elsewhere, is theirs to find."""
    exists = os.path.exists
    setattr(os.path, "exists", lambda path: path not in CONFIGURATIONS and exists(path))  # noqa: B010  mypy knows it as a function
