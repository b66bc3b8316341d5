"""Who is given which task: by hand, on a line, where what robots drive is left out."""

from dataclasses import replace

import numpy as np
import pytest
from floors import driven, ring, scenario
from line_fleets import Fleet
from worlds import graph_of, line

from mrp_sumo.core.execution import BOOKINGS
from mrp_sumo.core.task import Station
from mrp_sumo.drive.dispatchers.estimates import FAR_S, _useful, oldest_first
from mrp_sumo.drive.robot_work import NONE, Change, Leg
from mrp_sumo.drive.work_request import in_turn, work_request
from mrp_sumo.errors import PlugInError, ScenarioError

ALL = ("nearest", "hungarian", "central", "min_cost_flow", "regret", "token_passing", "tpts")
REASSIGN = ("hungarian", "central", "min_cost_flow", "tpts")


@pytest.mark.parametrize("dispatcher", [name for name in ALL if name != "nearest"])
def test_of_more_tasks_than_robots_the_near_one_goes_first_and_only_nearest_takes_the_oldest(dispatcher):
    tasks = [(0.0, (19, 18)), (0.0, (3, 4)), (0.0, (12, 13))]
    assert Fleet([2], *tasks).decides(dispatcher) == {0: 1}
    assert Fleet([2], *tasks).decides("nearest") == {0: 0}


@pytest.mark.parametrize("dispatcher", [*ALL, "round_robin"])
def test_a_task_goes_to_a_robot_of_the_type_that_it_needs_or_waits(dispatcher):
    tasks = [(0.0, (3, 4), 0, "lift"), (0.0, (5, 6), 0, "lift"), (0.0, (19, 18), 0, "")]
    assert Fleet([2, 5], *tasks, types=("cart", "lift")).decides(dispatcher)[0] == 2  # far away, and all that it can do
    assert Fleet([2, 5], *tasks[:2], types=("cart", "lift")).decides(dispatcher) in ({1: 0}, {1: 1})


def test_round_robin_gives_orders_in_turn_to_whoever_is_free():
    """All orders begin beside robot_0; nobody but the one whose turn it is gets them."""
    fleet = Fleet([2, 9, 15], *((5.0 * k, (2, 3)) for k in range(4)), service_s=1000.0)
    assert fleet.decides("round_robin", 0.0) == {0: 0}
    assert fleet.decides("round_robin", 5.0) == {0: 0, 1: 1}
    assert fleet.decides("round_robin", 10.0) == {0: 0, 1: 1, 2: 2}
    fleet.crew.set_free(fleet.crew.robots[1], 12.0)
    fleet.crew.set_free(fleet.crew.robots[0], 14.0)
    assert fleet.decides("round_robin", 15.0) == {0: 3, 2: 2}  # robot_1 is free for longer, but was given its order later
    assert Fleet([2, 9], (0.0, (15, 16)), (0.0, (3, 4))).decides("round_robin") == {0: 0, 1: 1}  # `nearest` would cross over


@pytest.mark.parametrize("dispatcher", ["nearest", "round_robin", "tpts"])
@pytest.mark.parametrize(("stops", "then"), [((12, 3), {}), ((3, 12), {0: 0})])
def test_who_cannot_come_to_the_first_stop_of_an_order_is_not_given_it(dispatcher, stops, then):
    """No lane leads from 9 to 10, beyond which robot_0 is not."""
    xy, lanes = line(20).xy.tolist(), [(k, k + 1) for k in range(19) if k != 9]
    fleet = Fleet([2], (0.0, stops))
    fleet.context.graph = graph_of(xy, lanes)
    assert fleet.decides(dispatcher) == then


