import math
from dataclasses import replace
from statistics import NormalDist
from types import SimpleNamespace

import numpy as np
import pytest
from shuttles import shuttle_rows

from mrp_sumo.calibration.cruise import PARTS, Scatter, Windows, _windows, fit_cruise, integrated_cov
from mrp_sumo.calibration.estimates import (
    CONFIDENCE,
    CalibratedFigure,
    Calibration,
    Unknown,
    _battery,
    _speeds,
    _spread_of,
    calibrated,
    student,
)
from mrp_sumo.calibration.files import disturbances_of, drift, type_of, write_files
from mrp_sumo.calibration.log import ActionTime, Charge, MotionLog, Track
from mrp_sumo.calibration.phases import Noise, _balls, _corners, phases_of
from mrp_sumo.calibration.ramps import Episodes, fit_episodes, position
from mrp_sumo.calibration.stops import _fit, _Stands, _unexplained, _within, fit_stops
from mrp_sumo.calibration.turning import fit_turning
from mrp_sumo.core.robot_type import RobotShape
from mrp_sumo.errors import MrpSumoError

TRUTH = {"max_speed_mps": 1.2, "accel_mps2": 0.6, "decel_mps2": 0.8, "turn_rate_rad_s": 1.0, "speed_noise": 0.06}


def log_of(rows):
    poses = {name: [(*row, np.nan, 0.0) for row in each.tolist()] for name, each in rows.items()}
    return MotionLog("log", "CSV", poses=poses)


@pytest.fixture(scope="module")
def shuttles():
    rng = np.random.default_rng(5)
    return {f"s{k}": shuttle_rows(rng) for k in range(4)}


def test_figures_of_noisy_states_of_1_hz_are_near_the_truth(shuttles):
    result = calibrated(log_of(shuttles)).quantities
    for name, truth in TRUTH.items():
        assert result[name].low < result[name].value < result[name].high
        assert result[name].value == pytest.approx(truth, rel=0.25 if name == "speed_noise" else 0.05)
        assert 0.9 * result[name].low < truth < 1.1 * result[name].high


def test_a_log_of_two_types_is_told_from_one_of_vehicles_that_are_alike(shuttles):
    """One type stands for all: who differs is said, and turn rates of vehicles count once each."""
    rng = np.random.default_rng(6)
    slow = {f"slow{k}": shuttle_rows(rng, top=0.6, accel=0.3, turn=0.6, trips=12) for k in range(2)}
    mixed, alike = (calibrated(log_of(dict(list(shuttles.items())[:2]) | others)) for others in (slow, {}))
    said = [note for note in mixed.log.notes if "top speeds differ" in note]
    assert len(said) == 1 and "m/s of slow" in said[0] and "m/s of s" in said[0] and not alike.log.notes
    low, high = (getattr(mixed.quantities["turn_rate_rad_s"], end) for end in ("low", "high"))
    assert low < 0.85 and high > 1.1
    assert alike.quantities["turn_rate_rad_s"].high < 1.01


@pytest.mark.parametrize("seed", range(2))
def test_without_noise_and_scatter_figures_are_the_truth(seed):
    rng = np.random.default_rng(seed)
    logs = {f"s{k}": shuttle_rows(rng, scatter=Scatter(0.0, 3.0), sigma=1e-4, trips=12) for k in range(2)}
    figures = calibrated(log_of(logs)).quantities
    for name, rel in (("max_speed_mps", 0.001), ("accel_mps2", 0.006), ("decel_mps2", 0.006), ("turn_rate_rad_s", 0.01)):
        assert figures[name].value == pytest.approx(TRUTH[name], rel=rel)
    assert figures["speed_noise"].value < 0.002 and figures["stopping_m"].value < 0.002


