"""Tasks: what robots are to do. A goal of MAPF is a task of one stop, released at 0, where the robot stays.

Refuses tasks without stops, and times that are no times.
"""

from dataclasses import dataclass, replace
from math import inf, isnan
from typing import Any

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, frozen
from mrp_sumo.errors import PlanError

ORDER, CHARGE = "order", "charge"  # kinds of tasks
NOBODY = -1  # a task that no robot has been given


@dataclass(frozen=True)
class Station:
    """A station, at which stops are made: places that serve one robot each, and places to wait for one."""

    name: str
    places: tuple[int, ...]  # vertices
    queue: tuple[int, ...] = ()  # vertices
    holds: int = 0  # loads that stay at each place until an order picks them up there; 0: they are taken away at once
    actions: tuple[str, ...] = ()  # of robots that are served there, see `core.handling`
    spans_s: tuple[tuple[float, float], ...] = ()  # of each day, in which services begin, see `core.shifts`; empty: always
    charges: bool = False  # whether robots charge while they are served
    service_factor: float = 1.0  # on the times of services there
    heading_rad: float | None = None  # in which vehicles that cannot turn in place are served; None: as they come

    def __post_init__(self) -> None:
        if not self.places:
            raise PlanError(f"station '{self.name}' has no places")


@dataclass(frozen=True)
class Stop:
    """A vertex, or a station with several, where a robot does something for a while."""

    vertex: int
    service_s: float = 0.0
    action: str = ""  # such as 'pickup', 'dropoff', 'charge'
    station: Station | None = None  # at one of whose places the stop is made instead

    @property
    def places(self) -> tuple[int, ...]:
        """Vertices at any of which it can be made."""
        return self.station.places if self.station else (self.vertex,)

    @property
    def queue(self) -> tuple[int, ...]:
        """Vertices to wait at for one of them."""
        return self.station.queue if self.station else ()

    def __post_init__(self) -> None:
        if not 0 <= self.service_s < inf:
            raise PlanError(f"a stop's service_s is {self.service_s}, expected a number of seconds from 0 up")


@dataclass(frozen=True)
class Task:
    """Stops to be made one after the other by one robot."""

    id: int
    stops: tuple[Stop, ...]
    release_s: float = 0.0  # when it becomes known
    due_s: float = inf
    priority: int = 0  # more is more urgent
    robot: int = NOBODY  # the only one that may do it; NOBODY: any may
    name: str = ""
    kind: str = ORDER  # or CHARGE, which the fleet makes for itself
    robot_type: str = ""  # the only one that can do it; '': any can
    load_kg: float = 0.0  # what it weighs

    def __post_init__(self) -> None:
        if not self.stops:
            raise PlanError(f"task {self.id} has no stops")
        if not 0 <= self.release_s < inf:
            raise PlanError(f"task {self.id}: release_s is {self.release_s}, expected a number of seconds from 0 up")
        if isnan(self.due_s):
            raise PlanError(f"task {self.id}: due_s is no time")

    @property
    def end(self) -> int:
        """The vertex of its last stop, where a robot without another task stays."""
        return self.stops[-1].vertex


RELEASED, ASSIGNED, PICKED, DONE, FAILED, CANCELLED, HANDED_OVER = TASK_STATES = (
    "released",  # it is known, and no robot has it
    "assigned",  # a robot has it, and has not come to its first stop
    "picked",  # its first stop was reached: from then on it is that robot's
    "done",  # the service of its last stop is over
    "failed",  # it will not be done
    "cancelled",  # the scenario's rule has withdrawn it
    "handed over",  # the robot that had picked it is lost, and another is to fetch its load
)


TASK_TIMES = ("released_s", "assigned_s", "opened_s", "done_s", "ended_s")  # of the log


@dataclass(frozen=True, eq=False)
class TaskLog:
    """The fate of K tasks of a run, by release. Times in s, NaN: not yet, or never."""

    name: tuple[str, ...]
    robot: IntArray  # [K] that has or had it, -1: none
    released_s: FloatArray
    assigned_s: FloatArray
    opened_s: FloatArray  # when its first stop was reached
    done_s: FloatArray  # when the service of its last stop was over
    ended_s: FloatArray  # when it was done, failed or cancelled
    status: tuple[str, ...]  # [K] of `TASK_STATES`, at the end of the run
    reason: tuple[str, ...]  # [K] why it failed, was cancelled or handed over, '' elsewhere
    kind: tuple[str, ...] = ()  # [K] ORDER or CHARGE; empty: all are orders

    @property
    def lead_time_s(self) -> FloatArray:
        """[K] from release to done."""
        return frozen(self.done_s - self.released_s)

    @property
    def is_order(self) -> BoolArray:
        """[K] whether somebody wants it done, rather than the fleet itself."""
        return frozen(np.array([kind == ORDER for kind in self.kind] or np.ones(len(self.name)), np.bool_))


@dataclass(frozen=True, eq=False)
class StopLog:
    """The S stops that were made in a run, by task and in the order in which each was made. Times in s."""

    task: IntArray  # [S] number in the `TaskLog`
    robot: IntArray  # [S]
    station: tuple[str, ...]  # [S] names
    vertex: IntArray  # [S] place of the station
    since_s: FloatArray  # [S] the robot was given the task, or was done with the stop before
    begin_s: FloatArray  # [S] of the service
    end_s: FloatArray  # [S] of the service, which may be after the run
    stood_s: FloatArray  # [S] for which it stood on the way there, for others or for what was closed; not while it gave way
    queued_s: FloatArray  # [S] for which it stood at a place to wait
    due_s: FloatArray  # [S] of the task, inf: never


def log_of_times(
    name: tuple[str, ...],
    robot: IntArray,
    released_s: FloatArray,
    assigned_s: FloatArray,
    opened_s: FloatArray,
    done_s: FloatArray,
    kind: tuple[str, ...] = (),
) -> TaskLog:
    """The log of K tasks of which none failed, was cancelled or handed over; see `TaskLog`."""
    reached = np.isfinite(assigned_s).astype(np.int64) + np.isfinite(opened_s) + np.isfinite(done_s)
    status = tuple(TASK_STATES[k] for k in reached.tolist())
    return TaskLog(name, robot, released_s, assigned_s, opened_s, done_s, done_s, status, ("",) * len(name), kind)


def some_tasks(tasks: TaskLog, wanted: BoolArray) -> TaskLog:
    """Those of wanted [K]."""
    rows = np.flatnonzero(wanted).tolist()
    arrays: dict[str, Any] = {key: frozen(getattr(tasks, key)[wanted]) for key in ("robot", *TASK_TIMES)}
    texts: dict[str, Any] = {
        key: tuple(column[k] for k in rows) for key in ("name", "status", "reason", "kind") if (column := getattr(tasks, key))
    }
    return replace(tasks, **arrays, **texts)


def orders_of(tasks: TaskLog, stops: StopLog | None) -> tuple[TaskLog, StopLog | None]:
    """The tasks that somebody wanted done, renumbered, and their stops."""
    wanted = tasks.is_order
    if wanted.all():
        return tasks, stops
    number, orders = np.cumsum(wanted) - 1, some_tasks(tasks, wanted)
    if stops is None:
        return orders, None
    rows = wanted[stops.task]
    station = tuple(name for name, keep in zip(stops.station, rows.tolist()) if keep)
    others = {key: frozen(getattr(stops, key)[rows]) for key in StopLog.__dataclass_fields__ if key not in ("station", "task")}
    return orders, replace(stops, task=frozen(number[stops.task[rows]]), station=station, **others)
