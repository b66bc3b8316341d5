"""The audit sees robots touch walls, at the samples and between them."""

import numpy as np
import pytest
from shapely import affinity, geometry

from mrp_sumo.core.execution import Execution, Outcome
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.metrics.audit import audit, in_words

pytestmark = pytest.mark.kernel

CART = RobotType("cart", 1.0, 0.5, max_speed_mps=9.0, accel_mps2=9.0, decel_mps2=9.0, turn_rate_rad_s=9.0)


def look(walls, x, y=0.0, yaw=0.0, dt=1.0, robot=CART):
    """The audit of these positions [T, R] among walls."""
    x = np.array(x, float)
    y, yaw = (np.broadcast_to(np.array(v, float), x.shape) for v in (y, yaw))
    n = x.shape[1]
    run = Execution(np.arange(len(x)) * dt, x, y, yaw, np.zeros_like(x), np.zeros(0), np.zeros(n), Outcome.COMPLETED, "adg", 1.0, 1.0, 1.0)
    return audit(run, fleet_of(robot, n), walls=np.array(walls, float).reshape(-1, 2, 2))


def test_a_cart_in_a_corridor_leaves_half_of_what_it_is_narrower():
    result = look([((-5, 0.5), (15, 0.5)), ((-5, -0.5), (15, -0.5))], np.arange(10.0)[:, None])
    assert result["passed"] and result["num_wall_contacts"] == 0 and in_words(result) == ""
    assert result["min_wall_clearance_m"] == pytest.approx(0.25)
    assert result["min_wall_clearance"] == {"robot": "robot_0", "t_s": 0.0}


def test_driving_through_a_wall_between_two_samples_is_seen():
    result = look([((5, -2), (5, 2))], [[0.0], [8.0]])
    assert not result["passed"] and result["num_wall_contacts"] == result["num_wall_crossings"] == 1
    (contact,) = result["wall_contacts"]
    assert contact["robot"] == "robot_0" and contact["crosses"]
    assert contact["x_m"] == pytest.approx(4.5, abs=1e-2) and contact["t_s"] == pytest.approx(4.5 / 8, abs=1e-2)  # its front is first
    assert in_words(result) == "robot_0 drives through a wall at (4.50, 0.00) after 0.6 s"
    assert result["min_wall_clearance_m"] == 0


def test_a_footprint_that_grazes_a_wall_touches_it_and_its_centre_does_not():
    for shared_m, contacts in ((0.001, 1), (-0.001, 0)):
        result = look([((2, 0.25 - shared_m), (3, 0.25 - shared_m))], [[0.0], [8.0]])
        assert (result["num_wall_contacts"], result["num_wall_crossings"]) == (contacts, 0)
        assert result["min_wall_clearance_m"] == pytest.approx(max(0, -shared_m), abs=2e-4)
    assert in_words(look([((2, 0.2), (3, 0.2))], [[0.0], [8.0]])).startswith("robot_0 touches a wall at (1.5")


def test_a_turning_cart_sweeps_a_corner_that_it_misses_at_both_samples():
    # it reaches 0.25 m up along x, and half its diagonal, 0.559 m, while it turns half around
    yaw = [[0.0], [np.pi * 0.999]]
    assert look([((-1, 0.5), (1, 0.5))], [[0.0], [0.0]], yaw=yaw)["num_wall_contacts"] == 1
    clear = look([((-1, 0.57), (1, 0.57))], [[0.0], [0.0]], yaw=yaw)
    assert clear["num_wall_contacts"] == 0
    assert clear["min_wall_clearance_m"] == pytest.approx(0.57 - np.hypot(0.5, 0.25), abs=1e-4)


def test_a_robot_that_stands_at_a_wall_is_seen_once():
    result = look([((-1, 0.2), (1, 0.2))], np.zeros((50, 1)))
    assert result["num_wall_contacts"] == 1 and result["wall_contacts"][0]["t_s"] == 0


