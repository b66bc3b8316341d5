"""Work whose truth is known: systems that are driven, each beside its closed formula or a tiny simulator of its own.

A system is a scenario on a small floor, what is measured of its run, and the interval in which the truth lies. The interval holds what the
formula leaves open: the length of a step, and how fast robots close up in a line. Times of services and arrivals are drawn here.
"""

import bisect
import heapq
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
from floors import BATTERY, lanes, ring, scenario
from queues import mean_wait_s

TURN_S = np.pi / 2 / 3.0  # by a right angle, of the small robot
HOUR_S = 3600.0


@dataclass(frozen=True)
class Variation:
    """How a system is driven."""

    engine: str = "kinematic"
    dispatcher: str = "nearest"
    planner: str = "lacam"
    step_length_s: float = 0.1
    budget_s: float = 1.0

    @property
    def execution(self) -> dict[str, Any]:
        """The keys of a scenario."""
        planning = {"budget_s": self.budget_s}
        if self.budget_s > 2:
            planning["window_s"] = 12 * self.budget_s
        return {"engine": self.engine, "dispatcher": self.dispatcher, "step_length_s": self.step_length_s, "planning": planning}


@dataclass(frozen=True)
class Truth:
    """What is measured has to lie between these, for a tolerance of its own."""

    low: float
    high: float


@dataclass(frozen=True)
class System:
    """A scenario with a known truth."""

    name: str
    made: Callable[[Path, Variation], Any]  # the scenario
    measured: Callable[[Any], float]  # of its result
    truth: Callable[[Variation], Truth]
    unit: str = "orders/h"
    exact: float = 0.02  # how far from the truth it may be

    def off(self, result: Any, variation: Variation) -> float:
        """How far what is measured lies outside of the truth's interval, as a share of it."""
        value, truth = self.measured(result), self.truth(variation)
        return max(truth.low / value - 1, value / truth.high - 1, 0.0) if value > 0 else 1.0


def lap_s(metres: tuple[float, ...]) -> float:
    """How long stretches take that begin and end at rest, 1 m/s and 1 m/s2, with a right angle between two."""
    return sum(m + 1.0 if m >= 1 else 2 * sqrt(m) for m in metres) + (len(metres) - 1) * TURN_S


def settings(variation: Variation, limit_s: float) -> dict[str, Any]:
    """Of a run: `execution` and `record`."""
    return {
        "execution": variation.execution | {"time_limit_s": limit_s},
        "record": {"bag": False, "period_s": variation.step_length_s},
        "planner": variation.planner,
    }


def per_hour(result: Any) -> float:
    """Orders done an hour, from the first one's end to the last one's."""
    tasks = result.execution.tasks
    ends = np.sort(tasks.done_s[tasks.is_order & np.isfinite(tasks.done_s)])
    skipped = len(ends) // 4
    return float((len(ends) - 1 - skipped) / (ends[-1] - ends[skipped]) * HOUR_S)


def flow_s(result: Any) -> float:
    """The mean time from release to done."""
    tasks = result.execution.tasks
    return float(np.nanmean((tasks.done_s - tasks.released_s)[tasks.is_order]))


def standing(folder: Path, variation: Variation, limit_s: float, robots: int, tasks: list[dict[str, Any]]) -> Any:
    """Robots that stand at the places of one station S, where all orders are served: nobody drives."""
    xy = {f"p{k}": (3.0 * k, 0.0) for k in range(max(robots, 2))}
    names = list(xy)
    row = lanes(folder / f"row_{robots}.csv", xy, pairwise(names), True)
    station = {"stations": {"S": {"places": names[:robots]}}, "list": tasks}
    return scenario(row, station, starts=names[:robots], **settings(variation, limit_s))


def drawn(seed: int, count: int, between_s: float, service_s: float, exponential: bool) -> tuple[np.ndarray, np.ndarray]:
    """Times of arrival, and of service."""
    rng = np.random.default_rng([seed, 93])
    arrivals = np.cumsum(rng.exponential(between_s, count))
    return arrivals, rng.exponential(service_s, count) if exponential else np.full(count, service_s)


