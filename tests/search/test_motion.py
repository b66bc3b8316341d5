"""Motion in steps against steps of time written out."""

import numpy as np
import pytest
from stepped_motion import first_step_at, stepped_run, stepped_way, taken_step

from mrp_sumo.search._motion import approach_speed, stop_speed, turn_steps

pytestmark = pytest.mark.kernel

DT_S = 0.1


def run_of(distance, top, accel, decel):
    out = np.zeros(2000)
    return out[: stepped_run(distance, top, accel, decel, DT_S, out)]


def speeds(run):
    return np.diff(run, prepend=0.0) / DT_S


@pytest.mark.parametrize("seed", range(10))
def test_run_keeps_its_limits_and_ends_where_it_shall(seed):
    distance, top, accel, decel = np.random.default_rng(seed).uniform((0.05, 0.3, 0.3, 0.3), (15.0, 2.0, 2.0, 2.0))
    run = run_of(distance, top, accel, decel)
    v = np.concatenate([[0.0], speeds(run), [0.0]])
    assert run[-1] == pytest.approx(distance, abs=1e-6)
    assert v.max() <= top + 1e-9
    assert np.diff(v).max() <= accel * DT_S + 1e-6
    assert np.diff(v).min() >= -decel * DT_S - 1e-6


def test_number_of_steps_does_not_depend_on_the_room_for_them():
    assert stepped_run(5.0, 1.0, 0.5, 0.5, DT_S, np.zeros(3)) == len(run_of(5.0, 1.0, 0.5, 0.5))


@pytest.mark.parametrize("seed", range(10))
def test_robot_is_as_slow_as_a_slower_lane_when_it_comes_there(seed):
    rng = np.random.default_rng(seed)
    end = np.cumsum(rng.uniform(0.5, 3.0, 5))
    limit = rng.uniform(0.2, 2.0, 5)
    out = np.zeros(5000)
    run = out[: stepped_way(end, limit, end[-1], 1.5, 0.5, 0.8, DT_S, out)]
    v = speeds(run)
    begins_on = np.minimum(np.searchsorted(end, np.append(0.0, run[:-1]), side="right"), 4)
    assert (v <= np.minimum(limit[begins_on], 1.5) + 1e-9).all()
    assert np.diff(v).min() >= -0.8 * DT_S - 1e-6
    assert run[-1] == pytest.approx(end[-1], abs=1e-6)


def test_lanes_without_limits_are_one_run():
    out = np.zeros(2000)
    run = out[: stepped_way(np.array([1.0, 3.0, 6.0]), np.full(3, np.inf), 6.0, 1.0, 0.5, 0.5, DT_S, out)]
    assert run.tolist() == run_of(6.0, 1.0, 0.5, 0.5).tolist()


@pytest.mark.parametrize("free", [0.0, 0.013, 0.4, 3.0])
def test_stopping_is_slowing_down_to_nothing(free):
    assert approach_speed(free, 0.0, 0.5, DT_S) == pytest.approx(stop_speed(free, 0.5, DT_S))


@pytest.mark.parametrize("until", [0.0, 0.5, 2.0, 4.9, 6.0])
def test_robot_that_is_let_on_at_the_last_moment_drives_as_if_nothing_had_been(until):
    run = run_of(6.0, 1.0, 0.5, 0.7)
    last = taken_step(run, len(run), until, 0.7, DT_S)

    def driven(let_on_after):
        s, v, result = 0.0, 0.0, []
        for k in range(len(run)):
            free = (6.0 if k >= let_on_after else until) - s
            v = min(stop_speed(free, 0.7, DT_S), v + 0.5 * DT_S, 1.0)
            s += v * DT_S
            result.append(s)
        return np.array(result)

    assert driven(last) == pytest.approx(run, abs=1e-6)
    assert last == len(run) or np.abs(driven(last + 1) - run).max() > 1e-6


def test_step_at_a_place_is_the_first_after_which_the_robot_is_there():
    run = run_of(2.0, 1.0, 0.5, 0.5)
    assert first_step_at(run, len(run), 0.0) == 0
    k = first_step_at(run, len(run), 1.0)
    assert run[k - 1] >= 1.0 > run[k - 2]
    assert first_step_at(run, len(run), 2.5) == len(run) + 1


@pytest.mark.parametrize(("angle", "expected"), [(0.0, 0), (0.1, 1), (-0.11, 2), (1.5, 15)])
def test_steps_of_a_turn(angle, expected):
    assert turn_steps(angle, 1.0, DT_S) == expected
