"""`tasks` of a scenario: stations, and the streams of tasks between them; listed, in a file, or drawn.

`tasks: [...]` is short for one list, `tasks: orders.csv` for one file.
"""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from mrp_sumo.core.order_rules import Cancel, Retry
from mrp_sumo.io.scenario.strict import Strict

MAX_TASKS = 1_000_000  # of a stream with an end
MAX_OPEN = 100_000
MAX_RATE_PER_H, MAX_PER_STEP = 1e6, 1e3
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Percent = Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)]


class StationChoice(Strict):
    """A place where stops are made."""

    places: list[str] = Field(min_length=1, description="Names of vertices; one robot at a time is served at each.")
    queue: list[str] = Field([], description="Names of vertices where robots wait for a place.")


class ServiceChoice(Strict):
    """Duration of a stop; a number is short for constant_s."""

    constant_s: NotNegative | None = Field(None, description="Always as long.")
    triangular_s: tuple[NotNegative, NotNegative, NotNegative] | None = Field(None, description="Least, usual and most.")
    lognormal: tuple[Positive, NotNegative] | None = Field(None, description="Median in s, and sigma of the logarithm.")

    @model_validator(mode="before")
    @classmethod
    def _short_form(cls, value: Any) -> Any:
        return {"constant_s": value} if isinstance(value, int | float) and not isinstance(value, bool) else value

    @model_validator(mode="after")
    def _one(self) -> "ServiceChoice":
        keys = [key for key in ("constant_s", "triangular_s", "lognormal") if getattr(self, key) is not None]
        if len(keys) != 1:
            raise ValueError(f"give one of constant_s, triangular_s, lognormal; found {', '.join(keys) or 'none'}")
        if self.triangular_s and not self.triangular_s[0] <= self.triangular_s[1] <= self.triangular_s[2]:
            raise ValueError(f"triangular_s is {list(self.triangular_s)}, expected least, usual and most in ascending order")
        return self


TaskTime = Annotated[float, Field(ge=0, le=1e9)]  # seconds: 30 years


class TaskChoice(Strict):
    """One task."""

    name: str = Field("", description="Of its own; made of its number by default.")
    stops: list[str] = Field(min_length=1, description="Names of stations or vertices.")
    release_s: TaskTime = Field(0.0, description="When it becomes known.")
    due_s: TaskTime | None = Field(None, description="When it is late.")
    priority: int = Field(0, description="More is more urgent.")
    service_s: TaskTime | list[TaskTime] = Field(0.0, description="At each stop, or one for each.")
    robot_type: str = Field("", description="The only type of robot that can do it; by default any can.")

    @model_validator(mode="after")
    def _a_time_for_each(self) -> "TaskChoice":
        if isinstance(self.service_s, list) and len(self.service_s) != len(self.stops):
            raise ValueError(f"service_s has {len(self.service_s)} times, but there are {len(self.stops)} stops")
        if self.due_s is not None and self.due_s < self.release_s:
            raise ValueError(f"due_s is {self.due_s:g}, before release_s, {self.release_s:g}")
        return self


class ArrivalsChoice(Strict):
    """Arrivals of tasks; exactly one kind."""

    rate_per_h: Annotated[Positive, Field(le=MAX_RATE_PER_H)] | None = Field(None, description="Poisson arrivals.")
    profile: list[NotNegative] = Field([], description="Of Poisson arrivals: factors on the rate in equal parts of a day.")
    open: Annotated[int, Field(ge=1, le=MAX_OPEN)] | None = Field(None, description="So many are always known and not done: a closed loop.")
    per_step: Annotated[Positive, Field(le=MAX_PER_STEP)] | None = Field(
        None, description="Tasks in a planned step; below 1 one with that probability."
    )
    at_once: bool = Field(False, description="All at 0; needs count.")

    @model_validator(mode="after")
    def _one(self) -> "ArrivalsChoice":
        keys = [key for key in ("rate_per_h", "open", "per_step") if getattr(self, key) is not None] + ["at_once"] * self.at_once
        if len(keys) != 1:
            raise ValueError(f"give one of rate_per_h, open, per_step, at_once; found {', '.join(keys) or 'none'}")
        if self.profile and (self.rate_per_h is None or max(self.profile) <= 0):
            raise ValueError("profile goes with rate_per_h, and needs a factor above 0")
        if self.per_step is not None and self.per_step > 1 and self.per_step != round(self.per_step):
            raise ValueError(f"per_step is {self.per_step:g}, expected a whole number, or one below 1")
        return self