@pytest.mark.parametrize("dispatcher", [*ALL, "round_robin", "bundle"])
@pytest.mark.parametrize(
    ("is_lost", "stops", "able"), [(True, (5, 6), {2}), (True, (1, 0), {0}), (True, (4, 3), {0, 2}), (False, (5, 6), {0, 1})]
)
def test_no_order_is_given_to_one_that_a_lost_robot_shuts_in(dispatcher, is_lost, stops, able):
    """On the line robot_1 is at 4, between robot_0 at 2 and 5; robot_2 is far away on the other side. To 4 itself both may come near."""
    fleet = Fleet([2, 4, 19], (0.0, stops))
    if is_lost:
        fleet.crew.robots[1].on(Change.LOST, 0.0)
    (robot,) = fleet.decides(dispatcher)
    assert robot in able


@pytest.mark.parametrize("dispatcher", ["nearest", "hungarian", "round_robin", "tpts"])
def test_who_is_shut_in_gets_an_order_where_others_are_too_few(dispatcher):
    """As before, with an order more than robots on the other side."""
    fleet = Fleet([2, 4, 19], (0.0, (5, 6)), (0.0, (7, 8)))
    fleet.crew.robots[1].on(Change.LOST, 0.0)
    assert sorted(fleet.decides(dispatcher)) == [0, 2]


@pytest.mark.parametrize("dispatcher", ALL)
def test_an_urgent_order_that_a_robot_cannot_do_does_not_keep_it_from_another(dispatcher):
    tasks = [(0.0, (3, 4), 1, "lift"), (0.0, (19, 18))]
    assert Fleet([2], *tasks, types=("cart",)).decides(dispatcher) == {0: 1}


@pytest.mark.parametrize("dispatcher", ALL)
def test_a_task_that_is_bound_to_a_robot_waits_for_it(dispatcher):
    """robot_1 stands beside both tasks, robot_0 is the only one that may do them."""
    tasks = [(0.0, (15, 16), 0, "", 0), (0.0, (15, 16), 0, "", 0), (0.0, (19, 18))]
    assert Fleet([2, 14], *tasks).decides(dispatcher) == {0: 0, 1: 2}
    assert Fleet([2, 14], *tasks[:2], (0.0, (15, 16))).decides(dispatcher) == {0: 0, 1: 2}
    assert Fleet([2, 14], *tasks[:2]).decides(dispatcher) == {0: 0}


def test_a_dispatcher_that_gives_a_task_to_a_robot_of_another_type_is_named():
    fleet = Fleet([2, 15], (0.0, (5, 6)), (0.0, (3, 4), 0, "lift"), types=("cart", "lift"))
    fleet.crew.orders.reveal(0.0)
    with pytest.raises(PlugInError, match="order '' needs a robot of type 'lift', robot_0 is none"):
        work_request(fleet.crew, 0.0, fleet.context.closed, {0: 1})
    fleet = Fleet([2, 15], (0.0, (5, 6), 0, "", 1))
    fleet.crew.orders.reveal(0.0)
    with pytest.raises(PlugInError, match="order '' is for robot_1, not for robot_0"):
        work_request(fleet.crew, 0.0, fleet.context.closed, {0: 0})


def test_a_way_on_is_asked_for_half_a_second_before_a_robot_would_have_to_brake():
    """From 1 m/s it brakes in half a metre."""
    fleet = Fleet([5])
    assert fleet.work._near_m(0) == fleet.crew.settings.planning.budget_s + 0.5 + 0.5


@pytest.mark.parametrize("dispatcher", ALL)
def test_the_urgent_one_goes_before_the_near_one(dispatcher):
    assert Fleet([2], (0.0, (3, 4)), (0.0, (19, 18), 1)).decides(dispatcher) == {0: 1}
    assert Fleet([2], (9.0, (3, 4))).decides(dispatcher) == {}  # nothing is known yet


