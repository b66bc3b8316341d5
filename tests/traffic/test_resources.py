"""Places too close for two robots are zones or kept apart by their vertex; proven by sampling, and by hand where the answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrp_sumo.core.graph import nav_graph, relaid
from mrp_sumo.core.plan import plan_of_paths
from mrp_sumo.traffic.resources import LEFT_M, OF_CURVE_M, _last_share, distance_m, needs_of, resources_of, segments
from tests.campaigns.vehicles import drawn_roads
from tests.vehicles import along, quarter, roads, straight

R = 0.325


def both_ways(xy, pairs):
    return nav_graph(name="world", xy=xy, lanes=[lane for a, b in pairs for lane in ((a, b), (b, a))])


def zones(graph, separation=R):
    result = resources_of(graph, separation)
    return result, {tuple(pair) for pair in result.zone.tolist()}


def test_a_grid_of_cells_wider_than_robots_has_no_zones():
    graph = both_ways([(0.4 * x, 0.4 * y) for y in range(3) for x in range(3)], [(0, 1), (1, 2), (3, 4), (4, 5), (1, 4), (4, 7)])
    result, pairs = zones(graph)
    assert not pairs
    assert result.leave_m[0] == pytest.approx(R) and result.enter_m[0] == pytest.approx(R)


def test_an_acute_junction_is_held_for_r_over_its_sine():
    angle = np.radians(40)
    graph = both_ways([(0, 0), (3, 0), (3 * np.cos(angle), 3 * np.sin(angle))], [(0, 1), (0, 2)])
    result, pairs = zones(graph)
    assert not pairs
    out = graph.lane_between(0, 1)
    assert result.leave_m[0, out] == pytest.approx(R / np.sin(angle))
    assert result.enter_m[0, graph.lane_between(1, 0)] == pytest.approx(R / np.sin(angle))
    assert result.leave_m[0, graph.lane_between(1, 0)] == pytest.approx(R)  # alone at the far end


def test_where_the_clearance_does_not_fit_the_next_vertex_is_in_a_zone():
    angle = np.radians(40)
    graph = both_ways([(0, 0), (0.4, 0), (3 * np.cos(angle), 3 * np.sin(angle))], [(0, 1), (0, 2)])
    result, pairs = zones(graph)
    assert result.leave_m[0, graph.lane_between(0, 1)] == pytest.approx(0.4 - LEFT_M)
    long_track = graph.num_vertices + int(result.track[graph.lane_between(0, 2)])
    assert pairs == {(1, long_track)}


def test_crossing_and_neighbouring_lanes_without_a_common_vertex_are_zones():
    crossing = both_ways([(-1, 0), (1, 0), (0, -1), (0, 1)], [(0, 1), (2, 3)])
    assert zones(crossing)[1] == {(4, 5)}
    beside = both_ways([(0, 0), (1, 0), (0, 0.3), (1, 0.3)], [(0, 1), (2, 3)])
    assert zones(beside)[1] == {(0, 2), (1, 3), (0, 5), (1, 5), (2, 4), (3, 4), (4, 5)}
    assert not zones(both_ways([(0, 0), (1, 0), (0, 0.33), (1, 0.33)], [(0, 1), (2, 3)]))[1]


def test_places_on_other_levels_and_vertices_without_lanes_do_not_matter():
    pairs = [(0, 1), (2, 3)]
    lanes = [lane for a, b in pairs for lane in ((a, b), (b, a))]
    floors = nav_graph(name="two", xy=[(0, 0), (1, 0), (0, 0), (1, 0)], lanes=lanes, level_names=("L1", "L2"), level=[0, 0, 1, 1])
    assert not zones(floors)[1]
    alone = nav_graph(name="one", xy=[(0, 0), (1, 0), (0.5, 0)], lanes=[(0, 1)])
    assert not zones(alone)[1]


def test_a_visit_needs_its_vertex_and_the_zones_of_its_vertex_and_lane():
    graph = both_ways([(-1, 0), (1, 0), (0, -1), (0, 1)], [(0, 1), (2, 3)])
    result, _ = zones(graph)
    plan = plan_of_paths([[0, 1]], 1.0)
    needs = needs_of(graph, plan, np.array([-1, graph.lane_between(0, 1)]), result, np.zeros(1, np.int64))
    assert needs.resource.tolist() == [0, 1, 4]
    assert needs.on_lane.tolist() == [False, False, True]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_robots_that_hold_what_they_need_are_apart(seed):
    """Any two robots, each anywhere on what it may occupy with its vertices and zones held, are R apart (less what LEFT_M gives)."""
    rng = np.random.default_rng(seed)
    num = int(rng.integers(4, 9))
    xy = rng.uniform(0, 2, (num, 2))
    pairs = sorted({tuple(sorted(rng.choice(num, 2, replace=False).tolist())) for _ in range(num + 3)})
    graph = both_ways(xy, pairs)
    result, _ = zones(graph)
    tracks = np.arange(len(result.ends))

    def occupied(point, track):
        """Places a robot at this share of a track holds: the track, and vertices it has not left or must have won."""
        lane = graph.lane_between(*result.ends[track].tolist())
        back = int(graph.reverse[lane])
        length = graph.length_m[lane]
        held = {graph.num_vertices + int(track)}
        if point * length < result.leave_m[0, lane]:
            held.add(int(result.ends[track, 0]))
        if (1 - point) * length < result.leave_m[0, back]:
            held.add(int(result.ends[track, 1]))
        return held

    zone_pairs = {tuple(pair) for pair in result.zone.tolist()}
    for _ in range(200):
        a, b = rng.choice(tracks, 2)
        u, v = rng.choice([0.0, 1.0, rng.random()]), rng.choice([0.0, 1.0, rng.random()])
        if a == b:
            continue
        ends = graph.xy[result.ends]
        p = ends[a, 0] + u * (ends[a, 1] - ends[a, 0])
        q = ends[b, 0] + v * (ends[b, 1] - ends[b, 0])
        if np.hypot(*(p - q)) >= R - 2 * LEFT_M:
            continue
        mine, other = occupied(u, a), occupied(v, b)
        clash = bool(mine & other) or any(tuple(sorted((x, y))) in zone_pairs for x in mine for y in other)
        assert clash, (p, q, mine, other)


BULGE_M = 4.0 * (1 - np.sqrt(0.5))  # of a quarter of a circle of 4 m beyond its chord


@pytest.mark.parametrize("closer_m, near", [(0.05, True), (-0.05, False)])
def test_a_place_is_in_a_zone_with_a_curve_that_comes_within_r(closer_m, near):
    """Outside a quarter of a circle in one step, whose chord is another 1.17 m away."""
    out_m, out = 4.0 + 1.5 - closer_m, np.array([1.0, -1.0]) / np.sqrt(2)
    graph = along(quarter(4.0), cell_m=9.0)
    beside = relaid(
        graph,
        xy=np.vstack([graph.xy, [0.0, 4.0] + out_m * out, [0.0, 4.0] + (out_m + 3.0) * out]),
        level=np.zeros(graph.num_vertices + 2, np.int64),
        vertex_options=[*graph.vertex_options, {}, {}],
        lanes=[(0, 1), (1, 0), (graph.num_vertices, graph.num_vertices + 1)],
        length_m=[graph.length_m[0]] * 2 + [3.0],
    )
    result, pairs = zones(beside, 1.5)
    curve = beside.num_vertices + int(result.track[beside.lane_between(0, 1)])
    assert ((graph.num_vertices, curve) in pairs) == near
    assert not zones(replace(beside, curves={}), 1.5 + BULGE_M - 0.1)[1]


def test_a_vertex_is_held_along_a_curve_until_who_follows_it_and_who_drives_its_chord_are_away():
    """A quarter of a circle of 4 m, by robots that need 3 m: 8 asin(3 / 8) m along the circle, 3 m of the chord's 5.66."""
    graph = along(straight((-4, 0), (0, 0)), quarter(4.0), cell_m=9.0)
    result, lane = resources_of(graph, 3.0), graph.lane_between(1, 2)
    assert 8 * np.arcsin(3 / 8) < result.leave_m[0, lane] == pytest.approx(graph.length_m[lane] * 3.0 / np.sqrt(32))
    assert result.leave_m[0, graph.lane_between(1, 0)] == pytest.approx(3.0)


