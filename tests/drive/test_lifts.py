"""Robots that ride lifts, with times known by hand."""

import numpy as np
import pytest
from worlds import problem_of, two_levels

from mrp_sumo.core.disturbances import Disturbances, Fire, Outage
from mrp_sumo.core.driving import RecoveryOptions
from mrp_sumo.core.facilities import LIFT_MODES, LIFT_STATES, PEOPLE
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.metrics.audit import audit

pytestmark = pytest.mark.kernel

STEP_S, RIDE_S = 3.0, 10.0
UP = [3, 10, 11, 12, 4]  # through the shaft
DOWN = UP[::-1]
ONE_BY_ONE = [[1, 2, *UP, 5, 6, 7], [0, 0, 0, 0, 0, 0, 0, 1, 2, *UP, 5, 6]]


def planned_and_driven(tmp_path, paths, **settings):
    """The retimed plan, and how it was driven."""
    graph = two_levels(RIDE_S, STEP_S)
    problem, plan = problem_of(graph, paths)
    how = ExecutionSettings(**settings)
    planned = retime(problem, plan, how)
    run = simulate(problem, planned, how, build_network(graph, tmp_path / "world.net.xml"))
    verdict = audit(run, problem.fleet)
    assert verdict["passed"], verdict
    assert run.all_at_goal
    return planned, run


def times(plan, robot, vertex):
    """When a robot comes to a vertex, and when it leaves it."""
    visit = next(k for k in range(plan.first[robot], plan.first[robot + 1]) if plan.vertex[k] == vertex)
    return plan.arrive_s[visit], plan.depart_s[visit]


@pytest.mark.parametrize("engine", ["kinematic", "sumo"])
def test_two_robots_ride_one_after_the_other_and_arrive_as_planned(tmp_path, engine):
    planned, run = planned_and_driven(tmp_path, ONE_BY_ONE, engine=engine)
    assert np.abs(run.arrived_s - planned.arrive_s).max() <= 0.1 + 1e-9
    assert times(planned, 0, 4)[0] - times(planned, 0, 3)[0] == pytest.approx(RIDE_S, abs=0.2)
    assert run.level[0].tolist() == [0, 0]
    assert run.level[-1].tolist() == [1, 1]
    assert 50.0 in run.x_m[(run.level == 1) & (run.speed_mps < 0.1)].round(6)


def test_the_second_robot_waits_for_the_ride_the_return_and_the_doors(tmp_path):
    planned, run = planned_and_driven(tmp_path, ONE_BY_ONE, engine="kinematic")
    left_s = times(planned, 0, 5)[0]
    arrived_s, leaves_s = times(planned, 1, 2)
    assert leaves_s - left_s == pytest.approx(RIDE_S, abs=0.2)  # it comes back: doors close, it travels, doors open
    waits = [event for event in run.events if event.kind == "waited" and event.robot == 1]
    assert [event.text for event in waits[-2:]] == ["needs what robot_0 holds or is to pass first", "waits for lift 'goods'"]
    assert sum(event.duration_s for event in waits[-2:]) == pytest.approx(leaves_s - arrived_s, abs=0.2)
    assert not [event for event in run.events if event.kind == "blocked" and event.robot == 0]


def test_who_leaves_goes_first_and_the_car_is_there_for_who_enters_next(tmp_path):
    opposite = [[1, 2, *UP, 5, 6, 7], [9, 9, 9, 9, 9, 9, 9, 9, 9, 6, 5, *DOWN, 2, 1]]
    planned, run = planned_and_driven(tmp_path, opposite, engine="kinematic")
    assert times(planned, 1, 4)[0] - times(planned, 0, 7)[0] < RIDE_S  # it need not come back
    log = run.facilities
    assert log.lift_name == ("goods",)
    states = zip((LIFT_STATES[k] for k in log.lift_state.tolist()), log.lift_level.tolist())
    assert list(dict.fromkeys(states)) == [("coming", 0), ("open", 0), ("taken", 0), ("taken", 1), ("open", 1)]


def test_without_an_order_the_lift_is_for_who_asked_first(tmp_path):
    _, run = planned_and_driven(tmp_path, [[1, 2, *UP, 5, 6, 7], [8, 8, 8, 1, 2, *UP, 5, 6, 9]], policy="open_loop", engine="kinematic")
    assert run.goal_s[0] < run.goal_s[1]