@pytest.mark.parametrize("dispatcher", [*ALL, "round_robin"])
def test_orders_of_a_crowded_station_are_held_back_and_others_are_given(dispatcher):
    """Robots have 9 steps to drive on average. Beside four in line, one on the way is of use; three where services take no time."""
    crowd = [(0.0, (15, 16))] * 9
    assert len(Fleet([*range(2, 11)], *crowd, service_s=1000.0).decides(dispatcher)) == 5
    assert sorted(Fleet([*range(2, 11)], *crowd, (0.0, (18, 19)), service_s=1000.0).decides(dispatcher).values()) == [*range(5), 9]
    assert len(Fleet([*range(2, 11)], *crowd, service_s=0.0).decides(dispatcher)) == 7
    carts = {"types": ("cart",) * 9, "service_s": 1000.0}
    assert len(Fleet([*range(2, 11)], *[(0.0, (15, 16), 0, "cart")] * 9, **carts).decides(dispatcher)) == 5
    assert len(Fleet([*range(2, 6)], *crowd, service_s=1000.0).decides(dispatcher)) == 4


@pytest.mark.parametrize(("charges", "count"), [(False, 5), (True, 9)])
def test_robots_that_are_bound_for_a_crowded_station_hold_orders_back_unless_they_go_there_to_charge(charges, count):
    """Five of nine orders are given, and as many are enough a second later; the other four robots are free."""
    fleet = Fleet([*range(2, 11)], *[(0.0, (15, 16))] * 9, service_s=1000.0)
    for r in fleet.decides("nearest"):
        fleet.crew.robots[r].charges = charges
    assert len(fleet.decides("nearest", 1.0)) == count


@pytest.mark.parametrize("dispatcher", [*ALL, "round_robin"])
def test_orders_that_wait_for_one_robot_hold_back_nobody_else(dispatcher):
    """Nine older ones at the same station are for robot_0 alone, which is at work on the first of them."""
    fleet = Fleet([*range(2, 11)], *[(0.0, (15, 16), 0, "", 0)] * 9, (0.0, (15, 16)), service_s=1000.0)
    fleet.decides(dispatcher, 0.0)
    assert {0, 9} <= set(fleet.decides(dispatcher, 1.0).values())


@pytest.mark.parametrize("dispatcher", ["hungarian", "min_cost_flow", "regret"])
def test_of_equally_near_tasks_the_short_one_goes_first(dispatcher):
    assert Fleet([5], (0.0, (6, 19)), (0.0, (4, 3))).decides(dispatcher) == {0: 1}


@pytest.mark.parametrize("dispatcher", REASSIGN)
def test_a_robot_that_comes_free_takes_the_task_that_another_is_far_from(dispatcher):
    fleet = Fleet([10, 19], (0.0, (0, 1)), (5.0, (19, 18)))
    assert fleet.decides(dispatcher) == {0: 0}
    fleet.context.start[:] = [9, 3]  # robot_1 has come nearer meanwhile
    assert fleet.decides(dispatcher, 1.0) == {1: 0}
    assert fleet.decides(dispatcher, 5.0) == {0: 1, 1: 0}


@pytest.mark.parametrize("dispatcher", REASSIGN)
@pytest.mark.parametrize(("at", "who_takes"), [(15, ()), (14, ()), (13, REASSIGN)])
def test_a_task_is_taken_from_a_robot_only_by_one_that_is_nearer(dispatcher, at, who_takes):
    """robot_0 is on its way from 5 to 10 when robot_1 comes to `at`; nobody takes it where that saves but a step."""
    fleet = Fleet([5, 19], (0.0, (10, 11)))
    assert fleet.decides(dispatcher) == {0: 0}
    fleet.context.start[1] = at
    assert fleet.decides(dispatcher, 1.0) == {int(dispatcher in who_takes): 0}


@pytest.mark.parametrize("dispatcher", REASSIGN)
@pytest.mark.parametrize(("in_line", "who_takes"), [(False, 1), (True, 0)])
def test_a_task_is_not_taken_from_a_robot_that_waits_in_line_for_its_place(dispatcher, in_line, who_takes):
    fleet = Fleet([5, 19], (0.0, (10, 11)))
    fleet.decides(dispatcher)
    fleet.context.start[1] = 12
    if in_line:
        fleet.crew.robots[0].came_s = 0.5
        fleet.crew.robots[0].on(Change.LINED_UP, 0.5)
    assert fleet.decides(dispatcher, 1.0) == {who_takes: 0}