def test_the_covariance_of_lost_speed_is_that_of_a_folded_normal_pair():
    """Its variance and its slope at once are exact; in between and integrated it is near."""
    weights, rates = np.array(PARTS).T
    assert weights.sum() == pytest.approx(1 - 2 / np.pi) and weights @ rates == pytest.approx(1.0)
    scatter, ends = Scatter(0.1, 3.0), np.array([1.0, 5.0])
    t = (np.arange(1000) + 0.5) * 0.005
    r = np.exp(-np.abs(t[:, None] - t) / scatter.tau_s)
    exact = 2 / np.pi * scatter.noise**2 * (r * np.arcsin(r) + np.sqrt(1 - r**2) - 1)
    integrals = [[exact[: round(a / 0.005), : round(b / 0.005)].sum() * 0.005**2 for b in ends] for a in ends]
    assert integrated_cov(ends, scatter) == pytest.approx(np.array(integrals), rel=0.02)


@pytest.mark.parametrize(("u", "at_m"), [(-1.0, 0.0), (0.0, 0.0), (1.0, 0.25), (2.0, 1.0), (4.0, 3.0), (10.0, 9.0)])
def test_a_vehicle_speeds_up_and_then_keeps_its_speed(u, at_m):
    """0.5 m/s2 to 1 m/s, in 2 s and 1 m."""
    assert float(position(np.array(u), np.array(1.0), 0.5)) == pytest.approx(at_m)


def charges(*stretches):
    """Charge of a vehicle: stretches of (duration in s, from share, to share, whether it charges), a reading a minute."""
    rows, begin_s = [], 0.0
    for long_s, begin, end, charging in stretches:
        times_s = np.arange(0.0, long_s + 1e-9, 60.0).tolist()
        rows += [Charge("a", begin_s + t, begin + (end - begin) * t / long_s, charging) for t in times_s]
        begin_s += long_s + 60.0
    return rows


def test_charge_an_hour_is_the_mean_of_stretches_that_are_long_enough():
    """Drawn 12, 18 and 24 % an hour in 10 min each, and more in 5; charged 60 % an hour three times."""
    drawn = [(600.0, 0.9, 0.9 - share, False) for share in (0.02, 0.03, 0.04)]
    charged = [(600.0, 0.3, 0.4, True)] * 3
    short = (300.0, 0.9, 0.5, False), (300.0, 0.1, 0.9, True)
    stretches = [each for pair in zip(drawn, charged) for each in pair]
    figures = {figure.name: figure for figure in _battery(charges(*stretches, *short))}
    draws, fills = figures["battery_drawn_per_h"], figures["battery_charged_per_h"]
    assert (draws.value, draws.count) == (pytest.approx(0.18), 3) and (fills.value, fills.count) == (pytest.approx(0.6), 3)
    assert draws.high - draws.value == pytest.approx(student(CONFIDENCE, 2) * 0.06 / 3**0.5) == pytest.approx(draws.value - draws.low)
    assert fills.high == pytest.approx(0.6)


def test_one_long_stretch_is_cut_and_few_tell_nothing():
    """An hour and a minute without charging are three stretches of 20 min and a minute's rest."""
    (draws, unknown) = _battery(charges((3660.0, 0.9, 0.9 - 0.1 * 61 / 60, False)))
    assert (draws.value, draws.count) == (pytest.approx(0.1), 3)
    assert unknown.reason == "0 stretches of five minutes, expected three or more"
    (still, _) = _battery(charges((3660.0, 1.0, 1.0, False)))
    assert (still.name, still.reason) == ("battery_drawn_per_h", "the state of charge never changes")
    (none,) = _battery([])
    assert none.reason == "the log has no state of charge"


@pytest.mark.parametrize(("drop", "low", "high"), [(1.0, 2.0, 4.0), (0.25, 2.5, 3.5), (16.0, 0.0, 6.0)])
def test_a_range_ends_where_the_profile_has_dropped(drop, low, high):
    at = np.linspace(0.0, 6.0, 6001)
    assert _within(at, 7.0 - (at - 3.0) ** 2, drop) == pytest.approx((low, high), abs=1e-3)


def test_corners_are_where_ways_bend_by_more_than_noise():
    xy = np.array([(0, 0), (1, 0.01), (2, 0), (3, 0), (3, 1), (3.01, 2), (3, 3), (2, 4), (1, 5)], float)
    assert _corners(xy, 0.05) == [0, 3, 6, 8] and _corners(xy, 5.0) == [0, 8]
    assert _corners(np.array([(0, 0), (2, 0), (0, 0)], float), 0.05) == [0, 1, 2]  # to and fro


