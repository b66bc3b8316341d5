"""Plans from paths and back, problems that are refused, and positions between samples."""

import numpy as np
import pytest

from mrp_sumo.core.execution import Execution, Outcome, positions_at
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.plan import Plan, paths_of_plan, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import MrpSumoError, PlanError

ROBOT = RobotType("small", 0.3, 0.4, 1.0, 1.0, 1.0, 1.0)


def test_waits_collapse_into_visits():
    plan = plan_of_paths([[0, 0, 1, 2, 2], [3]], 2.0)
    assert plan.first.tolist() == [0, 3, 4]
    assert plan.vertex.tolist() == [0, 1, 2, 3]
    assert plan.arrive_s.tolist() == [0, 4, 6, 0]
    assert plan.depart_s.tolist() == [2, 4, np.inf, np.inf]
    assert plan.end_s.tolist() == [6, 0]


def test_paths_come_back_without_trailing_waits():
    paths = [[0, 0, 1, 2, 2], [3], [4, 5, 5, 5, 4]]
    assert [p.tolist() for p in paths_of_plan(plan_of_paths(paths, 0.3), 0.3)] == [[0, 0, 1, 2], [3], [4, 5, 5, 5, 4]]


def test_times_off_the_steps_are_refused():
    plan = Plan(np.array([0, 2]), np.array([0, 1]), np.array([0.0, 1.5]), np.array([0.0, np.inf]))
    with pytest.raises(PlanError, match="not at a whole step"):
        paths_of_plan(plan, 1.0)
    with pytest.raises(PlanError, match="needs 3 steps for one lane"):
        paths_of_plan(plan, 0.5)


def test_plan_of_no_robots_is_empty():
    assert plan_of_paths([], 1.0).num_robots == 0


@pytest.mark.parametrize(
    ("start", "goal", "goal_of", "words"),
    [
        ([0, 0], [1, 2], [0, 1], "robot_0 and robot_1 both start at 'dock'"),
        ([0, 7], [1, 2], [0, 1], "start 7 is not a vertex of 't'"),
        ([0, 1], [1, 2], [1, 1], "two robots are assigned the same goal"),
        ([0], [1], [0], "2 robots have 1 starts"),
    ],
)
def test_impossible_problem_is_refused(start, goal, goal_of, words):
    nav = nav_graph(name="t", xy=[(i, 0) for i in range(3)], lanes=[(0, 1), (1, 2)], vertex_name=["dock", "", ""])
    graph = plan_graph(nav, kind="roadmap", cell_m=1.0)
    with pytest.raises(PlanError, match=words):
        Problem(graph, fleet_of(ROBOT, 2), np.array(start), np.array(goal), np.array(goal_of), 1.0)


def test_robot_type_without_speed_is_refused():
    with pytest.raises(MrpSumoError, match="max_speed_mps is 0"):
        RobotType("stone", 1, 1, 0, 1, 1, 1)


def test_separation_is_both_circles_and_the_gap():
    assert fleet_of(ROBOT, 3).separation_m == pytest.approx(0.5 + 0.1)


def test_position_between_samples_is_linear_and_turns_the_short_way():
    execution = Execution(
        t_s=np.array([0.0, 1.0, 2.0]),
        x_m=np.array([[0.0], [2.0], [2.0]]),
        y_m=np.zeros((3, 1)),
        yaw_rad=np.array([[3.0], [-3.0], [-3.0]]),
        speed_mps=np.zeros((3, 1)),
        arrived_s=np.zeros(1),
        goal_s=np.zeros(1),
        outcome=Outcome.COMPLETED,
        policy="adg",
        sim_time_s=2.0,
        wall_time_s=1.0,
        cpu_time_s=1.0,
    )
    x, _, yaw = positions_at(execution, np.array([-1.0, 0.5, 1.0, 9.0]))
    assert x[:, 0].tolist() == [0.0, 1.0, 2.0, 2.0]
    assert yaw[1, 0] == pytest.approx(np.pi, abs=1e-12)


@pytest.mark.parametrize(
    ("arrive", "depart", "words"),
    [([0, 3, 2], [2, 1, np.inf], "leaves visit 1 before it arrives"), ([0, 1, 1e15], [0, 1e15 - 1, np.inf], "at most 1000000")],
)
def test_plan_that_cannot_be_written_step_by_step_is_refused(arrive, depart, words):
    plan = Plan(np.array([0, 3]), np.array([0, 1, 2]), np.array(arrive, np.float64), np.array(depart, np.float64))
    with pytest.raises(PlanError, match=words):
        paths_of_plan(plan, 1.0)
