"""Reading files that may be anybody's: regular files of a bounded size and nothing else.

Devices, FIFOs and sockets are refused before they are opened: a device may have no end, a FIFO waits for a writer. All readers of
the program begin here.
"""

import json
import math
import os
import re
import stat
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from mrp_sumo.errors import MrpSumoError, in_one_line, sentence

MAX_BYTES = 2**30  # where a format states no smaller limit
_HALF, _HALF_BYTES = re.compile(r"\\u[dD][89a-fA-F]"), re.compile(rb"\\u[dD][89a-fA-F]")
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def require_regular(path: Path, max_bytes: int = MAX_BYTES, error: type[MrpSumoError] = MrpSumoError) -> None:
    """Refuse what is no regular file, or is too large, without opening it; for libraries that open files themselves."""
    try:
        _check(path, path.stat(), max_bytes, error)
    except OSError as fault:
        raise error(f"{shortened(path)}: {sentence(fault)}") from None
    except ValueError:  # a null byte
        raise error(f"{str(path)!r} is not a path") from None


def read_bytes(path: Path, max_bytes: int = MAX_BYTES, error: type[MrpSumoError] = MrpSumoError) -> bytes:
    """The content of a regular file; as `require_regular`."""
    require_regular(path, max_bytes, error)
    try:
        with open(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK), "rb") as file:  # noqa: PTH123
            status = os.fstat(file.fileno())
            _check(path, status, max_bytes, error)  # it may be another by now
            data = file.read(status.st_size + 1)  # not max_bytes: memory for all of it would be taken
            while len(data) <= max_bytes and (more := file.read(2**16)):  # files of the system have no size
                data += more
    except OSError as fault:
        raise error(f"{shortened(path)}: {sentence(fault)}") from None
    if len(data) > max_bytes:
        raise error(f"{shortened(path)}: more than {_size(max_bytes)}, which is not read")
    return data


def read_head(path: Path, num_bytes: int, error: type[MrpSumoError] = MrpSumoError) -> bytes:
    """The first bytes of a regular file of any size; as `require_regular`."""
    require_regular(path, 2**63, error)
    try:
        with open(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK), "rb") as file:  # noqa: PTH123
            return file.read(num_bytes)
    except OSError as fault:
        raise error(f"{shortened(path)}: {sentence(fault)}") from None


def read_text(path: Path, max_bytes: int = MAX_BYTES, error: type[MrpSumoError] = MrpSumoError) -> str:
    """The text of a regular file in UTF-8, a byte order mark left out; as `require_regular`."""
    data = read_bytes(path, max_bytes, error)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        line = data.count(b"\n", 0, fault.start) + 1
        raise error(f"{shortened(path)}:{line}: not a text file in UTF-8") from None


def is_number(value: object, beyond: float = math.inf) -> bool:
    """True for a number that is finite and nearer to 0 than `beyond`; not for true and false, which Python counts among whole ones."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < beyond


def json_value(text: str | bytes, *, finite: bool = False, largest: float | None = None) -> Any:
    """The value of a JSON text; as `json.loads`, but half of a character of two halves is refused: nobody could write it to a file.

    With `finite`, `Infinity` and `NaN` are refused, which are no JSON; with `largest` also numbers farther from 0. Raises ValueError for
    what is not JSON, and RecursionError for what is nested too deep.
    """
    if largest is None:
        value = json.loads(text, parse_constant=_no_number if finite else None)
    else:
        number = partial(_bounded, float, largest)
        value = json.loads(text, parse_float=number, parse_int=partial(_bounded, int, largest), parse_constant=number)
    if _HALF.search(text) if isinstance(text, str) else _HALF_BYTES.search(text):
        json.dumps(value, ensure_ascii=False).encode()  # UnicodeEncodeError is a ValueError
    return value


def _no_number(text: str) -> float:
    raise ValueError(text)


def _bounded(make: Callable[[str], float], largest: float, text: str) -> float:
    value = make(text)
    if not abs(value) <= largest:
        raise ValueError(f"the number {text[:20]}")
    return value


def read_json(path: Path, max_bytes: int = MAX_BYTES, error: type[MrpSumoError] = MrpSumoError) -> Any:
    """The document of a JSON file; as `read_text`, and for what is not JSON or nested too deep."""
    text = read_text(path, max_bytes, error)
    try:
        return json_value(text)
    except ValueError as fault:
        raise error(f"{shortened(path)}: not JSON: {fault}") from None
    except RecursionError:
        raise error(f"{shortened(path)}: not JSON that is read here: nested too deep") from None


def shortened(path: Path) -> str:
    """A path for a message: one line, and not the thousands of characters that it may have."""
    text = in_one_line(str(path))
    return text if len(text) <= 200 else f"{text[:80]}...{text[-80:]}"


def _check(path: Path, status: os.stat_result, max_bytes: int, error: type[MrpSumoError]) -> None:
    for is_kind, kind in _KINDS:
        if is_kind(status.st_mode):
            raise error(f"{shortened(path)} is {kind}, expected a file")
    if status.st_size > max_bytes:
        raise error(f"{shortened(path)}: {_size(status.st_size)}; above {_size(max_bytes)} nothing is read")


def _size(num_bytes: int) -> str:
    return f"{num_bytes / 2**20:.0f} MB" if num_bytes >= 2**20 else f"{num_bytes} bytes"
