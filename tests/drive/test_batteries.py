"""Batteries of a fleet drain by time and motion, and fill at chargers."""

from types import SimpleNamespace

import numpy as np
import pytest

from mrp_sumo.core.battery import Battery
from mrp_sumo.drive.batteries import Batteries

SMALL = Battery(10.0, 1.0, 36.0, 1.0, 0.0, 0.0, 36.0)  # 36 kJ: a thousandth a second at rest, one more to accelerate; charged in 100 s


def test_standing_drains_by_time_and_charging_fills():
    batteries = Batteries([SMALL], np.zeros(2, np.int64), (0.5, 0.5), 0)
    still = SimpleNamespace(speed_mps=np.zeros(2), yaw_rad=np.zeros(2))
    for now_s in np.arange(0.0, 10.5, 0.5):
        batteries.observe(now_s, still, np.array([False, True]))
    assert batteries.level == pytest.approx([0.49, 0.6])
    log = batteries.log(10.0, 0.2)
    assert log.used_j == pytest.approx([360, 0]) and log.charged_j == pytest.approx([0, 3600]) and log.t_s.tolist() == [0, 10]
