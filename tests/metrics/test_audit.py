"""The audit sees what happened to footprints, whatever the plan said."""

from dataclasses import replace

import numpy as np
import pytest
from shapely import affinity, geometry

from mrp_sumo.core.execution import Execution, Outcome
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.robot_type import RobotType, Wheels
from mrp_sumo.metrics import _audit
from mrp_sumo.metrics._audit import rectangle_distance
from mrp_sumo.metrics.audit import audit, in_words

pytestmark = pytest.mark.kernel

CART = RobotType("cart", 1.0, 0.5, max_speed_mps=1.0, accel_mps2=1.0, decel_mps2=2.0, turn_rate_rad_s=1.0)


COUNTS = ("speed_violations", "accel_violations", "decel_violations", "turn_rate_violations", "jumps", "heading_jumps")


def driven(x, y, yaw=0.0, speed=0.0, dt=1.0, **more):
    """An execution of these positions [T, R]."""
    x = np.array(x, float)
    fill = [np.broadcast_to(np.array(v, float), x.shape) for v in (y, yaw, speed)]
    n = x.shape[1]
    return Execution(np.arange(len(x)) * dt, x, *fill, np.zeros(0), np.zeros(n), Outcome.COMPLETED, "adg", 1.0, 1.0, 1.0, **more)


def faults(result):
    """Counts that are not 0."""
    return {kind: result[f"num_{kind}"] for kind in COUNTS if result[f"num_{kind}"]}


def test_rectangles_pass_where_circles_would_touch():
    # two carts side by side, centres 0.6 m apart, 0.5 m wide: 0.1 m of air, though circles of 0.56 m radius overlap
    result = audit(driven([[0, 0.0], [0.5, -0.5]], [[0, 0.6], [0, 0.6]]), fleet_of(CART, 2))
    assert result["passed"] and result["num_overlaps"] == 0
    assert result["min_clearance_m"] == pytest.approx(0.1)


def test_a_turned_robot_overlaps_its_neighbour():
    # turned by a quarter it reaches 0.5 m across, its neighbour 0.25 m: 0.75 m > 0.6 m
    result = audit(driven([[0, 0.0], [0, 0.0]], [[0, 0.6], [0, 0.6]], yaw=[[0, 0], [0, np.pi / 2]]), fleet_of(CART, 2))
    assert not result["passed"]
    assert result["num_overlaps"] == 1
    assert result["overlaps"] == [{"robots": ["robot_0", "robot_1"], "t_s": 1.0, "x_m": 0.0, "y_m": 0.3}]
    assert result["min_clearance_m"] == 0


def test_robots_that_touch_do_not_overlap():
    result = audit(driven([[0.0, 1.0]], [[0, 0]]), fleet_of(CART, 2))
    assert result["num_overlaps"] == 0 and result["min_clearance_m"] == pytest.approx(0, abs=1e-9)


def test_a_pair_is_found_behind_one_in_the_same_square_that_is_too_far():
    """robot_1 is 1.4 m away, in the square of both; circles of two carts meet within 1.12 m."""
    result = audit(driven([[0.05, 1.05, 0.45]], [[0.05, 1.05, 0.05]]), fleet_of(CART, 3))
    assert [o["robots"] for o in result["overlaps"]] == [["robot_0", "robot_2"]]


@pytest.mark.parametrize(("owner", "pairs"), [([0, 1, 0, 1], [[0, 3]]), ([0, 1, 0, 0], [])])
def test_a_trailer_hides_nobody_who_overlaps_its_robot(owner, pairs):
    """Squares of 0.2 m, all but the second in one square of the search: the fourth overlaps the first, and not the third."""
    x, y, half = np.array([[0.05, 9.0, 0.05, 0.2]]), np.array([[0.05, 0.05, 0.27, 0.05]]), np.full(4, 0.1)
    bodies = _audit.Footprints(np.hypot(half, half), half, half, np.array(owner))
    _, _, hits = _audit.closeness(_audit.Poses(x, y, np.zeros((1, 4))), np.zeros(4, np.int64), bodies)
    assert hits[:, 2:].tolist() == pairs


def test_a_pair_is_one_overlap_however_long_it_lasts():
    x = np.tile([0, 5, 5.5], (30, 1))
    result = audit(driven(x, 0.0), fleet_of(CART, 3))
    assert [o["robots"] for o in result["overlaps"]] == [["robot_1", "robot_2"]]
    assert result["overlaps"][0]["t_s"] == 0


