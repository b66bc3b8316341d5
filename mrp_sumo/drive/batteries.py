"""The batteries of a fleet while robots drive: drained by what they do, filled at chargers."""

from collections.abc import Sequence

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.battery import BatteryLog, Charging, full_s
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, frozen
from mrp_sumo.core.robot_type import Battery

BATTERIES = 43  # purpose of the stream of chance
SAMPLE_S = 10.0


class Batteries:
    """States of charge of R robots."""

    def __init__(self, fleet: Fleet, start: tuple[float, float], seed: int, period_s: float, charging: Charging | None = None) -> None:
        """All types of the fleet have a battery; `start` are the levels at first, `period_s` is the time between two samples."""
        num_robots = fleet.num_robots
        self._fleet, self._loaded = fleet, fleet.batteries_loaded
        self._of_kind = [(battery, np.flatnonzero(fleet.kind == k)) for k, battery in enumerate(fleet.batteries)]
        self._energy_j, self._full_s = (np.zeros(num_robots) for _ in range(2))
        for battery, mine in self._of_kind:
            self._energy_j[mine], self._full_s[mine] = battery.energy_j, full_s(charging, battery.charge_s(1.0))
        self.level: FloatArray = np.random.default_rng([seed, BATTERIES]).uniform(*start, num_robots)  # [R] shares of the capacity
        self._used_j, self._charged_j = np.zeros(num_robots), np.zeros(num_robots)
        self._lift_j = np.array([battery.lift_j for battery in fleet.batteries])[fleet.kind]
        self._num_lifts = np.zeros(num_robots, np.int64)
        self._period_s = period_s
        self._samples: list[FloatArray] = []  # [K, 2, R] headings and speeds since the last look, and the last before it
        self._rate = np.zeros((1, num_robots))  # at which robots turned before that
        self._t_s: list[float] = []
        self._levels: list[FloatArray] = []

    def add(self, yaw_rad: FloatArray, speed_mps: FloatArray) -> None:
        """Samples [K, R] of what robots did, one period after the other."""
        self._samples.append(np.stack([yaw_rad, speed_mps], 1))

    @property
    def num_samples(self) -> int:
        """Samples since the last look, and the last before it."""
        return sum(map(len, self._samples))

    def observe(
        self, now_s: float, charging: BoolArray, is_loaded: BoolArray | None = None, num_lifts: IntArray | None = None
    ) -> list[int]:
        """Drain and fill batteries by what robots have done since the last look. Returns those that have run empty in it.

        `num_lifts` [R] is how many loads each has lifted so far; by default as many as at the last look.
        """
        return self.observe_each([now_s], [self.num_samples], charging, is_loaded, num_lifts)

    def observe_each(
        self,
        looks_s: Sequence[float],
        num_samples: Sequence[int],
        charging: BoolArray,
        is_loaded: BoolArray | None = None,
        num_lifts: IntArray | None = None,
    ) -> list[int]:
        """`observe` at several times, of which each comes after so many of the samples; the first is the last before the first look.

        Returns those that have run empty in the last.
        """
        samples, dt = np.concatenate(self._samples), self._period_s
        yaw_rad, speed_mps = samples[:, 0], samples[:, 1]
        turn_rate = wrapped(np.diff(yaw_rad, axis=0)) / dt
        turning = np.diff(turn_rate, axis=0, prepend=self._rate) / dt
        mean_mps, accel = (speed_mps[1:] + speed_mps[:-1]) / 2, np.diff(speed_mps, axis=0) / dt
        powers_w = [
            (mine, battery.power_w(mean_mps[:, mine], accel[:, mine], turn_rate[:, mine], turning[:, mine]))
            for battery, mine in self._in_use(is_loaded)
        ]
        after = np.array(num_samples) - 1
        begin = np.append(0, after[:-1])
        drawn_j = np.zeros((len(looks_s), len(self.level)))
        for mine, power_w in powers_w:
            drawn_j[:, mine] = np.array([power_w[a:b].sum(0) for a, b in zip(begin.tolist(), after.tolist())]) * dt
        if num_lifts is not None:
            drawn_j[0] += self._lift_j * (num_lifts - self._num_lifts)
            self._num_lifts = num_lifts.copy()
        level = self._take(drawn_j, (after - begin) * dt, charging)
        for k, look_s in enumerate(looks_s):
            if look_s >= len(self._t_s) * SAMPLE_S - 1e-9:
                self._note(look_s, level[k + 1])
        self.level = level[-1]
        self._samples, self._rate = [samples[after[-1] :]], np.concatenate([self._rate, turn_rate])[after[-1] : after[-1] + 1]
        emptied: list[int] = np.flatnonzero((level[-1] <= 0) & (level[-2] > 0)).tolist()
        return emptied

    def _in_use(self, is_loaded: BoolArray | None) -> list[tuple[Battery, IntArray]]:
        """Batteries as they are, and the robots that have them."""
        if not self._loaded or is_loaded is None:
            return self._of_kind
        pairs = zip(self._loaded, self._of_kind)
        return [part for loaded, (one, mine) in pairs for part in ((one, mine[~is_loaded[mine]]), (loaded, mine[is_loaded[mine]]))]

    def _take(self, drawn_j: FloatArray, charged_s: FloatArray, charging: BoolArray) -> FloatArray:
        """Robots draw so much [K, R] between looks, or are charged for so long [K]. Returns levels [K + 1, R] from the last look on."""
        change = np.where(charging, charged_s[:, None] / self._full_s, -drawn_j / self._energy_j)
        level = np.minimum(_sums(self.level, change), 1.0)
        drained = np.logical_or.accumulate(~charging & (drawn_j > 0) & (drawn_j >= level[:-1] * self._energy_j))
        level[1:][drained] = 0.0
        used_j = np.where(charging, 0.0, np.minimum(drawn_j, level[:-1] * self._energy_j))  # no more than there is
        charged_j = (level[1:] - level[:-1]) * charging * self._energy_j
        self._used_j, self._charged_j = _sums(self._used_j, used_j)[-1], _sums(self._charged_j, charged_j)[-1]
        return level

    def most_per_s(self) -> FloatArray:
        """[R] shares of their capacity that robots draw in a second at most, or that they are charged by."""
        share, fleet = 1 / self._full_s, self._fleet
        with_load = [(battery, mine, fleet.loaded or fleet) for battery, (_, mine) in zip(self._loaded, self._of_kind)]
        for battery, mine, limits in (*((battery, mine, fleet) for battery, mine in self._of_kind), *with_load):
            accel, rate = np.maximum(limits.accel_mps2, limits.decel_mps2)[mine], limits.turn_rate_rad_s[mine]
            most_w = battery.power_w(limits.max_speed_mps[mine], accel, rate, 2 * rate / self._period_s)
            share[mine] = np.maximum(share[mine], most_w / self._energy_j[mine])
        return share

    def log(self, now_s: float, critical: float) -> BatteryLog:
        """The log of all batteries until now."""
        if not self._t_s or now_s > self._t_s[-1]:
            self._note(now_s, self.level)
        level = np.ceil(np.array(self._levels) * 1e6) / 1e6  # as tables keep it; what is not empty stays so
        return BatteryLog(frozen(np.array(self._t_s)), frozen(level), frozen(self._used_j), frozen(self._charged_j), critical)

    def _note(self, now_s: float, level: FloatArray) -> None:
        self._t_s.append(now_s)
        self._levels.append(level.copy())


def _sums(begin: FloatArray, added: FloatArray) -> FloatArray:
    """[K + 1, R] sums of what was there [R] and what is added [K, R], one after the other: as exact as single steps."""
    return np.add.accumulate(np.concatenate([begin[None], added]))
