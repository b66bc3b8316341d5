"""The same small questions to every registered planner; the referee judges the answers."""

from dataclasses import fields, is_dataclass

import numpy as np
import pytest

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.plan import Status, paths_of_plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.referee import judge
from mrp_sumo.errors import PlanError
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.maps.roadmap import cut_lanes, plan_graph
from mrp_sumo.core.graph import nav_graph
from mrp_sumo.planning.registry import planner, planner_class, planner_names

ROBOT = RobotType("square", 0.3, 0.3, 1.0, 1.0, 1.0, 1.0)
ALL = tuple(name for name in planner_names() if name != "external")  # which is nothing without a program
COORDINATED = [name for name in ALL if planner_class(name).guarantee != "no coordination"]
SOLVERS = [name for name in COORDINATED if "not complete" not in planner_class(name).guarantee]


def world(picture, *, seed=0):
    """A Problem from a drawing: '.' free, '@' blocked, '0'..'9' starts, 'a'..'j' goals of those robots; top row first."""
    rows = picture.split()
    free = np.array([[c != "@" for c in row] for row in rows])
    number = np.cumsum(free.ravel()).reshape(free.shape) - 1
    places = {c: int(number[y, x]) for y, row in enumerate(rows) for x, c in enumerate(row) if c not in ".@"}
    count = sum(c.isdigit() for c in places)
    return Problem(
        graph=grid_graph(free, 1.0, (0.0, 0.0)),
        fleet=fleet_of(ROBOT, count),
        start=np.array([places[str(r)] for r in range(count)], np.int64),
        goal=np.array([places["abcdefghij"[r]] for r in range(count)], np.int64),
        goal_of=np.arange(count),
        step_s=1.0,
        seed=seed,
    )


def lanes(pairs, start, goal, num_vertices):
    """A Problem on a graph of directed lanes between vertices on a circle."""
    turn = np.arange(num_vertices) * 2 * np.pi / num_vertices
    nav = nav_graph(name="lanes", xy=np.column_stack([np.cos(turn), np.sin(turn)]), lanes=pairs, length_m=np.ones(len(pairs)))
    return Problem(
        graph=cut_lanes(nav, 1.0),
        fleet=fleet_of(ROBOT, len(start)),
        start=np.array(start, np.int64),
        goal=np.array(goal, np.int64),
        goal_of=np.arange(len(start)),
        step_s=1.0,
    )


def made(name):
    found = planner(name, {})
    found.prepare()
    return found


def solved(name, problem, time_limit_s=20.0):
    result = made(name).plan(problem, time_limit_s)
    assert result.status is Status.SOLVED, result.message
    verdict = judge(problem, result.plan, result.goal_of)
    assert not verdict.faults
    if name in COORDINATED:
        assert verdict.valid, verdict.summary(problem)
    assert result.lower_bound_steps <= result.plan.end_s.sum() + 1e-6
    assert result.planning_time_s > 0
    return result


@pytest.mark.parametrize("name", ALL)
def test_planner_is_a_frozen_dataclass_with_a_guarantee(name):
    made_class = planner_class(name)
    assert is_dataclass(made_class)
    assert made_class.__dataclass_params__.frozen
    assert isinstance(made_class.assigns, bool)
    assert made_class.guarantee
    assert {f.name for f in fields(made_class)}.isdisjoint({"assigns", "guarantee"})


@pytest.mark.parametrize("name", ALL)
def test_robot_alone_takes_the_shortest_path(name):
    result = solved(name, world("0.. @@. a.."))
    assert result.plan.end_s.tolist() == [6.0]
    assert result.lower_bound_steps <= 6


@pytest.mark.parametrize("name", ALL)
def test_robots_at_their_goals_stay(name):
    problem = world("0.1")
    result = made(name).plan(problem.__class__(**{**problem.__dict__, "goal": problem.start}), 5.0)
    assert result.status is Status.SOLVED
    assert result.plan.end_s.sum() == 0


@pytest.mark.parametrize("name", ALL)
def test_no_robots_need_no_plan(name):
    problem = Problem(
        graph=grid_graph(np.ones((1, 2), bool), 1.0, (0.0, 0.0)),
        fleet=fleet_of(ROBOT, 0),
        start=np.zeros(0, np.int64),
        goal=np.zeros(0, np.int64),
        goal_of=np.zeros(0, np.int64),
        step_s=1.0,
    )
    result = made(name).plan(problem, 5.0)
    assert result.status is Status.SOLVED
    assert result.plan.num_robots == 0
