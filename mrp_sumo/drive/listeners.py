"""Listeners of an execution: who is handed its moments, and may step in or end it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from tempfile import SpooledTemporaryFile
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.disturbances import Breakdown, ClosedLane
from mrp_sumo.core.execution import Event, GrantLog
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import FloatArray, IntArray, frozen
from mrp_sumo.core.task import Task
from mrp_sumo.drive.train import Trains

if TYPE_CHECKING:
    from mrp_sumo.drive.crew import Crew
    from mrp_sumo.drive.ledger import Ledger
    from mrp_sumo.drive.state import Facilities
    from mrp_sumo.engines.protocol import Engine

ROWS = 256  # samples are kept in blocks of this many
MOST_BLOCKS = 64  # until positions are worked out
HALF_OVER_M = 1e-9  # after the half of a ride, as driven, a robot is at the other stop
IN_MEMORY = 16_000_000  # bytes of each of the four columns, beyond which they are on the disk
COMPARE_EVERY_S = 10.0  # the engine's own positions are kept this often for the audit, and at the end
Intervention = Breakdown | ClosedLane | Task  # by somebody who watches
AtGoalReport = Callable[[float, int], None]  # simulated time in s, robots that are where their tasks end


class Moment(NamedTuple):
    """A time between two steps of the engine, when robots have been observed and granted what they may drive."""

    step: int
    now_s: float
    is_sample: bool  # whether it is recorded
    is_last: bool
    bodies: "Engine"
    ledger: "Ledger"
    events: Sequence[Event]  # what has happened since the moment before; some of it is known only when it is over
    crew: "Crew"  # robots and the tasks that are known
    facilities: "Facilities"  # lifts and doors as they are


class Listener:
    """Somebody who watches an execution, and may step in or end it. By itself it does neither: override what is of use."""

    is_patient = False  # content to hear of what happens, and else every ten simulated seconds: other steps may be taken together

    def hear(self, snapshot: Moment) -> None:
        """Take note of a step that has passed."""

    def interventions(self, now_s: float) -> Sequence[Intervention]:
        """Tasks and disturbances that come up now, before the next step."""
        return ()

    def wants_end(self) -> bool:
        """True if the execution is to end, with outcome INTERRUPTED; asked as often as it hears of a sample."""
        return False


class Recorder(Listener):
    """Keeps samples of every robot: x, y, yaw and speed, which go to files without a name where they are many.

    Positions follow from distances along the robots' ways, whenever the ledger is about to forget how those went, and at the end. Who
    rides in a lift stands at one stop of it until half of the ride is over, and then at the other.
    """

    def __init__(self, fleet: Fleet, *, levels: bool = False) -> None:
        """`levels`: keep the levels that robots are on, too."""
        self._blocks: list[FloatArray] = []  # [ROWS, 3, R] each: distance, yaw, speed
        self._count = 0  # of samples in them
        self._shape = 0, fleet.num_robots
        self._levels = levels
        self._trains = Trains(fleet)
        num_columns = 4 + levels + len(self._trains.columns)
        self._columns = tuple(SpooledTemporaryFile(max_size=IN_MEMORY) for _ in range(num_columns))  # noqa: SIM115 they are read at the end

    def hear(self, snapshot: Moment) -> None:
        if not snapshot.is_sample:
            return
        motion, row = snapshot.ledger.state.motion, self.room(snapshot.ledger)[0]
        row[0], row[1], row[2] = motion.s_m, motion.yaw_rad, motion.speed_mps
        self.add(1)

    def room(self, ledger: "Ledger") -> FloatArray:
        """[K, 3, R] for the next samples, at least one: distances, yaws and speeds, to be `add`ed when they have been filled in."""
        row = self._count % ROWS
        if row == 0 and len(self._blocks) * ROWS == self._count:
            if len(self._blocks) == MOST_BLOCKS:
                self.settle(ledger)
            self._blocks.append(np.empty((ROWS, 3, self._shape[1])))
        return self._blocks[-1][row:]

    def add(self, num_samples: int) -> None:
        """Keep as many samples more."""
        self._count += num_samples

    def settle(self, ledger: "Ledger") -> None:
        """Work out the positions of what has been heard so far."""
        num_samples, num_robots = self._shape
        s_m, yaw, speed = (
            np.concatenate([np.empty((0, num_robots)), *(block[:, k] for block in self._blocks)])[: self._count] for k in range(3)
        )
        x, y, level = np.empty_like(s_m), np.empty_like(s_m), np.empty_like(s_m)
        for r in range(num_robots):
            at_m, xy, on = way_of(ledger, r)
            level[:, r] = on[np.maximum(np.searchsorted(at_m, s_m[:, r], side="right") - 1, 0)] if self._levels else 0
            if r not in self._trains.of_robot:
                x[:, r], y[:, r] = (np.interp(s_m[:, r], at_m, xy[:, k]) for k in (0, 1))
        hitch = self._trains.place(ledger, s_m, x, y, yaw)
        columns = (x, y, wrapped(yaw), speed, *([level] if self._levels else []), *hitch.values())
        for file, column in zip(self._columns, columns):
            file.write(np.ascontiguousarray(column).data)
        self._shape = num_samples + self._count, num_robots
        self._blocks, self._count = [], 0

    def samples(self, ledger: "Ledger") -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray | None, dict[str, FloatArray]]:
        """x, y, yaw, speed and, where they are kept, levels, [T, R] each; and the angles of trailers by their columns."""
        self.settle(ledger)
        x, y, yaw, speed, *more = (_read(file, self._shape) for file in self._columns)
        level = more.pop(0).astype(np.int64) if self._levels else None
        return x, y, yaw, speed, level, dict(zip(self._trains.columns, more))

    def close(self) -> None:
        """Let go of the files; what has been read of them stays."""
        for file in self._columns:
            file.close()


def _read(file: "SpooledTemporaryFile[bytes]", shape: tuple[int, int]) -> FloatArray:
    """[T, R] what was written, read-only; the file's pages, where it is on the disk."""
    file.seek(0)
    if shape[0] * shape[1] * 8 <= IN_MEMORY:
        return np.frombuffer(file.read()).reshape(shape)
    file.rollover()
    return np.memmap(file, np.float64, "r", shape=shape).view(np.ndarray)


