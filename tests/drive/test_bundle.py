"""Several orders on a robot: whose tour an order goes into by hand, on a line, and what is driven, judged by the audit of the work."""

from dataclasses import replace

import numpy as np
import pytest
from floors import BATTERY, driven, lanes, ring, scenario
from line_fleets import Fleet

from mrp_sumo.core.robot_states import ROBOT_STATES
from mrp_sumo.drive.crew import STANDS
from mrp_sumo.drive.dispatchers.bundle import tours
from mrp_sumo.drive.robot_work import NONE
from mrp_sumo.drive.work_request import work_request
from mrp_sumo.errors import PlugInError
from mrp_sumo.experiments.audit_work import logs_of
from mrp_sumo.metrics.operations.audit import operations_audit

ORDERS = {"streams": [{"name": "o", "stops": ["A", "B"], "service": [5, 3], "arrivals": {"rate_per_h": 200}, "count": 12}]}


def block(folder):
    """Nine crossings, 5 m apart, with lanes both ways: who stands on one can be passed."""
    xy = {f"c{x}{y}": (5.0 * x, 5.0 * y) for x in range(3) for y in range(3)}
    pairs = [(f"c{x}{y}", f"c{x + a}{y + b}") for x in range(3) for y in range(3) for a, b in ((1, 0), (0, 1)) if max(x + a, y + b) < 3]
    return lanes(folder / "block.csv", xy, pairs, True)


def fleet_with_room(at, *orders, capacity=2, **other):
    """Robots at vertices of the line that can have so many orders on board."""
    fleet = Fleet(at, *orders, **other)
    problem = fleet.context.ledger.problem
    fleet.context.ledger.problem = replace(problem, fleet=replace(problem.fleet, capacity=np.full(len(at), capacity)))
    fleet.crew.problem = fleet.context.ledger.problem
    return fleet


def bundles(at, *orders, most=30, **other):
    """The stops ahead of robots, once they have been given the orders."""
    fleet = fleet_with_room(at, *orders, **other)
    fleet.crew.orders.reveal(0.0)
    return tours(fleet.context, 0.0, most)


def carried(tmp_path, tasks=ORDERS, floor=ring, capacity=3, **other):
    """A run of two robots under `bundle`; the audits find nothing."""
    dispatcher = {"dispatcher": "bundle", "time_limit_s": 900.0, **other.pop("execution", {})}
    shape = {"capacity": capacity, **other.pop("shape", {})}
    result = driven(scenario(floor(tmp_path), tasks, robots=2, shape=shape, execution=dispatcher, **other))
    assert result.status == "completed" and result.audit["passed"] and result.operations_audit["passed"], result.note
    return result


def test_orders_on_the_way_go_on_board_together():
    # 3 to 10 and 5 to 12, from 0: one after the other would drive from 10 back to 5
    assert bundles([0], (0.0, (3, 10)), (0.0, (5, 12))) == {0: [(0, 0), (1, 0), (0, 1), (1, 1)]}


@pytest.mark.parametrize(("other_at", "taken_by"), [(19, 0), (6, 1)])
def test_what_an_order_delays_counts_and_not_what_a_robot_has_to_do_anyway(other_at, taken_by):
    """robot_0 is to go from 3 to 10 and passes 4 on its way: both orders together take 9 s more. robot_1 takes 19 s, or 6."""
    fleet = fleet_with_room([0, other_at], (0.0, (3, 10), 0, "", 0), (1.0, (3, 4)))
    assert fleet.decides("bundle") == {0: 0}
    fleet.crew.orders.reveal(1.0)
    assert list(tours(fleet.context, 1.0, 30)) == [taken_by]


@pytest.mark.parametrize(
    ("leaves", "at", "then"),
    [
        (True, [3, 8], {0: [(1, 0), (1, 1), (0, 1)]}),
        (False, [3, 15], {1: [(1, 0), (1, 1)]}),
        (False, [3, 17], {0: [(0, 0), (1, 0), (1, 1), (0, 1)]}),
    ],
)
def test_an_order_comes_after_the_service_that_is_being_made_unless_that_will_be_over(leaves, at, then):
    """robot_0 is served at 3 for 11 s more, and would do the new order, from 4 to 5, 2 s later; robot_1 takes 5, 12 or 14 s."""
    fleet = fleet_with_room(at, (0.0, (3, 10), 0, "", 0), (1.0, (4, 5)), service_s=(12.0, 0.0))
    assert fleet.decides("bundle") == {0: 0} and fleet.crew.serving[0]
    fleet.crew.robots[0].leaves = leaves
    fleet.crew.orders.reveal(1.0)
    assert tours(fleet.context, 1.0, 30) == then


