"""What lifts and doors had to do, on a ride with times known by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from worlds import problem_of, two_levels

from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.metrics.facilities import METRICS, lift_use
from mrp_sumo.metrics.metric import Evidence


def test_a_lift_is_busy_while_it_comes_and_while_a_robot_is_in_it(tmp_path):
    graph, up = two_levels(10.0, 3.0), [3, 10, 11, 12, 4]
    problem, plan = problem_of(graph, [[1, 2, *up, 5, 6, 7], [0, 0, 0, 0, 0, 0, 0, 1, 2, *up, 5, 6]])
    how = ExecutionSettings(engine="kinematic")
    run = simulate(problem, retime(problem, plan, how), how, tmp_path)
    (use,) = lift_use(run, graph)
    log = run.facilities
    stands_s = sum(  # open, with nobody in it: between the robots, and before the first is in it
        after - at for state, at, after in zip(log.lift_state.tolist(), log.lift_t_s.tolist(), log.lift_t_s.tolist()[1:]) if state == 2
    )
    ends_s = run.sim_time_s - log.lift_t_s[-1] if log.lift_state[-1] == 2 else 0.0
    assert use.busy_share == pytest.approx(1 - (stands_s + ends_s) / run.sim_time_s)
    assert (use.name, use.queue) == ("goods", 1)
    assert use.waited_s == pytest.approx(sum(e.duration_s for e in run.events if e.kind == "waited" and e.vertex == up[0]))
    assert lift_use(run, graph, since_s=run.sim_time_s) == []


@pytest.mark.parametrize(("doors", "openings"), [(("glass",), 2), ((), None)])
def test_a_door_opens_when_it_begins_to(doors, openings):
    (metric,) = (metric for metric in METRICS if metric.name == "door_openings")
    log = SimpleNamespace(door_name=doors, door_state=np.array([1, 2, 3, 0, 1, 2]))
    assert metric(Evidence(None, None, None, SimpleNamespace(facilities=log, tasks=None))) == openings
