"""Metrics of work that does not end: tasks done, how long they took, and from when on a run is steady.

The warm-up is left out of throughput and lead times. It is found by MSER-5 on the lead times of tasks in the order in which they
were done.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.task import CANCELLED, FAILED, StopLog, TaskLog, orders_of
from mrp_sumo.metrics.metric import LESS, MORE, NONE, Evidence, Function, Metric, Sample, logged, of, part, quantile, statistic
from mrp_sumo.metrics.warm_up import warm_up_length

HOUR_S = 3600.0


def steady_from(tasks: TaskLog) -> float | None:
    """End of the warm-up, s; None where the run is too short to tell: it would be more than half of the tasks done."""
    done = np.flatnonzero(np.isfinite(tasks.done_s))
    done = done[np.argsort(tasks.done_s[done], kind="stable")]
    cut = warm_up_length(tasks.lead_time_s[done])
    return None if cut is None else float(tasks.done_s[done[cut - 1]]) if cut else 0.0


def overload(tasks: TaskLog, end_s: float, num_robots: int) -> str:
    """A line for people where tasks come faster than they are done, '' elsewhere.

    The mean number of tasks that wait for a robot grows from each of the last three quarters of the run to the next, by half in all.
    """
    tasks, _ = orders_of(tasks, None)
    if not end_s:
        return ""
    edges = np.linspace(0.0, end_s, 5)
    given_s = np.where(np.isnan(tasks.assigned_s), np.inf, tasks.assigned_s)
    waited = [np.clip(np.minimum(given_s, b) - np.maximum(tasks.released_s, a), 0, None).sum() for a, b in pairwise(edges)]
    second, third, last = (float(total) * 4 / end_s for total in waited[1:])
    num_open = int(np.isnan(tasks.ended_s).sum())
    if second < third < last and last >= max(1.5 * second, 1.0) and num_open > num_robots:
        return f"orders wait longer and longer: {num_open} open at the end"
    return ""


def _warm_up(run: Evidence) -> float | None:
    """What is left out: nothing where the run is too short to tell."""
    tasks = _tasks(run)
    return None if tasks is None else steady_from(tasks) or 0.0


def _orders(run: Evidence) -> tuple[TaskLog, StopLog | None] | None:
    """What somebody wanted done: charging is none of it."""
    if run.execution is None or run.execution.tasks is None:
        return None
    return orders_of(run.execution.tasks, run.execution.stops)


def _tasks(run: Evidence) -> TaskLog | None:
    orders = run.once(_orders)
    return None if orders is None else orders[0]


def _stops(run: Evidence) -> StopLog | None:
    orders = run.once(_orders)
    return None if orders is None else orders[1]


def _steadily_done(run: Evidence) -> IntArray:
    """[K] tasks done after the warm-up."""
    tasks, warm_s = _tasks(run), run.once(_warm_up)
    return np.zeros(0, np.int64) if tasks is None or warm_s is None else np.flatnonzero(tasks.done_s > warm_s)


def _cycle(run: Evidence) -> dict[str, float]:
    """Mean parts of the time from release to done of the tasks done after the warm-up; they add up to its mean."""
    tasks, stops, done = _tasks(run), _stops(run), run.once(_steadily_done)
    if tasks is None or stops is None or not len(done):
        return {}
    rows = np.isin(stops.task, done)
    first = rows & np.concatenate([[True], stops.task[1:] != stops.task[:-1]])
    drove_s = stops.begin_s - stops.since_s - stops.stood_s - stops.queued_s
    totals = {
        "assignment": (tasks.assigned_s - tasks.released_s)[done].sum(),
        "empty": drove_s[first].sum(),
        "loaded": drove_s[rows & ~first].sum(),
        "standing": stops.stood_s[rows].sum(),
        "queue": stops.queued_s[rows].sum(),
        "serving": (stops.end_s - stops.begin_s)[rows].sum(),
    }
    return {name: float(total) / len(done) for name, total in totals.items()}


def _utilisation(run: Evidence) -> FloatArray:
    """[P] of the places where stops were made, the share of the time after the warm-up for which each served a robot."""
    stops, warm_s = _stops(run), run.once(_warm_up)
    if stops is None or run.execution is None or warm_s is None or run.execution.sim_time_s <= warm_s:
        return np.zeros(0)
    end_s = run.execution.sim_time_s
    served_s = np.clip(np.minimum(stops.end_s, end_s) - np.maximum(stops.begin_s, warm_s), 0, None)
    _, place = np.unique(stops.vertex, return_inverse=True)
    shares: FloatArray = np.bincount(place, served_s) / (end_s - warm_s)
    return shares


def _steady(read: Callable[[TaskLog], FloatArray]) -> Sample:
    """[K] times of the tasks done after the warm-up."""

    def values(run: Evidence) -> FloatArray:
        tasks = _tasks(run)
        return np.zeros(0) if tasks is None else read(tasks)[run.once(_steadily_done)]

    return values


def _events(kind: str) -> Function:
    return lambda run: None if _tasks(run) is None or run.execution is None else sum(e.kind == kind for e in run.execution.events)


def _throughput_per_h(run: Evidence) -> float | None:
    tasks, warm_s = _tasks(run), run.once(_warm_up)
    if tasks is None or run.execution is None or warm_s is None or run.execution.sim_time_s <= warm_s:
        return None
    return float((tasks.done_s > warm_s).sum() / (run.execution.sim_time_s - warm_s) * HOUR_S)


def _on_time_share(run: Evidence) -> float | None:
    tasks, stops, done = _tasks(run), _stops(run), run.once(_steadily_done)
    if tasks is None or stops is None:
        return None
    due_s = np.full(len(tasks.name), np.inf)
    due_s[stops.task] = stops.due_s
    due = done[np.isfinite(due_s[done])]
    return float((tasks.done_s[due] <= due_s[due]).mean()) if len(due) else None


_LEAD_TIME_S = _steady(lambda tasks: tasks.lead_time_s)
_WAITING_S = _steady(lambda tasks: tasks.assigned_s - tasks.released_s)
_TASK_S = _steady(lambda tasks: tasks.done_s - tasks.assigned_s)

# fmt: off
METRICS = (
    Metric("throughput_per_h", "", MORE, "orders done within an hour after the warm-up", _throughput_per_h),
    Metric("tasks_done", "", MORE, "orders that are done at the end", of(_tasks, lambda tasks: int(np.isfinite(tasks.done_s).sum()))),
    Metric("tasks_open", "", LESS, "known orders that are neither done, failed nor cancelled at the end",
           of(_tasks, lambda tasks: int(np.isnan(tasks.ended_s).sum()))),
    Metric("tasks_failed", "", LESS, "orders that failed: their robot was lost with them on board, or none that could do them was left",
           of(_tasks, lambda tasks: tasks.status.count(FAILED))),
    Metric("tasks_cancelled", "", NONE, "orders that were cancelled, since nobody had picked them in time",
           of(_tasks, lambda tasks: tasks.status.count(CANCELLED))),
    Metric("tasks_handed_over", "", LESS,
           "how often an order's load was left for another robot to fetch, since its robot was lost (`tasks.retry.hand_over`)",
           _events("handed_over")),
    Metric("tasks_begun_anew", "", LESS, "how often an order was begun anew, since its robot was lost (`tasks.retry.times`)",
           _events("begun_anew")),
    Metric("lead_time_mean_s", "s", LESS, "mean time from release to done of the orders done after the warm-up",
           statistic(_LEAD_TIME_S, np.mean)),
    Metric("lead_time_p50_s", "s", LESS, "median of the same", quantile(_LEAD_TIME_S, 0.5)),
    Metric("lead_time_p95_s", "s", LESS, "95th percentile of the same", quantile(_LEAD_TIME_S, 0.95)),
    Metric("lead_time_max_s", "s", LESS, "maximum of the same", statistic(_LEAD_TIME_S, np.max)),
    Metric("warm_up_s", "s", NONE, "when the warm-up ends, by MSER-5 on lead times; null where the run is too short to tell",
           of(_tasks, steady_from)),
    Metric("cycle_assignment_s", "s", LESS,
           "mean time that these orders waited for a robot; this and the next five add up to `lead_time_mean_s`",
           part(_cycle, "assignment")),
    Metric("cycle_empty_travel_s", "s", LESS, "mean time for which robots drove to the first stops of these orders, standing left out",
           part(_cycle, "empty")),
    Metric("cycle_loaded_travel_s", "s", LESS, "mean time for which they drove to the stops after that, standing left out",
           part(_cycle, "loaded")),
    Metric("cycle_standing_s", "s", LESS,
           "mean time for which they stood on the way: for others, as planned or not, and for what was closed", part(_cycle, "standing")),
    Metric("cycle_queue_s", "s", LESS, "mean time for which they stood at places to wait, or near a station that was full",
           part(_cycle, "queue")),
    Metric("cycle_serving_s", "s", NONE, "mean time for which they were served", part(_cycle, "serving")),
    Metric("waiting_time_p50_s", "s", LESS, "median time that these orders waited for a robot", quantile(_WAITING_S, 0.5)),
    Metric("waiting_time_p95_s", "s", LESS, "95th percentile of the same", quantile(_WAITING_S, 0.95)),
    Metric("task_time_p50_s", "s", LESS, "median time from when these orders had a robot until they were done", quantile(_TASK_S, 0.5)),
    Metric("task_time_p95_s", "s", LESS, "95th percentile of the same", quantile(_TASK_S, 0.95)),
    Metric("on_time_share", "", MORE, "share of these orders that were done when they were due; null where none has a due time",
           _on_time_share),
    Metric("station_utilisation_max", "", NONE,
           "share of the time after the warm-up for which the busiest place of a station served a robot", statistic(_utilisation, np.max)),
    Metric("station_utilisation_mean", "", NONE, "mean of the same over all places where a stop was made",
           statistic(_utilisation, np.mean)),
    Metric("planner_calls", "", NONE, "requests to the planner while robots drove",
           logged("calls", lambda calls: calls.requests)),
    Metric("planner_calls_late", "", LESS,
           "of these, requests for which `execution.planning.effort` did not suffice; robots kept what they had",
           logged("calls", lambda calls: calls.late)),
    Metric("planner_calls_failed", "", LESS,
           "of these, requests without a plan, or with one that could not be driven; robots kept what they had",
           logged("calls", lambda calls: calls.failed)),
    Metric("planner_calls_stepped", "", LESS, "late or failed requests in a row from the second on, which PIBT answered for a window",
           logged("calls", lambda calls: calls.stepped)),
    Metric("planner_calls_stopped", "", LESS, "such requests that PIBT could not answer either: robots stopped at the ends of their ways",
           logged("calls", lambda calls: calls.stopped)),
)
