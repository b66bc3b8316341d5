"""Causes of waiting, by hand: robots on a ring of six vertices, of which each stands where it is until it drives one on at 8 s."""

from types import SimpleNamespace

import numpy as np
import pytest
from worlds import graph_of, line

from mrp_sumo.core.places import Places
from mrp_sumo.sizing.causes import NONE, PLANNER, Pressed, _comes_out, _floor, _looked_at, _looks, _one_lane_on, causes

RING = [(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1)]
PERIOD_S, END_S, LOOKS = 0.5, 10.0, 18  # looks every half a second from 0 s to 8.5 s, the last second is left out
STATION = ("station", "S")
GRAPH = graph_of(RING, [(k, (k + 1) % 6) for k in range(6)])
PLACES = Places(tuple("abcdef"), ("crossing",) * 6, np.arange(6))


def run(at, served_s, place, busy_s=2.0):
    """Robots stand at vertices, the first is served there between two times, and all have orders for `place` from `busy_s` to 8 s."""
    num, t_s = len(at), np.arange(0.0, END_S + PERIOD_S / 2, PERIOD_S)
    vertex = (np.array(at) + (t_s[:, None] >= 8.0)) % len(RING)
    x_m, y_m = np.array(RING, np.float64)[vertex].transpose(2, 0, 1)
    begin_s, end_s = np.full(num, np.inf), np.full(num, np.inf)
    begin_s[0], end_s[0] = served_s
    vertices = np.array([at[0], *[place] * (num - 1)])
    since_s = np.full(num, busy_s)
    stops = {"robot": np.arange(num), "task": np.arange(num), "station": ["S"] * num, "vertex": vertices}
    stops |= {"since_s": since_s, "begin_s": begin_s, "end_s": end_s}
    tasks = {"robot": np.arange(num), "assigned_s": since_s, "done_s": np.full(num, 8.0), "is_order": np.ones(num, np.bool_)}
    return SimpleNamespace(
        **{"t_s": t_s, "period_s": PERIOD_S, "x_m": x_m, "y_m": y_m, "yaw_rad": np.zeros(x_m.shape)},
        **{"sim_time_s": END_S, "facilities": None},
        **{"stops": SimpleNamespace(**stops), "tasks": SimpleNamespace(**tasks)},
    )


def pressed(at, served_s, place, *, busy_s=2.0, num_places=1, planning_share=0.0):
    return causes(run(at, served_s, place, busy_s), GRAPH, PLACES, 0.0, planning_share, {STATION: num_places})


@pytest.mark.parametrize(
    ("at", "num_places", "expected"),
    [
        ([2], 1, {STATION: Pressed(0.0, 10 / LOOKS)}),  # from 2 s to 7 s, in use and nobody waits
        ([2], 2, {}),
        ([2, 1], 1, {STATION: Pressed(10 * END_S / LOOKS, 10 / LOOKS)}),
        ([2, 1, 0], 1, {STATION: Pressed(20 * END_S / LOOKS, 10 / LOOKS)}),  # who is behind who waits waits for the same
        ([2, 1], 2, {STATION: Pressed(10 * END_S / LOOKS, 10 / LOOKS)}),  # since the robot stands, whatever else is free
    ],
)
def test_who_stands_behind_one_that_is_served_waits_for_the_station(at, num_places, expected):
    assert pressed(at, (2.0, 7.0), 2, num_places=num_places) == {cause: nearly(cost) for cause, cost in expected.items()}


@pytest.mark.parametrize(("planning_share", "cause"), [(0.5, PLANNER), (0.49, ("crossing", "b"))])
def test_who_stands_at_its_last_stop_waits_for_a_planner_that_is_at_work_half_of_the_time(planning_share, cause):
    """It is served at a until 2 s, and sets out a second before it is seen at b: 10 looks."""
    waits = pressed([0], (0.0, 2.0), 0, busy_s=0.0, planning_share=planning_share)
    assert waits[cause] == nearly(Pressed(10 * END_S / LOOKS, 10 / LOOKS)) and set(waits) == {STATION, cause}


def test_who_has_no_order_waits_for_nobody():
    assert pressed([2, 1], (2.0, 7.0), 2, busy_s=99.0) == {STATION: nearly(Pressed(0.0, 10 / LOOKS))}


def test_where_robots_go_is_known_from_the_first_look_on():
    """Both have driven one place on by 8 s; the first has been served by 1 s, at the third look."""
    execution = run([2, 1], (0.0, 1.0), 2, busy_s=0.0)
    looks = list(_looked_at(execution, GRAPH, PLACES, *_looks(execution, 0.0)))
    assert (looks[0].vertex, looks[0].towards, looks[0].onward) == ([2, 1], [3, 2], [[3, NONE], [2, NONE]])
    assert [(look.served[0], look.last[0]) for look in looks[:3]] == [(0, NONE), (0, NONE), (NONE, 2)]
    assert (looks[-1].vertex, looks[-1].towards) == ([3, 2], [NONE, NONE])


def test_the_next_vertex_is_the_one_nearest_to_where_a_robot_was_seen_next():
    vertex, towards = np.array([[0, 1, 1, 0]]), np.array([[2, 5, 3, NONE]])
    assert _one_lane_on(GRAPH, vertex, towards).tolist() == [[1, 0, 2, NONE]]


@pytest.mark.parametrize(
    ("length", "place", "onward", "comes_out"),
    [
        (5, 2, [1, 0], True),
        (5, 2, [3, 4], False),  # through
        (5, 2, [NONE, NONE], False),
        (5, 3, [2, 1], False),  # not in it yet
        (4, 3, [2, 1], True),  # at its dead end
        (4, 2, [3, NONE], True),  # on the way there, from where it comes back
        (4, 1, [0, NONE], False),
    ],
)
def test_who_is_to_enter_an_aisle_waits_for_who_comes_out_of_it(length, place, onward, comes_out):
    """robot_0 is at 0, before the free place 1 and the aisle 2, of a line of places; who is not bound for the aisle waits for nobody."""
    places = Places(tuple("abcde"[:length]), ("crossing", "crossing", "aisle", "crossing", "crossing")[:length], np.arange(length))
    floor = _floor(line(length), places)
    for bound_for, aisle in ((2, 2 if comes_out else NONE), (NONE, NONE)):
        look = SimpleNamespace(place=[0, place], onward=[[1, bound_for], onward])
        assert _comes_out(0, look, floor, 1) == aisle


def nearly(cost):
    """Equal to a cost but for what rounding does to it."""
    return Pressed(pytest.approx(cost.waited_s), pytest.approx(cost.share))
