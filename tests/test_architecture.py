"""The floors of the house hold: a module imports from lower floors, or its own folder; heavy libraries have one home."""

import ast
import subprocess
import sys
from collections import defaultdict
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import networkx as nx
import pytest

from planners import PLUGINS

PROJECT = Path(__file__).resolve().parents[1]
PACKAGE = PROJECT / "mrp_sumo"

FLOORS = (  # from the ground up; rooms of one floor do not know each other
    {"errors"},
    {"files"},
    {"core", "plugins"},
    {"traffic", "search", "maps"},
    {"formats", "engines", "crowd"},
    {"planning"},
    {"drive", "metrics", "io"},
    {"bags"},
    {"experiments"},
    {"sizing", "wire", "calibration"},
    {"reports"},
    {"door", "studio"},
    {"cli"},
)
BELOW = {room: set().union(*FLOORS[:k]) for k, floor in enumerate(FLOORS) for room in floor}
BELOW_PLANNERS = ("core", "errors", "formats", "planning", "search", "traffic")
PLUG_INS = {target.partition(":")[0] for table in PLUGINS.values() for target in table.values()}  # modules of planners and assigners
HOMES = {
    "libsumo": ("mrp_sumo/engines/sumo/",),
    "traci": ("mrp_sumo/engines/sumo/",),
    "rosbags": ("mrp_sumo/bags/",),
    "ortools": ("planners/assigners/",),
    "matplotlib": ("mrp_sumo/reports/",),
    "gymnasium": ("mrp_sumo/door/environment.py",),
    "pettingzoo": ("mrp_sumo/door/environment.py",),
    "pydantic": ("mrp_sumo/io/", "mrp_sumo/experiments/"),
    "paho": ("mrp_sumo/wire/mqtt.py",),
    "cyclonedds": ("mrp_sumo/wire/dds.py",),
    "foxglove": ("mrp_sumo/wire/foxglove.py",),
    "rerun": ("mrp_sumo/wire/rerun.py", "mrp_sumo/data/viewers/"),
    "ezdxf": ("mrp_sumo/maps/readers/dxf.py",),
    "pypdfium2": ("mrp_sumo/maps/readers/pdf.py",),
    "pyarrow": ("mrp_sumo/io/", "mrp_sumo/reports/exports.py"),
}
HEAVY = (
    "libsumo",
    "rosbags",
    "ortools",
    "matplotlib",
    "pydantic",
    "pyarrow",
    "numba",
    "scipy",
    "numpy",
    "pandas",
    "yaml",
    "pettingzoo",
    "ezdxf",
    "pypdfium2",
)


def sources():
    return sorted(p for folder in ("mrp_sumo", "planners") for p in (PROJECT / folder).rglob("*.py"))


@cache
def trees():
    return tool("measures").sources(PROJECT)


@cache
def statements(path):
    """Imports and classes of a file, wherever they stand."""
    tree = trees()[path.relative_to(PROJECT).as_posix()]
    return [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom | ast.ClassDef)]


def imports(path, each_name=False):
    """(line, module) of every import of a file; with `each_name` what is imported from a module may be one."""
    for node in statements(path):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            yield node.lineno, node.module
            if each_name:
                yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)


def may_import(path, module):
    """Whether the floors let a file import a module."""
    inside, parts = path.relative_to(PROJECT).parts, module.split(".")
    if parts[0] not in ("mrp_sumo", "planners"):
        return True
    if inside[0] == "planners":  # no planner imports another one
        return module not in PLUG_INS if parts[0] == "planners" else parts[1] in BELOW_PLANNERS
    if len(inside) == 2:  # mrp_sumo/__init__.py, __main__.py and errors.py
        return inside[1] in ("__init__.py", "__main__.py")
    return parts[0] != "planners" and (len(parts) == 1 or parts[1] == inside[1] or parts[1] in BELOW[inside[1]])