@pytest.mark.parametrize(
    ("fault", "near_miss", "count", "output"),
    [  # a cart at 1 m/s, 1 m/s2 up, 2 m/s2 down, 1 rad/s; samples 0.5 s apart
        ({"speed": [1.002]}, {"speed": [1.0005]}, "speed_violations", ("speed", 0.0, 1.002, 1.0)),
        ({"speed": [0.2, 0.71]}, {"speed": [0.2, 0.704]}, "accel_violations", ("accel", 0.5, 1.02, 1.0)),
        ({"speed": [1.0, -0.02]}, {"speed": [1.0, 0.0]}, "decel_violations", ("decel", 0.5, 2.04, 2.0)),
        ({"speed": [1.0, 0.0], "dt": 0.4}, {"speed": [1.0, 0.2], "dt": 0.4}, "decel_violations", ("decel", 0.4, 2.5, 2.0)),
        ({"yaw": [3.0, -2.78]}, {"yaw": [3.0, -2.7832]}, "turn_rate_violations", ("turn_rate", 0.5, 1.0063706, 1.0)),
        ({"yaw": [0.0, 1.1]}, {"yaw": [0.0, -0.5]}, "heading_jumps", ("heading_jump", 0.5, 1.1, 0.5)),
        ({"x": [0.0, 0.502]}, {"x": [0.0, 0.5005]}, "jumps", ("jump", 0.5, 0.502, 0.5)),
    ],
    ids=["speed", "accel", "reversing", "decel", "turn_rate", "heading", "jump"],
)
def test_planted_faults_are_found_and_near_misses_are_not(fault, near_miss, count, output):
    def look(x=0.0, yaw=0.0, speed=0.0, dt=0.5):
        columns = np.broadcast_arrays(*(np.atleast_1d(v)[:, None] for v in (x, yaw, speed)))
        return audit(driven(columns[0], 0.0, columns[1], columns[2], dt), fleet_of(CART, 1))

    result = look(**fault)
    assert not result["passed"] and faults(result) == {count: 1}
    kind, t_s, value, limit = output
    assert [(v["kind"], v["robot"], v["t_s"]) for v in result["violations"]] == [(kind, "robot_0", t_s)]
    assert result["violations"][0]["value"] == pytest.approx(value) and result["violations"][0]["limit"] == pytest.approx(limit)
    assert look(**near_miss)["passed"], look(**near_miss)


def test_driving_back_takes_braking_and_speeding_up():
    for seconds, possible in ((1.5, True), (1.45, False)):  # 1 m/s to 0 takes 0.5 s, to -1 m/s another 1 s
        result = audit(driven([[0.0], [0.0]], 0.0, speed=[[1.0], [-1.0]], dt=seconds), fleet_of(CART, 1))
        assert result["passed"] is possible


def test_only_the_first_of_a_kind_are_told_one_by_one():
    result = audit(driven(np.zeros((100, 1)), 0.0, speed=np.full((100, 1), 1.5)), fleet_of(CART, 1))
    assert result["num_speed_violations"] == 100
    assert [v["t_s"] for v in result["violations"]] == list(range(20))


def test_overlap_before_one_of_both_is_in_a_lift_has_a_place():
    # both stand in one place, until one of them is in a lift at 1 s and on the other floor at 2 s
    result = audit(driven([[2.0, 2.0]] * 3, 0.0, level=np.array([[0, 0], [0, 0], [0, 1]])), fleet_of(CART, 2))
    assert result["overlaps"] == [{"robots": ["robot_0", "robot_1"], "t_s": 0.0, "x_m": 2.0, "y_m": 0.0}]


def test_overlap_between_two_rides_of_one_of_both_has_a_place():
    """One comes out of a lift at 4 s, where the other stands, and is in it again at 5 s."""
    level = np.array([[0, 1]] * 4 + [[0, 0]] * 2 + [[0, 1]])
    (overlap,) = audit(driven([[2.0, 2.0]] * 7, 0.5, level=level), fleet_of(CART, 2))["overlaps"]
    assert overlap == {"robots": ["robot_0", "robot_1"], "t_s": 4.0, "x_m": 2.0, "y_m": 0.5}


