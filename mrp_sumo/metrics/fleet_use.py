"""Metrics of what a fleet's time, way and energy are spent on where tasks come while robots drive, and of queues at stations."""

from collections.abc import Sequence

import numpy as np

from mrp_sumo.core.battery import BatteryLog
from mrp_sumo.core.execution import Execution, Outcome
from mrp_sumo.core.robot_states import BROKEN, CHARGING, EMPTY, IDLE, ROBOT_STATES, STALLED, WORKING, RobotStateLog
from mrp_sumo.core.task import StopLog, TaskLog, orders_of
from mrp_sumo.metrics.metric import LESS, MORE, NONE, TOGETHER, Evidence, Metric, logged, most_at_once, of, part
from mrp_sumo.search.route import reach_m


def stalled_robots(execution: Execution, robot_name: Sequence[str]) -> str:
    """A line for people where robots, or all work, stand stalled at the end of a run with orders, '' elsewhere."""
    log = execution.robot_states
    if log is None or (stalled := _at_end(log, STALLED, execution.sim_time_s, robot_name)):
        return f"stalled at the end: {stalled}" if log else ""
    if execution.outcome is not Outcome.STALLED:
        return ""
    broken = _at_end(log, BROKEN, execution.sim_time_s, robot_name)
    of_all = (event.text for event in reversed(execution.events) if event.kind == "stalled" and event.robot < 0)
    at_work_s = float(log.end_s.max(where=~np.isin(log.state, (IDLE, BROKEN, EMPTY)), initial=0.0))
    return next(of_all, f"broken down at the end: {broken}" if broken else f"nobody has been at work since {at_work_s:.0f} s")


def _at_end(log: RobotStateLog, state: int, end_s: float, robot_name: Sequence[str]) -> str:
    """The robot that has been in a state longest at the end, and how many more are, '' where none is."""
    last = np.flatnonzero((log.state == state) & (log.end_s >= end_s - 1e-9)).tolist()
    if not last:
        return ""
    first = min(last, key=lambda k: float(log.begin_s[k]))
    others = f" and {len(last) - 1} more" if len(last) > 1 else ""
    return f"{robot_name[log.robot[first]]} since {log.begin_s[first]:.0f} s{others}"


def ran_empty(log: BatteryLog, robot_name: Sequence[str]) -> str:
    """A line for people where batteries ran empty, '' elsewhere."""
    empty = np.flatnonzero((log.level <= 0).any(0)).tolist()
    if not empty:
        return ""
    first = min(empty, key=lambda r: int((log.level[:, r] <= 0).argmax()))
    at_s = float(log.t_s[int((log.level[:, first] <= 0).argmax())])
    others = f" and {len(empty) - 1} more" if len(empty) > 1 else ""
    return f"ran empty: {robot_name[first]} by {at_s:.0f} s{others}"


def _logs(run: Evidence) -> tuple[TaskLog, StopLog] | None:
    """The orders of a run that were known, and their stops."""
    execution = run.execution
    if execution is None or execution.tasks is None or execution.stops is None or not len(execution.t_s):
        return None
    orders, stops = orders_of(execution.tasks, execution.stops)
    return None if stops is None else (orders, stops)


def _shares(run: Evidence) -> dict[str, float]:
    """Shares of the fleet's time by its use; all but `stalled` add up to 1."""
    logs, execution = run.once(_logs), run.execution
    if logs is None or execution is None or execution.robot_states is None or not execution.sim_time_s:
        return {}
    states, whole_s = execution.robot_states, execution.sim_time_s * run.problem.num_robots
    ordered = (states.state == STALLED) & (states.task >= 0)
    spent_s = np.bincount(np.where(ordered, WORKING, states.state), states.end_s - states.begin_s, minlength=len(ROBOT_STATES))
    blocked_s = min(float(logs[1].stood_s.sum()), float(spent_s[WORKING]))
    seconds = {
        "working": spent_s[WORKING] - blocked_s,
        "blocked": blocked_s,
        "charging": spent_s[CHARGING] + spent_s[STALLED],
        "idle": spent_s[IDLE],
        "lost": spent_s[EMPTY] + spent_s[BROKEN],
        "stalled": (states.end_s - states.begin_s)[states.state == STALLED].sum(),
    }
    return {name: float(share_s / whole_s) for name, share_s in seconds.items()}


