"""What a run's note says of robots that stand at its end."""

from types import SimpleNamespace

import numpy as np
import pytest

from mrp_sumo.core.execution import Event, Outcome
from mrp_sumo.core.robot_states import BROKEN, IDLE, STALLED, WORKING, RobotStateLog
from mrp_sumo.metrics.fleet_use import stalled_robots

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
