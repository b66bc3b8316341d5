"""Names that files give: of scenarios, suites, maps, vertices, robots. They are shown, and some become names of folders."""

import re
from collections.abc import Container, Iterable
from itertools import chain, count

MAX_BYTES = 200  # which leaves room for a suffix in a file's name
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f]")


def fault_of(name: str) -> str:
    """Fault of a name, in words that follow its key; '' for nothing."""
    if _CONTROL.search(name):
        return f"found {name[:40]!r}, expected a name without control characters"
    if len(name.encode(errors="surrogatepass")) > MAX_BYTES:
        return f"found '{name[:40]}...', expected a name of at most {MAX_BYTES} bytes"
    return ""


def free_name(name: str, taken: Container[str]) -> str:
    """The name, with the first number that makes it none of those taken: dock, dock_2, dock_3."""
    return next(free for free in chain([name], (f"{name}_{k}" for k in count(2))) if free not in taken)


def distinct(names: Iterable[str]) -> list[str]:
    """The names, each another: of those alike the later ones get numbers."""
    taken: dict[str, None] = {}
    for name in names:
        taken[free_name(name, taken)] = None
    return list(taken)


def fault_of_folder(name: str) -> str:
    """As `fault_of`, for a name that becomes that of a folder."""
    if name in (".", "..") or len(name.encode(errors="surrogatepass")) > MAX_BYTES or not name.isprintable() or "/" in name:
        return f"found {name[:40]!r}, expected the name of a folder, of at most {MAX_BYTES} bytes"
    return ""
