"""Policies: four that differ in order, clock and reach, and a new one from one file."""

import pytest
from worlds import cross, drive, least_distance_m, line

from mrp_sumo.core.disturbances import Breakdown, Disturbances
from mrp_sumo.drive.policy import policy_of
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
    assert policy_of("late_start").sound_plan_only


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


DECIDING = """
from dataclasses import dataclass, replace
from mrp_sumo.drive.policy import Adg
from mrp_sumo.traffic.passages import order_of

@dataclass(frozen=True)
class Overtaking(Adg):
    look_ahead: int = 1
    decides_every_s: float = 1.0

    def decide(self, problem, plan, needs, now_s):
        if now_s != 2.0:
            return None
        late = 100.0 * ((plan.robot == 0) & (plan.arrive_s >= 0))
        return order_of(replace(plan, arrive_s=plan.arrive_s + late, depart_s=plan.depart_s + late), needs)

@dataclass(frozen=True)
class Backwards(Overtaking):
    look_ahead: int = 4

    def decide(self, problem, plan, needs, now_s):
        return order_of(replace(plan, arrive_s=plan.arrive_s + 100.0 * (plan.robot == 0), depart_s=plan.depart_s + 100.0), needs)

@dataclass(frozen=True)
class Careless(Overtaking):
    def decide(self, problem, plan, needs, now_s):
        return "robot_1 first"
"""


def test_a_policy_may_change_the_order_while_robots_drive(tmp_path):
    # robot_0 is planned first at the middle, but held back; the policy lets robot_1 pass before it
    file = tmp_path / "deciding.py"
    file.write_text(DECIDING)
    paths, held = [[3, 2, 1, 0, 7], [6, 6, 6, 5, 4, 0, 10]], Disturbances(breakdowns=(Breakdown(0, 0.5, 30.0),))
    rest, changed = (drive(tmp_path, cross(), paths, policy, disturbances=held) for policy in ("adg", f"{file}:Overtaking"))
    assert rest.all_at_goal and changed.all_at_goal
    assert rest.goal_s[0] < rest.goal_s[1]
    assert changed.goal_s[1] < 20.0 < changed.goal_s[0]
    assert least_distance_m(changed) >= 0.325


def test_an_order_that_passes_over_a_robot_on_its_way_is_refused(tmp_path):
    file = tmp_path / "deciding.py"
    file.write_text(DECIDING)
    paths = [[3, 2, 1, 0, 7], [6, 6, 6, 5, 4, 0, 10]]
    with pytest.raises(
        PlugInError, match="decide\\(\\) at 1 s: the new order lets robot_1 pass before robot_0, which is on its way already"
    ):
        drive(tmp_path, cross(), paths, f"{file}:Backwards")
    with pytest.raises(PlugInError, match=r"deciding.py:\d+: decide\(\) returned str, expected a Schedule"):
        drive(tmp_path, cross(), paths, f"{file}:Careless")
