"""What would mend a run, by its status and metrics."""

import pytest

from mrp_sumo.io.remedy import remedy

GOOD = {"plan_success": True, "plan_valid": True}


def planned_by(planner):
    return {"scenario": {"planner": {"name": planner}}}


@pytest.mark.parametrize(
    ("status", "metrics", "words"),
    [
        ("completed", GOOD, ""),
        ("completed", GOOD | {"plan_valid": False}, "such as lacam"),
        ("time_limit", GOOD | {"blocked_s": 0.0}, "a larger execution.time_limit_s"),
        ("time_limit", GOOD | {"blocked_s": 31.0}, "blocked each other"),
        ("time_limit", GOOD | {"tasks_done": 40}, ""),  # runs with tasks end with their time
        ("deadlock", GOOD, "execution.on_deadlock: resolve"),
        ("audit_failed", GOOD | {"num_wall_contacts": 2, "num_overlaps": 1}, "discretisation.clearance: prune"),
        ("audit_failed", GOOD | {"num_wall_contacts": 0, "num_overlaps": 1}, "such as adg"),
        ("planning_timed_out", {"plan_success": False}, "planner.time_limit_s"),
        ("refused", {"plan_success": False}, ""),
    ],
)
def test_remedy_names_what_to_change(status, metrics, words):
    line = remedy({"status": status, "metrics": metrics} | planned_by("cbs"))
    assert words in line
    assert bool(line) == bool(words)


PASSED_OVER = {"rule": "first come, first served", "place": "Storage 01"}


@pytest.mark.parametrize(
    ("findings", "words"),
    [
        ([PASSED_OVER], "more places at Storage 01"),
        ([{"rule": "idle beside work", "place": ""}], "another execution.dispatcher: "),
        ([{"rule": "oldest first", "place": ""}], "or fewer orders"),
        ([PASSED_OVER, {"rule": "loads", "place": "A"}], "contradicts itself (loads)"),  # which counts for more
    ],
)
def test_remedy_for_work_is_a_change_that_a_user_can_make(findings, words):
    said = {"operations_audit": {"passed": False, "findings": findings}}
    line = remedy({"status": "audit_failed", "metrics": GOOD} | said | planned_by("cbs"))
    assert words in line
    assert "`" not in line  # pages show it as plain text


@pytest.mark.parametrize(
    ("planner", "line"),
    [
        ("cbs", "a larger planner.time_limit_s, planner lacam, or fewer robots"),
        ("lacam", "a larger planner.time_limit_s, planner auto, or fewer robots"),
        ("auto", "a larger planner.time_limit_s, or fewer robots"),
    ],
)
def test_planner_that_had_no_plan_is_not_advised(planner, line):
    assert remedy({"status": "planning_timed_out", "metrics": {"plan_success": False}} | planned_by(planner)) == line


@pytest.mark.parametrize(
    ("note", "words"), [("", "where they can pass each other"), ("broken down at the end: robot_0 since 10 s", "shorter repairs")]
)
def test_remedy_for_a_fleet_that_broke_down_is_not_room(note, words):
    assert words in remedy({"status": "stalled", "note": note, "metrics": {}} | planned_by("cbs"))
