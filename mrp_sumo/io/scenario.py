"""Scenario files: everything one run needs, as YAML.

The models below are the format; `mrp-sumo schema` prints their JSON schema. Unknown keys, values of
the wrong kind and figures out of range are refused, each in one line with its line number. What only
the map can tell (names of vertices, robots that fit) is checked when the run is set up.
"""

import difflib
import os
import shlex
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)

from mrp_sumo.core.battery import Battery
from mrp_sumo.core.fleet import RobotType
from mrp_sumo.errors import MrpSumoError, PlugInError, ScenarioError, nearest
from mrp_sumo.files.names import fault_of_folder
from mrp_sumo.files.reading import require_regular, shortened
from mrp_sumo.io.columns import MAIN_KEYS, put
from mrp_sumo.io.documents import Document, Place, read_document, validated
from mrp_sumo.io.people import PeopleChoice
from mrp_sumo.io.tasks import TasksChoice
from mrp_sumo.maps.catalogue import bundled_folder
from mrp_sumo.plugins.source import program_of
from mrp_sumo.plugins.trust import Program, in_trusted_folder, is_trusted, trust

Positive = Annotated[float, Field(gt=0, le=1e9, allow_inf_nan=False)]
OfRobot = Annotated[float, Field(ge=1e-4, le=1e3, allow_inf_nan=False)]  # sizes and speeds, generously
OfBattery = Annotated[float, Field(ge=1e-5, le=1e5, allow_inf_nan=False)]  # and of what it weighs
Heading = Annotated[float, Field(ge=-360, le=360, allow_inf_nan=False)]
GraphIndex = Annotated[int, Field(ge=0, le=9)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True, allow_inf_nan=False)


class FurnitureChoice(_Strict):
    """The size of a model that stands in a building."""

    model: str = Field(description="The `model_name` in the building file.")
    length_m: OfRobot = Field(description="Along the model's x.")
    width_m: OfRobot


class MapChoice(_Strict):
    """Which part of which map."""

    file: str = Field(description="A map file, relative to the scenario, or the name of a bundled map.")
    reader: str | None = Field(None, description="A map reader by name, or FILE.py:CLASS; by default the one that recognises the file.")
    level: str | None = Field(None, description="Only this level; all levels by default.")
    graph: GraphIndex | tuple[GraphIndex, ...] | Literal["all"] | None = Field(
        None, description="Nav graph index; several, or 'all', are united. The lowest with lanes by default."
    )
    meters_per_pixel: Positive | None = Field(None, description="Scale of a building without measurements.")
    vehicle_type: str | None = Field(
        None, description="Only the lanes for this type of vehicle, where the map knows types; all by default."
    )
    furniture: tuple[FurnitureChoice, ...] = Field(
        (), description="Sizes of models in a building file, which are walls then; by default models have no effect."
    )
    snap_m: Positive | None = Field(None, description="Repair: join lane ends that lie this close to a vertex or lane they are not on.")
    split_crossings: bool = Field(False, description="Repair: put a vertex where lanes cross without one.")
    join_short_m: Positive | None = Field(
        None, description="Repair: join the ends of lanes shorter than this, where one end has no name and no properties."
    )
    largest_component: bool = Field(False, description="Repair: keep the largest connected piece only.")

    @field_validator("graph", mode="before")
    @classmethod
    def _one_or_several(cls, found: Any) -> Any:
        several = found if isinstance(found, list | tuple) and found else [found]
        if found not in (None, "all") and not all(type(number) is int and 0 <= number <= 9 for number in several):
            raise ValueError(f"found {found!r}, expected a number from 0 to 9, a list of them, or 'all'")
        return found


class Discretisation(_Strict):
    """How the nav graph becomes a graph of unit steps."""

    kind: Literal["grid", "roadmap"] = Field(
        "grid", description="'grid': the occupancy grid of the MRP-Bench paper, lanes two cells wide; 'roadmap': lanes cut into steps."
    )
    cell_m: Positive = Field(0.4, description="Length of a step.")
    lanes: Literal["single_track", "two_way"] = Field(
        "single_track", description="Of a roadmap: can robots meet on a bidirectional lane? On a grid they can, lanes are two cells wide."
    )
    doubled: tuple[tuple[str, str], ...] = Field(
        (), description="Of a roadmap: along the shortest way between two vertices robots can meet, as with two_way everywhere."
    )
    clearance: Literal["refuse", "prune", "ignore"] = Field(
        "ignore",
        description="What to do with lanes and cells where walls leave the robots no room: 'refuse' the scenario, 'prune': leave them out. "
        "A run that touches a wall fails its audit in any case.",
    )

    @model_validator(mode="after")
    def _lanes_of_a_roadmap(self) -> "Discretisation":
        if self.kind == "grid" and self.lanes == "two_way":
            raise ValueError("lanes: two_way is for kind roadmap; lanes of a grid are two cells wide already")
        if self.doubled and (self.kind == "grid" or self.lanes == "two_way"):
            raise ValueError("doubled is for kind roadmap with single tracks; here robots can meet on every lane already")
        return self


