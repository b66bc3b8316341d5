"""PIBT: kernels against the algorithm in plain Python, steps against what is allowed."""

from dataclasses import replace

import numpy as np
import pytest
from plain_pibt import Step
from worlds import corridor, graph_of, line, problem_on, random_grid

from mrp_sumo.core.plan import paths_of_plan
from mrp_sumo.search.distance import steps_to_targets
from planners.configuration import _pibt
from planners.configuration.pibt import Pibt
from planners.world import ByConfigurations, build_world


@pytest.fixture(scope="module", autouse=True)
def compiled():
    Pibt().prepare()


def stepping(problem, *, packed=False, hindrance=False):
    """World and scratch for PIBT's steps."""
    world, _ = build_world(problem, np.inf, packed=packed, rules=ByConfigurations(hindrance=hindrance))
    return world, _pibt.room_for_step(world)


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_a_step_of_pibt_moves_everybody_without_collision(seed, packed):
    problem = random_grid(10, 40, seed)
    (world, scratch), rng = stepping(problem, packed=packed, hindrance=True), np.random.default_rng(seed)
    here, order = problem.start.copy(), np.arange(40)
    lanes = set(zip(problem.graph.tail.tolist(), problem.graph.head.tolist(), strict=True))
    for _ in range(30):
        to = np.full(40, -1)
        assert _pibt.step(world, scratch, here, to, order, rng)
        assert len(set(to.tolist())) == 40
        moves = {(a, b) for a, b in zip(here.tolist(), to.tolist(), strict=True) if a != b}
        assert moves <= lanes
        assert not {(b, a) for a, b in moves} & moves
        assert (scratch.now == -1).all() and (scratch.next == -1).all()
        here = to


def test_imposed_vertices_are_kept_or_refused():
    problem = problem_on(corridor(3), [0, 1], [2, 0])
    (world, scratch), rng = stepping(problem), np.random.default_rng(0)
    to = np.array([0, -1])
    assert _pibt.step(world, scratch, problem.start, to, np.arange(2), rng)
    assert to[0] == 0
    assert not _pibt.step(world, scratch, problem.start, np.array([1, 0]), np.arange(2), rng)  # a swap
    assert not _pibt.step(world, scratch, problem.start, np.array([1, 1]), np.arange(2), rng)
    assert (scratch.now == -1).all() and (scratch.next == -1).all()


def neighbours_and_steps(problem):
    """[V] lists of neighbours and [R][V] steps to the goals."""
    graph = problem.graph
    neighbours = [graph.head[graph.first[v] : graph.first[v + 1]].tolist() for v in range(graph.num_vertices)]
    return neighbours, steps_to_targets(problem).tolist()


@pytest.mark.parametrize("seed", range(20))
def test_kernels_choose_what_the_algorithm_in_plain_python_chooses(seed):
    if seed < 10:
        problem = random_grid(9, 10 + 4 * seed, seed, blocked=0.1 + 0.02 * seed)
    else:  # narrow, so that robots have to swap
        graph = random_grid(9, 2, seed, blocked=0.42).graph
        draw = np.random.default_rng([seed, 7])
        num_robots = min(seed - 6, graph.num_vertices)
        problem = problem_on(graph, draw.permutation(graph.num_vertices)[:num_robots], draw.permutation(graph.num_vertices)[:num_robots])
    (world, scratch), rng, same_rng = stepping(problem), np.random.default_rng(seed), np.random.default_rng(seed)
    neighbours, steps = neighbours_and_steps(problem)
    here, order = problem.start.copy(), np.arange(problem.num_robots)
    for _ in range(60):
        to = np.full(problem.num_robots, -1)
        assert _pibt.step(world, scratch, here, to, order, rng)
        step = Step(neighbours, steps, problem.target.tolist(), here.tolist(), same_rng.random)
        assert step.choose(order.tolist()) == to.tolist()
        here = to
        _pibt.reorder(world, here, order, order)


def test_two_robots_in_a_corridor_swap_at_its_fork():
    """0 - 1 - 2 - 3, and 4 beside 1: the robot on 1 wants to 3, the one on 2 to 0."""
    neighbours = [[1], [0, 2, 4], [1, 3], [2], [1]]
    steps = [[3, 2, 1, 0, 3], [0, 1, 2, 3, 2]]
    here, rng = [1, 2], np.random.default_rng(0)
    for _ in range(20):
        here = Step(neighbours, steps, [3, 0], here, rng.random).choose([0, 1])
    assert here == [3, 0]


def after(graph, starts, goals, steps):
    """[R] where robots are that PIBT has moved for so many steps."""
    problem = replace(problem_on(graph, starts, goals), window_steps=steps)
    return [int(path[-1]) for path in paths_of_plan(Pibt().plan(problem, 60.0).plan, 1.0)]


def test_of_two_with_one_goal_in_a_row_neither_makes_way_for_the_other():
    """Both want to cell 1 by way of 5, beside which are 6 and 7."""
    xy, row = [(i, 0) for i in range(6)], [(i, i + 1) for i in range(5)]
    assert 1 in after(graph_of([*xy, (5, 1), (5, -1)], [*row, (5, 6), (5, 7)], 1.0), [5, 6], [1, 1], 8)


def test_robots_swap_while_another_stands_at_a_stop():
    """0 - 1 - 2 - 3, with 4 beside 1; nobody may come to 5, where one stands who is not asked, and from where a lane leads to 3."""
    graph = graph_of([(0, 0), (1, 0), (2, 0), (3, 0), (1, 1), (4, 0)], [(0, 1), (1, 2), (2, 3), (1, 4)], 1.0, one_way=[(5, 3)])
    assert after(graph, [1, 2], [3, 0], 20) == [3, 0]


@pytest.mark.parametrize(("since_s", "ends"), [([0.0, 1.0], [5, 6]), ([1.0, 0.0], [0, 1]), (None, [2, 3])])
def test_who_has_had_its_goal_for_longest_keeps_its_priority_from_window_to_window(since_s, ends):
    """Two meet on a line of seven, where nobody can pass. The farther one first, they push each other to and fro."""
    here = [2, 4]
    for _ in range(12):
        problem = replace(problem_on(line(7), here, [5, 1]), window_steps=1, since_s=None if since_s is None else np.array(since_s))
        here = [int(path[-1]) for path in paths_of_plan(Pibt().plan(problem, 60.0).plan, 1.0)]
    assert here == ends


def test_who_stands_in_a_group_leaves_it_for_one_that_pushes():
    """On a one-way ring, of which vertices 2 and 3 are a group: the robot at 1 chooses first and waits, the one at 2 drives on."""
    ring = graph_of([(np.cos(k * np.pi / 4), np.sin(k * np.pi / 4)) for k in range(8)], (), one_way=[(k, (k + 1) % 8) for k in range(8)])
    grouped = replace(ring, vertex_options=tuple({"mutex": "machine"} if v in (2, 3) else {} for v in range(8)))
    problem = replace(problem_on(grouped, [1, 2], [4, 6]), drivable=True)
    (world, scratch), here, rng = stepping(problem), problem.start.copy(), np.random.default_rng(0)
    for _ in range(3):
        to = np.full(2, -1)
        assert _pibt.step(world, scratch, here, to, np.arange(2), rng)
        here = to
    assert here.tolist() == [2, 5]
