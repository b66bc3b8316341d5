"""The screen that sumo-gui needs: looked for at once, since TraCI tries sixty times to reach a sumo-gui that has found none."""

import os
import re
import socket
import sys
from pathlib import Path

from mrp_sumo.errors import ExecutionError

ANSWER_S = 5.0  # of an X server on another machine


def require_screen() -> None:
    """Refuse to drive in sumo-gui where there is no X server to show it.

    Raises
    ------
    ExecutionError
        Without a server at `DISPLAY`.
    """
    if sys.platform != "linux":
        return
    display = os.environ.get("DISPLAY", "")
    match = re.fullmatch(r"(.*):(\d{1,4})(\.\d+)?", display)
    if match is None:
        fault = f"DISPLAY is '{display}', expected such as :0" if display else "DISPLAY is not set"
    elif not _answers(match[1], int(match[2])):
        fault = f"nothing answers at DISPLAY={display}"
    else:
        return
    raise ExecutionError(f"sumo-gui needs a screen, and {fault}; --live shows a run in the browser")


def _answers(host: str, number: int) -> bool:
    try:
        if host not in ("", "unix"):
            socket.create_connection((host, 6000 + number), ANSWER_S).close()
            return True
        path = f"/tmp/.X11-unix/X{number}"
        with socket.socket(socket.AF_UNIX) as server:
            server.connect(path if Path(path).exists() else f"\0{path}")
    except OSError:
        return False
    return True
