"""The same questions to every registered assigner."""

from itertools import permutations

import numpy as np
import pytest

from mrp_sumo.errors import PlanError, ScenarioError
from mrp_sumo.planning.registry import assigner
from mrp_sumo.plugins import registry

ALL = registry.names("assigners")


def cost_of(cost, goal_of):
    robots = np.flatnonzero(goal_of >= 0)
    return cost[robots, goal_of[robots]]


def brute_force(cost, of):
    if cost.shape[0] > cost.shape[1]:
        return brute_force(cost.T, of)
    return min(of(cost[np.arange(len(cost)), list(p)]) for p in permutations(range(cost.shape[1]), len(cost)))


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("shape", [(3, 3), (2, 4), (4, 2), (1, 1)])
@pytest.mark.parametrize("objective", ["sum", "bottleneck"])
def test_assignment_is_the_cheapest(name, shape, objective):
    rng = np.random.default_rng([*shape, len(objective)])
    for _ in range(5):
        cost = rng.integers(1, 30, shape) / 4
        cost[rng.random(shape) < 0.2] = np.inf
        of = np.sum if objective == "sum" else np.max
        best = brute_force(cost, of)
        if np.isinf(best):
            continue
        goal_of = assigner(name, {"objective": objective}).assign(cost, 10.0)
        served = goal_of[goal_of >= 0]
        assert goal_of.dtype == np.int64
        assert len(np.unique(served)) == len(served) == min(shape)
        assert of(cost_of(cost, goal_of)) == pytest.approx(best)


@pytest.mark.parametrize("name", ALL)
def test_robot_without_a_goal_in_reach_is_named(name):
    with pytest.raises(PlanError, match="robot 1 can reach none"):
        assigner(name, {}).assign(np.array([[1.0, 2.0], [np.inf, np.inf]]), 10.0)


@pytest.mark.parametrize("name", ALL)
def test_two_robots_for_one_reachable_goal_are_refused(name):
    with pytest.raises(PlanError, match="serves 2 of 2 goals"):
        assigner(name, {}).assign(np.array([[1.0, np.inf], [2.0, np.inf]]), 10.0)


@pytest.mark.parametrize("name", ALL)
def test_nan_is_refused(name):
    with pytest.raises(PlanError, match="robot 0 for goal 1 is nan"):
        assigner(name, {}).assign(np.array([[1.0, np.nan]]), 10.0)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("shape", [(0, 0), (0, 2), (2, 0)])
def test_nothing_to_assign_is_fine(name, shape):
    assert assigner(name, {}).assign(np.zeros(shape), 10.0).tolist() == [-1] * shape[0]


def test_unknown_names_and_parameters_are_told_the_nearest():
    with pytest.raises(ScenarioError, match="unknown assigner 'cpsat' \\(did you mean 'cp_sat'"):
        assigner("cpsat", {})
    with pytest.raises(ScenarioError, match="unknown parameter 'objectiv' \\(did you mean 'objective'"):
        assigner("mip", {"objectiv": "sum"})
    with pytest.raises(ScenarioError, match="objective is 'max', expected one of 'sum', 'bottleneck'"):
        assigner("mip", {"objective": "max"})