def test_modules_import_from_lower_floors_only():
    wrong = [f"{p.relative_to(PROJECT)}:{n}: {m}" for p in sources() for n, m in imports(p) if not may_import(p, m)]
    assert not wrong, "\n".join(wrong)


def test_no_circle_of_imports():
    modules = {".".join(p.relative_to(PROJECT).with_suffix("").parts): p for p in sources()}
    graph = nx.DiGraph()
    for name, path in modules.items():
        graph.add_edges_from((name, module) for _, module in imports(path, each_name=True) if module in modules and module != name)
    assert not list(nx.simple_cycles(graph))


def test_heavy_libraries_stay_at_home():
    wrong = []
    for path in sources():
        name = path.relative_to(PROJECT).as_posix()
        for line, module in imports(path):
            library = module.split(".")[0]
            if (library == "numba" and not path.name.startswith("_")) or (library in HOMES and not name.startswith(HOMES[library])):
                wrong.append(f"{name}:{line}: {module}")
    assert not wrong, "\n".join(wrong)


@cache
def tool(name):
    """A program of `tools/`, as a module."""
    spec = spec_from_file_location(f"tool_{name}", PROJECT / "tools" / f"{name}.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_no_private_name_of_another_library():
    assert tool("measures").private_names(trees()) == []


@pytest.mark.parametrize("command", ["import mrp_sumo", "from mrp_sumo.cli.main import main; main(['--help'])"])
def test_import_and_help_load_nothing_heavy(command):
    code = f"{command}\nimport sys\nprint('loaded:', *(m for m in {HEAVY!r} if m in sys.modules))"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PROJECT).stdout
    assert output.splitlines()[-1] == "loaded:"


SCENARIOS = {
    "key.yaml": "map: office\nrobots: {cuont: 5}\n",
    "map.yaml": "map: nowhere\nrobots: 3\n",
    "planner.yaml": "map: office\nrobots: 3\nplanner: cbbs\n",
    "tab.yaml": "map: office\nrobots:\n\tcount: 5\n",
}
REFUSED = [
    *(f"run {name}" for name in (*SCENARIOS, "nowhere.yaml", "office_5 --type nope", "office_5 --set planner.time_limit_s=5min")),
    *("plan nowhere.yaml", "init nowhere", "capacity nowhere", "batch nowhere", "analyze nowhere", "reproduce nowhere"),
]


def test_lines_about_bad_input_come_before_arrays_and_engines_are_loaded(tmp_path):
    for name, text in SCENARIOS.items():
        (tmp_path / name).write_text(text)
    code = (
        f"import sys\nfrom mrp_sumo.cli.main import main\nfor line in {REFUSED!r}:\n"
        f"    print(line, main(line.split()), *(m for m in {[*HEAVY, 'numpy']!r} if m in sys.modules), sep='|')"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert [line for line in ended.stdout.splitlines() if not set(line.split("|")[1:]) <= {"2", "pydantic", "yaml"}] == []
    assert len(ended.stdout.splitlines()) == len(ended.stderr.splitlines()) == len(REFUSED)


def test_sources_name_no_path_of_a_machine():
    for path in [*sources(), *(PROJECT / "docs").rglob("*.md"), *(PROJECT / "tools").iterdir(), PROJECT / "README.md"]:
        if path.is_file():
            text = path.read_text()
            assert not [w for w in ("/home/", "/root/", "/work/", "C:\\") if w in text], path


def test_no_two_classes_share_a_name():
    homes = defaultdict(list)
    for path in sources():
        for node in statements(path):
            if isinstance(node, ast.ClassDef):
                homes[node.name].append(path)
    shared = {name: paths for name, paths in homes.items() if len(paths) > 1}
    assert not shared, shared


def test_files_with_an_underscore_hold_kernels_or_their_constants():
    wrong = [path for path in sources() if path.match("_[!_]*.py") and "@kernel" not in (text := path.read_text()) and "def " in text]
    assert not wrong, wrong
