"""A look at the work, by hand on a line: who does not get on, who goes to charge, and when nobody has to look."""

from dataclasses import replace

import numpy as np
import pytest
from line_fleets import Fleet

from mrp_sumo.core.battery import Charging
from mrp_sumo.core.shifts import Shift
from mrp_sumo.core.task import CHARGE, FAILED, Station
from mrp_sumo.drive._causes import FACILITY, OTHER, PLANNED
from mrp_sumo.drive.charging import Chargers
from mrp_sumo.drive.robot_work import NONE, Change, Condition


def at_work(at=(2, 8), stops=(5, 12), drives=()):
    """Robots on their ways to one stop each since 0 s; some drive, the others stand."""
    fleet = Fleet(list(at), *((0.0, (v,), 0, "", r) for r, v in enumerate(stops)))
    fleet.crew.orders.reveal(0.0)
    for r in range(len(stops)):
        fleet.crew.orders.assign(r, r, 0.0)
        fleet.crew.give(fleet.crew.robots[r], r, 0.0, 0.0)
    fleet.state.motion.speed_mps[list(drives)] = 0.5
    fleet.crew.looks_s, fleet.crew.is_changed = (59.0, 60.0), False
    return fleet


@pytest.mark.parametrize(
    ("stops", "what", "now_s", "stalled"),
    [
        ((), {}, 500.0, False),  # nothing is asked of them
        ((5, 12), {}, 500.0, False),  # they are at it
        ((5, 12), {0: Change.STALLS}, 359.9, False),
        ((5, 12), {0: Change.STALLS}, 360.0, True),
        ((5, 12), {0: Change.STALLS, 1: Change.STALLS}, 60.0, True),
        ((5, 12), {0: Change.STALLS, 1: Change.BREAKS}, 60.0, False),  # it will be mended
        ((5,), {0: Change.STALLS}, 60.0, True),  # the other has nothing to do
    ],
)
def test_a_run_has_stalled_where_one_stands_for_six_minutes_or_nobody_is_at_work(stops, what, now_s, stalled):
    fleet = at_work(stops=stops)
    for r, change in what.items():
        fleet.crew.robots[r].on(change, 30.0)
    assert fleet.work.progress.has_stalled(now_s) == stalled


@pytest.mark.parametrize(
    ("released_s", "freed_s", "now_s", "stalled"), [(9, 0, 68.9, False), (9, 0, 69, True), (0, 9, 68.9, False), (0, 9, 69, True)]
)
def test_a_run_has_stalled_when_an_order_waits_for_a_minute_though_robots_are_free(released_s, freed_s, now_s, stalled):
    fleet = Fleet([2, 8], (0.0, (5,)), (float(released_s), (12,)))
    fleet.crew.orders.reveal(9.0)
    fleet.crew.orders.assign(0, 0, 0.0)
    if not freed_s:
        fleet.crew.orders.pick(0, 0.0)
        fleet.crew.orders.finish(0, 0.0)
    fleet.crew.give(fleet.crew.robots[0], 0, 0.0, 0.0)
    fleet.crew.set_free(fleet.crew.robots[0], float(freed_s))
    assert fleet.work.progress.has_stalled(now_s) == stalled


def test_that_no_stop_is_made_for_long_is_said_once_and_is_over_with_the_next():
    """For six minutes and three times the 14 s from the far end of the line to a stop at 5."""
    fleet = at_work(drives=(0, 1))
    progress, output = fleet.work.progress, []
    for now_s in (10.0, 179.9, 180.0, 401.9, 402.0, 403.0):
        progress.look(now_s)
        output.append((len(fleet.crew.drain()), progress.is_steady(now_s), progress.has_stalled(now_s)))
    assert output == [(0, True, False), (0, True, False), (0, False, False), (0, False, False), (1, False, True), (0, False, True)]
    fleet.crew.made_s = 402.5
    progress.look(404.0)
    assert progress.is_steady(404.0) and not progress.has_stalled(404.0) and progress.made_s == 402.5


@pytest.mark.parametrize("change", [Change.BREAKS, Change.SERVED])
def test_stops_need_not_be_made_while_one_is_served_or_will_be_mended(change):
    fleet = at_work(drives=(1,))
    fleet.crew.robots[0].on(change, 0.0)
    if change is Change.SERVED:
        fleet.crew.robots[0].making = "a stop"
    fleet.work.progress.look(360.0)
    assert fleet.work.progress.gets_done and fleet.work.progress.made_s == 360.0 and fleet.work.progress.is_steady(900.0)
    assert not fleet.crew.drain()


