"""Driven work beside its closed formulas and tiny simulators: the small and quick ones; `tools/bench_truth.py` has all."""

import numpy as np
import pytest
from closed_networks import Network
from floors import driven
from known_work import BETWEEN_S, SERVICE_S, Variation, drawn, formula_s, going_round, rate_per_h, served, served_shortest_first, systems

SYSTEMS = systems()
QUICK = ("loop, A to B, 1 robot", "tandem A 30 s, B 5 s, 2 robots", "two shifts, D/D/1")


def off(name, tmp_path, variation):
    """How far a system is from its truth, as a share of it."""
    system = SYSTEMS[name]
    result = driven(system.made(tmp_path, variation))
    assert result.status == "completed", result.note
    return system.off(result, variation)


@pytest.mark.parametrize("name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in SYSTEMS])
def test_driven_work_is_what_formulas_say(tmp_path, name):
    assert off(name, tmp_path, Variation()) <= SYSTEMS[name].exact


@pytest.mark.parametrize("budget_s", [0.0, 5.0])
def test_the_budget_delays_by_what_its_documentation_says(tmp_path, budget_s):
    assert off("loop, A to B, 1 robot", tmp_path, Variation(budget_s=budget_s)) <= SYSTEMS["loop, A to B, 1 robot"].exact


@pytest.mark.parametrize("step_length_s", [0.5, 1.0])
def test_longer_steps_change_laps_by_what_their_documentation_says(tmp_path, step_length_s):
    assert off("loop, A to B, 1 robot", tmp_path, Variation(step_length_s=step_length_s)) <= 0.002


@pytest.mark.campaign
@pytest.mark.parametrize("name", list(SYSTEMS))
@pytest.mark.parametrize("variation", [Variation(engine="sumo"), Variation(planner="prioritised"), Variation(dispatcher="hungarian")])
def test_driven_work_does_not_hang_on_engine_planner_or_dispatcher(tmp_path, name, variation):
    assert off(name, tmp_path, variation) <= SYSTEMS[name].exact


@pytest.mark.parametrize(("servers", "exponential"), [(1, False), (1, True), (2, True)])
def test_the_simulator_of_queues_has_the_formulas_means(servers, exponential):
    means = []
    for seed in range(20):
        arrivals, service = drawn(seed, 4000, BETWEEN_S / servers, SERVICE_S, exponential)
        means.append(float((served(arrivals, service, servers, 0.0) - arrivals)[500:].mean()))
    limits = 2.6 * np.std(means) / np.sqrt(len(means))  # 99 %
    assert abs(np.mean(means) - formula_s(servers, exponential)) < limits


def test_the_shortest_first_is_who_came_first_among_equals_and_shorter_on_the_mean_elsewhere():
    assert served_shortest_first(np.array([0.0, 1.0, 2.0]), np.array([5.0, 3.0, 1.0]), 1, 0.0).tolist() == [5.0, 9.0, 6.0]
    assert served_shortest_first(np.array([0.0, 1.0, 2.0]), np.array([5.0, 3.0, 1.0]), 1, 0.0, 1).tolist() == [5.0, 8.0, 9.0]
    for servers in (1, 2):
        arrivals, service = drawn(1, 500, BETWEEN_S / servers, SERVICE_S, False)
        assert served_shortest_first(arrivals, service, servers, 1.0).tolist() == served(arrivals, service, servers, 1.0).tolist()
        arrivals, service = drawn(1, 500, BETWEEN_S / servers, SERVICE_S, True)
        assert served_shortest_first(arrivals, service, servers, 1.0).mean() < served(arrivals, service, servers, 1.0).mean()


@pytest.mark.parametrize("stations_s", [(20.0,), (20.0, 12.0)])
def test_the_simulator_of_robots_that_go_round_has_the_throughput_of_closed_networks(stations_s):
    """Ways take as long for all robots: for a network in which any number may be on its way, their mean is all that counts."""
    service_s = np.random.default_rng([7, 93]).exponential(stations_s, (60_000, len(stations_s)))
    done_s = going_round(service_s, [0.0, 1.0, 2.0], 48.0 / len(stations_s), 0.0, 0)
    exact = Network("ring", 48.0, tuple((mean_s, 1) for mean_s in stations_s), (1, 3)).throughput_per_h(3)
    assert rate_per_h(done_s) == pytest.approx(exact, rel=0.01)


def test_robots_that_close_up_are_later_by_that_where_they_queue_and_nowhere_else():
    queued = going_round(np.full((30, 1), 30.0), [0.0, 1.0], 10.0, 3.0, 0)
    assert np.diff(queued).tolist() == [33.0] * 29
    alone = going_round(np.full((30, 1), 30.0), [0.0], 10.0, 3.0, 0)
    assert np.diff(alone).tolist() == [40.0] * 29
