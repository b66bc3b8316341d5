"""The same small questions to every registered planner; the referee judges the answers."""

from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from worlds import SQUARE, on_a_circle
from worlds import drawn as world

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.plan import Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.planning.registry import planner, planner_class, planner_names
from mrp_sumo.traffic.referee import judge
from mrp_sumo.traffic.schedule import schedule_of

pytestmark = pytest.mark.kernel

ALL = tuple(name for name in planner_names() if name not in ("external", "plan_file"))  # nothing without a program, or a file
ASSIGNING = [name for name in ALL if planner_class(name).assigns]
COORDINATED = [name for name in ALL if planner_class(name).guarantee != "no coordination"]
IN_STEPS = [name for name in ALL if "seconds" not in getattr(planner_class(name), "supports", ())]  # a lane is a step for these
COMPLETE = [name for name in COORDINATED if not any(w in planner_class(name).guarantee for w in ("not complete", "incomplete", "none"))]


def lanes(pairs, start, goal, num_vertices):
    """A Problem on a graph of directed lanes between vertices on a circle."""
    return Problem(
        graph=on_a_circle(pairs, num_vertices),
        fleet=fleet_of(SQUARE, len(start)),
        start=np.array(start, np.int64),
        goal=np.array(goal, np.int64),
        goal_of=np.arange(len(start)),
        step_s=1.0,
    )


def made(name):
    outcome = planner(name, {})
    outcome.prepare()
    return outcome


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
    assert result.plan.vertex.tolist() == [0, 1, 2, 3, 6, 5, 4]
    if name in IN_STEPS:
        assert result.plan.end_s.tolist() == [6.0]


@pytest.mark.parametrize("name", ALL)
def test_robots_at_their_goals_stay(name):
    result = made(name).plan(world("0.1"), 5.0)
    assert result.status is Status.SOLVED
    assert result.plan.end_s.sum() == 0


@pytest.mark.parametrize("name", ALL)
def test_no_robots_need_no_plan(name):
    problem = Problem(
        graph=grid_graph(np.ones((1, 2), bool), 1.0, (0.0, 0.0)),
        fleet=fleet_of(SQUARE, 0),
        start=np.zeros(0, np.int64),
        goal=np.zeros(0, np.int64),
        goal_of=np.zeros(0, np.int64),
        step_s=1.0,
    )
    result = made(name).plan(problem, 5.0)
    assert result.status is Status.SOLVED
    assert result.plan.num_robots == 0


@pytest.mark.parametrize("name", COORDINATED)
def test_robots_pass_each_other_where_there_is_room(name):
    result = solved(name, world("0.....1 b.....a"))
    assert result.plan.end_s.sum() >= 14


@pytest.mark.parametrize("name", COMPLETE)
def test_one_robot_steps_aside_into_the_bay(name):
    solved(name, world("@@.@@ b0.1a"))


@pytest.mark.parametrize("name", COORDINATED)
def test_four_robots_cross_in_an_open_square(name):
    solved(name, world("..0.3 .d... 1...b .2... c.a.."))


@pytest.mark.parametrize("name", COORDINATED)
def test_directed_lanes_are_driven_forwards(name):
    result = solved(name, lanes([(0, 1), (1, 2), (2, 3), (3, 0)], [0, 2], [3, 1], 4))
    lanes_driven = result.plan.num_visits - 2
    assert lanes_driven == 6  # goals that are given are kept, by planners that assign, too
    if name in IN_STEPS:
        assert result.plan.end_s.tolist() == [lanes_driven / 2] * 2


@pytest.mark.parametrize("name", [name for name in ALL if name not in ASSIGNING])  # those choose among goals: see the next test
def test_goal_out_of_reach_names_robot_and_goal(name):
    result = made(name).plan(lanes([(0, 1), (1, 0), (2, 3), (3, 2)], [0], [3], 4), 5.0)
    assert result.status is Status.INFEASIBLE
    assert "robot_0" in result.message
    assert "v3" in result.message


@pytest.mark.parametrize("name", [n for n in ALL if planner_class(n).assigns])
def test_no_assignment_in_reach_is_infeasible(name):
    result = made(name).plan(lanes([(0, 1), (1, 0), (2, 3), (3, 2)], [0], [3], 4), 5.0)
    assert result.status is Status.INFEASIBLE
    assert result.message


@pytest.mark.parametrize("name", [name for name in COORDINATED if name not in ASSIGNING])  # those need not swap
def test_swap_in_a_dead_end_corridor_is_infeasible(name):
    corridor = world("0.1")
    problem = replace(corridor, goal=corridor.start[::-1].copy())
    result = made(name).plan(problem, 0.5)
    assert result.status is Status.INFEASIBLE
    assert result.plan is None
    assert result.message


@pytest.mark.parametrize("name", ALL)
def test_time_limit_of_zero_is_refused(name):
    with pytest.raises(PlanError, match="time limit"):
        planner(name, {}).plan(world("0.a"), 0.0)


@pytest.mark.parametrize("name", ALL)
def test_same_seed_gives_the_same_plan(name):
    problem = world("0..1 .... b..a")
    first, second = (solved(name, problem).plan for _ in range(2))
    for column in ("first", "vertex", "arrive_s", "depart_s"):
        assert getattr(first, column).tolist() == getattr(second, column).tolist()


CROSSING = "..0.3 .d... 1...b .2... c.a.."


@pytest.mark.compiled
@pytest.mark.parametrize("name", [n for n in COORDINATED if "following" in {f.name for f in fields(planner_class(n))}])
def test_nobody_enters_a_vertex_while_another_leaves_it_where_that_is_asked(name):
    problem = world(CROSSING)
    made_strict = planner(name, {"following": True})
    made_strict.prepare()
    result = made_strict.plan(problem, 20.0)
    assert result.status is Status.SOLVED, result.message
    verdict = judge(problem, result.plan, result.goal_of)
    assert verdict.valid
    assert not verdict.following


@pytest.mark.parametrize("name", [n for n in COORDINATED if "rotations" in {f.name for f in fields(planner_class(n))}])
def test_no_ring_of_robots_turns_where_that_is_asked(name):
    problem = world("01. 32. ...")
    problem = replace(problem, goal=problem.start[[1, 2, 3, 0]].copy())
    made_strict = planner(name, {"rotations": False})
    made_strict.prepare()
    result = made_strict.plan(problem, 20.0)
    assert result.status is Status.SOLVED, result.message
    assert judge(problem, result.plan).valid
    schedule_of(problem, result.plan)


@pytest.mark.parametrize("name", [name for name in IN_STEPS if name in COORDINATED])
def test_full_one_way_ring_turns_where_robots_need_not_keep_an_order(name):
    ring = lanes([(k, (k + 1) % 5) for k in range(5)], range(5), [1, 2, 3, 4, 0], 5)
    assert solved(name, ring).plan.end_s.tolist() == [1.0] * 5
    if name in COMPLETE:
        assert made(name).plan(replace(ring, drivable=True), 20.0).status is Status.INFEASIBLE


@pytest.mark.parametrize("name", ALL)
def test_two_robots_sent_to_one_vertex_are_infeasible(name):
    problem = world("0.1 ...")
    problem = replace(problem, goal=np.array([4, 4]), goal_of=np.full(2, -1) if planner_class(name).assigns else np.arange(2))
    result = made(name).plan(problem, 5.0)
    assert result.status is Status.INFEASIBLE
    assert "v4" in result.message
