"""Doors that open for robots, with times known by hand."""

import dataclasses

import numpy as np
import pytest
from worlds import drive, line, problem_of

from mrp_sumo.core.disturbances import Disturbances, Outage
from mrp_sumo.core.facilities import DOOR_STATES, PEOPLE
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.maps.building import Building, Door, Level
from mrp_sumo.maps.doors import opening_s, with_doors

pytestmark = pytest.mark.kernel

OPENS_S, FAR = 5.0, 12


def corridor(opens_s=OPENS_S, **options):
    """A line with a door between its last two vertices but one."""
    graph = line(FAR)
    through = [
        {"door": "gate", "door_s": opens_s, **options} if {a, b} == {FAR - 3, FAR - 2} else {} for a, b in zip(graph.tail, graph.head)
    ]
    return dataclasses.replace(graph, lane_options=tuple(through))


def states(run):
    """What the door did, and when."""
    return [(DOOR_STATES[k], t) for k, t in zip(run.facilities.door_state.tolist(), run.facilities.door_t_s.tolist())]


def test_doors_open_as_in_open_rmf():
    assert opening_s("double_sliding", 1.7) == pytest.approx(0.85 / 0.2 + 1.0)
    assert opening_s("sliding", 1.7) == pytest.approx(1.7 / 0.2 + 1.0)
    assert opening_s("hinged", 1.0) == opening_s("double_hinged", 2.0) == pytest.approx(np.pi / 2 / 0.5 + 0.5 / 0.3)


def test_a_door_is_open_when_a_robot_comes_and_closes_behind_it(tmp_path):
    there = list(range(FAR))
    with_door = drive(tmp_path, corridor(), [there], engine="kinematic")
    without = drive(tmp_path, line(FAR), [there], engine="kinematic")
    np.testing.assert_array_equal(with_door.x_m, without.x_m[: len(with_door.x_m)])
    (shut, _), (opening, begins_s), (stands_open, opened_s), (closing, leaves_s) = states(with_door)[:4]
    assert (shut, opening, stands_open, closing) == ("closed", "opening", "open", "closing")
    assert opened_s - begins_s == pytest.approx(OPENS_S)
    assert begins_s > 0
    assert leaves_s >= with_door.arrived_s[FAR - 2]


def test_a_robot_that_starts_before_a_door_is_delayed_as_long_as_it_opens(tmp_path):
    there = list(range(FAR - 3, FAR))
    problem, plan = problem_of(corridor(), [there])
    how = ExecutionSettings(engine="kinematic")
    planned = retime(problem, plan, how)
    run = simulate(problem, planned, how, tmp_path)
    without = drive(tmp_path, line(FAR), [there], engine="kinematic")
    assert run.goal_s - without.goal_s == pytest.approx(OPENS_S, abs=0.11)
    assert run.arrived_s == pytest.approx(planned.arrive_s)
    assert [event.text for event in run.events if event.kind == "waited"] == ["waits for door 'gate'"]


def test_a_door_stays_open_while_the_next_one_is_near(tmp_path):
    paths = [list(range(4, FAR)), list(range(2, FAR - 1))]
    run = drive(tmp_path, corridor(), paths, engine="kinematic")
    assert [state for state, _ in states(run)].count("opening") == 1
    assert run.all_at_goal


def test_a_door_does_not_close_before_a_robot_that_comes_within_its_closing_and_opening(tmp_path):
    apart = 5  # vertices, 9 s: less than two times 5 s
    paths = [list(range(FAR - 4, FAR)), list(range(FAR - 4 - apart, FAR - 1))]
    run = drive(tmp_path, corridor(), paths, engine="kinematic")
    closing = [t for state, t in states(run) if state == "closing"]
    assert [state for state, _ in states(run)].count("opening") == 1
    assert closing[0] >= run.arrived_s[-1]


def test_robots_wait_before_a_locked_door(tmp_path):
    locked = Disturbances(outages=(Outage(door="gate", begin_s=0.0, duration_s=50.0),))
    run = drive(tmp_path, corridor(), [list(range(FAR))], engine="kinematic", disturbances=locked)
    opening = [t for state, t in states(run) if state == "opening"]
    assert opening == [50.0]
    assert run.arrived_s[FAR - 2] > 50.0 + OPENS_S
    assert [event.text for event in run.events if event.kind == "closed"] == ["door 'gate' is locked"]


def test_a_manual_door_opens_for_people_only(tmp_path):
    paths, manual = [list(range(FAR))], corridor(door_manual=True)
    shut = drive(tmp_path, manual, paths, engine="kinematic")
    assert not shut.all_at_goal
    assert states(shut) == [("closed", 0.0)]
    people = Disturbances(door_passages_per_h=60.0, door_hold_s=10.0)
    run = drive(tmp_path, manual, paths, engine="kinematic", disturbances=people, time_limit_s=600.0)
    assert run.all_at_goal
    assert set(run.facilities.door_robot[run.facilities.door_state == DOOR_STATES.index("opening")].tolist()) == {PEOPLE}


def test_robots_need_a_door_open_wherever_they_would_touch_it():
    graph = line(4, 1.0)
    level = Level(
        name="L1",
        elevation_m=0.0,
        **dict.fromkeys(("raw_xy", "world_xy", "xy"), np.array([[1.3, -0.5], [1.3, 0.5], [2.5, 3.0], [2.5, 4.0]])),
        vertex_name=("",) * 4,
        vertex_options=({},) * 4,
        doors=(Door(0, 1, "gate", "hinged"), Door(2, 3, "elsewhere", "hinged")),
    )
    building = Building(name="b", path=None, coordinate_system="", levels={"L1": level}, lifts={})
    result = with_doors(graph, building, 0.4)
    assert {(a, b) for a, b, o in zip(result.tail.tolist(), result.head.tolist(), result.lane_options) if o} == {
        (0, 1),
        (1, 0),
        (1, 2),
        (2, 1),
    }
    assert [v for v, options in enumerate(result.vertex_options) if options] == [1]
    assert with_doors(graph, building, 0.1).lane_options.count({}) == 4
