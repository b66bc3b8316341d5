"""Metrics of work that does not end: tasks done, how long they took, and from when on a run is steady.

The warm-up is left out of throughput and service times. It is found by MSER-5 on the service times of tasks in the order in which they
were done: White, "An effective truncation heuristic for bias reduction in simulation output", Simulation 69(6), 1997.
"""

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.task import TaskLog
from mrp_sumo.metrics.metric import Evidence, metric

BATCH = 5
HOUR_S = 3600.0


def _tasks(run: Evidence) -> TaskLog | None:
    return None if run.execution is None else run.execution.tasks


@metric("", "more", "tasks done within an hour after the warm-up")
def throughput_per_h(run: Evidence) -> float | None:
    tasks, warm_s = _tasks(run), run.once(_warm_up)
    if tasks is None or run.execution is None or warm_s is None or run.execution.sim_time_s <= warm_s:
        return None
    return float((tasks.done_s > warm_s).sum() / (run.execution.sim_time_s - warm_s) * HOUR_S)


@metric("", "more", "tasks that are done at the end")
def tasks_done(run: Evidence) -> int | None:
    tasks = _tasks(run)
    return None if tasks is None else int(np.isfinite(tasks.done_s).sum())


@metric("", "less", "tasks that are known and not done at the end")
def tasks_open(run: Evidence) -> int | None:
    tasks = _tasks(run)
    return None if tasks is None else int(np.isnan(tasks.done_s).sum())


@metric("s", "less", "mean time from release to done of the tasks done after the warm-up")
def service_time_mean_s(run: Evidence) -> float | None:
    times = run.once(_service_times)
    return float(times.mean()) if len(times) else None


@metric("s", "less", "95th percentile of the same")
def service_time_p95_s(run: Evidence) -> float | None:
    times = run.once(_service_times)
    return float(np.quantile(times, 0.95)) if len(times) else None


@metric("s", "none", "when the warm-up ends, by MSER-5 on service times; null where the run is too short to tell")
def warm_up_s(run: Evidence) -> float | None:
    tasks = _tasks(run)
    return None if tasks is None else steady_from(tasks)


def steady_from(tasks: TaskLog) -> float | None:
    """When the warm-up ends, s; None where the run is too short to tell: it would be more than half of the tasks done."""
    done = np.flatnonzero(np.isfinite(tasks.done_s))
    done = done[np.argsort(tasks.done_s[done], kind="stable")]
    num_batches = len(done) // BATCH
    if num_batches < 4:
        return None
    means = tasks.service_time_s[done[: num_batches * BATCH]].reshape(-1, BATCH).mean(1)
    error = np.array([means[d:].var() / (num_batches - d) for d in range(num_batches - 1)])
    cut = int(np.argmin(error))
    if cut > num_batches // 2:
        return None
    return float(tasks.done_s[done[cut * BATCH - 1]]) if cut else 0.0


def _warm_up(run: Evidence) -> float | None:
    """What is left out: nothing where the run is too short to tell."""
    tasks = _tasks(run)
    return None if tasks is None else steady_from(tasks) or 0.0


def _service_times(run: Evidence) -> FloatArray:
    """[K] of the tasks done after the warm-up."""
    tasks, warm_s = _tasks(run), run.once(_warm_up)
    if tasks is None or warm_s is None:
        return np.zeros(0)
    times: FloatArray = tasks.service_time_s[tasks.done_s > warm_s]
    return times
