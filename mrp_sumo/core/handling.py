"""Loads and how long they take to handle: an order of two stops or more is a load, on board from its first stop to its last.

Times are drawn by order, stop and action, so that they are the same for whichever robot of a type comes.
"""

from functools import lru_cache
from zlib import crc32

import numpy as np

from mrp_sumo.core.arrivals import ServiceTime
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.task import Task

HANDLING = 71  # purpose of the stream of chance
STANDS_S = 1.0  # at least, where a load goes on or off a robot whose limits change with it


def stop_s(fleet: Fleet, seed: int, robot: int, task: Task, nth: int) -> float:
    """Time in s for which a robot is at a stop of an order: what is asked for, and the actions of its type."""
    stop, change = task.stops[nth], load_change(task, nth)
    takes_s = stop.service_s
    times = fleet.types[fleet.kind[robot]].actions if fleet.types else None
    if times is not None:
        done = (*(("pick",) if change > 0 else ("drop",) if change else ()), *(stop.station.actions if stop.station else ()))
        from_end = len(task.stops) - nth  # the same where another robot goes on with it
        takes_s += sum(_drawn_s(seed, task.name, from_end, action, time) for action in done if (time := getattr(times, action)))
    return max(takes_s, STANDS_S) if change and fleet.loaded is not None else takes_s


def load_change(task: Task, nth: int) -> int:
    """Loads that a robot has more on board after a stop of an order: 1 after the first of several, -1 after the last."""
    return (nth == 0) - (nth == len(task.stops) - 1)


@lru_cache(maxsize=100_000)
def _drawn_s(seed: int, order: str, from_end: int, action: str, time: ServiceTime) -> float:
    return time.draw(np.random.default_rng([seed, HANDLING, crc32(order.encode()), from_end, crc32(action.encode())]))
