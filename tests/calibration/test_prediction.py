"""What is predicted and its band, by hand; and what a prediction assumes is said."""

import math
import re
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from statistics import NormalDist
from types import SimpleNamespace

import numpy as np
import pytest

from mrp_sumo.calibration.estimates import ANY_NOISE, CalibratedFigure, Calibration
from mrp_sumo.calibration.log import LoggedOrder, MotionLog
from mrp_sumo.calibration.prediction import (
    FEW,
    NORMAL,
    WITHIN_S,
    Outcomes,
    _busiest,
    _compared,
    _drawn,
    _middle,
    _note_what_is_assumed,
    _note_what_is_not_told,
    _period_s,
    _quantile,
    _require_orders,
    _usual_lead_s,
    _waits_s,
    _write,
    outcomes_of,
)
from mrp_sumo.core.task import StopLog, log_of_times
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.io.scenario.read import scenario_of


def outcomes(per_h, *lead_time_s):
    return Outcomes(np.array(lead_time_s or [20.0, np.inf]), np.zeros(0), np.zeros(0), per_h, 0.5, 0.5)


@pytest.mark.parametrize(("logged", "holds"), [(6.6, False), (6.7, True), (13.3, True), (13.4, False)])
def test_the_median_is_predicted_and_the_band_is_that_of_one_run_more(logged, holds):
    """Three runs do 9, 10 and 11 an hour: 10 +- 2.92 sqrt(1 + 1 / 3), since t(0.95, 2) is 2.92."""
    figures = _compared(outcomes(logged), [outcomes(n) for n in (11.0, 9.0, 10.0)], "A", (2.0, 1.0))
    figure = next(each for each in figures if each.name == "throughput_per_h")
    assert figure.predicted == 10.0 and figure.error == 10.0 / logged - 1
    assert (figure.low, figure.high) == pytest.approx((10 - 3.3717, 10 + 3.3717), abs=1e-3)
    assert figure.holds == holds


@pytest.mark.parametrize(("simulated", "low", "high"), [((9.0,), 0.0, math.inf), ((9.0, 9.0), 7.0, 11.0)])
def test_one_run_says_nothing_of_a_band_and_runs_that_are_alike_leave_room_for_an_order(simulated, low, high):
    figures = _compared(outcomes(5.0), [outcomes(n) for n in simulated], "A", (2.0, 1.0))
    figure = next(each for each in figures if each.name == "throughput_per_h")
    assert (figure.low, figure.high) == (low, high)


def test_waits_are_told_to_the_time_between_two_poses():
    run = replace(outcomes(1.0), station_wait_s=np.full(4, 3.0))
    figures = {each.name: each for each in _compared(run, [run] * 2, "A", (2.0, 0.5))}
    assert (figures["station_wait_p50_s"].low, figures["station_wait_p95_s"].high) == (2.5, 3.5)


@pytest.mark.parametrize(("share", "value"), [(0.0, 1.0), (0.5, 3.0), (0.25, 2.0), (0.9, math.inf), (1.0, math.inf)])
def test_a_quantile_of_times_of_which_some_are_never_over(share, value):
    assert _quantile(np.array([3.0, math.inf, 1.0, 5.0, 2.0]), share) == value


@pytest.mark.parametrize(
    ("is_known", "people", "kind", "says"),
    [
        (True, None, "run folder", []),
        (False, None, "run folder", ["how long services take"]),
        (True, 20, "run folder", ["people cause"]),
        (True, None, "CSV", ["orders count as released"]),
    ],
)
def test_what_a_prediction_assumes_is_said(is_known, people, kind, says):
    orders = [SimpleNamespace(release_s=5.0, assigned_s=5.0, vehicle="a")]
    held = SimpleNamespace(orders=orders, vehicles=("a",), log=SimpleNamespace(kind=kind), notes=[])
    _note_what_is_assumed(held, SimpleNamespace(scenario=SimpleNamespace(people=people)), SimpleNamespace(is_known=is_known))
    assert len(held.notes) == len(says) and all(words in note for words, note in zip(says, held.notes))


