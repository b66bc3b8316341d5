"""Gets the controller's kernels compiled or loaded before time is measured, without SUMO."""

from functools import cache

import numpy as np

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.plan import Plan, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive import _observe
from mrp_sumo.drive.controller import Controller
from mrp_sumo.drive.facilities import facilities_of
from mrp_sumo.drive.fit import resources_for
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.policy import policy_of
from mrp_sumo.drive.reroute import first_of
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.state import tape_for
from mrp_sumo.drive.world import World
from mrp_sumo.engines.kinematic.engine import KinematicEngine


@cache  # once a process, and not to push the resources of real graphs out of memory
def prepare(engine: str = "sumo") -> None:
    """Let the controller look at one robot on one lane, twice, and watch it, or with the engine `kinematic` drive it on by itself."""
    problem, plan = _one_robot()
    policy, settings = policy_of("adg"), ExecutionSettings()
    ledger = Ledger(problem, resources_for(problem, plan))
    ledger.append(first_of(plan), policy, 0.0)
    controller = Controller(ledger, policy, settings)
    conditions = World(problem, settings, facilities_of(problem.graph, ledger.resources)).conditions
    bodies = KinematicEngine(problem.graph, problem.fleet, 0.1)
    bodies.place(ledger.visits)
    for step in range(2):
        controller.advance(step * 0.1, bodies, conditions, observe=step > 0)
    tape = tape_for(1, 1, 1)
    if engine == "kinematic":
        controller.drive_on(2, 0, bodies, conditions, tape)
    else:
        controller.watch(2, bodies, conditions, tape, is_last=True)
    _observe.waiting_cycles(np.zeros(1, np.int64), np.zeros(1))
    prepare_retime()


@cache
def prepare_retime() -> None:
    """Retime a plan for one robot on one lane."""
    retime(*_one_robot(), ExecutionSettings())


def _one_robot() -> tuple[Problem, Plan]:
    nav = nav_graph(name="lane", xy=[(0, 0), (1, 0)], lanes=[(0, 1), (1, 0)])
    graph = plan_graph(nav, kind="roadmap", cell_m=1.0)
    fleet = fleet_of(RobotType("dot", 0.1, 0.1, 1.0, 1.0, 1.0, 1.0), 1)
    problem = Problem(graph, fleet, np.array([0]), np.array([1]), np.array([0]), 1.0)
    return problem, plan_of_paths([[0, 1]], 1.0)