def served(arrivals: np.ndarray, service: np.ndarray, servers: int, budget_s: float) -> np.ndarray:
    """When each order is done that comes to a line of servers: who is free takes `budget_s` to begin (Kiefer and Wolfowitz)."""
    free, done = np.zeros(servers), np.zeros(len(arrivals))
    for k, (at_s, takes_s) in enumerate(zip(arrivals.tolist(), service.tolist())):
        first = int(free.argmin())
        free[first] = done[k] = max(free[first], at_s + budget_s) + takes_s
    return done


def served_shortest_first(arrivals: np.ndarray, service: np.ndarray, servers: int, budget_s: float, nth: int = 0) -> np.ndarray:
    """The same where who is free takes the shortest of those that wait, or with `nth` the next but so many, if there are as many."""
    free, done, waiting = [0.0] * servers, np.zeros(len(arrivals)), list[tuple[float, int]]()
    known_s, come = (arrivals + budget_s).tolist(), 0
    for _ in known_s:
        now_s = heapq.heappop(free)
        if not waiting:
            now_s = max(now_s, known_s[come])
        while come < len(known_s) and known_s[come] <= now_s:
            bisect.insort(waiting, (float(service[come]), come))
            come += 1
        takes_s, k = waiting.pop(min(nth, len(waiting) - 1))
        done[k] = now_s + takes_s
        heapq.heappush(free, done[k])
    return done


COUNT, BETWEEN_S, SERVICE_S = 150, 20.0, 14.0  # of queues


def queue(name: str, servers: int, exponential: bool, seed: int) -> System:
    """Poisson arrivals at robots that stand where they serve: M/D/c or M/M/c."""
    arrivals, service = drawn(seed, COUNT, BETWEEN_S / servers, SERVICE_S, exponential)
    tasks = [
        {"name": f"o{k}", "stops": ["S"], "release_s": a, "service_s": s}
        for k, (a, s) in enumerate(zip(arrivals.tolist(), service.tolist()))
    ]

    def truth(variation: Variation) -> Truth:
        budgets_s = variation.budget_s, 2 * variation.budget_s
        if variation.dispatcher == "hungarian":  # as many of the shortest as there are robots are matched with them, whichever with which
            done = (served_shortest_first(arrivals, service, servers, budgets_s[n], n * (servers - 1)) for n in (0, 1))
        else:
            done = (served(arrivals, service, servers, budget_s) for budget_s in budgets_s)
        low_s, high_s = (float((each - arrivals).mean()) for each in done)
        return Truth(low_s, high_s + variation.step_length_s)  # seen in the step after its release; asked for after what is under way

    limit_s = float(arrivals[-1] + 40 * SERVICE_S)
    return System(name, lambda folder, variation: standing(folder, variation, limit_s, servers, tasks), flow_s, truth, "s in system")


def formula_s(servers: int, exponential: bool) -> float:
    """The mean time in such a system in the steady state, without a budget: Erlang's C, and for M/D/1 Pollaczek and Khinchine."""
    if exponential:
        return mean_wait_s(servers / BETWEEN_S, SERVICE_S, servers) + SERVICE_S
    share = SERVICE_S / BETWEEN_S
    return SERVICE_S * (1 + share / (2 * (1 - share)))


def on_ring(
    name: str, robots: int, stops: list[str], service: list[float], truth: Callable[[Variation], Truth], starts: list[str]
) -> System:
    """A closed loop on the ring of 40 m with twice as many orders as robots, and one more."""
    tasks = {"streams": [{"name": "o", "stops": stops, "service": service, "arrivals": {"open": 2 * robots + 1}}]}

    def made(folder: Path, variation: Variation) -> Any:
        return scenario(ring(folder), tasks, starts=starts[:robots], **settings(variation, 1500.0))

    return System(name, made, per_hour, truth)


def there_and_back(services: tuple[float, ...]) -> Callable[[Variation], Truth]:
    """One robot goes round: half a lap to the other place, and half a lap back. A service shorter than the budget is waited out."""

    def truth(variation: Variation) -> Truth:
        waits_s = sum(max(variation.budget_s - service_s, 0.0) for service_s in services)
        rate = HOUR_S / (sum(services) + waits_s + 2 * lap_s((5.0, 10.0, 5.0)))
        return Truth(rate, rate)

    return truth


