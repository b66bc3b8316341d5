"""Error bands of a run, driven: where one station binds, and where the way does, their effects are known by hand."""

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest
from ring_floor import LAP_S, MOVE_UP_S, ring

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.experiments.run_bands import require_bounds, with_error_bands
from mrp_sumo.io.scenario.read import scenario_of

HORIZON_S = 6000.0


@pytest.fixture
def output(tmp_path):
    """Effects on the lead time and throughput of two robots on a ring, whose stop takes so long."""

    def of(service_s):
        result = ring(tmp_path, 2, service_s, HORIZON_S)
        with MapCache() as maps:
            bands = with_error_bands(result, {}, lambda file: carry_out(file, maps)).error_bands
        of_throughput = bands["measures"]["throughput_per_h"]
        return of_throughput, {quantity["name"]: quantity["effect"] for quantity in of_throughput["quantities"]}, bands["sentence"]

    return of


@pytest.mark.slow
def test_a_station_that_binds_is_what_matters_most(output):
    figures, effects, sentence = output(100.0)
    assert "what matters most is the time at stop" in sentence
    assert effects["the time at stop"] == pytest.approx(3600 / (110 + MOVE_UP_S) - 3600 / (90 + MOVE_UP_S), rel=0.15)
    assert abs(effects["the top speed"]) < 0.2 * abs(effects["the time at stop"])
    assert figures["low"] == pytest.approx(3600 / (110 + MOVE_UP_S), rel=0.05)


@pytest.mark.slow
def test_the_way_that_binds_is_what_matters_most(output):
    _, effects, sentence = output(5.0)
    assert "what matters most is the top speed" in sentence
    lap_s = {factor: LAP_S + 16.0 / 0.22 * (1 / factor - 1) + 5.0 for factor in (0.9, 1.1)}
    assert effects["the top speed"] == pytest.approx(2 * 3600 * (1 / lap_s[1.1] - 1 / lap_s[0.9]), rel=0.2)
    assert abs(effects["the time at stop"]) < 0.2 * effects["the top speed"]


def test_a_station_that_is_not_there_is_refused_before_anything_is_driven():
    values = {"map": "office", "robots": 2, "planner": "lacam"}
    values |= {"tasks": {"streams": [{"arrivals": {"open": 2}, "stops": ["pantry", "lounge"]}]}}
    with MapCache() as maps, pytest.raises(MrpSumoError, match="--error-bands: 'pantri' is no station, group or vertex"):
        require_bounds(scenario_of(values, Path(), "case"), {"tasks.service_factor.pantri": (0.9, 1.1)}, maps)


@dataclass(frozen=True)
class Result:
    """A run without orders, in which everybody takes 100 s."""

    setup: SimpleNamespace
    metrics: dict
    execution: None = None
    error_bands: dict | None = None


@pytest.mark.parametrize(
    ("slow_is_possible", "high", "without"), [(True, 100 / 0.9, ""), (False, 100.0, " 4 of 8 runs have no such figures.")]
)
def test_runs_that_a_quantity_makes_impossible_are_counted_and_leave_no_hole(slow_is_possible, high, without):
    """Robots are all the slower, the lower their top speed, and nothing else matters."""
    file = scenario_of({"map": "office", "robots": 2, "planner": "lacam"}, Path(), "case")

    def run(file):
        factor = file.scenario.robots.factor.max_speed_mps
        if factor < 1 and not slow_is_possible:
            raise MrpSumoError("too slow")
        return SimpleNamespace(metrics={"driven_makespan_s": 100.0 / factor})

    setup = SimpleNamespace(file=file, scenario=file.scenario)
    bands = with_error_bands(Result(setup, {"driven_makespan_s": 100.0}), {}, run).error_bands
    ends = bands["measures"]["driven_makespan_s"]
    assert (ends["value"], ends["low"], ends["high"]) == pytest.approx((100.0, 100 / 1.1, high), rel=1e-3)
    assert bands["sentence"].endswith(without or "top speed.")


@pytest.mark.parametrize(("jammed_s", "high"), [(130.0, 130.0), (0.0, 100 / 0.9)])
def test_band_holds_a_run_in_between_that_is_worse_than_all_worst_ends_together(jammed_s, high):
    """Slow robots that brake well jam; those that brake badly as well do not."""
    file = scenario_of({"map": "office", "robots": 2, "planner": "lacam"}, Path(), "case")

    def run(file):
        factor = file.scenario.robots.factor
        is_jam = factor.max_speed_mps < 1 < factor.decel_mps2
        return SimpleNamespace(metrics={"driven_makespan_s": max(100.0 / factor.max_speed_mps, jammed_s * is_jam)})

    setup = SimpleNamespace(file=file, scenario=file.scenario)
    bands = with_error_bands(Result(setup, {"driven_makespan_s": 100.0}), {}, run).error_bands
    assert bands["measures"]["driven_makespan_s"]["high"] == pytest.approx(high, rel=1e-3)
