"""`execution.disturbances` of a scenario: what goes wrong."""

from typing import Annotated, Any

from pydantic import Field, model_validator

from mrp_sumo.errors import nearest
from mrp_sumo.io.scenario.strict import Positive, Strict


class BreakdownChoice(Strict):
    """A robot that stands still for a while."""

    robot: Annotated[int, Field(ge=0)]
    begin_s: float
    duration_s: Positive | None = Field(None, description="For good by default.")


class ObstacleChoice(Strict):
    """A pallet or a human on the floor."""

    x_m: float
    y_m: float
    begin_s: float
    duration_s: Positive | None = Field(None, description="For good by default.")
    radius_m: Positive = 0.3


class ClosureChoice(Strict):
    """A stretch that nobody may set out on for a while."""

    between: tuple[str, str] = Field(description="Names of two vertices: the shortest way between them is closed in both directions.")
    begin_s: Annotated[float, Field(ge=0)] = 0.0
    duration_s: Positive | None = Field(None, description="For good by default.")


class OutageChoice(Strict):
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


class FireChoice(Strict):
    """A fire alarm: lifts end their rides, go to where they stood at first, and take nobody."""

    begin_s: Annotated[float, Field(ge=0)]
    duration_s: Positive | None = Field(None, description="For good by default.")


NAMED_DISTURBANCES: dict[str, dict[str, float]] = {  # how they were found: docs/paper.md
    "nav2_like": {"speed_noise": 0.053, "speed_noise_tau_s": 2.0},
}


class DisturbanceChoice(Strict):
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
    breakdowns: list[BreakdownChoice] = Field([])
    obstacles: list[ObstacleChoice] = Field([])
    closures: list[ClosureChoice] = Field([])
    outages: list[OutageChoice] = Field([])
    fires: list[FireChoice] = Field([])

    @model_validator(mode="before")
    @classmethod
    def _of_a_set(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(name := data.get("name"), str) or not name:
            return data
        if name not in NAMED_DISTURBANCES:
            raise ValueError(f"'{name}' is no named set of disturbances{nearest(name, NAMED_DISTURBANCES)}")
        return {**NAMED_DISTURBANCES[name], **data}
