"""Disturbances slow robots down and hold them back, the same ones for the same seed, and nothing overlaps under any of them."""

import dataclasses

import numpy as np
import pytest
from worlds import BURGER, cross, drive, graph_of, kinds, least_distance_m, line, square_grid

from mrp_sumo.core.disturbances import Breakdown, ClosedLane, Disturbances, Fire, Obstacle
from mrp_sumo.core.driving import RecoveryOptions
from mrp_sumo.core.execution import BOOKINGS, Outcome
from mrp_sumo.errors import ExecutionError, OptionError
from mrp_sumo.metrics.audit import audit

DISTURBED = BOOKINGS.index("disturbed")
EVERYTHING = Disturbances(
    speed_spread=0.08,
    speed_noise=0.05,
    stops_per_s=1 / 20,
    start_delay_s=3.0,
    delay_probability=0.05,
    latency_s=0.4,
    message_loss=0.2,
)
STRAIGHT = [[0, 1, 2, 3, 4, 5]]


def time_with(tmp_path, **what):
    closed_lanes = what.pop("closed_lanes", ())
    return drive(tmp_path, line(6), STRAIGHT, disturbances=Disturbances(**what), closed_lanes=closed_lanes, seed=2)


@pytest.mark.parametrize(
    "what",
    [
        {"speed_spread": 0.2},
        {"speed_noise": 0.1},
        {"stops_per_s": 0.2},
        {"start_delay_s": 8.0},
        {"delay_probability": 0.5},
        {"breakdowns": (Breakdown(0, 2.0, 5.0),)},
        {"closed_lanes": (ClosedLane(3, 4, 0.0, 15.0),)},
        {"obstacles": (Obstacle(1.6, 0.0, 0.0, 15.0, 0.1),)},
    ],
    ids=lambda what: next(iter(what)),
)
def test_every_disturbance_makes_the_robot_later(tmp_path, what):
    run = time_with(tmp_path, **what)
    assert run.all_at_goal
    assert run.goal_s[0] > time_with(tmp_path).goal_s[0] + 0.3
    again = time_with(tmp_path, **what)
    assert again.x_m.tobytes() == run.x_m.tobytes() and again.events == run.events


def test_late_and_lost_messages_cost_time_where_robots_wait_for_each_other(tmp_path):
    paths = [[1, 0, 7], [4, 4, 0, 10]]
    prompt = drive(tmp_path, cross(), paths)
    late = drive(tmp_path, cross(), paths, disturbances=Disturbances(latency_s=1.0, message_loss=0.5))
    assert late.goal_s[1] > prompt.goal_s[1] + 1.0


def test_a_breakdown_lasts_as_long_as_it_says(tmp_path):
    run = time_with(tmp_path, breakdowns=(Breakdown(0, 2.0, 5.0),))
    assert run.goal_s[0] == pytest.approx(time_with(tmp_path).goal_s[0] + 5.0, abs=0.3)
    assert run.booked_s[0, DISTURBED] == pytest.approx(5.0, abs=0.3)
    event = next(event for event in run.events if event.kind == "disturbed")
    assert (event.t_s, event.robot, event.duration_s, event.text) == (2.0, 0, 5.0, "breaks down")


def test_a_broken_robot_stops_those_behind_and_nobody_touches_it(tmp_path):
    paths = [[2, 3, 4, 5, 6], [1, 2, 3, 4, 5], [0, 1, 2, 3, 4]]
    run = drive(tmp_path, line(7), paths, disturbances=Disturbances(breakdowns=(Breakdown(0, 3.0),)), time_limit_s=40.0)
    assert run.outcome is Outcome.TIME_LIMIT and np.isnan(run.goal_s).all()
    assert least_distance_m(run) >= 0.325
    assert sorted(set(kinds(run)["blocked"])) == [1, 2]


def test_an_obstacle_is_kept_clear_of(tmp_path):
    run = time_with(tmp_path, obstacles=(Obstacle(1.2, 0.0, 0.0, 15.0, 0.1),))
    while_there = run.t_s < 15.0
    radius = float(np.hypot(BURGER.length_m, BURGER.width_m) / 2)
    assert np.abs(run.x_m[while_there, 0] - 1.2).min() >= 0.1 + radius


@pytest.mark.parametrize("policy", ["adg", "adg_timed", "open_loop", "timed"])
@pytest.mark.parametrize("dt", [0.1, 0.5])
def test_nothing_overlaps_under_everything_at_once(tmp_path, policy, dt):
    paths = [[0, 1, 2, 3, 7, 11], [12, 8, 4, 5, 6], [15, 14, 13, 9, 10]]
    for seed in range(3):
        settings = {"disturbances": EVERYTHING, "step_length_s": dt, "record_period_s": dt, "seed": seed}
        run = drive(tmp_path, square_grid(4), paths, policy, time_limit_s=200.0, **settings)
        assert least_distance_m(run) >= 0.325
        fleet_audit = audit(run, fleet_of_burgers(3))
        assert fleet_audit["passed"], fleet_audit
        assert not run.findings
        assert run.all_at_goal or not policy.startswith("adg")
        assert run.booked_s.sum(1) == pytest.approx(run.sim_time_s)