class BatteryShape(_Strict):
    """The battery of a robot type, and what drains it, after Open-RMF's model."""

    voltage_v: OfBattery
    capacity_ah: OfBattery
    charging_a: OfBattery
    mass_kg: OfBattery
    inertia_kgm2: OfBattery
    friction: float = Field(ge=0, le=10, description="Coefficient.")
    device_w: float = Field(0.0, ge=0, le=1e5, description="Drawn by computer and sensors all the time.")


class RobotShape(_Strict):
    """A robot type written out; see the files in robots/."""

    length_m: OfRobot
    width_m: OfRobot
    max_speed_mps: OfRobot
    accel_mps2: OfRobot
    decel_mps2: OfRobot
    turn_rate_rad_s: OfRobot
    gap_m: float = Field(0.1, ge=0, le=1e3, description="Kept between robots, on top of their radii.")
    source: str = ""
    battery: BatteryShape | None = None


class RobotGroup(_Strict):
    """Robots of one type in a fleet of several."""

    type: str | RobotShape = Field(description="As robots.type.")
    count: Annotated[int, Field(ge=1, le=100_000)] | None = Field(None, description="How many; by default as many as there are starts.")
    starts: list[str] | None = Field(None, description="Names of vertices; drawn where the type has room by default.")
    goals: list[str] | None = Field(None, description="Names of vertices, for robots of this group; drawn by default.")

    @property
    def size(self) -> int:
        """How many robots."""
        return self.count or len(self.starts or self.goals or ())

    @model_validator(mode="after")
    def _enough(self) -> "RobotGroup":
        if not self.size:
            raise ValueError("give count, or starts")
        for key, places in (("starts", self.starts), ("goals", self.goals)):
            if places is not None and len(places) != self.size:
                raise ValueError(f"{len(places)} {key} for {self.size} robots")
        return self


class Robots(_Strict):
    """The fleet and where it starts and goes."""

    count: Annotated[int, Field(ge=1, le=100_000)] | None = Field(None, description="Number of robots, drawn or the first of `starts`.")
    type: str | RobotShape = Field("turtlebot3", description="A type of robots/, a YAML file of the same form, or one written out.")
    fleet: Annotated[list[RobotGroup], Field(min_length=1)] | None = Field(
        None,
        description="Instead of count, type, starts and goals: groups of robots, each of a type. Lanes on which walls leave a type no room "
        "are not its lanes, and goals of a group are for its robots. A list in the place of `robots` is short for it.",
    )
    draw: Literal["uniform", "anywhere", "mrp_bench"] = Field(
        "uniform",
        description="How starts and goals are drawn where they are not given. 'uniform': distinct and mutually reachable stations; "
        "'anywhere': the same between stations, too, on any vertex that robots plan on; "
        "'mrp_bench': random.sample over the vertices with the seed (starts) and seed + 1 (goals), as MRP-Bench does.",
    )
    starts: list[str] | None = Field(None, description="Names of vertices, one a robot; an unnamed vertex is v<index>.")
    goals: list[str] | None = Field(None, description="Names of vertices.")
    start_heading_deg: Heading | list[Heading | None] | None = Field(
        None,
        description="Headings at the starts, counter-clockwise from x: one for all, or one a start, null for that of the robot's first "
        "lane. By default all robots face the way that they go.",
    )
    goal_heading_deg: Heading | list[Heading | None] | None = Field(
        None,
        description="Headings to which robots turn at the goals, of lanes that lead to the goal or away from it: one for all, or one a "
        "goal, null for any. By default all robots stay as they come.",
    )

    @field_validator("start_heading_deg", "goal_heading_deg", mode="before")
    @classmethod
    def _one_or_each(cls, found: Any) -> Any:
        for heading in found if isinstance(found, list | tuple) else [found]:
            if heading is not None and (type(heading) not in (int, float) or not -360 <= heading <= 360):
                raise ValueError(f"found {heading!r:.40}, expected degrees from -360 to 360, or a list of them, null where any will do")
        return found

    @property
    def size(self) -> int:
        """How many robots."""
        return sum(group.size for group in self.fleet) if self.fleet else self.count or len(self.starts or ())

    @property
    def groups(self) -> list[RobotGroup]:
        """Robots by type; those of one type are one group."""
        return self.fleet or [RobotGroup(type=self.type, count=self.size)]

    @model_validator(mode="after")
    def _enough(self) -> "Robots":
        if self.fleet is not None:
            given = [key for key in ("count", "starts", "goals") if getattr(self, key) is not None]
            given += ["type"] if self.type != Robots.model_fields["type"].default else []
            if given or self.draw == "mrp_bench":
                raise ValueError(f"fleet and {given[0] if given else 'draw: mrp_bench'} exclude each other: its groups have their own")
            return self._with_headings()
        if (self.starts is None) != (self.goals is None):
            raise ValueError("starts and goals go together: give both or neither")
        if self.starts is None and self.count is None:
            raise ValueError("give count, or starts and goals")
        if self.starts is not None and self.count is not None and self.count > len(self.starts):
            raise ValueError(f"count is {self.count}, but there are {len(self.starts)} starts")
        return self._with_headings()

    def _with_headings(self) -> "Robots":
        """Refuse lists of headings that are not one for each."""
        for key, headings, places in (
            ("start", self.start_heading_deg, self.starts),
            ("goal", self.goal_heading_deg, self.goals),
        ):
            expected = self.size if places is None else len(places)
            if isinstance(headings, list) and len(headings) != expected:
                raise ValueError(f"{key}_heading_deg has {len(headings)} headings, but there are {expected} {key}s")
        return self