@pytest.mark.parametrize(
    ("aside_m", "turn_rad", "least_m", "touches"), [(0.0, 0.0, 0.0, 1 / 3), (0.6, 0.0, 0.1, -1), (0.6, np.pi, 0.0, 0.4)]
)
@pytest.mark.parametrize("sought", [_audit.NONE, _audit.ANY, _audit.FIRST])
def test_rectangles_that_pass_are_as_near_as_they_come_and_overlap_when_they_do(aside_m, turn_rad, least_m, touches, sought):
    """Of 1 m by 0.5 m, from 3 m before to 3 m behind, and one may turn round meanwhile; what was in the scratch is no matter."""
    scratch, half = (np.full((64, 4), 1e9), np.full(3, 1e9)), (0.5, 0.25)
    pace = 6.0 + np.hypot(*half) * turn_rad
    _audit.approach((-3.0, aside_m, 0.0, 0.0), (6.0, 0.0, 0.0, turn_rad), (half, half), pace, np.inf, sought, scratch)
    nearest, when, overlap = scratch[1].tolist()
    assert nearest == pytest.approx(least_m, abs=1e-3) and 1 / 3 - 0.01 < when < 2 / 3 + 0.01
    if sought == _audit.NONE or touches < 0:
        assert overlap == -1.0
    elif sought == _audit.FIRST:
        assert overlap == pytest.approx(touches, abs=2e-3 if not turn_rad else 0.04)
    else:
        assert touches - 0.01 <= overlap <= 2 / 3


def test_robots_that_pass_through_each_other_between_two_samples_overlap():
    # head on at 1 m/s each: 1.2 m of air at both samples, bodies meet at 0.6 s and have passed at 1.6 s of 2 s
    x = [[0.0, 2.2], [2.2, 0.0]]
    result = audit(driven(x, 0.0, yaw=[[0, np.pi]] * 2, dt=2.2), fleet_of(CART, 2))
    assert not result["passed"] and result["num_overlaps"] == 1 and result["min_clearance_m"] == 0
    assert 0.6 < result["overlaps"][0]["t_s"] < 1.6
    assert result["overlaps"][0]["x_m"] == pytest.approx(1.1) and faults(result) == {}
    # the same side by side, 1 cm of air
    passed = audit(driven(x, [[0.0, 0.51]] * 2, yaw=[[0, np.pi]] * 2, dt=2.2), fleet_of(CART, 2))
    assert passed["passed"] and passed["min_clearance_m"] == pytest.approx(0.01, abs=1e-4)


def test_a_robot_that_sweeps_its_neighbour_while_it_turns_overlaps():
    # half a turn on the spot: along x at both samples, across x in between, where it reaches 0.5 m up
    yaw = [[0.0, 0.0], [np.pi * 0.999, 0.0]]
    hit = audit(driven([[0.0, 0.0]] * 2, [[0.0, 0.7]] * 2, yaw, dt=np.pi), fleet_of(CART, 2))
    assert hit["num_overlaps"] == 1 and 0 < hit["overlaps"][0]["t_s"] <= np.pi / 2
    # its corner draws a circle of 0.559 m: just clear of it
    clear = audit(driven([[0.0, 0.0]] * 2, [[0.0, 0.81]] * 2, yaw, dt=np.pi), fleet_of(CART, 2))
    assert clear["passed"] and clear["min_clearance_m"] == pytest.approx(0.56 - np.hypot(0.5, 0.25), abs=1e-4)


def test_robots_that_touch_overlap_from_when_one_turns():
    # side by side they touch at both samples; half-way through half a turn the one reaches far into the other
    result = audit(driven([[0.0, 0.0]] * 2, [[0.0, 0.5]] * 2, [[0.0, 0.0], [np.pi, 0.0]], dt=np.pi), fleet_of(CART, 2))
    assert result["num_overlaps"] == 1 and result["overlaps"][0]["t_s"] == pytest.approx(np.pi / 2)


def test_a_corner_that_is_clipped_for_a_moment_is_found():
    # a square of 1 m passes another's corner on a diagonal; they share 1 mm of it, in the middle of the interval
    square = RobotType("square", 1.0, 1.0, 10.0, 10.0, 10.0, 10.0)
    for shared_m, overlaps in ((0.001, 1), (-0.001, 0)):
        away = np.sqrt(2) - shared_m / np.sqrt(2)  # of the centres when corners meet, seen along the diagonal
        x, y = away / np.sqrt(2) + np.array([-1.0, 1.0]), away / np.sqrt(2) + np.array([1.0, -1.0])
        result = audit(driven(np.c_[np.zeros(2), x], np.c_[np.zeros(2), y]), fleet_of(square, 2))
        assert result["num_overlaps"] == overlaps
        assert result["min_clearance_m"] == pytest.approx(max(0, -shared_m) / np.sqrt(2), abs=2e-4)


def test_robots_on_different_floors_never_meet():
    run = driven([[0.0, 0.0, 3.0]], 0.0)
    assert audit(run, fleet_of(CART, 3))["num_overlaps"] == 1
    result = audit(run, fleet_of(CART, 3), np.array([0, 1, 0]))
    assert result["passed"] and result["min_clearance"]["robots"] == ["robot_0", "robot_2"]


