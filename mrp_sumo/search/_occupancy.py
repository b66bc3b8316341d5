"""Robots by spot and step, of the records that are installed, so that a search can count the robots it would disturb.

A bit for every spot and step says whether a robot on its way is there, another whether more than one is; only
where these do not suffice is the list looked up that tells who. Lists hold what happens at a spot within WORD
steps. Robots at their goals are kept apart from these.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._records import FOREVER, OK, TOO_LATE

WORD = 32  # steps in a word of bits
ONE, MANY = np.uint64(1), np.uint64(1 << WORD)  # bits of a word's first step


class Occupancy(NamedTuple):
    """S spots, R robots, T steps, W = T / WORD. A visit is a robot at a step: its number is step * R + robot + 1."""

    busy: np.ndarray  # [S * W] uint64 bits: a robot on its way is there; above them: more than one
    visit: np.ndarray  # [S * W] int32 the first visit within the word's steps, 0 for none
    after: np.ndarray  # [T * R + 1] int32 the next visit within the same word
    since: np.ndarray  # [S] int32 from when on a robot is there for good, FOREVER for nobody
    parked: np.ndarray  # [S] int32 which
    record: np.ndarray  # [R] int64 installed, -1 for none
    words: int  # W


def empty_occupancy(num_spots: int, num_robots: int, horizon: int) -> Occupancy:
    """Nobody anywhere; `horizon` is a multiple of WORD."""
    words = horizon // WORD
    return Occupancy(
        np.zeros(num_spots * words, np.uint64),
        np.zeros(num_spots * words, np.int32),
        np.empty(horizon * num_robots + 1, np.int32),
        np.full(num_spots, FOREVER, np.int32),
        np.full(num_spots, -1, np.int32),
        np.full(num_robots, -1, np.int64),
        words,
    )


@kernel
def steps_known(occupancy):
    """T: robots on their way are known of before this step."""
    return WORD * occupancy.words


@kernel(inline="always")
def next_visit(after, first, low, num_robots):
    """The first visit of a list, from visit `first` on, that is one of those numbered low + 1 .. low + num_robots; 0 for none."""
    k = np.int64(first)
    while k > 0 and not (low < k <= low + num_robots):
        k = np.int64(after[k])
    return k


@kernel
def visitor(occupancy, spot, step, visit):
    """The next visit at a spot and step after `visit` (0: the first one), 0 when there is none; step is below T."""
    num_robots = len(occupancy.record)
    if visit == 0:
        word = spot * occupancy.words + (step >> 5)
        if not (occupancy.busy[word] >> np.uint64(step & 31)) & ONE:
            return np.int64(0)
        k = np.int64(occupancy.visit[word])
    else:
        k = np.int64(occupancy.after[visit])
    return next_visit(occupancy.after, k, step * num_robots, num_robots)


@kernel
def _install(store, occupancy, record):
    """Put a robot on its path; False when the path is longer than the tables."""
    busy, visit, after = occupancy.busy, occupancy.visit, occupancy.after
    num_robots, words = len(occupancy.record), occupancy.words
    robot, path0, cost = store.meta[record].robot, store.meta[record].path0, store.meta[record].cost
    if cost >= WORD * words:
        return False
    for t in range(cost):
        word = np.int64(store.path[path0 + t].spot) * words + (t >> 5)
        k = t * num_robots + robot + 1
        after[k] = visit[word]
        visit[word] = k
        bit = ONE << np.uint64(t & 31)
        busy[word] |= bit | (busy[word] & bit) << np.uint64(WORD)
    v = store.path[path0 + cost].spot
    occupancy.parked[v] = robot
    occupancy.since[v] = cost
    occupancy.record[robot] = record
    return True


@kernel
def uninstall(store, occupancy, robot):
    """Take a robot off its path."""
    record = occupancy.record[robot]
    if record < 0:
        return
    busy, visit, after = occupancy.busy, occupancy.visit, occupancy.after
    num_robots, words = len(occupancy.record), occupancy.words
    path0, cost = store.meta[record].path0, store.meta[record].cost
    for t in range(cost):
        word = np.int64(store.path[path0 + t].spot) * words + (t >> 5)
        low = t * num_robots
        mine = low + robot + 1
        others = 0
        before, k = np.int64(0), np.int64(visit[word])
        while k > 0:
            following = np.int64(after[k])
            if k == mine:
                if before:
                    after[before] = following
                else:
                    visit[word] = following
            else:
                others += low < k <= low + num_robots
                before = k
            k = following
        if others < 2:
            busy[word] &= ~((MANY if others else ONE) << np.uint64(t & 31))
    v = store.path[path0 + cost].spot
    if occupancy.parked[v] == robot:
        occupancy.parked[v] = -1
        occupancy.since[v] = FOREVER
    occupancy.record[robot] = -1


@kernel
def install_all(store, occupancy, records, but):
    """Make the occupancy that of these records [R] without robot `but`; only what differs is touched."""
    for robot in range(len(records)):
        if occupancy.record[robot] != records[robot] or robot == but:
            uninstall(store, occupancy, robot)
    for robot in range(len(records)):
        if (
            robot != but
            and records[robot] >= 0
            and occupancy.record[robot] != records[robot]
            and not _install(store, occupancy, records[robot])
        ):
            return TOO_LATE
    return OK
