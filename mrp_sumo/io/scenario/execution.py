"""`execution` of a scenario: how the plan is driven."""

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, SerializerFunctionWrapHandler, model_serializer

from mrp_sumo.core.disturbances import NAMED_DISTURBANCES, NONE, Disturbances
from mrp_sumo.core.driving import DrivingOptions
from mrp_sumo.core.options import meaning, option
from mrp_sumo.errors import nearest
from mrp_sumo.io.scenario.strict import Strict


class PolicyChoice(Strict):
    """The execution policy; its name alone is short for one without parameters."""

    name: str = Field("adg", description="A policy, or FILE.py:CLASS.")
    parameters: dict[str, Any] = Field(default_factory=dict, description="Its parameters.")

    @model_serializer(mode="wrap")
    def _short(self, full: SerializerFunctionWrapHandler) -> str | dict[str, Any]:
        return full(self) if self.parameters else self.name


class DispatcherChoice(PolicyChoice):
    """The dispatcher; its name alone is short for one without parameters."""

    name: str = Field("", description="By default one_shot, and nearest where there are orders.")
    parameters: dict[str, Any] = Field(default_factory=dict, description="Its parameters.")


def _named(value: Any) -> Any:
    """The name alone is short for a plug-in without parameters."""
    return {"name": value} if isinstance(value, str) else value


def _of_a_set(value: Any) -> Any:
    """The values of a named set, and what a file says beside its name."""
    values = _named(value)
    if not isinstance(values, dict) or not isinstance(name := values.get("name"), str) or not name:
        return values
    if name not in NAMED_DISTURBANCES:
        raise ValueError(f"'{name}' is no named set of disturbances{nearest(name, NAMED_DISTURBANCES)}")
    return {**NAMED_DISTURBANCES[name], **values}


@dataclass(frozen=True, kw_only=True)
class ExecutionChoice(DrivingOptions):
    """Execution of the plan."""

    policy: Annotated[PolicyChoice, BeforeValidator(_named, str | PolicyChoice)] = field(
        default=PolicyChoice(), metadata=meaning("Who may enter which vertex when: adg, open_loop, ..., or name and parameters.")
    )
    dispatcher: Annotated[DispatcherChoice, BeforeValidator(_named, str | DispatcherChoice)] = field(
        default=DispatcherChoice(),
        metadata=meaning("Who decides what robots do next: a name, or name and parameters."),
    )
    disturbances: Annotated[Disturbances, BeforeValidator(_of_a_set, str | Disturbances)] = field(
        default=NONE, metadata=meaning("What goes wrong; the name of a set, or of a YAML file with these keys, alone is short for it.")
    )
    invalid_plan: Literal["open_loop", "refuse"] = option(
        "open_loop", "What to do with a plan that the referee or the schedule rejects under a policy that needs a sound one."
    )
    time_limit_s: float | None = option(
        None, "Simulated time; by default 1.5 times the planned makespan, at least 300 s. What was used is in result.json.", gt=0, le=1e9
    )
    goal_tolerance_m: float = option(
        0.7, "MRP-Bench's locationTolerance: a robot this near its goal has reached it. Nobody stops short for it.", gt=0, le=1e9
    )
    mutex_groups: dict[str, tuple[str, ...]] = field(
        default_factory=dict,
        metadata=meaning("Vertices, and lanes between them, for one robot at a time, by the group's name."),
    )
    one_way: tuple[tuple[str, str], ...] = option(
        (), "Pairs of vertices: along the shortest way from the first to the second, lanes go in that direction only."
    )
    doors: Literal["open", "automatic"] = option(
        "open", "Whether the map's doors stand open, or open and close for robots as in Open-RMF's simulations."
    )
    manual_doors: tuple[str, ...] = option(
        (), "Doors that only people open, beside those that the map gives no plugin: robots pass while people keep them open."
    )