@pytest.mark.parametrize(("people", "says"), [(None, ["up to 0.15", "none"]), (20, ["up to 0.15"])])
def test_what_the_earlier_part_does_not_tell_is_said_with_what_is_taken_instead(people, says):
    held = SimpleNamespace(notes=[])
    one = SimpleNamespace(unknown={"stops_per_s": "1 s of driving", "speed_noise": "26 steps", "stopping_m": "no place"})
    _note_what_is_not_told(held, SimpleNamespace(scenario=SimpleNamespace(people=people)), [one])
    assert len(held.notes) == len(says) and all(words in note for words, note in zip(says, held.notes))


def test_the_run_that_is_shown_is_the_one_whose_median_lead_time_is_in_the_middle():
    """Medians of 30, 10, 20 and 40 s."""
    runs = [outcomes(1.0, *lead_s) for lead_s in ((1.0, 30.0, 31.0), (1.0, 10.0, 99.0), (1.0, 20.0, 98.0), (1.0, 40.0, 41.0))]
    assert _middle(runs) == 2 and _middle(runs[:3]) == 2 and _middle(runs[:1]) == 0


def test_halves_and_the_last_twentieth_of_lead_times_and_waits_are_compared():
    """Lead times of 0 to 20 s, and waits of 0 to 40 s."""
    run = replace(outcomes(1.0, *map(float, range(21))), station_wait_s=np.arange(41.0))
    figures = {each.name: each.logged for each in _compared(run, [run], "A", (2.0, 1.0))}
    assert (figures["lead_time_p50_s"], figures["lead_time_p95_s"]) == (10.0, 19.0)
    assert (figures["station_wait_p50_s"], figures["station_wait_p95_s"]) == (20.0, 38.0)


def logged(name, release_s, done_s, *services, vehicle="a"):
    return LoggedOrder(name, ("A", "B")[: max(len(services), 1)], release_s, release_s, vehicle, services, done_s, done_s)


def held_of(*orders, log_orders=None, cut_s=100.0, end_s=500.0):
    log = SimpleNamespace(orders=orders if log_orders is None else log_orders, kind="CSV", source="log", poses={})
    return SimpleNamespace(orders=orders, log=log, cut_s=cut_s, end_s=end_s, span_s=end_s - cut_s, vehicles=("a", "b"), notes=[])


def test_the_station_that_serves_most_often_in_the_later_part_is_the_busiest():
    """A twice, for 10 s and for 5 s, B once for 84 s; of one service each, the first by name; what is over at the cut does not count."""
    early, late = logged("1", 0.0, 200.0, (50.0, 110.0), (116.0, 200.0)), logged("2", 490.0, 600.0, (495.0, 600.0))
    over = logged("3", 0.0, 130.0, (50.0, 100.0), (116.0, 130.0))
    assert [_busiest(held_of(*orders)) for orders in ((early, late), (early,), (over,), ())] == ["A", "A", "B", ""]


@pytest.mark.parametrize(("leads_s", "usual_s"), [((10.0,) * 20, 10.0), ((*(10.0,) * 19, 50.0), 12.0), ((400.0,), 100.0), ((), 0.0)])
def test_orders_released_within_the_usual_lead_time_before_the_end_are_not_compared(leads_s, usual_s):
    """At most a quarter of 400 s; orders that were not done in the log tell nothing."""
    orders = [logged(str(k), 20.0, 20.0 + lead_s) for k, lead_s in enumerate(leads_s)]
    assert _usual_lead_s(held_of(log_orders=[*orders, logged("open", 20.0, 500.0), logged("never", 20.0, math.nan)])) == pytest.approx(
        usual_s
    )


