"""Streams of tasks: the same for everybody who draws them, and as many and as spread as they say."""

from itertools import islice

import numpy as np
import pytest

from mrp_sumo.core.arrivals import Arrivals, ServiceTime
from mrp_sumo.core.stream import ClosedLoop, TaskStream, zipf_weights
from mrp_sumo.core.task import Station, Stop, Task
from mrp_sumo.errors import PlanError

A, B, C = (Station(name, (v,)) for v, name in enumerate("abc"))


FIVE = (ServiceTime(constant_s=5.0),)


def stream(arrivals, service=FIVE, routes=((A, B), (B, C)), weight=(1.0, 1.0), **other):
    return TaskStream("orders", arrivals, tuple(routes), np.array(weight), tuple(service), **other)


def first(count, of):
    return list(islice(of.tasks(), count))


def test_the_same_seed_gives_the_same_tasks_and_another_stream_others():
    one = stream(Arrivals(rate_per_h=60), seed=3)
    assert first(50, one) == first(50, one)
    assert first(50, one) != first(50, stream(Arrivals(rate_per_h=60), seed=4))
    assert first(50, one) != first(50, stream(Arrivals(rate_per_h=60), seed=3, number=1))


def test_a_shorter_series_is_the_beginning_of_a_longer_one():
    endless = stream(Arrivals(rate_per_h=60))
    assert first(30, endless) == list(stream(Arrivals(rate_per_h=60), count=30).tasks())


def test_another_rate_changes_no_route_and_no_service_time():
    varied = (ServiceTime(lognormal=(5, 0.5)),)
    slow, fast = (first(20, stream(Arrivals(rate_per_h=rate), varied)) for rate in (10, 1000))
    assert [task.stops for task in slow] == [task.stops for task in fast]


def test_poisson_has_its_rate():
    tasks = first(4000, stream(Arrivals(rate_per_h=360)))
    gaps = np.diff([task.release_s for task in tasks])
    assert gaps.mean() == pytest.approx(10.0, rel=0.05) and gaps.std() == pytest.approx(10.0, rel=0.06)


def test_a_daily_profile_moves_tasks_to_its_hours():
    half_days = stream(Arrivals(rate_per_h=100, profile=(0.0, 2.0)))
    hours = np.array([task.release_s for task in first(500, half_days)]) / 3600 % 24
    assert hours.min() >= 12 and len(hours) == 500


def test_f_tasks_a_step_and_one_with_a_probability():
    assert [task.release_s for task in first(6, stream(Arrivals(per_step=2), step_s=3.0))] == [0, 0, 3, 3, 6, 6]
    sparse = np.array([task.release_s for task in first(2000, stream(Arrivals(per_step=0.2)))])
    assert (np.diff(sparse) >= 1).all() and sparse[-1] / 2000 == pytest.approx(5.0, rel=0.06)


def test_service_times_are_spread_as_they_say():
    rng = np.random.default_rng(0)
    triangular = np.array([ServiceTime(triangular_s=(2, 3, 7)).draw(rng) for _ in range(4000)])
    assert triangular.min() >= 2 and triangular.max() <= 7 and triangular.mean() == pytest.approx(4.0, abs=0.07)
    lognormal = np.array([ServiceTime(lognormal=(8, 0.4)).draw(rng) for _ in range(4000)])
    assert np.median(lognormal) == pytest.approx(8, rel=0.05) and np.log(lognormal).std() == pytest.approx(0.4, rel=0.05)
    assert {ServiceTime(constant_s=4).draw(rng) for _ in range(3)} == {4}


def test_routes_are_drawn_by_weight():
    drawn = first(4000, stream(Arrivals(at_once=True), weight=(1.0, 3.0)))
    assert sum(task.stops[0].station == A for task in drawn) / 4000 == pytest.approx(0.25, abs=0.03)


def test_zipf_weighs_by_rank():
    assert zipf_weights(4, 1.0).tolist() == [1, 1 / 2, 1 / 3, 1 / 4]


def test_due_times_count_from_the_release():
    task = first(1, stream(Arrivals(rate_per_h=60), due_after_s=100.0, priority=2))[0]
    assert task.due_s == task.release_s + 100 and task.priority == 2 and task.name == "orders_0"


def test_stops_are_made_at_a_place_of_their_station():
    pack = Station("pack", (4, 5), (7,))
    assert Stop(4, station=pack).places == (4, 5) and Stop(4, station=pack).queue == (7,)
    assert Stop(4).places == (4,) and Stop(4).queue == ()
    with pytest.raises(PlanError, match="task 3 has no stops"):
        Task(3, ())
    with pytest.raises(PlanError, match="station 'pack' has no places"):
        Station("pack", ())


def test_a_closed_loop_keeps_the_order_of_arrival_and_the_mix():
    rates = [stream(Arrivals(rate_per_h=rate), number=k, priority=k) for k, rate in enumerate((300, 100))]
    loop = first(400, ClosedLoop(tuple(rates), 8))
    assert [task.release_s for task in loop] == sorted(task.release_s for task in loop)
    assert 0.65 < sum(task.priority == 0 for task in loop) / 400 < 0.85
    turns = [stream(Arrivals(open=n), number=k, priority=k) for k, n in enumerate((2, 1))]
    assert sum(task.priority for task in first(30, ClosedLoop(tuple(turns), 4))) == 10
