"""The front door as a whole: names, laziness, types, and the tour in the documentation."""

import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import mrp_sumo as ms

PROJECT = Path(__file__).resolve().parents[2]
TOUR = PROJECT / "docs" / "python.md"
LISTED = (
    "import sys, mrp_sumo as ms; {}; print(*sorted(m for m in ('numpy', 'pandas', 'matplotlib', 'pydantic', 'yaml') if m in sys.modules))"
)

SAMPLE = """\
from pathlib import Path

import mrp_sumo as ms

site: ms.Site = ms.load_map("office", largest_component=True)
scenario = ms.Scenario(map=site, robots=9, planner={"name": "eecbs"}, seed=3)
problem: ms.Problem = ms.problem(scenario)
plan: ms.Solution = ms.plan(problem, "ecbs", w=1.2, time_limit_s=10)
valid: bool = ms.judge(problem, plan).valid
run = ms.simulate(problem, plan, policy="adg", time_limit_s=600)
folder: Path = run.save("runs/x")
batch: ms.Batch = ms.run_suite("paper_comparison", workers=2)
reveal_type(run)
reveal_type(run.executed)
reveal_type(plan.cost_steps)


def own(problem: ms.Problem, time_limit_s: float) -> list[list[int]]:
    return [[v] for v in problem.start.tolist()]


ms.plan(problem, own)
"""
WRONG = """\
import mrp_sumo as ms

ms.Scenario(map="office", robot=9)
ms.plan("office", "cbs")
ms.lod_map("office")
"""


def loaded_after(code):
    done = subprocess.run([sys.executable, "-c", LISTED.format(code)], capture_output=True, text=True, check=True, cwd=PROJECT)
    return done.stdout.split()


@pytest.fixture(scope="module")
def checked(tmp_path_factory):
    """What mypy says of the samples, strict and with the gate's cache, by sample."""
    from mypy import api

    files = {name: tmp_path_factory.mktemp("samples") / f"{name}.py" for name in ("sample", "wrong")}
    files["sample"].write_text(SAMPLE)
    files["wrong"].write_text(WRONG)
    out, _, _ = api.run(["--config-file", str(PROJECT / "pyproject.toml"), *map(str, files.values())])
    return {name: [line.partition(f"{name}.py:")[2] for line in out.splitlines() if f"{name}.py:" in line] for name in files}


def test_every_name_is_there_and_editors_see_it():
    assert dir(ms) == ms.__all__ == sorted(ms.__all__)
    assert set(ms.__all__) == {*ms._HOMES, "__version__"}
    for name, home in ms._HOMES.items():
        assert getattr(ms, name) is getattr(import_module(f"mrp_sumo.{home}"), name)


def test_unknown_name_is_refused_with_the_nearest():
    with pytest.raises(AttributeError, match=r"has no attribute 'simulat' \(did you mean 'simulate'\?\)"):
        ms.simulat  # noqa: B018


@pytest.mark.parametrize("code", ["dir(ms)", "ms.__version__", "ms.MrpSumoError"])
def test_import_loads_nothing_heavy(code):
    assert loaded_after(code) == []


def test_maps_and_plans_load_neither_tables_nor_pictures():
    assert loaded_after("ms.plan(ms.problem(ms.Scenario(ms.load_map('office'), 2)), 'cbs')") == ["numpy", "pydantic", "yaml"]


def test_calls_of_the_tour_are_typed(checked):
    shown = [line.partition('"')[2].rstrip('"').replace("builtins.", "") for line in checked["sample"] if "Revealed type" in line]
    assert shown == ["mrp_sumo.door.running.Run", "bool", "float | None"]
    assert not [line for line in checked["sample"] if "error" in line]


def test_wrong_calls_are_found_by_types(checked):
    errors = [line for line in checked["wrong"] if "error" in line]
    assert [int(line.split(":")[0]) for line in errors] == [3, 4, 5]


def test_package_says_that_it_is_typed():
    assert (PROJECT / "mrp_sumo" / "py.typed").is_file()


def test_public_names_have_docstrings():
    assert not [name for name in ms._HOMES if not (getattr(ms, name).__doc__ or "").strip()]


def test_module_is_the_command():
    done = subprocess.run([sys.executable, "-m", "mrp_sumo", "--version"], capture_output=True, text=True, check=True, cwd=PROJECT)
    assert done.stdout == f"mrp-sumo {ms.__version__}\n"


@pytest.mark.slow
def test_every_line_of_the_tour_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```", TOUR.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    names = {}
    for block in blocks:
        exec(compile(block, str(TOUR), "exec"), names)
    assert names["verdict"] and names["batch"].counts == {"completed": 4}
    assert (tmp_path / "office.svg").is_file() and (tmp_path / "runs" / "first" / "bag").is_dir()
