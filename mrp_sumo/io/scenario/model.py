"""The scenario: everything one run needs.

The models of this folder are the format; `mrp-sumo schema` prints their JSON schema. Unknown keys, values of the wrong kind and
figures out of range are refused, each in one line with its line number. What only the map can tell (names of vertices, robots
that fit) is checked when the run is set up.
"""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field, model_validator

from mrp_sumo.files.names import fault_of_folder
from mrp_sumo.io.scenario.execution import ExecutionChoice
from mrp_sumo.io.scenario.map import Discretisation, MapChoice
from mrp_sumo.io.scenario.people import PeopleChoice
from mrp_sumo.io.scenario.robots import Robots
from mrp_sumo.io.scenario.strict import Positive, Strict
from mrp_sumo.io.scenario.tasks import TasksChoice


class Assignment(Strict):
    """Assignment of goals to robots."""

    mode: Literal["optimal", "random", "fixed"] = Field("optimal", description="'fixed': robot i to goal i.")
    solver: str = Field("linear_sum_assignment", description="Assigner for 'optimal', such as mip or cp_sat, or FILE.py:CLASS.")
    cost: Literal["euclidean", "manhattan", "path"] = Field("euclidean", description="What 'optimal' makes small, from start to goal.")
    parameters: dict[str, Any] = Field(default_factory=dict, description="Its parameters.")


class RetimeChoice(Strict):
    """Retiming: a plan with the times of real motion."""

    margin_s: Annotated[float, Field(ge=0)] = Field(0.0, description="What a robot leaves is planned to be free this much later.")
    spread_s: Annotated[float, Field(ge=0)] = Field(
        0.0,
        description="Standard deviation of a robot's delay at a visit: what it leaves after n visits is free 2 spread_s √n later.",
    )


class PlannerChoice(Strict):
    """The planner and what it may spend."""

    name: str = Field("auto", description="A registered planner, or FILE.py:CLASS relative to the scenario.")
    time_limit_s: Positive = Field(
        60.0, description="CPU time. A plan that it may have shaped is marked in result.json: plan.clock_limited."
    )
    budget: Annotated[int, Field(ge=1, le=10**12)] | None = Field(
        None,
        description="Labels that the search may make, beside the time limit: the same on every machine, under any load. With orders, see "
        "execution.planning.effort.",
    )
    parameters: dict[str, Any] = Field(default_factory=dict, description="Its parameters.")
    step_s: Positive | None = Field(
        None, description="Planned time for a lane; by default its length at full speed plus a quarter turn, rounded up to the step length."
    )
    retime: bool | RetimeChoice = Field(
        True, description="Give the plan the times of the robots' real motion, in the order that it has; false: leave it in steps."
    )


class Recording(Strict):
    """Records that are kept of a run."""

    period_s: Positive = Field(0.1, description="Time between samples of the trajectory; a multiple of the step length.")
    bag: bool = Field(True, description="Whether a rosbag is written.")
    storage: Literal["mcap", "sqlite3"] = Field(
        "mcap", description="Format of the bag: 'mcap' with zstd, or 'sqlite3' as MRP-Bench's analyser reads it."
    )
    rmf_messages: Literal["galactic", "jazzy", "kilted"] = Field("jazzy", description="Generation of rmf_fleet_msgs in the bag.")
    robots: tuple[str, ...] = Field((), description="Robots that get topics of their own in the bag, /<robot>/odom and /<robot>/plan.")
    metrics: list[str] = Field([], description="Metrics beside the bundled ones: FILE.py:FUNCTION, or the name that a package gives one.")
    poses: bool = Field(False, description="Put /robot_poses into the bag: what /tf says, as a PoseArray.")
    split_s: Positive | None = Field(None, description="Seconds in each file of the bag; one file by default.")


def folder_name(name: str) -> str:
    """A name that can be a folder's, with room for a suffix."""
    if fault := fault_of_folder(name):
        raise ValueError(fault)
    return name


class ScenarioModel(Strict):
    """One problem and how to solve, execute and record it."""

    model_config = ConfigDict(title="Scenario")

    name: Annotated[str, AfterValidator(folder_name)] = Field(
        "", pattern=r"^[\w.+-]*$", description="Name of the run; the file's by default."
    )
    seed: Annotated[int, Field(ge=0, lt=2**63)] = Field(0, description="Seed of all random numbers.")
    map: MapChoice = Field(description="Which part of which map.")
    discretisation: Discretisation = Discretisation()
    robots: Robots
    assignment: Assignment = Assignment()
    planner: PlannerChoice = PlannerChoice()
    tasks: TasksChoice | None = Field(None, description="Work that comes while robots drive; then robots have no goals of their own.")
    people: PeopleChoice | None = Field(None, description="People who walk among the robots. A number alone is short for their count.")
    execution: ExecutionChoice = ExecutionChoice()
    record: Recording = Recording()

    @model_validator(mode="after")
    def _goals_or_tasks(self) -> "ScenarioModel":
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
            starts = robots.get("starts")
            are_names = isinstance(starts, list) and all(isinstance(name, str) for name in starts)  # else that is the fault, and told once
            return {**data, "robots": {"goals": starts if are_names else None, **robots}}
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


SECTIONS = tuple(ScenarioModel.model_fields)
