"""Prices of steps from the traffic of a crowd, in a corridor of four cells; by hand."""

import numpy as np
import pytest
from step_wise_worlds import problem_of

from mrp_sumo.core.step_wise import FORWARD, WAIT
from planners.step_wise.ground import FreeCells
from planners.step_wise.traffic import EVERY, CrowdTraffic

EAST, WEST = 0, 2


def prices_after(steps, seen, against=2, robots=2):
    """What steps east and west cost along the corridor, after so many steps in each of which these states and actions of some were seen."""
    ground = FreeCells(problem_of(["...."], [0], [[3]]), 1, against)
    ground.slot(3)
    traffic, (state, action) = CrowdTraffic(ground, robots), (np.array(column) for column in zip(*seen))
    for _ in range(steps):
        traffic.see(state.astype(np.int32), action.astype(np.int8))
    return ground.price[EAST:12:4].tolist(), ground.price[4 + WEST :: 4].tolist(), ground.num_tables


def test_prices_and_tables_stay_until_enough_steps_have_been_seen():
    """Row 0 leads east: against it a step counts as two more."""
    assert prices_after(EVERY - 1, [(0, FORWARD)]) == ([1, 1, 1], [3, 3, 3], 1)


def test_a_step_against_the_stream_counts_as_much_as_nobody_drives_there():
    """All of the first ten who drive between 0 and 1 go east, and all between 1 and 2 go west, but for the one that was there at first."""
    seen = [(4 * 0 + EAST, FORWARD), (4 * 2 + WEST, FORWARD)]
    east, west, num_tables = prices_after(EVERY, seen)
    assert east == [1, 1 + round(4 * (2 * 10 / 11 - 1)), 1]
    assert west == [5, 1, 5]
    assert num_tables == 0


@pytest.mark.parametrize(("against", "price"), [(2, 21), (1, 11)])
def test_a_step_to_where_robots_wait_counts_more(against, price):
    """Somebody always waits at 1, so steps there, from 0 and from 2, cost more, the latter also as it is against the row."""
    east, west, _ = prices_after(EVERY, [(4 * 1 + EAST, WAIT)], against)
    assert (east, west) == ([price, 1, 1], [1 + 2 * against, price + 2 * against, 1 + 2 * against])


def test_where_cells_are_full_streams_count_more_and_jams_nothing():
    """Four robots on four cells, or three, of which the one at 1 drives east to 2 in each step, or waits."""
    assert prices_after(EVERY, [(4 * 1 + EAST, FORWARD)], 1, 4)[1][1] == 1 + 8
    assert prices_after(EVERY, [(4 * 1 + EAST, FORWARD)], 1, 3)[1][1] == 1 + 2
    assert prices_after(EVERY, [(4 * 1 + EAST, WAIT)], 1, 4)[0] == [1, 1, 1]
    assert prices_after(EVERY, [(4 * 1 + EAST, WAIT)], 1, 3)[0] == [11, 1, 1]
