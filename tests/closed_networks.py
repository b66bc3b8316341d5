"""Closed networks whose throughput is known exactly: N robots go round a floor and stations, whose rates depend on how many are there.

All times are exponential, so the networks have product form: `throughput_per_h` is exact (Buzen's convolution with rates that depend on the
load, Communications of the ACM 16, 1973; the same numbers as mean value analysis). `Studied` draws the runs that a capacity study asks for.
"""

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
    def truth(self) -> dict[str, float]:
        """Peak, knee and collapse of the sizes that are asked about; NaN: none."""
        sizes = range(self.sizes[0], self.sizes[1] + 1)
        of = {n: self.throughput_per_h(n) for n in sizes}
        best = max(of.values())
        peak = next(n for n in sizes if of[n] >= best * (1 - 1e-9))
        knee = next(n for n in sizes if of[n] >= 0.95 * best)
        collapse = next((n for n in sizes if n > peak and of[n] < 0.95 * best), np.nan)
        return {"peak": peak, "knee": knee, "collapse": collapse, "best_per_h": best}


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
