"""Robots that ride lifts, with times known by hand."""

import numpy as np
import pytest
from worlds import problem_of, two_levels

from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.metrics.audit import audit

STEP_S, RIDE_S = 3.0, 10.0
UP = [3, 8, 9, 10, 4]  # through the shaft


@pytest.mark.parametrize("engine", ["kinematic", "sumo"])
def test_two_robots_ride_one_after_the_other_and_arrive_as_planned(tmp_path, engine):
    graph = two_levels(RIDE_S, STEP_S)
    paths = [[1, 2, *UP, 5, 6, 7], [0, 0, 0, 0, 0, 0, 0, 1, 2, *UP, 5, 6]]
    problem, plan = problem_of(graph, paths)
    how = ExecutionSettings(engine=engine)
    planned = retime(problem, plan, how)
    run = simulate(problem, planned, how, build_network(graph, tmp_path / "world.net.xml"))
    assert run.all_at_goal
    assert np.abs(run.arrived_s - planned.arrive_s).max() <= 0.1 + 1e-9
    first = planned.arrive_s[: len(paths[0])]
    assert first[6] - first[2] == pytest.approx(RIDE_S, abs=0.2)
    verdict = audit(run, problem.fleet)
    assert verdict["passed"], verdict
    assert run.level is not None
    assert run.level[0].tolist() == [0, 0]
    assert run.level[-1].tolist() == [1, 1]
    assert set(run.x_m[(run.level == 1) & (run.speed_mps < 0.1)].round(6).tolist()) >= {50.0}