@pytest.mark.parametrize(
    ("now_s", "drives", "is_stalled"), [(59.9, (), False), (60.0, (), True), (60.0, (0,), False)], ids=("not long", "long", "drives")
)
def test_who_has_not_got_on_for_a_minute_is_stalled_until_it_drives_again(now_s, drives, is_stalled):
    fleet = at_work(drives=(1, *drives))
    fleet.work.progress.look(now_s)
    robot = fleet.crew.robots[0]
    assert (robot.condition is Condition.STALLED) == is_stalled == bool(fleet.crew.drain())
    assert fleet.work.progress.is_steady(now_s) != is_stalled
    fleet.state.motion.turning[0] = True
    fleet.work.progress.look(now_s + 1.0)
    assert robot.condition is Condition.SOUND and robot.moved_s == now_s + 1.0


@pytest.mark.parametrize(
    ("why", "is_stalled"),
    [
        ({"cause": PLANNED}, False),
        ({"cause": FACILITY}, False),
        ({}, True),  # for nobody
        ({"other": {0: 1}, "moved_s": {1: 30.5}}, False),
        ({"other": {0: 1}, "moved_s": {1: 30.0}}, True),  # half a minute is too long
        ({"other": {0: 1, 1: 2}, "moved_s": {1: 20.0, 2: 30.5}}, False),
        ({"other": {0: 1, 1: 0}, "moved_s": {1: 20.0}}, True),  # for each other
        ({"other": {0: 1}, "moved_s": {1: 60.0}, "breaks": 1}, True),
        ({"other": {0: 3}, "moved_s": {3: 60.0}}, True),  # who has no work does not get on
    ],
)
def test_who_waits_for_one_that_gets_on_is_not_stalled(why, is_stalled):
    fleet = at_work((2, 8, 14, 18), (5, 12, 16))
    grants, robots = fleet.state.grants, fleet.crew.robots
    grants.cause[:], grants.cause[0], grants.other[:] = OTHER, why.get("cause", OTHER), -1
    for r, other in why.get("other", {}).items():
        grants.other[r] = other
    for r, moved_s in {1: 60.0, 2: 60.0, **why.get("moved_s", {})}.items():
        robots[r].moved_s = moved_s
    if "breaks" in why:
        robots[why["breaks"]].on(Change.BREAKS, 60.0)
    fleet.work.progress.look(60.0)
    assert (robots[0].condition is Condition.STALLED) == is_stalled and (robots[0].moved_s == 60.0) != is_stalled


@pytest.mark.parametrize(("places", "fails"), [((8,), True), ((8, 9), False)])
def test_an_order_fails_at_whose_only_place_one_stands_that_is_lost(places, fails):
    fleet = at_work(stops=(8,))
    crew = fleet.crew
    crew.robots[1].on(Change.LOST, 0.0)
    (stop,) = crew.tasks[0].stops
    crew.orders.tasks[0] = replace(crew.tasks[0], stops=(replace(stop, station=Station("S", places)),))
    fleet.work.progress.look(60.0)
    assert (crew.orders.status[0] == FAILED, crew.robots[0].task == NONE, crew.is_changed) == (fails,) * 3
    assert [event.robot for event in crew.drain()] == [0]


def charged(levels, *orders, places=(18, 19), **rules):
    """Robots with these levels, who can charge, and orders that wait; a full charge takes 1000 s."""
    fleet = Fleet(list(range(len(levels))), *orders)
    crew = fleet.crew
    crew.settings = replace(crew.settings, charging=Charging(stations=("c",), **rules), chargers=places)
    crew.level, crew.charge_s = np.array(levels), lambda robot, share: 1000.0 * share
    crew.orders.reveal(0.0)
    return fleet, Chargers(crew, crew.settings.charging, Station("c", places, spans_s=crew.settings.charging.spans_s))


def who_charges(fleet):
    return [robot.number for robot in fleet.crew.robots if robot.charges]


