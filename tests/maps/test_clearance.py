"""Room beside walls, on floors where the distances are known by hand."""

from dataclasses import replace

import numpy as np
import pytest
from shapely import geometry

from mrp_sumo.core.graph import nav_graph
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive._causes import MARGIN_M
from mrp_sumo.errors import MapError
from mrp_sumo.maps.building import Building, Door, Level
from mrp_sumo.maps.clearance import STOPS_SHORT_M, clearance, narrow, point_distances, pruned, segment_distances, standing_walls
from mrp_sumo.maps.roadmap import cut_lanes

CART = RobotType("cart", 1.0, 0.5, max_speed_mps=1.0, accel_mps2=1.0, decel_mps2=1.0, turn_rate_rad_s=1.0)  # 0.559 m radius
CORRIDOR = [((0, 0), (10, 0)), ((0, 1), (10, 1))]  # 1 m wide
ALONG = ([(1, 0.5), (9, 0.5)], [(0, 1)])


def level(walls, doors=(), name="L1"):
    ends = [*walls, *doors]
    xy = np.array(ends, float).reshape(-1, 2)
    pairs = np.arange(2 * len(ends)).reshape(-1, 2)
    return Level(
        name=name,
        elevation_m=0.0,
        raw_xy=xy,
        world_xy=xy,
        xy=xy,
        vertex_name=("",) * len(xy),
        vertex_options=({},) * len(xy),
        walls=pairs[: len(walls)],
        doors=tuple(Door(int(a), int(b), "door", "") for a, b in pairs[len(walls) :]),
    )


def building(*levels):
    return Building(name="b", path=None, coordinate_system="", levels={each.name: each for each in levels}, lifts={})


def graph(xy, lanes, **more):
    return nav_graph(name="g", xy=xy, lanes=[(a, b) for a, b in lanes] + [(b, a) for a, b in lanes], **more)


def clear(walls, doors=(), xy=ALONG[0], lanes=ALONG[1], within_m=9.0):
    return clearance(graph(xy, lanes), building(level(walls, doors)), within_m)


def test_a_lane_in_the_middle_of_a_corridor_is_half_its_width_from_the_walls():
    room = clear(CORRIDOR)
    assert room.lane_m.tolist() == pytest.approx([0.5, 0.5])  # the lane and its reverse
    assert room.vertex_m.tolist() == pytest.approx([0.5, 0.5])


def test_distances_of_no_interest_are_infinite():
    assert np.isinf(clear(CORRIDOR, within_m=0.4).lane_m).all() and np.isinf(clear([]).vertex_m).all()


def test_driving_takes_half_the_width_and_turning_the_radius():
    places = narrow(graph(*ALONG), building(level(CORRIDOR)), CART)
    assert places.lanes.tolist() == [] and places.vertices.tolist() == [0, 1]
    slim = RobotType("slim", 0.8, 0.5, 1.0, 1.0, 1.0, 1.0)  # 0.472 m radius
    assert narrow(graph(*ALONG), building(level(CORRIDOR)), slim).notes == ()
    wide = RobotType("wide", 0.2, 1.1, 1.0, 1.0, 1.0, 1.0)
    assert narrow(graph(*ALONG), building(level(CORRIDOR)), wide).lanes.tolist() == [0]


@pytest.mark.parametrize(("away_m", "narrow_vertices"), [(0.4, [0, 1]), (0.402, [])])
def test_robot_that_stops_short_of_a_vertex_needs_a_millimetre_more(away_m, narrow_vertices):
    round_one = RobotType("round", 0.48, 0.64, 1.0, 1.0, 1.0, 1.0)  # 0.4 m radius
    assert STOPS_SHORT_M == MARGIN_M
    assert narrow(graph(*ALONG), building(level([((0, 0.5 + away_m), (10, 0.5 + away_m))])), round_one).vertices.tolist() == narrow_vertices


