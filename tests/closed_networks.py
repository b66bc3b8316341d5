"""Closed networks whose throughput is known exactly: N robots go round a floor and stations, whose rates depend on how many are there.

All times are exponential, so the networks have product form: `throughput_per_h` is exact (Buzen's convolution with rates that depend on the
load, Communications of the ACM 16, 1973; the same numbers as mean value analysis). `Studied` draws the runs that a capacity study asks for.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from fleets import question, record_with
from numba import njit


@dataclass(frozen=True)
class Network:
    """Robots drive `drive_s` on the floor, slower the more drive there (not at all with `jam` of them), and are served at each station."""

    name: str
    drive_s: float
    stations: tuple[tuple[float, int], ...]  # mean service in s, places
    sizes: tuple[int, int]
    jam: float = np.inf

    def rates(self, most: int) -> np.ndarray:
        """[K, most + 1] departures a second from the floor and each station by the number there."""
        n = np.arange(most + 1)
        floor = n / self.drive_s * np.maximum(1 - n / self.jam, 0.05)
        return np.array([floor, *(np.minimum(n, places) / service_s for service_s, places in self.stations)])

    @lru_cache  # noqa: B019
    def throughput_per_h(self, robots: int) -> float:
        """Exactly."""
        total = np.zeros(robots + 1)
        total[0] = 1.0
        for rate in self.rates(robots) * 100.0:  # scaled: the constants stay in range
            with np.errstate(divide="ignore"):
                weight = np.cumprod(np.concatenate([[1.0], 1 / rate[1:]]))
            total = np.convolve(total, weight)[: robots + 1]
        return float(total[robots - 1] / total[robots]) / 100.0 * 3600.0

    @property
    def per_h(self) -> dict[int, float]:
        """Throughput of the sizes that are asked about."""
        return {n: self.throughput_per_h(n) for n in range(self.sizes[0], self.sizes[1] + 1)}


# One state is stable in each: where robots jam the floor, stations take them all at once. (A floor that a crowd jams and a station that a
# queue empties have two, and which of them a run of an hour is in hangs on how it began.)
NETWORKS = (
    Network("one station", 120.0, ((30.0, 1),), (1, 24)),
    Network("two stations", 200.0, ((20.0, 1), (35.0, 2)), (2, 30)),
    Network("crowded floor", 120.0, ((5.0, 20),), (2, 50), jam=60.0),
    Network("narrow floor", 60.0, ((4.0, 10),), (2, 26), jam=30.0),
    Network("long ways", 600.0, ((12.0, 1),), (4, 100)),
    Network("still rising", 900.0, ((15.0, 2),), (4, 40)),
)


def truth(per_h: Mapping[int, float]) -> dict[str, float]:
    """Peak, knee and collapse of fleets by size, ascending; NaN: none."""
    best = max(per_h.values())
    peak = next(n for n, of in per_h.items() if of >= best * (1 - 1e-9))
    knee = next(n for n, of in per_h.items() if of >= 0.95 * best)
    collapse = next((n for n, of in per_h.items() if n > peak and of < 0.95 * best), np.nan)
    return {"peak": peak, "knee": knee, "collapse": collapse}


def held(answer, per_h: Mapping[int, float]) -> dict[str, list[bool]]:
    """Which limits of a study's answer hold the truth. A collapse that is not there is *invented*; one not seen claims nothing."""
    curve, true = answer.curve, truth(per_h)
    sizes = {n: _holds(curve.points[n].throughput, per_h[n]) for n in curve.sizes}
    there = not np.isnan(true["collapse"])
    return {
        "size": list(sizes.values()),
        "best": [sizes[curve.best]],
        "peak": [_holds(answer.peak, true["peak"])],
        "knee": [_holds(answer.knee, true["knee"])],
        "collapse": [_holds(answer.collapse, true["collapse"])] if there and answer.collapse.estimate is not None else [],
        "seen": [answer.collapse.estimate is not None] if there else [],
        "invented": [] if there else [answer.collapse.estimate is not None],
    }


def by_hand(answer, per_h: Mapping[int, float]) -> list[bool]:
    """Whether limits of sizes hold what is known of them by hand."""
    return [_holds(answer.curve.points[n].throughput, of) for n, of in per_h.items() if n in answer.curve.points]


def agree(one, other) -> bool:
    """Whether the limits of two answers have something in common, in each of peak, knee and most throughput."""
    return all(
        _low(a) <= _high(b) and _low(b) <= _high(a) for a, b in ((one.peak, other.peak), (one.knee, other.knee), (_most(one), _most(other)))
    )


def _most(answer):
    return answer.curve.points[answer.curve.best].throughput


def _low(limits) -> float:
    return -np.inf if limits.low is None else limits.low


def _high(limits) -> float:
    return np.inf if limits.high is None else limits.high


def _holds(limits, truth: float) -> bool:
    return bool(_low(limits) <= truth <= _high(limits))


class Studied:
    """Records of trials of one study of a network."""

    def __init__(self, network: Network, study: int, effort) -> None:
        self.network, self.study = network, study
        self.question = question(network.sizes, replace(effort, budget_s=1e9))
        self._made = {}

    def __call__(self, trial):
        if trial not in self._made:
            horizon_s = self.question.effort.horizon_s
            rng = np.random.default_rng([self.study, trial.robots, trial.seed])
            done_s = _drive(self.network.rates(trial.robots), trial.robots, horizon_s, rng)
            self._made[trial] = record_with(done_s, horizon_s)
        return self._made[trial]


@njit
def _drive(rates, robots, horizon_s, rng):
    """Times at which orders are done: departures from the last station, all robots on the floor at first."""
    num, now = rates.shape[0], 0.0
    here = np.zeros(num, np.int64)
    here[0] = robots
    done = []
    while True:
        total = 0.0
        for k in range(num):
            total += rates[k, here[k]]
        now += rng.exponential(1 / total)
        if now > horizon_s:
            return np.array(done)
        at, left = 0, rng.random() * total
        while at < num - 1 and left >= rates[at, here[at]]:
            left -= rates[at, here[at]]
            at += 1
        here[at] -= 1
        here[(at + 1) % num] += 1
        if at == num - 1:
            done.append(now)
