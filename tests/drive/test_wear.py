"""Failures and maintenance that come with use, by closed forms and by hand."""

import math
from itertools import chain, repeat

import numpy as np
import pytest
from floors import SMALL, driven, ring, scenario, tee

from mrp_sumo.core.disturbances import MAINTAINED, Failure
from mrp_sumo.core.robot_type import HOUR_S, Maintenance, RobotShape
from mrp_sumo.drive.robot_work import Change, RobotWork
from mrp_sumo.drive.wear import PUSHED_MPS, Wear
from mrp_sumo.errors import OptionError

OPEN = {"streams": [{"name": "o", "stops": ["A", "B"], "service": [5, 3], "arrivals": {"open": 3}}]}


def shape(**figures):
    return RobotShape(**{**SMALL, **figures})


@pytest.mark.parametrize("k", [0.7, 1.0, 3.0])
def test_times_between_failures_have_the_mean_and_spread_of_weibull(k):
    """20,000 draws of one robot: mean and standard deviation within 4 standard errors of the closed form."""
    wear = Wear([shape(mtbf_h=2.0, mttr_h=0.1, mtbf_shape=k)], seed=1)
    hours = np.array([wear._next_s(0) for _ in range(20_000)]) / HOUR_S
    spread = 2.0 * math.sqrt(math.gamma(1 + 2 / k) / math.gamma(1 + 1 / k) ** 2 - 1)
    assert abs(hours.mean() - 2.0) < 4 * spread / math.sqrt(len(hours))
    assert hours.std() == pytest.approx(spread, rel=0.05)


@pytest.mark.parametrize(("sigma", "spread"), [(None, 1.0), (0.5, math.sqrt(math.exp(0.25) - 1)), (0.0, 0.0)])
def test_times_to_repair_have_the_mean_and_spread_asked_for(sigma, spread):
    wear = Wear([shape(mtbf_h=1.0, mttr_h=0.5, mttr_sigma=sigma)], seed=2)
    hours = np.array([wear._repair_s(0) for _ in range(20_000)]) / HOUR_S
    assert abs(hours.mean() - 0.5) <= 4 * 0.5 * spread / math.sqrt(len(hours)) + 1e-12
    assert hours.std() == pytest.approx(0.5 * spread, rel=0.05, abs=1e-12)


def test_failures_depend_on_hours_of_use_and_on_no_other_robot():
    """The n-th failure of robot_1 comes after the same use beside one that fails often, one that does not, and for longer idleness."""
    used_s = []
    for other, idle_s in ((0.1, 0), (0.1, 500), (None, 500)):
        first = shape(mtbf_h=other, mttr_h=other)
        wear, robots = Wear([first, shape(mtbf_h=0.1, mttr_h=0.1)], seed=3), [RobotWork(0), RobotWork(1)]
        at, used, now_s = [], 0, 0.0
        wear.look(now_s, robots)
        now_s += idle_s
        wear.look(now_s, robots)
        for robot in robots:
            robot.begin([(robot.number, 0)], now_s, now_s, (0.0, 0.0), charges=False)
        wear.look(now_s, robots)
        while len(at) < 5:
            now_s, used = now_s + 1.0, used + 1
            at += [used for failure in wear.look(now_s, robots) if failure.robot == 1]
            wear.look(now_s, robots)
        used_s.append(at)
    assert used_s[0] == used_s[1] == used_s[2]


@pytest.mark.parametrize("done_s", [1700.0, 1900.0])
def test_maintenance_is_due_after_its_hours_as_soon_as_an_order_is_done(done_s):
    """An hour and a half idle, then at an order until 1,700 or 1,900 s of use: 100 s too early, or late."""
    wear, robot = Wear([shape(maintenance=Maintenance(every_h=0.5, takes_s=60.0))], seed=0), RobotWork(0)
    wear.look(0.0, [robot])
    wear.look(5400.0, [robot])
    robot.begin([(0, 0)], 5400.0, 5400.0, (0.0, 0.0), charges=False)
    wear.look(5400.0, [robot])
    assert wear.wake_s == 5400.0 + 1800.0
    due = list(chain.from_iterable(wear.look(5400.0 + used_s, [robot]) for used_s in range(100, int(done_s) + 1, 100)))
    assert not due and robot.is_called == (done_s == 1900.0)
    robot.drop(Change.FREED, 5400.0 + done_s)
    due = wear.look(5400.0 + done_s, [robot])
    assert due == ([Failure(0, 5400.0 + done_s, 60.0, 0.0, text=MAINTAINED)] if done_s == 1900.0 else [])
    assert robot.is_free == (done_s == 1700.0)


