"""The audit sees what happened to footprints, whatever the plan said."""

import numpy as np
import pytest
from shapely import affinity, geometry

from mrp_sumo.core.execution import Execution, Outcome
from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.metrics.audit import audit, signed_distances

CART = RobotType("cart", 1.0, 0.5, max_speed_mps=1.0, accel_mps2=1.0, decel_mps2=2.0, turn_rate_rad_s=1.0)


def driven(x, y, yaw=0.0, speed=0.0, dt=1.0):
    """An execution of these positions [T, R]."""
    x = np.array(x, float)
    fill = [np.broadcast_to(np.array(v, float), x.shape) for v in (y, yaw, speed)]
    n = x.shape[1]
    return Execution(np.arange(len(x)) * dt, x, *fill, np.zeros(0), np.zeros(n), Outcome.COMPLETED, "adg", 1.0, 1.0, 1.0)


def test_rectangles_pass_where_circles_would_touch():
    # two carts side by side, centres 0.6 m apart, 0.5 m wide: 0.1 m of air, though circles of 0.56 m radius overlap
    found = audit(driven([[0, 0.0], [0.5, -0.5]], [[0, 0.6], [0, 0.6]]), fleet_of(CART, 2))
    assert found["passed"] and found["num_overlaps"] == 0
    assert found["min_clearance_m"] == pytest.approx(0.1)


def test_a_turned_robot_overlaps_its_neighbour():
    # turned by a quarter it reaches 0.5 m across, its neighbour 0.25 m: 0.75 m > 0.6 m
    found = audit(driven([[0, 0.0], [0, 0.0]], [[0, 0.6], [0, 0.6]], yaw=[[0, 0], [0, np.pi / 2]]), fleet_of(CART, 2))
    assert not found["passed"]
    assert found["num_overlaps"] == 1
    assert found["overlaps"] == [{"robots": ["robot_0", "robot_1"], "t_s": 1.0, "x_m": 0.0, "y_m": 0.3}]
    assert found["min_clearance_m"] == 0


def test_robots_that_touch_do_not_overlap():
    found = audit(driven([[0.0, 1.0]], [[0, 0]]), fleet_of(CART, 2))
    assert found["num_overlaps"] == 0 and found["min_clearance_m"] == pytest.approx(0, abs=1e-9)


def test_a_pair_is_one_overlap_however_long_it_lasts():
    x = np.tile([0, 5, 5.5], (30, 1))
    found = audit(driven(x, 0.0), fleet_of(CART, 3))
    assert [o["robots"] for o in found["overlaps"]] == [["robot_1", "robot_2"]]
    assert found["overlaps"][0]["t_s"] == 0


def test_jumps_speeding_and_hard_braking_are_told_apart():
    jump = audit(driven([[0.0], [1.0], [3.0]], 0.0), fleet_of(CART, 1))
    assert (jump["num_jumps"], jump["num_speed_violations"], jump["num_accel_violations"]) == (1, 0, 0)
    assert jump["violations"] == [{"kind": "jump", "robot": "robot_0", "t_s": 2.0, "value": 2.0, "limit": 1.0}]
    fast = audit(driven([[0.0], [0.0]], 0.0, speed=[[1.5], [1.5]]), fleet_of(CART, 1))
    assert (fast["num_jumps"], fast["num_speed_violations"], fast["num_accel_violations"]) == (0, 2, 0)
    hard = audit(driven([[0.0]] * 3, 0.0, speed=[[0.0], [1.0], [0.0]], dt=0.8), fleet_of(CART, 1))  # 1.25 up, 1.25 down
    assert (hard["num_jumps"], hard["num_speed_violations"], hard["num_accel_violations"]) == (0, 0, 1)
    assert not jump["passed"] and not fast["passed"] and not hard["passed"]


def test_a_robot_alone_and_robots_at_different_times_have_no_clearance():
    assert audit(driven([[0.0], [1.0]], 0.0), fleet_of(CART, 1))["min_clearance_m"] is None
    nan = np.nan
    found = audit(driven([[0.0, nan], [nan, 0.0]], [[0, nan], [nan, 0]]), fleet_of(CART, 2))
    assert found["min_clearance_m"] is None and found["num_overlaps"] == 0


def test_distances_of_turned_rectangles_equal_those_of_polygons():
    rng = np.random.default_rng(5)
    n = 400
    dx, dy = rng.uniform(-2, 2, (2, n))
    yaw_a, yaw_b = rng.uniform(-4, 4, (2, n))
    half_a, half_b = rng.uniform(0.1, 1.0, (2, n, 2))
    signed = signed_distances(dx, dy, yaw_a, yaw_b, half_a, half_b)

    def polygon(x, y, yaw, half):
        box = geometry.box(-half[0], -half[1], half[0], half[1])
        return affinity.translate(affinity.rotate(box, yaw, origin=(0, 0), use_radians=True), x, y)

    for k in range(n):
        a, b = polygon(0, 0, yaw_a[k], half_a[k]), polygon(dx[k], dy[k], yaw_b[k], half_b[k])
        assert max(signed[k], 0) == pytest.approx(a.distance(b), abs=1e-9)
        assert (signed[k] < 0) == (a.intersection(b).area > 0)


@pytest.mark.parametrize(("area_m", "crowded"), [(12, True), (400, False)])
def test_the_search_for_neighbours_misses_no_pair(area_m, crowded):
    """A crowd on the move against every pair of every sample."""
    rng = np.random.default_rng(9)
    samples, robots = 40, 60
    x = np.cumsum(rng.normal(0, 0.3, (samples, robots)), 0) + rng.uniform(0, area_m, robots)
    y = np.cumsum(rng.normal(0, 0.3, (samples, robots)), 0) + rng.uniform(0, area_m, robots)
    x[:20, 3] = y[:20, 3] = np.nan
    yaw = rng.uniform(-3, 3, (samples, robots))
    found = audit(driven(x, y, yaw), fleet_of(CART, robots))
    i, j = np.triu_indices(robots, 1)
    half = np.full((len(i), 2), (0.5, 0.25))
    signed = np.array([signed_distances(x[k, j] - x[k, i], y[k, j] - y[k, i], yaw[k, i], yaw[k, j], half, half) for k in range(samples)])
    assert found["num_overlaps"] == (np.nanmin(signed, 0) < -1e-6).sum()
    assert (found["num_overlaps"] > 0) == crowded
    assert found["min_clearance_m"] == pytest.approx(max(np.nanmin(signed), 0), abs=1e-12)
    assert [o["t_s"] for o in found["overlaps"]] == sorted(o["t_s"] for o in found["overlaps"])