class Assignment(_Strict):
    """Who goes to which goal."""

    mode: Literal["optimal", "random", "fixed"] = Field("optimal", description="'fixed': robot i to goal i.")
    solver: str = Field("linear_sum_assignment", description="Assigner for 'optimal', such as mip or cp_sat, or FILE.py:CLASS.")
    cost: Literal["euclidean", "manhattan", "path"] = "euclidean"
    parameters: dict[str, Any] = Field(default_factory=dict, description="Of the assigner.")


class RetimeChoice(_Strict):
    """How a plan gets the times of real motion."""

    margin_s: Annotated[float, Field(ge=0)] = Field(0.0, description="What a robot leaves is planned to be free this much later.")
    spread_s: Annotated[float, Field(ge=0)] = Field(
        0.0,
        description="Standard deviation of a robot's delay at a visit: what it leaves after n visits is free 2 spread_s √n later.",
    )


class PlannerChoice(_Strict):
    """The planner and what it may spend."""

    name: str = Field("cbs", description="Of a registered planner, or FILE.py:CLASS, the file relative to the scenario.")
    time_limit_s: Positive = 60.0
    budget: Annotated[int, Field(ge=1, le=10**12)] | None = Field(
        None,
        description="Labels that the search may make, beside the time limit: what ends it at the same place on every machine, under any "
        "load. With tasks, see execution.planning.effort.",
    )
    parameters: dict[str, Any] = Field(default_factory=dict, description="Of the planner.")
    step_s: Positive | None = Field(
        None, description="Planned time for a lane; by default its length at full speed plus a quarter turn, rounded up to the step length."
    )
    retime: bool | RetimeChoice = Field(
        True, description="Give the plan the times of the robots' real motion, in the order that it has; false: leave it in steps."
    )


class BreakdownChoice(_Strict):
    """A robot that stands still for a while."""

    robot: Annotated[int, Field(ge=0)]
    begin_s: float
    duration_s: Positive | None = Field(None, description="For good by default.")


class ObstacleChoice(_Strict):
    """A pallet or a human on the floor."""

    x_m: float
    y_m: float
    begin_s: float
    duration_s: Positive | None = Field(None, description="For good by default.")
    radius_m: Positive = 0.3


class ClosureChoice(_Strict):
    """A stretch that nobody may set out on for a while."""

    between: tuple[str, str] = Field(description="Names of two vertices: the shortest way between them is closed in both directions.")
    begin_s: Annotated[float, Field(ge=0)] = 0.0
    duration_s: Positive | None = Field(None, description="For good by default.")