def test_contacts_at_one_time_are_listed_by_robot():
    """robot_1 stands at the wall that is drawn first."""
    result = look([((4, 0.2), (6, 0.2)), ((-1, 0.2), (1, 0.2))], [[0.0, 5.0]])
    assert [contact["robot"] for contact in result["wall_contacts"]] == ["robot_0", "robot_1"] and result["num_wall_crossings"] == 0


@pytest.mark.parametrize("elsewhere", [np.nan, 0.0])  # not on the floor, and standing beside a wall
def test_a_robot_that_touches_no_wall_hides_nobody_who_does(elsewhere):
    walls = [((4, 0.2), (6, 0.2)), ((-1, 0.6), (1, 0.6))]
    result = look(walls, [[elsewhere, 9.0], [elsewhere, 9.0], [elsewhere, 5.0]])
    assert [(contact["robot"], contact["t_s"] >= 1) for contact in result["wall_contacts"]] == [("robot_1", True)]


def test_a_robot_that_comes_later_is_seen_where_it_is():
    nan = np.nan
    result = look([((5, -1), (5, 1))], [[nan], [5.2], [nan]], [[nan], [0.0], [nan]])
    assert result["num_wall_contacts"] == 1 and result["wall_contacts"][0]["t_s"] == 1
    assert look([((5, -1), (5, 1))], [[nan], [6.0], [nan]], [[nan], [0.0], [nan]])["min_wall_clearance_m"] == pytest.approx(0.5)


def test_a_wall_far_away_has_its_distance_all_the_same():
    assert look([((300, -1), (300, 1))], [[0.0], [1.0]])["min_wall_clearance_m"] == pytest.approx(298.5)


def test_without_a_drawing_nothing_is_said_of_walls():
    run = look([], [[0.0], [1.0]])
    assert run["passed"] and run["num_wall_contacts"] == 0 and run["min_wall_clearance_m"] is None
    x = np.zeros((2, 1))
    bare = audit(Execution(np.arange(2.0), x, x, x, x, np.zeros(0), np.zeros(1), Outcome.COMPLETED, "adg", 1, 1, 1), fleet_of(CART, 1))
    assert bare["passed"] and bare["num_wall_contacts"] is None and in_words(bare) == ""


def test_contacts_equal_those_of_shapely():
    """Carts on random ways among random walls, against polygons at 60 moments of every interval."""
    rng = np.random.default_rng(8)
    samples, robots, moments = 6, 5, 60
    x, y = (np.cumsum(rng.normal(0, 0.5, (samples, robots)), 0) + rng.uniform(0, 12, robots) for _ in range(2))
    yaw = np.cumsum(rng.uniform(-1, 1, (samples, robots)), 0)
    walls = rng.uniform(0, 12, (60, 1, 2)) + rng.normal(0, 0.8, (60, 2, 2))
    result = look(walls, x, y, yaw)
    drawn = [geometry.LineString(wall) for wall in walls]
    at = np.arange(0, samples - 1 + 1e-9, 1 / moments)
    box, nearest = geometry.box(-0.5, -0.25, 0.5, 0.25), {}
    for r in range(robots):
        columns = (np.interp(at, np.arange(samples), v[:, r]) for v in (x, y, yaw))
        for px, py, turn in zip(*columns):
            body = affinity.translate(affinity.rotate(box, turn, origin=(0, 0), use_radians=True), px, py)
            for w, wall in enumerate(drawn):
                nearest[r, w] = min(nearest.get((r, w), np.inf), body.distance(wall))
    touched = sum(distance == 0 for distance in nearest.values())
    unsure = sum(0 < distance < 0.02 for distance in nearest.values())  # 60 moments are too few to see these
    assert 3 < touched <= result["num_wall_contacts"] <= touched + unsure
    truth = {(r, w) for r in range(robots) for w, wall in enumerate(drawn) if geometry.LineString(np.c_[x[:, r], y[:, r]]).intersects(wall)}
    assert result["num_wall_crossings"] == len(truth) > 0
