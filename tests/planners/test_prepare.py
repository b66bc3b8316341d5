"""What `prepare` has to do: leave nothing to compile or to load while planning time is measured."""

import sys

import numpy as np
import pytest

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.planning.registry import planner, planner_names
from mrp_sumo.search import distance
from mrp_sumo.search._kernel import Kernel, is_compiled
from mrp_sumo.traffic.draw import uniform_draw

pytestmark = pytest.mark.skipif(not is_compiled(), reason="nothing is compiled")


def compiled():
    """How much machine code of each kernel is ready in this process."""
    outcome = {}
    for name, module in list(sys.modules.items()):
        if module is not None and name.split(".")[0] in ("planners", "mrp_sumo"):
            kernels = [k for k in vars(module).values() if isinstance(k, Kernel)]
            outcome |= {f"{k.__module__}.{k.__name__}": k.num_types for k in kernels}
    return outcome


@pytest.mark.parametrize("name", [n for n in planner_names() if n not in ("external", "plan_file")])
@pytest.mark.parametrize(("side", "robots"), [(24, 25), (9, 20)])  # the second so crowded that searches take turns
def test_planning_compiles_nothing_after_prepare(name, side, robots):
    free = np.random.default_rng(5).random((side, side)) > 0.15
    graph = grid_graph(free, 1.0, (0.0, 0.0))
    start, goal = uniform_draw(graph, robots, 3)
    fleet = fleet_of(RobotType("dot", 0.1, 0.1, 1.0, 1.0, 1.0, 1.0), len(start))
    chosen = planner(name, {})
    goal_of = np.full(len(start), -1) if chosen.assigns else np.arange(len(start))
    problem = Problem(graph, fleet, start, goal, goal_of, 1.0)
    distance.prepare()
    chosen.prepare()
    before = compiled()
    chosen.plan(problem, 0.4)
    assert {kernel: n for kernel, n in compiled().items() if n != before.get(kernel, 0)} == {}


def test_bettering_an_incumbent_compiles_nothing():
    free = np.random.default_rng(5).random((16, 16)) > 0.15
    graph = grid_graph(free, 1.0, (0.0, 0.0))
    start, goal = uniform_draw(graph, 70, 3)
    fleet = fleet_of(RobotType("dot", 0.1, 0.1, 1.0, 1.0, 1.0, 1.0), 70)
    problem = Problem(graph, fleet, start, goal, np.arange(70), 1.0)
    chosen = planner("eecbs", {})
    distance.prepare()
    chosen.prepare()
    before = compiled()
    result = chosen.plan(problem, 2.0)
    assert result.stats["incumbent_cost"] > 0  # LNS found a plan and went on from there
    assert {kernel: n for kernel, n in compiled().items() if n != before.get(kernel, 0)} == {}
