import json
import math

import pytest

from mrp_sumo.calibration.log import ActionTime, LoggedOrder
from mrp_sumo.calibration.orders import matched, orders_of_file, orders_of_visits
from mrp_sumo.calibration.reading import read_fleet
from mrp_sumo.errors import MrpSumoError


def visit(action, station, begin_s, end_s, vehicle="a", told_s=math.nan):
    return ActionTime(vehicle, action, station, begin_s, end_s, told_s)


def test_order_begins_with_a_pick_and_ends_with_the_next_drop():
    visits = [
        visit("pick", "shelf", 10, 15),
        visit("service", "scale", 20, 25),
        visit("drop", "dock", 30, 34),
        visit("startCharging", "charger", 40, 90),
        visit("pick", "door", 100, 105),
        visit("pick", "shelf", 110, 115),
    ]
    orders = orders_of_visits(visits)
    assert [order.stops for order in orders] == [("shelf", "scale", "dock"), ("door",), ("shelf",)]
    assert [order.done_s for order in orders] == [34, 105, 115]
    assert [order.release_s for order in orders] == [10, 34, 105]  # since it was free, or when it is first seen


@pytest.mark.parametrize(
    ("leaves_s", "far_m", "release_s"),
    [(80, 20.0, 80), (60, 20.0, 60), (53, 20.0, 34), (80, 4.0, 34)],  # stands for 20 s; for less; where it is to be served
)
def test_order_of_a_vehicle_that_nobody_told_is_released_when_it_set_out(leaves_s, far_m, release_s):
    visits = [visit("drop", "dock", 30, 34), visit("pick", "shelf", 100, 105)]
    poses = [(float(t), 0.0 if t <= leaves_s else far_m, 0.0, 0.0, math.nan, 0.0) for t in range(110)]
    assert orders_of_visits(visits, {"a": poses})[1].release_s == release_s


def test_order_is_released_when_its_vehicle_is_told():
    orders = orders_of_visits([visit("pick", "shelf", 10, 15, told_s=3), visit("drop", "dock", 30, 34)])
    assert (orders[0].release_s, orders[0].assigned_s) == (3, 3)


def test_vehicle_that_was_sent_to_the_stop_before_its_action_is_said_had_the_order_then():
    visits = [visit("pick", "shelf", 50, 55, told_s=40), visit("drop", "dock", 70, 74)]
    sent = {"a": [(5, "park"), (20, "shelf"), (30, "shelf"), (60, "dock")]}
    assert orders_of_visits(visits, sent=sent)[0].assigned_s == 20


def test_orders_of_a_log_of_messages(tmp_path):
    def state(second, node, status):
        return {
            "timestamp": f"1970-01-01T00:00:{second:02d}.000Z",
            "serialNumber": "agv",
            "lastNodeId": node,
            "agvPosition": {"x": float(second), "y": 0.0, "theta": 0.0, "mapId": "L1"},
            "actionStates": [{"actionId": node, "actionType": "pick" if node == "shelf" else "drop", "actionStatus": status}],
        }

    order = {"timestamp": "1970-01-01T00:00:02.000Z", "nodes": [{"nodeId": "shelf", "actions": [{"actionId": "shelf"}]}]}
    lines = [{"topic": "uagv/v2/m/agv/order", "payload": order}]
    lines += [state(10, "shelf", "RUNNING"), state(14, "shelf", "FINISHED"), state(20, "dock", "RUNNING"), state(26, "dock", "FINISHED")]
    (tmp_path / "log.jsonl").write_text("\n".join(map(json.dumps, lines)))
    orders = read_fleet(tmp_path / "log.jsonl").orders
    assert [(o.stops, o.release_s, o.services, o.done_s) for o in orders] == [(("shelf", "dock"), 2.0, ((10.0, 14.0), (20.0, 26.0)), 26.0)]


def test_orders_of_a_file_are_found_in_the_log_by_their_stops(tmp_path):
    (tmp_path / "orders.csv").write_text("release_s,stops,name\n20,shelf dock,later\n0,shelf dock,first\n5,door dock,never\n")
    orders = orders_of_file(tmp_path / "orders.csv")
    assert [order.name for order in orders] == ["first", "never", "later"]
    seen = [
        LoggedOrder(f"a_{k}", ("shelf", "dock"), t, t, "a", ((t, t + 1), (t + 5, t + 6)), t + 6, t + 6) for k, t in enumerate((8.0, 30.0))
    ]
    first, never, later = matched(orders, seen)
    assert (first.release_s, first.assigned_s, first.done_s) == (0, 8, 14)
    assert math.isnan(never.done_s)
    assert (later.release_s, later.done_s) == (20, 36)


@pytest.mark.parametrize(("begins_s", "mine"), [((98.9,), None), ((99.0,), 0), ((40.0, 150.0, 120.0), 2)])
def test_an_order_of_a_file_is_the_first_of_its_stops_that_begins_after_its_release_or_a_second_before(begins_s, mine):
    """It is released at 100 s."""
    seen = [LoggedOrder(f"seen_{k}", ("A",), begin_s, services=((begin_s, begin_s + 5.0),)) for k, begin_s in enumerate(begins_s)]
    (order,) = matched([LoggedOrder("order", ("A",), 100.0)], seen)
    assert order.services == (() if mine is None else seen[mine].services)


def test_bad_file_of_orders_is_one_line(tmp_path):
    (tmp_path / "orders.csv").write_text("release_s,stops\nsoon,shelf\n")
    with pytest.raises(MrpSumoError, match=r"orders.csv:2: release_s: .*found 'soon'"):
        orders_of_file(tmp_path / "orders.csv")
