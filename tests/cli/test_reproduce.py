"""`mrp-sumo reproduce`: a run and a batch, made again."""

import json
import shutil

import pytest

from mrp_sumo.cli.main import main


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduce") / "run"
    assert main(["run", "office_5", "--set", "execution.engine=kinematic", "--set", "record.bag=false", "--out", str(out)]) == 0
    return out


def test_a_run_is_the_same_again(finished, capsys):
    assert main(["reproduce", str(finished)]) == 0
    assert "every byte is the same, " in capsys.readouterr().out


def test_what_differs_is_named(finished, tmp_path, capsys):
    run = shutil.copytree(finished, tmp_path / "run")
    result = json.loads((run / "result.json").read_text())
    result["scenario"]["seed"] = 3001
    result["versions"]["numpy"] = "1.0"
    (run / "result.json").write_text(json.dumps(result))
    (run / "events.jsonl").write_text("")
    assert main(["reproduce", str(run)]) == 1
    said = capsys.readouterr()
    lines = said.out.splitlines()
    assert "events.jsonl: was changed after the run" in lines
    assert any(line.startswith("result.json: metrics.makespan_s is ") for line in lines)
    assert any(line.startswith("plan.json: line ") for line in lines)
    assert "made with numpy 1.0, here is " in said.err


def test_plan_that_the_clock_may_have_shaped_is_marked_and_one_that_a_budget_ended_is_not(tmp_path, capsys):
    run = ["run", "office_5", "--set", "planner.name=lns2", "--set", "planner.parameters.anytime=true", "--set", "record.bag=false"]
    run += ["--set", "execution.engine=kinematic", "--set", "execution.time_limit_s=1"]
    for name, key in (("clock", "planner.time_limit_s=0.05"), ("budget", "planner.budget=20000")):
        main([*run, "--set", key, "--out", str(tmp_path / name)])
    marks = {name: json.loads((tmp_path / name / "result.json").read_text())["plan"]["clock_limited"] for name in ("clock", "budget")}
    assert marks == {"clock": True, "budget": False}
    capsys.readouterr()
    assert main(["reproduce", str(tmp_path / "budget")]) == 0


def test_budget_is_refused_for_a_planner_that_does_not_count(tmp_path, capsys):
    assert main(["run", "office_5", "--set", "planner.name=cbs_ta", "--set", "planner.budget=100", "--out", str(tmp_path / "run")]) == 2
    assert "planner.budget" in (said := capsys.readouterr().err)
    assert "'cbs_ta' does not count its labels, expected one that does (auto, cbs, " in said


@pytest.mark.slow
def test_a_batch_is_the_same_again(tmp_path, capsys):
    suite = tmp_path / "two.yaml"
    suite.write_text("name: two\nbase: office_5\nuntil: plan\ngrid_search: {seed: 3000..3001}\n")
    assert main(["batch", str(suite), "--out", str(tmp_path / "out"), "--workers", "1"]) == 0
    assert main(["reproduce", str(tmp_path / "out")]) == 0
    assert "every result is the same, 2 runs" in capsys.readouterr().out
    assert main(["reproduce", str(tmp_path / "out"), "--runs", "3"]) == 2
    assert "--runs: found 3, expected 1 to 2" in capsys.readouterr().err


def test_bad_input_is_one_line(finished, tmp_path, capsys):
    for arguments in ([str(tmp_path)], [str(tmp_path / "none")], [str(finished), "--runs", "3"]):
        assert main(["reproduce", *arguments]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_a_map_that_is_elsewhere_names_the_option_that_says_where(finished, tmp_path, capsys):
    run = shutil.copytree(finished, tmp_path / "run")
    result = json.loads((run / "result.json").read_text())
    result["scenario"]["map"]["file"] = "../site.yaml"
    (run / "result.json").write_text(json.dumps(result))
    assert main(["reproduce", str(run), "--base", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "no map '../site.yaml'" in said and said.endswith(f"; --base says where the paths of its scenario begin, now {tmp_path}\n")


def test_a_folder_of_runs_without_the_plan_of_a_batch_is_none_here_as_elsewhere(tmp_path, capsys):
    (tmp_path / "runs").mkdir()
    for command in (["reproduce"], ["analyze", "--metric", "makespan_s"]):
        assert main([*command, str(tmp_path)]) == 2
        assert "no run has a result" not in (said := capsys.readouterr().err) and said.count("\n") == 1
