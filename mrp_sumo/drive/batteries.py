"""The batteries of a fleet while robots drive: drained by what they do, filled at chargers."""

from collections.abc import Sequence

import numpy as np

from mrp_sumo.core.battery import Battery, BatteryLog
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, frozen
from mrp_sumo.drive.state import Motion

BATTERIES = 43  # purpose of the stream of chance
SAMPLE_S = 10.0


class Batteries:
    """States of charge of R robots."""

    def __init__(self, batteries: Sequence[Battery], kind: IntArray, start: tuple[float, float], seed: int) -> None:
        """`batteries` [K] are those of the types, `kind` [R] says which each robot is."""
        num_robots = len(kind)
        self._of_kind = [(battery, np.flatnonzero(kind == k)) for k, battery in enumerate(batteries)]
        self._energy_j, self._full_s = (np.zeros(num_robots) for _ in range(2))
        for battery, mine in self._of_kind:
            self._energy_j[mine], self._full_s[mine] = battery.energy_j, battery.charge_s(1.0)
        self.level: FloatArray = np.random.default_rng([seed, BATTERIES]).uniform(*start, num_robots)  # [R] shares of the capacity
        self._used_j, self._charged_j = np.zeros(num_robots), np.zeros(num_robots)
        self._before: tuple[float, FloatArray, FloatArray, FloatArray] | None = None  # s, speed, yaw, turn rate
        self._t_s: list[float] = []
        self._levels: list[FloatArray] = []

    def observe(self, now_s: float, motion: Motion, charging: BoolArray) -> list[int]:
        """Drain and fill batteries by what robots have done since the last call. Returns those that have run empty in it."""
        speed_mps, yaw_rad, turn_rate = motion.speed_mps.copy(), motion.yaw_rad.copy(), np.zeros(len(self.level))
        empty: list[int] = []
        if self._before is not None and now_s > self._before[0]:
            then_s, speed_then, yaw_then, rate_then = self._before
            dt = now_s - then_s
            turn_rate = (yaw_rad - yaw_then + np.pi) % (2 * np.pi) - np.pi
            turn_rate /= dt
            mean_mps, accel = (speed_mps + speed_then) / 2, (speed_mps - speed_then) / dt
            turning, power_w = (turn_rate - rate_then) / dt, np.zeros(len(self.level))
            for battery, mine in self._of_kind:
                power_w[mine] = battery.power_w(mean_mps[mine], accel[mine], turn_rate[mine], turning[mine])
            before, filled = self.level, np.where(charging, dt / self._full_s, 0.0)
            drained = ~charging & (power_w * dt >= before * self._energy_j)
            used_j = np.where(charging, 0.0, np.minimum(power_w * dt, before * self._energy_j))  # no more than there is
            self.level = np.where(drained, 0.0, np.clip(before - used_j / self._energy_j + filled, 0.0, 1.0))
            self._used_j += used_j
            self._charged_j += (np.minimum(before + filled, 1.0) - before) * charging * self._energy_j
            empty = np.flatnonzero((self.level <= 0) & (before > 0)).tolist()
        self._before = now_s, speed_mps, yaw_rad, turn_rate
        if now_s >= len(self._t_s) * SAMPLE_S - 1e-9:
            self._note(now_s)
        return empty

    def log(self, now_s: float, critical: float) -> BatteryLog:
        """What has become of them until now."""
        if not self._t_s or now_s > self._t_s[-1]:
            self._note(now_s)
        level = np.ceil(np.array(self._levels) * 1e6) / 1e6  # as tables keep it; what is not empty stays so
        return BatteryLog(frozen(np.array(self._t_s)), frozen(level), frozen(self._used_j), frozen(self._charged_j), critical)

    def _note(self, now_s: float) -> None:
        self._t_s.append(now_s)
        self._levels.append(self.level.copy())
