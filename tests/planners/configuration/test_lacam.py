"""LaCAM and LaCAM* against slow truth."""

from collections import deque
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from worlds import ending_there, graph_of, on_a_circle, problem_on, random_grid

from mrp_sumo.core.plan import Status, paths_of_plan
from mrp_sumo.errors import PlanError
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.traffic.referee import judge
from mrp_sumo.traffic.schedule import schedule_of
from planners.configuration import lacam
from planners.configuration.lacam import Lacam
from planners.world import search_start


@pytest.fixture(scope="module", autouse=True)
def compiled():
    Lacam().prepare()


def reachable_without_rings(problem):
    """Whether the goals can be reached where no ring moves at once, or nobody follows: over configurations, one robot at a time."""
    graph, goal, begin = problem.graph, tuple(problem.target.tolist()), tuple(problem.start.tolist())
    ways = [[v, *graph.head[graph.first[v] : graph.first[v + 1]].tolist()] for v in range(graph.num_vertices)]
    seen, queue = {begin}, deque([begin])
    while queue:
        here = queue.popleft()
        for i, v in enumerate(here):  # whatever may move at once may move one after another, the first of a chain first
            for u in ways[v]:
                there = (*here[:i], u, *here[i + 1 :])
                if u not in here and there not in seen:
                    seen.add(there)
                    queue.append(there)
    return goal in seen


def least_sum_of_loss(problem):
    """Breadth-first over whole configurations by cost: slow and sure."""
    graph, goal = problem.graph, tuple(problem.target.tolist())
    ways = [[v, *graph.head[graph.first[v] : graph.first[v + 1]].tolist()] for v in range(graph.num_vertices)]
    best, queue = {tuple(problem.start.tolist()): 0}, deque([tuple(problem.start.tolist())])
    while queue:
        here = queue.popleft()
        for there in product(*(ways[v] for v in here)):
            if len(set(there)) < len(there):
                continue
            if any(here[i] == there[j] and here[j] == there[i] for i in range(len(here)) for j in range(i)):
                continue
            cost = best[here] + sum(not (a == b == g) for a, b, g in zip(here, there, goal, strict=True))
            if cost < best.get(there, 1 << 30):
                best[there] = cost
                queue.append(there)
    return best.get(goal)


def loss(plan, problem):
    """Sum of loss of a plan: moves, and waits away from the goal."""
    total = 0
    for path, goal in zip(paths_of_plan(plan, 1.0), problem.target, strict=True):
        total += sum(not (a == b == goal) for a, b in pairwise(path))
    return total


def test_some_plans_turn_rings_where_they_may():
    refused = 0
    for seed in range(10):
        problem = random_grid(8, 40, seed, blocked=0.1)
        try:
            schedule_of(problem, Lacam().plan(problem, 20.0).plan)
        except PlanError:
            refused += 1
    assert refused > 0


@pytest.mark.parametrize("kind", [{"following": True}, {"rotations": False}])
@pytest.mark.parametrize("seed", range(12))
def test_lacam_is_complete_without_rings(kind, seed):
    rng = np.random.default_rng([seed, 5])
    graph = grid_graph(np.ones((2, 3), bool), 1.0, (0.0, 0.0))
    num_robots = 3 + seed % 4
    problem = problem_on(graph, rng.permutation(6)[:num_robots], rng.permutation(6)[:num_robots], seed)
    result = Lacam(**kind).plan(problem, 30.0)
    assert result.status is (Status.SOLVED if reachable_without_rings(problem) else Status.INFEASIBLE)
    if result.plan:
        assert judge(problem, result.plan).valid
        schedule_of(problem, result.plan)


@pytest.mark.parametrize(("planner", "turns"), [(Lacam(), True), (Lacam(rotations=False), False), (Lacam(following=True), False)])
def test_full_ring_turns_only_at_once(planner, turns):
    ring = on_a_circle([(i, (i + 1) % 4) for i in range(4)], 4)
    problem = problem_on(ring, [0, 1, 2, 3], [1, 2, 3, 0])
    assert planner.plan(problem, 10.0).status is (Status.SOLVED if turns else Status.INFEASIBLE)


def test_robots_swap_in_a_corridor_with_one_siding():
    lanes = [(a, b) for i in range(6) for a, b in ((i, i + 1), (i + 1, i))] + [(3, 7), (7, 3)]
    problem = problem_on(on_a_circle(lanes, 8), [0, 6], [6, 0])
    result = Lacam().plan(problem, 20.0)
    assert judge(problem, result.plan).valid


