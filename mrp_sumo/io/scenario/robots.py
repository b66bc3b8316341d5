"""`robots` of a scenario, and the files of robots/: the fleet, its types, where it starts and goes."""

import os
from collections.abc import Sequence
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import Field, field_validator, model_validator

from mrp_sumo.core.robot_type import AS_THEY_ARE, Factors, RobotShape, RobotType
from mrp_sumo.errors import MrpSumoError, ScenarioError, nearest
from mrp_sumo.files.reading import shortened
from mrp_sumo.io.documents import document_from, read_document, validated
from mrp_sumo.io.scenario.strict import Strict

Heading = Annotated[float, Field(ge=-360, le=360, allow_inf_nan=False)]
WIDEST = 1_000_000  # characters of a line that is not broken


class RobotGroup(Strict):
    """Robots of one type in a fleet of several."""

    type: str | RobotShape = Field(description="As robots.type.")
    count: Annotated[int, Field(ge=1, le=100_000)] | None = Field(None, description="How many; by default as many as there are starts.")
    starts: list[str] | None = Field(None, description="Names of vertices; drawn where the type has room by default.")
    goals: list[str] | None = Field(None, description="Names of vertices, for robots of this group; drawn by default.")

    @property
    def size(self) -> int:
        """Number of robots."""
        return self.count or len(self.starts or self.goals or ())

    @model_validator(mode="after")
    def _enough(self) -> "RobotGroup":
        if not self.size:
            raise ValueError("give count, or starts")
        for key, places in (("starts", self.starts), ("goals", self.goals)):
            if places is not None and len(places) != self.size:
                raise ValueError(f"{len(places)} {key} for {self.size} robots")
        return self


class Robots(Strict):
    """The fleet and where it starts and goes."""

    count: Annotated[int, Field(ge=1, le=100_000)] | None = Field(None, description="Number of robots, drawn or the first of `starts`.")
    type: str | RobotShape = Field(
        "turtlebot3",
        description="A type of robots/, a YAML file of the same form, a factsheet of VDA 5050 (JSON), or one written out. "
        "`--set` and axes of suites change figures of any.",
    )
    fleet: Annotated[list[RobotGroup], Field(min_length=1)] | None = Field(
        None,
        description="Instead of count, type, starts and goals: groups of robots, each of a type and with goals of its own. A list in the "
        "place of `robots` is short for it.",
    )
    factor: Factors = Field(AS_THEY_ARE, description="Factors on figures of all types of the fleet, with a load and without.")
    draw: Literal["uniform", "anywhere", "mrp_bench"] = Field(
        "uniform",
        description="How starts and goals are drawn. 'uniform': distinct and mutually reachable stations; 'anywhere': the same of all "
        "vertices that robots plan on; 'mrp_bench': random.sample over the vertices with the seed (starts) and seed + 1 (goals), "
        "as MRP-Bench does.",
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
        description="Headings to which robots turn at the goals, of lanes to or from these: one for all, or one a goal, null for any. By "
        "default all robots stay as they come.",
    )

    @field_validator("start_heading_deg", "goal_heading_deg", mode="before")
    @classmethod
    def _one_or_each(cls, value: Any) -> Any:
        for heading in value if isinstance(value, list | tuple) else [value]:
            if heading is not None and (type(heading) not in (int, float) or not -360 <= heading <= 360):
                raise ValueError(f"found {heading!r:.40}, expected degrees from -360 to 360, or a list of them, null where any will do")
        return value

    @property
    def size(self) -> int:
        """Number of robots."""
        return sum(group.size for group in self.fleet) if self.fleet else self.count or len(self.starts or ())

    @property
    def groups(self) -> list[RobotGroup]:
        """Robots by type; those of one type are one group."""
        return self.fleet or [RobotGroup(type=self.type, count=self.size)]

    @model_validator(mode="after")
    def _enough(self) -> "Robots":
        if self.fleet is not None:
            keys = [key for key in ("count", "starts", "goals") if getattr(self, key) is not None]
            keys += ["type"] if self.type != Robots.model_fields["type"].default else []
            if keys or self.draw == "mrp_bench":
                raise ValueError(f"fleet and {keys[0] if keys else 'draw: mrp_bench'} exclude each other: its groups have their own")
            return self
        if (self.starts is None) != (self.goals is None):
            raise ValueError("starts and goals go together: give both or neither")
        if self.starts is None and self.count is None:
            raise ValueError("give count, or starts and goals")
        if self.starts is not None and self.count is not None and self.count > len(self.starts):
            raise ValueError(f"count is {self.count}, but there are {len(self.starts)} starts")
        return self

    @model_validator(mode="after")
    def _headings_for_each(self) -> "Robots":
        for key, headings, places in (("start", self.start_heading_deg, self.starts), ("goal", self.goal_heading_deg, self.goals)):
            expected = self.size if places is None else len(places)
            if isinstance(headings, list) and len(headings) != expected:
                raise ValueError(f"{key}_heading_deg has {len(headings)} headings, but there are {expected} {key}s")
        return self