class StreamChoice(Strict):
    """Tasks drawn with the scenario's seed: the same for every fleet."""

    name: str = Field("task", pattern=r"^[\w.+-]+$", description="Of the stream; its tasks are called name_0, name_1, ...")
    arrivals: ArrivalsChoice = Field(description="When tasks become known; exactly one kind.")
    count: Annotated[int, Field(ge=1, le=MAX_TASKS)] | None = Field(None, description="Tasks in all; without end by default.")
    stops: list[str] | None = Field(None, min_length=1, description="One of each of these groups, stations or vertices, in this order.")
    zipf: NotNegative = Field(0.0, description="Of groups: the k-th station is drawn with weight 1 / k ** zipf.")
    matrix: dict[str, dict[str, NotNegative]] | None = Field(
        None, description="Weights of ways between stations or groups, instead of stops."
    )
    service: list[ServiceChoice] = Field([], description="Of each stop; the last also of those after it. Nothing by default.")
    due_after_s: Positive | None = Field(None, description="After the release.")
    priority: int = Field(0, description="More is more urgent.")
    robot_type: str = Field("", description="The only type of robot that can do these tasks; by default any can.")

    @model_validator(mode="after")
    def _routes(self) -> "StreamChoice":
        if (self.stops is None) == (self.matrix is None):
            raise ValueError("give stops or matrix")
        if self.arrivals.at_once and self.count is None:
            raise ValueError("arrivals at_once need a count")
        return self


class ChargingChoice(Strict):
    """Charging of robots; levels in percent, with the names of a VDA 5050 factsheet."""

    stations: list[str] = Field(min_length=1, description="Names of groups, stations or vertices: a place each.")
    policy: Literal["threshold", "opportunity"] = Field(
        "threshold", description="'threshold': robots charge when they have to; 'opportunity': when they have nothing else to do, too."
    )
    critical_low_charging_level: Percent = Field(20.0, description="At or below it a robot without a load goes to charge.")
    minimum_desired_charging_level: Percent = Field(50.0, description="From it on 'opportunity' calls robots off when tasks wait.")
    maximum_desired_charging_level: Percent = Field(100.0, description="Charging ends.")
    minimum_charging_time_s: NotNegative = Field(0.0, description="For which a robot stays at least.")
    start_level: tuple[Percent, Percent] = Field((100.0, 100.0), description="Each robot's at the start, drawn evenly between these.")
    start_charging: Percent = Field(0.0, description="Share of the robots that go to charge first, whatever their level.")

    @model_validator(mode="after")
    def _ascending(self) -> "ChargingChoice":
        levels = [self.critical_low_charging_level, self.minimum_desired_charging_level, self.maximum_desired_charging_level]
        if not levels[0] < levels[2] or not levels[0] <= levels[1] <= levels[2]:
            raise ValueError(f"levels are {levels}, expected critical_low, minimum_desired and maximum_desired in ascending order")
        if self.policy == "opportunity" and levels[0] == levels[1]:  # who is called off would have to charge again at once
            raise ValueError(f"levels are {levels}, expected with policy opportunity a minimum_desired above critical_low")
        if self.start_level[0] > self.start_level[1]:
            raise ValueError(f"start_level is {list(self.start_level)}, expected the least and the most")
        return self


class TasksChoice(Strict):
    """Work that comes while robots drive."""

    stations: dict[str, StationChoice] = Field({}, description="By name; every vertex of the map is one, too.")
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
        description="So many tasks of all streams together are always known and not done, in the order of their arrival.",
    )
    charging: ChargingChoice | None = Field(None, description="Robots with a battery charge; without, theirs drain all the same.")
    parking: tuple[str, ...] = Field((), description="Groups, stations or vertices where robots without a task go.")
    cancel: Cancel | None = Field(None, description="When orders are withdrawn that no robot has picked up; never by default.")
    retry: Retry | None = Field(None, description="What becomes of orders whose robot is lost with them; they fail by default.")

    @model_validator(mode="before")
    @classmethod
    def _short_forms(cls, value: Any) -> Any:
        return {"list": value} if isinstance(value, list | tuple) else {"file": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _any(self) -> "TasksChoice":
        if not (self.list or self.file or self.streams):
            raise ValueError("no tasks: give list, file or streams")
        names = [stream.name for stream in self.streams if "name" in stream.model_fields_set]
        if (twice := next((name for n, name in enumerate(names) if name in names[:n]), None)) is not None:
            raise ValueError(f"two streams are called '{twice}', expected names of their own")
        return self