def test_a_robot_that_carries_one_is_given_one():
    assert bundles([0], (0.0, (3, 10)), (0.0, (5, 12)), capacity=1) == {0: [(0, 0), (0, 1)]}


@pytest.mark.parametrize(("capacity", "tour"), [(2, [0, 1]), (3, [2, 0, 1])])
def test_a_robot_is_given_as_many_orders_of_one_stop_as_it_has_room_for(capacity, tour):
    """The oldest first, and each where it makes the others late the least."""
    assert bundles([0], (0.0, (3,)), (0.0, (5,)), (0.0, (2,)), capacity=capacity) == {0: [(task, 0) for task in tour]}


@pytest.mark.parametrize(("then", "who"), [(NONE, [0]), (1, [])])
def test_who_has_its_next_order_already_is_given_no_third(then, who):
    fleet = fleet_with_room([2], (0.0, (3, 10), 0, "", 0), (0.0, (19, 18)), (0.0, (4, 5)))
    fleet.crew.orders.reveal(0.0)
    robot = fleet.crew.robots[0]
    for task in (0, 1)[: 1 + (then != NONE)]:
        fleet.crew.orders.assign(task, 0, 0.0)
    fleet.crew.give(robot, 0, 0.0, 0.0)
    robot.then = then
    assert list(tours(fleet.context, 0.0, 30)) == who


def test_orders_the_other_way_are_done_one_after_the_other():
    # from 10: to 12 and back from 8 to 2; with both on board the first would wait for the way to 8 and back
    (tour,) = bundles([10], (0.0, (11, 13)), (0.0, (8, 2))).values()
    assert tour in ([(0, 0), (0, 1), (1, 0), (1, 1)], [(1, 0), (1, 1), (0, 0), (0, 1)])


def test_a_free_robot_nearby_takes_what_would_delay_the_other():
    assert bundles([0, 18], (0.0, (1, 3)), (0.0, (17, 15))) == {0: [(0, 0), (0, 1)], 1: [(1, 0), (1, 1)]}


def test_urgent_orders_are_inserted_first_and_no_more_than_were_looked_at():
    orders = (0.0, (3, 10)), (0.0, (5, 12), 1)
    assert bundles([0], *orders, most=1) == {0: [(1, 0), (1, 1)]}


def test_an_order_that_nobody_can_do_waits():
    assert bundles([0], (0.0, (3, 10), 0, "lift"), types=("cart",)) == {}


def test_robots_carry_several_and_never_more_than_they_can(tmp_path):
    run = carried(tmp_path).execution
    assert run.loads.max() == 3 and set(run.tasks.status) == {"done"}
    assert carried(tmp_path, capacity=2).execution.loads.max() == 2
    one = carried(tmp_path, capacity=1).execution
    assert one.loads is None and set(one.tasks.status) == {"done"}


def test_bundling_saves_way(tmp_path):
    """Twelve loads round the ring of 40 m: three at a time take a third of the laps, but for the first and the last."""
    three, one = (carried(tmp_path, capacity=capacity).metrics["distance_per_order_m"] for capacity in (3, 1))
    assert three < 0.6 * one


def test_limits_with_a_load_hold_as_long_as_there_is_one(tmp_path):
    run = carried(tmp_path, shape={"loaded": {"speed_mps": 0.5}}).execution
    assert run.speed_mps[run.loads == 0].max() == pytest.approx(1.0) and run.speed_mps[run.loads > 0].max() == pytest.approx(0.5)


@pytest.mark.parametrize("breaks", [{"robot": 0, "begin_s": 45.0, "duration_s": 40.0}, {"robot": 0, "begin_s": 45.0}])
def test_orders_of_a_robot_that_breaks_down_are_done_by_it_or_by_another(tmp_path, breaks):
    """Beside the ring, so that the other can pass: what is on board is fetched from there, what is not begun goes back."""
    tasks = {
        "streams": [{**ORDERS["streams"][0], "stops": ["c00", "c22"], "service": [8, 8]}],
        "retry": {"hand_over": True},
    }
    run = carried(tmp_path, tasks, block, execution={"disturbances": {"breakdowns": [breaks]}, "on_deadlock": "resolve"}).execution
    assert run.tasks.status.count("done") >= 6


