"""The conflict-based planners against slow truth, and what their parts claim."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from truth import least_cost, random_problem

from mrp_sumo.core.plan import Status, paths_of_plan
from mrp_sumo.core.referee import judge
from mrp_sumo.errors import ScenarioError
from mrp_sumo.planning.ranking import ranked_assignments
from mrp_sumo.planning.registry import planner

OPTIMAL = [
    ("cbs", {}),
    ("cbs", {"symmetries": False, "heuristic": False, "bypass": False}),
    ("cbs", {"disjoint": True}),
    ("cbs", {"following": True}),
]
BOUNDED = [("ecbs", {"w": 1.2}), ("eecbs", {"w": 1.2}), ("eecbs", {"w": 1.5}), ("ecbs", {"w": 1.0})]
LIMIT_S = 1.0


def compare(name, parameters, seed):
    """Put one question to a planner and to the slow search, and hold the answer against the truth."""
    problem = random_problem(seed)
    following = parameters.get("following", False)
    result = planner(name, parameters).plan(problem, LIMIT_S)
    if result.status is Status.TIMED_OUT:
        return
    best = least_cost(problem, following=following)
    assert (result.status is Status.SOLVED) == (best is not None), (seed, best, result.message)
    if best is None:
        return
    verdict = judge(problem, result.plan)
    assert verdict.valid, (seed, verdict.summary(problem))
    assert not (following and verdict.following), seed
    cost = result.plan.end_s.sum()
    assert best <= cost <= parameters.get("w", 1.0) * best + 1e-9, (seed, best, cost)
    assert result.lower_bound_steps <= best, seed


@pytest.mark.parametrize(("name", "parameters"), OPTIMAL + BOUNDED, ids=str)
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_cost_is_within_the_guarantee(name, parameters, seed):
    compare(name, parameters, seed)


@pytest.mark.campaign
@pytest.mark.parametrize(("name", "parameters"), OPTIMAL + BOUNDED, ids=str)
def test_cost_is_within_the_guarantee_on_thousands(name, parameters):
    for seed in range(2_000_000, 2_002_000):
        compare(name, parameters, seed)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_assigning_costs_as_much_as_the_best_assignment(seed):
    problem = random_problem(seed, directed=False, side=3)
    optimal = planner("cbs_ta", {}).plan(problem, LIMIT_S)
    bounded = planner("ecbs_ta", {"w": 1.3}).plan(problem, LIMIT_S)
    if Status.TIMED_OUT in (optimal.status, bounded.status):
        return
    costs = [least_cost(problem.assigned(goal_of)) for _, goal_of in ranked_assignments(np.zeros((problem.num_robots,) * 2))]
    best = min((cost for cost in costs if cost is not None), default=None)
    assert (optimal.status is Status.SOLVED) == (bounded.status is Status.SOLVED) == (best is not None)
    if best is not None:
        assert judge(problem, optimal.plan, optimal.goal_of).valid
        assert judge(problem, bounded.plan, bounded.goal_of).valid
        assert optimal.plan.end_s.sum() == best
        assert best <= bounded.plan.end_s.sum() <= 1.3 * best + 1e-9


def test_more_goals_than_robots_are_chosen_from():
    problem = random_problem(5, directed=False)
    graph = problem.graph
    few = type(problem)(
        graph=graph,
        fleet=problem.fleet,
        start=problem.start,
        goal=np.arange(graph.num_vertices),
        goal_of=np.full(problem.num_robots, -1),
        step_s=1.0,
    )
    result = planner("cbs_ta", {}).plan(few, 5.0)
    assert result.status is Status.SOLVED
    assert result.plan.end_s.sum() == 0  # every robot stands on a goal


def test_assignments_come_in_order_and_once():
    cost = np.array([[1.0, 4.0, np.inf], [2.0, 3.0, 6.0], [5.0, 1.0, 2.0]])
    found = list(ranked_assignments(cost))
    expected = sorted(
        cost[0, a] + cost[1, b] + cost[2, c] for a in range(3) for b in range(3) for c in range(3) if len({a, b, c}) == 3 and a != 2
    )
    assert [total for total, _ in found] == expected
    assert len({tuple(goal_of.tolist()) for _, goal_of in found}) == len(found)


def test_fewer_goals_than_robots_leave_some_without():
    found = list(ranked_assignments(np.array([[1.0], [2.0], [np.inf]])))
    assert [(total, goal_of.tolist()) for total, goal_of in found] == [(1.0, [0, -1, -1]), (2.0, [-1, 0, -1])]


@pytest.mark.parametrize("name", ["ecbs", "eecbs", "ecbs_ta"])
@pytest.mark.parametrize("w", [0.9, float("inf"), float("nan")])
def test_factor_that_is_no_bound_is_refused(name, w):
    with pytest.raises(ScenarioError, match=rf"w is {w}, expected a finite number of 1 or more"):
        planner(name, {"w": w})


@pytest.mark.parametrize("name", ["ecbs", "eecbs", "ecbs_ta"])
def test_huge_factor_bounds_nothing_and_breaks_nothing(name):
    problem = random_problem(3, directed=False)
    result, truth = planner(name, {"w": 1e300}).plan(problem, 10.0), planner("lacam", {}).plan(problem, 10.0)
    assert result.status is truth.status


def test_plans_without_following_conflicts_can_be_had():
    for seed in range(30):
        problem = random_problem(seed, directed=False)
        result = planner("prioritised", {"following": True}).plan(problem, 1.0)
        if result.plan:
            assert not judge(problem, result.plan).following
            assert all(len(path) for path in paths_of_plan(result.plan, 1.0))
