"""Plans without clashes and rotations can be driven in their order; what clashes is what the resources say."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from truth import Rules, crowded_problem, rotates
from worlds import BURGER, cross, problem_on, square_grid

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.plan import plan_of_paths
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive.motion_plan import lanes_along
from mrp_sumo.errors import PlanError
from mrp_sumo.traffic.clashes import clashes_of, exclusive_vertices
from mrp_sumo.traffic.passages import order_of
from mrp_sumo.traffic.resources import needs_of
from mrp_sumo.traffic.schedule import check_order


def moves_of(graph):
    return [*zip(graph.tail.tolist(), graph.head.tolist()), *((v, v) for v in range(graph.num_vertices))]


def excluded(clashes, graph, move, other):
    """Whether the arrays say that two robots cannot make these moves at once, apart from the rules of MAPF."""
    vertices = clashes.vertex[clashes.vertex_first[move] : clashes.vertex_first[move + 1]]
    lanes = clashes.lane[clashes.lane_first[move] : clashes.lane_first[move + 1]]
    u, v = moves_of(graph)[other]
    return u in vertices or v in vertices or (other < graph.num_lanes and other in lanes)


@pytest.mark.parametrize("seed", range(12))
def test_moves_clash_where_they_need_one_zone_or_group(seed):
    problem = crowded_problem(seed)
    graph, rules, (clashes, _) = problem.graph, Rules(problem), clashes_of(problem)
    moves = moves_of(graph)
    for a, one in enumerate(moves):
        for b, other in enumerate(moves):
            if one[0] == other[0] or one[1] == other[1] or one == other[::-1]:
                continue  # the rules of MAPF
            assert excluded(clashes, graph, a, b) == rules.clash(one, other), (one, other)


@pytest.mark.parametrize("seed", range(12))
def test_vertices_exclude_each_other_where_two_robots_cannot_both_come_to_stand(seed):
    """Too near, in one group, or by no last move of one while the other stands; asked of all pairs and lanes."""
    problem = crowded_problem(seed)
    graph, rules, excludes = problem.graph, Rules(problem), exclusive_vertices(problem)
    for u, v in itertools.combinations(range(graph.num_vertices), 2):
        last = [(lane, stood) for lane in zip(graph.tail.tolist(), graph.head.tolist()) for stood in (u, v) if {lane[1], stood} == {u, v}]
        last = [(lane, stood) for lane, stood in last if lane[0] != stood]
        never = bool(last) and all(rules.clash(lane, (stood, stood)) for lane, stood in last)
        expected = rules.clash((u, u), (v, v)) or never
        assert (v in excludes.get(u, ())) == (u in excludes.get(v, ())) == expected, (u, v)


@pytest.mark.parametrize(("aside_m", "excluded"), [(0.1, True), (-0.1, False)])
def test_nobody_is_at_the_mouth_of_an_aisle_while_another_is_at_its_end_if_the_way_in_passes_too_near(aside_m, excluded):
    """Robots that need 1.1 m; the aisle leads 1.101 m down from 1, and the way to 1 comes from 0, a little from below or from above."""
    graph = nav_graph(name="aisle", xy=[(2.0, -aside_m), (0.0, 0.0), (0.0, -1.101)], lanes=[(0, 1), (1, 0), (1, 2), (2, 1)])
    fleet = fleet_of(RobotType("disc", 0.8, 0.6, 1.0, 1.0, 1.0, 1.0), 1)
    problem = replace(problem_on(plan_graph(graph, kind="roadmap", cell_m=1.0), [0], [1]), fleet=fleet)
    assert exclusive_vertices(problem) == ({1: frozenset({2}), 2: frozenset({1})} if excluded else {})


def random_walks(problem, rng, num_steps=30):
    """[T, R] robots that make any moves that the rules allow, now and then none."""
    rules, graph = Rules(problem), problem.graph
    path = [problem.start.tolist()]
    for _ in range(num_steps):
        at = path[-1]
        there = list(at)
        for robot in rng.permutation(problem.num_robots).tolist():
            if rng.random() < 0.8:
                lanes = graph.head[graph.first[at[robot]] : graph.first[at[robot] + 1]]
                if len(lanes):
                    tried = [*there[:robot], int(rng.choice(lanes)), *there[robot + 1 :]]
                    there = tried if rules.allow(at, tried) else there
        path.append(there)
    return np.array(path)


@pytest.mark.parametrize("seed", range(60))
def test_the_order_of_a_plan_without_clashes_can_be_kept(seed):
    problem = crowded_problem(seed, most_robots=4, num_vertices=10)
    path = random_walks(problem, np.random.default_rng(seed))
    plan = plan_of_paths(list(path.T), 1.0)
    needs = needs_of(problem.graph, plan, lanes_along(problem.graph, plan)[0], Rules(problem).found, problem.fleet.kind)
    check_order(problem, plan, order_of(plan, needs))


def test_a_plan_that_clashes_is_refused_somewhere():
    """The property above is not empty: without the rules about zones, orders cannot be kept."""
    refused = 0
    for seed in range(20):
        problem = crowded_problem(seed, most_robots=4, num_vertices=10)
        rules, rng = Rules(problem), np.random.default_rng(seed)
        rules.clash = lambda one, other: False
        path = [problem.start.tolist()]
        for _ in range(30):
            at, there = path[-1], list(path[-1])
            for robot in range(problem.num_robots):
                lanes = problem.graph.head[problem.graph.first[at[robot]] : problem.graph.first[at[robot] + 1]]
                tried = [*there[:robot], int(rng.choice(lanes)) if len(lanes) else at[robot], *there[robot + 1 :]]
                there = tried if rules.allow(at, tried) else there
            path.append(there)
        plan = plan_of_paths(list(np.array(path).T), 1.0)
        needs = needs_of(problem.graph, plan, lanes_along(problem.graph, plan)[0], rules.found, problem.fleet.kind)
        try:
            check_order(problem, plan, order_of(plan, needs))
        except PlanError:
            refused += 1
    assert refused > 5


def test_grids_that_robots_fit_on_have_no_clashes():
    problem = replace(problem_on(square_grid(3), [0], [8]), fleet=fleet_of(BURGER, 1), drivable=True)
    clashes, _ = clashes_of(problem)
    assert not clashes.any and not clashes.rotations
    assert clashes_of(replace(problem, drivable=False))[0].rotations


@pytest.mark.parametrize(("side_m", "fits"), [(0.21, True), (0.215, False)])
def test_grids_that_robots_do_not_fit_on_have_clashes(side_m, fits):
    """Cells of 0.4 m, and squares with 0.1 m between the circles around them."""
    robot = replace(BURGER, length_m=side_m, width_m=side_m)
    assert fleet_of(robot, 1).separation_m == pytest.approx(0.397 if fits else 0.404, abs=1e-3)
    problem = replace(problem_on(square_grid(3), [0], [8]), fleet=fleet_of(robot, 1), drivable=True)
    assert clashes_of(problem)[0].any != fits


def test_robots_on_the_arms_of_a_cross_do_not_clash():
    problem = replace(problem_on(cross(), [0], [1]), fleet=fleet_of(BURGER, 1), drivable=True)
    assert not clashes_of(problem)[0].any


def test_rotations_are_rings_of_three_or_more():
    assert rotates([0, 1, 2], [1, 2, 0]) and not rotates([0, 1, 2], [1, 2, 3])
