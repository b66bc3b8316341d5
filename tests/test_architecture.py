"""The floors of the house hold: a module imports from lower floors, or its own folder; heavy libraries have one home."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[1]
PACKAGE = PROJECT / "mrp_sumo"

BELOW = {
    "errors": set(),
    "core": {"errors"},
    "maps": {"core", "errors"},
    "planning": {"core", "errors"},
    "sim": {"maps", "planning", "core", "errors"},
    "metrics": {"maps", "planning", "core", "errors"},
    "io": {"maps", "planning", "core", "errors"},
    "experiments": {"sim", "metrics", "io", "maps", "planning", "core", "errors"},
    "reports": {"experiments", "sim", "metrics", "io", "maps", "planning", "core", "errors"},
    "cli": {"reports", "experiments", "sim", "metrics", "io", "maps", "planning", "core", "errors"},
}
HOMES = {
    "libsumo": ("mrp_sumo/sim/sumo.py",),
    "traci": ("mrp_sumo/sim/sumo.py",),
    "rosbags": ("mrp_sumo/io/rosbag",),
    "ortools": ("planners/",),
    "matplotlib": ("mrp_sumo/reports/",),
    "pydantic": ("mrp_sumo/io/", "mrp_sumo/experiments/"),
    "pyarrow": ("mrp_sumo/io/",),
}
HEAVY = ("libsumo", "rosbags", "ortools", "matplotlib", "pydantic", "pyarrow", "numba", "scipy", "numpy", "pandas", "yaml")


def sources():
    return sorted(p for folder in ("mrp_sumo", "planners") for p in (PROJECT / folder).rglob("*.py"))


def imports(path):
    """(line, module) of every import of a file, wherever it stands."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            names = [f"planners.{alias.name}" for alias in node.names] if node.module == "planners" else [node.module]
            yield from ((node.lineno, name) for name in names)


@pytest.mark.parametrize("path", sources(), ids=lambda p: str(p.relative_to(PROJECT)))
def test_module_imports_from_lower_floors_only(path):
    inside = path.relative_to(PROJECT).parts
    for line, module in imports(path):
        parts = module.split(".")
        if inside[0] == "planners":
            allowed = parts[0] != "mrp_sumo" or parts[1] in ("core", "planning", "errors")
            allowed = allowed and (parts[0] != "planners" or parts[-1].startswith("_"))
        elif len(inside) == 2:  # mrp_sumo/__init__.py and errors.py
            allowed = inside[1] == "__init__.py" or parts[0] != "mrp_sumo"
        else:
            allowed = parts[0] != "planners"
            if parts[0] == "mrp_sumo" and len(parts) > 1:
                allowed = parts[1] == inside[1] or parts[1] in BELOW[inside[1]]
        assert allowed, f"{path}:{line}: imports {module}"


@pytest.mark.parametrize("path", sources(), ids=lambda p: str(p.relative_to(PROJECT)))
def test_heavy_library_stays_at_home(path):
    name = path.relative_to(PROJECT).as_posix()
    for line, module in imports(path):
        library = module.split(".")[0]
        if library == "numba":
            assert path.name.startswith("_"), f"{name}:{line}: numba outside a kernel file"
        if library in HOMES:
            assert name.startswith(HOMES[library]), f"{name}:{line}: imports {library}"


@pytest.mark.parametrize("command", ["import mrp_sumo", "from mrp_sumo.cli.main import main; main(['--help'])"])
def test_import_and_help_load_nothing_heavy(command):
    code = f"{command}\nimport sys\nprint('loaded:', *(m for m in {HEAVY!r} if m in sys.modules))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PROJECT).stdout
    assert told.splitlines()[-1] == "loaded:"


def test_sources_name_no_path_of_a_machine():
    for path in [*sources(), *(PROJECT / "docs").rglob("*.md"), *(PROJECT / "tools").iterdir(), PROJECT / "README.md"]:
        if path.is_file():
            text = path.read_text()
            assert not [w for w in ("/home/", "/root/", "/work/", "C:\\") if w in text], path
