"""Every default that the documentation promises, by running it to a written folder."""

import json

import numpy as np
import pytest
import yaml

from mrp_sumo.cli.main import main
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.io.scenario import Scenario

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
    found = [line for line in lines if line["kind"] == NAMED[kind]]
    assert found and all(line["for_good"] is True and "duration_s" not in line for line in found)
    events = load_run(tmp_path / "run").events
    assert np.isinf(events[events.kind == NAMED[kind]].duration_s).all()


def test_scenario_with_all_defaults_written_out_is_the_scenario_without_them(tmp_path):
    short = written(tmp_path)
    whole = Scenario.model_validate(yaml.safe_load(short.read_text())).model_dump(mode="json")
    (tmp_path / "whole.yaml").write_text(yaml.safe_dump({**whole, "name": "small"}))
    for name in ("small", "whole"):
        assert main(["run", str(tmp_path / f"{name}.yaml"), "--out", str(tmp_path / name)]) == 0
    for file in ("plan.json", "trajectory.parquet", "events.jsonl"):
        assert (tmp_path / "small" / file).read_bytes() == (tmp_path / "whole" / file).read_bytes()