@pytest.mark.parametrize("seed", range(12))
def test_robots_on_curves_that_hold_what_they_need_are_apart(seed):
    """As above; vehicles are on the curves, others on the steps."""
    rng, separation = np.random.default_rng(seed), 1.7
    graph = drawn_roads(rng, 1.8, curved=True)
    result, pairs = zones(graph, separation)
    ends, num = result.ends, graph.num_vertices

    def standing(track, share):
        """Where a robot is, and the places it holds."""
        low, high = ends[track].tolist()
        tail, head = (low, high) if graph.lane_between(low, high) >= 0 else (high, low)
        lane = graph.lane_between(tail, head)
        curve = graph.curves.get((tail, head))
        if curve is None or rng.random() < 0.3:
            xy = graph.xy[tail] + share * (graph.xy[head] - graph.xy[tail])
        else:
            xy = np.array([np.interp(share * curve[-1, 0], curve[:, 0], curve[:, n]) for n in (1, 2)])
        held = {num + track}
        if share * graph.length_m[lane] < result.leave_m[0, lane]:
            held.add(tail)
        if (1 - share) * graph.length_m[lane] < result.enter_m[0, lane]:
            held.add(head)
        return xy, held

    near = 0
    for _ in range(3000):
        a, b = rng.choice(len(ends), 2, replace=False).tolist()
        (p, mine), (q, other) = (standing(track, rng.choice([0.0, 1.0, rng.random()])) for track in (a, b))
        if np.hypot(*(p - q)) < separation - 2 * LEFT_M - 2 * OF_CURVE_M:
            near += 1
            assert mine & other or any(tuple(sorted((x, y))) in pairs for x in mine for y in other), (p, q, mine, other)
    assert near > 5 and graph.curves