def _availability(run: Evidence) -> float | None:
    """Share of the time for which robots had orders, or were broken, that they were not."""
    states = run.execution.robot_states if run.execution else None
    if states is None:
        return None
    spent_s = np.bincount(states.state, states.end_s - states.begin_s, minlength=len(ROBOT_STATES))
    used_s = float(spent_s[WORKING] + spent_s[STALLED])
    return used_s / (used_s + float(spent_s[BROKEN])) if used_s else None


def _driven_m(run: Evidence) -> tuple[float, float, float | None]:
    """Driven by all robots in the whole run, and from one stop of a task to the next, m; the same for each load, None where nobody knows.

    Looks at some samples at a time. Where loads on board are known, they say what was driven with one.
    """
    logs, execution = run.once(_logs), run.execution
    assert logs is not None and execution is not None
    stops, t, x, y = logs[1], execution.t_s, execution.x_m, execution.y_m
    loaded = np.flatnonzero(stops.task[1:] == stops.task[:-1]) + 1
    moments = np.clip(np.concatenate([stops.since_s[loaded], stops.begin_s[loaded]]), t[0], t[-1])
    robot, at_m = np.tile(stops.robot[loaded], 2), np.zeros(2 * len(loaded))
    so_far, with_load_m, carried_m = np.zeros(x.shape[1]), 0.0, 0.0
    for begin in range(0, len(t), TOGETHER):
        block = slice(begin, begin + TOGETHER + 1)  # with the first of the next
        steps = np.nan_to_num(np.hypot(np.diff(x[block], axis=0), np.diff(y[block], axis=0)))
        driven = so_far + np.concatenate([np.zeros((1, len(so_far))), np.cumsum(steps, axis=0)])
        for k in np.flatnonzero((moments >= t[block][0]) & (moments <= t[block][-1])).tolist():
            at_m[k] = np.interp(moments[k], t[block], driven[:, robot[k]])
        so_far = driven[-1]
        if execution.loads is not None:
            loads = execution.loads[block][1:]
            with_load_m, carried_m = with_load_m + float(steps[loads > 0].sum()), carried_m + float((steps * loads).sum())
    if execution.loads is not None:
        return float(so_far.sum()), with_load_m, carried_m
    began_m, ended_m = at_m.reshape(2, -1)
    return float(so_far.sum()), float((ended_m - began_m).sum()), None


def _queues(run: Evidence) -> list[tuple[float, int]]:
    """Mean and most robots that waited for a place, by station, in the whole run."""
    logs, execution = run.once(_logs), run.execution
    if logs is None or execution is None or not execution.sim_time_s:
        return []
    stops, queues = logs[1], []
    for name in dict.fromkeys(stops.station):
        here = np.array([station == name for station in stops.station])
        begin_s, queued_s = stops.begin_s[here], stops.queued_s[here]
        waits = queued_s > 0
        queues.append((float(queued_s.sum() / execution.sim_time_s), most_at_once((begin_s - queued_s)[waits], begin_s[waits])))
    return queues


def _distances_m(run: Evidence) -> dict[str, float]:
    """Driven by all robots, what of it was not from a task's first stop to those after it, by order done, and loads on board by metre."""
    logs = run.once(_logs)
    if logs is None:
        return {}
    driven_m, loaded_m, carried_m = _driven_m(run)
    by = {"all": driven_m, "empty": driven_m - loaded_m}
    if num_done := int(np.isfinite(logs[0].done_s).sum()):
        by["order"] = driven_m / num_done
    return by if carried_m is None or not loaded_m else {**by, "loads": carried_m / loaded_m}


