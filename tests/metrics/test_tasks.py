"""The warm-up is what comes before a run is steady, and is told only where that can be seen."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from mrp_sumo.core.execution import Event, PlannerCalls
from mrp_sumo.core.task import StopLog, log_of_times
from mrp_sumo.metrics.metric import Evidence
from mrp_sumo.metrics.tasks import METRICS, _orders, _steadily_done, _throughput_per_h, overload, steady_from


def log_of(service_s):
    """A task done every 10 s, with these service times."""
    done_s = 10.0 * np.arange(1, len(service_s) + 1)
    return log_of_times(tuple(map(str, range(len(done_s)))), np.zeros(len(done_s), np.int64), done_s - service_s, done_s, done_s, done_s)


def test_what_is_steady_from_the_beginning_has_no_warm_up():
    assert steady_from(log_of(np.tile([4.0, 6.0, 5.0, 5.0, 5.0], 20))) == 0.0


def test_a_slow_beginning_is_left_out():
    service_s = np.concatenate([np.full(20, 9.0), np.tile([1.0, 3.0, 2.0, 2.0, 2.0], 30)])
    tasks = log_of(service_s)
    assert steady_from(tasks) == pytest.approx(200.0)  # the twentieth is done then
    backwards = (-np.arange(170) - 1) % 170  # an order that is done first may have come last, and others are not done yet
    times_s = (np.append(column[backwards], np.nan) for column in (tasks.released_s, tasks.assigned_s, tasks.done_s))
    released_s, assigned_s, done_s = times_s
    mixed = log_of_times(tuple(map(str, range(171))), np.zeros(171, np.int64), released_s, assigned_s, assigned_s, done_s)
    assert steady_from(mixed) == pytest.approx(200.0)


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
    ("each", "fewer_robots", "grows"),
    [
        ((1, 2, 4), 1, True),
        ((1, 2, 4), 0, False),  # each robot could have one of them
        ((1, 4, 2), 1, False),
        ((2, 1, 4), 1, False),
        ((2, 2, 4), 1, False),
        ((1, 3, 3), 1, False),
        ((3, 4, 4.5), 1, True),
        ((4, 4.5, 5), 1, False),
        ((0.25, 0.5, 1), 1, True),
        ((0.25, 0.5, 0.75), 1, False),  # fewer than one at a time
    ],
)
def test_a_queue_grows_from_quarter_to_quarter_and_by_half_or_is_no_overload(each, fewer_robots, grows):
    """So many wait in the last three quarters of 400 s, the last of each only for a part of it."""
    waits = [(100.0 * k, 100.0 * k + 100.0 * min(1.0, many - n)) for k, many in enumerate(each, 1) for n in range(math.ceil(many))]
    released_s, assigned_s = np.array(waits).T
    assert bool(overload(waiting(released_s, assigned_s), 400.0, len(waits) - fewer_robots)) == grows


def test_a_run_without_time_is_not_overloaded():
    assert overload(waiting(np.zeros(9), np.full(9, np.nan)), 0.0, 1) == ""


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
    result = [shown[f"{of}_time_p{share}_s"] for of in ("waiting", "task", "lead") for share in (50, 95)]
    assert result == [1.0, 3.0, 4.0, 6.0, 5.0, 9.0]


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
    cut_short = run_of(tasks, [], 200.0)  # ends with its warm-up
    assert cut_short["throughput_per_h"] is None and cut_short["station_utilisation_max"] is None


def run_of(tasks, stops, end_s, events=(), calls=None):
    """All metrics of a run; stops are rows of task, vertex, since, begin, end, stood, queued and due."""
    task, vertex, *times_s = np.asarray(stops, np.float64).reshape(-1, 8).T
    whole = task.astype(np.int64), np.zeros(len(task), np.int64), ("A",) * len(task), vertex.astype(np.int64)
    execution = SimpleNamespace(tasks=tasks, stops=StopLog(*whole, *times_s), sim_time_s=end_s, events=events, calls=calls)
    return {metric.name: metric.function(Evidence(None, None, None, execution)) for metric in METRICS}


def test_every_second_of_an_order_is_in_one_part_of_its_cycle():
    """Two orders of 30 s, each from the place 5 to the place 6; the robot charges first. Of the others one is on, two are over."""
    nan = np.nan
    times_s = np.array([(0, 0, 0, 5), (0, 2, 10, 30), (10, 10, 20, 40), (20, 30, 38, nan), (20, nan, nan, nan), (20, 21, nan, nan)]).T
    log = log_of_times(tuple("CABDEF"), np.zeros(6, np.int64), *times_s, ("charge", *["order"] * 5))
    ended_s = np.array([5, 30, 40, nan, 41, 42])
    tasks = replace(log, ended_s=ended_s, status=("done", "done", "done", "picked", "cancelled", "failed"))
    stops = [
        (0, 7, 0, 1, 5, 0, 0, np.inf),
        (1, 5, 2, 10, 12, 1, 2, 30),
        (1, 6, 12, 25, 30, 3, 0, 30),
        (2, 5, 10, 20, 21, 0, 4, 39.5),
        (2, 6, 21, 37, 40, 5, 1, 39.5),
        (3, 5, 30, 38, 45, 0, 0, np.inf),
    ]
    events = [Event(0.0, kind, 0) for kind in ("handed_over", "begun_anew", "begun_anew", "goal")]
    shown = run_of(tasks, stops, 42.0, events, PlannerCalls(5, 4, 3, 2, 1))
    none = [name for name, value in shown.items() if value is None]
    assert none == ["warm_up_s"]
    assert {name: value for name, value in shown.items() if name not in none} == pytest.approx(
        {
            "throughput_per_h": 2 / 42 * 3600,
            "tasks_done": 2,
            "tasks_open": 1,
            "tasks_failed": 1,
            "tasks_cancelled": 1,
            "tasks_handed_over": 1,
            "tasks_begun_anew": 2,
            "lead_time_mean_s": 30,
            "lead_time_p50_s": 30,
            "lead_time_p95_s": 30,
            "lead_time_max_s": 30,
            "cycle_assignment_s": (2 + 0) / 2,
            "cycle_empty_travel_s": (10 - 2 - 3 + 20 - 10 - 4) / 2,
            "cycle_loaded_travel_s": (25 - 12 - 3 + 37 - 21 - 6) / 2,
            "cycle_standing_s": (1 + 3 + 5) / 2,
            "cycle_queue_s": (2 + 4 + 1) / 2,
            "cycle_serving_s": (2 + 5 + 1 + 3) / 2,
            "waiting_time_p50_s": 1,
            "waiting_time_p95_s": 1.9,
            "task_time_p50_s": 29,
            "task_time_p95_s": 29.9,
            "on_time_share": 0.5,
            "station_utilisation_max": 8 / 42,
            "station_utilisation_mean": (7 + 8) / 2 / 42,
            "planner_calls": 5,
            "planner_calls_late": 4,
            "planner_calls_failed": 3,
            "planner_calls_stepped": 2,
            "planner_calls_stopped": 1,
        }
    )


def test_without_tasks_there_is_nothing_to_say_of_them():
    nothing = SimpleNamespace(tasks=None, stops=None, sim_time_s=9.0, events=(), calls=None)
    for execution in (None, nothing):
        assert {metric.function(Evidence(None, None, None, execution)) for metric in METRICS} == {None}


@pytest.mark.parametrize(
    ("warm_s", "an_hour", "steady"), [(50.0, 144.0, 2), (99.0, 3600.0, 1), (100.0, None, 0), (120.0, None, 0), (None, None, 0)]
)
def test_orders_an_hour_are_those_after_the_warm_up_in_the_time_after_it(warm_s, an_hour, steady):
    """One of 100 s; orders are done at 40, 60 and 100 s, and one is not."""
    orders = SimpleNamespace(done_s=np.array([40.0, 60.0, 100.0, np.nan]))
    run = SimpleNamespace(execution=SimpleNamespace(sim_time_s=100.0))
    run.once = lambda what: (orders, None) if what is _orders else warm_s
    assert _throughput_per_h(run) == (None if an_hour is None else pytest.approx(an_hour))
    assert len(_steadily_done(run)) == steady
