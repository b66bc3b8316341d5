"""Answers while they come, of records whose figures are known."""

import pytest

from mrp_sumo.io.results import write_record
from mrp_sumo.studio.answers import curve, paired


def record(folder, number, robots=2, waiting=4.0, observed=True, map_="a.building.yaml", seed=1, throughput=10.0):
    scenario = {
        "robots": {"count": robots},
        "tasks": {"open": waiting},
        "execution": {"time_limit_s": 1800.0},
        "map": {"file": f"/site/{map_}"},
        "seed": seed,
    }
    seen = {"done_s": [10.0, None, 900.0]} if observed else None
    metrics = {"throughput_per_h": throughput, "lead_time_mean_s": None}
    texts = dict.fromkeys(("scenario_key", "reason", "until", "code", "libsumo", "ortools", "machine", "python", "ended_at"), "")
    numbers = dict.fromkeys(("run_wall_s", "run_cpu_s", "peak_memory_mb"), 1.0)
    known = {"key": f"{number:040x}", "status": "completed", "attempts": 1, "success": True, "repeat": 0, "scenario": scenario}
    write_record(folder, {**texts, **numbers, **known, "observed": seen, "metrics": metrics})


def test_a_study_so_far_shows_the_runs_in_which_orders_always_wait(tmp_path):
    assert curve(tmp_path) == {"points": []}
    record(tmp_path, 1, robots=3)
    record(tmp_path, 2, waiting=None)  # of the scenario's own demand
    record(tmp_path, 3, observed=False)
    assert curve(tmp_path) == {"points": [{"robots": 3, "per_h": 4.0, "status": "completed"}]}  # two orders in half an hour


def test_variants_are_compared_seed_by_seed(tmp_path):
    for seed, (a, b) in enumerate(((10, 12), (20, 23), (30, 34)), 1):
        record(tmp_path, seed, seed=seed, throughput=a)
        record(tmp_path, 10 + seed, seed=seed, throughput=b, map_="b.building.yaml")
    record(tmp_path, 20, seed=9, throughput=99)  # without its pair
    result = paired(tmp_path, "b.building.yaml")
    assert result["maps"] == ["b.building.yaml", "a.building.yaml"]
    row = result["rows"][0]
    assert (row["first"], row["second"], row["pairs"]) == (23, 20, 3)
    assert row["difference"] == pytest.approx([-3, -3 - 2.484, -3 + 2.484], abs=1e-3)  # t(0.975, 2) = 4.303, deviation 1
    assert result["rows"][1]["difference"] == [None, None, None]


def test_one_variant_is_no_comparison(tmp_path):
    record(tmp_path, 1)
    assert paired(tmp_path, "a.building.yaml")["rows"] == []
