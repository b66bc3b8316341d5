"""The warm-up is what comes before a run is steady, and is told only where that can be seen."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from mrp_sumo.core.task import StopLog, log_of_times
from mrp_sumo.metrics.metric import Evidence
from mrp_sumo.metrics.tasks import METRICS, overload, steady_from


def log_of(service_s):
    """A task done every 10 s, with these service times."""
    done_s = 10.0 * np.arange(1, len(service_s) + 1)
    return log_of_times(tuple(map(str, range(len(done_s)))), np.zeros(len(done_s), np.int64), done_s - service_s, done_s, done_s, done_s)


def test_what_is_steady_from_the_beginning_has_no_warm_up():
    assert steady_from(log_of(np.tile([4.0, 6.0, 5.0, 5.0, 5.0], 20))) == 0.0


def test_a_slow_beginning_is_left_out():
    service_s = np.concatenate([np.full(20, 9.0), np.tile([1.0, 3.0, 2.0, 2.0, 2.0], 30)])
    assert steady_from(log_of(service_s)) == pytest.approx(200.0)  # the twentieth is done then


def test_times_that_grow_to_the_end_are_never_steady():
    assert steady_from(log_of(np.arange(100.0))) is None


def test_a_few_tasks_tell_nothing():
    assert steady_from(log_of(np.full(19, 3.0))) is None


def waiting(released_s, assigned_s):
    """Tasks that wait for a robot, or have one; none is done."""
    none = np.full(len(released_s), np.nan)
    return log_of_times(tuple(map(str, range(len(none)))), np.zeros(len(none), np.int64), released_s, assigned_s, none, none)


def test_a_stream_that_is_faster_than_the_fleet_is_reported():
    released_s = np.arange(0.0, 400.0, 10.0)
    one_in_four = np.where(np.arange(40) % 4 == 0, released_s, np.nan)
    assert overload(waiting(released_s, one_in_four), 400.0, 5) == "orders wait longer and longer: 40 open at the end"
    assert overload(waiting(released_s, released_s), 400.0, 5) == ""  # all have robots at once


def test_a_queue_that_does_not_grow_is_no_overload():
    released_s = np.arange(0.0, 400.0, 10.0)
    assert overload(waiting(released_s, released_s + 60.0), 400.0, 5) == ""


@pytest.mark.parametrize(
    ("each", "grows"), [((1, 2, 4), True), ((1, 4, 2), False), ((2, 1, 4), False), ((3, 4, 4.5), True), ((4, 4.5, 5), False)]
)
def test_a_queue_grows_from_quarter_to_quarter_and_by_half_or_is_no_overload(each, grows):
    """So many wait in the last three quarters of 400 s, the last of each only for a part of it."""
    waits = [(100.0 * k, 100.0 * k + 100.0 * min(1.0, many - n)) for k, many in enumerate(each, 1) for n in range(math.ceil(many))]
    released_s, assigned_s = np.array(waits).T
    assert bool(overload(waiting(released_s, assigned_s), 400.0, 5)) == grows


def metrics_of(tasks, due_s):
    """The metrics of tasks with a stop each."""
    num = len(tasks.name)
    none, zeros = np.zeros(num, np.int64), np.zeros(num)
    stops = StopLog(np.arange(num), none, ("A",) * num, none, tasks.assigned_s, tasks.done_s - 2, tasks.done_s, zeros, zeros, due_s)
    execution = SimpleNamespace(tasks=tasks, stops=stops, sim_time_s=float(tasks.done_s[-1]))
    run = Evidence(None, None, None, execution)
    shown = ("on_time_share", "throughput_per_h", "lead_time_mean_s", "station_utilisation_max")
    quantiles = [f"{of}_time_p{share}_s" for of in ("lead", "waiting", "task") for share in (50, 95)]
    return {metric.name: metric.function(run) for metric in METRICS if metric.name in (*shown, *quantiles)}


def test_quantiles_are_of_the_times_before_and_with_a_robot_and_of_both():
    """Of 100 orders, one every 10 s: one in four waits for 3 s and has a robot for 6 s, others for 1 s and 4 s."""
    done_s, n = 10.0 * np.arange(1, 101), np.arange(100)
    task_s, waiting_s = np.where(n % 4 == 0, 6.0, 4.0), np.where(n % 4 == 0, 3.0, 1.0)
    assigned_s = done_s - task_s
    log = log_of_times(tuple(map(str, n)), np.zeros(100, np.int64), assigned_s - waiting_s, assigned_s, assigned_s, done_s)
    shown = metrics_of(log, np.full(100, np.inf))
    found = [shown[f"{of}_time_p{share}_s"] for of in ("waiting", "task", "lead") for share in (50, 95)]
    assert found == [1.0, 3.0, 4.0, 6.0, 5.0, 9.0]


def test_orders_count_from_the_end_of_the_warm_up_on():
    """The first twenty, of 9 s, are the warm-up, until 200 s. Of the 150 after it every third is due, and each tenth of these late."""
    lead_s = np.concatenate([np.full(20, 9.0), np.tile([1.0, 3.0, 2.0, 2.0, 2.0], 30)])
    tasks = log_of(lead_s)
    due_s = np.where(np.arange(170) % 3 == 2, tasks.done_s, np.inf)
    due_s[20::30] -= 0.5
    shown = metrics_of(tasks, due_s)
    assert shown["throughput_per_h"] == pytest.approx(360.0) and shown["lead_time_mean_s"] == pytest.approx(2.0)
    assert shown["on_time_share"] == pytest.approx(0.9)
    assert shown["station_utilisation_max"] == pytest.approx(0.2)  # two of every ten seconds
    assert metrics_of(tasks, np.full(170, np.inf))["on_time_share"] is None