def _bundled_share(run: Evidence) -> float | None:
    """Ways are the shortest along lanes between the stops of a robot's orders that are done: as made, and order after order."""
    logs = run.once(_logs)
    if logs is None or not run.problem.fleet.carries_several:
        return None
    tasks, stops = logs
    rows = np.flatnonzero(np.isfinite(tasks.done_s)[stops.task] & (stops.robot == tasks.robot[stops.task]))
    begun_s = np.full(len(tasks.name), np.inf)
    np.minimum.at(begun_s, stops.task[rows], stops.begin_s[rows])
    graph = run.problem.for_any().graph
    place, at = np.unique(stops.vertex[rows], return_inverse=True)
    away_m = reach_m(graph, np.ones(graph.num_lanes, np.bool_), place)[:, place] if len(place) else np.zeros((0, 0))
    time = stops.begin_s[rows]
    together_m, apart_m = (
        float(np.where(np.diff(stops.robot[rows][order]) == 0, away_m[at[order[:-1]], at[order[1:]]], 0.0).sum())
        for order in (
            np.lexsort((time, stops.robot[rows])),
            np.lexsort((time, stops.task[rows], begun_s[stops.task[rows]], stops.robot[rows])),
        )
    )
    return 1 - together_m / apart_m if 0 < apart_m < np.inf else None


# fmt: off
METRICS = (
    Metric("robot_busy_share", "", NONE, "share of the fleet's time for which robots had an order, those left out that were lost with one",
           of(_shares, lambda shares: shares["working"] + shares["blocked"] if shares else None)),
    Metric("robot_working_share", "", NONE,
           "share of the fleet's time for which robots had an order and were getting on with it; this and the next four add up to 1",
           part(_shares, "working")),
    Metric("robot_blocked_share", "", LESS,
           "share for which they had an order and stood on the way to a stop that they made, for others or what was closed",
           part(_shares, "blocked")),
    Metric("robot_charging_share", "", NONE, "share for which they were charged or on their way to it", part(_shares, "charging")),
    Metric("robot_idle_share", "", NONE, "share for which they had no order", part(_shares, "idle")),
    Metric("robot_lost_share", "", LESS, "share for which they were broken or empty", part(_shares, "lost")),
    Metric("availability", "", MORE,
           "MTBF / (MTBF + MTTR): of the time for which robots had orders or were broken or maintained, the share for which they were not",
           _availability),
    Metric("robot_stalled_share", "", LESS,
           "share for which they had an order or had to charge, but made no progress for a minute; part of the others",
           part(_shares, "stalled")),
    Metric("station_queue_mean", "", NONE, "mean number of robots that waited for a place of the station where most did",
           lambda run: max((mean for mean, _ in run.once(_queues)), default=None)),
    Metric("station_queue_max", "", NONE, "most robots that waited for a place of one station at a time",
           lambda run: max((most for _, most in run.once(_queues)), default=None)),
    Metric("distance_m", "m", LESS, "driven by all robots", part(_distances_m, "all")),
    Metric("empty_distance_m", "m", LESS, "of it, what was not driven from an order's first stop to those after it",
           part(_distances_m, "empty")),
    Metric("distance_per_order_m", "m", LESS, "driven by all robots, by order done", part(_distances_m, "order")),
    Metric("loads_mean", "", MORE, "mean number of loads on board, by metre driven with one; null where robots carry one at most",
           part(_distances_m, "loads")),
    Metric("bundled_saved_share", "", MORE,
           "share of the way that robots saved by carrying several orders at once, by the shortest ways between stops of orders that are "
           "done: beside one order at a time, in the order in which they were begun; null where robots carry one at most",
           _bundled_share),
    Metric("energy_j", "J", LESS, "drawn from all batteries, chargers left out; null where the robots' type has no battery",
           logged("batteries", lambda log: float(log.used_j.sum()))),
    Metric("battery_level_min", "", MORE, "least state of charge of a robot at any time, as a share of the capacity",
           logged("batteries", lambda log: float(log.level.min()))),
    Metric("robots_battery_critical", "", LESS, "robots whose state of charge was at or below `critical_low_charging_level` at some time",
           logged("batteries", lambda log: int((log.level <= log.critical).any(0).sum()))),
    Metric("robots_battery_empty", "", LESS, "robots whose batteries ran empty",
           logged("batteries", lambda log: int((log.level[-1] <= 0).sum()))),
)