def test_what_sumo_says_is_compared():
    x = np.array([[0.0, 5.0], [0.5, 5.0], [1.0, 5.0]])
    seen = np.array([[(0.0, 0.0), (5.0, 0.0)], [(0.76, 0.0), (5.0, 0.0)], [(1.0, 0.0), (5.0, 0.1)]])
    result = audit(driven(x, 0.0, sumo_t_s=np.array([0.0, 1.5, 2.0]), sumo_xy_m=seen), fleet_of(CART, 2))
    assert not result["passed"] and result["num_sumo_disagreements"] == 1 and result["sumo_apart_m"] == pytest.approx(0.1)
    assert result["sumo_disagreements"] == [{"robot": "robot_1", "t_s": 2.0, "apart_m": pytest.approx(0.1)}]
    near = audit(driven(x, 0.0, sumo_t_s=np.array([0.0, 1.5]), sumo_xy_m=seen[:2]), fleet_of(CART, 2))
    assert near["passed"] and near["sumo_apart_m"] == pytest.approx(0.01)
    assert audit(driven(x, 0.0), fleet_of(CART, 2))["sumo_apart_m"] is None


def test_a_collision_that_sumo_reports_fails_the_audit():
    result = audit(driven([[0.0, 5.0]], 0.0, findings=("1.00 s: SUMO reports a collision of robot_0 and robot_1",)), fleet_of(CART, 2))
    assert not result["passed"] and result["num_overlaps"] == 0
    assert result["num_sumo_collisions"] == 1 and "robot_0 and robot_1" in result["sumo_collisions"][0]


def test_a_robot_alone_and_robots_at_different_times_have_no_clearance():
    assert audit(driven([[0.0], [1.0]], 0.0), fleet_of(CART, 1))["min_clearance_m"] is None
    nan = np.nan
    result = audit(driven([[0.0, nan], [nan, 0.0]], [[0, nan], [nan, 0]]), fleet_of(CART, 2))
    assert result["min_clearance_m"] is None and result["num_overlaps"] == 0


def test_a_robot_that_comes_or_goes_is_looked_at_where_it_is():
    nan = np.nan
    result = audit(driven([[0.0, nan], [0.0, 0.9], [0.0, nan]], [[0, nan], [0, 0], [0, nan]]), fleet_of(CART, 2))
    assert result["num_overlaps"] == 1 and result["overlaps"][0]["t_s"] == 1


def polygon(x, y, yaw, half):
    box = geometry.box(-half[0], -half[1], half[0], half[1])
    return affinity.translate(affinity.rotate(box, yaw, origin=(0, 0), use_radians=True), x, y)


def test_distances_of_turned_rectangles_equal_those_of_polygons():
    rng = np.random.default_rng(5)
    for _ in range(300):
        dx, dy = rng.uniform(-2, 2, 2)
        yaw_a, yaw_b = rng.uniform(-4, 4, 2)
        half_a, half_b = rng.uniform(0.1, 1.0, (2, 2))
        signed = rectangle_distance(dx, dy, yaw_a, yaw_b, tuple(half_a), tuple(half_b))
        a, b = polygon(0, 0, yaw_a, half_a), polygon(dx, dy, yaw_b, half_b)
        assert max(signed, 0) == pytest.approx(a.distance(b), abs=1e-9)
        assert (signed < 0) == (a.intersection(b).area > 0)


@pytest.mark.parametrize(("area_m", "crowded"), [(12, True), (200, False)])
def test_the_search_misses_no_pair_at_no_time(area_m, crowded):
    """A crowd on the move against every pair at 40 moments of every interval."""
    rng = np.random.default_rng(9)
    samples, robots, moments = 12, 16, 40
    x = np.cumsum(rng.normal(0, 0.3, (samples, robots)), 0) + rng.uniform(0, area_m, robots)
    y = np.cumsum(rng.normal(0, 0.3, (samples, robots)), 0) + rng.uniform(0, area_m, robots)
    x[:6, 3] = y[:6, 3] = np.nan
    yaw = np.cumsum(rng.uniform(-1, 1, (samples, robots)), 0)
    result = audit(driven(x, y, yaw), fleet_of(CART, robots))
    at = np.arange(0, samples - 1 + 1e-9, 1 / moments)
    xs, ys, yaws = (np.stack([np.interp(at, np.arange(samples), v[:, r]) for r in range(robots)], 1) for v in (x, y, yaw))
    nearest = {}
    for i in range(robots):
        for j in range(i + 1, robots):
            centres = np.hypot(xs[:, j] - xs[:, i], ys[:, j] - ys[:, i])
            time_s = np.flatnonzero(centres < np.nanmin(centres) + 1.2)  # their circles' radii sum up to less
            columns = (v[time_s] for v in (xs[:, j] - xs[:, i], ys[:, j] - ys[:, i], yaws[:, i], yaws[:, j]))
            nearest[f"robot_{i}", f"robot_{j}"] = min(rectangle_distance(*row, (0.5, 0.25), (0.5, 0.25)) for row in zip(*columns))
    seen = {pair for pair, d in nearest.items() if d < -1e-6}
    output = {tuple(overlap["robots"]) for overlap in result["overlaps"]}
    assert (len(seen) > 5) == crowded and len(output) == result["num_overlaps"] < 20
    assert seen <= output
    assert all(nearest[pair] < 0.02 for pair in output - seen)  # 40 moments are too few to see these
    assert 0 <= max(min(nearest.values()), 0) - result["min_clearance_m"] < 0.02
    assert [o["t_s"] for o in result["overlaps"]] == sorted(o["t_s"] for o in result["overlaps"])


