"""Policies: four that differ in order, clock and reach, and a new one from one file."""

import pytest
from worlds import cross, drive, line

from mrp_sumo.drive.policy import needs_sound_plan, policy_of
from mrp_sumo.errors import PlugInError, ScenarioError
from mrp_sumo.plugins import registry

pytestmark = pytest.mark.kernel


LATE_START = """
import numpy as np
from mrp_sumo.drive.policy import Adg

class LateStart(Adg):
    def earliest_s(self, plan):
        return np.where(np.isin(np.arange(plan.num_visits), plan.first[:-1]), 10.0, 0.0)
"""  # what somebody else's file may hold: the plan's order, and nobody sets out in the first ten seconds


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Makes an installed package that registers a policy."""

    def make(entry):
        (tmp_path / "late_start_policy.py").write_text(LATE_START)
        info = tmp_path / "late_start-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: late-start\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[mrp_sumo.policies]\n{entry}\n")
        monkeypatch.syspath_prepend(tmp_path)
        registry.forget()

    yield make
    registry.forget()


def test_a_policy_is_one_file_of_any_package(tmp_path, package):
    package("late_start = late_start_policy:LateStart")
    run = drive(tmp_path, line(4), [[0, 1, 2, 3]], "late_start")
    usual = drive(tmp_path, line(4), [[0, 1, 2, 3]], "adg")
    assert run.policy == "late_start"
    assert run.goal_s[0] == pytest.approx(usual.goal_s[0] + 10.0, abs=0.2)
    assert run.booked_s[0, 2] == pytest.approx(10.0, abs=0.2)  # planned wait
    assert needs_sound_plan("late_start")


def test_a_policy_that_is_missing_is_told(package):
    package("late_start = late_start_policy:LateSart")
    with pytest.raises(PlugInError, match=r"late_start_policy.py has no 'LateSart' \(did you mean 'LateStart'\?\)"):
        policy_of("late_start")


def test_an_unknown_policy_is_told_with_the_nearest():
    with pytest.raises(ScenarioError, match=r"unknown execution policy 'timd' \(did you mean 'timed'\?\)"):
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
