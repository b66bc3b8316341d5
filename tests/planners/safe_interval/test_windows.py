"""Priority-based search in windows: by all stops ahead, without collisions, and short."""

from dataclasses import replace

import numpy as np
from worlds import ending_there, line, problem_on, square_grid

from mrp_sumo.core.plan import Status, paths_of_plan
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.referee import judge


def test_a_way_goes_by_the_stops_before_the_goal():
    problem = replace(problem_on(line(9), [1], [2]), window_steps=8, via=((4, 0),))
    plan = planner("pbs", {}).plan(problem, 60.0).plan
    assert paths_of_plan(plan, problem.step_s)[0].tolist() == [1, 2, 3, 4, 3, 2, 1, 0, 1]


def test_robots_keep_clear_within_the_window_and_take_short_ways():
    rng = np.random.default_rng(5)
    for drivable in (False, True):
        start, goal, via = rng.permutation(64)[:20], rng.permutation(64)[:20], rng.integers(0, 64, 20)
        stops = tuple((v,) for v in via.tolist())
        problem = replace(problem_on(square_grid(8), start, goal), window_steps=10, via=stops, drivable=drivable)
        result = planner("pbs", {}).plan(problem, 60.0)
        assert result.status is Status.SOLVED and judge(ending_there(problem, result.plan), result.plan).valid
        assert result.lower_bound_steps <= result.stats["cost"] <= result.stats["first_solution_cost"]
        assert result.stats["cost"] < 1.15 * result.lower_bound_steps


def test_effort_ends_the_search_at_the_same_place():
    problem = replace(problem_on(square_grid(5), range(12), range(24, 12, -1)), window_steps=12, drivable=True)
    results = [planner("pbs", {}).plan(replace(problem, effort=effort), 60.0) for effort in (300, 300, 0)]
    assert [result.status for result in results] == [Status.TIMED_OUT, Status.TIMED_OUT, Status.SOLVED]
    assert results[0].stats == results[1].stats
