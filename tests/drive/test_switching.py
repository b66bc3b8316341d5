"""Switching the order of passages: nobody waits for who is late, nobody waits for ever, and the least order of small worlds is found."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds import BURGER, cross, drive, least_distance_m, problem_of, square_grid

from mrp_sumo.core.disturbances import Breakdown, Disturbances
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.plan import Plan, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive.live_plan import LivePlan
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.policy import Adg
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.switching import best_order, cost_of, net_of, scratch_for
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.metrics.audit import audit
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.draw import uniform_draw
from mrp_sumo.traffic.passages import order_of, permuted, vertex_needs
from mrp_sumo.traffic.schedule import check_order

pytestmark = pytest.mark.kernel

CROSSING = [[3, 2, 1, 0, 7], [6, 6, 6, 5, 4, 0, 10]]  # robot_0 first
STPG = Path(__file__).parents[3] / "shared" / "reference" / "data" / "stpg"


def under_way(problem, plan, held=()):
    """A plan of which nothing has been driven; some robots are held."""
    num_robots, needs = problem.num_robots, vertex_needs(plan, problem.graph.num_vertices)
    granted = np.zeros(plan.num_visits, np.bool_)
    granted[plan.first[:-1]] = True
    at_start = replace(plan, arrive_s=np.where(granted, -1.0, plan.arrive_s))
    none = np.zeros(num_robots)
    return LivePlan(**vars(at_start), order=order_of(plan, needs), driven_m=none, late_s=none, held=np.isin(np.arange(num_robots), held))


def net_and_plan(problem, plan, held, hold_s=30.0):
    live = under_way(problem, plan, held)
    return net_of(problem, live, live.order, 0.0, hold_s), live


def least_cost(net, schedule):
    """Over all orders that keep what has been granted in front."""
    scratch, blocks = scratch_for(net), []
    for begin, end in itertools.pairwise(schedule.first.tolist()):
        granted = [e for e in range(begin, end) if net.fixed[e]]
        blocks.append([granted + list(rest) for rest in itertools.permutations(e for e in range(begin, end) if not net.fixed[e])])
    orders = (np.array([e for block in choice for e in block], np.int64) for choice in itertools.product(*blocks))
    return min(cost_of(net, order, scratch) for order in orders)


def test_a_robot_passes_before_one_that_is_late(tmp_path):
    held = Disturbances(breakdowns=(Breakdown(0, 0.5, 30.0),))
    remaining, changed = (drive(tmp_path, cross(), CROSSING, policy, disturbances=held) for policy in ("adg", "adg_switch"))
    assert remaining.all_at_goal and changed.all_at_goal
    assert remaining.goal_s[0] < remaining.goal_s[1]
    assert changed.goal_s[1] < 25.0 < changed.goal_s[0] <= remaining.goal_s[0] + 3.0
    assert least_distance_m(changed) >= 0.325


def test_nothing_is_changed_while_nobody_is_late(tmp_path):
    problem, plan = problem_of(square_grid(3), [[0, 1, 2, 5], [6, 3, 4, 4, 1], [8, 7, 6]])
    plan = retime(problem, plan, ExecutionSettings())
    remaining, other = (simulate(problem, plan, ExecutionSettings(policy=p, engine="kinematic"), tmp_path) for p in ("adg", "adg_switch"))
    assert (remaining.x_m == other.x_m).all() and (remaining.y_m == other.y_m).all()
    assert other.arrived_s == pytest.approx(plan.arrive_s, abs=0.1)


def test_a_policy_sees_who_is_where_and_how_late(tmp_path, monkeypatch):
    seen = {}

    def decide(self, problem, plan, needs, now_s):
        seen[now_s] = plan

    monkeypatch.setattr(Adg, "decides_every_s", 5.0, raising=False)
    monkeypatch.setattr(Adg, "decide", decide, raising=False)
    drive(tmp_path, cross(), CROSSING, "adg", disturbances=Disturbances(breakdowns=(Breakdown(0, 0.5, 30.0),)))
    assert seen[5.0].held.tolist() == [True, False] and seen[35.0].held.tolist() == [False, False]
    assert 0 < seen[5.0].driven_m[0] < 0.2 and seen[5.0].driven_m[0] == seen[30.0].driven_m[0]
    assert seen[30.0].late_s[0] - seen[10.0].late_s[0] == pytest.approx(20.0)
    first, last = seen[5.0].order, seen[30.0].order
    assert first.robot[first.first[0]] == last.robot[last.first[0]] == 0  # at the middle


@pytest.mark.parametrize("held", [[0], [1], [2], [0, 1], []])
@pytest.mark.parametrize(
    "paths",
    [
        [[3, 2, 1, 0, 10, 11], [6, 6, 6, 5, 4, 0, 1, 2], [9, 9, 9, 9, 9, 8, 7, 0, 4, 5]],
        [[2, 1, 0, 7, 8], [6, 6, 5, 4, 0, 10, 11], [3, 3, 3, 3, 2, 1, 0, 4]],
    ],
)
def test_the_best_order_of_a_small_world_is_found(paths, held):
    problem, plan = problem_of(cross(), paths)
    net, live = net_and_plan(problem, plan, held)
    start, scratch = np.arange(len(net.robot)), scratch_for(net)
    least = least_cost(net, live.order)
    result = best_order(net, start, 0.0, 1000)
    assert cost_of(net, start if result is None else result, scratch) == pytest.approx(least)


def test_opposite_ways_through_a_corridor_switch_together():
    paths = [[3, 3, 3, 3, 3, 2, 1, 0, 7, 8], [9, 8, 7, 0, 4]]  # along one arm, one after the other
    problem, plan = problem_of(cross(), paths)
    net, live = net_and_plan(problem, plan, [1])
    order = best_order(net, np.arange(len(net.robot)), 0.0, 100)
    assert order is None  # robot_0 would end where robot_1 has to pass
    problem, plan = problem_of(cross(), [[3, 2, 1, 0, 4, 5], [9, 9, 9, 9, 9, 8, 7, 0, 10]])
    net, live = net_and_plan(problem, plan, [0])
    order = best_order(net, np.arange(len(net.robot)), 0.0, 100)
    assert order is not None
    check_order(problem, plan, permuted(live.order, order))


@pytest.mark.parametrize("budget", [1, 7, 50])
def test_a_decision_looks_no_oftener_than_its_budget(budget, monkeypatch):
    from mrp_sumo.drive import _switch, switching

    looks, depth = 0, 0

    def counted(name):
        kernel = getattr(_switch, name)

        def call(*arguments):
            nonlocal looks, depth
            depth += 1  # without the compiler, kernels call each other by these names too
            result = kernel(*arguments)
            depth -= 1
            looks += (result[1] if name == "switch" else 1) if not depth else 0
            return result

        return call

    problem, plan = problem_of(cross(), [[3, 2, 1, 0, 10, 11], [6, 6, 6, 5, 4, 0, 1, 2], [9, 9, 9, 9, 9, 8, 7, 0, 4, 5]])
    net, _ = net_and_plan(problem, plan, [0])
    for name in ("cost_of", "switch"):
        monkeypatch.setattr(switching._switch, name, counted(name))
    best_order(net, np.arange(len(net.robot)), 0.0, budget)
    assert 0 < looks <= max(budget, 1)


@pytest.mark.parametrize("seed", range(3))
def test_nobody_waits_for_ever_and_nobody_touches(tmp_path, seed):
    graph = grid_graph(np.random.default_rng(seed).random((6, 6)) >= 0.15, 0.4, (0.0, 0.0))
    start, goal = uniform_draw(graph, 6, seed)
    problem = Problem(graph, fleet_of(BURGER, 6), start, goal, np.arange(6), 2.5)
    method = planner("lacam", {"rotations": False})
    method.prepare()
    plan = method.plan(problem, 10.0).plan
    plan = retime(problem, plan, ExecutionSettings())
    delays = Disturbances(delay_probability=0.1, speed_spread=0.1 * (seed % 2), stops_per_s=0.02)
    how = ExecutionSettings(policy="adg_switch", engine="kinematic", disturbances=delays, time_limit_s=600.0, seed=seed)
    run = simulate(problem, plan, how, tmp_path)
    assert run.all_at_goal
    assert audit(run, problem.fleet)["num_overlaps"] == 0
    again = simulate(problem, plan, how, tmp_path)
    assert (run.x_m == again.x_m).all() and (run.goal_s == again.goal_s).all()


@pytest.mark.compiled
@pytest.mark.skipif(not STPG.exists(), reason="instances of Jiang et al. are not at hand")
@pytest.mark.parametrize("name", ["map_random-32-32-10_ins_1_an_60", "map_random-32-32-10_ins_10_an_80"])
def test_published_situations_get_better_and_stay_free_of_circles(name):
    for file in sorted((STPG / "sit").glob(f"{name}_sit_*.json")):
        net, order, problem, live = situation(file)
        before = cost_of(net, order, scratch_for(net))
        result = best_order(net, order, 0.0, 2000)
        assert result is not None and cost_of(net, result, scratch_for(net)) < before
        check_order(problem, live, permuted(live.order, result))


def situation(file: Path):
    """A published situation: every lane takes one step, robots have made `states` moves, and some are held for some steps."""
    data = json.loads(file.read_text())
    lines = (STPG / "path" / Path(data["path_file"]).name).read_text().splitlines()
    ways = [line.split(":")[1].strip(" >-").split("->") for line in lines if ":" in line]
    cells = [[tuple(map(int, cell.strip("()").split(","))) for cell in route] for route in ways]
    graph = grid_graph(np.ones((32, 32), np.bool_), 1.0, (0.0, 0.0))
    whole = plan_of_paths([[32 * y + x for y, x in path] for path in cells], 1.0)
    left = np.concatenate([np.arange(a + state, b) for a, b, state in zip(whole.first, whole.first[1:], data["states"])])
    first = np.concatenate([[0], np.cumsum(np.diff(whole.first) - data["states"])])
    plan = Plan(first, whole.vertex[left], whole.arrive_s[left], whole.depart_s[left])
    quick = RobotType("point", 0.1, 0.1, 1.0, 1e3, 1e3, 1e3)
    begins, ends = plan.vertex[first[:-1]], plan.last_vertex
    problem = Problem(graph, fleet_of(quick, len(cells)), begins, ends, np.arange(len(cells)), 1.0)
    net, live = net_and_plan(problem, plan, [])
    net = net._replace(ready_s=np.array(data["delay_steps"], np.float64), early_s=np.zeros(len(net.robot)))
    return net, np.arange(len(net.robot)), problem, live