def test_a_vehicle_stands_where_samples_stay_together_and_a_creeping_one_does_not():
    xy = np.array([(0, 0), (0.01, 0), (0, 0.01), (0.5, 0), (0.6, 0), (0.7, 0), (2, 2), (2, 2)], float)
    stands = _balls(xy, 0, 8, 0.05)
    assert [(stand.first, stand.last, stand.x_m, stand.y_m) for stand in stands] == [(0, 2, 0.0, 0.0), (6, 7, 2.0, 2.0)]


def test_memory_of_vehicles_that_each_keep_one_speed_has_the_bounds_of_the_fit():
    rows = [(np.full(16, 0.5), np.full(16, 0.1 + 0.002 * (k % 5)), k % 4, 60.0 * (k // 4)) for k in range(20)]
    cruise = fit_cruise(_windows(rows), Noise(0.002, 0.01), 4)
    assert cruise.tau_range[1] == pytest.approx(300.0)


def test_few_windows_in_which_a_vehicle_brakes_make_no_scatter_of_all():
    rng = np.random.default_rng(3)
    steady = [(np.ones(8), 1.0 + rng.normal(0, 0.02, 8), k % 3, 60.0 * (k // 3)) for k in range(30)]
    braking = [(np.ones(8), np.linspace(1.0, 0.6, 8), 0, 30.0), (np.ones(3), np.array([0.9, 0.7, 0.6]), 1, 90.0)]
    alone, beside = (fit_cruise(_windows(rows), Noise(0.01, 0.01), 3) for rows in (steady, steady + braking))
    assert beside.scatter.noise == pytest.approx(alone.scatter.noise, rel=0.05)
    assert len(beside.windows.count) == len(alone.windows.count) == 30


def test_vehicles_differ_where_their_means_differ_by_more_than_is_known_of_them():
    means, deviation = np.log([1.0, 0.9, 0.99, 0.93]), np.full(4, 0.005)
    (top, low, high), (spread, least, most) = _spread_of(means, deviation)
    assert low < 0.0 < high and top == pytest.approx(0.0, abs=0.02) and 0.02 < least < spread < most < 0.2
    assert _spread_of(means, 20 * deviation)[1][1] == 0.0 and _spread_of(np.zeros(4), deviation)[1][:2] == (0.0, 0.0)


def test_vehicles_that_do_not_scatter_may_have_no_scatter():
    rng = np.random.default_rng(5)
    result = calibrated(log_of({f"s{k}": shuttle_rows(rng, scatter=Scatter(0.0, 3.0), sigma=0.0, trips=20) for k in range(2)})).quantities
    assert result["speed_noise"].low == 0.0 and result["max_speed_mps"].low <= 1.2 <= result["max_speed_mps"].high


@pytest.mark.parametrize(("scatter", "least", "most"), [(0.0, 0.0, 0.01), (0.05, 0.012, 0.1)])
def test_exact_steps_leave_little_room_for_scatter_and_uneven_ones_have_some(scatter, least, most):
    step_m = np.full((90, 16), 0.5) * (1 + scatter * np.random.default_rng(3).normal(size=(90, 1)))
    windows = Windows(np.full((90, 16), 1.0), step_m, np.full(90, 16), np.arange(90) % 3, np.arange(90))
    cruise = fit_cruise(windows, Noise(0.001, 0.001), 3)
    assert least < cruise.scatter.noise + 1e-9 and cruise.noise_range[1] < most


def test_offsets_of_clocks_change_nothing(shuttles):
    moved = {name: rows + np.array([1e6 * k, 0, 0, 0]) for k, (name, rows) in enumerate(shuttles.items())}
    before, after = (calibrated(log_of(rows)).quantities for rows in (shuttles, moved))
    assert after["accel_mps2"].value == pytest.approx(before["accel_mps2"].value, rel=1e-3)
    assert after["max_speed_mps"].value == pytest.approx(before["max_speed_mps"].value, rel=1e-2)


def test_less_of_a_log_tells_less(shuttles):
    short = {name: rows[: len(rows) // 5] for name, rows in shuttles.items()}
    wide, narrow = (calibrated(log_of(rows)).quantities["accel_mps2"] for rows in (short, shuttles))
    assert wide.high - wide.low > 1.3 * (narrow.high - narrow.low)


def test_log_without_headings_leaves_the_turn_rate(shuttles):
    rows = {name: np.column_stack((each[:, :3], np.full(len(each), np.nan))) for name, each in shuttles.items()}
    result = calibrated(log_of(rows))
    assert "turn_rate_rad_s" not in result.quantities
    assert result.unknown["turn_rate_rad_s"] == "the log has no headings"


def test_coarse_log_says_what_it_does_not_tell(monkeypatch):
    monkeypatch.setattr("shuttles.LENGTH_M", 60.0)
    rng = np.random.default_rng(5)
    result = calibrated(log_of({f"s{k}": shuttle_rows(rng, trips=20, period_s=3.0) for k in range(3)}))
    assert result.unknown["speed_noise"] == "a pose every 3 s, expected every 2.5 s or oftener"
    assert not {"speed_noise", "speed_noise_tau_s"} & set(result.quantities)
    top = result.quantities["max_speed_mps"]
    assert top.low < 1.2 < top.high
    assert top.high > 1.1 * top.value


def test_turns_that_are_over_between_two_poses_are_not_told():
    rng = np.random.default_rng(5)
    result = calibrated(log_of({f"s{k}": shuttle_rows(rng, turn=8.0) for k in range(2)}))
    assert result.unknown["turn_rate_rad_s"] == "turns are over sooner than a pose every 1 s shows"


@pytest.mark.parametrize(("period_s", "noise_rad"), [(1.0, 0.003), (0.2, 1e-5)])
def test_turns_are_as_fast_as_they_were(period_s, noise_rad):
    off = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        rate = rng.uniform(0.6, 1.8)
        angles = rng.choice([np.pi / 2, -np.pi / 2, np.pi], 300)
        begins = np.cumsum(rng.uniform(12, 30, 300)) + np.concatenate(([0.0], np.cumsum(np.abs(angles) / rate)[:-1]))
        t = np.arange(0.0, begins[-1] + 10, period_s)
        yaw = (np.clip((t[:, None] - begins) * rate, 0.0, np.abs(angles)) * np.sign(angles)).sum(1) + rng.normal(0, noise_rad, len(t))
        track = Track("t", t, *rng.normal(0, 0.02, (2, len(t))), yaw, np.zeros(len(t)))
        off.append(fit_turning([track], Noise(0.02, max(noise_rad, 0.002)), 1.0).value / rate - 1)
    assert np.abs(off).max() < 0.001


def test_times_of_actions_are_lognormal():
    rng = np.random.default_rng(1)
    log = log_of({"s": shuttle_rows(rng, trips=8)})
    log.visits = [ActionTime("s", "pick", "a", 100.0 * k, 100.0 * k + t) for k, t in enumerate(rng.lognormal(np.log(12.0), 0.3, 400))]
    result = calibrated(log).quantities
    assert result["actions.pick.median_s"].value == pytest.approx(12.0, rel=0.05)
    assert result["actions.pick.sigma"].value == pytest.approx(0.3, rel=0.1)


def test_fleet_that_stands_is_refused():
    rng = np.random.default_rng(2)
    rows = np.column_stack((np.arange(500.0), rng.normal(0, 0.02, (500, 2)), np.zeros(500)))
    with pytest.raises(MrpSumoError, match="no vehicle drives: positions change by no more than their noise"):
        calibrated(log_of({"s": rows}))


def test_milliseconds_taken_for_seconds_are_refused(shuttles):
    with pytest.raises(MrpSumoError, match=r"vehicles drive at 0\.0012 m/s, expected 0\.02 or more: other units than metres and seconds"):
        calibrated(log_of({"s": shuttles["s0"] * [1000, 1, 1, 1]}))


def test_two_vehicles_of_one_name_are_refused(shuttles):
    one, other = shuttles["s0"], shuttles["s1"] + [0.0, 500.0, 0.0, 0.0]
    both = np.concatenate((one, other))
    with pytest.raises(MrpSumoError, match="vehicle 's' is at two places at once"):
        calibrated(log_of({"s": both[np.argsort(both[:, 0])]}))


def test_one_vehicle_of_two_names_is_refused(shuttles):
    with pytest.raises(MrpSumoError, match="'s' and 't' are at the same places all the time: one vehicle of two names"):
        calibrated(log_of({"s": shuttles["s0"], "t": shuttles["s0"] + [0.0, 0.01, 0.0, 0.0]}))


def test_poses_in_no_order_are_refused(shuttles):
    with pytest.raises(MrpSumoError, match=r"poses of 's' go back in time \d+ times, expected them in order of time"):
        calibrated(log_of({"s": np.random.default_rng(0).permutation(shuttles["s0"])}))


def test_fleet_whose_vehicles_are_never_alone_does_not_tell_its_stops(shuttles):
    beside = shuttles["s0"] + [0.0, 0.0, 2.0, 0.0]
    result = calibrated(log_of({"s": shuttles["s0"], "t": beside}))
    assert result.unknown["stops_per_s"] == "0 s of driving with nobody near, expected 10 s or more"


def test_clock_that_jumps_back_cuts_the_log(shuttles):
    rows = shuttles["s0"].copy()
    rows[300:, 0] -= 100.0
    result = calibrated(log_of({"s": rows}))
    assert result.log.notes == ["the clock of s jumps back once: the log is cut there"]
    assert result.quantities["accel_mps2"].value == pytest.approx(0.6, rel=0.15)


def test_a_few_poses_are_too_short_to_tell():
    with pytest.raises(MrpSumoError, match="too short to tell anything"):
        calibrated(log_of({"s": np.array([[0.0, 0, 0, 0], [1, 1, 0, 0], [2, 2, 0, 0]])}))


def stops_of(holds, driven_s=10_000.0):
    return _fit(np.array(holds), driven_s, 5.0, 1.4)


def test_few_stops_count_for_those_that_are_too_short_to_be_seen():
    rate, low, high = stops_of([6.0, 8.0]).rate_per_s
    assert rate > 1.3 * 2 / 10_000  # a median of about 6 s, so that a third lasts less than 5 s
    assert low < 2 / 10_000 < high
    assert stops_of([]).rate_per_s[:2] == (0.0, 0.0)


def test_intervals_of_rates_hold_the_truth_whether_stops_are_few_or_many():
    rng, held = np.random.default_rng(7), {5.0: 0, 50.0: 0}
    for expected in held:
        for _ in range(30):
            spread = 0.5 if expected > 5 else 0.0  # of durations about the usual ones, which few stops do not tell
            rate, median, sigma = expected / 10_000, 6.0 * np.exp(spread * rng.normal()), 0.5 * np.exp(spread * rng.normal())
            holds = rng.lognormal(np.log(median), sigma, rng.poisson(expected))
            _, low, high = stops_of(holds[holds > 5.0]).rate_per_s
            held[expected] += low <= rate <= high
    assert min(held.values()) >= 23  # of 30, where 27 are expected


def test_stops_that_are_hardly_seen_are_not_taken_for_the_end_of_many_short_ones():
    stops = stops_of([5.1, 5.3, 5.2, 5.6, 5.4, 5.2, 5.9, 5.1, 5.5, 5.3])
    assert stops.median_s[0] > 2.0
    assert stops.rate_per_s[0] < 0.1


def test_place_where_one_of_many_stood_is_none_where_vehicles_often_stand():
    rng = np.random.default_rng(3)
    tracks = [Track("s", *(row for row in shuttle_rows(rng, trips=60).T), np.full(1, np.nan)) for _ in range(1)]
    phases = [phases_of(track, Noise(0.02, 0.02), 1.2) for track in tracks]
    every = [dict.fromkeys(range(len(each.stands)), 9) for each in phases]
    often = _Stands(phases, every).often(np.array([0.0, 7.0]), np.array([0.0, 0.0]))
    assert often.tolist() == [True, False]  # it turns at the end, and passes the middle


def one_stop():
    """A vehicle that stands from 20 to 28 s at x = 10, on its way to where it turns at x = 20."""
    t = np.arange(0.0, 60.0)
    x = np.where(t < 10, 0, np.where(t < 20, t - 10, np.where(t < 28, 10.0, np.where(t < 38, t - 18, np.where(t < 45, 20.0, 65 - t)))))
    track = Track("s", t, np.maximum(x, 5.0), np.zeros(60), np.zeros(60), np.full(60, np.nan))
    return track, phases_of(track, Noise(0.002, 0.002), 1.0)


def test_stands_where_a_vehicle_turns_are_explained_and_one_on_its_way_is_not():
    _, phases = one_stop()
    assert [round(phases.stands[k].x_m) for k in _unexplained(phases, [])] == [10]
    assert not _unexplained(phases, [ActionTime("s", "pick", "a", 20.0, 28.0)])


def test_stop_beside_another_vehicle_may_be_a_wait_for_it_whatever_its_type():
    track, phases = one_stop()
    other = Track("t", track.t_s, np.full(60, 10.0), np.full(60, 1.0), np.zeros(60), np.full(60, np.nan))
    alone, beside = (fit_stops([phases], [], tracks, 1.0, {}, {}, 1.4) for tracks in ([track], [track, other]))
    assert (len(alone.hold_s), len(beside.hold_s)) == (1, 0)


@pytest.mark.parametrize(("station", "ends_s", "stops"), [("dock", 29.0, 0), ("gate", 29.0, 1), ("dock", 15.0, 1)])
def test_stop_while_another_is_served_at_the_next_stop_may_be_a_wait_for_it(station, ends_s, stops):
    """It stands from about 20 s to 28 s, and is served at the dock from 58 s on."""
    track, phases = one_stop()
    visits = [ActionTime("s", "drop", "dock", 58.0, 59.0), ActionTime("t", "drop", station, 5.0, ends_s)]
    assert len(fit_stops([phases], visits, [track], 1.0, {}, {}, 1.4).hold_s) == stops


def test_driving_counts_where_nobody_is_served_at_the_next_stop_before_a_stop_would_have_ended():
    """Of 17 s of driving those from 29 s on, 6 s before another is served at the dock, count for nothing until that ends."""
    track, phases = one_stop()
    dock = ActionTime("s", "drop", "dock", 58.0, 59.0)
    alone, taken = (
        fit_stops([phases], visits, [track], 1.0, {}, {}, 1.4) for visits in ([dock], [dock, ActionTime("t", "drop", "dock", 35, 50)])
    )
    driven = [t for leg in phases.legs for t in track.t_s[leg.first + 2 : leg.last - 2] if t < 29 or t >= 50]
    assert alone.driven_s == pytest.approx(17.0) and taken.driven_s == pytest.approx(len(driven))


@pytest.mark.parametrize(("brake_s", "behind_s", "driven_s"), [(1.0, None, 17.0), (3.0, None, 12.0), (1.0, 5.0, 0.0), (1.0, 100.0, 17.0)])
def test_driving_counts_where_a_stop_would_be_told(brake_s, behind_s, driven_s):
    """Legs of 6, 11 and 15 poses, less two at each end and the time in which it brakes; who follows within 6 s would pass it."""
    track, phases = one_stop()
    other = [] if behind_s is None else [replace(track, vehicle="t", t_s=track.t_s + behind_s)]
    stops = fit_stops([phases], [], [track, *other], brake_s, {}, {}, 1.4)
    assert stops.driven_s == pytest.approx(driven_s, abs=1e-6)


def test_start_that_shows_only_top_speed_tells_nothing_beside_those_that_show_all():
    """Four vehicles leave stands at 1 m/s^2, without noise; the fifth is at twice the speed that it is taken for in all samples."""
    t = np.arange(8.0)
    along = np.stack([*(position(t - first, np.full(8, 0.5), 1.0) for first in (2.1, 2.3, 2.5, 2.7)), t])
    speeds, there = np.full(5, 0.5), np.ones((5, 8), bool)
    episodes = Episodes(
        np.zeros(5), np.tile(t, (5, 1)), along, there, speeds, 0.3 * speeds, np.ones(5), np.arange(5), np.zeros((5, 2), int)
    )
    ramp = fit_episodes(episodes, Noise(2.0**-12, 1e-3), Scatter(1e-9, 3.0), 1.0)
    assert ramp.value == pytest.approx(1.0, rel=1e-3) and ramp.used[:4].all()


@pytest.mark.parametrize(("level", "x_m"), [(1.0, 13.0), (0.0, 113.0)])
def test_stop_before_a_lift_may_be_a_wait_for_it(level, x_m):
    track, phases = one_stop()
    before = replace(track, vehicle="t", t_s=track.t_s + 100.0, x_m=np.full(60, 12.5))
    after = replace(before, t_s=track.t_s + 161.0, x_m=np.full(60, x_m), level=level)
    alone, beside = (fit_stops([phases], [], tracks, 1.0, {}, {}, 1.4) for tracks in ([track], [track, before, after]))
    assert (len(alone.hold_s), len(beside.hold_s)) == (1, 0)


@pytest.mark.parametrize(("steps", "tells_speed", "tells_scatter"), [(9, False, False), (12, True, False), (30, True, True)])
def test_few_steps_at_top_speed_tell_how_fast_but_not_how_that_scatters(steps, tells_speed, tells_scatter):
    """Windows of 3 steps of 1 s at 0.95 m/s, and some noise."""
    rng = np.random.default_rng(2)
    rows = [(np.ones(3), 0.95 + rng.normal(0, 0.01, 3), k % 2, 60.0 * (k // 2)) for k in range(steps // 3)]
    cruise = fit_cruise(_windows(rows), Noise(0.005, 0.01), 2)
    assert (cruise is not None) == tells_speed
    if cruise is not None:
        figures = {each.name: each for each in _speeds(cruise, 1.0)}
        top = figures["max_speed_mps"]
        assert top.low < 0.96 < top.high and isinstance(figures["speed_noise"], Unknown) != tells_scatter
        assert (top.high > 1.05) != tells_scatter  # 0.95 / (1 - 0.8 * 0.15) is the mean of 1.08 that scatter by 0.15


@pytest.mark.parametrize(("usual_mps", "made_mps"), [(0.5, 0.8), (1.5, 1.5)])
def test_type_is_no_slower_than_what_is_seen(usual_mps, made_mps):
    base = RobotShape(length_m=0.6, width_m=0.6, max_speed_mps=usual_mps, accel_mps2=0.5, decel_mps2=0.5, turn_rate_rad_s=1.0)
    seen = Calibration(MotionLog("log", "CSV"), ["a"], 60.0, {}, fits=SimpleNamespace(speed_mps=0.8))
    assert type_of(seen, base).max_speed_mps == made_mps


def test_stands_in_frames_of_their_own_are_not_at_one_place(shuttles):
    """Half a centimetre apart in one frame, or on two levels at the same numbers; and nobody is seen to wait for whom."""
    rows = {name: shuttles[name] for name in ("s0", "s1")}
    moved = rows["s1"] + (0.0, 0.2, 0.0, 0.0)
    one, apart = log_of(rows | {"s1": moved}), log_of(rows | {"s1": moved})
    apart.poses["s1"] = [(*row[:5], 1.0) for row in apart.poses["s1"]]
    together, alone = calibrated(one), calibrated(apart)
    assert alone.quantities["stopping_m"].value < 0.01 < 0.05 < together.quantities["stopping_m"].value
    note = "no two vehicles share a frame: where one stands for another, it counts as a stop on the way"
    assert (note in apart.notes, note in one.notes) == (alone.quantities["stops_per_s"].count > 0, False)


def test_rate_of_few_stops_is_that_of_stops_that_last_as_long_as_usual():
    """Of stops of 6 s (sigma 0.5) 64.23 % last the 5 s from which on they are seen. Quantiles are those of
    gamma distributions of 0.5, 1.5 and 5 stops; the prior is half a stop in 125 s, which hardly matters in long driving.
    """
    one, none = stops_of([5.1], driven_s=250.0), stops_of([], driven_s=250.0)
    seen_s = 250 * 0.6423 + 125
    assert one.rate_per_s == pytest.approx((1.183 / seen_s, 0.1759 / seen_s, 3.907 / seen_s), rel=1e-3)
    assert none.rate_per_s == pytest.approx((0.0, 0.0, 1.921 / seen_s), rel=1e-3)
    assert stops_of([5.1, 5.1, 5.1, 5.1], driven_s=250.0).rate_per_s[2] == pytest.approx(8.459 / seen_s, rel=1e-3)
    assert stops_of([5.1], driven_s=25_000.0).rate_per_s[0] == pytest.approx(1.183 / (25_000 * 0.6423 + 125), rel=1e-3)
    written = {}
    for name, stops in (("none", none), ("few", one), ("many", stops_of([5.5, 6.0, 7.0, 8.0, 9.0], driven_s=250.0))):
        figures = {"stops_per_s": stops.rate_per_s} | ({} if stops.median_s is None else {"stop_median_s": stops.median_s})
        known = {key: CalibratedFigure(key, "", *ends, 1, "stops") for key, ends in figures.items()}
        written[name] = disturbances_of(Calibration(MotionLog("log", "CSV"), [], 1.0, known))
    assert written["none"].intervals == {}
    assert (written["few"].stops_per_s, written["few"].stop_median_s) == (pytest.approx(one.rate_per_s[0], rel=1e-3), 6.0)
    assert written["many"].stop_median_s != 6.0


def test_rate_of_many_stops_is_that_of_stops_that_last_as_long_as_is_written():
    """Median of the gamma distribution of 5.5, 5.170, by driving times the share of stops that is seen, and the prior's 125 s."""
    stops = stops_of([5.5, 6.0, 7.0, 8.0, 9.0], driven_s=250.0)
    seen_share = 1 - NormalDist(math.log(stops.median_s[0]), stops.sigma[0]).cdf(math.log(5.0))
    assert stops.rate_per_s[0] == pytest.approx(5.170 / (250.0 * seen_share + 125), rel=1e-3)
    assert stops.rate_per_s[1] < stops.rate_per_s[0] < stops.rate_per_s[2]


@pytest.mark.parametrize(("now", "drifts"), [((10.0, 9.5, 10.5), True), ((9.0, 8.0, 10.0), False)])
def test_time_of_an_action_drifts_where_both_intervals_do_not_explain_it(tmp_path, now, drifts):
    """From 8 s, 7.5 to 8.5, in both cases."""

    def known(*ends):
        figures = {"actions.pick.median_s": ends, "actions.pick.sigma": (0.3, 0.2, 0.4)}
        return Calibration(
            MotionLog("log", "CSV"), [], 1.0, {name: CalibratedFigure(name, "s", *each, 9, "times") for name, each in figures.items()}
        )

    base = RobotShape(length_m=0.5, width_m=0.5, max_speed_mps=1.0, accel_mps2=1.0, decel_mps2=1.0, turn_rate_rad_s=1.0)
    write_files(known(8.0, 7.5, 8.5), base, tmp_path / "a.yaml")
    assert list(drift(known(*now), tmp_path / "a.yaml")) == ["actions.pick.median_s"] * drifts


@pytest.mark.parametrize(("ends", "written"), [((71.0, 0.2, 300.0), (4.0, (1.0, 16.0))), ((8.0, 2.0, 40.0), (8.0, (2.0, 40.0)))])
def test_memory_that_is_not_told_is_written_as_usual(ends, written):
    figures = {
        name: CalibratedFigure(name, "", *each, 9, "steps")
        for name, each in (("speed_noise", (0.05, 0.04, 0.06)), ("speed_noise_tau_s", ends))
    }
    made = disturbances_of(Calibration(MotionLog("log", "CSV"), [], 1.0, figures))
    assert (made.speed_noise_tau_s, made.intervals["speed_noise_tau_s"]) == written
