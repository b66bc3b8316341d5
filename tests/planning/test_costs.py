"""What assigning a robot to a goal costs, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import graph_of, problem_on

from mrp_sumo.core.fleet import fleet_of_types
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.planning.costs import costs_of

SMALL, LARGE = (RobotType(name, size, size, 1.0, 1.0, 1.0, 1.0) for name, size in (("small", 0.2), ("large", 0.8)))


def test_each_robot_counts_the_lanes_of_its_own_type():
    """A ring 0-1-2-3. Both are a lane from their goal, at 1, but the large robot has no room between 1 and 2: it drives round."""
    graph = graph_of([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1), (1, 2), (2, 3), (3, 0)], 1.0)
    kind, barred = np.array([0, 1]), np.zeros((2, graph.num_lanes), np.bool_)
    barred[1, [graph.lane_between(1, 2), graph.lane_between(2, 1)]] = True
    start, goal = np.array([0, 2]), np.array([1])
    problem = Problem(graph, fleet_of_types([SMALL, LARGE], kind), start, goal, np.full(2, -1), 1.0, barred=barred)
    assert costs_of(problem, "path").tolist() == [[1], [3]]
    shut = barred | (graph.head == 1) & (kind == 1)[:, None]
    assert costs_of(replace(problem, barred=shut), "path").tolist() == [[1], [np.inf]]


@pytest.mark.parametrize(("kind", "cost"), [("path", 4), ("euclidean", 5.0), ("manhattan", 7.0)])
def test_a_goal_four_lanes_away_is_five_metres_off_and_seven_along_the_axes(kind, cost):
    graph = graph_of([(0, 0), (3, 0), (3, 2), (5, 2), (3, 4)], [(0, 1), (1, 2), (2, 3), (3, 4)], 1.0)
    assert costs_of(problem_on(graph, [0], [4]), kind).tolist() == [[cost]]


@pytest.mark.parametrize(("at_once", "looks"), [(1, 3), (2, 2), (3, 1)])
def test_goals_are_looked_at_a_few_at_a_time_and_all_of_them(monkeypatch, at_once, looks):
    graph = graph_of([(0, 0), (1, 0), (2, 0), (3, 0)], [(0, 1), (1, 2), (2, 3)], 1.0)
    monkeypatch.setattr("mrp_sumo.search.distance.TABLES_AT_ONCE", at_once)
    clock = []
    assert costs_of(problem_on(graph, [0, 3], [1, 2, 3]), "path", lambda: clock.append(0)).tolist() == [[1, 2, 3], [2, 1, 0]]
    assert len(clock) == looks
