"""Draws: MRP-Bench's own is repeated to the vertex; ours only pairs places that reach each other."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from golden import INSTANCES, MRP_BENCH
from vehicles import CAR, CART, TRICYCLE, TUGGER, roads

from mrp_sumo.core.graph import nav_graph, plan_graph, with_lanes
from mrp_sumo.errors import PlanError
from mrp_sumo.traffic.draw import draw_by_type, most_drawn, mrp_bench_draw, stands_of, uniform_draw


def drawn_graph(lanes, num_vertices, stations=None):
    nav = nav_graph(name="t", xy=np.column_stack((np.arange(num_vertices), np.zeros(num_vertices))), lanes=lanes)
    station = np.arange(num_vertices) if stations is None else np.array(stations)
    return plan_graph(nav, kind="roadmap", cell_m=1.0, vertex_of_station=station)


@pytest.mark.parametrize("name", ["office", "warehouse"])
def test_mrp_bench_draw_repeats_its_instances(name):
    nav = MRP_BENCH / f"{name}.nav/0.yaml"
    vertices = next(iter(yaml.safe_load(nav.read_text())["levels"].values()))["vertices"]
    xy = np.array([v[:2] for v in vertices], np.float32).astype(float)
    cell = np.floor((xy - xy.min(0)) / 0.4).astype(int)
    for seed in (3000, 3017, 3049):
        rows = (INSTANCES / f"{name}_0.4_n9_s{seed}.scen").read_text().splitlines()[1:]
        rows = np.array([[int(x) for x in row.split()[4:8]] for row in rows])
        start, goal = mrp_bench_draw(len(xy), 9, seed)
        assert (cell[start] == rows[:, :2]).all()
        assert sorted(map(tuple, cell[goal])) == sorted(map(tuple, rows[:, 2:]))


def test_uniform_draw_is_distinct_and_repeats_itself():
    ring = [(i, (i + 1) % 10) for i in range(10)]
    graph = drawn_graph(ring, 10)
    start, goal = uniform_draw(graph, 10, seed=4)
    assert sorted(start) == sorted(goal) == list(range(10))
    assert (start != goal).any()
    assert all((a == b).all() for a, b in zip((start, goal), uniform_draw(graph, 10, seed=4), strict=True))
    assert (start != uniform_draw(graph, 10, seed=5)[0]).any()


def test_uniform_draw_stays_where_one_way_lanes_lead_back():
    # 0 <-> 1 <-> 2 and then a one-way street 2 -> 3 -> 4 from which nobody returns
    graph = drawn_graph([(0, 1), (1, 0), (1, 2), (2, 1), (2, 3), (3, 4)], 5)
    for seed in range(10):
        start, goal = uniform_draw(graph, 3, seed)
        assert set(start) | set(goal) <= {0, 1, 2}


def test_uniform_draw_uses_stations_only():
    graph = drawn_graph([(i, j) for i in range(5) for j in (i - 1, i + 1) if 0 <= j < 5], 5, stations=[0, 4, 4])
    start, goal = uniform_draw(graph, 2, 0)
    assert set(start) == set(goal) == {0, 4}


@pytest.mark.parametrize(("stations", "piece"), [([0, 1, 5], {0, 1}), ([0, 5, 6], {2, 3, 4, 5, 6}), ([0, 5], {0, 1})])
def test_a_draw_anywhere_is_in_the_piece_with_most_stations_as_that_of_stations_is(stations, piece):
    """A row of two and a longer one of five; where both have as many stations, the first."""
    graph = drawn_graph([(i, j) for i in range(7) for j in (i - 1, i + 1) if 0 <= j < 7 and {i, j} != {1, 2}], 7, stations)
    assert set(stands_of(graph, anywhere=True).start.tolist()) == piece
    assert set(stands_of(graph).start.tolist()) == piece & set(stations)


def test_too_many_robots_are_refused():
    with pytest.raises(PlanError, match="cannot draw 6 robots: there are 5 vertices"):
        mrp_bench_draw(5, 6, 0)
    with pytest.raises(PlanError, match="cannot draw 3 robots: there are 2 stations"):
        uniform_draw(drawn_graph([(0, 1), (1, 0)], 2), 3, 0)


def grouped(members, separation_m, xy=None):
    """A ring of ten stations, some in the mutex group 'dock'."""
    ring = [(i, (i + 1) % 10) for i in range(10)]
    graph = drawn_graph([*ring, *[(b, a) for a, b in ring]], 10)
    options = tuple({"mutex": "dock"} if v in members else {} for v in range(10))
    graph = replace(graph, vertex_options=options, xy=graph.xy if xy is None else np.array(xy, np.float64))
    return lambda num_robots, seed: uniform_draw(graph, num_robots, seed, separation_m)


def test_at_most_one_robot_starts_and_one_ends_in_a_mutex_group():
    draw = grouped({2, 3, 4, 5}, 0.1)
    for seed in range(20):
        for chosen in draw(6, seed):
            assert len(set(chosen.tolist()) & {2, 3, 4, 5}) <= 1 and len(set(chosen.tolist())) == 6


def test_draw_without_violation_is_the_same_as_without_groups():
    free, docked = grouped(set(), 0.1), grouped({2, 3}, 0.1)
    same = [seed for seed in range(40) if all(len({2, 3} & set(ends.tolist())) < 2 for ends in free(3, seed))]
    assert same
    for seed in same:
        assert all((a == b).all() for a, b in zip(free(3, seed), docked(3, seed)))


def test_no_two_robots_start_nearer_to_each_other_than_they_may_stand():
    xy = [(float(i // 2), 0.2 * (i % 2)) for i in range(10)]  # five pairs of stations 0.2 m apart
    draw = grouped(set(), 0.3, xy)
    for seed in range(10):
        for chosen in draw(5, seed):
            assert sorted(v // 2 for v in chosen.tolist()) == list(range(5))


def test_draw_that_groups_make_impossible_is_refused():
    with pytest.raises(PlanError, match="cannot draw 8 robots: there are 7 stations on which robots may stand at once"):
        grouped({2, 3, 4, 5}, 0.1)(8, 0)


def test_nobody_starts_or_ends_where_robots_only_pass_through():
    graph = drawn_graph([(0, 1), (1, 0), (1, 2), (2, 1)], 3)
    graph = replace(graph, vertex_options=({}, {"is_passthrough_point": True}, {}))
    start, goal = uniform_draw(graph, 2, 1)
    assert sorted(start.tolist()) == sorted(goal.tolist()) == [0, 2]
    with pytest.raises(PlanError, match="cannot draw 3 robots: there are 2 stations"):
        uniform_draw(graph, 3, 1)


def test_types_are_drawn_where_they_have_room_and_apart_from_those_that_are_given():
    small = drawn_graph([(a, b) for a in range(8) for b in (a - 1, a + 1) if 0 <= b < 8], 8)
    large = with_lanes(small, small.tail >= 2)
    large = with_lanes(large, large.head >= 2)  # which has no way to vertices 0 and 1
    kind, none = np.array([0, 0, 1, 1]), np.full(4, -1)
    for seed in range(9):
        start, goal = draw_by_type([(CART, small), (CART, large)], kind, np.array([3, -1, -1, -1]), none, seed, 0.5)
        assert start[0] == 3 and len(set(start.tolist())) == len(set(goal.tolist())) == 4
        assert min(start[2:].tolist() + goal[2:].tolist()) >= 2


def ring_with_a_spur():
    """A one-way ring 0, 6, 1, 2, 3, 4 with sides of 8 m, with 6 in the middle of 0 - 1, and 4 2.2 m before 0; 5 ends a spur from 1."""
    xy = [(0.0, 0.0), (8.0, 0.0), (8.0, 8.0), (0.0, 8.0), (0.0, 2.2), (16.0, 0.0), (4.0, 0.0)]
    return roads(xy, [(1, 5)], [(0, 6), (6, 1), (1, 2), (2, 3), (3, 4), (4, 0)], cell_m=8.0)


ALL = {0, 1, 2, 3, 4, 5, 6}


@pytest.mark.parametrize(
    ("vehicle", "starts", "goals"),
    [
        (CART, ALL, ALL),
        (TRICYCLE, ALL, ALL),  # backs out of the spur
        (CAR, ALL, ALL - {5}),  # would not come back from there
        (TUGGER, {4, 6}, ALL - {5}),  # trailers stand straight behind it, so at a corner it could not turn
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_vehicles_are_drawn_where_they_can_come_and_go(vehicle, starts, goals):
    stands = stands_of(ring_with_a_spur(), vehicle=vehicle)
    assert (set(stands.start.tolist()), set(stands.goal.tolist())) == (starts, goals)


def test_nobody_is_drawn_where_trailers_stand():
    graph = ring_with_a_spur()
    behind = [{v: u for v, (u,) in each.items()} for each in stands_of(graph, vehicle=TUGGER).behind]
    assert behind == [{4: 3, 6: 0}, {0: 4, 6: 0, 1: 6, 2: 1, 3: 2, 4: 3}]
    assert most_drawn(graph, 0, 1.0, vehicle=TUGGER) == 2
    for seed in range(9):
        for chosen, tows in zip(uniform_draw(graph, 2, seed, 1.0, vehicle=TUGGER), behind):
            assert len({*chosen.tolist(), *(tows[v] for v in chosen.tolist())}) == 4
        for chosen, tows in zip(draw_by_type([(TUGGER, graph), (CART, graph)], np.array([0, 1]), *np.full((2, 2), -1), seed, 1.0), behind):
            assert int(chosen[1]) not in (int(chosen[0]), tows[int(chosen[0])])
