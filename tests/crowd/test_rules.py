"""The rules by which people step, each by hand: the kernels as plain Python, on one or two people, robots and walls."""

import numpy as np
import pytest
from crowds import crowd_on, room
from plain_kernels import as_plain_python
from shapely import affinity, geometry

from mrp_sumo.crowd import _floor, _walk
from mrp_sumo.crowd.state import BODY_M, Machines


@pytest.fixture(autouse=True)
def plain(monkeypatch):
    as_plain_python(monkeypatch, _walk, _floor)


def machine(x=0.0, y=0.0, yaw=0.0, along=0.0, half_length=0.5, half_width=0.3, halted=False):
    columns = (np.array([value]) for value in (x, y, yaw, along, half_length, half_width))
    return Machines(*columns, 0.1, np.array([halted]), np.zeros(1, np.int64), np.zeros(1, np.int64))


@pytest.mark.parametrize("seed", range(30))
def test_distances_from_a_robot_are_those_of_its_rectangle_stretched_by_what_it_drives(seed):
    chance = np.random.default_rng(seed)
    x, y, yaw, along = *chance.uniform(-2, 2, 2), chance.uniform(-4, 4), chance.choice([0.0, 0.8, -0.8])
    robots, half = machine(x, y, yaw, along), 0.5 + abs(along) * 0.3
    middle = x + along * 0.3 * np.cos(yaw), y + along * 0.3 * np.sin(yaw)
    shape = affinity.rotate(
        geometry.box(middle[0] - half, middle[1] - 0.3, middle[0] + half, middle[1] + 0.3), yaw, middle, use_radians=True
    )
    for px, py in [*chance.uniform(-3, 3, (12, 2)), *(chance.normal(middle, 0.2) for _ in range(6))]:
        away, nx, ny = _walk.from_robot(px, py, 0, robots, 0.6)
        point = geometry.Point(px, py)
        assert away == pytest.approx(-shape.exterior.distance(point) if shape.contains(point) else shape.distance(point))
        assert np.hypot(nx, ny) == pytest.approx(1.0)
        assert shape.exterior.distance(geometry.Point(px - away * nx, py - away * ny)) == pytest.approx(0.0, abs=1e-9)


