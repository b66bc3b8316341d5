"""Keeps samples of every robot at a fixed period. Positions follow from distances along the paths at the end."""

from dataclasses import dataclass, field

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.drive import _controller

ROWS = 256  # samples are kept in blocks of this many


@dataclass
class Recorder:
    """Samples of R robots on their paths."""

    xy: FloatArray  # [N, 2] of the visits, m
    path: _controller.Path
    _done: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]] = field(default_factory=list)  # on earlier paths
    _blocks: list[FloatArray] = field(default_factory=list)  # [ROWS, 3, R]: distance, yaw, speed
    _count: int = 0

    def sample(self, s_m: FloatArray, yaw_rad: FloatArray, speed_mps: FloatArray) -> None:
        """Keep one sample, the next by the period."""
        row = self._count % ROWS
        if row == 0:
            self._blocks.append(np.empty((ROWS, 3, len(s_m))))
        block = self._blocks[-1][row]
        block[0], block[1], block[2] = s_m, yaw_rad, speed_mps
        self._count += 1

    def place(self, s_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """x and y of robots that have driven `s_m` [..., R] along their paths."""
        x, y = np.empty_like(s_m), np.empty_like(s_m)
        for r in range(len(self.path.first) - 1):
            points = slice(self.path.first[r], self.path.first[r + 1])
            x[..., r] = np.interp(s_m[..., r], self.path.at[points], self.xy[points, 0])
            y[..., r] = np.interp(s_m[..., r], self.path.at[points], self.xy[points, 1])
        return x, y

    def turn_to(self, xy: FloatArray, path: _controller.Path) -> None:
        """Robots go on along other paths."""
        self._done.append(self._samples())
        self.xy, self.path = xy, path
        self._blocks, self._count = [], 0

    def samples(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """x, y, yaw and speed, [T, R] each."""
        x, y, yaw, speed = (np.concatenate(parts) for parts in zip(*self._done, self._samples()))
        return x, y, yaw, speed

    def _samples(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        num_robots = len(self.path.first) - 1
        parts = [block[: self._count - k * ROWS] for k, block in enumerate(self._blocks)] or [np.empty((0, 3, num_robots))]
        s, yaw, speed = (np.concatenate([part[:, k] for part in parts]) for k in range(3))
        x, y = self.place(s)
        return x, y, yaw, speed
