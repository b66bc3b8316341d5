"""Observations of a run that a study keeps beside its metrics: every order's times, and where robots stood, waited and were served.

Worker processes call `observe`; it is JSON, so that a study can be resumed and asked again from what it has on disk.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mrp_sumo.core.execution import Execution, PlannerCalls
from mrp_sumo.core.graph import FloatArray, PlanGraph
from mrp_sumo.core.places import places_of
from mrp_sumo.core.task import StopLog, TaskLog, orders_of
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.result import RunResult
from mrp_sumo.experiments.worker import Answer, Job, measure
from mrp_sumo.metrics.tasks import steady_from
from mrp_sumo.sizing.causes import Cause, causes

FUNCTION = f"{__name__}:observe"
MINUTE_S = 60.0
LOOK_S = 1.0  # between looks at where robots are
NUM_VERTICES = 60  # whose waiting is kept one by one


def observe(job: Job, maps: MapCache) -> Answer:
    """Make a run, measure it, and keep what a capacity study reads. Called in worker processes."""
    return measure(job, maps, observation)


def observation(result: RunResult) -> dict[str, Any]:
    """Observations of a run that was driven, as JSON; nothing of one without tasks.

    Of one with tasks: `released_s, assigned_s, done_s` and `due_s` of every order (None: not, or never); `stations` by name, with places,
    seconds served and queued; `causes`, with kind, name, seconds that robots stood because of it and the share of time for which it was
    pressed (see `sizing.causes`); `idle_share` of the robots' time; `batteries` (None: robots have none), with when the first ran empty,
    how many did, the mean and most that charged at a time, and places to charge; `vertices`, pairs of a vertex of the plan graph and
    seconds waited for it; `minutes`, pairs of the mean number of robots in traffic and the metres driven in each minute; `lane_m`;
    `deadlocks`; `planning_share` of the time; `requests`, asked of the planner and not answered; `operations`, findings of the operations
    audit; `steady_s`.
    """
    execution, graph, settings = result.execution, result.graph, result.setup.settings
    assert execution is not None
    if execution.tasks is None or execution.stops is None:
        return {}
    orders, stops = orders_of(execution.tasks, execution.stops)
    assert stops is not None
    steady_s = steady_from(orders) or 0.0
    every = max(1, round(LOOK_S / execution.period_s))
    x, y = execution.x_m[::every], execution.y_m[::every]
    calls = execution.calls or PlannerCalls()
    planning_share = min(1.0, calls.requests * settings.planning.budget_s / execution.sim_time_s)
    places = places_of(graph, result.nav)
    num_places = {("station", station.name): len(station.places) for source in settings.tasks for station in source.stations()}
    num_places |= {("charger", "charger"): len(settings.chargers)} if settings.chargers else {}
    pressed = causes(execution, graph, places, steady_s, planning_share, num_places)
    wait_s = _waiting(execution, graph, steady_s)
    heaviest = np.argsort(-wait_s, kind="stable")[:NUM_VERTICES]
    return {
        **_orders(orders, stops),
        "steady_s": steady_s,
        "stations": _stations(stops, num_places, steady_s, execution.sim_time_s),
        "causes": [[kind, name, round(of.waited_s, 1), round(of.share, 4)] for (kind, name), of in sorted(pressed.items())],
        "idle_share": _idle_share(execution, steady_s, num_robots=x.shape[1]),
        "batteries": _batteries(execution, steady_s, settings.chargers),
        "vertices": [[int(v), round(float(wait_s[v]), 1)] for v in heaviest if wait_s[v] > 0],
        "minutes": _minutes(execution, orders, stops, x, y, every),
        "lane_m": round(float(graph.length_m[graph.is_once].sum()), 2),
        "deadlocks": sum(event.kind in ("deadlock", "blocked_for_good") for event in execution.events),
        "planning_share": round(planning_share, 4),
        "requests": [calls.requests, calls.failed + calls.late],
        "operations": [str(finding["text"]) for finding in result.result.get("operations_audit", {}).get("findings", [])][:3],
    }


def _listed(values: FloatArray) -> list[float | None]:
    return [round(float(v), 2) if np.isfinite(v) else None for v in values]


def _orders(tasks: TaskLog, stops: StopLog) -> dict[str, Any]:
    due_s = np.full(len(tasks.name), np.inf)
    due_s[stops.task] = stops.due_s
    return {
        "released_s": _listed(tasks.released_s),
        "assigned_s": _listed(tasks.assigned_s),
        "done_s": _listed(tasks.done_s),
        "due_s": _listed(due_s),
    }


def _stations(stops: StopLog, num_places: Mapping[Cause, int], since_s: float, end_s: float) -> dict[str, dict[str, float]]:
    served = np.clip(np.minimum(stops.end_s, end_s) - np.maximum(stops.begin_s, since_s), 0, None)
    later, names = stops.begin_s >= since_s, np.array(stops.station)
    return {
        name: {
            "places": num_places.get(("station", name), len(np.unique(stops.vertex[rows]))),
            "served_s": round(float(served[rows].sum()), 2),
            "queued_s": round(float(stops.queued_s[rows & later].sum()), 2),
            "stops": int((rows & later).sum()),
            "over_s": round(end_s - since_s, 2),
        }
        for name in dict.fromkeys(stops.station)
        for rows in [names == name]
    }


def _waiting(execution: Execution, graph: PlanGraph, since_s: float) -> FloatArray:
    """[V] seconds that robots waited for others to go on to each vertex, from a time on."""
    wait_s = np.zeros(graph.num_vertices)
    for event in execution.events:
        if event.kind == "waited" and event.vertex >= 0 and event.t_s >= since_s:
            wait_s[event.vertex] += event.duration_s
    return wait_s


def _idle_share(execution: Execution, since_s: float, num_robots: int) -> float:
    """Share of the robots' time from a time on for which they had no task."""
    tasks, over_s = execution.tasks, execution.sim_time_s - since_s
    assert tasks is not None
    if over_s <= 0:
        return 0.0
    begin_s = np.where(np.isnan(tasks.assigned_s), np.inf, tasks.assigned_s)
    end_s = np.where(np.isnan(tasks.done_s), execution.sim_time_s, tasks.done_s)
    busy_s = np.clip(np.minimum(end_s, execution.sim_time_s) - np.maximum(begin_s, since_s), 0, None).sum()
    return round(max(0.0, 1 - float(busy_s) / (over_s * num_robots)), 4)


