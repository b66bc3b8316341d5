"""Who waits for whom in a circle."""

import numpy as np
import pytest

from mrp_sumo.drive._observe import waiting_cycles
from mrp_sumo.drive.deadlock import DeadlockWatch
from mrp_sumo.drive.state import state_at_rest


def two_that_wait_for_each_other():
    state = state_at_rest(2, 4, 4, np.array([0, 1]))
    state.grants.other[:] = [1, 0]
    state.waits.since_s[:] = 3.0
    return state


def test_robots_that_wait_for_each_other_are_a_deadlock_reported_once():
    state, watch = two_that_wait_for_each_other(), DeadlockWatch()
    assert watch.look(state) == [(0, 1)]
    assert watch.look(state) == []


def test_robot_that_may_go_on_but_has_not_heard_of_it_is_in_no_deadlock():
    state, watch = two_that_wait_for_each_other(), DeadlockWatch()
    state.grants.allowed_m[1] = 0.4  # granted; the message is under way
    assert watch.look(state) == []
    state.motion.s_m[1] = 0.4  # there, and still waiting
    assert watch.look(state) == [(0, 1)]


@pytest.mark.parametrize(
    ("other", "not_waiting", "label"),
    [
        ([1, 2, 0, 1, -1, 4], [], [1, 1, 1, 0, 0, 0]),  # 3 waits for one in the ring, 5 for one that waits for nobody
        ([1, 2, 0, 1, -1, 4], [2], [0] * 6),
        ([3, 2, 1, 0, 5, 4], [], [1, 2, 2, 1, 3, 3]),
        ([3, 2, 1, 0, 5, 4], [4], [1, 2, 2, 1, 0, 0]),
        ([0], [], [1]),
    ],
)
def test_rings_are_numbered_and_who_waits_for_one_of_a_ring_is_in_none(other, not_waiting, label):
    since_s = np.full(len(other), 3.0)
    since_s[not_waiting] = np.inf
    assert waiting_cycles(np.array(other), since_s).tolist() == label
