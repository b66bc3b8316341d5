"""A path under constraints costs the least there is and disturbs fewest, and MDDs hold all such paths: against every path written out."""

from itertools import pairwise

import numpy as np
import pytest
from truth import ROBOT

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.problem import Problem
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.search import _records as st
from mrp_sumo.search._mdd import mdd_of, only, raises_cost
from mrp_sumo.search._space_time import ReplanEffort
from planners.conflict_based.tree import SearchLimits, Tree

pytestmark = pytest.mark.kernel

HORIZON = 26  # beyond all that constraints ask for here


def drawn(chance, num_robots=6, *, free=True):
    """A tree of robots that start and end anywhere, its root, and some constraints on the last of them."""
    cells = np.ones((3, 4), bool)
    cells[1, 1] = free
    graph = grid_graph(cells, 1.0, (0.0, 0.0))
    start, goal = (chance.permutation(graph.num_vertices)[:num_robots] for _ in range(2))
    tree = Tree(Problem(graph, fleet_of(ROBOT, num_robots), start, goal, np.arange(num_robots), 1.0), SearchLimits(np.inf, 4000))
    return tree, tree.root(1.0), rows_on(chance, graph, int(start[-1]), int(goal[-1]))


def rows_on(chance, graph, start, goal):
    """Constraints as (kind, vertex, tail, begin, end)."""
    rows = []
    for _ in range(chance.integers(1, 9)):
        lane, begin = chance.integers(graph.num_lanes), int(chance.integers(0, 9))
        end = int(chance.choice([begin, begin, begin + 2, begin + 6, st.FOREVER], p=[0.3, 0.3, 0.2, 0.15, 0.05]))
        tail, head = int(graph.tail[lane]), int(graph.head[lane])
        rows.append((st.RANGE, head, -1, begin + (head == start), end) if chance.random() < 0.6 else (st.EDGE, head, tail, begin, end))
    if chance.random() < 0.3:
        rows.append((st.MIN_COST, goal, -1, int(chance.integers(1, 12)), 0))
    if chance.random() < 0.4:
        step = int(chance.integers(1, 9))
        rows.append((st.MUST, int(graph.head[chance.integers(graph.num_lanes)]), -1, step, step))
    return rows


def allowed(rows, u, v, t):
    for kind, vertex, tail, begin, end in rows:
        if begin <= t <= end and ((kind == st.RANGE and vertex == v) or (kind == st.EDGE and (tail, vertex) == (u, v))):
            return False
        if kind == st.MUST and t == begin and vertex != v:
            return False
    return True


def ends_from(rows, goal):
    """The first step from which a robot may have ended at its goal."""
    first = 0
    for kind, vertex, _, begin, end in rows:
        if kind == st.MIN_COST:
            first = max(first, begin)
        elif (kind == st.RANGE and vertex == goal) or (kind == st.MUST and vertex != goal):
            first = max(first, end + 1)
    return first


def disturbed(others, u, v, t):
    """Robots on paths that a move, or a wait, to step t is in conflict with."""
    at = lambda path, step: path[min(step, len(path) - 1)]  # noqa: E731
    return sum((at(path, t) == v) + (u != v and at(path, t - 1) == v and at(path, t) == u) for path in others)


def truth(graph, start, goal, rows, others, w):
    """(cost, robots disturbed) of the path that disturbs fewest, then costs least, of those that cost at most w times the least."""
    if not allowed(rows, start, start, 0):
        return None
    best = {start: 0}  # robots disturbed on the way to each vertex, at a step
    ends, least = [], np.inf
    for t in range(HORIZON):
        if goal in best and t >= ends_from(rows, goal):
            least = min(least, t)
            later = sum(path[t:-1].count(goal) for path in others)
            ends += [(best[goal] + later, t)] * (t <= w * least + 1e-9)
        after = {}
        for u, num in best.items():
            for v in (*graph.head[graph.first[u] : graph.first[u + 1]].tolist(), u):
                if allowed(rows, u, v, t + 1):
                    after[v] = min(after.get(v, np.inf), num + disturbed(others, u, v, t + 1))
        best = after
    return (*min(ends)[::-1], least) if ends else None


