"""Who is where and when: bits against paths written out, robots that a search disturbs counted again, conflicts against all pairs."""

from itertools import permutations

import numpy as np
import pytest
from truth import ROBOT

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph
from mrp_sumo.core.problem import Problem
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.maps.roadmap import cut_lanes
from mrp_sumo.search import _records as st
from mrp_sumo.search._conflicts import CLASH, CONFLICT, FOLLOW, MEET, SWAP, TARGET, conflicts_of
from mrp_sumo.search._constraints import load
from mrp_sumo.search._occupancy import MANY, ONE, WORD, install_all, steps_known, uninstall
from mrp_sumo.search._space_time import FINISH, TreeTables, find_path
from planners.conflict_based.tree import SearchLimits, Tree

pytestmark = pytest.mark.kernel


def root_of(free, start, goal, *, following=False):
    """A tree, and its root, in which paths collide."""
    robots = np.arange(len(start))
    problem = Problem(grid_graph(free, 1.0, (0.0, 0.0)), fleet_of(ROBOT, len(start)), np.array(start), np.array(goal), robots, 1.0)
    tree = Tree(problem, SearchLimits(np.inf, 4000), following=following)
    return tree, tree.root(1.0)


def path_of(store, record):
    begin, cost = store.meta[record].path0, store.meta[record].cost
    return store.path["vertex"][begin : begin + cost + 1].tolist()


def at(path, step):
    return path[min(step, len(path) - 1)]


def counted_on(paths, occupancy):
    """[V, T] how many robots on their way are at each vertex and step."""
    count = np.zeros((len(occupancy.since), steps_known(occupancy)), int)
    for path in paths:
        for t, v in enumerate(path[:-1]):
            count[v, t] += 1
    return count


def by_bits(occupancy):
    """[V, T] 0, 1, or 2 for more than one, as the bits say."""
    steps = np.arange(WORD, dtype=np.uint64)
    bits = [(occupancy.busy[:, None] >> steps) & one for one in (ONE, MANY)]
    return np.reshape([bit > 0 for bit in bits], (2, len(occupancy.since), -1)).sum(axis=0)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_bits_tell_none_one_and_more_however_robots_leave(order):
    """Three robots cross the middle of a plus at the same step."""
    plus = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], bool)
    tree, root = root_of(plus, [0, 1, 3], [4, 3, 1])
    store, occupancy = tree._buffers.store, tree._buffers.occupancy
    paths = [path_of(store, record) for record in root.records]
    assert [path[1] for path in paths] == [2, 2, 2]
    install_all(store, occupancy, root.records, -1)
    there = list(range(3))
    for robot in [None, *order]:
        if robot is not None:
            uninstall(store, occupancy, robot)
            there.remove(robot)
        assert np.array_equal(by_bits(occupancy), np.minimum(counted_on([paths[r] for r in there], occupancy), 2))


