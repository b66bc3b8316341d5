"""Gets the controller's kernels compiled or loaded before time is measured, by a drive without SUMO."""

from collections.abc import Callable
from typing import Any

import numpy as np

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.graph import FloatArray, PlanGraph, frozen, nav_graph
from mrp_sumo.core.plan import plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.sim.course import course_of
from mrp_sumo.sim.loop import drive
from mrp_sumo.sim.policy import policy_of
from mrp_sumo.sim.settings import ExecutionSettings


def prepare() -> None:
    """Drive one robot, which does not move, along one lane for two steps."""
    nav = nav_graph(name="lane", xy=[(0, 0), (1, 0)], lanes=[(0, 1), (1, 0)])
    graph = PlanGraph(**vars(nav), kind="roadmap", cell_m=1.0, vertex_of_station=frozen(np.arange(2)))
    fleet = fleet_of(RobotType("dot", 0.1, 0.1, 1.0, 1.0, 1.0, 1.0), 1)
    problem = Problem(graph, fleet, np.array([0]), np.array([1]), np.array([0]), 1.0)
    plan, settings = plan_of_paths([[0, 1]], 1.0), ExecutionSettings(time_limit_s=0.2)
    course = course_of(problem, plan, policy_of(settings.policy), settings.step_length_s)
    stand_in: Any = _Standstill()
    drive(problem, plan, settings, course, stand_in, None)


class _Standstill:
    """Takes every order of `Sumo` and does nothing."""

    names = ("robot_0",)

    def lane_length_m(self, edge: str) -> float:
        return 1.0

    def edge(self, robot: int) -> str:
        return "e0_1"

    def driven_m(self) -> FloatArray:
        return np.zeros(1)

    def collisions(self) -> list[tuple[str, str, str]]:
        return []

    def __getattr__(self, order: str) -> Callable[..., None]:
        return lambda *_: None
