"""What a capacity study keeps of a run beside its metrics: every order's times, and where robots stood, waited and were served.

Worker processes call `observe`; it is JSON, so that a study can be resumed and asked again from what it has on disk.
"""

from typing import Any

import numpy as np

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import FloatArray, IntArray, PlanGraph
from mrp_sumo.core.places import places_of
from mrp_sumo.core.task import StopLog, TaskLog
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.result import RunResult
from mrp_sumo.experiments.worker import Answer, Job, measure
from mrp_sumo.metrics.facilities import lift_use
from mrp_sumo.metrics.tasks import steady_from

FUNCTION = f"{__name__}:observe"
MINUTE_S = 60.0
LOOK_S = 1.0  # between looks at where robots are
NUM_VERTICES = 60  # whose waiting is kept one by one


def observe(job: Job, maps: MapCache) -> Answer:
    """Make a run, measure it, and keep what a capacity study reads. Called in worker processes."""
    return measure(job, maps, observation)


def observation(result: RunResult) -> dict[str, Any]:
    """What is kept of a run that was driven, as JSON.

    Returns
    -------
    dict
        Of a run with tasks: `released_s, assigned_s, done_s` and `due_s` of every order (None: not, or never); `stations` by name, with
        places, seconds served and queued; `places` by name, with kind, seconds that robots waited to go there and the share of time
        for which one was there; `lifts` by name, with the share of time for which they were busy and seconds that robots waited before
        them; `vertices`, pairs of a vertex of the plan graph and seconds waited for it; `minutes`, pairs of the mean number of robots in
        traffic and the metres driven in each minute; `lane_m`; `deadlocks`; `planning_share` of the time; `steady_s`.
        Of one without, nothing.
    """
    execution, graph = result.execution, result.graph
    assert execution is not None
    if execution.tasks is None or execution.stops is None:
        return {}
    steady_s = steady_from(execution.tasks) or 0.0
    x, y, every = _looks(execution)
    wait_s = _waiting(execution, graph, steady_s)
    heaviest = np.argsort(-wait_s, kind="stable")[:NUM_VERTICES]
    budget_s = result.setup.settings.planning.budget_s
    return {
        **_orders(execution.tasks, execution.stops),
        "steady_s": steady_s,
        "stations": _stations(execution.stops, steady_s, execution.sim_time_s),
        "places": _places(result, x, y, wait_s, int(steady_s / LOOK_S)),
        "lifts": {use.name: [round(use.busy_share, 4), round(use.waited_s, 1)] for use in lift_use(execution, graph, steady_s)},
        "vertices": [[int(v), round(float(wait_s[v]), 1)] for v in heaviest if wait_s[v] > 0],
        "minutes": _minutes(execution, x, y, every),
        "lane_m": round(float(graph.length_m[(graph.reverse < 0) | (graph.reverse > np.arange(graph.num_lanes))].sum()), 2),
        "deadlocks": sum(event.kind in ("deadlock", "blocked_for_good") for event in execution.events),
        "planning_share": round(min(1.0, execution.calls.asked * budget_s / execution.sim_time_s), 4) if execution.calls else 0.0,
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


def _stations(stops: StopLog, since_s: float, end_s: float) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = {}
    served = np.clip(np.minimum(stops.end_s, end_s) - np.maximum(stops.begin_s, since_s), 0, None)
    later = stops.begin_s >= since_s
    names = np.array(stops.station)
    for name in dict.fromkeys(stops.station):
        rows = names == name
        found[name] = {
            "places": len(np.unique(stops.vertex[rows])),
            "served_s": round(float(served[rows].sum()), 2),
            "queued_s": round(float(stops.queued_s[rows & later].sum()), 2),
            "stops": int((rows & later).sum()),
            "over_s": round(end_s - since_s, 2),
        }
    return found


def _looks(execution: Execution) -> tuple[FloatArray, FloatArray, int]:
    """x and y of robots [K, R] at whole looks, and samples between them."""
    period_s = float(execution.t_s[1] - execution.t_s[0]) if len(execution.t_s) > 1 else LOOK_S
    every = max(1, round(LOOK_S / period_s))
    return execution.x_m[::every], execution.y_m[::every], every


def _waiting(execution: Execution, graph: PlanGraph, since_s: float) -> FloatArray:
    """[V] seconds that robots waited for others to go on to each vertex, from a time on."""
    wait_s = np.zeros(graph.num_vertices)
    for event in execution.events:
        if event.kind == "waited" and event.vertex >= 0 and event.t_s >= since_s:
            wait_s[event.vertex] += event.duration_s
    return wait_s


def _places(result: RunResult, x: FloatArray, y: FloatArray, wait_s: FloatArray, first: int) -> dict[str, list[Any]]:
    """Kind, seconds waited, and share of looks at which a robot was there, by name; where nobody waited it is left out."""
    from scipy.spatial import cKDTree

    graph = result.graph
    places = places_of(graph, result.nav)
    waited = np.bincount(places.of_vertex, wait_s, len(places.name))
    there = np.stack([x[first:], y[first:]], -1)
    _, vertex = cKDTree(graph.xy).query(there.reshape(-1, 2))
    at: IntArray = places.of_vertex[vertex].reshape(there.shape[:2])
    look = np.repeat(np.arange(len(at)), at.shape[1])
    pairs = np.unique(np.stack([look, at.reshape(-1)], 1), axis=0)
    share = np.bincount(pairs[:, 1], minlength=len(places.name)) / max(1, len(at))
    return {
        places.name[p]: [places.kind[p], round(float(waited[p]), 1), round(float(share[p]), 4)]
        for p in np.argsort(-waited, kind="stable")
        if waited[p] > 0
    }


def _minutes(execution: Execution, x: FloatArray, y: FloatArray, every: int) -> list[list[float]]:
    """Mean number of robots in traffic (with an order, and not served), and metres driven, in each whole minute."""
    tasks, stops = execution.tasks, execution.stops
    assert tasks is not None and stops is not None
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
    under_way: FloatArray = np.searchsorted(np.sort(begin_s), t_s, "right") - np.searchsorted(np.sort(end_s), t_s, "right") + 0.0
    return under_way