def test_small_robots_pass_where_a_large_one_passes_alone():
    beside = both_ways([(0, 0), (1, 0), (0, 0.5), (1, 0.5)], [(0, 1), (2, 3)])
    result = resources_of(beside, np.array([[0.3, 0.6], [0.6, 0.9]]))
    small, large = ({place: set(result.zones_at(place, kind).tolist()) for place in range(6)} for kind in (0, 1))
    assert not any(small[a] & small[b] for a in (0, 4) for b in (2, 5))
    assert all(large[a] & of[b] and of[a] & large[b] for of in (small, large) for a, b in ((0, 2), (4, 5)))
    assert result.leave_m.tolist() == [[0.6] * 4, [0.9] * 4]


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_robots_of_several_types_that_hold_what_they_need_are_apart(seed):
    """As above, for each pair of types; and two places that are far enough apart for two types are no zone for them."""
    rng = np.random.default_rng(seed)
    radius, gap = rng.uniform(0.05, 0.3, 3), rng.uniform(0, 0.1, 3)
    apart = radius[:, None] + radius + np.maximum(gap[:, None], gap)
    graph = both_ways(rng.uniform(0, 2, (7, 2)), sorted({tuple(sorted(rng.choice(7, 2, replace=False).tolist())) for _ in range(9)}))
    result = resources_of(graph, apart)
    place = segments(graph, result.ends)

    def held(kind, track, share):
        lane, num = graph.lane_between(*result.ends[track].tolist()), graph.num_vertices
        length, back = graph.length_m[lane], int(graph.reverse[lane])
        places = [num + int(track)]
        places += [int(result.ends[track, 0])] * bool(share * length < result.leave_m[kind, lane])
        places += [int(result.ends[track, 1])] * bool((1 - share) * length < result.leave_m[kind, back])
        vertices = {p for p in places if p < num}
        return vertices | {num + int(z) for p in places for z in result.zones_at(p, kind)}

    for _ in range(100):
        (a, b), (k, m) = rng.integers(len(result.ends), size=2).tolist(), rng.integers(3, size=2).tolist()
        u, v = rng.choice([0.0, 1.0, rng.random()]), rng.choice([0.0, 1.0, rng.random()])
        one, two = place[graph.num_vertices + a], place[graph.num_vertices + b]
        p, q = one[0] + u * (one[1] - one[0]), two[0] + v * (two[1] - two[0])
        if a != b and np.hypot(*(p - q)) < apart[k, m] - 2 * LEFT_M:
            assert held(k, a, u) & held(m, b, v), (p, q, k, m)
        i, j = sorted(rng.choice(len(place), 2, replace=False).tolist())
        if distance_m(place[[i]], place[[j]])[0] >= apart[k, m]:
            both = set(result.zones_at(i, k).tolist()) & set(result.zones_at(j, m).tolist())
            assert (i, j) not in {tuple(result.zone[z].tolist()) for z in both}


