"""Work whose truth is known: systems that are driven, each beside its closed formula or a tiny simulator of its own.

A system is a scenario on a small floor, what is measured of its run, and the interval in which the truth lies. The interval holds what the
formula leaves open: the length of a step, and how fast robots close up in a line. Times of services and arrivals are drawn here.
"""

import bisect
import heapq
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from floors import BATTERY, SMALL, lanes, ring, scenario, tee
from queues import mean_wait_s

HOUR_S = 3600.0
HALF_M = (5.0, 10.0, 5.0)  # from A to B on the ring, and from B to A


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


Truths = Callable[[Variation, Any], Truth]  # of how it is driven, and of its result: who goes first is the dispatcher's choice


@dataclass(frozen=True)
class System:
    """A scenario with a known truth."""

    name: str
    made: Callable[[Path, Variation], Any]  # the scenario
    measured: Callable[[Any], float]  # of its result
    truth: Truths
    unit: str = "orders/h"
    exact: float = 0.02  # how far from the truth it may be

    def off(self, result: Any, variation: Variation) -> float:
        """How far what is measured lies outside of the truth's interval, as a share of it."""
        value, truth = self.measured(result), self.truth(variation, result)
        return max(truth.low / value - 1, value / truth.high - 1, 0.0) if value > 0 else 1.0


def lap_s(metres: Sequence[float], step_s: float) -> float:
    """How long stretches of whole metres take that begin and end at rest, 1 m/s and 1 m/s2, with a right angle between two.

    In Euler steps (docs/time.md) speeding up covers (1 + step) / 2 m in a second, and braking the rest of a metre in a second less a step.
    """
    return sum(m + 1.0 - step_s for m in metres) + (len(metres) - 1) * turn_s(np.pi / 2, step_s)


def turn_s(angle_rad: float, step_s: float) -> float:
    """How long the small robot turns: whole steps."""
    return ceil(angle_rad / SMALL["turn_rate_rad_s"] / step_s) * step_s


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
    return rate_per_h(np.sort(tasks.done_s[tasks.is_order & np.isfinite(tasks.done_s)]))


def rate_per_h(ends_s: np.ndarray) -> float:
    """Of ascending times, but for the first quarter of them."""
    skipped = len(ends_s) // 4
    return float((len(ends_s) - 1 - skipped) / (ends_s[-1] - ends_s[skipped]) * HOUR_S)


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


SHORTEST_FIRST = ("hungarian", "min_cost_flow", "regret")  # dispatchers, of tasks that wait
COUNT, BETWEEN_S, SERVICE_S = 150, 20.0, 14.0  # of queues


def queue(name: str, servers: int, exponential: bool, seed: int) -> System:
    """Poisson arrivals at robots that stand where they serve: M/D/c or M/M/c."""
    arrivals, service = drawn(seed, COUNT, BETWEEN_S / servers, SERVICE_S, exponential)
    tasks = [
        {"name": f"o{k}", "stops": ["S"], "release_s": a, "service_s": s}
        for k, (a, s) in enumerate(zip(arrivals.tolist(), service.tolist()))
    ]

    def truth(variation: Variation, _: Any) -> Truth:
        budgets_s = variation.budget_s, 2 * variation.budget_s
        if (
            variation.dispatcher in SHORTEST_FIRST
        ):  # as many of the shortest as there are robots are matched with them, whichever with which
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


def on_ring(name: str, robots: int, stops: list[str], service: list[float], truth: Truths, starts: list[str]) -> System:
    """A closed loop on the ring of 40 m with twice as many orders as robots, and one more."""
    tasks = {"streams": [{"name": "o", "stops": stops, "service": service, "arrivals": {"open": 2 * robots + 1}}]}

    def made(folder: Path, variation: Variation) -> Any:
        return scenario(ring(folder), tasks, starts=starts[:robots], **settings(variation, 1500.0))

    return System(name, made, per_hour, truth)


def there_and_back(services: tuple[float, ...]) -> Truths:
    """One robot goes round: half a lap to the other place, and half a lap back. A service shorter than the budget is waited out."""

    def truth(variation: Variation, _: Any) -> Truth:
        waits_s = sum(max(variation.budget_s - service_s, 0.0) for service_s in services)
        rate = HOUR_S / (sum(services) + waits_s + 2 * lap_s(HALF_M, variation.step_length_s))
        return Truth(rate, rate)

    return truth


def closing_s(step_s: float) -> tuple[float, float]:
    """How long the next takes to close up in a line, at least and at most: a metre from rest to rest, once the one before has left it."""
    return 2.0 - step_s, sqrt(2.0) + 2.0


def bound(service_s: float, robots: int, others_s: float) -> Truths:
    """Of robots that queue at one place: one every `service_s`, and the time in which the next closes up."""

    def truth(variation: Variation, _: Any) -> Truth:
        cycle_s = service_s + others_s + 2 * lap_s(HALF_M, variation.step_length_s)
        most, least = (min(robots / cycle_s, 1 / (service_s + wait_s)) for wait_s in closing_s(variation.step_length_s))
        return Truth(least * HOUR_S, most * HOUR_S)

    return truth


