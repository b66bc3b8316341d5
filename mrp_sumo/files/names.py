"""Names that files give: of scenarios, suites, maps, vertices, robots. They are shown, and some become names of folders."""

import re

MAX_BYTES = 200  # which leaves room for a suffix in a file's name
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f]")


def fault_of(name: str) -> str:
    """Fault of a name, in words that follow its key; '' for nothing."""
    if _CONTROL.search(name):
        return f"found {name[:40]!r}, expected a name without control characters"
    if len(name.encode(errors="surrogatepass")) > MAX_BYTES:
        return f"found '{name[:40]}...', expected a name of at most {MAX_BYTES} bytes"
    return ""


def fault_of_folder(name: str) -> str:
    """As `fault_of`, for a name that becomes that of a folder."""
    if name in (".", "..") or len(name.encode(errors="surrogatepass")) > MAX_BYTES or not name.isprintable() or "/" in name:
        return f"found {name[:40]!r}, expected the name of a folder, of at most {MAX_BYTES} bytes"
    return ""
