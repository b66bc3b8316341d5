"""A folder of anybody's is not read, whichever command is used in it: no module is opened, no configuration of a library."""

import ast
import ctypes
import os
import shlex
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from mrp_sumo.cli.main import COMMANDS
from mrp_sumo.core import children

PROJECT = Path(__file__).parents[2]
CONSOLE = Path(sys.executable).with_name("mrp-sumo")
OURS = {"mrp_sumo", "planners"}


@cache
def modules():
    """Names of all modules that there are, and of some that Python looks for."""
    return {*sys.stdlib_module_names, *packages_distributions(), *OURS, "sitecustomize", "usercustomize"}


CONFIGURATIONS = {  # whatever libraries might look for, of which some would be refused
    "matplotlibrc": "text.usetex: True\nbackend: none such\nfont.size: x\n",
    ".numba_config.yaml": "disable_jit: 1\nopt: none such\n",
    ".coveragerc": "[run]\nplugins = planted\n",
    "setup.cfg": "[options]\n",
    "pyvenv.cfg": "home = .\n",
    ".netrc": "x",
    ".duckdbrc": "none such\n",
    ".env": "NUMBA_DISABLE_JIT=1\n",
    ".mpl.toml": "x",
    "dask.yaml": "none such: [\n",
    "planted.pth": "import planted\n",
    "pydevd.cfg": "x",
    "pyproject.toml": "none such\n",
    "pytest.ini": "none such\n",
    "sumo.sumocfg": "none such\n",
}
IN_OPEN = 0x20  # of Linux's inotify.h
SUITE = "name: s\nbase: {map: office, robots: {count: 2}}\ngrid_search: {seed: [0]}\nuntil: plan\n"
LINES = {  # at least one of every command; {run} and {batch} are made beforehand, {new} is for what they write
    "run": "run office_5 --out {new}/run --replay",
    "capacity": "capacity warehouse_lifelong --quick --robots 1..2 --budget 1min --horizon 1min --workers 1 --out {new}/study",
    "import": "import office --out {new}/map",
    "plan": "plan office_5",
    "validate": "validate {run}/plan.json --scenario office_5",
    "convert": "convert office {new}/office.geojson",
    "generate": "generate ring --vertices 20 --out {new}/ring.building.yaml",
    "batch": "batch suite.yaml --out {new}/batch --workers 1",
    "paper": "paper --maps nowhere",
    "status": "status {batch}",
    "query": "query {batch} 'select planner from results'",
    "compare": "compare {batch} {batch}",
    "reproduce": "reproduce {run}",
    "export": "export {run} --csv --out {new}/csv",
    "analyze": "analyze {run}/bag",
    "calibrate": "calibrate {run} --out {new}/type.yaml",
    "predict": "predict warehouse_lifelong --log {run} --out {new}/prediction",
    "vda5050": "vda5050 office_5 --broker 127.0.0.1:1 --duration 1",
    "replay": "replay {run} --out {new}/page.html",
    "render": "render {run} --at 1 --out {new}/page.png",
    "list": "list planners",
    "trust": "trust --list",
    "warmup": "warmup astar",
    "report": "report {run} --out {new}/report.html",
    "studio": "studio nowhere --no-browser",
    "demo": "demo --no-open --out /dev/null",
    "init": "init office --out {new}/site",
    "completion": "completion bash",
    "schema": "schema",
}
COMPILES = {"run", "init", "capacity", "plan", "batch", "reproduce", "warmup"}  # kernels, where there are none
REFUSED = {"paper", "studio", "demo", "predict", "vda5050"}  # for what takes minutes, or a broker; after all is loaded that reads the line
COLD = {"plan": pytest.mark.slow}  # compiles kernels, minutes: one line in CI, the others by night


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder that holds a module and a package of every name that anything imports, each of which ends who imports it."""
    folder = tmp_path_factory.mktemp("strange")
    for name in modules():
        (folder / name).mkdir()
        for file in (folder / f"{name}.py", folder / name / "__init__.py"):
            file.write_text(f"raise SystemExit({name!r})\n")
    for name, text in CONFIGURATIONS.items():
        (folder / name).write_text(text)
    (folder / "suite.yaml").write_text(SUITE)
    return folder


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run folder and a batch's."""
    made = tmp_path_factory.mktemp("made")
    (made / "suite.yaml").write_text(SUITE)
    for line in ("run office_5 --out run", "batch suite.yaml --out batch --workers 1"):
        subprocess.run([CONSOLE, *line.split()], cwd=made, check=True, capture_output=True)
    return {"run": made / "run", "batch": made / "batch"}


