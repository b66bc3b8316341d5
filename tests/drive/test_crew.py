"""What becomes of orders and of the robots that have them, by hand on a line, where what robots drive is left out."""

from dataclasses import replace

import numpy as np
import pytest
from line_fleets import Fleet

from mrp_sumo.core.order_rules import Cancel, Retry
from mrp_sumo.core.stream import ClosedLoop, TaskList
from mrp_sumo.core.task import ASSIGNED, CANCELLED, DONE, FAILED, HANDED_OVER, NOBODY, PICKED, RELEASED, Station, Stop, Task
from mrp_sumo.drive.orders import Orders
from mrp_sumo.drive.robot_work import NONE, Change, Leg, RobotWork, state_log
from mrp_sumo.drive.work_request import _may_take, take_over, work_request


def row(begin_s, end_s):
    """A service of robot_0 in a fleet with one order to 3, where it stands."""
    fleet = Fleet([3], (0.0, (3, 7)))
    fleet.crew.orders.reveal(0.0)
    fleet.crew.orders.assign(0, 0, 0.0)
    fleet.crew.give(fleet.crew.robots[0], 0, 0.0, 0.0)
    fleet.crew.robots[0].making = fleet.crew._row(fleet.crew.robots[0], 0, (begin_s, end_s), begin_s)
    return fleet.crew, fleet.crew.robots[0]


@pytest.mark.parametrize(
    ("now_s", "until_s", "span_s"),
    [(10.0, 30.0, (10.0, 36.0)), (12.0, 30.0, (10.0, 34.0)), (9.0, 30.0, (30.0, 36.0)), (5.0, 8.0, (10.0, 16.0))],
)
def test_a_service_of_a_broken_robot_lasts_longer_or_begins_later(now_s, until_s, span_s):
    """It was to last from 10 s to 16 s."""
    crew, robot = row(10.0, 16.0)
    crew.put_off(robot, now_s, until_s)
    assert (robot.making.begin_s, robot.making.end_s) == span_s


@pytest.mark.parametrize(("now_s", "made"), [(9.9, False), (10.0, True)])
def test_a_service_that_has_not_begun_at_the_end_of_a_run_never_will(now_s, made):
    crew, robot = row(10.0, 16.0)
    crew.close(now_s)
    assert (robot.making is not None) == made


@pytest.mark.parametrize(
    ("priorities", "since_s", "places", "line_up", "num_before"),
    [
        ((0, 0), (5.0, 4.0), ((3,), (3,)), False, 1),
        ((0, 0), (5.0, 4.0), ((3,), (3,)), True, 1),
        ((0, 0), (4.0, 4.0), ((3,), (3,)), False, 0),  # who is served did not set out later
        ((1, 0), (5.0, 4.0), ((3,), (3,)), False, 0),  # it is more urgent
        ((0, 1), (5.0, 4.0), ((3,), (3,)), False, 1),
        ((0, 0), (5.0, 4.0), ((3,), (8,)), False, 0),  # for another stop
    ],
)
def test_who_set_out_before_one_that_is_served_at_its_stop_is_passed_over(priorities, since_s, places, line_up, num_before):
    fleet = Fleet([3, 12], *((0.0, of, priority, "", r) for r, (of, priority) in enumerate(zip(places, priorities))), service_s=9.0)
    crew = fleet.crew
    crew.orders.reveal(0.0)
    for r, set_out_s in enumerate(since_s):
        crew.orders.assign(r, r, set_out_s)
        crew.give(crew.robots[r], r, set_out_s, set_out_s)
    if line_up:
        crew.robots[1].on(Change.LINED_UP, 6.0)
    crew.robots[0].legs = [Leg(0, 0, 3)]
    crew.follow(crew.robots[0], 7.0)
    assert crew.robots[0].making is not None and crew.robots[1].num_before == num_before and crew.robots[0].num_before == 0


@pytest.mark.parametrize(
    ("rules", "due_s", "last_s"),
    [
        (None, 50.0, np.inf),
        ({"overdue": True}, 50.0, 50.0),
        ({"after_s": 30.0}, 50.0, 35.0),
        ({"overdue": True, "after_s": 30.0}, 50.0, 35.0),
        ({"overdue": True, "after_s": 90.0}, 50.0, 50.0),
    ],
)
def test_the_last_chance_of_an_order_is_when_it_is_due_or_some_time_after_it_came(rules, due_s, last_s):
    orders = Orders((TaskList((order(5.0, due_s=due_s),)),), Cancel(**rules) if rules else None)
    assert orders.reveal(4.9) == [] and orders.reveal(5.0) == [0]
    assert orders.last_chance_s(0) == last_s and orders.not_picked == ([0] if rules else [])
    orders.assign(0, 3, 6.0)
    assert orders.not_picked == ([0] if rules else [])
    orders.pick(0, 7.0)
    assert orders.not_picked == [] and orders.opened_s(0) == 7.0


