"""What listens to an execution: each listener is handed every moment, and changes nothing."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from mrp_sumo.core.execution import Event
from mrp_sumo.core.graph import FloatArray
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.engines.protocol import Engine

ROWS = 256  # samples are kept in blocks of this many
COMPARE_EVERY_S = 10.0  # the engine's own positions are kept this often for the audit, and at the end
AtGoalReport = Callable[[float, int], None]  # simulated time in s, robots that are where their tasks end


class Moment(NamedTuple):
    """A time between two steps of the engine, when robots have been observed and granted what they may drive."""

    step: int
    now_s: float
    is_sample: bool  # whether it is recorded
    is_last: bool
    bodies: Engine
    ledger: Ledger
    events: Sequence[Event]  # what has happened since the moment before; some of it is known only when it is over


class Listener(Protocol):
    """Anything that wants to know."""

    def hear(self, moment: Moment) -> None:
        """A step has passed."""


@dataclass
class Recorder:
    """Keeps samples of every robot. Positions follow from distances along the robots' ways at the end."""

    _blocks: list[FloatArray] = field(default_factory=list)  # [ROWS, 3, R]: distance, yaw, speed
    _count: int = 0

    def hear(self, moment: Moment) -> None:
        """See Listener."""
        if not moment.is_sample:
            return
        row, motion = self._count % ROWS, moment.ledger.state.motion
        if row == 0:
            self._blocks.append(np.empty((ROWS, 3, len(motion.s_m))))
        block = self._blocks[-1][row]
        block[0], block[1], block[2] = motion.s_m, motion.yaw_rad, motion.speed_mps
        self._count += 1

    def samples(self, ledger: Ledger) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """x, y, yaw and speed, [T, R] each."""
        s_m, yaw, speed = (np.concatenate([block[:, k] for block in self._blocks])[: self._count] for k in range(3))
        x, y = np.empty_like(s_m), np.empty_like(s_m)
        for r in range(s_m.shape[1]):
            at_m, xy = way_of(ledger, r)
            x[:, r] = np.interp(s_m[:, r], at_m, xy[:, 0])
            y[:, r] = np.interp(s_m[:, r], at_m, xy[:, 1])
        return x, y, yaw, speed


def way_of(ledger: Ledger, robot: int) -> tuple[FloatArray, FloatArray]:
    """[K] distances along a robot's way, ascending, and [K, 2] where it is then: its visits, and where it turned round on a lane."""
    ids = ledger.all_ids(robot)
    at_m, xy = ledger.column("at_m")[ids], ledger.graph.xy[ledger.column("vertex")[ids]]
    turns = [turn for turn in ledger.turn_backs if turn.robot == robot]
    place = np.searchsorted(at_m, [turn.at_m for turn in turns])
    if turns:
        xy = np.insert(xy, place, np.array([turn.xy for turn in turns]), axis=0)
        at_m = np.insert(at_m, place, [turn.at_m for turn in turns])
    return at_m, xy


@dataclass
class EventLog:
    """Keeps what happens."""

    events: list[Event] = field(default_factory=list)

    def hear(self, moment: Moment) -> None:
        """See Listener."""
        self.events += moment.events


@dataclass
class Witness:
    """Asks the engine now and then where it has the robots, for the audit."""

    t_s: list[float] = field(default_factory=list)
    xy_m: list[FloatArray] = field(default_factory=list)  # [R, 2] each

    def hear(self, moment: Moment) -> None:
        """See Listener."""
        if moment.is_sample and (moment.is_last or moment.now_s >= len(self.t_s) * COMPARE_EVERY_S):
            self.t_s.append(moment.now_s)
            self.xy_m.append(moment.bodies.positions())


@dataclass(frozen=True)
class ProgressReport:
    """Reports once a simulated second."""

    report: AtGoalReport
    every: int  # steps

    def hear(self, moment: Moment) -> None:
        """See Listener."""
        if moment.step and moment.step % self.every == 0 and not moment.is_last:
            self.report(moment.now_s, int(np.isfinite(moment.ledger.state.waits.goal_s).sum()))
