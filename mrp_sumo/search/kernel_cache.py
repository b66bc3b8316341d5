"""Drops compiled kernels whose callees have changed.

numba's cache looks at the file of the kernel itself only. A kernel holds the code of the kernels it calls, so after
an update of their file it would go on doing what they did before. Here the files a kernel file imports from, and
theirs, are looked at too.
"""

import re
from functools import cache
from importlib.util import find_spec
from pathlib import Path

PACKAGES = (
    "mrp_sumo.search",
    "planners",
    *(f"planners.{family}" for family in ("configuration", "conflict_based", "neighbourhood", "safe_interval")),
)
IMPORT = re.compile(r"^from ([\w.]+\._\w+) import", re.MULTILINE)


@cache
def drop_stale_kernels() -> int:
    """Remove from the cache what is older than a file it was made of; once a process. Returns how many."""
    source: dict[str, Path] = {}
    for package in PACKAGES:
        spec = find_spec(package)
        for folder in spec.submodule_search_locations or () if spec else ():
            source.update({f"{package}.{path.stem}": path for path in Path(folder).glob("_*.py") if path.stem != "__init__"})
    return sum(_drop(path, newest) for path, newest in _newest(source))


def _newest(source: dict[str, Path]) -> list[tuple[Path, float]]:
    """Each file with the time of the latest change to it or to what it imports, directly or not."""
    imports = {name: {m for m in IMPORT.findall(path.read_text(encoding="utf-8")) if m in source} for name, path in source.items()}
    found = []
    for name, path in source.items():
        needed, todo = {name}, [name]
        while todo:
            new = imports[todo.pop()] - needed
            needed |= new
            todo += new
        found.append((path, max(source[n].stat().st_mtime for n in needed)))
    return found


def _drop(path: Path, newest: float) -> int:
    count = 0
    for index in (path.parent / "__pycache__").glob(f"{path.stem}.*.nbi"):
        try:
            if index.stat().st_mtime < newest:
                index.unlink()
                count += 1
        except OSError:  # another process was faster, or the folder is not ours to write
            continue
    return count
