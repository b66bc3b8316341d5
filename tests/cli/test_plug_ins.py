"""Plug-ins in files, as a user writes and runs them; no plug-in breaks what the commands promise."""

import json
import subprocess
import sys

import pytest

from mrp_sumo.cli.main import main

PLANNER = """
import os, sys, time
from dataclasses import dataclass
from typing import ClassVar
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths

@dataclass(frozen=True)
class Mine:
    patience: int = 3
    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "none"

    def prepare(self):
        pass

    def plan(self, problem, time_limit_s):
        return PlanResult(Status.GAVE_UP, message=f"patience is {self.patience}")
"""

POLICY = """
import sys
from mrp_sumo.drive.policy import Adg

class Mine(Adg):
    def earliest_s(self, plan):
        return super().earliest_s(plan)
"""

SCENARIO = "map: office\nrobots: 2\nassignment: {mode: fixed}\nrecord: {bag: false}\n"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(PLANNER)
    (tmp_path / "mine.yaml").write_text(SCENARIO + "planner: {name: ./mine.py:Mine, time_limit_s: 1}\n")
    return tmp_path


def line_of(words, text=PLANNER):
    return next(i for i, line in enumerate(text.splitlines(), 1) if words in line)


def result(folder):
    return json.loads((folder / "out" / "result.json").read_text())