def test_walls_near_cells_are_those_within_reach_of_their_centres():
    walls = np.array([(0.3, 0.3, 1.7, 0.3), (1.0, 1.9, 1.6, 1.1), (0.5, 1.5, 0.5, 1.5), (-3.0, 0.0, -3.0, 2.0)])
    first, near, away_m = _floor.walls_near(walls, -0.5, -0.2, 0.3, 8, 7, 0.5)
    for cell in range(56):
        centre = geometry.Point(-0.5 + (cell % 8 + 0.5) * 0.3, -0.2 + (cell // 8 + 0.5) * 0.3)
        away = [centre.distance(geometry.LineString([wall[:2], wall[2:]])) for wall in walls]
        assert sorted(near[first[cell] : first[cell + 1]].tolist()) == [k for k, each in enumerate(away) if each <= 0.5]
        assert away_m[cell] == pytest.approx(min(away) if min(away) <= 0.5 else np.inf)


@pytest.mark.parametrize("start", [0, 7, 210, 399])
def test_on_an_open_floor_people_walk_straight_to_their_place(start):
    direction, cell = np.zeros(400, np.uint8), np.arange(400)
    _floor.march(start, np.ones(400, bool), np.full(400, np.inf), 0.2, 0.25, 20, direction)
    dx, dy = (start % 20 - cell % 20) * 0.2, (start // 20 - cell // 20) * 0.2
    assert ((direction == _floor.THERE) <= (np.hypot(dx, dy) <= 0.81)).all() and (direction == _floor.THERE)[np.hypot(dx, dy) < 0.5].all()
    far = direction != _floor.THERE
    off = (direction * 1.5 - np.degrees(np.arctan2(dy, dx)) + 180) % 360 - 180
    assert np.abs(off[far]).max() < 16 and np.abs(off[far]).mean() < 5
    straight = far & ((dx == 0) | (dy == 0))
    assert np.abs(off[straight]).max() <= 0.75


def test_ways_lead_round_what_is_not_free_and_none_from_where_there_is_none():
    """Columns 3 and 7 of nine are a wall, the first with a gap in the top row."""
    free = np.ones((5, 9), bool)
    free[:4, 3] = free[:, 7] = False
    direction = np.zeros(45, np.uint8)
    _floor.march(0, free.ravel(), np.full(45, np.inf), 1.0, 0.25, 9, direction)
    direction = direction.reshape(5, 9)
    assert (direction[~free] == _floor.NO_WAY).all() and (direction[:, 8] == _floor.NO_WAY).all() and direction[0, 0] == _floor.THERE
    assert direction[4, 3] == 120 and direction[4, 4] == 120 and direction[0, 4] == 60 and direction[4, 0] == 180
    assert direction[0, 1] == direction[0, 2] == 120 and direction[1, 0] == direction[2, 0] == 180


def test_near_walls_ways_are_slow_and_beyond_their_reach_they_are_not():
    """Two rows lead to the place; in the first, people walk at two fifths of their speed, as it is within a body of a wall."""
    for away_m, along_first in ((0.25, False), (0.6, True), (9.0, True)):
        direction = np.zeros(40, np.uint8)
        _floor.march(0, np.ones(40, bool), np.array([away_m] * 20 + [9.0] * 20), 1.0, 0.25, 20, direction)
        assert (direction[10] == 120) == along_first


def two(dx, dy, vx=0.0, vy=0.0, own=(0.0, 0.0)):
    """One at (3, 3) that walks, and another so far from it, with a speed."""
    crowd = crowd_on(room(6, 6), [(1, 1), (5, 5)], [((3.0, 3.0), (0, 1)), ((3.0 + dx, 3.0 + dy), (0, 1))])
    walkers = crowd.walkers
    walkers.vx_mps[:2], walkers.vy_mps[:2] = [own[0], vx], [own[1], vy]
    _walk.put_in_bins(walkers.x_m, walkers.y_m, 2, crowd.ground, walkers.first, walkers.member)
    return walkers, crowd.ground


@pytest.mark.parametrize(
    ("dx", "dy", "vx", "gap"),
    [
        (1.0, 0.0, 1.0, 1.0),
        (1.0, 0.26, 1.0, 1.0),
        (1.0, -0.26, 1.0, 1.0),
        (1.0, 0.28, 1.0, np.inf),  # beside one's lane
        (1.0, 0.18, -1.0, 1.0),
        (1.0, 0.2, -1.0, np.inf),  # who comes towards one leaves more room
        (-1.0, 0.0, 1.0, np.inf),  # behind
        (2.51, 0.0, 1.0, np.inf),
        (2.49, 0.0, 1.0, 2.49),
    ],
)
def test_the_next_one_ahead_is_in_the_lane_of_a_body(dx, dy, vx, gap):
    walkers, ground = two(dx, dy, vx)
    assert _walk.push_of_people(0, 1.0, 0.0, walkers, ground) == (0.0, 0.0, pytest.approx(gap))


def test_bodies_that_touch_push_each_other_and_followers_do_not_push_forward():
    """0.3 m apart, where 0.4 m is free: 100 / s^2 times a third of 0.3 m."""
    size = 100.0 * (0.4 / 0.3 - 1.0) * 0.3
    for dx, vx, push in ((0.3, 0.0, -size), (0.3, 1.0, -size), (-0.3, 0.0, size), (-0.3, 1.0, 0.0), (-0.3, -1.0, size), (0.41, 0.0, 0.0)):
        walkers, ground = two(dx, 0.0, vx)
        assert _walk.push_of_people(0, 1.0, 0.0, walkers, ground)[:2] == pytest.approx((push, 0.0))
    walkers, ground = two(0.0, 0.3, 1.0)
    assert _walk.push_of_people(0, 1.0, 0.0, walkers, ground)[:2] == pytest.approx((0.0, -size))


@pytest.mark.parametrize(
    ("dx", "dy", "vx", "own", "weight"),
    [
        (1.0, 0.3, 0.0, 0.0, 0.5 * (0.4 + 0.5) * np.exp((0.4 - np.hypot(1.0, 0.3)) / 0.6 - (0.3 / 0.8) ** 2)),  # it stands
        (1.0, -0.3, 0.0, 0.0, -0.5 * (0.4 + 0.5) * np.exp((0.4 - np.hypot(1.0, 0.3)) / 0.6 - (0.3 / 0.8) ** 2)),
        (1.0, 0.0, 1.0, 1.0, 0.5 * 0.4 * np.exp((0.4 - 1.0) / 0.6)),  # it goes the same way
        (1.5, 0.0, -0.5, 0.5, 0.5 * 1.4 * np.exp((0.4 - 0.5) / 0.6)),  # it comes, and is 0.5 m away in a second
        (1.5, 0.0, -1.0, 1.0, 0.5 * 1.4 * np.exp(0.4 / 0.6)),  # and here
        (-1.0, 0.0, 0.0, 0.0, 0.0),
        (2.51, 0.0, 0.0, 0.0, 0.0),
    ],
)
def test_people_turn_from_others_the_more_the_sooner_they_meet(dx, dy, vx, own, weight):
    """To the right of who is ahead or to the left, to the left of who is to the right."""
    walkers, ground = two(dx, dy, vx, own=(own, 0.0))
    tx, ty, meets = _walk.round_people(0, 0.5, 0.0, walkers, ground)
    assert meets == (weight != 0.0 and vx <= -0.5)
    assert np.hypot(tx, ty) == pytest.approx(0.5) and ty / tx == pytest.approx(-weight)
    assert _walk.round_people(0, 0.0, 0.0, walkers, ground) == (0.0, 0.0, False)


@pytest.mark.parametrize(
    ("others", "turns"),
    [
        ([], True),  # nobody slows it down there
        ([(0.57, -0.4, 1.0)], False),
        ([(0.57, -0.4, 1.0), (0.44, 0.0, -1.0)], True),  # straight on it would stand
        ([(0.57, -0.4, 1.0), (0.6, 0.0, 1.0)], True),  # there it would be slower
    ],
)
def test_who_is_slowed_by_turning_goes_straight_on_if_that_leads_farther(others, turns):
    """Somebody comes on the left, others walk ahead: 0.7 m away to the right, and straight on."""
    people = [(0.0, 0.0, 1.0), (1.2, 0.6, -1.0), *others]
    crowd = crowd_on(room(12, 6), [(1, 3), (11, 3)], [((3 + dx, 3 + dy), (0, 1)) for dx, dy, _ in people])
    walkers = crowd.walkers
    walkers.vx_mps[: len(people)] = [vx for *_, vx in people]
    _walk.put_in_bins(walkers.x_m, walkers.y_m, len(people), crowd.ground, walkers.first, walkers.member)
    _walk.push(0.0, 0, walkers, crowd.ground, crowd.robots, crowd._ways)
    heading = np.arctan2(walkers.ay_mps2[0], walkers.ax_mps2[0] + 1.0 / _walk.RELAX_S)
    assert (heading < np.radians(-15)) == turns and (heading > np.radians(-8)) != turns


@pytest.mark.parametrize(
    ("away_m", "ex", "ey", "part"), [(0.3, 1.0, 0.0, 1.0), (0.3, 0.0, 1.0, 1.0), (0.3, 0.0, -1.0, 0.0), (1.5, 1.0, 0.0, 0.0)]
)
def test_walls_push_to_the_side_and_never_back(away_m, ex, ey, part):
    """50 m/s^2 at the wall, which fade by e in 0.2 m."""
    ground = crowd_on(room(6, 6), [(1, 1), (5, 5)], []).ground
    cell = _walk.cell_of(3.0, away_m, ground)
    assert _walk.push_of_walls(3.0, away_m, ex, ey, ground, cell) == pytest.approx((0.0, part * 50.0 * np.exp(-away_m / 0.2)))


@pytest.mark.parametrize(
    ("x", "y", "nx", "ny", "through"),
    [
        (2.9, 1.0, 3.1, 1.0, True),
        (3.1, 1.0, 2.9, 1.1, True),
        (2.9, 1.6, 3.1, 1.6, False),
        (2.9, 1.0, 2.99, 1.3, False),
        (2.9, 1.4, 3.1, 1.7, False),
    ],
)
def test_a_step_leads_through_a_wall_where_it_crosses_it(x, y, nx, ny, through):
    """One from the lower edge up to 1.5 m, at x = 3."""
    ground = crowd_on(room(6, 4, (3, 0, 3, 1.5)), [(1, 3.4), (5, 3.4)], []).ground
    assert _walk.leads_through_wall(x, y, nx, ny, ground) == through


def test_people_and_robots_are_in_the_bins_where_they_stand():
    crowd = crowd_on(room(9, 6), [(1, 1), (5, 5)], [])
    chance, ground = np.random.default_rng(1), crowd.ground
    x, y = chance.uniform(-0.5, 9.5, 40), chance.uniform(-0.5, 6.5, 40)
    x[[3, 20]] = np.nan
    first, member = np.zeros(ground.columns * ground.rows + 1, np.int64), np.zeros(40, np.int64)
    _walk.put_in_bins(x, y, 30, ground, first, member)
    for row in range(ground.rows):
        for column in range(ground.columns):
            b = row * ground.columns + column
            there = [
                p
                for p in range(30)
                if np.isfinite(x[p]) and (min(max(x[p], 0), 8.99) // 2.5, min(max(y[p], 0), 5.99) // 2.5) == (column, row)
            ]
            assert member[first[b] : first[b + 1]].tolist() == there
    assert first[-1] == 28 and (ground.columns, ground.rows) == (4, 3)


@pytest.mark.parametrize(
    ("x", "ex", "along", "stuck", "size"),
    [
        (1.0, 1.0, 0.0, False, 0.5 * 7 * np.exp(-(0.5 - BODY_M) / 0.3)),  # behind one: half of it
        (1.0, -1.0, 0.0, False, 7 * np.exp(-(0.5 - BODY_M) / 0.3)),
        (1.0, -1.0, 0.5, False, 7 * np.exp(-max(0.5 - 0.3 - BODY_M, 0.0) / 0.3)),  # where it will be in 0.6 s
        (1.0, -1.0, 0.0, True, 0.0),
        (1.0, -1.0, 0.06, True, 7 * np.exp(-(0.5 - 0.036 - BODY_M) / 0.3)),
        (3.01, -1.0, 0.0, False, 0.0),
    ],
)
def test_robots_push_people_from_where_they_will_be(x, ex, along, stuck, size):
    """One of a metre faces a person that is so far from its middle."""
    crowd = crowd_on(room(8, 6), [(1, 1), (5, 5)], [], robots=[(2.0, 3.0, 1.0, 0.6)])
    crowd.robots.along_mps[0] = along
    _walk.put_in_bins(crowd.robots.x_m, crowd.robots.y_m, 1, crowd.ground, crowd.robots.first, crowd.robots.member)
    ax, ay, nearest = _walk.push_of_robots(2.0 + x, 3.0, ex, 0.0, stuck, crowd.ground, crowd.robots)
    assert (ax, ay) == pytest.approx((size, 0.0)) and nearest == (np.inf if x > 3 else pytest.approx(x - 0.5 - along * 0.6))


@pytest.mark.parametrize(
    ("start", "speed", "accel", "ends", "keeps"),
    [
        ((3.0, 3.0), (1.0, 0.0), (0.5, 0.0), (3.105, 3.0), (1.05, 0.0)),
        ((3.0, 3.0), (1.0, 0.0), (9.0, 0.0), (3.13, 3.0), (1.3, 0.0)),  # 1.3 times what it likes, which is 1 m/s
        ((3.0, 0.2), (0.0, -1.0), (0.0, 0.0), (3.0, 0.15), (0.0, -0.5)),  # 0.15 m from the wall
        ((4.1, 3.0), (1.0, 0.0), (0.0, 0.0), (4.13, 3.0), (0.3, 0.0)),  # 0.27 m from the robot's end at 4.4
        ((4.3, 3.0), (0.0, 0.0), (0.0, 0.0), (4.13, 3.0), (-1.3, 0.0)),  # pushed away: it seems no faster than it could walk
    ],
)
def test_a_step_is_no_faster_than_people_walk_and_ends_beside_robots_and_walls(start, speed, accel, ends, keeps):
    crowd = crowd_on(room(6, 6), [(1, 1), (5, 5)], [(start, (0, 1))], 1.0, robots=[(4.9, 3.0, 1.0, 0.6)])
    who = crowd.walkers
    who.vx_mps[0], who.vy_mps[0], who.ax_mps2[0], who.ay_mps2[0] = *speed, *accel
    _walk.put_in_bins(crowd.robots.x_m, crowd.robots.y_m, 1, crowd.ground, crowd.robots.first, crowd.robots.member)
    _walk.move(0.1, 0, who, crowd.ground, crowd.robots)
    assert (who.x_m[0], who.y_m[0]) == pytest.approx(ends) and (who.vx_mps[0], who.vy_mps[0]) == pytest.approx(keeps)


@pytest.mark.parametrize(
    ("x", "walks", "stuck_s", "away_until_s", "after"),
    [
        (1.0, True, 0.0, 0.0, (0.0, 0.0, 0.0)),
        (1.0, True, 2.0, 0.0, (1.5, 0.0, 0.0)),
        (3.5, True, 2.0, 0.0, (2.0 - 0.125, 0.0, 0.0)),  # beside the robot it forgets slowly
        (1.0, False, 2.0, 0.0, (2.5, 0.0, 0.0)),
        (3.5, False, 2.0, 0.0, (2.5, 0.5, 0.0)),  # it waits for the robot
        (2.69, False, 0.0, 0.0, (0.5, 0.0, 0.0)),
        (2.71, False, 0.0, 0.0, (0.5, 0.5, 0.0)),
        (1.0, False, 7.4, 0.0, (7.9, 0.0, 0.0)),
        (1.0, False, 7.5, 0.0, (0.0, 0.0, 22.0)),  # it has no more patience, and goes back for 12 s
        (1.0, False, 7.5, 11.0, (0.0, 0.0, 11.0)),  # it does so already
    ],
)
def test_who_has_stood_for_long_goes_back_for_a_while(x, walks, stuck_s, away_until_s, after):
    """A robot reaches from 3.9 m on; what is slower than a fifth of the speed that one likes is standing."""
    crowd = crowd_on(room(6, 6), [(1, 1), (5, 5)], [((x, 3.0), (0, 1))], 1.0, robots=[(4.4, 3.0, 1.0, 0.6)])
    who = crowd.walkers
    who.vx_mps[0], who.stuck_s[0], who.away_until_s[0] = 0.21 if walks else 0.19, stuck_s, away_until_s
    _walk.put_in_bins(crowd.robots.x_m, crowd.robots.y_m, 1, crowd.ground, crowd.robots.first, crowd.robots.member)
    _walk.look_back(10.0, 0.5, 0, who, crowd.ground, crowd.robots)
    assert (who.stuck_s[0], who.waited_s[0], who.away_until_s[0]) == pytest.approx(after)


@pytest.mark.parametrize(
    ("sx", "sy", "can"),
    [
        (2.0, 1.0, True),
        (2.84, 1.0, True),
        (2.86, 1.0, False),  # too near to the wall at 3
        (3.5, 1.0, False),  # beyond it
        (1.0, 2.0, False),  # 0.35 m from another
        (1.0, 1.9, True),  # 0.45 m
        (0.5, 0.2, True),
        (0.5, 0.1, False),
    ],
)
def test_one_can_stand_where_there_is_room_for_a_body_and_nobody_else(sx, sy, can):
    crowd = crowd_on(room(6, 4, (3, 0, 3, 4)), [(1, 3.4), (2, 3.4)], [((1.0, 1.0), (0, 1)), ((1.0, 2.35), (0, 1))])
    _walk.put_in_bins(crowd.walkers.x_m, crowd.walkers.y_m, 2, crowd.ground, crowd.walkers.first, crowd.walkers.member)
    assert _walk.can_stand_at(0, sx, sy, crowd.walkers, crowd.ground, crowd.robots) == can


@pytest.mark.parametrize(
    ("at", "halted", "direction", "size"),
    [
        ((4.0, 3.1), True, (0.0, 1.0), 0.6 / 0.7),  # 0.7 m aside: 0.3 m, the field, a body and 5 cm; it is 0.1 m on that side
        ((4.0, 2.9), True, (0.0, -1.0), 0.6 / 0.7),
        ((4.0, 3.69), True, (0.0, 1.0), 0.01 / 0.7),
        ((4.0, 3.71), True, (0.0, 0.0), 0.0),  # beside its path
        ((1.7, 3.0), True, (-1.0, 0.0), 1.0),  # behind it, where it has no room to turn
        ((1.0, 3.0), True, (0.0, 0.0), 0.0),
        ((1.7, 3.0), False, (0.0, 0.0), 0.0),
    ],
)
def test_people_leave_the_path_of_a_robot_to_the_nearer_side(at, halted, direction, size):
    crowd = crowd_on(room(8, 6), [(1, 1), (5, 5)], [(at, (0, 1))], robots=[(2.0, 3.0, 1.0, 0.6)])
    crowd.robots.is_halted[0] = halted
    for each, count in ((crowd.walkers, 1), (crowd.robots, 1)):
        _walk.put_in_bins(each.x_m, each.y_m, count, crowd.ground, each.first, each.member)
    output = _walk.out_of_path(0, 0, crowd.walkers, crowd.ground, crowd.robots)
    assert output == pytest.approx(tuple(size * part for part in direction), abs=1e-9)


@pytest.mark.parametrize(
    ("dx", "dy", "free"), [(1.0, 0.0, True), (1.0, -1.0, True), (0.0, -1.0, False), (2.0, 0.0, False), (0.8, 3.0, False)]
)
def test_a_way_is_free_but_for_where_people_are_pushed_to_walls(dx, dy, free):
    """From 0.15 m before the wall at the left, into a room of 2 m by 4 m."""
    ground = crowd_on(room(2, 4), [(1, 1), (1, 3)], []).ground
    assert _walk.is_free_way(0.15, 2.0, dx, dy, ground) == free
