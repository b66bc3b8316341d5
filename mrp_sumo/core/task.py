"""Tasks: what robots are to do. A goal of MAPF is a task of one stop, released at 0, where the robot stays.

Refuses tasks without stops, and times that are no times.
"""

from dataclasses import dataclass, replace
from math import inf, isnan

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, frozen
from mrp_sumo.errors import PlanError

ORDER, CHARGE = "order", "charge"  # kinds of tasks
NOBODY = -1  # a task that no robot has been given


@dataclass(frozen=True)
class Station:
    """Where stops are made: places that serve one robot each, and places to wait for one."""

    name: str
    places: tuple[int, ...]  # vertices
    queue: tuple[int, ...] = ()  # vertices

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
    robot: int = NOBODY
    name: str = ""
    kind: str = ORDER  # or CHARGE, which the fleet makes for itself
    robot_type: str = ""  # the only one that can do it; '': any can

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


TASK_STATES = ("revealed", "assigned", "open", "done")


@dataclass(frozen=True, eq=False)
class TaskLog:
    """What became of K tasks of a run, by release. Times in s, NaN: not yet."""

    name: tuple[str, ...]
    robot: IntArray  # [K] that has or had it, -1: none
    released_s: FloatArray
    assigned_s: FloatArray
    opened_s: FloatArray  # when its first stop was reached: from then on it is that robot's
    done_s: FloatArray  # when the service of its last stop was over
    kind: tuple[str, ...] = ()  # [K] ORDER or CHARGE; empty: all are orders

    @property
    def state(self) -> tuple[str, ...]:
        """[K] of `TASK_STATES`."""
        reached = np.isfinite(self.assigned_s).astype(np.int64) + np.isfinite(self.opened_s) + np.isfinite(self.done_s)
        return tuple(TASK_STATES[k] for k in reached.tolist())

    @property
    def service_time_s(self) -> FloatArray:
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
    stood_s: FloatArray  # [S] for which it stood on the way there, for others or for what was closed
    queued_s: FloatArray  # [S] for which it stood at a place to wait
    due_s: FloatArray  # [S] of the task, inf: never


def some_tasks(tasks: TaskLog, wanted: BoolArray) -> TaskLog:
    """Those of wanted [K]."""
    kept = np.flatnonzero(wanted).tolist()
    names, kinds = tuple(tasks.name[k] for k in kept), tuple(tasks.kind[k] for k in kept) if tasks.kind else ()
    released_s, assigned_s = frozen(tasks.released_s[wanted]), frozen(tasks.assigned_s[wanted])
    return TaskLog(
        names, frozen(tasks.robot[wanted]), released_s, assigned_s, frozen(tasks.opened_s[wanted]), frozen(tasks.done_s[wanted]), kinds
    )


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
