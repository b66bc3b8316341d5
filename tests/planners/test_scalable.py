"""PIBT, LaCAM and LNS2: kernels against slow truth, plans against the referee."""

import os
import subprocess
import sys
from collections import deque
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.plan import Status, paths_of_plan, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.search.distance import UNREACHABLE, distances
from mrp_sumo.traffic.draw import uniform_draw
from mrp_sumo.traffic.referee import judge
from mrp_sumo.traffic.schedule import schedule_of
from planners._compass import UNKNOWN, read_code
from planners._world import build_scratch, build_world, steps_table, sum_of_costs, tiled
from planners.configuration import _flow, _pibt
from planners.configuration._search_start import search_start
from planners.configuration.lacam import Lacam
from planners.configuration.pibt import Pibt
from planners.neighbourhood import _lns, _sipps, _traffic
from planners.neighbourhood._collisions import find_collisions
from planners.neighbourhood._refinement import Refinement, room_to_repair, task_of
from planners.neighbourhood.lns2 import Lns2

POINT = RobotType("point", 0.2, 0.2, 1.0, 1.0, 1.0, 1.0)


@pytest.fixture(scope="module", autouse=True)
def compiled():
    for planner in (Pibt(), Lacam(), Lns2()):
        planner.prepare()


def problem_on(graph, start, goal, seed=0):
    return Problem(graph, fleet_of(POINT, len(start)), np.array(start), np.array(goal), np.arange(len(start)), 1.0, seed)


def random_problem(size, num_robots, seed, blocked=0.2):
    free = np.random.default_rng([seed, 99]).random((size, size)) >= blocked
    graph = grid_graph(free, 1.0, (0.0, 0.0))
    return problem_on(graph, *uniform_draw(graph, num_robots, seed), seed)


def roadmap(lanes, num_vertices):
    turn = np.arange(num_vertices) * 2 * np.pi / num_vertices
    nav = nav_graph(name="lanes", xy=np.column_stack([np.cos(turn), np.sin(turn)]), lanes=lanes)
    return plan_graph(nav, kind="roadmap", cell_m=1.0, vertex_of_station=np.arange(num_vertices))


def corridor(length):
    return roadmap([(a, b) for i in range(length - 1) for a, b in ((i, i + 1), (i + 1, i))], length)


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


@pytest.mark.parametrize("seed", range(5))
def test_packed_distances_tell_which_neighbour_is_nearer(seed):
    problem = random_problem(24, 6, seed)
    world, steps = build_world(problem, np.inf, packed=True)
    table, plain_steps = build_world(problem, np.inf, packed=False)
    assert (steps == plain_steps).all()
    graph = problem.graph
    for robot in range(6):
        known = np.array([read_code(world.code, robot, v) for v in range(graph.num_vertices)])
        inside = known != UNKNOWN
        assert inside[problem.start[robot]]
        assert (known[inside] == table.table[robot][inside] % 3).all()


def test_tiles_only_change_the_numbers():
    problem = random_problem(40, 5, 0)
    other, original = tiled(problem)
    assert (original[other.start] == problem.start).all() and (original[other.target] == problem.target).all()
    graph, renumbered = problem.graph, other.graph
    lanes = set(zip(graph.tail.tolist(), graph.head.tolist(), strict=True))
    assert set(zip(original[renumbered.tail].tolist(), original[renumbered.head].tolist(), strict=True)) == lanes
    assert (renumbered.head[renumbered.reverse] == renumbered.tail).all()
    assert (renumbered.xy == graph.xy[original]).all()


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_a_step_of_pibt_moves_everybody_without_collision(seed, packed):
    problem = random_problem(10, 40, seed)
    world, _ = build_world(problem, np.inf, packed=packed)
    scratch, rng = build_scratch(world), np.random.default_rng(seed)
    here, order = problem.start.copy(), np.arange(40)
    lanes = set(zip(problem.graph.tail.tolist(), problem.graph.head.tolist(), strict=True))
    for _ in range(30):
        to = np.full(40, -1)
        assert _pibt.step(world, scratch, here, to, order, True, rng)
        assert len(set(to.tolist())) == 40
        moves = {(a, b) for a, b in zip(here.tolist(), to.tolist(), strict=True) if a != b}
        assert moves <= lanes
        assert not {(b, a) for a, b in moves} & moves
        assert (scratch.now == -1).all() and (scratch.next == -1).all()
        here = to


