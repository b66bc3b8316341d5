"""MAPF-LNS2: kernels against slow truth, pairs in collision against the referee."""

import numpy as np
import pytest
from worlds import graph_of, problem_on, random_grid, square_grid

from mrp_sumo.core.plan import Status, paths_of_plan, plan_of_paths
from mrp_sumo.search.distance import steps_to_targets
from mrp_sumo.traffic.referee import judge
from mrp_sumo.traffic.schedule import schedule_of
from planners import world
from planners.configuration.lacam import Lacam
from planners.neighbourhood import _sipps, _traffic
from planners.neighbourhood.lns2 import Lns2
from planners.neighbourhood.refinement import Refinement, Repair, first_order, task_of
from planners.world import sum_of_costs


@pytest.fixture(scope="module", autouse=True)
def compiled():
    for planner in (Lns2(threads=2), Lacam()):
        planner.prepare()


def test_runs_of_bits_end_where_they_end():
    rng = np.random.default_rng(3)
    for density in (0.0, 0.02, 0.5, 0.98, 1.0):
        bits = rng.random(128) < density
        words = np.array([sum(int(bits[32 * w + k]) << k for k in range(32)) for w in range(4)], np.int64)
        for t in range(128):
            end = t
            while end + 1 < 128 and bits[end + 1] == bits[t]:
                end += 1
            assert _traffic.run_end(words, t) == (bits[t], end)


def repair_of(problem, num_planned, **kind):
    """Paths of the first robots, planned one after another with collisions allowed."""
    repair = Repair(task_of(problem, steps_to_targets(problem), **kind), 64, 4)
    assert repair.plan(np.arange(num_planned))
    return repair


@pytest.mark.parametrize("seed", range(6))
def test_search_over_intervals_arrives_as_early_as_search_over_steps(seed):
    problem = random_grid(8, 16, seed, blocked=0.15)
    repair = repair_of(problem, 15)
    at, robot = repair.traffic.at[:15].T.astype(int), 15
    start, goal = int(problem.start[robot]), int(problem.target[robot])
    graph = problem.graph
    reached, earliest = {start}, -1
    for t in range(63):
        if goal in reached and not (at[t:] == goal).any():
            earliest = t
            break
        onward = set()
        for v in reached:
            for u in [v, *graph.head[graph.first[v] : graph.first[v + 1]].tolist()]:
                swap = ((at[t] == u) & (at[t + 1] == v)).any()
                if not swap and not (at[t + 1] == u).any():
                    onward.add(u)
        reached = onward
    clear, crossing = (_sipps.plan_one(repair.traffic, repair.room, robot, 62, may_cross) for may_cross in (False, True))
    assert clear == earliest
    assert earliest < 0 or crossing == earliest


def test_straight_path_passes_who_stands_where_there_is_one_as_short():
    across = repair_of(problem_on(square_grid(3), [4, 0], [4, 8]), 1)  # one stands in the middle
    assert _sipps.plan_straight(across.traffic, across.room, 1)
    path = across.traffic.at[1]
    assert across.traffic.end[1] == 4 and path[[0, 4, 63]].tolist() == [0, 8, 8] and 4 not in path
    along = repair_of(problem_on(square_grid(3), [1, 0], [1, 2]), 1)  # one stands between
    assert not _sipps.plan_straight(along.traffic, along.room, 1)
    assert _sipps.plan_one(along.traffic, along.room, 1, 62, False) == 4


def test_robots_with_short_ways_are_planned_first_where_there_is_room():
    for num_robots, roomy in ((20, True), (70, False)):
        problem = random_grid(16, num_robots, 0)
        task = task_of(problem, steps_to_targets(problem))
        order = first_order(task, np.random.default_rng(0))
        assert sorted(order.tolist()) == list(range(num_robots))
        farther = task.least[order][:, None] * 0.75 > task.least[order][None, :] * 1.25  # for certain
        assert (not np.triu(farther).any()) == roomy


