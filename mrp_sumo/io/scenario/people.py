"""`people` of a scenario: who walks among the robots, and what robots do about it. `people: 20` is short for `count`."""

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from mrp_sumo.crowd.options import Group, ProtectiveFields
from mrp_sumo.io.scenario.strict import Strict

Count = Annotated[int, Field(ge=1, le=5000)]
Rate = Annotated[float, Field(ge=0, le=1e6)]
Factor = Annotated[float, Field(ge=0, le=1e3)]
Walking = Annotated[float, Field(gt=0, le=5)]


class FlowChoice(Strict):
    """People who go from one place to another."""

    origin: list[str] | None = Field(None, description="Name of a vertex, or names, one of which is drawn each time; any by default.")
    destination: list[str] | None = Field(None, description="The same.")
    rate_per_h: Rate = Field(description="How many set out in an hour on average, at random times (Poisson).")
    profile: list[Factor] | None = Field(None, description="As people.profile, for this flow.")

    @field_validator("origin", "destination", mode="before", json_schema_input_type=str | list[str] | None)
    @classmethod
    def _one_or_several(cls, value: Any) -> Any:
        return [value] if isinstance(value, str) else value


class PeopleChoice(Strict):
    """People who walk among the robots."""

    model: Literal["social_force", "lane_speeds"] = Field(
        "social_force", description="'lane_speeds': nobody walks, but each robot's speed is drawn anew on each lane."
    )
    count: Count | None = Field(None, description="Number of people at all times: whoever arrives is replaced.")
    rate_per_h: Rate | None = Field(None, description="Instead: how many set out in an hour, from any place to any other.")
    flows: Annotated[list[FlowChoice], Field(min_length=1)] | None = Field(None, description="Instead: people from place to place.")
    places: list[str] | None = Field(
        None, description="Names of vertices between which people walk; by default those with a name, at most 40, drawn by the seed."
    )
    profile: list[Factor] = Field([], description="Factors on the rates, in equal parts of a day.")
    clock_h: Annotated[float, Field(ge=0, lt=24)] = Field(8.0, description="The hour of the day at which the run begins.")
    free_speed_mps: Walking | None = Field(None, description="Mean preferred speed of all, instead of groups; 1.34 by default.")
    groups: tuple[Group, ...] = Field((), description="Who walks how fast; by default 1.34 m/s, standard deviation 0.26 m/s.")
    corridor_m: Annotated[float, Field(gt=0.5, le=100)] | None = Field(
        None,
        description="Width of the way along lanes, on maps without walls; 2 m by default, or what people need beside the widest robot.",
    )
    fields: ProtectiveFields = Field(ProtectiveFields(), description="What robots do about people.")
    lane_speeds: tuple[Walking, Walking, Walking] = Field(
        (0.274, 0.508, 0.63), description="Least, usual and greatest speed of model lane_speeds, m/s."
    )

    @model_validator(mode="after")
    def _one_number(self) -> "PeopleChoice":
        keys = [key for key in ("count", "rate_per_h", "flows") if getattr(self, key) is not None]
        if self.model == "lane_speeds":
            if keys:
                raise ValueError(f"{keys[0]} and model: lane_speeds exclude each other: nobody walks")
            least, usual, most = self.lane_speeds
            if not (least <= usual <= most and least < most):
                raise ValueError("lane_speeds: expected least <= usual <= greatest, not all equal")
        elif len(keys) != 1:
            raise ValueError(f"{' and '.join(keys)} exclude each other" if keys else "give count, rate_per_h or flows")
        if self.free_speed_mps is not None and self.groups:
            raise ValueError("free_speed_mps and groups exclude each other: groups have a speed_mps of their own")
        return self
