"""What makes a run the same run: its scenario, the files it reads, and the code that runs it.

Keys are the same on every machine: paths are told as the suite tells them, files by their content.
"""

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, entry_points, version
from importlib.util import find_spec
from pathlib import Path

import mrp_sumo

_ROOT = Path(mrp_sumo.__file__).resolve().parent
# what decides about results; the command line and reports do not
_FLOORS = (
    "core",
    "plugins",
    "traffic",
    "search",
    "maps",
    "planning",
    "formats",
    "engines",
    "drive",
    "metrics",
)
_FILES = ("io/scenario.py", "experiments/run.py", "experiments/set_up.py", "experiments/worker.py")
_LIBRARIES = ("libsumo", "ortools")  # whose versions may change results


def scenario_key(canonical: str, until: str, repeat: int) -> str:
    """Name of a run whatever code makes it; 20 hexadecimal digits.

    Parameters
    ----------
    canonical
        The scenario as JSON with sorted keys.
    until
        How far the run goes.
    repeat
        Which repetition.
    """
    return _digest(f"{until} {repeat} {canonical}".encode())


def run_key(scenario: str, inputs: str, code: str) -> str:
    """Name of a run: of its scenario key, the hash of its input files, and the version of the code."""
    return _digest(f"{scenario} {inputs} {code}".encode())


def input_hash(paths: Iterable[Path]) -> str:
    """Hash of the contents of files."""
    return _digest(b"".join(hashlib.sha256(path.read_bytes()).digest() for path in paths))


@cache
def code_version() -> str:
    """Version of the code that decides about results: `0.1.0+1a2b3c4d`.

    The second part hashes the sources, the bundled planners, and the versions of SUMO, OR-Tools and of
    the packages that bring planners.
    """
    sources = [_ROOT / name for name in _FILES]
    sources += [path for floor in _FLOORS for path in (_ROOT / floor).rglob("*.py")]
    planners = find_spec("planners")
    for folder in (planners.submodule_search_locations if planners else None) or ():
        sources += Path(folder).rglob("*.py")
    parts = [f"{path.parent.name}/{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}" for path in sources]
    parts += [f"{name} {library_versions()[name]}" for name in _LIBRARIES]
    plug_ins = (*entry_points(group="mrp_sumo.planners"), *entry_points(group="mrp_sumo.policies"))
    parts += [f"{e.dist.name} {e.dist.version}" for e in plug_ins if e.dist]
    return f"{mrp_sumo.__version__}+{_digest(chr(10).join(sorted(parts)).encode())[:8]}"


@cache
def library_versions() -> dict[str, str]:
    """Versions of the libraries that may change results, '' where one is missing."""
    found = {}
    for name in _LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = ""
    return found


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:20]