@pytest.mark.parametrize("seed", range(4))
def test_pairs_in_collision_are_those_the_referee_sees(seed):
    problem = random_grid(8, 24, seed, blocked=0.1)
    repair = repair_of(problem, 24)
    pairs = repair.num_pairs()

    def seen():
        verdict = judge(problem, plan_of_paths(list(repair.traffic.at), 1.0))
        assert not verdict.faults
        return len({(c.robot, c.other) for c in verdict.conflicts})

    assert pairs == seen()
    left = repair.repair(pairs, 20, np.random.default_rng(seed))
    assert left <= pairs
    assert left == seen() == repair.num_pairs()


def solved_by_lacam(problem, **kind):
    """[T, R] paths without collisions that can be made shorter."""
    paths = paths_of_plan(Lacam(polish=0, **kind).plan(problem, 20.0).plan, 1.0)
    return np.array([[p[min(t, len(p) - 1)] for p in paths] for t in range(max(map(len, paths)))])


@pytest.mark.parametrize(
    "more", [{}, {"bandit": True}, {"threads": 3}, {"threads": 2, "following": True}, {"threads": 2, "rotations": False}]
)
def test_refinement_only_ever_lowers_the_cost_of_valid_plans(more):
    problem = random_grid(10, 30, 1, blocked=0.2 if "following" not in more else 0.05)
    kind = {key: value for key, value in more.items() if key in ("following", "rotations")}
    path = solved_by_lacam(problem, **kind)
    others = {key: value for key, value in more.items() if key not in kind}
    refinement = Refinement(task_of(problem, steps_to_targets(problem), **kind), path, 5, np.random.default_rng(0), **others)
    costs = [sum_of_costs(path, problem.target)]
    for labels in (2_000, 20_000, 100_000):
        refinement.until(np.inf, most_labels=labels)
        plan = plan_of_paths(list(refinement.path().T), 1.0)
        assert judge(problem, plan).valid
        assert "following" not in more or not judge(problem, plan).following
        if "rotations" in more:
            schedule_of(problem, plan)  # refuses rings
        assert sum_of_costs(refinement.path(), problem.target) == refinement.cost
        costs.append(refinement.cost)
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < costs[0]


def test_threads_bring_together_what_each_has_gained():
    """With as much work for each, and so the best that one has found and more."""
    problem = random_grid(16, 70, 2)
    path = solved_by_lacam(problem)
    task = task_of(problem, steps_to_targets(problem))
    cost = {}
    for threads in (1, 4):
        refinement = Refinement(task, path, 4, np.random.default_rng(0), threads=threads)
        refinement.until(np.inf, most_labels=40_000 * threads)
        cost[threads] = refinement.cost
        for refiner in refinement.refiners[1:]:  # all have caught up, after a round in which somebody gained, or wait as cheaply
            assert refiner.cost == refinement.cost
    assert cost[4] < cost[1]


@pytest.mark.parametrize(("num_lanes", "share"), [(10, 1.0), (300, 0.2)])
def test_polishing_ends_sooner_the_less_there_is_to_gain(num_lanes, share):
    """Two robots that change places beside a siding take 7 steps instead of 4, and one drives along a line; nothing can be gained."""
    line = np.arange(4, 5 + num_lanes)
    edges = [(0, 1), (1, 2), (1, 3), *zip(line[:-1].tolist(), line[1:].tolist())]
    xy = [(0, 0), (1, 0), (2, 0), (1, 1), *((k, 2) for k in range(num_lanes + 1))]
    problem = problem_on(graph_of(xy, edges, 1.0), [0, 2, 4], [2, 0, 4 + num_lanes])
    path = np.stack([np.pad(route, (0, num_lanes + 1 - len(route)), "edge") for route in ([0, 1, 3, 1, 2], [2, 2, 1, 0], line)], 1)
    refinement = Refinement(task_of(problem, steps_to_targets(problem)), path.astype(np.int32), 2, np.random.default_rng(0))
    refinement.polish(np.inf, 20_000)
    made = sum(refiner.labels for refiner in refinement.refiners)
    assert refinement.cost == 7 + num_lanes
    assert share * 20_000 <= made < (share + 0.1) * 20_000


