"""What is predicted and its band, by hand; and what a prediction assumes is said."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mrp_sumo.calibration.prediction import Outcomes, _compared, _middle, _note_what_is_assumed, _quantile


def outcomes(per_h, *lead_time_s):
    return Outcomes(np.array(lead_time_s or [20.0, np.inf]), np.zeros(0), np.zeros(0), per_h, 0.5, 0.5)


@pytest.mark.parametrize(("logged", "holds"), [(6.6, False), (6.7, True), (13.3, True), (13.4, False)])
def test_the_median_is_predicted_and_the_band_is_that_of_one_run_more(logged, holds):
    """Three drawn runs do 9, 10 and 11 an hour: 10 +- 2.92 sqrt(1 + 1 / 3), since t(0.95, 2) is 2.92."""
    figures = _compared(
        outcomes(logged), [outcomes(n) for n in (10.0, 30.0, 12.0)], [outcomes(n) for n in (9.0, 10.0, 11.0)], "A", (2.0, 1.0)
    )
    figure = next(each for each in figures if each.name == "throughput_per_h")
    assert figure.predicted == 12.0 and figure.error == 12.0 / logged - 1
    assert (figure.low, figure.high) == pytest.approx((10 - 3.3717, 10 + 3.3717), abs=1e-3)
    assert figure.holds == holds


@pytest.mark.parametrize(("drawn", "low", "high"), [((9.0,), 0.0, math.inf), ((9.0, 9.0), 7.0, 11.0)])
def test_one_run_says_nothing_of_a_band_and_runs_that_are_alike_leave_room_for_an_order(drawn, low, high):
    figures = _compared(outcomes(5.0), [outcomes(10.0)], [outcomes(n) for n in drawn], "A", (2.0, 1.0))
    figure = next(each for each in figures if each.name == "throughput_per_h")
    assert (figure.low, figure.high) == (low, high)


def test_waits_are_told_to_the_time_between_two_poses():
    run = replace(outcomes(1.0), station_wait_s=np.full(4, 3.0))
    figures = {each.name: each for each in _compared(run, [run] * 2, [run] * 2, "A", (2.0, 0.5))}
    assert (figures["station_wait_p50_s"].low, figures["station_wait_p95_s"].high) == (2.5, 3.5)


@pytest.mark.parametrize(("share", "value"), [(0.0, 1.0), (0.5, 3.0), (0.25, 2.0), (0.9, math.inf), (1.0, math.inf)])
def test_a_quantile_of_times_of_which_some_are_never_over(share, value):
    assert _quantile(np.array([3.0, math.inf, 1.0, 5.0, 2.0]), share) == value


@pytest.mark.parametrize(
    ("is_known", "people", "kind", "vehicle", "says"),
    [
        (True, None, "run folder", "a", []),
        (False, None, "run folder", "a", ["how long services take"]),
        (True, 20, "run folder", "a", ["people cause"]),
        (True, None, "CSV", "a", ["orders count as released"]),
        (True, None, "run folder", "b", ["orders of b"]),
    ],
)
def test_what_a_prediction_assumes_is_said(is_known, people, kind, vehicle, says):
    orders = [SimpleNamespace(release_s=5.0, assigned_s=5.0, vehicle=vehicle)]
    held = SimpleNamespace(orders=orders, vehicles=("a",), log=SimpleNamespace(kind=kind), notes=[])
    _note_what_is_assumed(held, SimpleNamespace(scenario=SimpleNamespace(people=people)), SimpleNamespace(is_known=is_known))
    assert len(held.notes) == len(says) and all(words in note for words, note in zip(says, held.notes))


def test_the_run_that_is_shown_is_the_one_whose_median_lead_time_is_in_the_middle():
    """Medians of 30, 10, 20 and 40 s."""
    runs = [outcomes(1.0, *lead_s) for lead_s in ((1.0, 30.0, 31.0), (1.0, 10.0, 99.0), (1.0, 20.0, 98.0), (1.0, 40.0, 41.0))]
    assert _middle(runs) == 2 and _middle(runs[:3]) == 2 and _middle(runs[:1]) == 0


def test_halves_and_the_last_twentieth_of_lead_times_and_waits_are_compared():
    """Lead times of 0 to 20 s, and waits of 0 to 40 s."""
    run = replace(outcomes(1.0, *map(float, range(21))), station_wait_s=np.arange(41.0))
    figures = {each.name: each.logged for each in _compared(run, [run], [run], "A", (2.0, 1.0))}
    assert (figures["lead_time_p50_s"], figures["lead_time_p95_s"]) == (10.0, 19.0)
    assert (figures["station_wait_p50_s"], figures["station_wait_p95_s"]) == (20.0, 38.0)
