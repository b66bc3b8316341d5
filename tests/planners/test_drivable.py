"""Plans for robots that keep their order: nobody comes too close to anybody, nobody rotates, and complete planners stay complete."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from truth import Rules, crowded_problem, least_cost
from worlds import BURGER, problem_on, square_grid

from mrp_sumo.core.fleet import fleet_of, fleet_of_types
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.plan import Status, paths_of_plan, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.motion_plan import lanes_along
from mrp_sumo.planning.answers import answer_of
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.passages import order_of
from mrp_sumo.traffic.referee import judge
from mrp_sumo.traffic.resources import needs_of
from mrp_sumo.traffic.schedule import check_order

PLANNERS = {
    "cbs": [{}, {"symmetries": False, "heuristic": False, "bypass": False}, {"disjoint": True}],
    "ecbs": [{"w": 1.2}],
    "eecbs": [{"w": 1.2}],
    "cbs_ta": [{}],
    "ecbs_ta": [{}],
    "lacam": [{}, {"packed": True}],
    "lns2": [{}, {"threads": 2}],
    "pibt": [{}],
    "prioritised": [{}],
}
BOUND = {"cbs": 1.0, "ecbs": 1.2, "eecbs": 1.2}
COMPLETE = ("cbs", "ecbs", "eecbs", "lacam")
ASKED = [(name, parameters) for name, kinds in PLANNERS.items() for parameters in kinds]


def answer(name, parameters, problem, limit_s=1.0):
    parameters = dict(parameters)
    packed = parameters.pop("packed", None)
    method = planner(name, parameters)
    method.prepare()
    if packed is None or (problem.graph.reverse < 0).any():  # what is packed needs lanes both ways
        return method.plan(problem, limit_s)
    return method._plan(problem, limit_s, packed)


def check_plan(problem, plan):
    """The referee has nothing against it, every step keeps the slow rules, and its order can be kept."""
    assert judge(problem, plan).valid
    rules = Rules(problem)
    paths = paths_of_plan(plan, problem.step_s)
    for t in range(1, max(map(len, paths))):
        at, there = ([int(path[min(step, len(path) - 1)]) for path in paths] for step in (t - 1, t))
        assert rules.allow(at, there), (t, at, there)
    needs = needs_of(problem.graph, plan, lanes_along(problem.graph, plan)[0], rules.found, problem.fleet.kind)
    check_order(problem, plan, order_of(plan, needs))


def check(name, parameters, problem, limit_s):
    """Put one question to a planner and to the slow search, and hold the answer against the truth."""
    result = answer(name, parameters, problem, limit_s)
    if result.status is Status.SOLVED:
        check_plan(problem if result.goal_of is None else problem.assigned(result.goal_of), result.plan)
    if name.endswith("_ta") or result.status is Status.TIMED_OUT:
        return
    best = least_cost(problem)
    if result.status is Status.INFEASIBLE:
        assert best is None, (best, result.message)
        return
    if name in COMPLETE:
        assert (result.status is Status.SOLVED) == (best is not None), (best, result.message)
    if result.status is Status.SOLVED:
        cost = result.plan.end_s.sum()
        assert best <= cost
        assert name not in BOUND or cost <= BOUND[name] * best + 1e-9
        assert result.lower_bound_steps <= best


@pytest.mark.parametrize(("name", "parameters"), ASKED, ids=str)
def test_plans_are_drivable_and_guarantees_hold(name, parameters):
    for seed in range(10):
        check(name, parameters, crowded_problem(seed, num_vertices=6), 0.2)


@pytest.mark.campaign
@pytest.mark.parametrize(("name", "parameters"), ASKED, ids=str)
def test_plans_are_drivable_and_guarantees_hold_on_hundreds(name, parameters):
    for seed in range(1000, 1400):
        check(name, parameters, crowded_problem(seed, num_vertices=6 + seed % 3), 1.0)


@pytest.mark.parametrize(("name", "parameters"), ASKED, ids=str)
def test_nobody_rotates(name, parameters):
    """Three robots that could change places in one step on a ring of four."""
    graph = square_grid(3)
    problem = replace(problem_on(graph, [0, 1, 4, 3], [1, 4, 3, 0]), fleet=fleet_of(BURGER, 4))
    strict = replace(problem, drivable=True)
    result = answer(name, parameters, strict)
    assert result.status is Status.SOLVED
    check_plan(strict if result.goal_of is None else strict.assigned(result.goal_of), result.plan)


@pytest.mark.parametrize(("name", "parameters"), ASKED, ids=str)
def test_goals_that_are_too_close_are_named(name, parameters):
    nav = nav_graph(name="fork", xy=[(0, 0), (1, 0), (1, 0.2), (0, 1)], lanes=[(0, 1), (1, 0), (0, 2), (2, 0), (0, 3), (3, 0)])
    graph = plan_graph(nav, kind="roadmap", cell_m=1.0)
    problem = Problem(graph, fleet_of(BURGER, 2), np.array([0, 3]), np.array([1, 2]), np.arange(2), 1.0, drivable=True)
    result = answer(name, parameters, problem)
    assert result.status is Status.INFEASIBLE
    assert "v1" in result.message and "v2" in result.message


@pytest.mark.parametrize("name", ["prioritised", "continuous", "pbs"])
def test_a_large_robot_takes_the_way_round_that_a_small_one_need_not(name):
    """From 0 to 2 directly by 1, where only the small one has room, or by 3, 4 and 5."""
    graph = plan_graph(
        nav_graph(
            name="ring",
            xy=[(0, 0), (2, 0), (4, 0), (4, 2), (2, 2), (0, 2)],
            lanes=[lane for a in range(6) for lane in ((a, (a + 1) % 6), ((a + 1) % 6, a))],
        ),
        kind="roadmap",
        cell_m=2.0,
    )
    barred = np.zeros((2, graph.num_lanes), np.bool_)
    barred[1, (graph.tail == 1) | (graph.head == 1)] = True
    fleet = fleet_of_types([BURGER, replace(BURGER, length_m=0.6, width_m=0.6)], np.array([0, 1]))
    problem = Problem(graph, fleet, np.array([2, 0]), np.array([5, 3]), np.arange(2), 12.0, drivable=True, barred=barred)
    method = planner(name, {})
    method.prepare()
    result = answer_of(method, problem, 10.0)
    assert result.plan is not None
    ways = [result.plan.vertex[a:b].tolist() for a, b in pairwise(result.plan.first.tolist())]
    assert 1 not in ways[1] and judge(problem, result.plan, in_seconds=name != "prioritised").valid
    through = plan_of_paths([[2, 3, 4, 5], [0, 1, 2, 3]], problem.step_s)
    assert "robot_1 drives from 'v0' to 'v1' at 0 s, where a burger has no room" in judge(problem, through).faults
