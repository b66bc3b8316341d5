"""`map` and `discretisation` of a scenario: which map, and how it becomes a graph of unit steps."""

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from mrp_sumo.io.scenario.strict import Positive, Strict

Size = Annotated[float, Field(ge=1e-4, le=1e3)]
GraphIndex = Annotated[int, Field(ge=0, le=9)]


class FurnitureChoice(Strict):
    """The size of a model that stands in a building."""

    model: str = Field(description="The `model_name` in the building file.")
    length_m: Size = Field(description="Along the model's x.")
    width_m: Size = Field(description="Along the model's y.")


class MapChoice(Strict):
    """The map, and the part of it that is used."""

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
    def _one_or_several(cls, value: Any) -> Any:
        several = value if isinstance(value, list | tuple) and value else [value]
        if value not in (None, "all") and not all(type(number) is int and 0 <= number <= 9 for number in several):
            raise ValueError(f"found {value!r}, expected a number from 0 to 9, a list of them, or 'all'")
        return value


class Discretisation(Strict):
    """The graph of unit steps that is made of the nav graph."""

    kind: Literal["auto", "grid", "roadmap"] = Field(
        "auto",
        description="'roadmap': lanes cut into steps, with their directions, limits and curves; 'grid': the occupancy grid of the "
        "MRP-Bench paper, lanes two cells wide; 'auto': lanes where the map has them, else its grid.",
    )
    cell_m: Positive = Field(0.4, description="Approximate length of a step; with 'auto' the least, longer where robots or lanes need it.")
    lanes: Literal["single_track", "two_way"] = Field(
        "single_track", description="On roadmaps: whether robots can pass each other on a bidirectional lane. On grids they can."
    )
    doubled: tuple[tuple[str, str], ...] = Field(
        (),
        description="On roadmaps: pairs of vertices; on the shortest way between them robots can pass each other, as with two_way.",
    )
    clearance: Literal["refuse", "prune", "ignore"] = Field(
        "prune",
        description="Lanes and cells where walls leave the robots no room: 'prune' leaves them out, 'refuse' refuses the scenario, "
        "'ignore' plans over them. A run that touches a wall fails its audit in any case.",
    )

    short_lanes: Literal["refuse", "drive"] = Field(
        "refuse",
        description="Lanes of roadmaps that are shorter than two robots need between their centres: 'refuse' the scenario, or 'drive' them "
        "one robot at a time, with nobody else near.",
    )

    @model_validator(mode="after")
    def _lanes_of_a_roadmap(self) -> "Discretisation":
        if self.kind == "grid" and self.lanes == "two_way":
            raise ValueError("lanes: two_way is for kind roadmap; lanes of a grid are two cells wide already")
        if self.doubled and (self.kind == "grid" or self.lanes == "two_way"):
            raise ValueError("doubled is for kind roadmap with single tracks; here robots can meet on every lane already")
        return self
