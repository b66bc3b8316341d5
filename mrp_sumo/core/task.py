"""Tasks: what robots are to do. A goal of MAPF is a task of one stop, released at 0, where the robot stays.

Refuses tasks without stops, and times that are no times.
"""

from dataclasses import dataclass
from math import inf, isnan

from mrp_sumo.errors import PlanError

NOBODY = -1  # a task that no robot has been given


@dataclass(frozen=True)
class Stop:
    """A vertex where a robot does something for a while."""

    vertex: int
    service_s: float = 0.0
    action: str = ""  # such as 'pickup', 'dropoff', 'charge'

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