def way_of(ledger: "Ledger", robot: int) -> tuple[FloatArray, FloatArray, IntArray]:
    """[K] distances along a robot's way as far as the ledger knows it, ascending, [K, 2] where it is then, and [K] on which level.

    These are its visits, where it turned round on a lane, and where rides in lifts are half over.
    """
    graph, ids = ledger.graph, ledger.all_ids(robot)
    vertex, at_m = ledger.visits.vertex[ids], ledger.visits.at_m[ids]
    xy, level = graph.xy[vertex], graph.level[vertex]
    turns = [turn for turn in ledger.turn_backs if turn.robot == robot and turn.at_m >= at_m[0]]
    place = np.searchsorted(at_m, [turn.at_m for turn in turns])
    if graph.is_ride.any():
        xy, half = _at_stops(ledger, ids, xy, level)
        before, after = at_m[half - 1], at_m[half]
        place = np.concatenate([place, np.repeat(half, 2)])
        added_m = np.stack([(before + after) / 2, (before + after) / 2 + HALF_OVER_M], 1).ravel()
        added_xy = np.stack([xy[half - 1], xy[half]], 1).reshape(-1, 2)
        added_level = np.stack([level[half - 1], level[half]], 1).ravel()
    else:
        added_m, added_xy, added_level = np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.int64)
    if len(place):
        level = np.insert(level, place, np.concatenate([level[np.maximum(place[: len(turns)] - 1, 0)], added_level]))
        xy = np.insert(xy, place, np.concatenate([np.array([turn.xy for turn in turns]).reshape(-1, 2), added_xy]), axis=0)
        at_m = np.insert(at_m, place, np.concatenate([[turn.at_m for turn in turns], added_m]))
    return at_m, xy, level