def test_imposed_vertices_are_kept_or_refused():
    problem = problem_on(corridor(3), [0, 1], [2, 0])
    world, _ = build_world(problem, np.inf, packed=False)
    scratch, rng = build_scratch(world), np.random.default_rng(0)
    to = np.array([0, -1])
    assert _pibt.step(world, scratch, problem.start, to, np.arange(2), False, rng)
    assert to[0] == 0
    assert not _pibt.step(world, scratch, problem.start, np.array([1, 0]), np.arange(2), False, rng)  # a swap
    assert not _pibt.step(world, scratch, problem.start, np.array([1, 1]), np.arange(2), False, rng)
    assert (scratch.now == -1).all() and (scratch.next == -1).all()


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


def traffic_for(problem, num_planned, horizon=64):
    """Traffic of the first robots, planned one after another with collisions allowed."""
    task = task_of(problem, steps_table(problem, np.inf))
    traffic, labels, hood = room_to_repair(task, horizon, 4)
    assert _lns.plan_all(task, traffic, labels, np.arange(num_planned), 0, num_planned)
    return task, traffic, labels, hood


@pytest.mark.parametrize("seed", range(6))
def test_search_over_intervals_arrives_as_early_as_search_over_steps(seed):
    problem = random_problem(8, 16, seed, blocked=0.15)
    task, traffic, labels, _ = traffic_for(problem, 15)
    at, robot = traffic.at[:15].T.astype(int), 15
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
    found = _sipps.plan_one(
        task.first, task.head, task.reverse, traffic, labels, robot, start, goal, task.steps[robot], 62, False, 10**6
    )  # fmt: skip
    assert found == earliest


@pytest.mark.parametrize("seed", range(4))
def test_pairs_in_collision_are_those_the_referee_sees(seed):
    problem = random_problem(8, 24, seed, blocked=0.1)
    task, traffic, labels, hood = traffic_for(problem, 24)
    pairs = find_collisions(task, traffic, hood)

    def seen():
        verdict = judge(problem, plan_of_paths(list(traffic.at), 1.0))
        assert not verdict.faults
        return len({(c.robot, c.other) for c in verdict.conflicts})

    assert pairs == seen()
    left = _lns.repair(task, traffic, labels, hood, 4, pairs, 20, np.random.default_rng(seed))
    assert left <= pairs
    assert left == seen() == find_collisions(task, traffic, hood)


def test_refinement_only_ever_lowers_the_cost_of_valid_plans():
    problem = random_problem(10, 30, 1)
    result = Lacam(polish=0).plan(problem, 20.0)
    paths = paths_of_plan(result.plan, 1.0)
    rows = max(map(len, paths))
    path = np.array([[p[min(t, len(p) - 1)] for p in paths] for t in range(rows)])
    refinement = Refinement(task_of(problem, steps_table(problem, np.inf)), path, 5, np.random.default_rng(0))
    costs = [sum_of_costs(path, problem.target)]
    for labels in (2_000, 20_000, 100_000):
        refinement.until(np.inf, most_labels=labels)
        assert judge(problem, plan_of_paths(list(refinement.path().T), 1.0)).valid
        assert sum_of_costs(refinement.path(), problem.target) == refinement.cost
        costs.append(refinement.cost)
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < costs[0]


@pytest.mark.parametrize("planner", [Pibt(), Lacam(), Lacam(num_tries=3, flow=0, hindrance=False), Lns2()])
@pytest.mark.parametrize("seed", range(3))
def test_crowded_grids_are_solved_and_repeat_themselves(planner, seed):
    problem = random_problem(14, 50, seed)
    one, two = planner.plan(problem, 20.0), planner.plan(problem, 20.0)
    assert one.status is Status.SOLVED, one.message
    verdict = judge(problem, one.plan)
    assert verdict.valid, verdict.summary(problem)
    assert one.lower_bound_steps <= one.plan.end_s.sum() == one.stats["cost"]
    assert (one.plan.vertex == two.plan.vertex).all() and (one.plan.arrive_s == two.plan.arrive_s).all()


@pytest.mark.parametrize("planner", [Pibt(), Lacam()])
def test_packed_distances_lead_to_valid_plans(planner):
    problem = random_problem(40, 60, 2)
    result = planner._plan(problem, 20.0, True)
    assert judge(problem, result.plan).valid


STRICT = [made(**kind) for made in (Pibt, Lacam, Lns2) for kind in ({"following": True}, {"rotations": False})]


@pytest.mark.parametrize("planner", STRICT)
@pytest.mark.parametrize("seed", range(6))
def test_nobody_follows_or_no_ring_turns_where_that_is_asked(planner, seed):
    problem = random_problem(10, 15 if planner.following else 30, seed, blocked=0.0)  # PIBT soon gives up where nobody may follow
    result = planner.plan(problem, 20.0)
    assert result.status is Status.SOLVED, result.message
    verdict = judge(problem, result.plan)
    assert verdict.valid, verdict.summary(problem)
    schedule_of(problem, result.plan)  # refuses rings
    if planner.following:
        assert not verdict.following


