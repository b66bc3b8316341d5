"""First paths: prioritised, the short ones first, and repaired."""

import numpy as np
import pytest
from worlds import on_a_circle, problem_on, random_grid

from mrp_sumo.core.plan import paths_of_plan, plan_of_paths
from mrp_sumo.traffic.referee import judge
from planners.configuration.lacam import Lacam
from planners.neighbourhood.refinement import first_paths, task_on
from planners.world import ByConfigurations, build_world, search_start

pytestmark = pytest.mark.kernel


def paths_for(problem, packed=False, effort=0, memory_mb=100):
    world, _ = build_world(problem, np.inf, packed=packed)
    path, labels = first_paths(task_on(problem, world), np.random.default_rng(1), np.inf, effort, memory_mb)
    return path, labels, world.steps


def is_valid(problem, path):
    return judge(problem, plan_of_paths(list(path.T), 1.0)).valid


def test_paths_past_each_other_are_valid_and_hardly_longer_than_shortest_ones():
    cost = least = 0
    for seed in range(5):
        problem = random_grid(16, 20, seed, 0.1)
        path, _, steps = paths_for(problem)
        assert is_valid(problem, path)
        assert (paths_for(problem, packed=True)[0] == path).all()
        cost += sum(len(p) - 1 for p in paths_of_plan(plan_of_paths(list(path.T), 1.0), 1.0))
        least += int(steps.sum())
    assert cost < 1.03 * least


def test_robot_that_stays_in_a_corridor_lets_those_pass_that_have_to():
    lanes = [(a, b) for i in range(40) for a, b in ((i, i + 1), (i + 1, i))] + [(2, 41), (41, 2)]
    problem = problem_on(on_a_circle(lanes, 42), [41, 0], [3, 40])  # robot 0 would be at 3 first, for good
    path, *_ = paths_for(problem)
    assert is_valid(problem, path)
    assert path[-1].tolist() == [3, 40] and len(path) - 1 == 40


def test_search_that_takes_too_much_work_or_memory_or_finds_long_paths_ends_without_paths():
    assert paths_for(random_grid(8, 20, 3))[0] is None  # a crowd: paths around each other are long
    problem = random_grid(16, 20, 3, 0.1)
    assert paths_for(problem)[0] is not None
    path, labels, _ = paths_for(problem, effort=5)
    assert path is None and labels > 5
    assert paths_for(problem, memory_mb=0)[0] is None


def test_lacam_takes_such_paths_for_its_first_solution_where_the_map_is_used_thinly():
    thin = random_grid(12, 10, 1)

    def easy(problem, world, rng, until_s):
        return first_paths(task_on(problem, world), rng, until_s, effort=0, memory_mb=100)

    start = search_start(ByConfigurations(), thin, np.inf, 0, None, easy)
    assert is_valid(thin, start.path)
    result = Lacam(polish=0).plan(thin, 10.0)
    assert result.stats["expansions"] == 0 and judge(thin, result.plan).valid
    ring = on_a_circle([(i, (i + 1) % 4) for i in range(4)], 4)
    assert Lacam().plan(problem_on(ring, [0, 1, 2, 3], [1, 2, 3, 0]), 10.0).stats["expansions"] > 0  # a crowd