@pytest.mark.parametrize(("percent", "first"), [(0, []), (50, [0, 2]), (25, [1]), (100, [0, 1, 2, 3])])
def test_a_share_of_the_robots_goes_to_charge_first_whatever_their_level(percent, first):
    fleet, chargers = charged([1.0] * 4, start_charging=percent)
    chargers.look(0.0)
    assert who_charges(fleet) == first
    for r in first:
        fleet.crew.set_free(fleet.crew.robots[r], 1.0)
        fleet.crew.robots[r].charges = False
    chargers.look(2.0)
    assert who_charges(fleet) == []


@pytest.mark.parametrize(
    ("level", "params", "begun", "goes"), [(0.2, 0, 0, True), (0.21, 0, 0, False), (0.2, 1, 0, True), (0.2, 1, 1, False)]
)
def test_who_is_low_charges_unless_it_has_begun_an_order_and_one_that_it_has_not_waits_again(level, params, begun, goes):
    fleet, chargers = charged([level], (0.0, (5, 9)))
    crew, robot = fleet.crew, fleet.crew.robots[0]
    if params:
        crew.orders.assign(0, 0, 0.0)
        crew.give(robot, 0, 0.0, 0.0)
        robot.tour = robot.tour[begun:]
    chargers.look(1.0)
    assert robot.charges == goes and crew.unassigned == ([] if begun else [0])
    if goes:
        assert crew.tasks[robot.task].kind == CHARGE and crew.orders.robot[robot.task] == 0
        chargers.look(2.0)
        assert len(crew.tasks) == 2  # once


@pytest.mark.parametrize(
    ("levels", "num_orders", "places", "rules", "charge"),
    [
        ([0.5, 0.4, 0.6], 0, (18, 19), {}, [0, 1]),  # the emptiest, a place each
        ([0.5, 0.4, 0.6], 0, (17, 18, 19), {}, [0, 1, 2]),
        ([0.5, 0.4, 0.6], 2, (17, 18, 19), {}, [1]),  # two are wanted for orders
        ([0.94, 0.945, 0.95], 0, (17, 18, 19), {}, [0]),  # for less than a minute nobody goes
        ([0.5, 0.4, 0.6], 0, (17, 18, 19), {"minimum_charging_time_s": 500.0}, [0, 1]),
        ([0.5, 0.4, 0.6], 0, (17, 18, 19), {"maximum_desired_charging_level": 55.0}, [1]),
        ([0.5, 0.4, 0.6], 0, (17, 18, 19), {"policy": "threshold"}, []),
        ([0.5, 0.4, 0.6], 0, (17, 18, 19), {"shifts": (Shift(begin_h=6, end_h=14),)}, []),
    ],
)
def test_robots_that_nobody_needs_charge_where_there_are_places(levels, num_orders, places, rules, charge):
    fleet, chargers = charged(levels, *[(0.0, (9,))] * num_orders, places=places, **{"policy": "opportunity", **rules})
    assert chargers.watches == (rules.get("policy") != "threshold")
    chargers.look(1.0)
    assert who_charges(fleet) == charge


@pytest.mark.parametrize(
    ("levels", "num_orders", "rules", "off"),
    [
        ([0.8, 0.9, 0.7], 1, {}, [1]),  # the fullest
        ([0.8, 0.9, 0.7], 2, {}, [0, 1]),
        ([0.8, 0.9, 0.7], 0, {}, []),
        ([0.49, 0.5, 0.4], 3, {}, [1]),
        ([0.8, 0.9, 0.7], 3, {"minimum_charging_time_s": 9.0}, [0, 1, 2]),
        ([0.8, 0.9, 0.7], 3, {"minimum_charging_time_s": 9.1}, []),
    ],
)
def test_robots_are_called_off_chargers_for_orders_that_nobody_else_is_free_for(levels, num_orders, rules, off):
    """They have been charged since 1 s, and it is 10 s."""
    fleet, chargers = charged(levels, *[(0.0, (9,))] * num_orders, places=(0, 1, 2), policy="opportunity", **rules)
    crew = fleet.crew
    for robot in crew.robots:
        crew.charge(robot, Station("c", (robot.number,)), 0.0)
        crew.orders.pick(robot.task, 1.0)
        robot.on(Change.PLUGGED_IN, 1.0)
        robot.making = crew._row(robot, robot.number, (1.0, 900.0), 1.0)
    crew.looks_s = (8.0, 9.0)
    chargers.look(10.0)
    assert [robot.number for robot in crew.robots if robot.making is None] == off
    assert [robot.made[-1].end_s for robot in crew.robots if robot.made] == [10.0] * len(off)


