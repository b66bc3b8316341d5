"""The conflict-based planners against slow truth, and what their parts claim."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from truth import ROBOT, crowded_problem, least_cost, random_problem
from vehicles import CART, TRICYCLE, roads, vehicles_on

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.plan import Status, paths_of_plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError, ScenarioError
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.planning.registry import planner
from mrp_sumo.planning.vehicles import on_moves
from mrp_sumo.search import distance
from mrp_sumo.search.distance import steps_to_targets
from mrp_sumo.traffic.draw import uniform_draw
from mrp_sumo.traffic.referee import judge
from planners.conflict_based.buffers import Buffers
from planners.conflict_based.frame import ranked_assignments
from planners.conflict_based.incumbent import Incumbent
from planners.neighbourhood.refinement import polishing_labels

OPTIMAL = [
    ("cbs", {}),
    ("cbs", {"symmetries": False, "heuristic": False, "bypass": False}),
    ("cbs", {"disjoint": True}),
    ("cbs", {"following": True}),
]
BOUNDED = [("ecbs", {"w": 1.2}), ("eecbs", {"w": 1.2}), ("eecbs", {"w": 1.5}), ("ecbs", {"w": 1.0})]
LIMIT_S = 1.0


@pytest.fixture(scope="module", autouse=True)
def compiled():
    for name in ("cbs", "cbs_ta", "ecbs", "ecbs_ta", "eecbs", "lacam", "prioritised"):
        planner(name, {}).prepare()


def compare(name, parameters, seed, problem=None, on_map=None):
    """Put one question to a planner and to the slow search, and hold the answer against the truth."""
    problem = problem or random_problem(seed)
    following = parameters.get("following", False)
    result = planner(name, parameters).plan(problem, LIMIT_S)
    if result.status is Status.TIMED_OUT:
        return
    best = least_cost(problem, following=following, on_map=on_map)
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


def vehicles_in_corridors(seed):
    """Two vehicles on eight places that are joined by a tree and one more road, so that there are corridors and dead ends."""
    rng = np.random.default_rng([seed, 79])
    places = rng.permutation(9)[:8].tolist()
    xy = [(4.0 * (k % 3), 4.0 * (k // 3)) for k in range(9)]
    roads_of = [(a, b) for a in places for b in places if a < b and (b - a == 3 or (b - a == 1 and b % 3))]
    joined, lanes, spare = {k: k for k in places}, [], []
    for a, b in rng.permutation(roads_of).tolist():
        (lanes if joined[a] != joined[b] else spare).append((a, b))
        joined = {k: joined[a] if group == joined[b] else group for k, group in joined.items()}
    graph = roads(xy, lanes + spare[:1])
    start, goal = (rng.permutation(places)[:2] for _ in range(2))
    return vehicles_on(graph, start, goal, [TRICYCLE, TRICYCLE] if seed % 3 else [TRICYCLE, CART])


def compare_vehicles(name, parameters, seed):
    on_map = vehicles_in_corridors(seed)
    try:
        problem = on_moves(on_map)
    except PlanError:  # no way for one of them
        return
    compare(name, parameters, seed, replace(problem, step_s=1.0), on_map)


@pytest.mark.parametrize(("name", "parameters"), [*OPTIMAL[::2], *OPTIMAL[3:], ("eecbs", {"w": 1.0, "incumbent": False})], ids=str)
def test_cost_of_vehicles_in_corridors_is_within_the_guarantee(name, parameters):
    for seed in range(8):
        compare_vehicles(name, parameters, seed)


@pytest.mark.campaign
@pytest.mark.parametrize(("name", "parameters"), OPTIMAL + BOUNDED, ids=str)
def test_cost_of_vehicles_in_corridors_is_within_the_guarantee_on_hundreds(name, parameters):
    for seed in range(1_000, 1_300):
        compare_vehicles(name, parameters, seed)


def compare_with_learning(seed):
    """Put a crowded question to `cbs` that learns from its first split, and to one that knows no heuristic at all."""
    rng = np.random.default_rng([seed, 78])
    graph = grid_graph(rng.random((6, 6)) > 0.2, 1.0, (0.0, 0.0))
    at = rng.permutation(graph.num_vertices)[:7], rng.permutation(graph.num_vertices)[:7]
    problem = Problem(graph, fleet_of(ROBOT, 7), *at, np.arange(7), 1.0, seed)
    plain = planner("cbs", {"heuristic": False}).plan(problem, LIMIT_S)
    learned = planner("cbs", {}).plan(problem, LIMIT_S)
    assert learned.lower_bound_steps <= (plain.plan.end_s.sum() if plain.status is Status.SOLVED else np.inf), seed
    if learned.status is Status.SOLVED:
        assert judge(problem, learned.plan).valid, seed
        assert plain.lower_bound_steps <= learned.plan.end_s.sum(), seed
        assert plain.status is not Status.SOLVED or plain.plan.end_s.sum() == learned.plan.end_s.sum(), seed


@pytest.fixture
def learns_from_the_first_split(monkeypatch):
    monkeypatch.setattr("planners.conflict_based.tree.SPLITS_BEFORE_LEARNING", 0)


@pytest.mark.usefixtures("learns_from_the_first_split")
def test_what_is_learned_of_pairs_and_clusters_keeps_the_cost_least():
    for seed in range(30):
        compare("cbs", {}, 3_000_000 + seed)
        compare_with_learning(seed)


@pytest.mark.campaign
@pytest.mark.usefixtures("learns_from_the_first_split")
def test_what_is_learned_of_pairs_and_clusters_keeps_the_cost_least_on_thousands():
    for seed in range(1000):
        compare("cbs", {}, 3_000_000 + seed)
        compare("cbs", {"following": True}, 3_000_000 + seed)
        compare("cbs", {}, seed, crowded_problem(4_000 + seed, num_vertices=6))
        compare_with_learning(seed)


def test_robot_that_must_be_elsewhere_in_between_may_return_to_a_vertex():
    compare("cbs", {"disjoint": True}, 5_000_629)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_assigning_costs_as_much_as_the_best_assignment(seed):
    problem = random_problem(seed, directed=False, side=3)
    free = problem.assigned(np.full(problem.num_robots, -1))
    optimal = planner("cbs_ta", {}).plan(free, LIMIT_S)
    bounded = planner("ecbs_ta", {"w": 1.3}).plan(free, LIMIT_S)
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
    outcome = list(ranked_assignments(cost))
    expected = sorted(
        cost[0, a] + cost[1, b] + cost[2, c] for a in range(3) for b in range(3) for c in range(3) if len({a, b, c}) == 3 and a != 2
    )
    assert [total for total, _ in outcome] == expected
    assert len({tuple(goal_of.tolist()) for _, goal_of in outcome}) == len(outcome)


def test_fewer_goals_than_robots_leave_some_without():
    outcome = list(ranked_assignments(np.array([[1.0], [2.0], [np.inf]])))
    assert [(total, goal_of.tolist()) for total, goal_of in outcome] == [(1.0, [0, -1, -1]), (2.0, [-1, 0, -1])]


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


def crowd(seed):
    """Thirty robots on a 9 x 9 grid with a few obstacles."""
    free = np.random.default_rng(seed).random((9, 9)) > 0.1
    graph = grid_graph(free, 1.0, (0.0, 0.0))
    start, goal = uniform_draw(graph, 30, seed)
    return Problem(graph, fleet_of(ROBOT, len(start)), start, goal, np.arange(len(start)), 1.0, seed)


@pytest.mark.slow
def test_answer_from_the_incumbent_is_valid_and_within_the_bound_of_the_tree():
    output = [(crowd(seed), planner("eecbs", {"w": 1.2}).plan(crowd(seed), 120.0)) for seed in range(4)]
    assert any(result.stats["from_incumbent"] for _, result in output)
    for problem, result in output:
        assert result.status is Status.SOLVED
        assert judge(problem, result.plan).valid
        cost = result.plan.end_s.sum()
        assert cost <= 1.2 * result.lower_bound_steps + 1e-9
        if result.stats["from_incumbent"]:
            assert cost == result.stats["incumbent_cost"]


def test_incumbent_can_be_switched_off():
    result = planner("eecbs", {"w": 1.5, "incumbent": False}).plan(crowd(1), 5.0)
    assert result.stats["from_incumbent"] == 0
    assert "incumbent_labels" not in result.stats


def test_incumbent_is_polished_before_it_is_an_answer():
    problem = crowd(2)
    incumbent = Incumbent(problem, steps_to_targets(problem), np.inf)
    incumbent.work(10_000_000, np.inf)
    first, labels = incumbent.cost, incumbent.labels
    incumbent.polish()
    assert incumbent.cost < first
    assert incumbent.labels >= polishing_labels(2500, problem.num_robots, 0) > labels
    bounded = Incumbent(replace(problem, effort=1), steps_to_targets(problem), np.inf)
    bounded.work(10_000_000, np.inf)
    labels = bounded.labels
    bounded.polish()
    assert bounded.labels == labels


def test_incumbent_is_the_same_in_one_turn_and_in_many():
    problem = crowd(2)
    table = steps_to_targets(problem)
    costs = []
    for turns in ([220_000], range(10_000, 230_000, 10_000)):
        other = Incumbent(problem, table, np.inf)
        for labels in turns:
            other.work(labels, 0.0)
        paths = other.paths()
        assert sum(map(len, [trimmed(path) for path in paths])) - len(paths) == other.cost
        costs.append([path.tolist() for path in paths])
    assert costs[0] == costs[1]


def trimmed(path):
    """A path without the waits at its end."""
    moves = np.flatnonzero(path[1:] != path[:-1])
    return path[: moves[-1] + 2] if len(moves) else path[:1]


@pytest.mark.parametrize("name", ["cbs", "ecbs", "eecbs", "cbs_ta", "ecbs_ta"])
def test_search_that_may_take_no_memory_gives_up_with_what_it_knows(name):
    result = planner(name, {"memory_mb": 1}).plan(crowd(1), 20.0)
    assert (result.status, result.plan) == (Status.GAVE_UP, None)
    assert result.message == "no plan within 1 MB"


@pytest.mark.parametrize("name", ["cbs", "ecbs", "eecbs", "cbs_ta", "ecbs_ta"])
def test_memory_limit_that_is_none_is_refused(name):
    with pytest.raises(ScenarioError, match="memory_mb is 0, expected 1 or more"):
        planner(name, {"memory_mb": 0})


@pytest.mark.parametrize("name", ["cbs", "eecbs", "cbs_ta", "ecbs_ta"])
def test_time_that_is_up_makes_no_more_tables(name, monkeypatch):
    made = []
    monkeypatch.setattr(distance, "steps_to", lambda *params: made.append(params))
    graph = grid_graph(np.ones((20, 20), bool), 1.0, (0.0, 0.0))
    vertices = np.arange(400)
    goal_of = np.full(200, -1) if name.endswith("_ta") else np.arange(200)
    problem = Problem(graph, fleet_of(ROBOT, 200), vertices[:200], vertices[200:], goal_of, 1.0)
    result = planner(name, {}).plan(problem, 1e-9)
    assert result.status is Status.TIMED_OUT
    assert len(made) == 0


def test_steps_to_the_end_of_a_corridor_are_read_where_they_are_written():
    buffers = Buffers(5, 5, 2, 64)
    buffers.scratch.reach[:] = 7
    assert (buffers.scratch.reach_read == 7).all() and not buffers.scratch.reach_read.flags.writeable
