"""Places of a run for Rerun, a file or a viewer that listens: looked at before all that drives is loaded."""

import socket
from pathlib import Path
from urllib.parse import urlsplit

from mrp_sumo.errors import MrpSumoError

VIEWER = "rerun+http://127.0.0.1:9876/proxy"  # where `rerun` listens


def is_file(to: str) -> bool:
    """True for a file to write, which ends with .rrd."""
    return to.endswith(".rrd")


def require_place(to: str) -> None:
    """Refuse a file that cannot be written, and a viewer that is not there."""
    (_check_file if is_file(to) else _check_viewer)(to)


def _check_file(to: str) -> None:
    path = Path(to)
    place = next((above for above in path.absolute().parents if above.exists()), Path())
    if path.is_dir() or not place.is_dir():
        raise MrpSumoError(f"--rerun {path}: {path if path.is_dir() else place} is {'a' if path.is_dir() else 'no'} folder")


def _check_viewer(url: str) -> None:
    expected = "expected a file that ends with .rrd, or rerun+http://HOST:PORT/proxy"
    try:
        place = urlsplit(url)
        host, port = place.hostname, place.port
    except ValueError:
        raise MrpSumoError(f"--rerun {url}: {expected}") from None
    if place.scheme not in ("rerun+http", "rerun+https") or not host or not port:
        raise MrpSumoError(f"--rerun {url}: {expected}")
    try:
        socket.create_connection((host, port), 2.0).close()
    except OSError:
        raise MrpSumoError(
            f"--rerun: no viewer listens at {host}:{port}; start one with `rerun`, or name a file to write: --rerun run.rrd"
        ) from None
