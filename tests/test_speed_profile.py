"""Runs as closed forms of time, against figures worked out by hand and against small steps of time."""

import numpy as np
import pytest
from test_architecture import tool

CLOSED = tool("speed_profile")  # runs as closed forms


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


@pytest.mark.parametrize(("distance_m", "lasts_s"), [(16.0, 2 + 5 + 4), (1.5, 1 + 2)])  # 2 m up, 10 m on, 4 m down; a triangle up to 1 m/s
def test_one_lane_takes_as_long_as_speeding_up_going_on_and_braking(distance_m, lasts_s):
    assert CLOSED.run_profile(np.array([distance_m]), np.array([np.inf]), 2.0, 1.0, 0.5).end_s == pytest.approx(lasts_s)