class OutageChoice(_Strict):
    """A lift that is out of service for a while, or a door that is locked."""

    lift: str = Field("", description="Its name.")
    door: str = Field("", description="Its name, where doors are automatic.")
    begin_s: Annotated[float, Field(ge=0)] = 0.0
    duration_s: Positive | None = Field(
        None, description="For good by default; planners know of what is out of service from the start for good."
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> "OutageChoice":
        if bool(self.lift) == bool(self.door):
            raise ValueError("give lift or door")
        return self


class FireChoice(_Strict):
    """A fire alarm: lifts end their rides, go to where they stood at first, and take nobody."""

    begin_s: Annotated[float, Field(ge=0)]
    duration_s: Positive | None = Field(None, description="For good by default.")


NAMED_DISTURBANCES: dict[str, dict[str, float]] = {  # how they were found: docs/paper.md
    "nav2_like": {"speed_noise": 0.053, "speed_noise_tau_s": 2.0},
}


class DisturbanceChoice(_Strict):
    """What goes wrong, drawn with a seed. Nothing by default; the name of a set alone is short for it."""

    name: str = Field("", description=f"A named set, whose values other keys change: {', '.join(NAMED_DISTURBANCES)}.")
    seed: Annotated[int, Field(ge=0, lt=2**63)] | None = Field(None, description="By default the scenario's.")
    speed_spread: float = Field(0.0, description="Standard deviation of the robots' factors on their speed.")
    speed_noise: float = Field(0.0, description="Standard deviation of what every robot loses of its speed now and then.")
    speed_noise_tau_s: float = 2.0
    stops_per_s: float = Field(0.0, description="Random stops of a robot.")
    stop_median_s: float = 3.0
    stop_sigma: float = 0.6
    start_delay_s: float = Field(0.0, description="Robots set out up to this late.")
    delay_probability: float = Field(0.0, description="In each planned step, of being held for some steps.")
    delay_steps_min: int = 1
    delay_steps_max: int = 5
    latency_s: float = Field(0.0, description="Before a robot hears what it may enter.")
    message_loss: float = Field(0.0, description="Share of messages that are lost; they are repeated every step.")
    localisation_m: float = Field(
        0.0, description="Standard deviation of where robots take themselves to be, in x and y: believed.parquet and the bag, nothing else."
    )
    localisation_rad: float = Field(0.0, description="And of their heading.")
    localisation_tau_s: float = Field(0.0, description="In which such errors are forgotten; 0: every sample has its own.")
    lift_rides_per_h: float = Field(0.0, description="Of people in each lift, between levels drawn alike.")
    lift_hold_s: float = Field(10.0, description="Mean time for which they keep its doors open when they board, and again when they leave.")
    door_passages_per_h: float = Field(0.0, description="Of people through each door, where doors are automatic.")
    door_hold_s: float = Field(5.0, description="Mean time for which they keep it open.")
    breakdowns: list[BreakdownChoice] = []
    obstacles: list[ObstacleChoice] = []
    closures: list[ClosureChoice] = []
    outages: list[OutageChoice] = []
    fires: list[FireChoice] = []

    @model_validator(mode="before")
    @classmethod
    def _of_a_set(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(name := data.get("name"), str) or not name:
            return data
        if name not in NAMED_DISTURBANCES:
            raise ValueError(f"'{name}' is no named set of disturbances{nearest(name, NAMED_DISTURBANCES)}")
        return {**NAMED_DISTURBANCES[name], **data}


class RecoveryChoice(_Strict):
    """What `on_deadlock: resolve` does, mildest first."""

    give_way: bool = Field(True, description="First come first served, one of a ring of waiting robots steps aside or backs out.")
    patience_s: Positive = Field(10.0, description="Time blocked for good before a robot drives around, or all are replanned.")
    replanner: str | None = Field("lacam", description="Any planner, by name or FILE.py:CLASS; null: none.")


class PolicyChoice(_Strict):
    """The execution policy; its name alone is short for one without parameters."""

    name: str = "adg"
    parameters: dict[str, Any] = Field(default_factory=dict, description="Of the policy.")

    @model_serializer(mode="wrap")
    def _short(self, full: SerializerFunctionWrapHandler) -> str | dict[str, Any]:
        return full(self) if self.parameters else self.name


class DispatcherChoice(PolicyChoice):
    """The dispatcher; its name alone is short for one without parameters."""

    name: str = Field("", description="By default one_shot, and nearest where there are tasks.")
    parameters: dict[str, Any] = Field(default_factory=dict, description="Of the dispatcher.")


class PlanningChoice(_Strict):
    """How the planner is asked again and again while robots drive, in simulated time."""

    budget_s: Annotated[float, Field(ge=0)] = Field(
        1.0, description="An answer takes effect so long after it was asked for; until then robots keep their plan."
    )
    period_s: Annotated[float, Field(ge=0)] = Field(
        0.0, description="The least time between two requests; else there is one when a task comes or a stop is made."
    )
    window_s: Annotated[float, Field(ge=0)] | None = Field(
        None,
        description="Plans reach so far ahead: beyond, robots need not keep clear of each other. 0: to the end. "
        "By default 20 planned steps for planners that support windows, to the end for others.",
    )
    effort: Annotated[int, Field(ge=1)] = Field(
        1_000_000, description="Labels that a planner may make for an answer: what ends its search."
    )


class ExecutionChoice(_Strict):
    """How the plan is driven."""

    engine: Literal["sumo", "kinematic"] = Field(
        "sumo", description="What moves the bodies: SUMO, or the robots' limits alone, which takes a fraction of the time."
    )

    policy: PolicyChoice = Field(
        PolicyChoice(), description="Who may enter which vertex when: adg, open_loop, ..., or name and parameters."
    )
    dispatcher: DispatcherChoice = Field(
        DispatcherChoice(),
        description="Who decides what robots do next, once the first plan is being driven: by name, or name and parameters.",
    )
    planning: PlanningChoice = Field(PlanningChoice(), description="Of plans that are made while robots drive, for `tasks`.")
    invalid_plan: Literal["open_loop", "refuse"] = Field(
        "open_loop", description="What to do with a plan that the referee or the schedule rejects under a policy that needs a sound one."
    )
    step_length_s: Annotated[float, Field(gt=0, le=1)] = 0.1
    time_limit_s: Positive | None = Field(
        None, description="Simulated time; by default 1.5 times the planned makespan, at least 300 s. What was used is in result.json."
    )
    goal_tolerance_m: Positive = Field(
        0.7, description="MRP-Bench's locationTolerance: a robot this near its goal has reached it. Nobody stops short for it."
    )
    blocking_window_s: Positive = Field(10.0, description="A robot without a cell of progress along its path for so long is blocked.")
    on_deadlock: Literal["report", "stop", "resolve"] = Field("report", description="'resolve': see recovery.")
    recovery: RecoveryChoice = RecoveryChoice()
    mutex_groups: dict[str, list[str]] = Field(
        {}, description="Vertices on which, together, one robot at a time may be, by the group's name; lanes between them are in it too."
    )
    one_way: tuple[tuple[str, str], ...] = Field(
        (), description="Pairs of vertices: along the shortest way from the first to the second, lanes go in that direction only."
    )
    doors: Literal["open", "automatic"] = Field(
        "open",
        description="Whether the map's doors stand open, or open and close for robots, which takes as long as in Open-RMF's simulations.",
    )
    manual_doors: list[str] = Field(
        [], description="Doors that only people open, beside those that the map gives no plugin: robots pass while people keep them open."
    )
    disturbances: DisturbanceChoice = DisturbanceChoice()

    @field_validator("disturbances", mode="before", json_schema_input_type=str | DisturbanceChoice)
    @classmethod
    def _short_disturbances(cls, found: Any) -> Any:
        return {"name": found} if isinstance(found, str) else found

    @field_validator("policy", mode="before", json_schema_input_type=str | PolicyChoice)
    @classmethod
    def _short_policy(cls, found: Any) -> Any:
        return {"name": found} if isinstance(found, str) else found

    @field_validator("dispatcher", mode="before", json_schema_input_type=str | DispatcherChoice)
    @classmethod
    def _short_dispatcher(cls, found: Any) -> Any:
        return {"name": found} if isinstance(found, str) else found


class Recording(_Strict):
    """What is kept of a run."""

    period_s: Positive = Field(0.1, description="Between samples of the trajectory; a multiple of the step length.")
    bag: bool = True
    storage: Literal["mcap", "sqlite3"] = Field(
        "mcap", description="Of the bag: 'mcap' with zstd, or 'sqlite3' as MRP-Bench's analyser reads it."
    )
    rmf_messages: Literal["galactic", "jazzy", "kilted"] = Field("jazzy", description="Generation of rmf_fleet_msgs in the bag.")
    robots: tuple[str, ...] = Field((), description="Robots that get topics of their own in the bag, /<robot>/odom and /<robot>/plan.")
    metrics: list[str] = Field([], description="Metrics beside the bundled ones: FILE.py:FUNCTION, or the name that a package gives one.")
    poses: bool = Field(False, description="Put /robot_poses into the bag: what /tf says, as a PoseArray.")
    split_s: Positive | None = Field(None, description="A file of the bag for each so many seconds; one file by default.")


def _folder_name(name: str) -> str:
    """A name that can be a folder's, with room for a suffix."""
    if fault := fault_of_folder(name):
        raise ValueError(fault)
    return name


class Scenario(_Strict):
    """One problem and how to solve, execute and record it."""

    name: Annotated[str, AfterValidator(_folder_name)] = Field(
        "", pattern=r"^[\w.+-]*$", description="Of the run folder; the file's name by default."
    )
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    map: MapChoice
    discretisation: Discretisation = Discretisation()
    robots: Robots
    assignment: Assignment = Assignment()
    planner: PlannerChoice = PlannerChoice()
    tasks: TasksChoice | None = Field(None, description="Work that comes while robots drive; then robots have no goals of their own.")
    people: PeopleChoice | None = Field(None, description="People who walk among the robots. A number alone is short for their count.")
    execution: ExecutionChoice = ExecutionChoice()
    record: Recording = Recording()

    @model_validator(mode="after")
    def _goals_or_tasks(self) -> "Scenario":
        if self.tasks is not None and self.robots.goals != self.robots.starts:
            raise ValueError("robots: goals and tasks exclude each other")
        if self.tasks is not None and any(group.goals for group in self.robots.fleet or ()):
            raise ValueError("robots: fleet: goals and tasks exclude each other")
        if self.tasks is not None and self.robots.goal_heading_deg is not None:
            raise ValueError("robots: goal_heading_deg and tasks exclude each other")
        return self

    @model_validator(mode="before")
    @classmethod
    def _start_is_goal(cls, data: Any) -> Any:
        """With tasks, robots have no goals but their starts."""
        if isinstance(data, dict) and data.get("tasks") is not None and isinstance(robots := data.get("robots"), dict):
            return {**data, "robots": {"goals": robots.get("starts"), **robots}}
        return data

    @model_validator(mode="before")
    @classmethod
    def _short_forms(cls, data: Any) -> Any:
        """`map: office`, `planner: cbs`, `discretisation: grid`, `robots: 9` and `people: 20` stand for their main key, and a list of
        robots for `fleet`.
        """
        if isinstance(data, dict):
            for key, main, kind in (
                ("map", "file", str),
                ("planner", "name", str),
                ("discretisation", "kind", str),
                ("robots", "count", int),
                ("people", "count", int),
                ("robots", "fleet", list),
            ):
                if isinstance(data.get(key), kind) and not isinstance(data[key], bool):
                    data = {**data, key: {main: data[key]}}
        return data


SECTIONS = tuple(Scenario.model_fields)


@dataclass(frozen=True)
class ScenarioFile:
    """A checked scenario, and where its values come from, for messages about them."""

    scenario: Scenario
    document: Document
    options: Mapping[Place, str]  # command line options by the place they stand for

    def at(self, *place: str | int) -> str:
        """`file:line: key` of a place, or the command line option that set it or something above it, or those that set something in it."""
        for end in range(len(place), 0, -1):
            if option := self.options.get(place[:end]):
                return option
        inside = dict.fromkeys(option for set_place, option in self.options.items() if set_place[: len(place)] == place)
        return ", ".join(inside) or self.document.at(place)

    @contextmanager
    def located(self, *place: str | int) -> Iterator[None]:
        """Refusals within the block name file, line and key of a place: what is made of its value finds the fault, and knows no file."""
        try:
            yield
        except PlugInError:  # names its own file and line
            raise
        except MrpSumoError as error:
            raise type(error)(*(f"{self.at(*place)}: {line}" for line in str(error).splitlines())) from None

    @property
    def folder(self) -> Path:
        """Where relative paths begin."""
        return self.document.path.parent


def find_scenario(name_or_path: str) -> Path:
    """The file of a scenario: a path, or the name of a bundled one (`office_9`, `suites/...`).

    Raises
    ------
    ScenarioError
        When there is no such file, with the nearest one.
    """
    path, bundled = Path(name_or_path), bundled_folder("scenarios")
    named = bundled / (name_or_path if name_or_path.endswith(".yaml") else f"{name_or_path}.yaml")
    for file in (path, named):
        if os.path.isfile(file):  # noqa: PTH113  False for names that no system takes, too
            return file
    if os.path.lexists(path):
        require_regular(path, error=ScenarioError)
    beside = sorted(p.name for p in path.parent.glob("*.yaml")) if path.suffix else []
    known = nearest(path.name, beside or sorted(p.stem for p in bundled.glob("*.yaml")), limit=10)
    raise ScenarioError(f"{shortened(path)}: no such file{known}")


def read_scenario(path: Path, overrides: Mapping[Place, tuple[str, Any]] | None = None) -> ScenarioFile:
    """Read and check a scenario file.

    Parameters
    ----------
    path
        The file.
    overrides
        What the command line says instead: place -> (option, value), such as
        `{("planner", "name"): ("--planner", "cbs")}`. Naming another planner drops the parameters of the one before.

    Raises
    ------
    ScenarioError
        One line a fault, with file and line.
    """
    document = read_document(path)
    scenario = validated(document, Scenario)
    if not scenario.name:
        try:
            scenario = scenario.model_copy(update={"name": _folder_name(path.stem)})
        except ValueError as error:
            raise ScenarioError(f"{shortened(path)}: the file's name is the run's: {error}") from None
    return changed(ScenarioFile(scenario, document, {}), overrides or {})


def scenario_of(values: Mapping[str, Any], folder: Path, name: str) -> ScenarioFile:
    """Check a scenario that is not in a file. The programs that it names are trusted: the caller names them.

    Parameters
    ----------
    values
        What a file would say.
    folder
        Where relative paths begin.
    name
        Of a scenario that has none.

    Raises
    ------
    ScenarioError
        One line a fault.
    """
    document = Document(folder / "scenario", dict(values), {})
    scenario = validated(document, Scenario)
    file = ScenarioFile(scenario if scenario.name else scenario.model_copy(update={"name": name}), document, {})
    trust_programs(file)
    return file


def changed(file: ScenarioFile, overrides: Mapping[Place, tuple[str, Any]]) -> ScenarioFile:
    """The scenario with other values. The programs that these name are trusted: the user names them.

    Parameters
    ----------
    file
        The scenario.
    overrides
        As for `read_scenario`.

    Raises
    ------
    ScenarioError
        One line a fault, with the option that is to blame.
    """
    if not overrides:
        return file
    options = {**file.options, **{place: option for place, (option, _) in overrides.items()}}
    data = file.scenario.model_dump(exclude={"name"})  # which may be a file's, with any character
    if file.scenario.tasks is not None:
        del data["robots"]["goals"]  # robots have none but their starts, which may be others now
    for place, (_, value) in overrides.items():
        put(data, place, value)
    scenario = validated(file.document, Scenario, data, options=options)
    if not scenario.name:
        scenario = scenario.model_copy(update={"name": file.scenario.name})
    result = ScenarioFile(scenario, file.document, options)
    before = {program for _, program in programs_of(file)}
    for place, program in programs_of(result):
        whole = place[:-1] in overrides and not isinstance(overrides[place[:-1]][1], Mapping)  # a short form, a list
        if whole or place in overrides or program not in before:  # not what stays of a section that is changed in part
            trust(program)
    return result


PLUG_INS = {  # keys that name plug-ins, and their kinds
    "map.reader": "readers",
    "planner.name": "planners",
    "assignment.solver": "assigners",
    "execution.policy.name": "policies",
    "execution.dispatcher.name": "dispatchers",
    "execution.recovery.replanner": "planners",
}


def plug_ins_of(scenario: Scenario) -> Iterator[tuple[Place, str, str]]:
    """(place, kind, name) of every plug-in that a scenario names."""
    for key, kind in PLUG_INS.items():
        place = tuple(key.split("."))
        if name := reduce(getattr, place, scenario):
            yield place, kind, str(name)
    for i, metric in enumerate(scenario.record.metrics):
        yield ("record", "metrics", i), "metrics", metric


def programs_of(file: ScenarioFile) -> Iterator[tuple[Place, Program]]:
    """(place, program) of every plug-in file, and of the command, that a scenario names."""
    for place, _, name in plug_ins_of(file.scenario):
        if program := program_of(name, file.folder):
            yield place, program
    planner = file.scenario.planner
    if planner.name == "external" and planner.parameters.get("command"):
        yield ("planner", "parameters", "command"), Program(None, str(planner.parameters["command"]))


def trust_programs(file: ScenarioFile) -> None:
    """Trust the programs that a scenario names, until this process ends."""
    for _, program in programs_of(file):
        trust(program)


def require_trust(file: ScenarioFile, *folders: Path) -> None:
    """Refuse a scenario that names programs which are not trusted.

    Parameters
    ----------
    file
        What it names is trusted when it is in a trusted folder, or comes with this program.
    folders
        Of more files that had a say in it: of a suite's base.

    Raises
    ------
    ScenarioError
        One line per program: what would be run, and how to trust it.
    """
    unknown = [(place, program) for place, program in programs_of(file) if not is_trusted(program)]
    if not unknown:
        return
    places = [folder.resolve() for folder in (file.folder, *folders)]
    odd = [folder for folder in places if not folder.is_relative_to(bundled_folder("scenarios")) and not in_trusted_folder(folder)]
    if not odd:
        for _, program in unknown:
            trust(program)
        return
    how = f"name it on the command line, add --trust, or trust the folder once: mrp-sumo trust {shlex.quote(str(odd[0]))}"
    raise ScenarioError(*(f"{file.at(*place)}: would run {program.shown}, which is not trusted; {how}" for place, program in unknown))


def is_plug_in(key: str) -> bool:
    """Whether a dotted key, or what it is short for, names a plug-in."""
    return f"{key}.{MAIN_KEYS.get(key)}" in PLUG_INS or key in PLUG_INS


def rename(data: dict[str, Any], place: Place, name: str) -> None:
    """Change the name of a plug-in in a dumped scenario; its parameters stay."""
    at: Any = data
    for key in place[:-1]:
        if isinstance(at[key], str):  # the short form
            at[key] = name
            return
        at = at[key]
    at[place[-1]] = name


def unknown_key(key: str) -> str:
    """What is wrong with a dotted key of scenarios, '' if nothing is."""
    model: Any = Scenario
    for i, part in enumerate(parts := key.split(".")):
        if model is None or model is dict:
            return "" if model is dict else f"'{'.'.join(parts[:i])}' has no keys"
        if part not in model.model_fields:
            return f"unknown key{nearest_key(key)}"
        annotation = model.model_fields[part].annotation
        kinds = [annotation, *getattr(annotation, "__args__", ())]
        inner = [k for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)]
        model = inner[0] if inner else dict if str(annotation).startswith("dict") else None
    return ""


def nearest_key(key: str, others: Iterable[str] = ()) -> str:
    """The end of a message about an unknown key: the likeliest meant by its whole name, else by its last part.

    Parameters
    ----------
    key
        What the user wrote.
    others
        More keys that would have been right.
    """
    known = [*others, *_all_keys(Scenario)]
    by_last = {name.rpartition(".")[2]: name for name in reversed(known)}
    close = difflib.get_close_matches(key, known, n=1, cutoff=0.75) or [
        by_last[name] for name in difflib.get_close_matches(key.rpartition(".")[2], by_last, n=1, cutoff=0.75)
    ]
    return f" (did you mean '{close[0]}'?)" if close else nearest(key, known, limit=20)


def _all_keys(model: type[BaseModel], above: str = "") -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield above + name
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from _all_keys(field.annotation, f"{above}{name}.")


def robot_type(choice: str | RobotShape, folder: Path, beside: Path) -> RobotType:
    """The robot type that a scenario names or writes out.

    Parameters
    ----------
    choice
        Of the scenario.
    folder
        The bundled types, `<name>.yaml` each.
    beside
        Where a relative path begins.

    Raises
    ------
    ScenarioError
        For an unknown type and a flawed file.
    """
    if isinstance(choice, RobotShape):
        return _robot_type("custom", choice)
    path = folder / f"{choice}.yaml"
    if not os.path.isfile(path):  # noqa: PTH113
        path = beside / choice
        if not os.path.lexists(path):
            known = nearest(choice, (p.stem for p in sorted(folder.glob("*.yaml"))))
            raise ScenarioError(f"'{shortened(Path(choice))}' is neither a robot type nor a file{known}")
    return _robot_type(path.stem, validated(read_document(path), RobotShape))


def _robot_type(name: str, shape: RobotShape) -> RobotType:
    battery = Battery(**shape.battery.model_dump()) if shape.battery else None
    return RobotType(name=name, **shape.model_dump(exclude={"battery"}), battery=battery)