def test_a_lane_through_a_wall_is_named():
    places = narrow(graph(*ALONG), building(level([((5, -1), (5, 3))])), CART)
    assert places.notes == ("1 lane leads through a wall, such as v0 (1.00, 0.50) -> v1 (9.00, 0.50)",)
    assert places.radius_that_fits_m == 0.0


def test_lanes_and_vertices_are_reported_in_one_line_each_with_the_closest():
    places = narrow(graph([(1, 0.2), (4, 0.1), (8, 0.5)], [(0, 1), (1, 2)]), building(level(CORRIDOR)), CART)
    assert places.notes == (
        "2 lanes run closer than 0.25 m to a wall, too close for 'cart', the closest v0 (1.00, 0.20) -> v1 (4.00, 0.10): 0.10 m",
        "3 vertices are closer than 0.56 m to a wall, too close for 'cart' to turn, the closest v1 (4.00, 0.10): 0.10 m",
    )


@pytest.mark.parametrize("through", [True, False], ids=["wall drawn through", "wall ends at the door"])
def test_a_lane_through_a_door_is_as_far_from_walls_as_its_posts(through):
    walls = [((5, -1), (5, 3))] if through else [((5, -1), (5, 0)), ((5, 1), (5, 3))]
    room = clear(walls, [((5, 0), (5, 1))])
    assert room.lane_m.tolist() == pytest.approx([0.5, 0.5])
    assert clear(walls, [((5, 0), (5, 1))], [(1, 2), (9, 2)]).lane_m.tolist() == [0, 0]


def test_doors_open_only_the_wall_that_they_are_drawn_on():
    wall = [((5, -1), (5, 3))]
    for door in (((4.5, 0.5), (5.5, 0.5)), ((5.2, 0), (5.2, 1)), ((5, 4), (5, 5))):  # across it, beside it, past its end
        assert clear(wall, [door]).lane_m.tolist() == [0, 0]


def test_two_doors_leave_three_pieces_of_a_wall():
    left = standing_walls(building(level([((0, 0), (10, 0))], [((6, 0), (5, 0)), ((2, 0), (3, 0))])), ["L1", "attic"])
    assert left.tolist() == [[[0, 0], [2, 0]], [[3, 0], [5, 0]], [[6, 0], [10, 0]]]
    assert len(standing_walls(building(level([((0, 0), (1, 0))], [((-1, 0), (2, 0))])), ["L1"])) == 0


def test_walls_of_other_levels_and_lanes_of_lifts_do_not_count():
    both = building(level([]), level([((5, -9), (5, 9))], name="L2"))
    xy, lanes = [(1, 0.5), (9, 0.5), (9, 1.5)], [(0, 1), (1, 2)]
    lifted = graph(xy, lanes, level_names=("L1", "L2"), level=[0, 0, 1], lane_options=[{}, {"lift": "a"}] * 2)
    assert np.isinf(clearance(lifted, both, 3.0).lane_m).all()
    on_two = graph(xy, lanes, level_names=("L2",))
    assert clearance(on_two, both, 3.0).lane_m.min() == 0


def test_where_there_is_no_building_there_is_room():
    assert narrow(graph(*ALONG), None, CART).notes == ()


def test_pruning_leaves_out_lanes_without_room_and_keeps_the_numbers_of_vertices():
    # a wall stands between 3 and 4 m: the cut at 3.5 m is gone, and its two steps with it
    whole = cut_lanes(graph([(0.5, 0), (6.5, 0)], [(0, 1)]), 1.0)
    rest = pruned(whole, narrow(whole, building(level([((3, 0.3), (4, 0.3))])), CART))
    assert rest.num_vertices == whole.num_vertices and rest.xy.tolist() == whole.xy.tolist()
    dropped = {(float(whole.xy[a, 0]), float(whole.xy[b, 0])) for a, b in zip(whole.tail, whole.head)} - {
        (float(rest.xy[a, 0]), float(rest.xy[b, 0])) for a, b in zip(rest.tail, rest.head)
    }
    # those at 2.5 and 4.5 m are 0.58 m from the wall's ends
    assert dropped == {(2.5, 3.5), (3.5, 2.5), (3.5, 4.5), (4.5, 3.5)}
    assert (rest.tail[rest.reverse] == rest.head).all()