def _at_stops(ledger: "Ledger", ids: IntArray, xy: FloatArray, level: IntArray) -> tuple[FloatArray, IntArray]:
    """[N, 2] where robots are at visits, who ride in lifts at the stops of these; and the visits to which levels change.

    A ride ends where robots can get out, and where one that is called back turns: it may ride again without leaving the cabin.
    """
    graph, vertex, lane = ledger.graph, ledger.visits.vertex[ids], ledger.visits.lane[ids]
    xy, riding = xy.copy(), (lane >= 0) & graph.is_ride[lane]
    leads_out = np.isin(vertex, graph.tail[~graph.is_ride])
    again = np.append(False, riding[:-1] & (leads_out[:-1] | (lane[1:] == graph.reverse[lane[:-1]])))
    begins = np.flatnonzero(riding & (again | ~np.append(False, riding[:-1])))
    ends = np.flatnonzero(riding & np.append((again | ~riding)[1:], True)) + 1
    for begin, end in zip(begins.tolist(), ends.tolist()):
        before, last = max(begin - 1, 0), end - 1
        there = level[begin:last] == level[last]
        xy[begin:last] = np.where(there[:, None], xy[last], xy[before])
    return xy, np.flatnonzero(riding[1:] & (level[1:] != level[:-1])) + 1


@dataclass
class EventLog(Listener):
    """Keeps what happens."""

    events: list[Event] = field(default_factory=list)

    def hear(self, snapshot: Moment) -> None:
        self.events += snapshot.events


class GrantRecorder(Listener):
    """Keeps when robots are granted more of their ways."""

    def __init__(self, num_robots: int) -> None:
        self.known = np.full(num_robots, -1, np.int64)  # twice the rank of the last visit granted, one more where its next lane is entered
        self._rows: list[tuple[FloatArray, IntArray, IntArray]] = []

    def hear(self, snapshot: Moment) -> None:
        visits = snapshot.ledger.visits
        granted = 2 * visits.rank[visits.granted] + snapshot.ledger.state.grants.on_lane
        more = np.flatnonzero(granted != self.known)
        if len(more):
            self.add(np.full(len(more), snapshot.now_s), more, granted[more])
            self.known[more] = granted[more]

    def add(self, t_s: FloatArray, robot: IntArray, granted: IntArray) -> None:
        """Keep some more: times, robots, and what they were granted then, as in `known`."""
        self._rows.append((t_s, robot, granted))

    def log(self) -> GrantLog:
        t_s = np.concatenate([np.zeros(0), *(row[0] for row in self._rows)])
        none = [np.zeros(0, np.int64)]
        robot, granted = (np.concatenate([row[k] for row in self._rows] or none) for k in (1, 2))
        return GrantLog(frozen(t_s.astype(np.float64)), frozen(robot), frozen(granted // 2), frozen(granted % 2 == 1))


@dataclass
class Witness(Listener):
    """Asks the engine now and then where it has the robots, for the audit."""

    t_s: list[float] = field(default_factory=list)
    xy_m: list[FloatArray] = field(default_factory=list)  # [R, 2] each, NaN in lifts

    @property
    def due_s(self) -> float:
        """The time of the next sample that is compared, at the earliest."""
        return len(self.t_s) * COMPARE_EVERY_S

    def hear(self, snapshot: Moment) -> None:
        if snapshot.is_sample and (snapshot.is_last or snapshot.now_s >= self.due_s):
            visits, graph = snapshot.ledger.visits, snapshot.ledger.graph
            xy_m = snapshot.bodies.positions()
            if graph.is_ride.any():
                ahead = visits.next[visits.reached]
                for lane in (np.where(ahead >= 0, visits.lane[ahead], -1), visits.lane[visits.reached]):  # of who stands just before a stop
                    xy_m[(lane >= 0) & graph.is_ride[lane]] = np.nan
            xy_m[snapshot.ledger.is_vehicle] = np.nan  # which cut corners that the network has
            self.t_s.append(snapshot.now_s)
            self.xy_m.append(xy_m)


@dataclass
class ProgressReport(Listener):
    """Reports about once a simulated second, less often while nothing happens."""

    report: AtGoalReport
    due_s: float = 1.0
    is_patient = True

    def hear(self, snapshot: Moment) -> None:
        if snapshot.now_s >= self.due_s and not snapshot.is_last:
            self.due_s = math.floor(snapshot.now_s) + 1.0
            self.report(snapshot.now_s, int(np.isfinite(snapshot.ledger.state.waits.goal_s).sum()))