@contextmanager
def opened_in(folder: Path) -> Iterator[set[str]]:
    """Names of the folder's modules and configurations, and its packages, that any process opens, by inotify; filled at the end."""
    kernel = ctypes.CDLL(None, use_errno=True)
    watcher = kernel.inotify_init1(os.O_NONBLOCK)
    names = {}
    for path in (folder, *(folder / name for name in modules())):
        watch = kernel.inotify_add_watch(watcher, bytes(path), IN_OPEN)
        assert watch >= 0, os.strerror(ctypes.get_errno())
        names[watch] = path.name
    opened: set[str] = set()
    planted = {*CONFIGURATIONS, *(f"{name}.py" for name in modules())}
    try:
        yield opened
        for watch, name in _events(watcher):
            opened |= {name} & planted if names[watch] == folder.name else {names[watch]} if name else set()
    finally:
        os.close(watcher)


def _events(watcher: int) -> Iterator[tuple[int, str]]:
    while True:
        try:
            data = os.read(watcher, 1 << 16)
        except BlockingIOError:
            return
        at = 0
        while at < len(data):
            watch, mask, _, length = struct.unpack_from("iIII", data, at)
            assert watch >= 0, f"events were lost: {mask}"
            yield watch, data[at + 16 : at + 16 + length].rstrip(b"\0").decode()
            at += 16 + length


def check_nothing_is_opened(folder, command):
    with opened_in(folder) as opened:
        ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert not opened, f"{command} opened {opened}"
    assert "Traceback" not in ended.stderr
    for name in ("matplotlib", "numba", "Bad value", "SystemExit"):
        assert name not in ended.stderr
    return ended


def test_lines_are_of_every_command():
    assert set(LINES) == set(COMMANDS)


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_command_runs_nothing_of_the_folder(folder, made, tmp_path, name):
    ended = check_nothing_is_opened(folder, [CONSOLE, *shlex.split(LINES[name].format(**made, new=tmp_path))])
    assert (ended.returncode == 2) == (name in REFUSED), ended.stderr


@pytest.mark.parametrize("name", [pytest.param(name, marks=COLD.get(name, pytest.mark.campaign)) for name in COMMANDS])
def test_command_runs_nothing_of_the_folder_where_no_kernel_is_compiled(folder, made, tmp_path, monkeypatch, name):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    ended = check_nothing_is_opened(folder, [CONSOLE, *shlex.split(LINES[name].format(**made, new=tmp_path))])
    assert (ended.returncode == 2) == (name in REFUSED) or "--budget" in LINES[name], ended.stderr  # which compiling may use up
    assert (name in COMPILES) == any(tmp_path.glob("cache/mrp-sumo/kernels/*/*/*.nbc"))


def test_module_runs_nothing_of_the_folder(folder):
    assert not check_nothing_is_opened(folder, [sys.executable, "-P", "-m", "mrp_sumo", "list", "planners"]).returncode


def test_current_folder_is_left_even_where_python_was_told_to_import_from_it(folder):
    code = "import sys; from mrp_sumo.core.children import leave_current_folder as leave; sys.path[:0] = ['', {!r}]; leave(); import wave"
    assert not check_nothing_is_opened(folder, [sys.executable, "-P", "-c", code.format(str(folder))]).returncode


def test_process_of_ours_runs_nothing_of_the_folder_though_python_would(folder):
    assert not check_nothing_is_opened(folder, children.command("mrp_sumo.experiments.kernels:prepare_driving")).returncode
    for name in ("numpy", "planners"):
        with opened_in(folder) as opened:
            subprocess.run([sys.executable, "-c", f"import {name}"], cwd=folder, capture_output=True)
        assert name in opened
    with opened_in(folder) as opened:
        (folder / "matplotlibrc").read_text()
    assert opened == {"matplotlibrc"}


def test_processes_are_started_in_one_way():
    starts = {"executable", "get_context", "Pool", "ProcessPoolExecutor", "fork", "posix_spawn"}
    for file in sorted(p for room in OURS for p in (PROJECT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            name = node.attr if isinstance(node, ast.Attribute) else ""
            assert name not in starts or file.name == "children.py", f"{file}:{node.lineno}: {name}"
