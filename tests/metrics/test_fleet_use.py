"""What a run's note says of robots that stand at its end, and what bundling orders saved."""

from types import SimpleNamespace

import numpy as np
import pytest

from mrp_sumo.core.execution import Event, Outcome
from mrp_sumo.core.robot_states import BROKEN, IDLE, STALLED, WORKING, RobotStateLog
from mrp_sumo.core.task import StopLog, log_of_times
from mrp_sumo.metrics.fleet_use import stalled_robots
from mrp_sumo.metrics.registry import BY_NAME
from tests.worlds import line

NOBODY = Event(70.0, "stalled", -1, text="no stop has been made since 10 s, and 3 orders are open")


@pytest.mark.parametrize(
    ("ends", "events", "outcome", "text"),
    [
        ((STALLED, IDLE), (), Outcome.STALLED, "stalled at the end: robot_0 since 30 s"),
        ((STALLED, STALLED), (), Outcome.COMPLETED, "stalled at the end: robot_0 since 30 s and 1 more"),
        ((IDLE, WORKING), (NOBODY,), Outcome.STALLED, NOBODY.text),
        ((BROKEN, BROKEN), (), Outcome.STALLED, "broken down at the end: robot_0 since 30 s and 1 more"),
        ((IDLE, BROKEN), (), Outcome.STALLED, "broken down at the end: robot_1 since 40 s"),
        ((IDLE, IDLE), (), Outcome.STALLED, "nobody has been at work since 40 s"),
        ((IDLE, BROKEN), (), Outcome.COMPLETED, ""),
    ],
)
def test_a_run_that_comes_to_a_stand_says_why(ends, events, outcome, text):
    """robot_0 works until 30 s, robot_1 until 40 s; the run ends at 100 s."""
    columns = [(0, WORKING, 0.0, 30.0, 4), (0, ends[0], 30.0, 100.0, -1), (1, WORKING, 0.0, 40.0, 5), (1, ends[1], 40.0, 100.0, -1)]
    log = RobotStateLog(*map(np.array, zip(*columns, strict=True)))
    run = SimpleNamespace(robot_states=log, events=events, outcome=outcome, sim_time_s=100.0)
    assert stalled_robots(run, ("robot_0", "robot_1")) == text


@pytest.mark.parametrize(
    ("begin_s", "several", "saved"),
    [
        ((0.0, 30.0, 5.0, 40.0), True, 1 - (5 + 4) / (11 + 4)),  # 0, 1, 4, 5 instead of 0, 4, 1, 5, and 0, 4
        ((0.0, 30.0, 40.0, 50.0), True, 0.0),  # one at a time
        ((0.0, 30.0, 5.0, 40.0), False, None),
        ((0.0, 30.0, 5.0, np.nan), True, 0.0),  # the second order is not done
    ],
)
def test_what_bundling_saves_is_the_way_beside_that_of_one_order_at_a_time(begin_s, several, saved):
    """In a row, 1 m apart, robot_0 has two orders, from 0 to 4 and from 1 to 5, and robot_1 one from 0 to 4."""
    begin_s = np.array([*begin_s, 0.0, 9.0])
    task, robot, vertex = np.repeat(np.arange(3), 2), np.repeat([0, 0, 1], 2), np.array([0, 4, 1, 5, 0, 4])
    zeros = np.zeros(6)
    made = np.isfinite(begin_s)
    columns = (task, robot, vertex, zeros, begin_s, begin_s, zeros, zeros, zeros)
    task, robot, vertex, *times = (column[made] for column in columns)
    stops = StopLog(task, robot, ("",) * len(task), vertex, *times)
    tasks = log_of_times(("a", "b", "c"), np.array([0, 0, 1]), np.zeros(3), np.zeros(3), np.zeros(3), begin_s[1::2])
    execution = SimpleNamespace(tasks=tasks, stops=stops, t_s=np.zeros(1))
    graph = line(6, 1.0)
    problem = SimpleNamespace(fleet=SimpleNamespace(carries_several=several), for_any=lambda: SimpleNamespace(graph=graph))
    evidence = SimpleNamespace(execution=execution, problem=problem, once=lambda work: work(evidence))
    assert BY_NAME["bundled_saved_share"](evidence) == (None if saved is None else pytest.approx(saved))
