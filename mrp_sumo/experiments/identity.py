"""Identity of a run: its scenario, the files it reads, the plug-ins it names, and the code that runs it.

Keys are the same on every machine: paths are as the suite has them, files count by their content.
"""

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import mrp_sumo
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.io.scenario.programs import plug_ins_of
from mrp_sumo.plugins.registry import find
from mrp_sumo.plugins.source import digest

_ROOT = Path(mrp_sumo.__file__).resolve().parent
# what decides about results; the command line and reports do not
_FOLDERS = (
    "files",
    "core",
    "plugins",
    "traffic",
    "search",
    "maps",
    "planning",
    "formats",
    "engines",
    "crowd",
    "drive",
    "metrics",
    "io/scenario",
    "experiments/staging",
)
_FILES = (
    "io/task_requests.py",
    "io/tasks.py",
    "experiments/map_cache.py",
    "experiments/run.py",
    "experiments/solve.py",
    "experiments/worker.py",
    "sizing/observe.py",
)
_LIBRARIES = ("libsumo", "ortools")  # whose versions may change results


def scenario_key(canonical: str, until: str, repeat: int) -> str:
    """Name of a run whatever code makes it; 20 hexadecimal digits."""
    return _digest(f"{until} {repeat} {canonical}".encode())


def run_key(scenario: str, inputs: str, plug_ins: str, code: str) -> str:
    """Name of a run: of its scenario key, the hashes of its input files and plug-ins, and the version of the code."""
    return _digest(f"{scenario} {inputs} {plug_ins} {code}".encode())


def input_hash(paths: Iterable[Path]) -> str:
    """Hash of the contents of files."""
    return _digest(b"".join(hashlib.sha256(path.read_bytes()).digest() for path in paths))


def plug_in_hash(scenario: ScenarioModel, folder: Path) -> str:
    """Hash of the sources of the plug-ins from outside that a scenario names, '' where it names none.

    Raises ScenarioError for a plug-in that is not there.
    """
    digests = []
    for place, kind, name in plug_ins_of(scenario):
        source = find(kind, name, folder)
        if not source.ours:
            digests.append(f"{'.'.join(map(str, place))} {digest(source)}")
    return _digest("\n".join(digests).encode()) if digests else ""


@cache
def code_version() -> str:
    """Version of the code that decides about results: `0.1.0+1a2b3c4d`.

    The second part hashes the sources, the bundled planners, and the versions of SUMO and OR-Tools. Plug-ins from outside
    are not part of it but of the runs that use them.
    """
    sources = [_ROOT / name for name in _FILES]
    sources += [path for folder in _FOLDERS for path in (_ROOT / folder).rglob("*.py")]
    planners = find_spec("planners")
    for folder in (planners.submodule_search_locations if planners else None) or ():
        sources += Path(folder).rglob("*.py")
    parts = [f"{path.parent.name}/{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}" for path in sources]
    parts += [f"{name} {library_versions()[name]}" for name in _LIBRARIES]
    return f"{mrp_sumo.__version__}+{_digest(chr(10).join(sorted(parts)).encode())[:8]}"


@cache
def library_versions() -> dict[str, str]:
    """Versions of the libraries that may change results, '' where one is missing."""
    from mrp_sumo.io.run_folder import versions

    here = versions()
    return {name: here.get(name, "") for name in _LIBRARIES}


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:20]