def test_outcomes_are_of_orders_done_in_the_part_and_counted_from_their_release_in_the_log():
    """A part of 400 s; orders take 40 s. `old` came 30 s before the cut, `late` 30 s before the end; `over` is done after it."""
    held = held_of(logged("old", 70.0, 110.0), log_orders=[logged(str(k), 0.0, 40.0) for k in range(4)])
    names = ("old", "new", "late", "over", "edge")
    released_s, assigned_s = np.array([0.0, 50, 370, 200, 360]), np.array([-5.0, 60, 372, 210, 362])
    done_s = np.array([20.0, 100, 390, 401, 400])
    tasks = log_of_times(names, np.zeros(5, np.int64), released_s, assigned_s, assigned_s, done_s)
    begin_s, end_s = np.array([10.0, 90, 380, 395, 390]), np.array([20.0, 100, 390, 405, 400])
    zeros, none = np.zeros(5), np.zeros(5, np.int64)
    stops = StopLog(np.arange(5), none, ("A", "A", "B", "A", "A"), none, begin_s - 5, begin_s, end_s, zeros, zeros, np.full(5, np.inf))
    t_s = np.arange(0.0, 400.5, 0.5)
    still = np.zeros((len(t_s), 1))
    execution = SimpleNamespace(tasks=tasks, stops=stops, t_s=t_s, x_m=still, y_m=still)
    output = outcomes_of(SimpleNamespace(execution=execution), held, "A")
    assert output.lead_time_s.tolist() == [50.0, math.inf, 40.0]  # of `new`, `over` and `edge`
    assert output.done_s.tolist() == [20.0, 100.0, 390.0, 400.0] and output.throughput_per_h == 36.0
    assert output.robots_busy_share == pytest.approx((20 + 40 + 18 + 190 + 38) / 800)
    assert output.station_busy_share == pytest.approx((10 + 10 + 5 + 10) / 400)
    assert output.station_wait_s.tolist() == [5.0] * 5


@pytest.mark.parametrize(
    ("stands_from_s", "since_s", "begin_s", "waits_s"),
    [(10.0, 0.0, 30.0, 20.0), (10.0, 15.0, 30.0, 15.0), (35.0, 0.0, 30.0, 0.0), (10.0, 0.0, -1.0, None), (10.0, 29.9, 30.0, None)],
)
def test_robots_wait_that_stand_near_a_station_before_they_are_served(stands_from_s, since_s, begin_s, waits_s):
    t_s = np.arange(0.0, 60.0, 0.1)
    x = np.minimum(t_s, stands_from_s)[:, None]
    execution = SimpleNamespace(t_s=t_s, x_m=x, y_m=np.zeros_like(x))
    stops = SimpleNamespace(robot=np.array([0]), since_s=np.array([since_s]), begin_s=np.array([begin_s]))
    assert _waits_s(execution, stops).tolist() == ([] if waits_s is None else [pytest.approx(waits_s, abs=WITHIN_S / 2 + 0.11)])


@pytest.mark.parametrize("people", [None, {"count": 3}])
def test_noise_that_no_log_tells_may_be_any_and_people_stop_robots_themselves(tmp_path, people):
    figures = {"stops_per_s": CalibratedFigure("stops_per_s", "1/s", 0.01, 0.005, 0.02, 9, "stops")}
    values = {"map": "office", "robots": 2, "planner": "lacam", "people": people}
    file = scenario_of({key: value for key, value in values.items() if value is not None}, Path(), "case")
    held, one = SimpleNamespace(kinds=[0]), Calibration(MotionLog("log", "CSV"), [], 1000.0, figures)
    disturbing, (path,) = _write(held, [one], file, tmp_path, False)
    assert disturbing["intervals"]["speed_noise"] == [0.0, ANY_NOISE]
    assert {"stops_per_s", "stop_median_s"}.isdisjoint(disturbing) == (people is not None)
    assert ("stops_per_s" in disturbing["intervals"]) == (people is None)
    assert ("stops_per_s" in path.with_name(f"{path.stem}.disturbances.yaml").read_text()) == (people is None)


