"""`execution` of a scenario: how the plan is driven."""

from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, field_validator, model_serializer

from mrp_sumo.core.disturbances import NAMED_DISTURBANCES, NONE, Disturbances
from mrp_sumo.core.driving import Planning, RecoveryOptions
from mrp_sumo.errors import nearest
from mrp_sumo.io.scenario.strict import Positive, Strict


class PolicyChoice(Strict):
    """The execution policy; its name alone is short for one without parameters."""

    name: str = Field("adg", description="Of a policy, or FILE.py:CLASS.")
    parameters: dict[str, Any] = Field(default_factory=dict, description="Of the policy.")

    @model_serializer(mode="wrap")
    def _short(self, full: SerializerFunctionWrapHandler) -> str | dict[str, Any]:
        return full(self) if self.parameters else self.name


class DispatcherChoice(PolicyChoice):
    """The dispatcher; its name alone is short for one without parameters."""

    name: str = Field("", description="By default one_shot, and nearest where there are tasks.")
    parameters: dict[str, Any] = Field(default_factory=dict, description="Of the dispatcher.")


class ExecutionChoice(Strict):
    """Execution of the plan."""

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
    planning: Planning = Field(Planning(), description="Of plans that are made while robots drive, for `tasks`.")
    invalid_plan: Literal["open_loop", "refuse"] = Field(
        "open_loop", description="What to do with a plan that the referee or the schedule rejects under a policy that needs a sound one."
    )
    step_length_s: Annotated[float, Field(gt=0, le=1)] = Field(0.1, description="Of the simulation.")
    time_limit_s: Positive | None = Field(
        None, description="Simulated time; by default 1.5 times the planned makespan, at least 300 s. What was used is in result.json."
    )
    goal_tolerance_m: Positive = Field(
        0.7, description="MRP-Bench's locationTolerance: a robot this near its goal has reached it. Nobody stops short for it."
    )
    blocking_window_s: Positive = Field(10.0, description="A robot without a cell of progress along its path for so long is blocked.")
    on_deadlock: Literal["report", "stop", "resolve"] = Field("report", description="'resolve': see recovery.")
    recovery: RecoveryOptions = Field(RecoveryOptions(), description="What `on_deadlock: resolve` does, mildest first.")
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
    disturbances: Disturbances = Field(NONE, description="What goes wrong; the name of a set alone is short for it.")

    @field_validator("disturbances", mode="before", json_schema_input_type=str | Disturbances)
    @classmethod
    def _of_a_set(cls, value: Any) -> Any:
        """The values of a named set, and what a file says beside its name."""
        values = {"name": value} if isinstance(value, str) else value
        if not isinstance(values, dict) or not isinstance(name := values.get("name"), str) or not name:
            return values
        if name not in NAMED_DISTURBANCES:
            raise ValueError(f"'{name}' is no named set of disturbances{nearest(name, NAMED_DISTURBANCES)}")
        return {**NAMED_DISTURBANCES[name], **values}

    @field_validator("policy", mode="before", json_schema_input_type=str | PolicyChoice)
    @classmethod
    def _short_policy(cls, value: Any) -> Any:
        return {"name": value} if isinstance(value, str) else value

    @field_validator("dispatcher", mode="before", json_schema_input_type=str | DispatcherChoice)
    @classmethod
    def _short_dispatcher(cls, value: Any) -> Any:
        return {"name": value} if isinstance(value, str) else value
