"""Batches know the source of the plug-ins that they use: results of an edited one are never taken for its own."""

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.experiments import batch as batches
from mrp_sumo.io.results import read_plan, records_in

pytestmark = pytest.mark.slow

PLANNER = """
from dataclasses import dataclass
from typing import ClassVar
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from helper_of_mine import PAUSE

@dataclass(frozen=True)
class Mine:
    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "none"

    def prepare(self):
        pass

    def plan(self, problem, time_limit_s):
        return PlanResult(Status.GAVE_UP, message=f"{PAUSE} pauses")
"""

SUITE = """
base: {map: office, robots: 2, assignment: {mode: fixed}}
grid_search: {planner: [./mine.py:Mine, astar], seed: [1, 2]}
until: plan
"""


@pytest.fixture
def suite(tmp_path, monkeypatch):
    monkeypatch.setattr(batches, "code_version", lambda: "1")  # whatever is edited meanwhile
    (tmp_path / "mine.py").write_text(PLANNER)
    (tmp_path / "helper_of_mine.py").write_text("PAUSE = 3\n")
    (tmp_path / "suite.yaml").write_text(SUITE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(capsys):
    """Exit code of a batch, the reasons in its table, and how many runs were done before."""
    code = main(["batch", "suite.yaml", "--out", "out", "--workers", "1"])
    output = capsys.readouterr()
    done = next((line for line in output.err.splitlines() if "going on" in line), "0 of 4")
    return code, done, output


def reasons(folder):
    keys = read_plan(folder / "out")["keys"]
    return {record["reason"] for record in records_in(folder / "out", print) if record["key"] in keys}


@pytest.mark.parametrize("edited", ["mine.py", "helper_of_mine.py"])
def test_edited_planner_makes_its_runs_again_and_no_others(suite, capsys, edited):
    assert run(capsys)[0] == 0
    assert reasons(suite) >= {"3 pauses"}
    assert "4 of 4" in run(capsys)[1]
    file = suite / edited
    file.write_text(file.read_text().replace("pauses", "stops").replace("= 3", "= 4"))
    code, done, _ = run(capsys)
    assert code == 0
    assert "2 of 4 runs done" in done
    assert {"3 stops", "4 pauses"} & reasons(suite)
    assert "3 pauses" not in reasons(suite)


def test_dry_run_executes_nothing(suite, capsys):
    (suite / "mine.py").write_text(f"open('{suite}/executed', 'w')\n" + PLANNER)
    assert main(["batch", "suite.yaml", "--out", "out", "--dry-run"]) == 0
    assert "4 runs, 0 done, 4 to make" in capsys.readouterr().out
    assert not (suite / "executed").exists()


def test_planner_that_fails_is_a_result_of_its_runs(suite, capsys):
    (suite / "mine.py").write_text(PLANNER.replace("PlanResult(Status.GAVE_UP", "PlnResult(Status.GAVE_UP"))
    assert run(capsys)[0] == 0
    failed = [record for record in records_in(suite / "out", print) if record["status"] == "planner_failed"]
    assert len(failed) == 2
    assert not any(record["success"] for record in failed)
    assert "mine.py:16: in plan: NameError: name 'PlnResult' is not defined" in failed[0]["reason"]


def test_planner_edited_while_the_batch_runs_gives_no_result(suite, capsys):
    text = "from pathlib import Path\nPath(__file__).with_name('helper_of_mine.py').write_text('PAUSE = 5\\n')\n"
    (suite / "mine.py").write_text(text + PLANNER)
    code, _, _ = run(capsys)
    assert code == 1
    assert "a plug-in was edited while the batch ran; start the batch again" in reasons(suite)


def test_plug_in_that_is_not_there_is_bad_input(suite, capsys):
    (suite / "suite.yaml").write_text(SUITE.replace("mine.py:Mine", "mine.py:Mien"))
    code, _, output = run(capsys)
    assert code == 2
    assert "suite.yaml:3: grid_search.planner: planner './mine.py:Mien': mine.py has no 'Mien' (did you mean 'Mine'?)" in output.err
    assert output.err.count("\n") == 1
