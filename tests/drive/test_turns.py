"""Who comes first is served first, at stations and at chargers and under every dispatcher: on a dead end, known by hand."""

from itertools import pairwise

import numpy as np
import pytest
from floors import BATTERY, driven, lanes, ring, scenario, tee

from mrp_sumo.drive.dispatchers import OURS
from mrp_sumo.drive.loop import Records
from mrp_sumo.drive.work import Work

DISPATCHERS = [name for name in OURS if name != "one_shot"]


@pytest.mark.parametrize("dispatcher", DISPATCHERS)
def test_two_robots_take_turns_at_a_dead_end(tmp_path, dispatcher):
    """Who is being served has the way in behind it, where the other stands first in line."""
    tasks = {"streams": [{"name": "o", "stops": ["X"], "service": [30], "arrivals": {"open": 4}}]}
    run = driven(scenario(tee(tmp_path), tasks, starts=["west", "east"], execution={"dispatcher": dispatcher})).execution
    first = np.argsort(run.stops.begin_s)
    robots = run.stops.robot[first].tolist()
    assert len(robots) > 5 and all(one != other for one, other in pairwise(robots))
    assert [run.tasks.name[k] for k in run.stops.task[first].tolist()] == [f"o_{k}" for k in range(len(robots))]


@pytest.mark.parametrize(("robots", "service_s"), [(3, (10, 3)), (4, (3, 20))])
def test_robot_at_its_place_is_not_sent_round_the_ring(tmp_path, robots, service_s):
    """Nobody can pass on a one-way ring, so no planner gets more out of it: one that plans the others first does not send a robot off."""
    orders = [{"name": name, "stops": [name], "service": [s], "arrivals": {"open": 4}} for name, s in zip("AB", service_s)]
    short = {"execution": {"time_limit_s": 200.0}}
    done = [
        int(
            np.isfinite(
                driven(scenario(ring(tmp_path), {"streams": orders}, robots=robots, planner=planner, **short)).execution.tasks.done_s
            ).sum()
        )
        for planner in ("prioritised", "pbs")
    ]
    assert done[0] == done[1] > 20, done


@pytest.mark.slow
def test_three_robots_take_turns_at_one_charger(tmp_path):
    """A charge takes 5 minutes. They come from 4, 10 and 14 m away, and again in the order in which they left."""
    xy = {"west": (0.0, 0.0), "mid": (6.0, 0.0), "east": (16.0, 0.0), "X": (6.0, 4.0)}
    floor = lanes(tmp_path / "floor.csv", xy, [("west", "mid"), ("mid", "east"), ("mid", "X")], True)
    charging = {"stations": ["X"], "critical_low_charging_level": 50, "maximum_desired_charging_level": 90, "start_level": [40, 40]}
    tasks = {"streams": [{"name": "o", "stops": ["west", "east"], "arrivals": {"open": 4}}], "charging": charging}
    battery = {**BATTERY, "charging_a": 3.0, "device_w": 1.0, "inertia_kgm2": 0.01}
    shape, limit = {"battery": battery}, {"time_limit_s": 2400.0}
    result = driven(scenario(floor, tasks, starts=["west", "mid", "east"], shape=shape, execution=limit))
    run = result.execution
    charges = np.flatnonzero(~run.tasks.is_order[run.stops.task])
    in_turn = charges[np.argsort(run.stops.begin_s[charges])]
    assert run.stops.robot[in_turn].tolist()[:6] == [1, 0, 2, 1, 0, 2]
    assert result.operations_audit["passed"], result.operations_audit


WEARS = {"mtbf_h": 0.03, "mttr_h": 0.01, "tow_s": 10, "maintenance": {"every_h": 0.05, "takes_s": 20}}


@pytest.mark.parametrize(("engine", "wears"), [("kinematic", {}), pytest.param("sumo", {}, marks=pytest.mark.slow), ("kinematic", WEARS)])
def test_a_run_whose_looks_are_left_out_while_nobody_needs_them_is_the_same(tmp_path, monkeypatch, engine, wears):
    """Batteries come to the level at which their robots are to charge, and robots fail after so much time with orders: with all steps
    seen, with looks twice a second, and without.
    """
    charging = {"stations": ["c3"], "critical_low_charging_level": 50, "maximum_desired_charging_level": 60, "start_level": [52, 58]}
    tasks = {"streams": [{"name": "o", "stops": ["A", "B"], "service": [30, 5], "arrivals": {"open": 2}}], "charging": charging}
    other = {"shape": {"battery": BATTERY, **wears}, "execution": {"time_limit_s": 700.0, "engine": engine}}
    looks, runs, update = [], [], Work.update
    for leaves_out in ("looks", "steps", "nothing"):
        looks.append(0)

        def counted(work, *arguments, **named):
            looks[-1] += 1
            update(work, *arguments, **named)

        monkeypatch.setattr(Work, "update", counted)
        if leaves_out != "looks":
            monkeypatch.setattr(Work, "is_quiet", lambda *_: False)
        if leaves_out == "nothing":
            monkeypatch.setattr(Records, "few", False)
        runs.append(driven(scenario(ring(tmp_path), tasks, starts=["A"], **other)).execution)
    one, *others = runs
    breaks = [event for event in one.events if event.kind == "disturbed"]
    assert looks[0] < looks[1] * 0.5 and (~one.tasks.is_order).sum() > 1 and (len(breaks) > 3) == bool(wears)
    for same in others:
        assert [event for event in same.events if event.kind == "disturbed"] == breaks
        for name in ("x_m", "y_m", "yaw_rad", "speed_mps"):
            assert getattr(one, name).tobytes() == getattr(same, name).tobytes(), name
        assert one.stops.begin_s.tobytes() == same.stops.begin_s.tobytes()
        assert one.batteries.level.tobytes() == same.batteries.level.tobytes()
        assert all((a == b).all() for a, b in zip(vars(one.grants).values(), vars(same.grants).values()))


def test_nobody_is_passed_over_again_and_again_in_narrow_traffic(tmp_path):
    """Six robots on twelve crossings without a way round: one that has been passed over twice is let by."""
    xy = {f"p{x}{y}": (4.0 * x, 4.0 * y) for x in range(4) for y in range(3)}
    pairs = "p12-p22 p22-p32 p32-p31 p22-p21 p31-p30 p12-p11 p30-p20 p20-p10 p11-p01 p01-p00 p01-p02"
    tasks = {
        "groups": {"from": ["p20"], "to": ["p22", "p30"]},
        "streams": [{"name": "a", "stops": ["from", "to"], "service": [3.0, 0.0], "arrivals": {"open": 7}}],
    }
    execution = {"dispatcher": "regret", "time_limit_s": 600.0, "step_length_s": 0.2, "planning": {"budget_s": 0.0}}
    other = {"planner": "pbs", "seed": 345, "record": {"bag": False, "period_s": 0.2}}
    floor = lanes(tmp_path / "floor.csv", xy, (pair.split("-") for pair in pairs.split()), True)
    result = driven(scenario(floor, tasks, robots=6, shape={"turn_rate_rad_s": 1.5}, execution=execution, **other))
    assert result.operations_audit["passed"], result.operations_audit
