"""Every default that the documentation promises, by running it to a written folder."""

import json

import numpy as np
import pytest
import yaml

from mrp_sumo.cli.main import main
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.io.scenario.model import ScenarioModel

FOR_GOOD = {
    "breakdowns": {"robot": 0, "begin_s": 2},
    "obstacles": {"x_m": 8.0, "y_m": -3.0, "begin_s": 2},
    "closures": {"between": ["v0", "v1"], "begin_s": 2},
}
NAMED = {"breakdowns": "disturbed", "obstacles": "closed", "closures": "closed"}


def written(tmp_path, name="small", **keys):
    path = tmp_path / f"{name}.yaml"
    path.write_text(yaml.safe_dump({"map": "office", "robots": {"count": 2}, "planner": "pibt", **keys}))
    return path


@pytest.mark.parametrize("kind", FOR_GOOD)
def test_disturbance_without_duration_lasts_for_good(tmp_path, kind):
    execution = {"time_limit_s": 20, "disturbances": {kind: [FOR_GOOD[kind]]}}
    assert main(["run", str(written(tmp_path, execution=execution)), "--out", str(tmp_path / "run"), "--replay"]) in (0, 1)
    lines = [json.loads(line) for line in (tmp_path / "run" / "events.jsonl").read_text().splitlines()]
    outcome = [line for line in lines if line["kind"] == NAMED[kind]]
    assert outcome and all(line["for_good"] is True and "duration_s" not in line for line in outcome)
    events = load_run(tmp_path / "run").events
    assert np.isinf(events[events.kind == NAMED[kind]].duration_s).all()


def test_scenario_with_all_defaults_written_out_is_the_scenario_without_them(tmp_path):
    short = written(tmp_path)
    whole = ScenarioModel.model_validate(yaml.safe_load(short.read_text())).model_dump(mode="json")
    (tmp_path / "whole.yaml").write_text(yaml.safe_dump({**whole, "name": "small"}))
    for name in ("small", "whole"):
        assert main(["run", str(tmp_path / f"{name}.yaml"), "--out", str(tmp_path / name)]) == 0
    for file in ("plan.json", "trajectory.parquet", "events.jsonl"):
        assert (tmp_path / "small" / file).read_bytes() == (tmp_path / "whole" / file).read_bytes()


def test_time_limit_follows_the_plan_where_none_is_stated(tmp_path):
    robots = {"starts": ["v0"], "goals": ["v5"]}
    for name, planned_s, limit_s in (("short", None, 300.0), ("long", 40.0, None)):
        path = written(tmp_path, name, robots=robots, planner={"name": "pibt", "step_s": planned_s, "retime": planned_s is None})
        assert main(["run", str(path), "--out", str(tmp_path / name)]) == 0
        result = json.loads((tmp_path / name / "result.json").read_text())
        used_s = result["metrics"]["execution_time_limit_s"]
        assert used_s == result["scenario"]["execution"]["time_limit_s"]
        assert used_s == limit_s if limit_s else used_s >= 1.5 * result["metrics"]["makespan_s"] > 300


def test_stated_time_limit_is_kept(tmp_path):
    path = written(tmp_path, execution={"time_limit_s": 5})
    assert main(["run", str(path), "--out", str(tmp_path / "run")]) == 1
    metrics = json.loads((tmp_path / "run" / "result.json").read_text())["metrics"]
    assert metrics["execution_time_limit_s"] == metrics["execution_time_s"] == metrics["sim_time_s"] == 5


def test_blocking_window_of_the_scenario_decides_who_is_blocked(tmp_path):
    disturbances, outcome = {"breakdowns": [{"robot": 1, "begin_s": 5}]}, {}
    for window_s in (5, 40):
        execution = {"time_limit_s": 60, "blocking_window_s": window_s, "disturbances": disturbances}
        path = written(tmp_path, f"window_{window_s}", robots={"count": 4}, seed=3, execution=execution)
        main(["run", str(path), "--out", str(tmp_path / path.stem)])
        outcome[window_s] = load_run(tmp_path / path.stem).metrics["blocked_s"]
    assert outcome[5] > outcome[40]
