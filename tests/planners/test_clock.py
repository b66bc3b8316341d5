"""Planners count the time that they work, not what the machine does meanwhile."""

import sys
import time

import pytest
from worlds import drawn

from mrp_sumo.core.plan import Status
from mrp_sumo.planning.registry import planner, planner_names

pytestmark = pytest.mark.kernel

CROSSING = "..0.3 .d... 1...b .2... c.a.."


def hurried(monkeypatch, name):
    """This clock of the module `time` goes a million times as fast for all that reads it."""
    real = getattr(time, name)
    for module in list(sys.modules.values()):
        if getattr(module, name, None) is real and module is not time:
            monkeypatch.setattr(module, name, lambda: 1e6 * real())


@pytest.mark.parametrize("name", [name for name in planner_names() if name not in ("external", "plan_file")])
def test_an_hour_of_other_work_takes_nothing_of_the_limit(name, monkeypatch):
    method = planner(name, {})
    method.prepare()
    before = method.plan(drawn(CROSSING), 30.0)
    hurried(monkeypatch, "perf_counter")
    after = method.plan(drawn(CROSSING), 30.0)
    assert after.status is before.status is Status.SOLVED
    assert after.plan.arrive_s.tolist() == before.plan.arrive_s.tolist()


@pytest.mark.parametrize("name", ["cbs", "eecbs", "auto"])
def test_own_work_is_what_the_limit_is_about(name, monkeypatch):
    method = planner(name, {"planners": ["cbs", "eecbs"]} if name == "auto" else {})
    method.prepare()
    hurried(monkeypatch, "process_time")
    assert method.plan(drawn(CROSSING), 30.0).status is Status.TIMED_OUT