def test_some_plans_turn_rings_where_they_may():
    refused = 0
    for seed in range(10):
        problem = random_problem(8, 40, seed, blocked=0.1)
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
    ring = roadmap([(i, (i + 1) % 4) for i in range(4)], 4)
    problem = problem_on(ring, [0, 1, 2, 3], [1, 2, 3, 0])
    assert planner.plan(problem, 10.0).status is (Status.SOLVED if turns else Status.INFEASIBLE)


@pytest.mark.parametrize("kind", [{"following": True}, {"rotations": False}])
@pytest.mark.parametrize("seed", range(3))
def test_pairs_in_collision_are_found_where_following_or_rings_count(kind, seed):
    problem = random_problem(8, 24, seed, blocked=0.1)
    task = task_of(problem, steps_table(problem, np.inf))
    traffic, labels, hood = room_to_repair(task, 64, 4, **kind)
    assert _lns.plan_all(task, traffic, labels, np.arange(24), 0, 24)
    pairs = find_collisions(task, traffic, hood)
    left = _lns.repair(task, traffic, labels, hood, 4, pairs, 2000, np.random.default_rng(seed))
    verdict = judge(problem, plan_of_paths(list(traffic.at), 1.0))
    met = {(c.robot, c.other) for c in (*verdict.conflicts, *(verdict.following if "following" in kind else ()))}
    assert not verdict.faults
    assert len(met) <= left
    assert (left == 0) == (find_collisions(task, traffic, hood) == 0)
    if "following" in kind:
        assert left == len(met)


def test_guide_leads_round_lanes_that_others_come_along():
    """Two robots at opposite points of a ring change places: both ways are as long, and they go the same way round."""
    ring = roadmap([lane for i in range(10) for lane in ((i, (i + 1) % 10), ((i + 1) % 10, i))], 10)
    for seed in range(4):
        problem = problem_on(ring, [0, 5], [5, 0], seed)
        opening = search_start(problem, np.inf, 0, flow=1, following=False, rotations=True, packed=False)
        guide = opening.guided.guide
        assert guide[[0, 1], [5, 0]].tolist() == [0, 0]
        assert (guide[0, 1] < guide[0, 9]) == (guide[1, 6] < guide[1, 4])
        assert opening.world.table[0, 0] == 5


def test_costs_left_are_those_of_the_cheapest_way():
    problem = random_problem(9, 3, 1)
    opening = search_start(problem, np.inf, 0, flow=0, following=False, rotations=True, packed=False)
    assert not opening.guided.guided
    guide = search_start(problem, np.inf, 0, flow=2, following=False, rotations=True, packed=False).guided.guide
    graph, steps = problem.graph, opening.world.table
    assert (guide >= _flow.STEP * steps).all()
    for robot in range(3):
        left = guide[robot, graph.head] - guide[robot, graph.tail]
        assert (np.abs(left) <= _flow.MOST).all()
        best = np.full(graph.num_vertices, _flow.FAR)
        np.minimum.at(best, graph.tail, left)
        onward = (steps[robot] > 0) & (steps[robot] < UNREACHABLE)
        assert onward.any()
        assert (best[onward] <= -_flow.STEP).all()  # from everywhere some lane leads on


def test_robots_swap_in_a_corridor_with_one_siding():
    lanes = [(a, b) for i in range(6) for a, b in ((i, i + 1), (i + 1, i))] + [(3, 7), (7, 3)]
    problem = problem_on(roadmap(lanes, 8), [0, 6], [6, 0])
    result = Lacam().plan(problem, 20.0)
    assert judge(problem, result.plan).valid


def full_star():
    """Three robots on the three leaves of a star; whoever comes to the middle can only go back."""
    return problem_on(roadmap([lane for i in (1, 2, 3) for lane in ((0, i), (i, 0))], 4), [1, 2, 3], [2, 1, 3])


def test_lacam_proves_that_a_star_is_too_full_to_swap_in():
    result = Lacam().plan(full_star(), 20.0)
    assert result.status is Status.INFEASIBLE
    assert "every configuration" in result.message


def test_incomplete_planners_give_up_on_the_same_star():
    problem = full_star()
    result = Pibt(max_steps=100, num_attempts=2).plan(problem, 20.0)
    assert result.status is Status.GAVE_UP
    assert "2 attempts of 100 steps" in result.message
    result = Lns2().plan(problem, 0.2)
    assert result.status is Status.TIMED_OUT
    assert "left in collision" in result.message