@pytest.mark.parametrize("seed", range(120))
def test_a_robot_is_replanned_at_the_least_cost_and_disturbs_fewest(seed):
    chance = np.random.default_rng([seed, 3])
    tree, root, rows = drawn(chance, free=seed % 2 == 0)
    robot, w, graph = tree.num_robots - 1, (1.0, 1.0, 1.5)[seed % 3], tree.problem.graph
    made = tree._replanned(root, robot, tree._rows(rows), ReplanEffort(w, 0, 1000, 1 << 20))
    paths = [path.tolist() for path in tree.paths(root)]
    start, goal = paths[robot][0], int(tree.problem.goal[robot])
    expected = truth(graph, start, goal, rows, paths[:robot], w)
    assert (made is None) == (expected is None)
    if made is None:
        return
    meta = tree._buffers.store.meta[made[0]]
    mine = tree._buffers.store.path["vertex"][meta.path0 : meta.path0 + meta.cost + 1].tolist()
    assert mine[0] == start and mine[-1] == goal and all(allowed(rows, u, v, t) for t, (u, v) in enumerate(pairwise(mine), 1))
    later = sum(path[meta.cost : -1].count(goal) for path in paths[:robot])
    num = sum(disturbed(paths[:robot], u, v, t) for t, (u, v) in enumerate(pairwise(mine), 1)) + later
    assert (meta.cost, num, meta.bound) == expected


def levels_of(graph, start, goal, rows, cost):
    """The vertices at which a path of a cost can be at each step."""
    there = [{start} if allowed(rows, start, start, 0) else set()]
    moves = {v: (*graph.head[graph.first[v] : graph.first[v + 1]].tolist(), v) for v in range(graph.num_vertices)}
    for t in range(1, cost + 1):
        there.append({v for u in there[-1] for v in moves[u] if allowed(rows, u, v, t)})
    there[-1] &= {goal} if cost >= ends_from(rows, goal) else set()
    for t in range(cost - 1, -1, -1):
        there[t] = {u for u in there[t] if any(v in there[t + 1] and allowed(rows, u, v, t + 1) for v in moves[u])}
    return there


@pytest.mark.parametrize("seed", range(60))
def test_an_mdd_holds_all_paths_of_the_least_cost_and_tells_whether_constraints_cut_them(seed):
    chance = np.random.default_rng([seed, 4])
    tree, root, rows = drawn(chance, 3)
    robot, graph = tree.num_robots - 1, tree.problem.graph
    made = tree._replanned(root, robot, tree._rows(rows), ReplanEffort(1.0, 0, 0, 1 << 20))
    if made is None:
        return
    store, scratch, record = tree._buffers.store, tree._buffers.scratch, made[0]
    assert mdd_of(tree.instance, store, scratch, record) == st.OK
    start, goal, cost = int(tree.problem.start[robot]), int(tree.problem.goal[robot]), int(store.meta["cost"][record])
    level = store.level[store.meta["mdd0"][record] :]
    output = [sorted(store.member[level[t] : level[t + 1]].tolist()) for t in range(cost + 1)]
    expected = levels_of(graph, start, goal, rows, cost)
    assert output == [sorted(each) for each in expected] and store.meta["bound"][record] == cost
    for t in range(cost + 3):
        each = expected[min(t, cost)]
        assert only(store, record, t) == (min(each) if len(each) == 1 else -1)
    for _ in range(8):
        more = rows_on(chance, graph, start, goal)
        more = [row for row in more if row[0] != st.MUST or row[3] <= cost]  # where it is after its end is not looked at
        begin, end = tree._rows(more)
        cut = raises_cost(tree.instance, tree._buffers.store, scratch, record, begin, end)
        assert cut == (not levels_of(graph, start, goal, rows + more, cost)[0] if expected[0] else False), more
