"""Ways for all robots, one after the other: where one finds none, it is raised above those in its way, which look for others then."""

from time import process_time

import numpy as np

from mrp_sumo.core.graph import IntArray
from planners.safe_interval.timetable import TimedPath, Timetable

EFFORTS = ((1_000, 1.0), (2_000, 1.5), (6_000, 2.5))  # entries a search looks at, and its weight
RAISES = 1  # of each robot on average, before another order is tried

KnownWays = dict[tuple[int | TimedPath | None, ...], tuple[TimedPath | None, int]]  # of a robot beside others' ways: its own, and entries


def first_ways(timetable: Timetable, order: IntArray, protected_steps: int, deadline_s: float, most_work: int) -> bool:
    """Fill the timetable by robots in an order [R]. Returns whether all have ways.

    Starts of robots that still have no way are left to them for `protected_steps`. No more searches begin after the deadline
    (process_time), or when the timetable has done `most_work`, in entries since it was made.
    """
    timetable.clear(protected_steps)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    raised = np.zeros(len(order), np.int64)
    waiting = order.tolist()
    known: KnownWays = {}
    while waiting:
        if process_time() > deadline_s or timetable.work > most_work or raised.sum() > RAISES * len(order) + 20:
            return False
        robot = waiting.pop(0)
        path = _first_way(timetable, robot, known)
        evicted: list[int] = []
        if path is None:
            raised[robot] += 1
            path, evicted = _raise(timetable, robot, raised, known)
        if path is None:
            return False
        timetable.add(robot, path)
        waiting = sorted(evicted, key=rank.__getitem__) + waiting
    return True


def _first_way(timetable: Timetable, robot: int, known: KnownWays) -> TimedPath | None:
    """The earliest way, or where that takes long to find, one that is good.

    Robots that raise each other in turns look for the same ways again: these are known, but count as work as if they were not.
    """
    key = robot, *timetable.path
    if key not in known:
        path, before = None, timetable.work
        for most, weight in EFFORTS:
            path = timetable.search(robot, most, weight=weight)
            if path or timetable.exhausted:
                break
        known[key] = path, timetable.work - before
        return path
    path, work = known[key]
    timetable.work += work
    return path


def _raise(timetable: Timetable, robot: int, raised: IntArray, known: KnownWays) -> tuple[TimedPath | None, list[int]]:
    """A way around those only that have been raised as often, or around nobody; and who has lost his way by that."""
    with_path = [r for r, path in enumerate(timetable.path) if path is not None]
    lower = [r for r in with_path if raised[r] < raised[robot]]
    lost: list[int] = []  # whom the starts of others, protected again for a moment, kept from their ways
    for others in (lower, with_path) if len(lower) < len(with_path) else (lower,):
        removed = [(r, path) for r in others if (path := timetable.remove(r)) is not None]
        path = _first_way(timetable, robot, known)
        if path is None:
            lost += _put_back(timetable, removed)
            continue
        timetable.add(robot, path)
        evicted = lost + _put_back(timetable, removed)
        timetable.remove(robot)
        return path, evicted
    return None, []


def _put_back(timetable: Timetable, removed: list[tuple[int, TimedPath]]) -> list[int]:
    """Robots get their ways again, but for those where somebody else is in the way."""
    evicted = []
    for robot, path in removed:
        if len(timetable.hinders(robot, path)):
            evicted.append(robot)
        else:
            timetable.add(robot, path)
    return evicted