def bound(service_s: float, robots: int, cycle_s: float) -> Callable[[Variation], Truth]:
    """Of robots that queue at one place: one every `service_s`, and the time in which the next closes up: a metre, from rest to rest, while
    the one before leaves it.
    """

    def truth(variation: Variation) -> Truth:
        closes_s = sqrt(2.0) + 2.0
        least, most = (min(robots / cycle_s, 1 / (service_s + wait_s)) for wait_s in (closes_s, 2.0))
        return Truth(least * HOUR_S, most * HOUR_S)

    return truth


def charging_share(result: Any) -> float:
    """The share of its time for which the robot is charged, over whole rounds from charger to charger."""
    stops, tasks = result.execution.stops, result.execution.tasks
    rows = np.flatnonzero(~tasks.is_order[stops.task])
    begins, ends = stops.begin_s[rows], stops.end_s[rows]
    return float((ends - begins)[:-1].sum() / (begins[-1] - begins[0]))


def charging(name: str, power_w: float) -> System:
    """One robot, driving A to B to A and charging on its way: what it draws in a round is what it is given."""
    tasks = {
        "streams": [{"name": "o", "stops": ["A", "B"], "service": [5.0], "arrivals": {"open": 2}}],
        "charging": {
            "stations": ["c3"],
            "critical_low_charging_level": 40.0,
            "minimum_desired_charging_level": 60.0,
            "maximum_desired_charging_level": 90.0,
            "start_level": [60.0, 60.0],
        },
    }

    def made(folder: Path, variation: Variation) -> Any:
        return scenario(ring(folder), tasks, starts=["A"], shape={"battery": BATTERY}, **settings(variation, 4000.0))

    def truth(variation: Variation) -> Truth:
        given_w = BATTERY["voltage_v"] * BATTERY["charging_a"]
        share = power_w / (power_w + given_w)
        return Truth(share, share)

    return System(name, made, charging_share, truth, "share", exact=0.05)  # ways to the charger, and turns, are not in the formula


def lap_power_w() -> float:
    """The mean power of the small robot on a round with a stop of 5 s at A and at B: friction and device, and speeding up and braking."""
    drives_w = BATTERY["mass_kg"] * 9.81 * BATTERY["friction"] * 40.0  # J a lap
    changes = 6 * 2 * BATTERY["mass_kg"] * 0.5  # J: to 1 m/s and to rest on each of six stretches
    round_s = 10.0 + 2 * lap_s((5.0, 10.0, 5.0))
    return (drives_w + changes) / round_s + BATTERY["device_w"]


def systems() -> Mapping[str, System]:
    """By name."""
    round_s = 30.0 + 5.0 + 2 * lap_s((5.0, 10.0, 5.0))
    found = [
        on_ring("loop, 1 robot at A", 1, ["A"], [5.0], lambda v: Truth(720.0, 720.0), ["A"]),
        on_ring("loop, A to B, 1 robot", 1, ["A", "B"], [5.0, 3.0], there_and_back((5.0, 3.0)), ["A"]),
        on_ring("loop, no services", 1, ["A", "B"], [0.0], passing, ["A"]),
        on_ring("tandem A 30 s, B 5 s, 1 robot", 1, ["A", "B"], [30.0, 5.0], bound(30.0, 1, round_s), ["B"]),
        on_ring("tandem A 30 s, B 5 s, 2 robots", 2, ["A", "B"], [30.0, 5.0], bound(30.0, 2, round_s), ["B", "c4"]),
        on_ring("tandem A 30 s, B 5 s, 4 robots", 4, ["A", "B"], [30.0, 5.0], bound(30.0, 4, round_s), ["B", "c4", "c1", "c3"]),
        queue("M/D/1", 1, False, 1),
        queue("M/M/1", 1, True, 2),
        queue("M/M/2", 2, True, 3),
        queue("M/M/3", 3, True, 4),
        charging("battery with a charger", lap_power_w()),
    ]
    return {system.name: system for system in found}


def passing(variation: Variation) -> Truth:
    """Going by A and B without a stop: a lap of four stretches, each from rest to rest at the corners."""
    rate = HOUR_S / (lap_s((10.0, 10.0, 10.0, 10.0)) + TURN_S)
    return Truth(rate, rate)
