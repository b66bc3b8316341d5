"""Ways between places, past those that are blocked, beside what networkx finds on drawn floors of a few vertices."""

import networkx as nx
import numpy as np
import pytest
from worlds import graph_of, problem_on

from mrp_sumo.core.task import Station, Stop
from mrp_sumo.drive.places import RobotPlaces, _before
from mrp_sumo.search.distance import UNREACHABLE

SEEDS = pytest.mark.parametrize("seed", range(25))


def floor(seed):
    """Places of one robot on a floor of seven vertices, most lanes of which lead one way, the same for networkx, and chance."""
    chance = np.random.default_rng(seed)
    edges = [tuple(int(v) for v in pair) for pair in np.argwhere(chance.random((7, 7)) < 0.28) if pair[0] != pair[1]]
    graph = graph_of([(float(v % 3), float(v // 3)) for v in range(7)], [], 1.0, one_way=edges)
    return RobotPlaces(problem_on(graph, [0], [0]), ()), nx.DiGraph([*edges, *((v, v) for v in range(7))]), chance


def without(paths, vertices, leaves=()):
    """The floor without the lanes to some vertices, and from some."""
    return nx.DiGraph([(u, v) for u, v in paths.edges if (v not in vertices or u == v) and (u not in leaves or u == v)])


def some(chance, most, *but):
    return {int(v) for v in chance.permutation(7)[: chance.integers(most + 1)]} - set(but)


@SEEDS
def test_steps_past_what_is_blocked(seed):
    places, paths, chance = floor(seed)
    for at in range(7):
        blocked = some(chance, 3)
        steps = nx.single_source_shortest_path_length(without(paths, blocked), at)
        assert places._reach(0, at, blocked).tolist() == [steps.get(v, UNREACHABLE) for v in range(7)]


@SEEDS
def test_a_way_is_shortest_and_passes_who_is_blocked_only_where_every_way_does(seed):
    places, paths, chance = floor(seed)
    for start, end in np.argwhere(~np.eye(7, dtype=bool)).tolist():
        blocked = some(chance, 2)
        if not nx.has_path(paths, start, end):
            continue
        clear = without(paths, blocked - {end}) if end not in blocked else without(paths, blocked)
        least = clear if nx.has_path(clear, start, end) else paths
        path = places._way(0, start, end, blocked)
        assert (path[0], path[-1]) == (start, end) and nx.is_path(least, path)
        assert len(path) - 1 == nx.shortest_path_length(least, start, end)


@SEEDS
def test_whether_a_robot_can_come_to_a_stop_and_off_anothers_route(seed):
    places, paths, chance = floor(seed)
    for at in range(7):
        blocked, ends = some(chance, 3), some(chance, 2) | {int(chance.integers(7))}
        stop = Stop(min(ends), 1.0, "", Station("s", tuple(sorted(ends))))
        reached = nx.descendants(without(paths, blocked - {at}), at) | {at}
        assert places.can_come(0, at, stop, blocked) == bool(reached & ends)
        route = [int(v) for v in chance.permutation(7)[:3]]
        aside = nx.descendants(without(paths, blocked | {route[0], route[-1]}), at) | {at}
        assert places.can_let_pass(0, at, route, blocked) == bool(aside - blocked - set(route))


@SEEDS
def test_who_is_served_gets_out_past_one_that_waits_to_where_that_one_can_come_from(seed):
    places, paths, chance = floor(seed)
    for place, vertex in np.argwhere(~np.eye(7, dtype=bool)).tolist():
        if not nx.has_path(paths, vertex, place):
            continue
        waits = some(chance, 2, place)
        out = nx.descendants(without(paths, waits | {vertex}), place) | {place}
        back = nx.ancestors(without(paths, {place}, {place}), vertex) | {vertex}
        clear = out - set(places._way(0, vertex, place))
        assert places._leaves_way_out(0, place, vertex, waits) == bool(clear & back)
    assert not places._leaves_way_out(0, 3, 3, set())


@pytest.mark.parametrize(("routes", "steps", "before"), [
    ([[5, 4, 3]], [0, 1, 2, 3, 4, 5], set()),  # it is at 3 after three steps, the other after two
    ([[5, 4, 3]], [0, 1, 2, 2, 4, 5], {3}),
    ([[5, 4, 3]], [9, 9, 9, 2, 1, 9], {3, 4}),
    ([[5, 4, 3], [2, 1]], [9, 1, 0, 9, 9, 9], {1, 2}),
    ([[5, 0, 3]], [0, 9, 9, 9, 9, 9], {5, 0, 3}),  # it stands on it
    ([], [0] * 6, set()),
])  # fmt: skip
def test_where_a_robot_would_be_before_others_on_their_ways(routes, steps, before):
    assert _before(0, routes, np.array(steps)) == before