def fleet_of_burgers(num_robots):
    from mrp_sumo.core.fleet import fleet_of

    return fleet_of(BURGER, num_robots)


def test_parameters_out_of_range_are_refused(tmp_path):
    with pytest.raises(OptionError, match=r"speed_noise is -0\.1"):
        Disturbances(speed_noise=-0.1)
    with pytest.raises(OptionError, match="message_loss is 1"):
        Disturbances(message_loss=1)
    with pytest.raises(OptionError, match="delay_steps_min"):
        Disturbances(delay_steps_min=3, delay_steps_max=2)
    with pytest.raises(ExecutionError, match="breakdown of robot 7, but there are 1"):
        time_with(tmp_path, breakdowns=(Breakdown(7, 1.0),))
    with pytest.raises(ExecutionError, match="lane from vertex 0 to 3, which does not exist"):
        time_with(tmp_path, closed_lanes=(ClosedLane(0, 3, 1.0),))
    assert not Disturbances().any and dataclasses.replace(Disturbances(), latency_s=1.0).any
    assert Disturbances(fires=(Fire(5.0),)).any and Disturbances(door_passages_per_h=6.0).any
    assert not Disturbances(localisation_m=0.1, localisation_tau_s=2.0, stop_median_s=9.0).any  # robots do as without


SIDING = graph_of([(0.4 * k, 0) for k in range(6)] + [(0.8, 0.4)], [(k, k + 1) for k in range(5)] + [(2, 6)])
HEAD_ON = [[0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0]]


def test_a_deadlock_can_end_the_run(tmp_path):
    run = drive(tmp_path, line(6), HEAD_ON, "open_loop", on_deadlock="stop")
    assert run.outcome is Outcome.DEADLOCK
    assert run.sim_time_s < 7


def test_a_deadlock_beside_a_siding_is_resolved(tmp_path):
    run = drive(tmp_path, SIDING, HEAD_ON, "open_loop", on_deadlock="resolve", recovery=RecoveryOptions(give_way=False))
    assert run.all_at_goal and run.outcome is Outcome.COMPLETED
    assert "deadlock" in kinds(run) and "resolved" in kinds(run) and "gave_way" not in kinds(run)
    assert least_distance_m(run) >= 0.325
    assert audit(run, fleet_of_burgers(2))["passed"]
    assert run.booked_s.sum(1) == pytest.approx(run.sim_time_s)
    assert (run.x_m[-1, 0], run.x_m[-1, 1]) == pytest.approx((2.0, 0.0), abs=0.002)


def test_a_deadlock_that_no_plan_resolves_is_told_once(tmp_path):
    run = drive(tmp_path, line(6), HEAD_ON, "open_loop", on_deadlock="resolve", time_limit_s=60.0)
    unresolved = [event for event in run.events if event.kind == "unresolved"]
    assert len(unresolved) == 1 and "lacam" in unresolved[0].text
    assert run.outcome is Outcome.TIME_LIMIT


def test_robots_drive_around_one_that_broke_down_for_good(tmp_path):
    # robot_1 never sets out and stands in the way of robot_0, which has patience, then another way round the square
    run = drive(
        tmp_path,
        square_grid(3),
        [[0, 1, 2, 5], [1, 2, 5, 8]],
        disturbances=Disturbances(breakdowns=(Breakdown(1, 0.0),)),
        on_deadlock="resolve",
        recovery=RecoveryOptions(patience_s=15.0),
    )
    assert np.isnan(run.goal_s[1])
    assert np.isfinite(run.goal_s[0])
    assert "resolved" in kinds(run)
    assert least_distance_m(run) >= 0.325


def test_unknown_wishes_about_deadlocks_are_refused(tmp_path):
    with pytest.raises(ExecutionError, match=r"on_deadlock is 'resolv' \(did you mean 'resolve'\?\)"):
        drive(tmp_path, line(3), [[0, 1]], on_deadlock="resolv")


def test_a_new_plan_that_first_turns_back_is_the_one_that_is_driven(tmp_path):
    # robot_0 has passed the siding when they meet: it has to drive back over the edge it came by, then forward on it again
    graph = graph_of([(0.4 * k, 0) for k in range(6)] + [(0.4, 0.4)], [(k, k + 1) for k in range(5)] + [(1, 6)])
    run = drive(tmp_path, graph, HEAD_ON, "open_loop", on_deadlock="resolve", recovery=RecoveryOptions(give_way=False))
    assert run.all_at_goal
    assert least_distance_m(run) >= 0.325
    assert (run.x_m[-1, 0], run.x_m[-1, 1]) == pytest.approx((2.0, 0.0), abs=0.002)


def test_a_robot_never_waits_for_itself(tmp_path):
    # the lane in the middle is shorter than a robot is long: behind it a zone is needed again before it has been left
    graph = graph_of([(0, 0), (0.5, 0), (0.6, 0), (1.1, 0), (1.6, 0)], [(k, k + 1) for k in range(4)])
    run = drive(tmp_path, graph, [[0, 1, 2, 3, 4]], disturbances=Disturbances(latency_s=3.0))
    assert run.all_at_goal
    assert not [e for e in run.events if e.kind == "deadlock" or e.other == e.robot]
