"""Policies: four that differ in order, clock and reach, and a new one from one file."""

from dataclasses import dataclass

import numpy as np
import pytest
from worlds import cross, drive, line

from mrp_sumo.core.schedule import schedule_of
from mrp_sumo.errors import ExecutionError
from mrp_sumo.sim import policy as policies
from mrp_sumo.sim.policy import needs_sound_plan, policy_of

pytestmark = pytest.mark.kernel


@dataclass(frozen=True)
class LateStart:
    """What somebody else's file may hold: the plan's order, and nobody sets out in the first ten seconds."""

    name: str = "late_start"
    sound_plan_only: bool = True
    keeps_order: bool = True
    look_ahead: int = 1
    paced: bool = False

    def order(self, problem, plan, needs):
        return schedule_of(problem, plan, needs)

    def earliest_s(self, plan):
        return np.where(np.isin(np.arange(plan.num_visits), plan.first[:-1]), 10.0, 0.0)


def test_a_policy_is_one_class_with_a_name(tmp_path, monkeypatch):
    monkeypatch.setitem(policies.POLICIES, "late_start", LateStart())
    run = drive(tmp_path, line(4), [[0, 1, 2, 3]], "late_start")
    usual = drive(tmp_path, line(4), [[0, 1, 2, 3]], "adg")
    assert run.policy == "late_start"
    assert run.goal_s[0] == pytest.approx(usual.goal_s[0] + 10.0, abs=3.0)  # with one vertex at a time it stops at each
    assert run.booked_s[0, 2] == pytest.approx(10.0, abs=0.2)  # planned wait
    assert needs_sound_plan("late_start")


def test_an_unknown_policy_is_told_with_the_nearest():
    with pytest.raises(ExecutionError, match=r"unknown execution policy 'timd' \(did you mean 'timed'\?\)"):
        policy_of("timd")


@pytest.mark.parametrize(("name", "ordered", "clocked"), [("open_loop", 0, 0), ("timed", 0, 1), ("adg", 1, 0), ("adg_timed", 1, 1)])
def test_policies_are_order_and_clock(tmp_path, name, ordered, clocked):
    # by the plan robot_1 crosses first, though it is farther; robot_0 would be there first
    chosen = policy_of(name)
    run = drive(tmp_path, cross(), [[1, 1, 1, 1, 1, 1, 1, 0, 7], [6, 5, 4, 0, 10]], name)
    assert run.all_at_goal and chosen.keeps_order == bool(ordered)
    first = int(run.goal_s.argmin())
    assert first == (1 if ordered or clocked else 0)
    assert (run.goal_s[0] > 7 * 3.0) == bool(clocked)
