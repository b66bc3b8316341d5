"""The warm-up is what comes before a run is steady, and is told only where that can be seen."""

import numpy as np
import pytest

from mrp_sumo.core.task import TaskLog
from mrp_sumo.metrics.tasks import steady_from


def log_of(service_s):
    """A task done every 10 s, with these service times."""
    done_s = 10.0 * np.arange(1, len(service_s) + 1)
    return TaskLog(tuple(map(str, range(len(done_s)))), np.zeros(len(done_s), np.int64), done_s - service_s, done_s, done_s, done_s)


def test_what_is_steady_from_the_beginning_has_no_warm_up():
    assert steady_from(log_of(np.tile([4.0, 6.0, 5.0, 5.0, 5.0], 20))) == 0.0


def test_a_slow_beginning_is_left_out():
    service_s = np.concatenate([np.full(20, 9.0), np.tile([1.0, 3.0, 2.0, 2.0, 2.0], 30)])
    assert steady_from(log_of(service_s)) == pytest.approx(200.0)  # the twentieth is done then


def test_times_that_grow_to_the_end_are_never_steady():
    assert steady_from(log_of(np.arange(100.0))) is None


def test_a_few_tasks_tell_nothing():
    assert steady_from(log_of(np.full(19, 3.0))) is None