@pytest.mark.parametrize(("gain", "most", "made"), [(20, 9000, 550), (5, 9000, 100), (20, 275, 275)])
def test_polishing_goes_on_while_it_pays(monkeypatch, gain, most, made):
    """A plan that costs 1000 and gains so much in each 50 of the first 500 labels; 100 may be made."""
    problem = problem_on(square_grid(2), [0], [1])
    refinement = Refinement(task_of(problem, steps_to_targets(problem)), np.array([[0], [2], [3], [1]], np.int32), 1, None)
    cost, ends = [1000], []
    monkeypatch.setattr(Refinement, "cost", property(lambda self: cost[0]))

    def until(deadline_s, *, most_labels):
        cost[0] = 1000 - gain * (min(most_labels, 500) // 50)
        ends.append(most_labels)

    refinement.until = until
    refinement.polish(np.inf, 100, most)
    assert ends[-1] == made


def test_bandit_tries_the_late_robot_that_has_been_worth_it():
    problem = random_grid(10, 30, 1)
    task = task_of(problem, steps_to_targets(problem))
    refinement = Refinement(task, solved_by_lacam(problem), 4, np.random.default_rng(0), bandit=True)
    refiner = refinement.refiners[0]
    traffic, tried = refiner.traffic, refiner.hood.tried
    late = traffic.end - task.least
    robot = int(np.argsort(late)[-10])  # late, others more so
    tried[:], tried[robot] = (1000, 0), (0, 1000)
    for times in range(1, 6):
        if traffic.end[robot] == task.least[robot]:
            break
        refiner.work(np.inf, refiner.labels + 1, 0)
        assert tried[robot].sum() == 1000 + times
    assert times > 1
    tried[:] = 0
    refiner.work(np.inf, refiner.labels + 50_000, 0)
    assert 0 < tried[:, 1].sum() < tried.sum()
    assert traffic.end.sum() < late.sum() + task.least.sum()


@pytest.mark.parametrize("kind", [{"following": True}, {"rotations": False}])
@pytest.mark.parametrize("seed", range(3))
def test_pairs_in_collision_are_found_where_following_or_rings_count(kind, seed):
    problem = random_grid(8, 24, seed, blocked=0.1)
    repair = repair_of(problem, 24, **kind)
    left = repair.repair(repair.num_pairs(), 2000, np.random.default_rng(seed))
    verdict = judge(problem, plan_of_paths(list(repair.traffic.at), 1.0))
    met = {(c.robot, c.other) for c in (*verdict.conflicts, *(verdict.following if "following" in kind else ()))}
    assert not verdict.faults
    assert len(met) <= left
    assert (left == 0) == (repair.num_pairs() == 0)
    if "following" in kind:
        assert left == len(met)


def test_tables_beyond_the_memory_are_not_made():
    result = Lns2(memory_mb=1).plan(random_grid(30, 60, 0), 5.0)
    assert result.status is Status.GAVE_UP
    assert "expected at most 1 MB" in result.message
    assert Lns2(memory_mb=1).plan(random_grid(40, 300, 0), 5.0).message == "tables of distances take more than 1 MB"


@pytest.mark.parametrize("kind", [{}, {"following": True}])
def test_packed_distances_do_as_well_as_tables(monkeypatch, kind):
    problem = random_grid(20, 60, 2)
    by_tables = Lns2(**kind).plan(problem, 60.0)
    monkeypatch.setattr(world, "TABLE_CELLS", 0)
    monkeypatch.setattr(world, "steps_to_targets", None)
    packed = Lns2(**kind).plan(problem, 60.0)
    verdict = judge(problem, packed.plan)
    assert verdict.valid
    assert not (kind and verdict.following)
    assert packed.lower_bound_steps == by_tables.lower_bound_steps
    assert packed.stats["cost"] < 1.1 * by_tables.stats["cost"]