def test_a_lift_out_of_service_is_entered_when_it_is_back(tmp_path):
    out = Disturbances(outages=(Outage("goods", duration_s=30.0),))
    planned, run = planned_and_driven(tmp_path, ONE_BY_ONE, engine="kinematic", disturbances=out)
    late_s = run.arrived_s - planned.arrive_s
    assert late_s[:2] == pytest.approx([0, 0], abs=0.2)  # up to the lift
    assert late_s[3:10].min() > 15
    assert [event.text for event in run.events if event.kind == "closed"] == ["lift 'goods' is out of service"]


def test_robots_that_are_resolved_take_the_other_lift(tmp_path):
    graph = two_levels(RIDE_S, STEP_S, lifts=("goods", "people"))
    problem, plan = problem_of(graph, [[1, 2, 3, 13, 14, 15, 4, 5, 6]])
    out = Disturbances(outages=(Outage("goods"),))
    run = simulate(
        problem,
        plan,
        ExecutionSettings(engine="kinematic", disturbances=out, on_deadlock="resolve", recovery=RecoveryOptions(patience_s=2.0)),
        tmp_path,
    )
    assert run.all_at_goal
    names = run.facilities.lift_name
    assert {
        names[f] for f, k in zip(run.facilities.lift.tolist(), run.facilities.lift_state.tolist()) if k == LIFT_STATES.index("taken")
    } == {"people"}


def trips_of(run):
    """What the first lift did: (state, level, robot), each once in a row."""
    log = run.facilities
    rows = zip((LIFT_STATES[k] for k in log.lift_state.tolist()), log.lift_level.tolist(), log.lift_robot.tolist())
    return list(dict.fromkeys(rows))


def test_first_come_first_served_who_waits_before_the_lift_makes_room_for_who_leaves_it(tmp_path):
    opposite = [[1, 2, *UP, 5, 6, 7], [9, 9, 9, 9, 9, 9, 9, 9, 6, 5, *DOWN, 2, 1, 8]]
    _, run = planned_and_driven(tmp_path, opposite, policy="open_loop", engine="kinematic", on_deadlock="resolve")
    assert [event.robot for event in run.events if event.kind == "gave_way"] == [1]
    assert run.goal_s[0] < run.goal_s[1]


def test_robots_wait_while_people_ride(tmp_path):
    people = Disturbances(lift_rides_per_h=900.0, lift_hold_s=4.0)
    planned, run = planned_and_driven(tmp_path, ONE_BY_ONE, engine="kinematic", disturbances=people, seed=3)
    _, again = planned_and_driven(tmp_path, ONE_BY_ONE, engine="kinematic", disturbances=people, seed=3)
    states = {state for state, _, robot in trips_of(run) if robot == PEOPLE}
    assert states == {"coming", "held"}
    assert (run.goal_s > planned.arrive_s[planned.first[1:] - 1] + 1).any()
    np.testing.assert_array_equal(run.x_m, again.x_m)
    log = run.facilities
    human = log.lift_mode == LIFT_MODES.index("human")
    assert (log.lift_robot[human] == PEOPLE).all()


def test_lifts_go_home_and_take_nobody_while_there_is_a_fire(tmp_path):
    fire = Disturbances(fires=(Fire(22.0, 60.0),))  # robot_0 rides
    planned, run = planned_and_driven(tmp_path, ONE_BY_ONE, engine="kinematic", disturbances=fire)
    assert run.goal_s[0] == pytest.approx(planned.arrive_s[planned.first[1] - 1], abs=0.2)  # it rides to the end
    assert run.goal_s[1] > 82.0
    log = run.facilities
    burning = log.lift_mode == LIFT_MODES.index("fire")
    stands = burning & (log.lift_state == LIFT_STATES.index("open"))
    assert 0 in log.lift_level[stands]
    assert [event.text for event in run.events if event.kind == "closed"] == ["fire: lift 'goods' goes to L1"]


def test_who_is_called_back_in_the_cabin_was_on_the_level_to_which_it_rode(tmp_path):
    """It rides up, and down again without leaving the cabin: on each level where the lift stops there, 50 m apart in the picture."""
    for turns in (12, 4):  # in the shaft, where the level has changed, and at the upper stop
        there = [2, *UP[: UP.index(turns) + 1]]
        _, run = planned_and_driven(tmp_path, [[*there, *there[-2::-1]]])
        assert set(run.level[:, 0].tolist()) == {0, 1}
        assert np.array_equal(run.x_m[:, 0] > 25.0, run.level[:, 0] == 1)