def _batteries(execution: Execution, since_s: float, places: Sequence[object]) -> dict[str, Any] | None:
    """What became of batteries, None where robots have none."""
    log, tasks, stops = execution.batteries, execution.tasks, execution.stops
    if log is None or tasks is None or stops is None:
        return None
    flat = log.level <= 0
    charges = ~tasks.is_order[stops.task] if len(stops.task) else np.zeros(0, np.bool_)
    begin_s, end_s = stops.begin_s[charges], np.minimum(stops.end_s[charges], execution.sim_time_s)
    over_s = max(execution.sim_time_s - since_s, 1e-9)
    at_once = _count(begin_s, end_s, np.arange(since_s, execution.sim_time_s, MINUTE_S))
    return {
        "empty_s": round(float(log.t_s[int(flat.any(1).argmax())]), 1) if flat.any() else None,
        "empty": int(flat.any(0).sum()),
        "charging": round(float(np.clip(end_s - np.maximum(begin_s, since_s), 0, None).sum()) / over_s, 3),
        "most_charging": int(at_once.max(initial=0)),
        "places": len(places),
    }


def _minutes(execution: Execution, tasks: TaskLog, stops: StopLog, x: FloatArray, y: FloatArray, every: int) -> list[list[float]]:
    """Mean number of robots in traffic (with an order, and not served), and metres driven, in each whole minute."""
    t_s = execution.t_s[::every]
    ends = np.where(np.isnan(tasks.done_s), np.inf, tasks.done_s)
    starts = np.where(np.isnan(tasks.assigned_s), np.inf, tasks.assigned_s)
    busy = _count(starts, ends, t_s) - _count(stops.begin_s, stops.end_s, t_s)
    moved_m = np.concatenate([[0.0], np.hypot(np.diff(x, axis=0), np.diff(y, axis=0)).sum(1)])
    minute = (t_s // MINUTE_S).astype(np.int64)
    count = int(execution.sim_time_s // MINUTE_S)
    looks = np.maximum(np.bincount(minute, minlength=count), 1)
    robots, metres = np.bincount(minute, busy, count) / looks, np.bincount(minute, moved_m, count)
    return [[round(float(k), 3), round(float(m), 2)] for k, m in zip(robots[:count], metres[:count])]


def _count(begin_s: FloatArray, end_s: FloatArray, t_s: FloatArray) -> FloatArray:
    """[K] how many spans are under way at each time."""
    under_way = np.searchsorted(np.sort(begin_s), t_s, "right") - np.searchsorted(np.sort(end_s), t_s, "right")
    return under_way.astype(np.float64)