@pytest.mark.parametrize("following", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_search_disturbs_as_many_as_can_be_counted_on_its_path(seed, following):
    chance = np.random.default_rng(seed)
    tree, root = root_of(np.ones((5, 5), bool), chance.permutation(25)[:14], chance.permutation(25)[:14], following=following)
    store, occupancy, scratch = tree._buffers.store, tree._buffers.occupancy, tree._buffers.scratch
    paths = [path_of(store, record) for record in root.records]
    seen = 0
    for robot, record in enumerate(root.records.tolist()):
        install_all(store, occupancy, root.records, -1)
        uninstall(store, occupancy, robot)
        assert load(tree.instance, store, scratch, record) == st.OK
        least = int(tree.instance.distance[robot, tree.instance.start[robot]])
        code, end = find_path(TreeTables(tree.instance, store, occupancy, scratch), robot, least, least + 2, False, 1 << 20)
        assert code == st.OK
        state = scratch.state
        if state[end].label & 3 == FINISH:  # counts besides who comes to the goal later
            end = state[end].before
        disturbed, mine = state[end].label >> 2, []
        while end >= 0:
            mine.insert(0, int(state[end].vertex))
            end = state[end].before
        counted = 0
        for other in (path for k, path in enumerate(paths) if k != robot):
            for t in range(len(mine) - 1):
                u, v, was, now = mine[t], mine[t + 1], at(other, t), at(other, t + 1)
                counted += now == v
                if u != v:
                    counted += was == v and (now == u or (following and now != v))
                    counted += following and now == u and was != v and t + 2 < len(other)  # who ends there is not looked for
        assert disturbed == counted
        seen += counted
    assert seen > 0


def by_hand(paths, robot, following):
    """Conflicts of one robot as (one, other, kind, tail, at, step)."""
    expected, mine = set(), paths[robot]
    for other, path in enumerate(paths):
        for t in range(max(map(len, paths))) if other != robot else ():
            (u, v), (x, y) = ((at(each, max(t - 1, 0)), at(each, t)) for each in (mine, path))
            if v == y:
                stays = [r for r, each in ((robot, mine), (other, path)) if t >= len(each) - 1]
                pair = (stays[0], robot + other - stays[0]) if stays else (min(robot, other), max(robot, other))
                expected.add((*pair, TARGET if stays else MEET, -1, v, t))
            if u != v and x != y and not following and (u, v) == (y, x):
                expected.add((robot, other, SWAP, u, v, t) if robot < other else (other, robot, SWAP, v, u, t))
            if u != v and following and x == v != y:
                expected.add((other, robot, FOLLOW, -1, v, t - 1))
            if u != v and following and y == u != x != v:
                expected.add((robot, other, FOLLOW, -1, u, t - 1))
    return expected


@pytest.mark.parametrize("following", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_conflicts_are_those_of_every_pair_at_every_step(seed, following):
    chance, kinds = np.random.default_rng(seed), set()
    tree, root = root_of(np.ones((5, 5), bool), chance.permutation(25)[:14], chance.permutation(25)[:14], following=following)
    store, occupancy = tree._buffers.store, tree._buffers.occupancy
    paths = [path_of(store, record) for record in root.records]
    for robot, record in enumerate(root.records.tolist()):
        install_all(store, occupancy, root.records, -1)
        uninstall(store, occupancy, robot)
        rows = conflicts_of(tree.instance, store, occupancy, robot, record, np.empty(0, CONFLICT))
        listed = [tuple(row[name].item() for name in ("one", "other", "kind", "tail", "at", "step")) for row in rows]
        assert set(listed) == by_hand(paths, robot, following) and len(set(listed)) == len(listed)
        kinds |= {conflict[2] for conflict in listed}
    assert kinds == {MEET, TARGET, FOLLOW if following else SWAP}


@pytest.mark.parametrize(("start", "conflicts"), [([0, 2], [(0, 1, CLASH, 1)]), ([0, 4], [])])
def test_lanes_that_cross_are_in_conflict_where_they_are_driven_in_the_same_step(start, conflicts):
    """Robot 0 goes from 0 to 1, robot 1 from 2 to 3 across, in the same step, or one later, when it has come to 2 from 4."""
    nav = nav_graph(name="cross", xy=[(-1, -1), (1, 1), (-1, 1), (1, -1), (-3, 1)], lanes=[(0, 1), (2, 3), (4, 2)])
    problem = Problem(cut_lanes(nav, 3.0), fleet_of(ROBOT, 2), np.array(start), np.array([1, 3]), np.arange(2), 3.0, drivable=True)
    tree = Tree(problem, SearchLimits(np.inf, 4000))
    root = tree.root(1.0)
    store, occupancy = tree._buffers.store, tree._buffers.occupancy
    for robot in range(2):
        install_all(store, occupancy, root.records, robot)
        rows = conflicts_of(tree.instance, store, occupancy, robot, int(root.records[robot]), np.empty(0, CONFLICT))
        assert [tuple(row[name].item() for name in ("one", "other", "kind", "step")) for row in rows] == conflicts


def test_a_search_without_room_for_its_states_says_so_and_writes_no_further():
    tree, root = root_of(np.ones((5, 5), bool), [0, 4], [24, 20])
    store, occupancy, scratch = tree._buffers.store, tree._buffers.occupancy, tree._buffers.scratch
    install_all(store, occupancy, root.records, 0)
    record, codes = int(root.records[0]), []
    for room in range(4, 200, 3):
        assert load(tree.instance, store, scratch, record) == st.OK
        scratch.state[room:].fill((-7,) * 6)
        small = TreeTables(tree.instance, store, occupancy, scratch._replace(state=scratch.state[:room]))
        codes.append(find_path(small, 0, 8, 10, False, 1 << 20)[0])
        assert (scratch.state[room:]["vertex"] == -7).all()
    assert codes == sorted(codes, reverse=True) and {*codes} == {st.OK, st.SCRATCH_FULL}


@pytest.mark.parametrize(("rows", "hurry", "cost"), [(2, False, 9), (2, True, 9), (4, False, 13), (4, True, 7)])
def test_in_a_hurry_a_robot_is_disturbed_rather_than_a_long_way_round_taken(rows, hurry, cost):
    """Robot 1 stands on the side of 7 steps of a block; past it, or the other way round, it takes 2 steps more, or 6."""
    free = np.ones((rows, 8), bool)
    free[1:-1, 1:-1] = False
    tree, root = root_of(free, [0, 3], [7, 3])
    store, occupancy, scratch = tree._buffers.store, tree._buffers.occupancy, tree._buffers.scratch
    install_all(store, occupancy, root.records, 0)
    assert load(tree.instance, store, scratch, int(root.records[0])) == st.OK
    code, end = find_path(TreeTables(tree.instance, store, occupancy, scratch), 0, 7, 20, hurry, 1 << 20)
    assert code == st.OK and (scratch.state[end].step, scratch.state[end].label >> 2) == (cost, int(cost == 7))
