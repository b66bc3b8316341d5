"""Python processes of ours, and what they and the command keep out: whatever happens to lie in the current folder.

A process imports from where its parent does. On its own, Python would look in the current folder first, which may be anybody's.
Those that are talked to inherit a socket, have a session of their own, and end with their parent; whoever is killed is killed with all
that came of it.
"""

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from mrp_sumo.errors import OptionError

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Mapping
    from multiprocessing.connection import Connection
    from typing import IO

MOST_A_CORE = 8  # processes that work, each of which takes some 200 MB
CONFIGURATIONS = frozenset({"matplotlibrc", ".numba_config.yaml"})  # that libraries look for in the current folder


def num_workers(option: str, wanted: int | None) -> int:
    """The number of processes that work at a time, by default one a core.

    Raises OptionError for none, and for more than the machine bears.
    """
    cores = len(os.sched_getaffinity(0))
    if wanted is not None and not 1 <= wanted <= MOST_A_CORE * cores:
        raise OptionError(f"{option}: found {wanted}, expected 1 to {MOST_A_CORE * cores}, {MOST_A_CORE} for each core")
    return wanted or cores


def command(call: str, *words: str) -> list[str]:
    """The command of a process that calls `MODULE:FUNCTION` without arguments, with some words in `sys.argv[1:]`."""
    module, _, name = call.partition(":")
    code = f"import sys; sys.path[:] = {sys.path!r}; from mrp_sumo.core.children import read_no_configuration; read_no_configuration(); "
    return [sys.executable, "-P", "-c", f"{code}from {module} import {name}; {name}()", *words]


def start(
    call: str, *words: str, output: "IO[bytes] | int", environment: "Mapping[str, str] | None" = None
) -> "tuple[subprocess.Popen[bytes], Connection]":
    """Start a process to talk to, out of reach of Ctrl-C; all that it prints goes to `output`.

    The call, as `command`'s, begins with `connection_to_parent`, and has the words in `sys.argv[1:]` from then on. The environment is that
    of this process, with more variables.
    """
    import socket  # here and below: most commands need no process
    import subprocess
    from multiprocessing.connection import Connection

    ours, theirs = socket.socketpair()
    with theirs:
        process = subprocess.Popen(
            command(call, str(theirs.fileno()), str(os.getpid()), *words),
            pass_fds=(theirs.fileno(),),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
            env={**os.environ, **(environment or {})},
        )
    return process, Connection(ours.detach())


def connection_to_parent() -> "Connection":
    """The connection that this process inherited. It ends with its parent; elsewhere than on Linux its socket tells it."""
    from multiprocessing.connection import Connection

    descriptor = int(sys.argv.pop(1))
    end_with_parent()
    return Connection(descriptor)


def end_with_parent() -> None:
    """Have the system kill this process when its parent ends, whose number is the first word."""
    parent = int(sys.argv.pop(1))
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    if os.getppid() != parent:
        sys.exit("the parent is gone")


def kill_family(leader: int) -> None:
    """Kill a session's leader and all that came of it, in other process groups and sessions too."""
    for _ in range(10):  # again while something new appears
        family = _family(leader)
        for pid in family:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
        if family <= {leader}:
            break


def _family(leader: int) -> set[int]:
    """The living processes of a leader's session, their descendants, and the leader."""
    parent, session = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = stat.read_text(errors="replace").rpartition(")")[2].split()
            if fields[0] not in "ZX":
                parent[int(stat.parent.name)], session[int(stat.parent.name)] = int(fields[1]), int(fields[3])
    family = {leader} | {pid for pid in session if session[pid] == leader}
    while more := {pid for pid in parent if parent[pid] in family} - family:
        family |= more
    return family


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