@pytest.mark.parametrize("dispatcher", ALL)
@pytest.mark.parametrize(("service_s", "shortest_goes"), [((3.0, 3.0, 3.0), 0), ((3.0, 9.0, 3.0), 0), ((9.0, 3.0, 3.0), 1)])
def test_of_tasks_that_are_alike_the_oldest_goes_first_unless_it_takes_longer(dispatcher, service_s, shortest_goes):
    shortest_first = dispatcher in ("hungarian", "min_cost_flow", "regret")
    fleet = Fleet([5], *[(0.0, (4, 6))] * 3, service_s=service_s)
    assert fleet.decides(dispatcher) == {0: shortest_goes if shortest_first else 0}


@pytest.mark.parametrize("dispatcher", ["regret", "hungarian"])
@pytest.mark.parametrize(("places", "then"), [(((6, 7), (4, 3)), {0: 1, 1: 0}), (((4, 3), (6, 7)), {0: 0, 1: 1})])
def test_of_two_orders_a_step_from_one_robot_it_takes_the_one_that_is_farther_from_the_other(dispatcher, places, then):
    """robot_0 is at 5, and robot_1 at 12: 6 steps from one of the orders, 8 from the other."""
    assert Fleet([5, 12], *((0.0, of) for of in places)).decides(dispatcher) == then


@pytest.mark.parametrize(("has", "gets", "then"), [(NONE, 0, {0: 0}), (0, 0, {}), (0, 1, {0: 1}), (1, 0, {0: 0})])
def test_of_an_assignment_that_is_new_is_given_which_a_robot_does_not_have(has, gets, then):
    fleet = Fleet([5], (0.0, (6, 7)), (0.0, (4, 3)))
    fleet.crew.orders.reveal(0.0)
    if has != NONE:
        fleet.crew.orders.assign(has, 0, 0.0)
        fleet.crew.give(fleet.crew.robots[0], has, 0.0, 0.0)
    assert oldest_first({0: gets}, fleet.context) == then


def test_token_passing_avoids_the_ends_of_others_and_as_in_the_paper_waits_for_them():
    tasks = [(0.0, (2, 10)), (0.0, (4, 10)), (0.0, (9, 11))]
    assert Fleet([1, 5], *tasks).decides("token_passing") == {0: 0, 1: 2}
    assert Fleet([1, 5], *tasks[:2]).decides("token_passing") == {0: 0, 1: 1}
    assert Fleet([1, 5], *tasks[:2]).decides("token_passing", exclusive=True) == {0: 0}


def test_token_passing_minds_ends_of_tasks_and_not_what_lies_between():
    tasks = [(0.0, (2, 10)), (0.0, (4, 10, 12)), (0.0, (9, 11))]
    assert Fleet([1, 5], *tasks).decides("token_passing") == {0: 0, 1: 1}  # passes by the end of task 0
    tasks[1] = (0.0, (4, 12, 10))
    assert Fleet([1, 5], *tasks).decides("token_passing") == {0: 0, 1: 2}


@pytest.mark.parametrize(("parameters", "then"), [({}, {0: 0}), ({"busy": False}, {0: 0, 1: 1})])
def test_hungarian_lets_a_task_wait_for_a_robot_at_work_that_will_be_there_sooner(parameters, then):
    fleet = Fleet([3, 19], (0.0, (3, 4)), (1.0, (4, 5)), service_s=5.0)
    assert fleet.decides("hungarian") == {0: 0}
    assert fleet.decides("hungarian", 1.0, **parameters) == then


def test_min_cost_flow_looks_beyond_the_next_task_of_each_robot():
    # three short tasks near robot_0, the oldest far from both
    tasks = [(0.0, (19, 18)), (0.0, (0, 5)), (0.0, (2, 1)), (0.0, (3, 2))]
    assert Fleet([1, 10], *tasks).decides("hungarian") == {0: 2, 1: 3}
    assert Fleet([1, 10], *tasks).decides("min_cost_flow") == {0: 2, 1: 0}
    assert Fleet([1, 10], *tasks).decides("min_cost_flow", depth=1) == {0: 2, 1: 3}


