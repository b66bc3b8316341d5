"""Loads and how long they take to handle: an order of two stops or more is a load, on board from its first stop to its last.

Times are drawn by order, stop and action, so that they are the same for whichever robot of a type comes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from zlib import crc32

import numpy as np

from mrp_sumo.core.arrivals import ServiceTime
from mrp_sumo.core.task import Task

HANDLING = 71  # purpose of the stream of chance
STANDS_S = 1.0  # at least, where a load goes on or off a robot whose limits change with it


@dataclass(frozen=True)
class Handling:
    """Times that stops take robots beside what is asked for."""

    actions: tuple[Mapping[str, ServiceTime], ...] = ()  # [K] times of actions, by type of robots
    kind: tuple[int, ...] = ()  # [R] types
    seed: int = 0
    least_s: float = 0.0  # of stops at which a load goes on or off

    def stop_s(self, robot: int, task: Task, nth: int) -> float:
        """Time in s for which a robot is at a stop of an order."""
        stop, change = task.stops[nth], load_change(task, nth)
        takes_s = stop.service_s
        if self.actions:
            times = self.actions[self.kind[robot]]
            done = (*(("pick",) if change > 0 else ("drop",) if change else ()), *(stop.station.actions if stop.station else ()))
            from_end = len(task.stops) - nth  # the same where another robot goes on with it
            takes_s += sum(_drawn_s(self.seed, task.name, from_end, action, times[action]) for action in done if action in times)
        return max(takes_s, self.least_s) if change else takes_s


def load_change(task: Task, nth: int) -> int:
    """Loads that a robot has more on board after a stop of an order: 1 after the first of several, -1 after the last."""
    return (nth == 0) - (nth == len(task.stops) - 1)


@lru_cache(maxsize=100_000)
def _drawn_s(seed: int, order: str, from_end: int, action: str, time: ServiceTime) -> float:
    return time.draw(np.random.default_rng([seed, HANDLING, crc32(order.encode()), from_end, crc32(action.encode())]))
