"""Keeps what happened: samples of every robot at a fixed period, and events. Positions follow from distances at the end."""

from dataclasses import dataclass, field

import numpy as np

from mrp_sumo.core.execution import Event
from mrp_sumo.core.graph import FloatArray, IntArray

ROWS = 256  # samples are kept in blocks of this many


@dataclass
class Recorder:
    """Samples of R robots."""

    num_robots: int
    events: list[Event] = field(default_factory=list)
    _blocks: list[FloatArray] = field(default_factory=list)  # [ROWS, 3, R]: distance, yaw, speed
    _count: int = 0

    def sample(self, s_m: FloatArray, yaw_rad: FloatArray, speed_mps: FloatArray) -> None:
        """Keep one sample, the next by the period."""
        row = self._count % ROWS
        if row == 0:
            self._blocks.append(np.empty((ROWS, 3, self.num_robots)))
        block = self._blocks[-1][row]
        block[0], block[1], block[2] = s_m, yaw_rad, speed_mps
        self._count += 1

    def samples(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance along the path, yaw and speed, [T, R] each."""
        parts = [block[: self._count - k * ROWS] for k, block in enumerate(self._blocks)]
        s, yaw, speed = (np.concatenate([part[:, k] for part in parts]) for k in range(3))
        return s, yaw, speed


def positions_m(s_m: FloatArray, first: IntArray, at_m: FloatArray, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """x and y [T, R] of robots that have driven `s_m` [T, R] along their paths.

    Parameters
    ----------
    first
        [R + 1] CSR of the paths' points.
    at_m
        [N] distance of each point along its path.
    xy
        [N, 2] the points.
    """
    x, y = np.empty_like(s_m), np.empty_like(s_m)
    for r in range(len(first) - 1):
        points = slice(first[r], first[r + 1])
        x[:, r] = np.interp(s_m[:, r], at_m[points], xy[points, 0])
        y[:, r] = np.interp(s_m[:, r], at_m[points], xy[points, 1])
    return x, y