def test_file_is_relative_to_the_scenario(folder, monkeypatch, capsys):
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert main(["plan", "../mine.yaml", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["message"] == "patience is 3"


def test_file_on_the_command_line_is_relative_to_the_current_folder(folder, monkeypatch, capsys):
    (folder / "suites").mkdir()
    (folder / "suites" / "other.yaml").write_text(SCENARIO)
    assert main(["plan", "suites/other.yaml", "--planner", "mine.py:Mine", "--set", "patience=7", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["message"] == "patience is 7"


FAILURES = {
    "in plan: ZeroDivisionError: division by zero": "1 / 0",
    "in plan: ended the program (SystemExit: 0)": "sys.exit(0)",
    "ended its process with exit code 0 during plan()": "os._exit(0)",
    "plan() returned None, expected a PlanResult": "return None",
    "plan() returned a dict, expected a PlanResult": "return {}",
    "plan() returned vertex 100000 for robot_0": "return PlanResult(Status.SOLVED, plan_of_paths([[100000], [0]], 1.0))",
    "plan() returned plan.first of length 2, expected 3": "return PlanResult(Status.SOLVED, plan_of_paths([[0]], 1.0))",
}


@pytest.mark.parametrize("says", FAILURES)
def test_planner_that_fails_is_a_line_a_status_a_result_and_exit_code_1(folder, capsys, says):
    text = PLANNER.replace("        return PlanResult", f"        {FAILURES[says]}\n        return PlanResult")
    (folder / "mine.py").write_text(text)
    line = line_of(FAILURES[says], text) if says.startswith("in plan") else line_of("def plan", text)
    assert main(["run", "mine.yaml", "--out", "out"]) == 1
    output = capsys.readouterr().err
    assert output.startswith(f"mrp-sumo: planner failed: mine.py:{line}: {says}")
    assert output.count("\n") == 1
    assert result(folder)["status"] == "planner_failed"
    assert says in result(folder)["note"]


@pytest.mark.parametrize("command", [["run", "mine.yaml", "--out", "out"], ["plan", "mine.yaml"]])
def test_traceback_is_there_when_asked_for(folder, capsys, command):
    (folder / "mine.py").write_text(PLANNER.replace("        return", "        1 / 0\n        return"))
    assert main(["plan", "mine.yaml", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["status"] == "planner_failed"
    assert main([*command, "-v"]) == 1
    output = capsys.readouterr().err
    assert "Traceback (most recent call last)" in output
    assert output.splitlines()[-1].startswith("mrp-sumo: planner failed: mine.py:")


def test_planner_that_lacks_a_method_is_named(folder, capsys):
    (folder / "mine.py").write_text(PLANNER.replace("def plan(", "def plann("))
    assert main(["run", "mine.yaml", "--out", "out"]) == 1
    assert (
        capsys.readouterr().err == "mrp-sumo: planner failed: mine.py:8: Mine is no planner: it has no method plan(problem, time_limit_s)\n"
    )
    assert result(folder)["status"] == "planner_failed"


def test_planner_that_sleeps_is_killed_at_its_limit(folder):
    (folder / "mine.py").write_text(PLANNER.replace("        return", "        time.sleep(600)\n        return"))
    assert main(["run", "mine.yaml", "--out", "out"]) == 1
    outcome = result(folder)
    assert outcome["status"] == "planning_timed_out"
    assert 1.0 <= outcome["metrics"]["planning_time_s"] < 600


@pytest.mark.slow
def test_program_does_not_end_with_a_plug_in(folder):
    """In a process of its own, as a user has it."""
    (folder / "mine.py").write_text("import os\nos._exit(0)\n" + PLANNER)
    command = [sys.executable, "-m", "mrp_sumo", "run", "mine.yaml", "--trust", "--out", "out"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert ended.stderr == "mrp-sumo: planner failed: mine.py:10: ended its process with exit code 0 during load()\n"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--planner", "mien.py:Mine"], "--planner: planner '{folder}/mien.py:Mine': no such file: mien.py (did you mean 'mine.py'?)"),
        (["--planner", "mine.py:Mien"], "--planner: planner '{folder}/mine.py:Mien': mine.py has no 'Mien' (did you mean 'Mine'?)"),
        (["--planner", "mine.py"], "--planner: planner 'mine.py' is a file: expected the name in it, too, as in mine.py:NAME"),
        (["--set", "patients=3"], "--set patients: planner './mine.py:Mine': unknown parameter 'patients' (did you mean 'patience'?)"),
        (["--set", "patience=long"], "--set patience: planner './mine.py:Mine': patience is 'long', expected a whole number"),
        (["--set", "execution.polcy=adg"], "--set execution.polcy: unknown key (did you mean 'execution.policy'?)"),
        (["--set", "planner.patience=3"], "--set planner.patience: unknown key (did you mean 'planner.parameters.patience'?)"),
        (["--set", "planner.nam=cbs"], "--set planner.nam: unknown key (did you mean 'planner.name'?)"),
        (["--set", "seed=-3"], "--set seed: found -3, expected 0 or more"),
        (["--set", "seed"], "--set seed: expected KEY=VALUE"),
        (["--policy", "agd"], "--policy: unknown execution policy 'agd' (did you mean 'adg'?)"),
        (["--time-limit", "0"], "--time-limit is 0, expected a number of seconds above 0"),
    ],
)
def test_choice_that_cannot_be_right_is_one_line_exit_code_2_and_nothing_written(folder, capsys, options, says):
    assert main(["run", "mine.yaml", "--out", "out", *options]) == 2
    assert capsys.readouterr().err == f"mrp-sumo: {says.format(folder=folder.resolve())}\n"
    assert not (folder / "out").exists()


def test_any_key_of_the_scenario_can_be_set(folder):
    options = ["--set", "planner=cbs", "--set", "execution.time_limit_s=5", "--set", "robots.count=1", "--policy", "timed"]
    main(["run", "mine.yaml", "--out", "out", *options])
    scenario = result(folder)["scenario"]
    assert scenario["planner"] == {**scenario["planner"], "name": "cbs", "time_limit_s": 1.0, "parameters": {}}
    assert scenario["execution"]["time_limit_s"] == 5
    assert scenario["execution"]["policy"] == result(folder)["policy"] == "timed"
    assert scenario["robots"]["count"] == 1


POLICY_FAILURES = {
    "in earliest_s: ZeroDivisionError: division by zero": "1 / 0",
    "in earliest_s: ended the program (SystemExit: 0)": "sys.exit(0)",
    "earliest_s() returned an array of shape [2] and float64": "return [0.0, 1.0]",
    "earliest_s() returned an array of shape [] and object": "return None",
}


@pytest.mark.parametrize("says", POLICY_FAILURES)
def test_policy_that_fails_is_a_line_a_status_a_result_and_exit_code_1(folder, capsys, says):
    (folder / "mine.py").write_text(POLICY.replace("        return", f"        {POLICY_FAILURES[says]}\n        return"))
    (folder / "mine.yaml").write_text(SCENARIO + "planner: lacam\n")
    assert main(["run", "mine.yaml", "--policy", "mine.py:Mine", "--out", "out"]) == 1
    output = capsys.readouterr().err
    assert output.startswith("mrp-sumo: policy failed: mine.py:")
    assert says in output
    assert output.count("\n") == 1
    assert result(folder)["status"] == "policy_failed"
    assert (folder / "out" / "plan.json").is_file()


def test_dispatcher_that_fails_is_a_line_a_status_a_result_and_exit_code_1(folder, capsys):
    (folder / "mine.py").write_text(
        "class Mine:\n    def finished(self, now_s, context): return False\n"
        "    def due(self, now_s, context): return 1 / 0\n    def answer(self, request, context): return None\n"
    )
    (folder / "mine.yaml").write_text(SCENARIO + "planner: lacam\n")
    assert main(["run", "mine.yaml", "--set", "execution.dispatcher=mine.py:Mine", "--out", "out"]) == 1
    said = capsys.readouterr().err
    assert said == "mrp-sumo: dispatcher failed: mine.py:3: in due: ZeroDivisionError: division by zero\n"
    assert result(folder)["status"] == "dispatcher_failed"


def test_policy_that_lacks_a_method_is_named(folder, capsys):
    (folder / "mine.py").write_text("class Mine:\n    look_ahead, paced, keeps_order, sound_plan_only = 4, False, False, False\n")
    (folder / "mine.yaml").write_text(SCENARIO + "planner: lacam\n")
    assert main(["run", "mine.yaml", "--policy", "mine.py:Mine", "--out", "out"]) == 1
    line = "mine.py:1: Mine is no execution policy: it has no method order(problem, plan, needs)"
    assert capsys.readouterr().err == f"mrp-sumo: policy failed: {line}\n"


DECIDES = (
    POLICY
    + """
    decides_every_s = 1

    def decide(self, problem, plan, needs, now_s):
        return None
"""
)


def test_policy_of_a_file_may_decide_while_robots_drive(folder, capsys):
    (folder / "mine.yaml").write_text(SCENARIO + "planner: lacam\n")
    (folder / "mine.py").write_text(DECIDES)
    assert main(["run", "mine.yaml", "--policy", "mine.py:Mine", "--out", "out"]) == 0
    for wrong, says in {
        "return 1 / 0": "mine.py:12: in decide: ZeroDivisionError",
        "return 3": "mine.py:11: decide() returned int, expected a Schedule",
    }.items():
        (folder / "mine.py").write_text(DECIDES.replace("return None", wrong))
        assert main(["run", "mine.yaml", "--policy", "mine.py:Mine", "--out", "out"]) == 1
        assert f"mrp-sumo: policy failed: {says}" in capsys.readouterr().err
    (folder / "mine.py").write_text(DECIDES.replace("= 1\n", "= 'often'\n"))
    assert main(["run", "mine.yaml", "--policy", "mine.py:Mine", "--out", "out"]) == 1
    says = "mine.py:5: Mine is no policy that decides while driving: 'decides_every_s' is 'often', expected float"
    assert capsys.readouterr().err == f"mrp-sumo: policy failed: {says}\n"


def test_validate_executes_no_plug_in(folder, capsys):
    assert main(["plan", "mine.yaml", "--planner", "cbs", "--out", "plan.json"]) == 0
    (folder / "mine.py").write_text(f"open('{folder}/executed', 'w')\n" + PLANNER)
    (folder / "mine.yaml").write_text((folder / "mine.yaml").read_text() + "execution: {policy: ./mine.py:Mine}\n")
    assert main(["validate", "plan.json", "--scenario", "mine.yaml"]) == 0
    assert not (folder / "executed").exists()


def test_replanner_may_be_a_plug_in(folder):
    (folder / "mine.yaml").write_text(SCENARIO + "planner: lacam\nexecution: {recovery: {replanner: ./mine.py:Mien}}\n")
    assert main(["run", "mine.yaml", "--out", "out"]) == 2
    (folder / "mine.yaml").write_text(SCENARIO + "planner: lacam\nexecution: {recovery: {replanner: ./mine.py:Mine}}\n")
    assert main(["run", "mine.yaml", "--out", "out"]) == 0


def test_assigner_that_fails_is_a_planner_that_failed(folder, capsys):
    (folder / "mine.py").write_text("class Mine:\n    def assign(self, cost, time_limit_s):\n        return cost[0, 99999]\n")
    (folder / "mine.yaml").write_text("map: office\nrobots: 2\nassignment: {solver: ./mine.py:Mine}\nplanner: lacam\n")
    assert main(["run", "mine.yaml", "--out", "out"]) == 1
    assert capsys.readouterr().err.startswith("mrp-sumo: planner failed: mine.py:3: in assign: IndexError: ")
    assert result(folder)["status"] == "planner_failed"
