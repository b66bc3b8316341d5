"""A run in a few lines, of what its `result.json` says: for the command line and for notebooks."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import Any

from mrp_sumo.errors import count
from mrp_sumo.io.remedy import remedy
from mrp_sumo.io.summary import Summary, lateness, seconds, summary
from mrp_sumo.plugins.source import short_name

NO_PLAN, CONFLICTS = "no plan", "plan has conflicts"


def run_summary(result: Mapping[str, Any]) -> Summary:
    """Summary of a run: how it ended, what was planned and what was driven."""
    return summary(result["scenario"]["name"], ((name, ", ".join(part for part in parts if part)) for name, *parts in _rows(result)))


def planner_of(result: Mapping[str, Any]) -> str:
    """The planner of a run; behind `auto` the one that it chose, `auto: lns2`."""
    name, chosen = short_name(result["scenario"]["planner"]["name"]), (result.get("planner") or {}).get("chosen")
    return f"{name}: {chosen}" if chosen else name


def _rows(result: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    scenario, m = result["scenario"], defaultdict[str, Any](lambda: None, result["metrics"])
    yield "status", result["status"].replace("_", " "), result.get("note", "")
    if line := remedy(result):
        yield "to change", line
    yield "map", f"{scenario['map']['file']}, {count(m['num_robots'], 'robot')}, seed {result['seed']}"
    policy = short_name(result.get("policy") or "")
    yield "planner", planner_of(result), NO_PLAN if not m["plan_success"] else "plan valid" if m["plan_valid"] else CONFLICTS
    calls = count(m["planner_calls"], "answer") if m["planner_calls"] is not None else ""
    kinds = ("late", "failed", "stepped", "stopped")
    failed = ", ".join(f"{m[f'planner_calls_{kind}']} {kind}" for kind in kinds if m[f"planner_calls_{kind}"])
    cpu = _then(seconds(m["planning_cpu_s"]), "CPU")
    yield "planning time", seconds(m["planning_time_s"]), cpu, _given("assignment", seconds(m["assignment_time_s"])), calls, failed
    yield "makespan", _then(seconds(m["makespan_s"]), "planned"), _then(seconds(m["driven_makespan_s"]), "driven")
    yield "flowtime", _then(seconds(m["flowtime_s"]), "planned"), _then(seconds(m["driven_flowtime_s"]), "driven")
    yield (
        "cost",
        _count(m["soc_steps"], "steps (sum of costs)"),
        # 0: the planner proves nothing; plans in seconds have no steps to compare with
        _count(None if m["soc_steps"] is None else m["lower_bound_steps"] or None, "steps lower bound"),
    )
    if m["tasks_done"] is not None:
        saved = m.get("bundled_saved_share")
        bundled = f"{100 * saved:.0f} % of the way saved by bundling" if saved else ""  # 0: none was carried beside another
        yield "orders", orders_in_words(m), _count(m["throughput_per_h"], "an hour"), bundled
        yield (
            "lead time",
            _given("mean", seconds(m["lead_time_mean_s"])),
            _given("95 % below", seconds(m["lead_time_p95_s"])),
            "run too short to tell the warm-up" if m["warm_up_s"] is None else f"after a warm-up of {seconds(m['warm_up_s'])}",
        )
    if work := result.get("operations_audit"):
        yield "operations", "no findings" if work["passed"] else count(len(work["findings"]), "finding")
    if m["energy_j"] is not None:
        level, empty = f"lowest {100 * m['battery_level_min']:.0f} %", m["robots_battery_empty"]
        yield "batteries", f"{m['energy_j'] / 3600:.1f} Wh drawn", level, f"{count(empty, 'robot')} ran empty" if empty else ""
    if policy:
        if m["tasks_done"] is None:
            yield "goals reached", f"{m['goals_reached']} of {m['num_robots']}", f"policy {policy}"
        else:
            yield "policy", policy
            yield "simulated time", seconds(m["sim_time_s"])
        yield (
            "minimum distance",
            _metres(m["min_distance_m"]),
            _given("clearance", _metres(m["min_clearance_m"])),
            _count(m["num_overlaps"], "overlaps"),
        )
        if m["num_people"] is not None:
            yield (
                "people",
                f"{m['num_people']}",
                _count(m["protective_stops_per_robot_h"], "protective stops per robot-hour", ".1f"),
                f"{seconds(m['lost_to_people_s'])} lost",
                f"nearest {_metres(m['min_person_distance_m'])}",
                count(m["num_person_contacts"], "contact"),
            )
        yield "blocked time", seconds(m["blocked_s"])
        yield "lateness", _given("mean", lateness(m["lateness_mean_s"])), _given("maximum", lateness(m["lateness_max_s"]))
        yield "real-time factor", _count(m["real_time_factor"]), _count(m["robot_seconds_per_cpu_second"], "robot-seconds a CPU-second")


def orders_in_words(metrics: Mapping[str, Any]) -> str:
    """Counts of a run's orders; empty for one without."""
    counts = {end: metrics.get(f"tasks_{end}") for end in ("done", "open", "failed", "cancelled")}
    shown = (f"{number} {end}" for end, number in counts.items() if number or end in ("done", "open"))
    return "" if counts["done"] is None else ", ".join(shown)


def _given(name: str, value: str) -> str:
    return f"{name} {value}" if value else ""


def _then(value: str, what: str) -> str:
    return f"{value} {what}" if value else ""


def _count(value: float | None, unit: str = "", form: str = ".0f") -> str:
    return "" if value is None else f"{value:{form}} {unit}".rstrip()


def _metres(value: float | None) -> str:
    return _count(value, "m", ".3f")
