"""`tasks` of a scenario: stations, and the streams of tasks between them; listed, in a file, or drawn.

`tasks: [...]` is short for one list, `tasks: orders.csv` for one file.
"""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from mrp_sumo.core.arrivals import MAX_OPEN, Arrivals, ServiceTime
from mrp_sumo.core.battery import Charging
from mrp_sumo.core.order_rules import Cancel, Retry
from mrp_sumo.core.shifts import Shift
from mrp_sumo.io.scenario.strict import Strict

MAX_TASKS = 1_000_000  # of a stream with an end
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


def _service_of_a_number(value: Any) -> Any:
    """A number is short for a constant time."""
    return {"constant_s": value} if isinstance(value, int | float) and not isinstance(value, bool) else value


Service = Annotated[ServiceTime, BeforeValidator(_service_of_a_number)]


class StationChoice(Strict):
    """A place where stops are made."""

    places: list[str] = Field(min_length=1, description="Names of vertices; one robot at a time is served at each.")
    queue: list[str] = Field([], description="Names of vertices where robots wait for a place.")
    holds: Annotated[int, Field(ge=0, le=1000)] = Field(
        0,
        description="Loads that stay where they are set down, and take a place, until orders pick them up there; 0: they are taken away.",
    )
    actions: list[Literal["lift", "dock"]] = Field(
        [], description="What robots do at each stop there, for as long as their type says (`robots.type.actions`)."
    )
    shifts: list[Shift] = Field(
        [], description="Shifts of the people there: services begin only within, and end also after; always by default."
    )
    charges: bool = Field(False, description="Whether robots charge while they are served there.")
    heading_deg: Annotated[float, Field(ge=-360, le=360)] | None = Field(
        None,
        description="Heading in which vehicles that cannot turn in place are served, counter-clockwise from +x; any by default.",
    )


TaskTime = Annotated[float, Field(ge=0, le=1e9)]  # seconds: 30 years


class TaskChoice(Strict):
    """One task."""

    name: str = Field("", description="Unique name; made of its number by default.")
    stops: list[str] = Field(min_length=1, description="Names of stations or vertices.")
    release_s: TaskTime = Field(0.0, description="When it becomes known.")
    due_s: TaskTime | None = Field(None, description="When it is late.")
    priority: int = Field(0, description="More is more urgent.")
    service_s: TaskTime | list[TaskTime] = Field(0.0, description="Service time at every stop, or a list with one for each.")
    robot_type: str = Field("", description="The only type of robot that can do it; by default any can.")
    load_kg: Annotated[float, Field(ge=0, le=1e6)] = Field(0.0, description="Weight; only types that can carry it do it (`max_load_kg`).")
    robot: str = Field("", description="Name of the only robot that may do it, such as robot_0; by default any may.")

    @model_validator(mode="after")
    def _a_time_for_each(self) -> "TaskChoice":
        if isinstance(self.service_s, list) and len(self.service_s) != len(self.stops):
            raise ValueError(f"service_s has {len(self.service_s)} times, but there are {len(self.stops)} stops")
        if self.due_s is not None and self.due_s < self.release_s:
            raise ValueError(f"due_s is {self.due_s:g}, before release_s, {self.release_s:g}")
        return self


class StreamChoice(Strict):
    """Tasks drawn with the scenario's seed: the same for every fleet."""

    name: str = Field("task", pattern=r"^[\w.+-]+$", description="Its orders are called name_0, name_1, ...")
    arrivals: Arrivals = Field(description="When orders become known; exactly one kind.")
    count: Annotated[int, Field(ge=1, le=MAX_TASKS)] | None = Field(None, description="Tasks in all; without end by default.")
    stops: list[str] | None = Field(None, min_length=1, description="One of each of these groups, stations or vertices, in this order.")
    zipf: NotNegative = Field(0.0, le=10, description="In groups, the k-th station is drawn with weight 1 / k ** zipf.")
    matrix: dict[str, dict[str, NotNegative]] | None = Field(
        None, description="Weights of ways between stations or groups, instead of stops."
    )
    service: tuple[Service, ...] = Field(
        (), description="Service time of each stop; the last one holds for further stops, too. None by default."
    )
    due_after_s: Positive | None = Field(None, description="Due so long after the release.")
    priority: int = Field(0, description="More is more urgent.")
    robot_type: str = Field("", description="The only type of robot that can do these orders; by default any can.")
    load_kg: Annotated[float, Field(ge=0, le=1e6)] = Field(0.0, description="Weight of each, as tasks.list[].load_kg.")
    robot: str = Field("", description="Name of the only robot that may do these orders; by default any may.")

    @model_validator(mode="after")
    def _routes(self) -> "StreamChoice":
        if (self.stops is None) == (self.matrix is None):
            raise ValueError("give stops or matrix")
        if self.arrivals.at_once and self.count is None:
            raise ValueError("arrivals at_once need a count")
        return self


class TasksChoice(Strict):
    """Work that comes while robots drive."""

    stations: dict[str, StationChoice] = Field({}, description="Stations by name; every vertex of the map is one, too.")
    groups: dict[str, list[str]] = Field({}, description="Names of stations or vertices by the group's name.")
    list: tuple[TaskChoice, ...] = Field((), description="Tasks one by one.")
    file: str | None = Field(
        None,
        description="CSV with the columns release_s, stops (parted by blanks) and more of a task's keys; YAML with a list `tasks`; "
        "JSON with task requests of Open-RMF; or .tasks of the League of Robot Runners, for a MovingAI map.",
    )
    streams: tuple[StreamChoice, ...] = Field((), description="Tasks drawn with the scenario's seed: the same for every fleet.")
    open: Annotated[int, Field(ge=1, le=MAX_OPEN)] | None = Field(
        None,
        description="Number of orders, of all streams together, that are always known and not done, in the order of their arrival.",
    )
    profile: tuple[NotNegative, ...] = Field(
        (), description="Factors on the rates of all Poisson streams without a profile of their own, in equal parts of a day: 24 are hours."
    )
    charging: Charging | None = Field(None, description="How robots charge; without it their batteries drain all the same.")
    service_factor: dict[str, Positive] = Field(
        {}, description="Factors on the service times at stations, groups or vertices, by name; a station has those of its groups, too."
    )
    parking: tuple[str, ...] = Field((), description="Groups, stations or vertices where robots without an order go.")
    cancel: Cancel | None = Field(None, description="When to withdraw orders that no robot has picked up; never by default.")
    retry: Retry | None = Field(None, description="What becomes of orders whose robot is lost with them; they fail by default.")

    @property
    def group_of(self) -> dict[str, str]:
        """The first group of each station or vertex that is in some."""
        return {member: group for group, members in reversed(self.groups.items()) for member in members}

    @model_validator(mode="before")
    @classmethod
    def _short_forms(cls, value: Any) -> Any:
        return {"list": value} if isinstance(value, list | tuple) else {"file": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _any(self) -> "TasksChoice":
        if not (self.list or self.file or self.streams):
            raise ValueError("no tasks: give list, file or streams")
        if self.profile and (max(self.profile) <= 0 or not any(stream.arrivals.rate_per_h for stream in self.streams)):
            raise ValueError("profile goes with a stream with rate_per_h, and needs a factor above 0")
        names = [stream.name for stream in self.streams if "name" in stream.model_fields_set]
        if (twice := next((name for n, name in enumerate(names) if name in names[:n]), None)) is not None:
            raise ValueError(f"two streams are called '{twice}', expected names of their own")
        return self