@pytest.mark.parametrize("seed", range(6))
def test_lacam_star_converges_to_the_least_sum_of_loss(seed):
    problem = random_grid(4, 3, seed, blocked=0.1)
    result = Lacam(anytime=True, polish=0, flow=0, neighbourhood=1).plan(problem, 30.0)
    assert judge(problem, result.plan).valid
    # it stops early only at the lower bound or when the search is exhausted
    assert loss(result.plan, problem) <= least_sum_of_loss(problem) or result.plan.end_s.sum() == result.lower_bound_steps


def test_memory_limit_is_a_result():
    problem = random_grid(14, 80, 5)
    result = Lacam(memory_mb=1, flow=0, polish=0, num_tries=1).plan(replace(problem, seed=1), 20.0)
    assert result.status in (Status.SOLVED, Status.TIMED_OUT)


@pytest.mark.parametrize(("times", "shorter"), [(4, True), (2, False)])
def test_a_path_that_wanders_is_replaced_by_one_of_another_search(times, shorter):
    """A robot on a line of ten lanes that drives to and fro before it sets out: four times as long as its way, or twice."""
    problem = problem_on(graph_of([(k, 0) for k in range(11)], [(k, k + 1) for k in range(10)], 1.0), [0], [10])
    start = search_start(Lacam(), problem, np.inf, 0, None)
    path = np.array([*[0, 1] * (5 * (times - 1)), *range(11)], np.int32)[:, None]
    sooner = lacam._sooner(Lacam(), start, path)
    assert len(sooner) == 11 if shorter else sooner is path


def test_a_window_has_a_plan_though_robots_cannot_all_come_to_their_goals():
    ring = on_a_circle([(v, (v + 1) % 12) for v in range(12)], 12)
    problem = problem_on(ring, [0, 4, 8], [1, 11, 6])  # on the ring the second would have to pass the third
    assert Lacam().plan(problem, 20.0).status is Status.INFEASIBLE
    for window in (1, 5):
        result = Lacam().plan(replace(problem, window_steps=window), 20.0)
        assert result.status is Status.SOLVED and result.plan.end_s.max() <= window
        assert judge(ending_there(problem, result.plan), result.plan).valid


def test_first_solution_is_the_cheaper_of_easy_paths_and_of_those_that_ways_lead_along(monkeypatch):
    costs = []
    for seed in range(6):
        problem = random_grid(32, 60, seed, blocked=0.1)
        result = Lacam(polish=0).plan(problem, 60.0)
        assert judge(problem, result.plan).valid
        with monkeypatch.context() as without:
            without.setattr(lacam, "MOST_MOVES", 0)
            easy = Lacam(polish=0).plan(problem, 60.0)
        costs.append((result.stats["cost"], easy.stats["cost"]))
    assert all(cost <= easy for cost, easy in costs)
    assert any(cost < easy for cost, easy in costs)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_crowd_in_one_way_streets_has_a_plan_that_costs_less_than_twice_its_bound(seed):
    """44 robots on 64 crossings: the search alone wanders about, for plans that cost more than twice the bound after polishing."""
    n, chance = 8, np.random.default_rng(seed)
    east_or_west = [(v, v + 1) if v // n % 2 == 0 else (v + 1, v) for v in range(n * n) if v % n < n - 1]
    north_or_south = [(v, v + n) if v % 2 else (v + n, v) for v in range(n * n - n)]
    graph = graph_of([(v % n, v // n) for v in range(n * n)], [], 1.0, one_way=east_or_west + north_or_south)
    start, goal = (chance.permutation(n * n)[:44].tolist() for _ in range(2))
    problem = problem_on(graph, start, goal)
    result = Lacam().plan(problem, 60.0)
    assert judge(problem, result.plan, result.goal_of).valid
    assert result.stats["cost"] < 2 * result.lower_bound_steps
    assert Lacam(polish=0).plan(replace(problem, effort=2000), 60.0).plan is None  # no work is left to repair paths


def test_kernels_are_prepared_with_little_polishing_however_much_is_asked_for(monkeypatch):
    """No clock ends it: a billion labels a robot took minutes before the first plan."""
    labels = []
    monkeypatch.setattr(lacam.Refinement, "polish", lambda self, deadline_s, most, least=0: labels.append(most))
    Lacam(polish=10**9, traffic=10**9).prepare()
    assert labels and max(labels) <= 100