def text_of_type(robot: RobotShape, notes: Sequence[str] = ()) -> str:
    """A file of robots/: the figures that differ from the defaults, below some notes."""
    lines = [*(f"# {note}" for note in notes), *(f"{key}: {_flow(value)}" for key, value in non_default(robot).items())]
    return "\n".join(lines) + "\n"


def type_of_text(name: str, text: str, where: str) -> RobotType:
    """The type of a text as of `text_of_type`; raises ScenarioError with where it stands."""
    return RobotType(name, **vars(validated(document_from(Path(where), text), RobotShape)))


def _flow(value: Any) -> str:
    """A value as YAML on one line."""
    text: str = yaml.safe_dump(value, default_flow_style=True, width=WIDEST, sort_keys=False, allow_unicode=True)
    return text.removesuffix("...\n").strip()


def non_default(options: Any) -> dict[str, Any]:
    """The options of a declaration that differ from their defaults."""
    said = {}
    for each in fields(options):
        value = getattr(options, each.name)
        default = each.default if each.default_factory is MISSING else each.default_factory()
        if each.name != "name" and value != default:
            said[each.name] = _plain(value)
    return said


def _plain(value: Any) -> Any:
    """A value of an option as YAML has it."""
    if isinstance(value, tuple | list):
        return [_plain(one) for one in value]
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    return non_default(value) if is_dataclass(value) else value


def robot_type(choice: str | RobotShape, folder: Path, beside: Path) -> RobotType:
    """The robot type that a scenario names or writes out; `folder` has the bundled ones.

    Raises ScenarioError for an unknown type and a flawed file.
    """
    if isinstance(choice, RobotShape):
        return RobotType("custom", **vars(choice))
    path = folder / f"{choice}.yaml"
    if not os.path.isfile(path):  # noqa: PTH113
        path = beside / choice
        if not os.path.lexists(path):
            known = nearest(choice, (p.stem for p in sorted(folder.glob("*.yaml"))))
            raise ScenarioError(f"'{shortened(Path(choice))}' is neither a robot type nor a file{known}")
    if path.suffix.lower() == ".json":
        return _of_factsheet(path)
    return RobotType(path.stem, **vars(validated(read_document(path), RobotShape)))


def _of_factsheet(path: Path) -> RobotType:
    """The type of a factsheet that leaves nothing to guess."""
    from mrp_sumo.formats.vda.factsheet import read_factsheet  # which loads arrays

    try:
        robot, notes = read_factsheet(path)
    except MrpSumoError as error:
        raise ScenarioError(str(error)) from None
    if guesses := [note.removeprefix("guessed: ") for note in notes if note.startswith("guessed: ")]:
        name = shortened(path)
        more = f" and {len(guesses) - 1} more" if len(guesses) > 1 else ""
        raise ScenarioError(
            f"{name}: guessed would be {guesses[0]}{more}; `mrp-sumo convert {name} {path.stem}.yaml` makes a type to look over"
        )
    return robot
