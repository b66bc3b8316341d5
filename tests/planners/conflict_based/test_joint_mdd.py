"""What the joint MDD says of two robots, against all their paths and the slow search of joint states."""

import numpy as np
import pytest
from truth import least_cost, random_problem

from mrp_sumo.planning.answers import impossible
from mrp_sumo.search import _records as st
from mrp_sumo.search._mdd import mdd_of
from planners.conflict_based._joint_mdd import APART, LOST, TOGETHER, joint_paths
from planners.conflict_based.tree import SearchLimits, Tree


def meeting(seed, *, following):
    """Two robots' tree and root, and what the joint MDD says of them; None where they do not meet, or one cannot arrive."""
    problem = random_problem(seed, most_robots=2, side=5)
    if problem.num_robots < 2 or impossible(problem) is not None:
        return None
    tree = Tree(problem, SearchLimits(60.0, 1000), following=following)
    root = tree.root()
    store, scratch = tree._buffers.store, tree._buffers.scratch
    for record in root.records:
        assert mdd_of(tree.instance, store, scratch, record) == st.OK
    code, *output = joint_paths(tree.instance, store, scratch, *root.records)
    assert code == st.OK
    return problem, tree, root, output


def check(seed, *, following):
    """Hold the answer against the truth; what it was."""
    output = meeting(seed, following=following)
    if output is None:
        return None
    problem, tree, root, (result, row0, middle, row1) = output
    best = least_cost(problem, following=following)
    assert (result == LOST) == (best is None or best > root.cost), (seed, result, best)
    assert tree._pair_weight(*root.records) <= (np.inf if best is None else best - root.cost), seed
    if result == LOST:
        rows = tree._buffers.store.rows[row0:row1].tolist()
        for side in (rows[: middle - row0], rows[middle - row0 :]):
            assert side
        mine, theirs = (paths(problem, robot, 2) for robot in range(2))
        barred = [broken(path, rows[: middle - row0]) for path in mine], [broken(path, rows[middle - row0 :]) for path in theirs]
        for one in (path for path, bad in zip(mine, barred[0]) if bad):
            for other in (path for path, bad in zip(theirs, barred[1]) if bad):
                assert collide(one, other, following), (seed, one, other)
    return result


def paths(problem, robot, more):
    """All paths of a robot to where it stays, of up to so many steps more than its shortest; trailing waits are not part of one."""
    graph, goal = problem.graph, problem.target[robot]
    result, ends = [], [[int(problem.start[robot])]]
    most = None
    for length in range(12):
        arrived = [path for path in ends if path[-1] == goal and (len(path) == 1 or path[-2] != goal)]
        result += arrived
        if arrived and most is None:
            most = length + more
        if length == most or len(ends) > 3000:
            break
        ends = [[*path, int(v)] for path in ends for v in (*graph.head[graph.first[path[-1]] : graph.first[path[-1] + 1]], path[-1])]
    return result


def broken(path, rows):
    """Whether a path does not keep a side's constraints."""
    for kind, v, _, begin, end in rows:
        if kind == st.MIN_COST:
            if len(path) - 1 < begin:
                return True
        else:
            assert (kind, begin) == (st.RANGE, end)
            if path[min(begin, len(path) - 1)] == v:
                return True
    return False


def collide(one, other, following):
    for t in range(1, max(len(one), len(other))):
        (a, b), (c, d) = ((path[min(t - 1, len(path) - 1)], path[min(t, len(path) - 1)]) for path in (one, other))
        if b == d or (a == d and b == c) or (following and (a == d or b == c)):
            return True
    return False


@pytest.mark.parametrize("following", [False, True])
def test_robots_are_lost_where_all_shortest_paths_collide_and_no_plan_breaks_both_sides(following):
    result = {check(seed, following=following) for seed in range(150)}
    assert {LOST, TOGETHER} <= result  # the questions are not all alike


@pytest.mark.campaign
@pytest.mark.parametrize("following", [False, True])
def test_robots_are_lost_where_all_shortest_paths_collide_on_thousands(following):
    result = {check(seed, following=following) for seed in range(1000, 6000)}
    assert {APART, LOST, TOGETHER} <= result
