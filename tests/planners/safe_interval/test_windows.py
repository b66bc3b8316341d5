"""Priority-based search in windows: by all stops ahead, without collisions, and short."""

from dataclasses import replace

import numpy as np
from worlds import corridor, ending_there, line, on_a_circle, problem_on, square_grid

from mrp_sumo.core.plan import Status, paths_of_plan
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.referee import judge
from planners.safe_interval._window_way import MOST_CROSSED, room_for
from planners.safe_interval.window_motion import WindowSteps, task_of


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


def test_there_is_room_for_ways_all_round_a_one_way_ring():
    ring = on_a_circle([(v, (v + 1) % 40) for v in range(40)], 40)
    problem = replace(problem_on(ring, [0, 5], [10, 5]), window_steps=8)  # whoever leaves 5 comes back 39 steps later
    assert len(room_for(task_of(problem)).top) > (8 + 39) * (MOST_CROSSED + 1)
    result = planner("pbs", {}).plan(problem, 60.0)
    assert result.status is Status.SOLVED and judge(ending_there(problem, result.plan), result.plan).valid


def test_a_robot_goes_as_far_as_its_stops_can_be_reached_and_no_other_loses_its_way_for_that():
    one_way = on_a_circle([(0, 1), (1, 2), (2, 3)], 4)  # a row: nobody comes back from 2, nor to 0
    problem = replace(problem_on(one_way, [0, 3], [1, 3]), via=((2,), ()), window_steps=8)
    assert len(room_for(task_of(problem)).top) < 100 * (MOST_CROSSED + 1)
    plan = planner("pbs", {}).plan(problem, 60.0).plan
    assert [path.tolist() for path in paths_of_plan(plan, problem.step_s)] == [[0, 1, 2], [3]]
    cut_off = replace(problem_on(one_way, [2, 0], [3, 1]), via=((0,), ()), window_steps=8)
    plan = planner("pbs", {}).plan(cut_off, 60.0).plan
    assert [path.tolist() for path in paths_of_plan(plan, problem.step_s)] == [[2], [0, 1]]


def test_ways_are_mended_where_no_order_of_robots_has_a_plan_and_the_same_each_time():
    """As many orders as are looked at here: that in which nobody goes first."""
    rng, tree_alone = np.random.default_rng(5), 0
    for drivable in (False, True, False, True):
        start, goal, via = rng.permutation(64)[:24], rng.permutation(64)[:24], rng.integers(0, 64, 24)
        stops = tuple((v,) for v in via.tolist())
        problem = replace(problem_on(square_grid(8), start, goal), window_steps=10, via=stops, drivable=drivable)
        one, other = (planner("pbs", {"max_nodes": 1}).plan(problem, 60.0) for _ in range(2))
        assert one.status is Status.SOLVED and one.stats["mended"] and judge(ending_there(problem, one.plan), one.plan).valid
        assert one.stats == other.stats and one.lower_bound_steps <= one.stats["cost"] < 1.3 * one.lower_bound_steps
        tree_alone += "mended" in planner("pbs", {}).plan(problem, 60.0).stats
    assert not tree_alone  # which has plans here by itself


def test_prioritised_has_robots_at_their_goals_give_way_in_a_window():
    graph = on_a_circle([lane for a, b in [(0, 1), (1, 2), (2, 3), (3, 4), (2, 5)] for lane in ((a, b), (b, a))], 6)
    problem = replace(problem_on(graph, [2, 0], [2, 4]), window_steps=6)
    plan = planner("prioritised", {}).plan(problem, 60.0).plan
    assert paths_of_plan(plan, problem.step_s)[1].tolist() == [0, 1, 2, 3, 4]
    alone = replace(
        problem_on(corridor(5), [2, 0], [2, 4]), window_steps=6
    )  # without the side road it can only go ahead, and not come back
    assert planner("prioritised", {}).plan(alone, 60.0).plan.vertex[-1] != 4


def test_where_no_plan_keeps_all_apart_whoever_can_get_on_does_and_the_others_wait():
    """Robots 0 and 1 are to change places on a row, of which one has to make room; robot 2 has a free way. On two cells nobody can."""
    waited = WindowSteps(replace(problem_on(line(6), [0, 1, 3], [1, 0, 5]), window_steps=4)).waited()
    assert waited.at[2].tolist() == [3, 4, 5, 5, 5] and waited.cost[2] == 2
    assert WindowSteps(replace(problem_on(line(2), [0, 1], [1, 0]), window_steps=4)).waited() is None


def test_a_crowd_that_effort_is_too_short_for_gets_on_as_far_as_it_can():
    problem = replace(problem_on(square_grid(8), range(51), range(63, 12, -1)), window_steps=16, effort=50_000)
    result = planner("pbs", {}).plan(problem, 60.0)
    assert result.status is Status.SOLVED and judge(ending_there(problem, result.plan), result.plan).valid
    moved = sum(path[0] != path[-1] for path in paths_of_plan(result.plan, problem.step_s))
    assert 0 < moved <= 51 and result.stats["labels"] <= 51_000