@pytest.mark.parametrize("figure", ["stop_median_s", "speed_noise"])
def test_stops_are_drawn_short_where_they_are_many(figure):
    """And no other figure follows their rate."""
    output = {"stops_per_s": [0.005, 0.02], figure: [0.05, 50.0]}
    disturbances = {"stops_per_s": 0.01, "stop_median_s": 5.0, "speed_noise": 0.1, "intervals": output}
    values = {"map": "office", "robots": {"count": 2}, "planner": "lacam", "execution": {"disturbances": disturbances}}
    drawn = list(_drawn(scenario_of(values, Path(), "case"), 8, 1))
    rates, others = ([moves["execution", "disturbances", name] for moves in drawn] for name in output)
    assert (np.argsort(rates).tolist() == np.argsort(others)[::-1].tolist()) == (figure == "stop_median_s")


@pytest.mark.parametrize("runs", [1, 4])
def test_figures_are_drawn_evenly_within_their_intervals(runs):
    robot = {"length_m": 0.5, "width_m": 0.5, "max_speed_mps": 1.0, "accel_mps2": 1.0, "decel_mps2": 1.0, "turn_rate_rad_s": 1.0}
    robot |= {"intervals": {"max_speed_mps": [0.9, 1.05], "accel_mps2": [0.5, 2.0]}}
    values = {
        "map": "office",
        "robots": {"count": 2, "type": robot},
        "planner": "lacam",
        "execution": {
            "disturbances": {"speed_noise": 0.1, "speed_spread": 0.1, "intervals": {"speed_noise": [0.0, 0.3], "speed_spread": [0.05, 0.2]}}
        },
    }
    drawn = list(_drawn(scenario_of(values, Path(), "case"), runs, 1))
    assert len(drawn) == runs and len(drawn[0]) == 3  # the spread is of vehicles that differ already
    for place, low, high, usual in (
        (("robots", "factor", "max_speed_mps"), 0.9, 1.05, 1.0),
        (("execution", "disturbances", "speed_noise"), 0.0, 0.3, 0.1),
    ):
        at = sorted(moves[place] for moves in drawn)
        above = [math.log(value / usual) / math.log(high / usual) for value in at if value >= usual]
        shares = [math.log(value / usual) / math.log(usual / low) if low else value / usual - 1 for value in at if value < usual] + above
        normal = [NormalDist().inv_cdf((k + 0.5) / runs) / NORMAL for k in range(runs)]
        assert shares == pytest.approx(normal, abs=1e-4)
    if runs > 1:
        assert len({tuple(np.argsort([moves[place] for moves in drawn])) for place in drawn[0]}) > 1


def test_the_period_of_a_log_is_the_usual_one_of_its_vehicles():
    held = held_of()
    held.log.poses = {"a": [(t,) for t in (0.0, 1.0, 2.0, 9.0)], "b": [(t,) for t in (0.0, 0.5, 1.0, 1.5, 2.0)], "c": [(0.0,), (50.0,)]}
    assert _period_s(held) == 0.5
    held.vehicles = ("a",)
    assert _period_s(held) == 1.0


@pytest.mark.parametrize(
    ("done", "log_orders", "line"),
    [
        ((110.0,) * 5, None, None),
        ((110.0,) * (FEW - 1), None, f"{FEW - 1} orders are released in 100 to 500 s, all in 100 to {98 + FEW} s, expected {FEW} or more"),
        ((), (), f"the log has no orders, expected {FEW} or more to compare; give them with --orders FILE.csv"),
        ((math.nan,) * 5, None, f"fewer than {FEW} orders that came after 100 s were done by the end of the log"),
    ],
)
def test_a_log_needs_a_few_orders_to_compare(done, log_orders, line):
    held = held_of(*(logged(str(k), 100.0 + k, done_s) for k, done_s in enumerate(done)), log_orders=log_orders)
    held.log.visits = []
    with pytest.raises(MrpSumoError, match=re.escape(line)) if line else nullcontext():
        _require_orders(held)
