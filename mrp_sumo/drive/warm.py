"""Gets the controller's kernels compiled or loaded before time is measured, without SUMO."""

import numpy as np

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.graph import PlanGraph, frozen, nav_graph
from mrp_sumo.core.plan import plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive import _controller
from mrp_sumo.drive.disturbances import NONE
from mrp_sumo.drive.disturber import Disturber
from mrp_sumo.drive.motion_plan import course_of, empty_log, empty_news, fresh_state
from mrp_sumo.drive.policy import policy_of


def prepare() -> None:
    """Let the controller look at one robot on one lane, twice."""
    nav = nav_graph(name="lane", xy=[(0, 0), (1, 0)], lanes=[(0, 1), (1, 0)])
    graph = PlanGraph(**vars(nav), kind="roadmap", cell_m=1.0, vertex_of_station=frozen(np.arange(2)))
    fleet = fleet_of(RobotType("dot", 0.1, 0.1, 1.0, 1.0, 1.0, 1.0), 1)
    problem = Problem(graph, fleet, np.array([0]), np.array([1]), np.array([0]), 1.0)
    course = course_of(problem, plan_of_paths([[0, 1]], 1.0), policy_of("adg"), 0.1)
    state, log, news = fresh_state(course), empty_log(1), empty_news(1)
    around = Disturber(NONE, graph, 1, 0.1, 1.0, 0.1, 0).around
    for step in range(2):
        _controller.advance(
            *(step > 0, step * 0.1, 0.1, np.zeros(1), course.drive, course.path, course.need, state, log, news, around),
            *(1.0, 10.0, 0.1, 0.5, 4, False),
        )
    _controller.waiting_cycles(state)