def test_distances_of_segments_are_right_on_known_cases():
    def one(a, b):
        return distance_m(np.array([a], float), np.array([b], float))[0]

    assert one([(0, 0), (2, 0)], [(1, -1), (1, 1)]) == 0
    assert one([(0, 0), (2, 0)], [(3, 1), (3, 2)]) == pytest.approx(np.sqrt(2))
    assert one([(0, 0), (0, 0)], [(1, -1), (1, 1)]) == 1
    assert one([(0, 0), (2, 0)], [(0, 0.5), (2, 0.5)]) == 0.5
    graph = both_ways([(0, 0), (1, 0)], [(0, 1)])
    assert segments(graph, np.array([[0, 1]])).tolist() == [[[0, 0], [0, 0]], [[1, 0], [1, 0]], [[0, 0], [1, 0]]]


@pytest.mark.parametrize("spacing_m", [None, 0.4])
def test_a_lane_leaves_the_reach_of_a_place_where_its_points_do(spacing_m):
    """Lanes and places at random, and on a lattice, where lanes run along each other and end on each other."""
    rng = np.random.default_rng(4)
    xy = rng.uniform(0, 2, (40, 2)) if spacing_m is None else np.stack(np.divmod(np.arange(40), 7), 1) * spacing_m
    lanes = [(a, b) for a, b in rng.integers(0, 40, (120, 2)).tolist() if a != b]
    graph = nav_graph(name="any", xy=xy, lanes=sorted(set(lanes)))
    resources = resources_of(graph, 0.35)
    lane, other = rng.integers(0, graph.num_lanes, 400), rng.integers(0, len(xy) + len(resources.ends), 400)
    track, back = len(xy) + resources.track[lane], graph.tail[lane] > graph.head[lane]
    result = _last_share(resources.lines, track, back, other, np.full(400, 0.35))
    place, fraction = segments(graph, resources.ends)[other], np.linspace(0, 1, 2001)
    begin, along = xy[graph.tail[lane]], xy[graph.head[lane]] - xy[graph.tail[lane]]
    for k in range(400):
        point = np.repeat((begin[k] + fraction[:, None] * along[k])[:, None], 2, axis=1)
        near = distance_m(point, np.broadcast_to(place[k], point.shape)) < 0.35 - 1e-6
        assert result[k] == pytest.approx(fraction[near].max() if near.any() else 0.0, abs=6e-4 if near.any() else 0.02)


def test_a_vertex_whose_lanes_are_all_in_a_group_is_in_it():
    lanes, grouped = [(0, 1), (1, 0), (1, 2), (2, 1), (2, 3), (3, 2)], ({"mutex": "dock"},) * 4 + ({},) * 2
    nav = nav_graph(name="row", xy=[(5.0 * i, 0.0) for i in range(4)], lanes=lanes, lane_options=grouped)
    assert resources_of(nav, 1.0).groups_at.keys() == {0, 1}
    assert not resources_of(replace(nav, lane_options=({},) * 6), 1.0).groups_at


@pytest.mark.parametrize(("beyond_m", "near"), [(1.1, {(0, 2), (0, 5)}), (0.9, set())])
def test_a_vertex_at_which_vehicles_swing_is_in_zones_that_much_farther_away(beyond_m, near):
    """Two lanes 3 m beside each other; robots need 2 m, and beyond_m more at vertex 0. Place 5 is the second lane."""
    graph = replace(roads([(0.0, 0.0), (4.0, 0.0), (0.0, 3.0), (4.0, 3.0)], [(0, 1), (2, 3)]), beyond_m=np.array([beyond_m, 0.0, 0.0, 0.0]))
    result, pairs = zones(graph, 2.0)
    assert pairs == near
    lane = graph.lane_between(0, 1)
    assert (result.leave_m[0, lane], result.leave_m[0, graph.reverse[lane]]) == (pytest.approx(2.0 + beyond_m), pytest.approx(2.0))