ORDERS = 70  # of closed networks
STARTS_M = {"c1": (5.0,), "c4": (10.0, 5.0), "B": HALF_M, "c3": (10.0, 10.0, 5.0)}  # on the ring, and their ways to A


def going_round(service_s: np.ndarray, first_s: Sequence[float], way_s: float, closes_s: float, waits_in: int) -> np.ndarray:
    """When each order is done of robots that go round one after the other, and are served at one station after the other.

    Parameters
    ----------
    service_s
        [K, S] of orders in the order in which they are begun, at each station.
    first_s
        [N] when each robot comes to the first station at first, ascending.
    way_s
        From one station to the next.
    closes_s
        From when a robot leaves a place until the next has closed up to it.
    waits_in
        Places behind each station of which it takes a robot as long to close up.
    """
    num_robots, (count, num_stations) = len(first_s), service_s.shape
    ahead = np.full((num_stations, waits_in + 1), -np.inf)  # when the robot before left each place
    done = np.zeros(count)
    for k in range(count):
        at_s = first_s[k] if k < num_robots else done[k - num_robots] + way_s
        for station in range(num_stations):
            for place in range(waits_in, -1, -1):
                at_s = max(at_s, ahead[station, place] + closes_s)
                if place < waits_in:
                    ahead[station, place + 1] = at_s - min(closes_s, 2.0)
            done[k] = ahead[station, 0] = at_s + service_s[k, station]
            at_s = done[k] + way_s
    return done


def repair(name: str, robots: int, at_a_s: float, at_b_s: float | None, seed: int) -> System:
    """Robots go round and are served for exponential times at A, and at B for such times or for 6 s each: a closed network, or the repair
    of machines that work for the time of a lap.
    """
    starts, rng = list(STARTS_M)[:robots], np.random.default_rng([seed, 93])
    service_s = np.stack([rng.exponential(at_a_s, ORDERS), np.full(ORDERS, 6.0) if at_b_s is None else rng.exponential(at_b_s, ORDERS)], 1)
    tasks = [{"name": f"o{k}", "stops": ["A", "B"], "service_s": each} for k, each in enumerate(service_s.tolist())]

    def made(folder: Path, variation: Variation) -> Any:
        return scenario(ring(folder), {"list": tasks}, starts=starts, **settings(variation, 1.5 * ORDERS * (at_a_s + 60.0 / robots)))

    def truth(variation: Variation, result: Any) -> Truth:
        stops, step_s = result.execution.stops, variation.step_length_s
        at_a = np.array([station == "A" for station in stops.station])
        begun = stops.task[at_a][np.argsort(stops.begin_s[at_a])]
        takes_s = np.maximum(service_s, variation.budget_s)[begun]
        first_s = [lap_s(metres, step_s) + variation.budget_s for metres in (STARTS_M[at] for at in starts)]
        ways = zip(closing_s(step_s), (0, robots - 1))
        most, least = (rate_per_h(going_round(takes_s, first_s, lap_s(HALF_M, step_s), *each)) for each in ways)
        return Truth(least, most)

    return System(name, made, per_hour, truth)


def dead_end(name: str, service_s: float) -> System:
    """Two robots take turns at X, at the end of a dead end of 4 m: as one comes out, the other waits a metre from its mouth or farther."""
    tasks = {"streams": [{"name": "o", "stops": ["X"], "service": [service_s], "arrivals": {"open": 4}}]}

    def made(folder: Path, variation: Variation) -> Any:
        return scenario(tee(folder), tasks, starts=["west", "east"], **settings(variation, 3000.0))

    def truth(variation: Variation, _: Any) -> Truth:
        step_s = variation.step_length_s
        out_s = turn_s(np.pi, step_s) + lap_s((4.0,), step_s) + turn_s(np.pi / 2, step_s)
        most, least = (out_s + clears_s + lap_s((metres, 4.0), step_s) for clears_s, metres in ((1.0, 1.0), (sqrt(2.0), 5.0)))
        return Truth(HOUR_S / (service_s + least), HOUR_S / (service_s + most))

    return System(name, made, per_hour, truth)


def two_shifts(name: str, early: int, late: int) -> System:
    """Orders come every 10 s to a place that takes 14 s, and after the shift every 20 s: waits grow by 4 s an order, then shrink by 6."""
    arrivals = np.cumsum([10.0] * early + [20.0] * late)
    tasks = [{"name": f"o{k}", "stops": ["S"], "release_s": a, "service_s": SERVICE_S} for k, a in enumerate(arrivals.tolist())]

    def truth(variation: Variation, _: Any) -> Truth:
        waits_s = [4.0 * k for k in range(early)]
        for _ in range(late):
            waits_s.append(max(waits_s[-1] - 6.0, 0.0))
        waited_s = sum(waits_s) / len(waits_s) + SERVICE_S + variation.budget_s
        return Truth(waited_s, waited_s + variation.step_length_s)

    limit_s = float(arrivals[-1] + 40 * SERVICE_S)
    return System(name, lambda folder, variation: standing(folder, variation, limit_s, 1, tasks), flow_s, truth, "s in system")


