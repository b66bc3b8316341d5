"""What each robot is at in a run with tasks: one duty at a time, which changes by one table, and the log of it.

A robot that is out of order for a while goes on with what it was at; one whose battery is empty stands for good.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np

from mrp_sumo.core import robot_states
from mrp_sumo.core.graph import BoolArray, IntArray, frozen
from mrp_sumo.core.robot_states import RobotStateLog

NONE = -1  # no task

IDLE, TO_STOP, IN_SERVICE, LEAVING, TO_CHARGER, CHARGING, STALLED, BROKEN, EMPTY = range(9)
NAMES = ("idle", "to stop", "in service", "leaving", "to charger", "charging", "stalled", "broken", "empty")
LOST = (BROKEN, EMPTY)
NEXT = {  # what may come after what
    IDLE: (TO_STOP, TO_CHARGER, *LOST),
    TO_STOP: (IN_SERVICE, LEAVING, IDLE, STALLED, *LOST),
    IN_SERVICE: (LEAVING, TO_STOP, IDLE, *LOST),
    LEAVING: (TO_STOP, IDLE, *LOST),  # its service, or its way to a stop without, will be over when what is asked for now takes effect
    TO_CHARGER: (CHARGING, IDLE, STALLED, *LOST),
    CHARGING: (LEAVING, IDLE, *LOST),
    STALLED: (TO_STOP, TO_CHARGER, IN_SERVICE, CHARGING, IDLE, *LOST),
    BROKEN: (IDLE, TO_STOP, IN_SERVICE, TO_CHARGER, CHARGING, EMPTY),
    EMPTY: (),
}
STATE = {  # of `core.robot_states` that the log has
    IDLE: robot_states.IDLE,
    TO_STOP: robot_states.WORKING,
    IN_SERVICE: robot_states.WORKING,
    TO_CHARGER: robot_states.CHARGING,
    CHARGING: robot_states.CHARGING,
    STALLED: robot_states.STALLED,
    BROKEN: robot_states.BROKEN,
    EMPTY: robot_states.EMPTY,
}


class Duties:
    """What R robots are at, from 0 s on: idle at first."""

    def __init__(self, num_robots: int) -> None:
        self.of = np.full(num_robots, IDLE)  # [R]
        self._rows: list[list[tuple[int, float, int]]] = [[(robot_states.IDLE, 0.0, NONE)] for _ in range(num_robots)]  # state, s, task

    def enter(self, robot: int, duty: int, at_s: float, task: int = NONE) -> None:
        """A robot is at something else from a time on; not before what it was at began.

        Parameters
        ----------
        task
            The one that it has then.
        """
        before = int(self.of[robot])
        assert duty in NEXT[before], f"{NAMES[before]} -> {NAMES[duty]}"
        self.of[robot] = duty
        if duty == LEAVING:  # for the planner's sake: nothing changes but what is asked
            return
        rows, state = self._rows[robot], STATE[duty]
        row = state, max(at_s, rows[-1][1]), task
        if rows[-1][1] == row[1]:
            rows.pop()
        if not rows or rows[-1][::2] != (state, task):
            rows.append(row)

    def are(self, *duties: int) -> BoolArray:
        """[R] robots that are at one of these."""
        are: BoolArray = _is_one_of(duties)[self.of]
        return are

    @property
    def changed_s(self) -> float:
        """When a robot last began to be at something else."""
        return max(rows[-1][1] for rows in self._rows)

    def log(self, end_s: float) -> RobotStateLog:
        """What they were at until now."""
        rows = [
            (r, state, begin_s, until_s, task)
            for r, mine in enumerate(self._rows)
            for (state, begin_s, task), until_s in zip(mine, [*(row[1] for row in mine[1:]), end_s])
            if until_s > begin_s or len(mine) == 1
        ]
        robot, state, begin_s, until_s, task = zip(*rows)
        return RobotStateLog(_whole(robot), _whole(state), frozen(np.array(begin_s)), frozen(np.array(until_s)), _whole(task))


@cache
def _is_one_of(duties: tuple[int, ...]) -> BoolArray:
    """[D] of all duties, which are some."""
    some = np.zeros(len(NAMES), np.bool_)
    some[list(duties)] = True
    return frozen(some)


def _whole(column: Sequence[int]) -> IntArray:
    return frozen(np.array(column, np.int64))