def order(release_s, **other):
    return Task(0, (Stop(3, 1.0, "", Station("S", (3,))),), release_s, **other)


def test_orders_that_are_added_become_known_by_their_times():
    orders = Orders((TaskList((order(5.0, name="a"), order(20.0, name="c"))),))
    orders.reveal(5.0)
    orders.add(order(10.0, name="b"))
    assert orders.next_release_s == 10.0 and orders.endless
    orders.reveal(30.0)
    assert [task.name for task in orders.tasks] == ["a", "b", "c"] and [task.id for task in orders.tasks] == [0, 1, 2]
    assert orders.next_release_s == np.inf and not orders.endless and orders.num_open == 3 and orders.open_since_s == 5.0
    orders.assign(0, 0, 31.0)
    orders.fail(0, 32.0, "lost")
    assert orders.num_open == 2 and orders.open_since_s == 10.0 and orders.log().reason == ("lost", "", "")


def test_what_is_done_of_an_order_is_kept_when_it_is_handed_over_and_not_when_it_is_begun_anew():
    orders = Orders((TaskList(tuple(order(0.0) for _ in range(3))),))
    orders.reveal(0.0)
    for k in range(3):
        orders.assign(k, 7, 1.0)
        orders.pick(k, 2.0)
    orders.begin_anew(0, "lost")
    orders.hand_over(1, (order(0.0).stops[0],) * 2, "lost")
    assert orders.status == [RELEASED, HANDED_OVER, PICKED] and orders.waiting == [0, 1] and orders.robot == [NOBODY, NOBODY, 7]
    assert [orders.opened_s(k) for k in range(3)] == pytest.approx([np.nan, 2.0, 2.0], nan_ok=True) and orders.tries == [1, 0, 0]
    for k in range(2):
        orders.assign(k, 8, 3.0)
        orders.take_back(k)
    assert orders.status == [RELEASED, HANDED_OVER, PICKED] and np.isnan(orders.assigned_s(1)) and orders.opened_s(1) == 2.0
    orders.assign(1, 8, 4.0)
    orders.pick(1, 5.0)
    assert orders.opened_s(1) == 2.0  # since it was first begun
    orders.finish(2, 6.0)
    assert orders.log().done_s.tolist() == pytest.approx([np.nan, np.nan, 6.0], nan_ok=True)
    assert orders.log().ended_s.tolist() == pytest.approx([np.nan, np.nan, 6.0], nan_ok=True) and orders.status[2] == DONE


@pytest.mark.parametrize(
    ("retry", "tries", "status", "kind"),
    [
        (None, 0, FAILED, "failed"),
        (Retry(times=1), 0, RELEASED, "begun_anew"),
        (Retry(times=1), 1, FAILED, "failed"),
        (Retry(hand_over=True), 0, HANDED_OVER, "handed_over"),
    ],
)
def test_a_load_on_a_robot_that_is_lost_fails_or_is_begun_anew_or_handed_over(retry, tries, status, kind):
    fleet = Fleet([3, 12], (0.0, (3, 7), 0, "", 0), (0.0, (5,)))
    crew, robot = fleet.crew, fleet.crew.robots[0]
    crew.settings = replace(crew.settings, retry=retry)
    crew.orders.reveal(0.0)
    for k in (0, 1):
        crew.orders.assign(k, 0, 0.0)
    crew.orders.pick(0, 1.0)
    robot.begin([(0, 1), (1, 0)], 0.0, 0.0, (0.0, 0.0), charges=False)
    crew.orders.tries[0] = tries
    crew.lose(robot, 9.0, Change.LOST)
    # order 1 has not been begun; order 0 is robot_0's alone, so that nobody is left to begin it anew
    anew = [] if status != RELEASED else ["failed"]
    assert [event.kind for event in crew.drain()] == [kind, *anew, *(["failed"] if status == HANDED_OVER else [])]
    assert crew.orders.status[1] == RELEASED and 1 in crew.unassigned and robot.task == NONE and crew.is_changed


