"""The work of one robot in a run with tasks: what it has, what it is at, and the log of it.

What it is at changes by the table `Change` alone. Its duty is what its task has it do. Its condition is what befalls it: a robot that has
been mended goes on with its duty, and so does one that has been stalled.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, StrEnum
from typing import NamedTuple

import numpy as np

from mrp_sumo.core import robot_states
from mrp_sumo.core.graph import IntArray, frozen
from mrp_sumo.core.robot_states import RobotStateLog
from mrp_sumo.core.task import StopLog

NONE = -1  # no task, no vertex


class Duty(StrEnum):
    """Part of its task that a robot is at."""

    IDLE = "idle"
    DRIVING = "driving"  # to a stop or to a charger
    WAITING = "waiting"  # in line for a place of its stop
    IN_SERVICE = "in service"
    CHARGING = "charging"


class Condition(StrEnum):
    """State of a robot itself, whatever its task."""

    SOUND = "sound"
    STALLED = "stalled"  # it does not get on, for nothing that the work itself asks for
    BROKEN = "broken"  # for a while
    TOWED = "towed"  # broken, too, and pushed out of the way of others
    LOST = "lost"  # broken for good
    EMPTY = "empty"  # for good, too


OUT = (Condition.BROKEN, Condition.LOST, Condition.EMPTY)
GONE = (Condition.LOST, Condition.EMPTY)


class Rule(NamedTuple):
    """A change of what a robot is at; only from the duties and the conditions that it names, where it names some."""

    when: str
    duty: Mapping[Duty, Duty] | None = None
    condition: Mapping[Condition, Condition] | None = None


_UNHARMED = {Condition.SOUND: Condition.SOUND, Condition.STALLED: Condition.SOUND}
_ON_THE_ROAD = (Duty.DRIVING, Duty.WAITING)


class Change(Enum):
    """All changes that there are."""

    GIVEN = Rule("it is given an order, or has to charge", {Duty.IDLE: Duty.DRIVING}, {Condition.SOUND: Condition.SOUND})
    LINED_UP = Rule("it waits for a place of its stop, as near as it was sent", {Duty.DRIVING: Duty.WAITING})
    SERVED = Rule("its service begins", dict.fromkeys(_ON_THE_ROAD, Duty.IN_SERVICE), _UNHARMED)
    PLUGGED_IN = Rule("its charging begins", dict.fromkeys(_ON_THE_ROAD, Duty.CHARGING), _UNHARMED)
    ONWARD = Rule("a stop is made, and its order has another", dict.fromkeys((*_ON_THE_ROAD, Duty.IN_SERVICE), Duty.DRIVING), _UNHARMED)
    FREED = Rule("its task is done, or is taken from it", dict.fromkeys(tuple(Duty)[1:], Duty.IDLE), _UNHARMED)
    STALLS = Rule("it has made no progress for a minute", None, {Condition.SOUND: Condition.STALLED})
    GETS_ON = Rule("it makes progress again", None, {Condition.STALLED: Condition.SOUND})
    BREAKS = Rule("it breaks down for a while", None, dict.fromkeys(_UNHARMED, Condition.BROKEN))
    TOWED = Rule("it is broken, and pushed from now on", None, {Condition.BROKEN: Condition.TOWED})
    MENDED = Rule("its breakdown is over", None, dict.fromkeys((Condition.BROKEN, Condition.TOWED), Condition.SOUND))
    LOST = Rule(
        "it breaks down for good",
        dict.fromkeys(Duty, Duty.IDLE),
        dict.fromkeys((*_UNHARMED, Condition.BROKEN, Condition.TOWED), Condition.LOST),
    )
    EMPTIED = Rule("its battery runs empty", dict.fromkeys(Duty, Duty.IDLE), dict.fromkeys(tuple(Condition)[:-1], Condition.EMPTY))


LOGGED = {  # of `core.robot_states`, where the condition says it all
    Condition.STALLED: robot_states.STALLED,
    Condition.BROKEN: robot_states.BROKEN,
    Condition.TOWED: robot_states.BROKEN,
    Condition.LOST: robot_states.BROKEN,
    Condition.EMPTY: robot_states.EMPTY,
}


class Leg(NamedTuple):
    """A stop to which the way of a robot leads."""

    task: int
    nth: int  # of the task's stops
    vertex: int


TourStop = tuple[int, int]  # a task, and which of its stops


class StopRow(NamedTuple):
    """A row of the `StopLog`."""

    task: int
    robot: int
    station: str
    vertex: int
    since_s: float
    begin_s: float
    end_s: float
    stood_s: float
    queued_s: float
    due_s: float


@dataclass(slots=True)
class RobotWork:
    """A robot, its task, and how far it is with it: idle at first."""

    number: int
    duty: Duty = Duty.IDLE
    condition: Condition = Condition.SOUND
    leaves: bool = False  # whether what comes next is asked for: its stop will be over when the answer takes effect
    tour: list[TourStop] = field(default_factory=list)  # stops ahead, of one order or of several; the first may be being made
    charges: bool = False  # whether its task is the fleet's own, to charge
    then: int = NONE  # the task that it goes on with, whose way begins where this one's last stop is
    legs: list[Leg] = field(default_factory=list)  # stops that its way leads to, in their order
    wait_at: int = NONE  # vertex where it is to wait for a place
    came_s: float = np.inf  # since when it has waited as near as there
    num_before: int = 0  # who set out for the same stop later, with orders no more urgent, and were served
    making: StopRow | None = None  # the stop that it is at
    made: list[StopRow] = field(default_factory=list)  # those before
    over_s: float = -np.inf  # when the last of them was over
    since_s: float = 0.0  # when it was given the task, or was done with the stop before
    earliest_s: float = 0.0  # before which the next stop cannot begin
    moved_s: float = 0.0  # when it last got on, or stood for the work's sake
    loads: int = 0  # on board
    is_called: bool = False  # whether it is to be maintained, and is given no more orders before
    idle_s: tuple[float, float] = (0.0, 0.0)  # that it had stood on its way, and where it was sent, when it set out
    _rows: list[tuple[int, float, int]] = field(default_factory=lambda: [(robot_states.IDLE, 0.0, NONE)])  # state, since, task

    @property
    def task(self) -> int:
        """The task of its next stop, or of the one that it makes; NONE without any."""
        return self.tour[0][0] if self.tour else NONE

    @property
    def stop(self) -> int:
        """Number of that stop in its task."""
        return self.tour[0][1] if self.tour else 0

    @property
    def orders(self) -> list[int]:
        """Tasks that it has, by their next stops."""
        return list(dict.fromkeys(task for task, _ in self.tour))

    @property
    def is_out(self) -> bool:
        """True if it is broken for a while, lost or empty."""
        return self.condition in OUT

    @property
    def is_broken(self) -> bool:
        """True if it is broken for a while, be it in the way or pushed out of it."""
        return self.condition in (Condition.BROKEN, Condition.TOWED)

    @property
    def is_down(self) -> bool:
        """True if it is broken or gone."""
        return self.is_broken or self.is_gone

    @property
    def is_at_order(self) -> bool:
        """True if it is sound and has an order."""
        return self.task != NONE and not self.charges and not self.is_down

    @property
    def is_free(self) -> bool:
        """True if it can be given a task."""
        return self.duty is Duty.IDLE and self.condition is Condition.SOUND and not self.is_called

    @property
    def is_gone(self) -> bool:
        """True if it is lost or empty."""
        return self.condition in GONE

    @property
    def is_on_the_road(self) -> bool:
        """True if it drives to a stop or waits for a place there, and what comes after that has not been asked for."""
        return self.duty in _ON_THE_ROAD and not self.leaves

    @property
    def is_busy(self) -> bool:
        """True if it is at a stop or at a charger, and still will be when what is asked for now takes effect."""
        return self.making is not None and not self.leaves

    @property
    def is_charging(self) -> bool:
        """True if it is being charged."""
        return self.charges and self.making is not None and not self.is_out

    @property
    def in_line_since_s(self) -> float:
        """Since when it has waited for a place; inf: it does not."""
        return self.came_s if self.duty is Duty.WAITING else np.inf

    @property
    def changed_s(self) -> float:
        """Time at which it last began to be at something else."""
        return self._rows[-1][1]

    def on(self, change: Change, at_s: float) -> None:
        """It is at something else from a time on; not before what it was at began."""
        _, duty, condition = change.value
        assert duty is None or self.duty in duty, f"{change.name}: {self.duty}"
        assert condition is None or self.condition in condition, f"{change.name}: {self.condition}"
        self.duty = duty[self.duty] if duty else self.duty
        self.condition = condition[self.condition] if condition else self.condition
        self.leaves &= change is Change.LINED_UP
        rows, state = self._rows, self._logged()
        row = state, max(at_s, rows[-1][1]), NONE if self.charges else self.task
        if rows[-1][1] == row[1]:
            rows.pop()
        if not rows or rows[-1][::2] != row[::2]:
            rows.append(row)

    def begin(self, tour: Sequence[TourStop], since_s: float, earliest_s: float, idle_s: tuple[float, float], *, charges: bool) -> None:
        """It has a task, or several."""
        self.tour, self.charges, self.since_s, self.idle_s = list(tour), charges, since_s, idle_s
        self.earliest_s = self.moved_s = earliest_s
        self.wait_at, self.num_before = NONE, 0
        self.on(Change.GIVEN, earliest_s)

    def drop(self, change: Change, at_s: float) -> None:
        """It has no task any more."""
        self.tour, self.charges = [], False
        self.on(change, at_s)

    def _logged(self) -> int:
        by_duty = robot_states.IDLE if self.duty is Duty.IDLE else robot_states.CHARGING if self.charges else robot_states.WORKING
        return LOGGED.get(self.condition, by_duty)


def state_log(robots: Sequence[RobotWork], end_s: float) -> RobotStateLog:
    """Intervals in which robots were at the same, until now."""
    rows = [
        (robot.number, state, begin_s, until_s, task)
        for robot in robots
        for (state, begin_s, task), until_s in zip(robot._rows, [*(row[1] for row in robot._rows[1:]), end_s])
        if until_s > begin_s or len(robot._rows) == 1
    ]
    number, state, begin_s, until_s, task = zip(*rows)
    return RobotStateLog(_whole(number), _whole(state), frozen(np.array(begin_s)), frozen(np.array(until_s)), _whole(task))


def stop_log(robots: Sequence[RobotWork]) -> StopLog:
    """The stops that robots have made or are making, by task."""
    rows = sorted(
        (row for robot in robots for row in (*robot.made, robot.making) if row is not None), key=lambda row: (row.task, row.begin_s)
    )
    task, number, station, vertex, *times = zip(*rows) if rows else [()] * len(StopRow._fields)
    times_s = [frozen(np.array(column, np.float64)) for column in times]
    return StopLog(_whole(task), _whole(number), station, _whole(vertex), *times_s)


def _whole(column: Sequence[int]) -> IntArray:
    return frozen(np.array(column, np.int64))