@pytest.mark.parametrize(("most", "left"), [(2, [3, 1, 2]), (3, [3, 1, 2, 0])])
def test_the_least_urgent_tasks_are_left_out_and_those_of_one_priority_are_taken_together(most, left):
    """Of the priorities 2, 1, 1 and 0, two are too few for the second 1, which comes along, three bring the 0."""
    tasks = [(0.0, (3, 4)), (0.0, (5, 6), 1), (0.0, (7, 8), 1), (0.0, (9, 8), 2)]
    assert Fleet([2], *tasks).choice(most=most).task == left


@pytest.mark.parametrize(("robot_type", "left"), [("cart", [2, 1, 0]), ("", [2, 1])])
def test_nothing_is_left_out_where_a_task_needs_a_type_of_robot(robot_type, left):
    """What is left out might be all that some robot can do."""
    tasks = [(0.0, (3, 4)), (0.0, (5, 6), 1), (0.0, (7, 8), 2, robot_type)]
    assert Fleet([2], *tasks, types=("cart",)).choice(most=1).task == left


def test_a_task_takes_its_services_from_the_first_on_and_the_ways_between_them():
    fleet = Fleet([2], (0.0, (3,)), (0.0, (3, 7)), (0.0, (3, 7, 5)), service_s=10.0)
    assert fleet.choice().rest_s.tolist() == [10.0, 24.0, 36.0]
    assert fleet.choice().pick_up_s.tolist() == [[1.0] * 3]
    assert fleet.choice().between_s.tolist() == pytest.approx([(0 + 4 + 2) / 3] * 3)  # from 3, 7 and 5 to 3


@pytest.mark.parametrize(("at", "remaining_s"), [(3, 10 + 5 + 10), (0, 3 + 10 + 5 + 10)])
def test_a_robot_at_work_is_ready_when_its_services_are_over_and_the_one_under_way_counts_once(at, remaining_s):
    """Stops at 3 and 8, 10 s each: in service for 4 s, or still on the way there. Others in the way cost half as much again."""
    fleet = Fleet([at], (0.0, (3, 8)), (0.0, (10, 11)), service_s=10.0)
    fleet.decides("nearest")
    assert bool(fleet.crew.serving[0]) == (at == 3)
    now_s = 4.0 if at == 3 else 0.0
    left = fleet.choice(now_s, busy=True)
    assert left.able.tolist() == [] and left.task == [1]
    assert left.ready_s.tolist() == pytest.approx([1.5 * (remaining_s - now_s)])
    assert left.pick_up_s.tolist() == [pytest.approx([1.5 * (remaining_s - now_s) + 2])]  # from 8 to 10
    assert fleet.choice(now_s).ready_s.tolist() == [FAR_S]


@pytest.mark.parametrize("dispatcher", REASSIGN)
def test_a_robot_that_is_lost_before_it_has_ever_had_a_task_is_given_none(tmp_path, dispatcher):
    what = {"disturbances": {"breakdowns": [{"robot": 0, "begin_s": 1.0}]}, "dispatcher": dispatcher, "time_limit_s": 120.0}
    tasks = [{"name": "late", "stops": ["A"], "release_s": 20.0}]
    alone, both = (driven(scenario(ring(tmp_path), tasks, starts=starts, execution=what)) for starts in (["c4"], ["c4", "c1"]))
    assert alone.status == "stalled" and alone.execution.tasks.status == ("released",)
    assert both.status == "completed" and both.execution.tasks.robot.tolist() == [1]


@pytest.mark.parametrize(("num_legs", "then"), [(1, NONE), (2, 1)], ids=("on the way to its first stop", "to both"))
def test_who_is_about_to_come_to_a_stop_takes_another_order_only_behind_its_last_one(num_legs, then):
    """It was to swap orders, but comes to its first stop before the answer is there."""
    fleet = Fleet([2], (0.0, (3, 19)), (0.0, (5, 6)), service_s=0.0)
    assert fleet.decides("nearest") == {0: 0}
    robot = fleet.crew.robots[0]
    swap = work_request(fleet.crew, 0.0, fleet.context.closed, {0: 1})
    robot.leaves, robot.legs = True, [Leg(0, 0, 3), Leg(0, 1, 19)][:num_legs]
    fleet.work.accepted(swap, 3.0)
    assert (robot.task, robot.then) == (0, then)