def test_a_graph_without_any_room_is_refused():
    whole = cut_lanes(graph(*ALONG), 1.0)
    with pytest.raises(MapError, match="no lane of 'g' leaves 'cart' room beside the walls"):
        pruned(whole, narrow(whole, building(level(CORRIDOR)), CART))


def test_distances_equal_those_of_shapely():
    rng = np.random.default_rng(3)
    a, b, c, d = rng.integers(-4, 5, (4, 4000, 2)).astype(float)  # whole numbers touch, overlap and are points often
    b[:2000] += rng.normal(0, 1, (2000, 2))
    truth = [geometry.LineString(one).distance(geometry.LineString(other)) for one, other in zip(zip(a, b), zip(c, d))]
    assert segment_distances(a, b, c, d) == pytest.approx(np.array(truth), abs=1e-9)
    truth = [geometry.Point(p).distance(geometry.LineString(s)) for p, s in zip(a, zip(c, d))]
    assert point_distances(a, c, d) == pytest.approx(np.array(truth), abs=1e-9)


def test_a_crowded_floor_has_the_distances_of_all_pairs():
    rng = np.random.default_rng(4)
    xy, walls = rng.uniform(0, 20, (60, 2)), rng.uniform(0, 20, (80, 1, 2)) + rng.normal(0, 1, (80, 2, 2))
    lanes = np.unique(np.sort(rng.integers(0, 60, (90, 2)), axis=1), axis=0)
    lanes = lanes[lanes[:, 0] < lanes[:, 1]].tolist()
    whole, drawn = graph(xy, lanes), geometry.MultiLineString(walls.tolist())
    room = clearance(whole, building(level(walls)), 1.0)
    for distance, (i, j) in zip(room.lane_m, zip(whole.tail, whole.head)):
        truth = geometry.LineString(xy[[i, j]]).distance(drawn)
        assert distance == (pytest.approx(truth, abs=1e-9) if truth <= 1 else np.inf)
    for distance, place in zip(room.vertex_m, xy):
        truth = geometry.Point(place).distance(drawn)
        assert distance == (pytest.approx(truth, abs=1e-9) if truth <= 1 else np.inf)


def test_a_robot_needs_a_lane_as_wide_as_itself():
    on = graph(*ALONG, lane_options=[{"width": 0.6}] * 2)
    assert narrow(on, building(level([])), CART).notes == ()  # 0.5 m wide
    wide = RobotType("wide", 0.2, 0.7, 1.0, 1.0, 1.0, 1.0)
    for of in (building(level([])), None):
        places = narrow(on, of, wide)
        assert places.notes == ("1 lane is narrower than 'wide' with 0.70 m, such as v0 (1.00, 0.50) -> v1 (9.00, 0.50): 0.60 m",)
        assert places.is_barred.all()
        assert places.lane_notes == ("lane v0 (1.00, 0.50) -> v1 (9.00, 0.50) is 0.60 m wide, 'wide' needs 0.70 m",)


def test_robots_keep_out_of_a_zone_and_people_do_not():
    zone = np.array([(4, 0), (6, 0), (6, 3), (4, 3)], float)
    square = replace(level([]), xy=zone, zones=((0, 1, 2, 3),))
    xy = [(1, 1), (9, 1), (4.5, 2), (5.5, 2), (1, 3.4), (9, 3.4), (1, 4), (9, 4)]  # through it, within it, beside it twice
    places = narrow(graph(xy, [(0, 1), (2, 3), (4, 5), (6, 7)]), building(square), replace(CART, width_m=1.0))
    assert {tuple(sorted(pair)) for pair in zip(places.graph.tail[places.lanes], places.graph.head[places.lanes])} == {
        (0, 1),
        (2, 3),
        (4, 5),
    }
    assert places.vertices.tolist() == [2, 3]
    assert "2 lanes lead through a wall or a zone without robots" in places.notes[0]
    assert len(standing_walls(building(square), ["L1"])) == 0
