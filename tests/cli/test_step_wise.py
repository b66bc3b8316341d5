import json
from pathlib import Path

import pytest
from step_wise_worlds import ROUND, write_problem

from mrp_sumo.cli.main import main

PLANNER = f"{Path(__file__).parents[1] / 'step_wise_worlds.py'}:RoundAndRound"


@pytest.fixture
def planned(tmp_path, capsys):
    """A problem, its solution by robots that go round, and what `plan` printed."""
    problem, out = write_problem(tmp_path, ROUND, [0, 1], [[2], [3], [8, 6]]), tmp_path / "solution.json"
    assert main(["plan", str(problem), "--steps", "20", "--planner", PLANNER, "--out", str(out), "--json"]) == 0
    return problem, out, json.loads(capsys.readouterr().out)


def test_plan_prints_what_was_done_and_validate_accepts_it(planned, capsys):
    problem, out, printed = planned
    assert printed["valid"]
    assert printed["steps"] == 20
    assert printed["tasks_done"] == json.loads(out.read_text())["numTaskFinished"] > 2
    assert printed["planning_cpu_s"] >= 0
    assert main(["validate", str(out), "--problem", str(problem)]) == 0
    assert capsys.readouterr().out == f"valid: 2 robots, 20 steps, {printed['tasks_done']} tasks done\n"
    assert main(["validate", str(out), "--problem", str(problem), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["tasks_done"] == printed["tasks_done"]


def test_a_crowd_that_stands_still_is_no_success(tmp_path, capsys):
    """Two robots in a row of three cells want to pass each other."""
    problem = write_problem(tmp_path, ["..."], [0, 2], [[2], [0]])
    assert main(["plan", str(problem), "--steps", "40", "--set", "tasks=in_turn", "--json"]) == 1
    printed = json.loads(capsys.readouterr().out)
    assert printed["valid"] and printed["status"] == "stalled" and 0 < printed["wait_share"] < 1
    assert printed["stalled_since_step"] < 20 and sum(printed["errands_by_tenth"]) == printed["errands_done"]
    assert printed["message"] == f"no errand is done after step {printed['stalled_since_step']}"


def test_validate_names_the_first_fault(planned, capsys):
    problem, out, _ = planned
    document = json.loads(out.read_text())
    document["actualPaths"][0] = document["actualPaths"][0].replace("F", "W", 1)
    out.write_text(json.dumps(document))
    assert main(["validate", str(out), "--problem", str(problem)]) == 1
    assert capsys.readouterr().out.startswith("time ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["plan", "x.json"], "--steps is missing"),
        (["plan", "x.json", "--steps", "0"], "--steps is 0, expected 1 to 1000000"),
        (["plan", "x.json", "--steps", "5", "--robots", "1"], "--robots is not for problems that are planned step by step"),
        (["plan", "x.json", "--steps", "5", "--planner", "epibd"], "unknown step-wise planner 'epibd' (did you mean 'epibt'?)"),
        (["plan", "x.json", "--steps", "5", "--out", "out.yaml"], "expected a name that ends in .json"),
        (["plan", "none.json", "--steps", "5"], "none.json: no such file or directory"),
        (["plan", "null.json", "--steps", "5"], "null.json: found null, expected an object with mapFile"),
        (["validate", "x.json", "--problem", "x.json"], "x.json: start is missing"),
        (["validate", "none.json", "--problem", "x.json"], "none.json: no such file or directory"),
        (["validate", "none.zip2"], "none.zip2: no such file or directory"),
        (["validate", "x.csv"], "x.csv: found a log, expected a plan, --vda5050 for a log of VDA 5050, or an archive"),
        (["validate", "x.json", "--problem", "x.json", "--map", "x.map"], "expected either --map (with --scen), --scenario or --problem"),
    ],
)
def test_bad_request_is_one_line(tmp_path, monkeypatch, capsys, arguments, message):
    write_problem(tmp_path, ROUND, [0, 1], [[2]])
    (tmp_path / "x.csv").write_text("t_s,x_m,y_m\n")
    (tmp_path / "null.json").write_text("null")
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert printed.count("\n") == 1


def test_planner_that_answers_nonsense_is_one_line(tmp_path, capsys):
    (tmp_path / "mine.py").write_text(
        "class Mine:\n def prepare(self): pass\n def begin(self, p, s): return self\n def step(self, seen): return 7\n"
    )
    problem = write_problem(tmp_path, ROUND, [0, 1], [[2]])
    assert main(["plan", str(problem), "--steps", "5", "--planner", f"{tmp_path}/mine.py:Mine"]) == 1
    assert capsys.readouterr().err == "mrp-sumo: planner 'Mine', step 0: answers int, expected a Decision or an action for each robot\n"