@pytest.mark.parametrize(
    ("what", "may"),
    [
        ("free", True),
        ("broken", False),
        ("called", False),
        ("has begun", False),
        ("on its way", True),
        ("order is taken", False),
        ("order is on another's way", True),
        ("order is begun by another", False),
    ],
)
def test_an_order_may_be_given_as_long_as_neither_it_nor_the_robot_has_begun_another(what, may):
    fleet = Fleet([3, 12], (0.0, (6,)), (0.0, (3, 9)))
    crew, robot, other = fleet.crew, *fleet.crew.robots
    crew.orders.reveal(0.0)
    if what == "broken":
        robot.on(Change.BREAKS, 0.0)
    robot.is_called = what == "called"
    if what in ("has begun", "on its way"):
        crew.orders.assign(1, 0, 0.0)
        crew.give(robot, 1, 0.0, 0.0)
        robot.tour = robot.tour[what == "has begun" :]
    if what.startswith("order"):
        crew.orders.assign(0, 1, 0.0)
        crew.give(other, 0, 0.0, 0.0)
        other.leaves = what == "order is taken"
        if what == "order is begun by another":
            other.on(Change.SERVED, 0.0)
            other.making = "a stop"
    assert _may_take(crew, robot, 0) == may


def test_an_order_that_is_given_to_another_leaves_its_robot_free_and_one_that_came_to_nothing_is_decided_again():
    """robot_1 takes order 0 from robot_0; it was to have order 1, too, but has begun another when the answer is there."""
    fleet = Fleet([3, 12], (0.0, (6,)), (0.0, (9,)))
    crew = fleet.crew
    assert fleet.decides("nearest") == {0: 0, 1: 1}
    swap = work_request(crew, 1.0, fleet.context.closed, {1: 0})
    take_over(crew, swap, 2.0)
    assert [robot.task for robot in crew.robots] == [NONE, 0] and crew.unassigned == [1] and crew.is_changed
    assert crew.orders.status == [ASSIGNED, RELEASED] and crew.orders.assigned_s(0) == 1.0
    late = work_request(crew, 3.0, fleet.context.closed, {0: 1})
    crew.cancel(1, "late")
    crew.is_changed = False
    take_over(crew, late, 4.0)
    assert crew.robots[0].task == NONE and crew.is_changed and crew.orders.status[1] == CANCELLED


def test_the_log_of_a_robot_has_each_state_once_and_none_that_took_no_time():
    robots = [RobotWork(0), RobotWork(1)]
    robots[0].begin([(4, 0)], 5.0, 5.0, (0.0, 0.0), charges=False)
    robots[0].on(Change.SERVED, 7.0)  # works as before
    robots[0].drop(Change.FREED, 9.0)
    robots[0].begin([(6, 0)], 9.0, 9.0, (0.0, 0.0), charges=False)
    log = state_log(robots, 12.0)
    assert log.robot.tolist() == [0, 0, 0, 1] and log.task.tolist() == [NONE, 4, 6, NONE]
    assert log.begin_s.tolist() == [0.0, 5.0, 9.0, 0.0] and log.end_s.tolist() == [5.0, 9.0, 12.0, 12.0]


@pytest.mark.parametrize(("num_open", "known"), [(1, [0]), (2, [0, 1])])
def test_in_a_closed_loop_the_next_order_comes_when_one_has_ended(num_open, known):
    orders = Orders((ClosedLoop((TaskList(tuple(order(9.0, due_s=59.0) for _ in range(3))),), num_open),))
    assert orders.reveal(4.0) == known and orders.next_release_s == np.inf
    assert [(task.release_s, task.due_s) for task in orders.tasks] == [(4.0, 54.0)] * len(known)
    assert orders.reveal(5.0) == []
    orders.assign(0, 0, 5.0)
    orders.cancel(0, 5.0, "late") if num_open == 1 else orders.fail(0, 5.0, "lost")
    assert orders.reveal(6.0) == [len(known)]


@pytest.mark.parametrize(
    ("set_down", "not_for_pickup", "not_for_setting_down"),
    [({}, set(), set()), ({5: 1}, {6}, {5}), ({5: 1, 6: 1}, set(), {5, 6}), ({9: 1}, set(), set())],
)
def test_loads_are_picked_up_where_there_are_some_and_set_down_where_there_is_room(set_down, not_for_pickup, not_for_setting_down):
    """At a station with the places 5 and 6, which hold a load each; with none there, they may come from elsewhere."""
    fleet = Fleet([2], (0.0, (3, 3)))
    crew = fleet.crew
    crew.orders.reveal(0.0)
    station = Station("rack", (5, 6), holds=1)
    crew.orders.tasks[0] = replace(crew.tasks[0], stops=tuple(replace(stop, station=station) for stop in crew.tasks[0].stops))
    crew.set_down = set_down
    assert (crew.not_free(0, 0), crew.not_free(0, 1)) == (not_for_pickup, not_for_setting_down)