CABIN = np.array([[0, 10.0, 0.0, 0.0, 2.0, 1.5], [1, 10.0, 0.0, 0.0, 2.0, 1.5]])  # of one lift on two levels, 2 m along x


@pytest.mark.parametrize(
    ("x_m", "yaw_rad", "outside"), [(9.5, 0.0, 0), (10.5, 0.0, 0), (9.4, 0.0, 1), (10.6, 0.0, 1), (9.3, np.pi / 2, 0), (9.15, np.pi / 2, 1)]
)
def test_body_that_changes_levels_is_wholly_in_a_cabin(x_m, yaw_rad, outside):  # of 1 m x 0.5 m
    level = np.array([[0], [0], [1], [1]], np.int16)
    result = audit(driven([[x_m]] * 4, [[0.0]] * 4, yaw_rad, level=level), fleet_of(CART, 1), cabins=CABIN)
    assert (result["num_rides_outside"], result["passed"]) == (outside, not outside)
    if outside:
        assert result["rides_outside"] == [{"robot": "robot_0", "t_s": 1.0, "x_m": x_m, "y_m": 0.0, "level": 0}]
        assert in_words(result) == f"robot_0 rides a lift outside its cabin at ({x_m:.2f}, 0.00) after 1.0 s"


def test_who_stays_on_a_level_needs_no_cabin():
    level = np.zeros((4, 1), np.int16)
    assert audit(driven([[3.0]] * 4, [[0.0]] * 4, level=level), fleet_of(CART, 1), cabins=CABIN)["num_rides_outside"] == 0


TURNS = RobotType(
    "tricycle",
    1.0,
    0.5,
    9.0,
    9.0,
    9.0,
    gap_m=0.1,
    kinematics=Wheels(kind="tricycle", wheelbase_m=1.0, steering_max_rad=np.pi / 4, axle_m=0.0),
)


def on_wheels(x, y, yaw, robot=TURNS):
    """Findings about the wheels of one robot in a run through these poses, a second apart."""
    t = np.arange(len(x), dtype=float)
    poses = [np.array(column, float)[:, None] for column in (x, y, yaw)]
    run = Execution(t, *poses, np.zeros((len(x), 1)), np.zeros(0), np.zeros(1), Outcome.COMPLETED, "", t[-1], 0.0, 0.0)
    return [each["kind"] for each in audit(run, fleet_of(robot, 1))["violations"] if each["kind"] in ("radius", "side slip", "reverse")]


@pytest.mark.parametrize(("radius_m", "expected"), [(1.03, []), (0.95, ["radius"])])
def test_a_vehicle_turns_no_tighter_than_its_wheels_allow(radius_m, expected):
    assert on_wheels([0, radius_m * np.sin(0.5)], [0, radius_m * (1 - np.cos(0.5))], [0, 0.5]) == expected


@pytest.mark.parametrize(("aside_m", "expected"), [(0.06, []), (0.07, ["side slip"])])
def test_a_vehicle_slips_to_the_side_by_no_more_than_two_bends_of_its_least_radius_take_it(aside_m, expected):
    assert on_wheels([0, 0.5], [0, aside_m], [0, 0]) == expected


@pytest.mark.parametrize(("reverse", "expected"), [(True, []), (False, ["reverse"])])
def test_only_who_may_drives_backwards(reverse, expected):
    robot = replace(TURNS, kinematics=replace(TURNS.kinematics, reverse=reverse))
    assert on_wheels([0, -0.5], [0, 0], [0, 0], robot) == expected


def test_a_vehicle_does_not_turn_in_place():
    assert on_wheels([0, 0], [0, 0], [0, 0.1]) == ["radius"]
