"""The change that most likely mends a run that did not succeed, in a line: beside the status on pages and on the terminal."""

from collections.abc import Mapping
from typing import Any

BY_STATUS = {
    "deadlock": "execution.on_deadlock: resolve lets robots give way and replan",
    "stalled": "fewer robots, or lanes and stations where they can pass each other",
    "planner_stalled": "{another_planner}fewer robots",
    "planning_timed_out": "a larger planner.time_limit_s, {another_planner}or fewer robots",
    "planning_gave_up": "{another_planner}fewer robots",
    "planning_infeasible": "other goals, fewer robots, or lanes where two can pass (discretisation.lanes: two_way)",
}
BY_RULE = {  # of the operations audit, about decisions; the others are about whether the log contradicts itself
    "first come, first served": "fewer robots, or more places at {place}: robots are passed over there",
    "idle beside work": "another execution.dispatcher: robots stand idle beside orders",
    "oldest first": "another execution.dispatcher, or fewer orders: the oldest are passed over",
}
CONTRADICTION = (
    "another planner or execution.dispatcher: the log of work contradicts itself ({rule}), by a fault of one of them or of mrp_sumo, "
    "which is worth a report"
)
BROKEN_DOWN = "broken down at the end"  # in the note of `metrics.fleet_use`
CONFLICTS = "a planner that coordinates robots, such as lacam: this plan has conflicts"


def remedy(result: Mapping[str, Any]) -> str:
    """The change that most likely mends a run; '' for one that succeeded, and where its note is all that is known."""
    status, metrics = str(result["status"]), result.get("metrics") or {}
    if metrics.get("plan_success") and metrics.get("plan_valid") is False:
        return CONFLICTS
    if status == "stalled" and BROKEN_DOWN in str(result.get("note")):
        return "more robots, or shorter repairs: nobody was left to work"
    if status == "audit_failed":
        return _audit(result, metrics)
    if status == "time_limit" and metrics.get("tasks_done") is None:
        blocked = metrics.get("num_deadlocks") or (metrics.get("blocked_s") or 0) > 0
        return "fewer robots, or another planner or policy: robots blocked each other" if blocked else "a larger execution.time_limit_s"
    return BY_STATUS.get(status, "").format(another_planner=_another_planner(status, result))


def other_planner(name: str) -> str:
    """The planner to try where one has no plan; '' where it has tried all."""
    return {"auto": "", "lacam": "auto"}.get(name, "lacam")


def _another_planner(status: str, result: Mapping[str, Any]) -> str:
    """Words that go before the last of what could be changed."""
    name = other_planner(str(result["scenario"]["planner"]["name"]))
    return "" if not name else f"planner {name}, " if status == "planning_timed_out" else f"planner {name}, or "


def _audit(result: Mapping[str, Any], metrics: Mapping[str, Any]) -> str:
    if metrics.get("num_wall_contacts"):
        return "discretisation.clearance: prune leaves out lanes and cells without room; or a smaller robot"
    if metrics.get("num_overlaps"):
        return "a planner with valid plans and a policy that keeps their order, such as adg"
    findings = (result.get("operations_audit") or {}).get("findings") or ()
    worst = next((f for f in findings if f["rule"] not in BY_RULE), findings[0] if findings else None)
    return "" if worst is None else BY_RULE.get(worst["rule"], CONTRADICTION).format(**worst)