@pytest.mark.parametrize(("in_line", "order"), [(True, [1, 0]), (False, [0, 1])])
def test_who_is_in_line_on_the_way_of_one_that_waits_for_longer_comes_first_and_who_comes_later_lets_it_pass(in_line, order):
    """robot_0 waits at 0 for the place 4 when robot_1 sets out for it, which is at 3 then and can get out of the way, to 5 beside 2."""
    graph = graph_of([(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (2, 1)], [(0, 1), (1, 2), (2, 3), (3, 4), (2, 5)])
    crew = Fleet([0, 3], (0.0, (4,)), (0.0, (4,)), graph=graph).crew
    crew.orders.reveal(0.0)
    for r, sets_out_s in enumerate((0.0, 5.0)):
        crew.orders.assign(r, r, sets_out_s)
        crew.give(crew.robots[r], r, sets_out_s, sets_out_s)
    for robot, came_s in ((0, 1.0), (1, 6.0))[: 1 + in_line]:
        crew.robots[robot].came_s = came_s
        crew.robots[robot].on(Change.LINED_UP, came_s)
    stops = {r: crew.tasks[r].stops[0] for r in (0, 1)}
    assert in_turn(crew, np.array([0, 3]), stops, {0: 0, 1: 1}, np.zeros(2, np.bool_), ()) == order


def test_who_waits_at_a_place_is_served_when_it_is_given_it_not_before():
    fleet = Fleet([3], (0.0, (3, 4)))
    fleet.crew.orders.reveal(0.0)
    robot = fleet.crew.robots[0]
    fleet.crew.orders.assign(0, 0, 0.0)
    fleet.crew.give(robot, 0, 0.0, 0.0)
    robot.wait_at = 3  # though it is free, as when another was to come there
    fleet.work.accepted(work_request(fleet.crew, 6.0, fleet.context.closed, {}), 7.0)
    assert robot.making.begin_s == 7.0


@pytest.mark.parametrize(("is_free", "wait_at"), [(False, 4), (True, NONE)])
def test_who_has_no_order_any_more_when_the_answer_comes_waits_for_no_place(is_free, wait_at):
    fleet = Fleet([3], (0.0, (6, 7)))
    fleet.crew.orders.reveal(0.0)
    robot = fleet.crew.robots[0]
    fleet.crew.orders.assign(0, 0, 0.0)
    fleet.crew.give(robot, 0, 0.0, 0.0)
    request = replace(work_request(fleet.crew, 0.0, fleet.context.closed, {}), waits={0: 4})
    if is_free:
        fleet.crew.set_free(robot, 0.5)
    fleet.work.accepted(request, 1.0)
    assert robot.wait_at == wait_at


def test_a_robot_that_waits_for_a_place_is_not_there_though_it_makes_a_stop_where_it_is():
    """robot_0 makes its first stop in passing, at 3 where it stands, and robot_1 is before it at 5; robot_1 is there."""
    fleet = Fleet([3, 5], (0.0, (3, 5)), (0.0, (5,)), service_s=(1.0, 7.0))
    crew = fleet.crew
    crew.orders.reveal(0.0)
    crew.ahead_steps, (first, last) = 9, crew.tasks[0].stops
    crew.tasks[0] = replace(crew.tasks[0], stops=(replace(first, service_s=0.0), last))
    request = work_request(crew, 0.0, fleet.context.closed, {0: 0, 1: 1})
    assert [leg.vertex for leg in request.legs[0]] == [3] and list(request.waits) == [0] and request.there_s == {1: 7.0}


@pytest.mark.parametrize(("spent_on", "stood_s"), [("dependency_wait", 7.0), ("yielding", 0.0), ("moving", 0.0)])
def test_who_gives_way_drives_and_does_not_stand(spent_on, stood_s):
    fleet = Fleet([3], (0.0, (3, 4)))
    crew, robot = fleet.crew, fleet.crew.robots[0]
    crew.orders.reveal(0.0)
    crew.orders.assign(0, 0, 0.0)
    crew.give(robot, 0, 0.0, 0.0)
    fleet.state.waits.booked_s[0, BOOKINGS.index(spent_on)] += 7.0
    fleet.visits.arrived_s[0] = 10.0
    fleet.work.accepted(work_request(crew, 10.0, fleet.context.closed, {}), 10.0)
    assert robot.making.begin_s == 10.0 and robot.making.stood_s == stood_s


@pytest.mark.parametrize(
    ("over_s", "released_s", "since_s", "earliest_s"), [(1.5, 0.0, 1.5, 1.5), (1.5, 1.75, 1.75, 1.75), (1.0, 0.0, 2.0, 5.0)]
)
def test_who_has_just_been_served_has_its_order_since_then_and_others_since_it_was_asked_for(over_s, released_s, since_s, earliest_s):
    """The looks before were at 1 s and 2 s, and the answer is there at 5 s, before which nobody else is served."""
    fleet = Fleet([3], (released_s, (6, 7)))
    fleet.crew.orders.reveal(2.0)
    robot, fleet.crew.looks_s = fleet.crew.robots[0], (1.0, 2.0)
    robot.over_s = over_s
    fleet.work.accepted(work_request(fleet.crew, 2.0, fleet.context.closed, {0: 0}), 5.0)
    assert (fleet.crew.orders.assigned_s(0), robot.since_s, robot.earliest_s) == (since_s, since_s, earliest_s)


@pytest.mark.parametrize(
    ("at", "capacity", "is_changed"),
    [([3], 1, False), ([3], 2, True), ([2], 1, True), ([3, 8], 1, True)],
    ids=("in service", "with room for more", "on the way to its first stop", "another is free"),
)
def test_an_order_that_comes_while_nobody_could_take_it_changes_nothing(at, capacity, is_changed):
    fleet = Fleet(at, (0.0, (3, 7), 0, "", 0), (5.0, (9,)), service_s=10.0)
    fleet.crew.problem = replace(fleet.crew.problem, fleet=replace(fleet.crew.problem.fleet, capacity=np.full(len(at), capacity)))
    fleet.work.update(0.0)
    assert fleet.decides("nearest") == {0: 0}
    fleet.work.update(5.0)
    assert fleet.crew.unassigned == [1] and fleet.crew.is_changed == is_changed


@pytest.mark.parametrize(("on_m", "speed_mps", "wake_s"), [(0.0, 1.0, 12.0), (1.5, 0.5, 10.5), (3.5, 1.0, 9.0 + 1e-6), (0.0, 0.0, np.inf)])
def test_who_goes_to_a_stop_in_passing_is_looked_at_again_when_it_may_be_near(on_m, speed_mps, wake_s):
    """It is 9 s now; the stop is 4 m ahead, near is 1 m, and at most it drives 1 m/s; one that stands is looked at when it goes on."""
    fleet = Fleet([5], (0.0, (9,)), service_s=0.0)
    fleet.decides("nearest")
    fleet.visits.vertex, fleet.visits.at_m = np.array([9]), np.array([4.0])
    fleet.state.motion.s_m[0], fleet.state.motion.speed_mps[0] = on_m, speed_mps
    assert fleet.work._next_change_s(9.0) == pytest.approx(wake_s, abs=1e-9)


@pytest.mark.parametrize(
    ("cancelled", "task", "then", "waits"),
    [(0, NONE, NONE, [1, 2]), (1, 0, NONE, [2]), (2, 0, 1, [])],
    ids=("its own", "the next", "nobody's"),
)
def test_a_robot_whose_order_is_withdrawn_goes_on_with_no_other_and_the_next_one_waits_again(cancelled, task, then, waits):
    """robot_1, the last of the two, comes to the stop of order 0 and has been given order 1."""
    fleet = Fleet([12, 2], (0.0, (3,), 0, "", 1), (0.0, (5, 6)), (0.0, (7, 8)), service_s=0.0)
    crew, robot = fleet.crew, fleet.crew.robots[1]
    crew.orders.reveal(0.0)
    crew.orders.assign(0, 1, 0.0)
    crew.give(robot, 0, 0.0, 0.0)
    crew.orders.assign(1, 1, 0.0)
    robot.then, crew.is_changed = 1, False
    crew.cancel(cancelled, "late")
    assert (robot.task, robot.then, crew.unassigned, crew.is_changed) == (task, then, waits, True)


@pytest.mark.parametrize(("goes_on", "near"), [(False, {1, 2, 4, 5}), (True, {1, 2, 5, 6})])
def test_a_load_is_fetched_beside_where_a_robot_that_is_lost_stands_or_between_there_and_the_next_vertex(goes_on, near):
    """It came to 3, and may be on the lane to 4; robot_1, the visits of which come last, is far away."""
    fleet = Fleet([3, 15], (0.0, (9,)))
    if goes_on:
        fleet.visits.vertex, fleet.visits.next = np.array([3, 4, 15]), np.array([1, -1, -1])
    fleet.crew.orders.reveal(0.0)
    fetch = fleet.crew._place_to_hand_over(0, replace(fleet.crew.tasks[0].stops[0], service_s=7.0))
    assert set(fetch.station.places) == near and fetch.service_s == 7.0


@pytest.mark.parametrize(
    ("at", "assigned", "comes"),
    [([5, 6], {1: 0}, [True, True]), ([3, 6], {1: 0}, [False, True]), ([4, 5], {1: 0, 0: 1}, [False, True])],
    ids=("makes room", "stays", "waits there, and is served there"),
)
def test_who_goes_elsewhere_or_is_served_where_it_stands_has_a_heading_there(at, assigned, comes):
    """robot_1 is to be served at 5."""
    fleet = Fleet(at, (0.0, (5,)), (0.0, (5,)))
    fleet.crew.orders.reveal(0.0)
    fleet.crew.end_heading_rad = lambda robots, end, comes: comes
    assert work_request(fleet.crew, 0.0, fleet.context.closed, assigned).end_heading_rad.tolist() == comes


def test_a_row_of_orders_holds_one_at_least():
    with pytest.raises(ScenarioError, match="depth is 0, expected 1 or more"):
        Fleet([2], (0.0, (3, 4))).decides("min_cost_flow", depth=0)
    assert Fleet([2], (0.0, (3, 4))).decides("min_cost_flow", depth=1) == {0: 0}


def test_a_robot_whose_order_is_taken_has_the_token_next():
    """robot_1 comes free beside the order of robot_0, and takes it; robot_0 the other one, before robot_2, which is a step nearer."""
    fleet = Fleet([5, 19, 18], (0.0, (10, 11)), (1.0, (0, 1)))
    assert fleet.decides("tpts") == {0: 0}
    fleet.context.start[:] = [6, 9, 5]
    assert fleet.decides("tpts", 1.0) == {1: 0, 0: 1}


@pytest.mark.parametrize(("nth", "useful"), [(0, 2 * (4 + 2 / 5)), (1, 2 * (4 + (2 + 1 + 9) / 5))])
def test_as_many_robots_are_of_use_to_a_stop_as_stand_in_line_and_come_while_one_drives_there(nth, useful):
    """The robot is 2 s from the first place of the first stop, 9 s before that of the second; services take 1 s, exchanges 4 s."""
    fleet = Fleet([1], (0.0, (3, 12)))
    fleet.crew.orders.reveal(0.0)
    (task,) = fleet.crew.tasks
    stops = tuple(replace(stop, station=Station("S", places)) for stop, places in zip(task.stops, ((3, 5), (12, 17))))
    fleet.crew.orders.tasks[0] = replace(task, stops=stops)
    assert _useful(fleet.context, 0, nth) == pytest.approx(useful)
