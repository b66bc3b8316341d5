"""A crash of SUMO takes its worker with it, not the batch: the run's result says so and the others go on."""

from pathlib import Path

import pytest
from fake_runs import Silent

from mrp_sumo.experiments import batch as batches
from mrp_sumo.experiments.batch import Making, run_batch
from mrp_sumo.experiments.suite import read_suite
from mrp_sumo.io.results import records_in


@pytest.mark.slow
def test_a_crash_of_sumo_in_the_middle_of_a_run_is_its_result(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))
    monkeypatch.setattr(batches, "code_version", lambda: "1")  # whatever is edited meanwhile
    path = tmp_path / "study.yaml"
    path.write_text("base: office_5\ngrid_search: {seed: 0..2, planner: [prioritised], execution.time_limit_s: [30]}\n")
    batch = run_batch(read_suite(path), tmp_path / "out", Silent(), Making(1, retries=0), function="crashing_runs:measure")
    output = {record["scenario"]["seed"]: record for record in records_in(batch.folder, pytest.fail)}
    assert sorted(output) == [0, 1, 2]
    assert (output[1]["status"], output[1]["success"]) == ("crashed", False)
    assert output[1]["reason"].startswith("worker killed by SIGSEGV")
    for seed in (0, 2):
        assert output[seed]["status"] in ("completed", "time_limit") and output[seed]["metrics"]["sim_time_s"] > 5


def test_reason_of_a_run_that_ended_early_is_how_many_came_to_their_goals(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(
        "base: {map: office, robots: 2, planner: prioritised, execution: {engine: kinematic, time_limit_s: 1}}\ngrid_search: {seed: [0]}\n"
    )
    batch = run_batch(read_suite(path), tmp_path / "out", Silent(), Making(1))
    (record,) = records_in(batch.folder, pytest.fail)
    assert (record["status"], record["reason"]) == ("time_limit", "0 of 2 robots at their goals")
