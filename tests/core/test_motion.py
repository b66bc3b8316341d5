"""Closed forms of motion, against figures worked out by hand and against small steps of time."""

import numpy as np
import pytest
from test_architecture import tool

from mrp_sumo.core.motion import run_time_s

CLOSED = tool("speed_profile")  # runs as closed forms


def test_run_that_reaches_top_speed_accelerates_cruises_and_brakes():
    # 2 s and 2 m to reach 2 m/s, 4 s and 4 m to brake, 10 m in between
    assert run_time_s(16.0, 2.0, 1.0, 0.5) == pytest.approx(2 + 5 + 4)


def test_short_run_is_a_triangle_of_speed():
    # peak p with p^2 / 2 + p^2 = 1.5: 1 m/s, 1 s up and 2 s down
    assert run_time_s(1.5, 2.0, 1.0, 0.5) == pytest.approx(3.0)


def test_run_from_and_to_a_speed():
    assert run_time_s(3.0, 2.0, 1.0, 1.0, 1.0, 1.0) == pytest.approx(2.0)  # up to 2 m/s and down to 1 m/s again
    assert run_time_s(0.0, 2.0, 1.0, 1.0, 1.0, 1.0) == 0.0


def test_run_too_short_to_slow_down_has_no_time():
    assert np.isnan(run_time_s(1.0, 2.0, 1.0, 1.0, 2.0, 0.0))


def test_runs_of_several_distances_and_robots_at_once():
    found = run_time_s(np.array([[1.5], [16.0]]), np.array([2.0, 1.0]), 1.0, 0.5)
    assert found.shape == (2, 2)
    assert found[:, 0] == pytest.approx([3.0, 11.0])


def test_robot_slows_down_before_a_slower_lane_and_speeds_up_after_it():
    profile = CLOSED.run_profile(np.array([4.0, 1.0, 4.0]), np.array([np.inf, 1.0, np.inf]), 2.0, 1.0, 1.0)
    at_ends = CLOSED.speed_mps(profile, CLOSED.time_s(profile, np.array([4.0, 5.0])))
    assert at_ends == pytest.approx([1.0, 1.0])
    assert profile.speed_mps.max() == pytest.approx(2.0)
    # 2 m to 2 m/s, 0.5 m at it, 1.5 m down to 1 m/s; 1 m at that; and back
    assert profile.end_s == pytest.approx(2 * (2.0 + 0.25 + 1.0) + 1.0)


def random_run(rng):
    length = rng.uniform(0.1, 4.0, int(rng.integers(1, 7)))
    limit = np.where(rng.random(len(length)) < 0.5, np.inf, rng.uniform(0.2, 3.0, len(length)))
    return length, limit, *rng.uniform(0.3, 2.0, 3)


@pytest.mark.parametrize("seed", range(30))
def test_profile_keeps_all_limits_and_wastes_no_time(seed):
    length, limit, top, accel, decel = random_run(np.random.default_rng(seed))
    profile = CLOSED.run_profile(length, limit, top, accel, decel)
    t = np.linspace(0.0, profile.end_s, 20001)
    v = CLOSED.speed_mps(profile, t)
    s = np.append(0.0, np.cumsum((v[1:] + v[:-1]) / 2 * np.diff(t)))
    assert s[-1] == pytest.approx(length.sum())
    assert v[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(CLOSED.time_s(profile, s) - t)[s < s[-1] - 1e-4].max() < 1e-3
    rate = np.diff(v) / np.diff(t)
    assert rate.max() <= accel + 1e-6
    assert rate.min() >= -decel - 1e-6
    end = np.cumsum(length)
    lane = np.minimum(np.searchsorted(end, s, side="right"), len(length) - 1)
    assert (v <= np.minimum(limit[lane], top) + 1e-6).all()
    # at every moment something hinders it from going faster: its rates, or the limit of where it is
    bound = (rate > accel - 1e-3) | (rate < -decel + 1e-3) | (v[1:] > np.minimum(limit[lane], top)[1:] - 1e-3)
    assert bound.mean() > 0.995


@pytest.mark.parametrize("seed", range(10))
def test_one_lane_of_a_profile_takes_as_long_as_the_formula_says(seed):
    rng = np.random.default_rng(seed)
    distance, top, accel, decel = rng.uniform(0.05, 20.0), *rng.uniform(0.3, 2.0, 3)
    profile = CLOSED.run_profile(np.array([distance]), np.array([np.inf]), top, accel, decel)
    assert profile.end_s == pytest.approx(float(run_time_s(distance, top, accel, decel)))