def test_overdue_orders_are_taken_out_of_a_tour(tmp_path):
    tasks = {
        "streams": [{**ORDERS["streams"][0], "count": 30, "arrivals": {"at_once": True}, "due_after_s": 120}],
        "cancel": {"overdue": True},
    }
    status = carried(tmp_path, tasks).execution.tasks.status
    assert status.count("cancelled") > 5 and status.count("cancelled") + status.count("done") == 30


def test_low_batteries_are_charged_when_a_tour_is_over(tmp_path):
    charging = {"stations": ["c3"], "critical_low_charging_level": 85, "minimum_desired_charging_level": 90, "start_level": [90, 90]}
    tasks = {"streams": [{**ORDERS["streams"][0], "count": 30}], "charging": charging}
    run = carried(tmp_path, tasks, shape={"battery": BATTERY}).execution
    assert not run.tasks.is_order.all() and run.loads.max() == 3


def test_a_robot_whose_battery_is_low_is_given_no_more_orders(tmp_path):
    """There are always more: it ends its tour all the same, and charges. So it does when it is to be maintained."""
    endless = {"streams": [{"name": "o", "stops": ["A", "B"], "service": [5, 3], "arrivals": {"open": 12}}]}
    levels = {"critical_low_charging_level": 60, "minimum_desired_charging_level": 65, "maximum_desired_charging_level": 90}
    charging = {"charging": {"stations": ["c3"], "start_level": [70, 70], **levels}}
    result = carried(tmp_path, endless | charging, shape={"battery": BATTERY})
    assert "charge" in result.execution.tasks.kind
    served = carried(tmp_path, endless, shape={"maintenance": {"every_h": 0.1, "takes_s": 60}})
    assert "broken" in {ROBOT_STATES[k] for k in served.execution.robot_states.state.tolist()}


def test_the_audit_sees_one_order_too_many(tmp_path):
    logs = logs_of(carried(tmp_path))
    for most, passed in ((3, True), (2, False)):
        roomy = replace(logs.terms.fleet, capacity=np.array([most, most]))
        audited = operations_audit(replace(logs, terms=replace(logs.terms, fleet=roomy)))
        assert audited["passed"] is passed
    assert "can carry 2" in audited["findings"][0]["text"]


def test_the_audit_sees_a_last_stop_before_the_first(tmp_path):
    logs = logs_of(carried(tmp_path))
    stops = logs.stops
    one, other = np.flatnonzero(stops.task == 0)
    vertex = stops.vertex.copy()
    vertex[[one, other]] = vertex[[other, one]]
    changed = replace(logs, execution=replace(logs.execution, stops=replace(stops, vertex=vertex)))
    assert "stops in order" in {finding["rule"] for finding in operations_audit(changed)["findings"]}


def test_orders_that_nobody_can_do_are_refused_in_tours():
    fleet = Fleet([0], (0.0, (3, 10), 0, "lift"), types=("cart",))
    fleet.crew.orders.reveal(0.0)
    with pytest.raises(PlugInError, match="needs a robot of type 'lift'"):
        work_request(fleet.crew, 0.0, fleet.context.closed, {}, {0: [(0, 0), (0, 1)]})


@pytest.mark.parametrize(("on_m", "last", "stood_s"), [(0.0, 1, 4.5), (0.022, 1, 4.7), (1.0, 1, 8.1), (0.0, 0, 8.1)])
def test_who_waits_where_it_made_a_stop_in_passing_has_not_stood_so_long_on_the_way_there(on_m, last, stood_s):
    """It stood for 4.5 s on its way of 10 s, made the stop, and is seen 3.6 s later: it stands, has just gone on, drove on; at its end."""
    fleet = Fleet([2], (0.0, (3,)))
    robot, speed_mps = fleet.crew.robots[0], float(fleet.crew.problem.fleet.max_speed_mps[0])
    fleet.crew.orders.reveal(0.0)
    robot.begin([(0, 0)], 90.0, 90.0, (0.0, 0.0), charges=False)
    fleet.state.waits.booked_s[0, STANDS[1]] = 8.1
    fleet.state.motion.s_m[0] = on_m * speed_mps / 0.22
    fleet.visits.last = np.array([last])
    row = fleet.crew._row(robot, 0, (100.0, 100.0), 103.6)
    assert row.stood_s == pytest.approx(stood_s)