@pytest.mark.parametrize("change", [Change.BREAKS, Change.LOST])
def test_a_robot_that_is_down_is_not_used(change):
    wear, robot = Wear([shape(mtbf_h=0.1, mttr_h=0.1)], seed=0), RobotWork(0)
    robot.begin([(0, 0)], 0.0, 0.0, (0.0, 0.0), charges=False)
    wear.look(0.0, [robot])
    assert wear.wake_s < np.inf
    robot.on(change, 1.0)
    assert not wear.look(1.0, [robot]) and wear.wake_s == np.inf and not wear.look(1e9, [robot])


@pytest.mark.slow
def test_availability_of_a_long_run_is_mtbf_over_mtbf_and_mttr(tmp_path):
    """Two robots, 45 min: about 130 failures, so that the share is known to 0.03 (3 standard errors)."""
    figures = {"mtbf_h": 0.01, "mttr_h": 0.0025}
    result = driven(scenario(ring(tmp_path), OPEN, starts=["c4", "c2"], shape=figures, execution={"time_limit_s": 2700.0}))
    assert result.status == "completed" and not result.operations_audit["findings"], result.note
    assert result.metrics["availability"] == pytest.approx(0.01 / 0.0125, abs=0.03)
    assert sum(event.text == "breaks down" for event in result.execution.events) > 80


@pytest.mark.parametrize(("stands_s", "between_s"), [(30.0, (40.0, 80.0)), (math.inf, (205.0, 240.0))])
def test_who_is_behind_a_broken_robot_passes_when_it_is_pushed_or_repaired(tmp_path, monkeypatch, stands_s, between_s):
    """robot_0 breaks down on 'mid' at 5 s for 200 s; robot_1 has to pass it to the east."""
    due = chain([[Failure(0, 5.0, 200.0, stands_s, PUSHED_MPS)]], repeat([]))
    monkeypatch.setattr(Wear, "look", lambda self, now_s, robots: next(due))
    tasks = [{"name": "o", "stops": ["east"], "release_s": 8.0, "service_s": 1.0}]
    figures = {"mtbf_h": 1.0, "mttr_h": 1.0, "tow_s": 30.0 if stands_s == 30.0 else None}
    result = driven(scenario(tee(tmp_path), tasks, starts=["mid", "west"], shape=figures))
    (done_s,) = result.execution.tasks.done_s
    assert between_s[0] < done_s < between_s[1] and not result.operations_audit["findings"], result.note
    state, speed = result.execution.robot_states, result.execution.speed_mps[result.execution.t_s < 204.0, 0]
    assert state.end_s[(state.robot == 0) & (state.state == 4)][0] == pytest.approx(min(205.0, result.execution.sim_time_s), abs=0.6)
    assert speed.max() <= PUSHED_MPS + 1e-6 and (speed.max() > 0) == (stands_s == 30.0)


def test_maintenance_is_done_out_of_the_way(tmp_path):
    """The only robot is maintained after each 36 s at orders, for 60 s, at its place to park; nobody calls that a fault."""
    tasks = {"streams": [{"name": "o", "stops": ["X"], "service": [5], "arrivals": {"open": 2}}], "parking": ["east"]}
    result = driven(scenario(tee(tmp_path), tasks, starts=["west"], shape={"maintenance": {"every_h": 0.01, "takes_s": 60.0}}))
    run, state = result.execution, result.execution.robot_states
    broken = np.flatnonzero(state.state == 4)
    assert len(broken) >= 2 and not result.operations_audit["findings"], result.note
    for k in broken[:2].tolist():
        assert state.end_s[k] - state.begin_s[k] == pytest.approx(60.0, abs=0.6)
        at = int(np.searchsorted(run.t_s, state.end_s[k] - 1.0))
        assert math.hypot(run.x_m[at, 0] - 10.0, run.y_m[at, 0]) < 0.05
    used_s = (state.end_s - state.begin_s)[state.state == 0].sum()
    assert result.metrics["availability"] == pytest.approx(used_s / (used_s + (state.end_s - state.begin_s)[broken].sum()))


@pytest.mark.parametrize(
    ("figures", "says"),
    [
        ({"mtbf_h": 1.0}, "mtbf_h without mttr_h"),
        ({"mttr_h": 1.0}, "mttr_h without mtbf_h"),
        ({"tow_s": 10.0}, "tow_s without mtbf_h"),
        ({"mtbf_shape": 2.0}, "mtbf_shape without mtbf_h"),
        ({"mttr_sigma": 0.5}, "mttr_sigma without mtbf_h"),
        ({"mtbf_h": 0.0, "mttr_h": 1.0}, "mtbf_h is 0, expected above 0"),
    ],
)
def test_half_of_the_figures_are_refused(figures, says):
    with pytest.raises(OptionError, match=says):
        shape(**figures)
