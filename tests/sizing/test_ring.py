"""A closed ring of one lane, driven: its throughput is known by hand, from its length, the speed and the service time."""

import pytest
from ring_floor import LAP_S, MOVE_UP_S, SIDE_M, ring

from mrp_sumo.sizing.observe import observation

pytestmark = pytest.mark.slow


def rate(done_s, first):
    """Orders a second from the n-th on."""
    return (len(done_s) - 1 - first) / (done_s[-1] - done_s[first])


@pytest.mark.parametrize("robots", [1, 2])
def test_few_robots_do_an_order_a_lap(tmp_path, robots):
    result = observation(ring(tmp_path, robots, 40.0))
    done_s = [t for t in result["done_s"] if t is not None]
    assert rate(done_s, robots - 1) * (LAP_S + 40.0) == pytest.approx(robots, rel=0.05)
    assert result["lane_m"] == pytest.approx(4 * SIDE_M)
    metres, orders = sum(m for _, m in result["minutes"][2:12]), rate(done_s, robots - 1) * 600.0
    assert metres == pytest.approx(orders * 4 * SIDE_M, rel=0.05)  # distance is orders times way: what the diagram's flow stands on


def test_two_robots_are_bound_by_a_station_that_takes_longer_than_a_lap(tmp_path):
    result = observation(ring(tmp_path, 2, 100.0))
    done_s = [t for t in result["done_s"] if t is not None]
    assert rate(done_s, 2) * (100.0 + MOVE_UP_S) == pytest.approx(1.0, rel=0.02)
    assert result["stations"]["stop"]["queued_s"] > 0
    station = result["stations"]["stop"]
    assert station["served_s"] / station["over_s"] == pytest.approx(100.0 / (100.0 + MOVE_UP_S), rel=0.05)
