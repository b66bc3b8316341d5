"""Metrics of users: a function in a file, measured with the run or later, and whatever it does costs no result."""

import json

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.experiments.measure_later import measure_run
from mrp_sumo.io.results import load_results
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.metrics.registry import METRICS
from mrp_sumo.plugins import limit

MINE = '''"""Metrics of ours."""

import time

import numpy as np

from mrp_sumo.metrics.metric import metric


@metric("m", "less", "metres driven by all robots")
def driven(run):
    step = np.hypot(np.diff(run.execution.x_m, axis=0), np.diff(run.execution.y_m, axis=0))
    return step.sum()


def top_speed_mps(run):
    """The fastest that any robot was."""
    return float(run.execution.speed_mps.max())


def broken(run):
    return run.nonsense


def text(run):
    return "far"


def leaves(run):
    raise SystemExit(0)


def endless(run):
    time.sleep(60)


def soc_steps(run):
    return 1


LIST = [1]
'''


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A folder with a file of metrics, a scenario that names two of them, and its run."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "mine.py").write_text(MINE)
    scenario = "map: office\nrobots: {count: 3}\nplanner: pibt\nrecord: {metrics: ['./mine.py:driven', './mine.py:top_speed_mps']}\n"
    (folder / "mine.yaml").write_text(scenario)
    assert main(["run", str(folder / "mine.yaml"), "--out", str(folder / "run")]) == 0
    return folder


def metrics_of(folder):
    return json.loads((folder / "result.json").read_text())["metrics"]


def test_metric_of_a_file_stands_among_the_others(world):
    outcome = metrics_of(world / "run")
    assert outcome["driven"] > 10 and 0.2 < outcome["top_speed_mps"] <= 0.2201
    assert set(outcome) == {m.name for m in METRICS} | {"driven", "top_speed_mps"}


def test_every_metric_can_be_computed_later_from_the_folder(world):
    run = load_run(world / "run")
    assert measure_run(run, METRICS) == {name: run.metrics[name] for name in (m.name for m in METRICS)}


def test_analyze_computes_a_metric_of_a_run(world, capsys):
    assert main(["analyze", str(world / "run"), "--metric", f"{world}/mine.py:driven", "--metric", "soc_steps", "--json"]) == 0
    output = json.loads(capsys.readouterr().out)
    assert output == {name: metrics_of(world / "run")[name] for name in ("driven", "soc_steps")}


@pytest.mark.parametrize(
    ("name", "output"),
    [
        ("broken", "mine.py:22: in broken: AttributeError: 'Evidence' object has no attribute 'nonsense'"),
        ("text", "text is 'far', expected a finite number, true or false, a list, or None"),
        ("leaves", "ended the program (SystemExit: 0)"),
        ("endless", "mine.py:34: in endless: has not ended after 2 s"),
    ],
)
def test_metric_that_fails_is_one_line_and_exit_code_1_and_costs_no_result(world, capsys, monkeypatch, name, output):
    if name == "endless":  # the others have all the time they need on a busy machine
        monkeypatch.setattr(limit, "LIMIT_S", 2.0)
    out = world / name
    assert main(["run", str(world / "mine.yaml"), "--metric", f"{world}/mine.py:{name}", "--out", str(out)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("mrp-sumo: metric failed: ") and output in line
    result = json.loads((out / "result.json").read_text())
    assert output in result["note"] and result["metrics"][name] is None and result["status"] == "completed"
    assert load_run(out).execution.x_m.size
    assert main(["analyze", str(out), "--metric", f"{world}/mine.py:{name}"]) == 1
    assert output in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "output"),
    [
        ("mine.py:drivn", "did you mean 'driven'?"),
        ("mine.py:soc_steps", "'soc_steps' is the name of a bundled metric"),
        ("mine.py:LIST", "LIST is list, expected a function"),
        ("absent.py:driven", "absent.py"),
        ("soc_stps", "unknown metric 'soc_stps' (did you mean 'soc_steps'?)"),
    ],
)
def test_metric_that_is_none_is_refused_before_anything_runs(world, capsys, monkeypatch, name, output):
    monkeypatch.chdir(world)
    broken = "LIST" in name  # a plug-in that breaks its contract; its line begins with its own file
    assert main(["run", "mine.yaml", "--metric", name, "--out", "refused"]) == (1 if broken else 2)
    line = capsys.readouterr().err
    assert output in line and ("mrp-sumo: mine.py" if broken else "--metric") in line and "Traceback" not in line
    assert not (world / "refused").exists()


@pytest.mark.slow
def test_metrics_of_a_batch_computed_later_are_those_computed_with_it(tmp_path, capsys):
    (tmp_path / "mine.py").write_text(MINE)
    base = "base: {map: office, planner: pibt, robots: {count: 2}, record: {metrics: ['./mine.py:driven']}}\n"
    (tmp_path / "study.yaml").write_text(base + "grid_search: {seed: 0..1, execution.disturbances: [{}, nav2_like]}\n")
    out, name = tmp_path / "out", f"{tmp_path}/mine.py:top_speed_mps"
    again = ["batch", str(tmp_path / "study.yaml"), "--out", str(out), "--workers", "1", "--trust"]
    assert main([*again, "--metric", name]) == 0
    assert "top_speed_mps of 4 of 4 runs" in capsys.readouterr().out
    with_it = load_results(out)
    assert main(["analyze", str(out), "--metric", f"{tmp_path}/mine.py:driven", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"metrics": ["driven"], "measured": 4, "runs": 4}
    later = load_results(out)
    assert later["driven"].tolist() == with_it["driven"].tolist() and with_it["driven"].nunique() == 4
    assert with_it["top_speed_mps"].between(0.2, 0.23).all()
    assert len(list((out / "floors").iterdir())) == 1  # of all runs
    assert main([*again, "--metric", "mine.py:absent"]) == 2


@pytest.mark.slow
def test_a_batch_whose_metric_fails_keeps_its_results(tmp_path, capsys):
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "study.yaml").write_text("base: {map: office, planner: pibt, robots: {count: 2}}\ngrid_search: {seed: [1]}\n")
    out = tmp_path / "out"
    assert main(["batch", str(tmp_path / "study.yaml"), "--out", str(out), "--workers", "1", "--metric", f"{tmp_path}/mine.py:broken"]) == 1
    said = capsys.readouterr()
    assert "in broken: AttributeError" in said.err and "broken of 0 of 1 runs" in said.out
    assert load_results(out)["status"].tolist() == ["completed"]
