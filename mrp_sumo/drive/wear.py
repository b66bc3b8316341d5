"""Failures and maintenance of robots that come with use: after how many hours with an order, and how long they then stand.

Each robot has a stream of chance of its own, `default_rng([seed, purpose, robot])`, so that its failures in hours of use depend on nobody
else. What comes up is a breakdown as a scenario lists them (`drive.world`).
"""

import math
from collections.abc import Sequence

import numpy as np

from mrp_sumo.core.disturbances import MAINTAINED, Failure
from mrp_sumo.core.robot_type import HOUR_S, RobotShape
from mrp_sumo.drive.robot_work import NONE, RobotWork

FAILURES = 61  # purpose of the streams of chance
PUSHED_MPS = 0.5  # speed of a robot that people push


class Wear:
    """Hours of use of R robots, and what is due after so many."""

    def __init__(self, of_robot: Sequence[RobotShape], seed: int) -> None:
        self._of_robot = of_robot
        self.any = any(each.mtbf_h or each.maintenance for each in of_robot)
        self._rng = [np.random.default_rng([seed, FAILURES, r]) for r in range(len(of_robot))]
        self._used_s = np.zeros(len(of_robot))  # [R] time with an order
        self._fails_s = np.array([self._next_s(r) for r in range(len(of_robot))])  # [R] of it, after which each fails
        self._serviced_s = np.array([HOUR_S * each.maintenance.every_h if each.maintenance else np.inf for each in of_robot])
        self._works: list[int] = []  # robots with an order at the last look, which was at
        self._looked_s = 0.0

    def look(self, now_s: float, robots: Sequence[RobotWork]) -> list[Failure]:
        """Failures and maintenance that are due, as robots have been at their orders since the last look."""
        self._used_s[self._works] += now_s - self._looked_s
        self._looked_s, due = now_s, list[Failure]()
        for robot in robots:
            r, of_type = robot.number, self._of_robot[robot.number]
            if robot.is_broken or robot.is_gone:
                robot.is_called = False
                continue
            if self._used_s[r] >= self._fails_s[r] - 1e-9:
                stands_s = math.inf if of_type.tow_s is None else of_type.tow_s
                due.append(Failure(r, now_s, self._repair_s(r), stands_s, PUSHED_MPS))
                self._fails_s[r] = self._used_s[r] + self._next_s(r)
            elif self._used_s[r] >= self._serviced_s[r] - 1e-9 and of_type.maintenance:
                robot.is_called = True
                if robot.task == NONE:
                    due.append(Failure(r, now_s, of_type.maintenance.takes_s, 0.0, text=MAINTAINED))
                    self._serviced_s[r] = self._used_s[r] + HOUR_S * of_type.maintenance.every_h
        broken = {failure.robot for failure in due}
        self._works = [robot.number for robot in robots if robot.is_at_order and robot.number not in broken]
        return due

    def is_current(self, robots: Sequence[RobotWork]) -> bool:
        """True if those have orders who had some at the last look, so that nothing is due before `wake_s`."""
        return not self.any or self._works == [robot.number for robot in robots if robot.is_at_order]

    @property
    def wake_s(self) -> float:
        """Time of the next, if all robots go on with their orders."""
        if not self._works:
            return np.inf
        left_s = np.minimum(self._fails_s, np.where(self._serviced_s > self._used_s, self._serviced_s, np.inf)) - self._used_s
        return self._looked_s + float(left_s[self._works].min())

    def _next_s(self, r: int) -> float:
        """Time of use until a robot fails the next time."""
        of_type = self._of_robot[r]
        if of_type.mtbf_h is None:
            return math.inf
        return HOUR_S * of_type.mtbf_h / math.gamma(1 + 1 / of_type.mtbf_shape) * float(self._rng[r].weibull(of_type.mtbf_shape))

    def _repair_s(self, r: int) -> float:
        of_type = self._of_robot[r]
        mean_s, sigma = HOUR_S * (of_type.mttr_h or 0.0), of_type.mttr_sigma
        if sigma is None:
            return float(self._rng[r].exponential(mean_s))
        return mean_s * float(self._rng[r].lognormal(-(sigma**2) / 2, sigma))
