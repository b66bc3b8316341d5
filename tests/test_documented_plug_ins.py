"""The plug-ins that the documentation shows work as they stand there."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.io.run_reader import load_run

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = "\n".join((DOCS / name).read_text(encoding="utf-8") for name in ("own_planner.md", "own_plugins.md"))


def sample(file):
    """A file of the pages, by the name that its first line has."""
    return next(text for text in re.findall(r"```python.*?\n(.*?)```", PAGE, re.DOTALL) if text.startswith(f'"""{file}:'))


@pytest.fixture
def files(tmp_path, monkeypatch):
    for name in ("onebyone.py", "greedy.py", "late.py", "patrol.py"):
        (tmp_path / name).write_text(sample(name))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def result(folder):
    return json.loads((folder / "result.json").read_text())


def test_planner_of_the_page_solves_the_office(files):
    assert main(["run", "office_9", "--planner", "onebyone.py:OneByOne", "--set", "attempts=20", "--out", "run"]) == 0
    outcome = result(files / "run")
    assert outcome["status"] == "completed"
    assert outcome["metrics"]["plan_valid"]
    assert outcome["metrics"]["planning_time_s"] > 0


def test_assigner_and_policy_of_the_page_run_from_a_scenario(files):
    (files / "mine.yaml").write_text(
        "map: office\nrobots: 3\nplanner: {name: ./onebyone.py:OneByOne, time_limit_s: 10, parameters: {attempts: 20}}\n"
        "assignment: {solver: ./greedy.py:Greedy, cost: path}\n"
        "execution: {policy: {name: ./late.py:LateStart, parameters: {delay_s: 5}}}\n"
    )
    assert main(["run", "mine.yaml", "--out", "late"]) == 0
    assert main(["run", "mine.yaml", "--policy", "adg", "--out", "usual"]) == 0
    late, usual = result(files / "late"), result(files / "usual")
    assert late["policy"] == "./late.py:LateStart"
    first, second = ([robot["goal_s"] for robot in run["robots"] if robot["goal_s"]] for run in (usual, late))  # one starts at its goal
    assert len(first) == 2
    assert second == pytest.approx([goal_s + 5 for goal_s in first], abs=0.2)


def test_dispatcher_of_the_page_brings_robots_back(files):
    (files / "there_and_back.yaml").write_text(
        "map: office\nrobots: 3\nplanner: lacam\nexecution: {dispatcher: {name: ./patrol.py:Patrol, parameters: {trips: 1}}}\n"
    )
    assert main(["run", "there_and_back.yaml", "--trust", "--out", "run"]) == 0
    run = load_run(files / "run")
    first, last = run.execution.x_m[[0, -1]], run.execution.y_m[[0, -1]]
    assert np.hypot(first[0] - first[1], last[0] - last[1]).max() < 0.01  # where they began
    assert [reply.reason for reply in run.execution.replies] == ["patrol"]


@pytest.mark.slow
def test_planner_of_the_page_satisfies_the_protocol(files):
    """With `ClassVar` attributes, and strictly typed."""
    text = sample("onebyone.py")
    text = text.replace("def plan(self, problem, time_limit_s):", "def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:")
    text = text[: text.index("def plan_in_order")].replace("plan_in_order(problem, order)", "[[0]]")
    text = text.replace("import PlanResult, Status, plan_of_paths\n", "import PlanResult, Status, plan_of_paths\n" + IMPORTS)
    (files / "typed.py").write_text(text + "planner: Planner = OneByOne()\n")
    check = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "--no-incremental", "typed.py"]
    output = subprocess.run(check, capture_output=True, text=True, check=False).stdout
    assert "Success" in output, output


IMPORTS = "from mrp_sumo.core.problem import Problem\nfrom mrp_sumo.planning.protocol import Planner\n"