@pytest.mark.parametrize(
    ("levels", "charging", "out", "wake_s"),
    [
        ([0.5, 0.3], True, None, 109.0),  # 0.1 above 0.2, 0.01 a second, and a second early
        ([0.5, 0.3], False, None, 129.0),
        ([0.5, 0.2], True, None, 119.0),  # low already: until it is empty, or the other is low
        ([0.5, 0.0], True, None, 129.0),  # empty already
        ([0.5, 0.3], True, 1, 129.0),
    ],
)
def test_batteries_are_looked_at_before_they_can_be_low_or_empty(levels, charging, out, wake_s):
    fleet, _ = charged(levels)
    if not charging:
        fleet.crew.settings = replace(fleet.crew.settings, charging=None)
    if out is not None:
        fleet.crew.robots[out].on(Change.BREAKS, 0.0)
    assert fleet.work.level_wake_s(100.0, np.full(2, 0.01)) == pytest.approx(wake_s)


@pytest.mark.parametrize(
    ("what", "quiet"),
    [
        ("they drive", True),
        ("something has changed", False),
        ("one is stalled", False),
        ("one breaks down", False),
        ("one is mended", False),
        ("one is in line and nobody has noted it", False),
        ("one stands before a stop in passing", False),
        ("one drives to a stop in passing", True),
    ],
)
def test_nobody_need_look_where_nothing_can_change(what, quiet):
    fleet = at_work(drives=(0, 1))
    crew, robot, down_s = fleet.crew, fleet.crew.robots[0], np.zeros(2)
    crew.is_changed = what == "something has changed"
    if what == "one is stalled":
        robot.on(Change.STALLS, 0.0)
    down_s[0] = 99.0 if what == "one breaks down" else 0.0
    if what == "one is mended":
        robot.on(Change.BREAKS, 0.0)
    if "in line" in what:
        robot.wait_at = 2
    if "in passing" in what:
        fleet = Fleet([5, 19], (0.0, (9,)), service_s=0.0)
        fleet.decides("nearest")
        fleet.crew.is_changed = False
        fleet.visits.vertex = np.array([9, 19])
        fleet.state.motion.speed_mps[0] = 0.5 if "drives" in what else 0.0
    assert fleet.work.is_quiet(9.0, down_s, down_s) == quiet


def test_who_is_broken_is_looked_at_when_it_may_be_pushed_unless_it_is_served():
    fleet = at_work(drives=(0, 1))
    robot, down_s, stands_s = fleet.crew.robots[0], np.array([99.0, 0.0]), np.array([9.0, 0.0])
    robot.on(Change.BREAKS, 0.0)
    assert fleet.work.is_quiet(8.9, down_s, stands_s) and not fleet.work.is_quiet(9.0, down_s, stands_s)
    robot.making = "a stop"
    assert fleet.work.is_quiet(9.0, down_s, stands_s)


@pytest.mark.parametrize(
    ("wait_at", "service_s", "charges", "watched"),
    [(NONE, 5.0, False, False), (3, 5.0, False, True), (NONE, 0.0, False, True), (NONE, 5.0, True, True)],
)
def test_robots_are_watched_on_the_way_to_a_line_a_charger_or_a_stop_in_passing(wait_at, service_s, charges, watched):
    fleet = Fleet([2, 8], (0.0, (5,)), service_s=service_s)
    fleet.decides("nearest")
    robot = fleet.crew.robots[0]
    robot.wait_at, robot.charges = wait_at, charges
    assert fleet.work.watched.tolist() == [watched, False]


def test_times_that_nobody_looked_at_are_passed_over():
    """robot_1 was held; both times count as looks, and the last level is the one that is known."""
    fleet = at_work()
    fleet.crew.looks_s = (0.0, 1.0)
    fleet.work.pass_over((2.0, 3.0), np.array([0.5, 0.4]), np.array([False, True]))
    assert [robot.moved_s for robot in fleet.crew.robots] == [3.0, 0.0] and fleet.crew.looks_s == (2.0, 3.0)
    fleet.work.pass_over((), np.array([0.1, 0.1]), np.zeros(2, np.bool_))
    assert fleet.crew.level.tolist() == [0.5, 0.4] and fleet.crew.looks_s == (2.0, 3.0)