@pytest.mark.parametrize("planner", [Pibt(), Lacam(), Lns2()])
def test_goal_against_one_way_lanes_is_infeasible_and_named(planner):
    problem = problem_on(roadmap([(0, 1), (1, 2), (2, 1)], 3), [1, 0], [0, 2])
    result = planner.plan(problem, 5.0)
    assert result.status is Status.INFEASIBLE
    assert result.message == "robot_0 cannot reach its goal 'v0' from 'v1'"


@pytest.mark.parametrize("planner", [Pibt(), Lacam(), Lns2()])
def test_one_way_ring_is_driven_round(planner):
    ring = roadmap([(i, (i + 1) % 6) for i in range(6)], 6)
    problem = problem_on(ring, [0, 2, 4], [2, 4, 0])
    result = planner.plan(problem, 20.0)
    assert result.status is Status.SOLVED, result.message
    assert judge(problem, result.plan).valid
    assert result.plan.end_s.tolist() == [2.0, 2.0, 2.0]


@pytest.mark.parametrize("seed", range(6))
def test_lacam_star_converges_to_the_least_sum_of_loss(seed):
    problem = random_problem(4, 3, seed, blocked=0.1)
    result = Lacam(anytime=True, polish=0, flow=0, neighbourhood=1).plan(problem, 30.0)
    assert judge(problem, result.plan).valid
    # it stops early only at the lower bound or when the search is exhausted
    assert loss(result.plan, problem) <= least_sum_of_loss(problem) or result.plan.end_s.sum() == result.lower_bound_steps


def test_anytime_never_returns_worse_than_first():
    problem = random_problem(12, 40, 3)
    result = Lacam(anytime=True).plan(problem, 1.0)
    assert result.stats["cost"] <= result.stats["polished_cost"] <= result.stats["first_solution_cost"]
    assert judge(problem, result.plan).valid
    result = Lns2(anytime=True).plan(problem, 1.0)
    assert result.stats["cost"] <= result.stats["first_solution_cost"]
    assert judge(problem, result.plan).valid


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
@pytest.mark.parametrize("planner", [Pibt(), Lacam(), Lns2()])
def test_time_limits_have_to_be_positive(planner, limit):
    with pytest.raises(PlanError, match="time limit"):
        planner.plan(problem_on(corridor(3), [0], [2]), limit)


@pytest.mark.parametrize(("made", "field"), [(Pibt, "num_attempts"), (Lacam, "num_tries"), (Lns2, "neighbourhood")])
def test_parameters_have_to_make_sense(made, field):
    with pytest.raises(PlanError, match=field):
        replace(made(), **{field: 0})


def test_tables_beyond_the_memory_are_not_made():
    result = Lns2(memory_mb=1).plan(random_problem(30, 60, 0), 5.0)
    assert result.status is Status.GAVE_UP
    assert "expected at most 1 MB" in result.message
    assert Lns2(memory_mb=1).plan(random_problem(40, 300, 0), 5.0).message == "tables of distances take more than 1 MB"


def test_memory_limit_is_a_result():
    problem = random_problem(14, 80, 5)
    result = Lacam(memory_mb=1, flow=0, polish=0, num_tries=1).plan(replace(problem, seed=1), 20.0)
    assert result.status in (Status.SOLVED, Status.TIMED_OUT)


def test_tables_are_shared_with_others_on_the_graph():
    problem = random_problem(8, 4, 0)
    assert (steps_table(problem, np.inf)[2] == distances(problem.graph).to(int(problem.target[2]))).all()
    assert steps_table(problem, -np.inf) is None


def test_kernels_say_the_same_without_the_compiler():
    """In new processes: one as Python, one from the cache of compiled code."""
    script = """
import numpy as np
from tests.planners.test_scalable import random_problem
from planners.configuration.lacam import Lacam
from planners.neighbourhood.lns2 import Lns2
from planners.configuration.pibt import Pibt

problem = random_problem(7, 12, 4)
for planner in (Pibt(), Lacam(polish=300), Lns2(polish=300)):
    planner.prepare()
    result = planner.plan(problem, 60.0)
    print(result.status, result.plan.vertex.tolist(), result.plan.arrive_s.tolist())
print(Lacam()._plan(problem, 60.0, True).plan.vertex.tolist())
"""
    said = [
        subprocess.run(
            [sys.executable, "-W", "error", "-c", script],
            env={**os.environ, "NUMBA_DISABLE_JIT": disabled, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p) + os.pathsep + "."},
            capture_output=True,
            text=True,
            check=False,
        )
        for disabled in ("0", "1")
    ]
    assert said[0].stdout == said[1].stdout, said[1].stderr[-2000:]
    assert said[0].stdout.count("solved") == 3