def charging_share(result: Any) -> float:
    """The share of its time for which the robot is charged, over whole rounds from the end of a charge to the end of another."""
    stops, tasks = result.execution.stops, result.execution.tasks
    rows = np.flatnonzero(~tasks.is_order[stops.task])
    begins, ends = stops.begin_s[rows], stops.end_s[rows]
    return float((ends - begins)[1:].sum() / (ends[-1] - ends[0]))


def charging(name: str) -> System:
    """One robot goes round, A to B to A, and charges on its way: what it draws from one full charge to another is what it is given."""
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

    def truth(variation: Variation, result: Any) -> Truth:
        stops, is_order, step_s = result.execution.stops, result.execution.tasks.is_order, variation.step_length_s
        charges = np.flatnonzero(~is_order[stops.task])
        num_services = int((np.diff(charges) - 1).sum())
        lap, stop_s = lap_s((10.0,) * 4, step_s) + turn_s(np.pi / 2, step_s), 1.0 - step_s + max(5.0, variation.budget_s)
        away_s = float((stops.begin_s[charges[1:]] - stops.end_s[charges[:-1]]).sum())
        laps = round((away_s - num_services * stop_s) / lap)
        away_s = laps * lap + num_services * stop_s  # as it ought to be
        once_j = BATTERY["mass_kg"] * 1.0**2  # to 1 m/s and to rest
        turns = int(np.pi / 2 / SMALL["turn_rate_rad_s"] / step_s)  # steps at the full rate; the next has what is left of a quarter turn
        rates = np.array([0.0, *[SMALL["turn_rate_rad_s"]] * turns, np.pi / 2 / step_s - turns * SMALL["turn_rate_rad_s"]])
        turn_j = BATTERY["inertia_kgm2"] * float(np.abs(np.diff(rates)) @ rates[1:])
        rolling_j = BATTERY["mass_kg"] * 9.81 * BATTERY["friction"] * 40.0
        drawn_j = laps * (rolling_j + 4 * (once_j + turn_j)) + num_services * once_j + BATTERY["device_w"] * away_s
        charged_s = drawn_j / (BATTERY["voltage_v"] * BATTERY["charging_a"])
        share = charged_s / (charged_s + away_s)
        return Truth(share, share)

    return System(name, made, charging_share, truth, "share")


def systems() -> Mapping[str, System]:
    """By name."""
    outcome = [
        on_ring("loop, 1 robot at A", 1, ["A"], [5.0], lambda *_: Truth(720.0, 720.0), ["A"]),
        on_ring("loop, A to B, 1 robot", 1, ["A", "B"], [5.0, 3.0], there_and_back((5.0, 3.0)), ["A"]),
        on_ring("loop, no services", 1, ["A", "B"], [0.0], passing, ["A"]),
        on_ring("tandem A 30 s, B 5 s, 1 robot", 1, ["A", "B"], [30.0, 5.0], bound(30.0, 1, 5.0), ["B"]),
        on_ring("tandem A 30 s, B 5 s, 2 robots", 2, ["A", "B"], [30.0, 5.0], bound(30.0, 2, 5.0), ["B", "c4"]),
        on_ring("tandem A 30 s, B 5 s, 4 robots", 4, ["A", "B"], [30.0, 5.0], bound(30.0, 4, 5.0), ["B", "c4", "c1", "c3"]),
        repair("machine repair, A 20 s, 4 robots", 4, 20.0, None, 5),
        repair("closed A 20 s, B 12 s, 3 robots", 3, 20.0, 12.0, 6),
        dead_end("tee, 2 robots at X 50 s", 50.0),
        two_shifts("two shifts, D/D/1", 40, 40),
        queue("M/D/1", 1, False, 1),
        queue("M/M/1", 1, True, 2),
        queue("M/M/2", 2, True, 3),
        queue("M/M/3", 3, True, 4),
        charging("battery with a charger"),
    ]
    return {system.name: system for system in outcome}


GRANTED_M = 4.0  # visits that are granted ahead, by default, on lanes of a metre: from so far on the way beyond a stop can be asked for


def passing(variation: Variation, _: Any) -> Truth:
    """Going by A and B without a stop: a lap of four stretches, each from rest to rest at the corners.

    An answer that is there only when the robot has braked for a while costs the square of that time, one when it stands the time itself.
    """
    step_s = variation.step_length_s
    braked_s = [max(0.0, variation.budget_s + looks * step_s - (GRANTED_M - 0.5)) for looks in (0, 2)]
    lost_s = [2 * (late_s if late_s > 1.0 else late_s**2) for late_s in braked_s]
    once_s = lap_s((10.0, 10.0, 10.0, 10.0), step_s) + turn_s(np.pi / 2, step_s)
    return Truth(HOUR_S / (once_s + lost_s[1]), HOUR_S / (once_s + lost_s[0]))
