"""Scenarios without files: one problem, and how to plan, drive and record it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Never

from mrp_sumo.door.maps import Site
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.io.documents import Place
from mrp_sumo.io.run_folder import plain
from mrp_sumo.io.scenario import model, robots
from mrp_sumo.io.scenario.file import ScenarioFile, find_scenario
from mrp_sumo.io.scenario.programs import trust_programs
from mrp_sumo.io.scenario.read import changed, read_scenario, scenario_of
from mrp_sumo.io.summary import Summary, summary, with_summary

Section = Mapping[str, Any]
SHORT = {"map": "file", "planner": "name", "discretisation": "kind", "robots": "count"}  # what a value alone stands for
REQUIRED: Any = None


@with_summary
@dataclass(frozen=True, init=False, repr=False, eq=False)
class Scenario:
    """One problem, and how to plan, drive and record it: what a scenario file says.

    Parameters
    ----------
    map
        The name of a bundled map, a file, a map from `load_map`, or the keys of the section `map`.
    robots
        How many, or the keys of the section: `{"count": 9, "type": "turtlebot3"}`, `{"starts": [...], "goals": [...]}`.
    planner
        Its name, or the keys of the section: `{"name": "eecbs", "time_limit_s": 10, "parameters": {"w": 1.1}}`.
    seed
        Of every stream of chance.
    name
        Of runs; made of map and number of robots by default.
    discretisation
        "auto", "grid", "roadmap", or the keys of the section. By default lanes are driven where the map has them.
    assignment, execution, record
        The keys of these sections.
    folder
        Where relative paths begin; the current folder by default.

    Raises
    ------
    MrpSumoError
        One line per fault: an unknown key, with the nearest right one, or a value that does not fit.

    Examples
    --------
    >>> ms.Scenario(map="office", robots=9, planner="eecbs", seed=3)
    <Scenario office_9: office, 9 robots, eecbs, adg, seed 3>
    """

    file: ScenarioFile

    def __init__(
        self,
        map: str | Path | Site | Section = REQUIRED,
        robots: int | Section = REQUIRED,
        planner: str | Section = "auto",
        seed: int = 0,
        *,
        name: str = "",
        discretisation: str | Section = "auto",
        assignment: Section | None = None,
        execution: Section | None = None,
        record: Section | None = None,
        folder: str | Path = ".",
        **unknown: Never,
    ) -> None:
        sections = {
            "name": name,
            "map": map.choice.model_dump() if isinstance(map, Site) else map,
            "robots": robots,
            "planner": planner,
            "seed": seed,
            "discretisation": discretisation,
            "assignment": assignment,
            "execution": execution,
            "record": record,
            **unknown,
        }
        values = {key: value for key, value in plain(sections).items() if value is not None}
        file = scenario_of(values, Path(folder).resolve(), name)
        if not name:
            chosen = file.scenario
            size = chosen.robots.size
            file = ScenarioFile(chosen.model_copy(update={"name": f"{_map_name(chosen)}_{size}"}), file.document, file.options)
        object.__setattr__(self, "file", file)

    @classmethod
    def read(cls, name_or_path: str | Path, *, trust: bool = False) -> "Scenario":
        """A scenario file, or a bundled scenario such as "office_9".

        Parameters
        ----------
        name_or_path
            Which.
        trust
            Whether to run the programs that it names: plug-in files, and commands of external planners. Without, they run only from a
            folder that `mrp-sumo trust` knows.

        Raises
        ------
        MrpSumoError
            One line per fault, with file and line.
        """
        file = read_scenario(find_scenario(str(name_or_path)))
        if trust:
            trust_programs(file)
        return cls._of(file)

    @classmethod
    def _of(cls, file: ScenarioFile) -> "Scenario":
        scenario = object.__new__(cls)
        object.__setattr__(scenario, "file", file)
        return scenario

    def replace(self, **changes: Any) -> "Scenario":
        """The scenario with other values.

        Parameters
        ----------
        changes
            By the keys of a scenario. Of a section only the keys given change: `replace(execution={"policy": "timed"})`. Another
            planner comes with its default parameters.

        Raises
        ------
        MrpSumoError
            As for a new scenario.
        """
        return Scenario._of(changed(self.file, {place: (dotted(place), value) for place, value in places_of(changes).items()}))

    @property
    def name(self) -> str:
        return self.file.scenario.name

    @property
    def seed(self) -> int:
        return self.file.scenario.seed

    @property
    def values(self) -> dict[str, Any]:
        """Every key with its value, defaults included, as a file would say them."""
        values: dict[str, Any] = self.file.scenario.model_dump(mode="json")
        return values

    @property
    def _summary(self) -> Summary:
        chosen = self.file.scenario
        kind = chosen.discretisation
        rows = [
            ("map", f"{chosen.map.file}, {kind.kind} of {kind.cell_m:g} m"),
            ("robots", ", ".join(f"{each.size} of type {_type_name(each)}" for each in chosen.robots.groups)),
            ("assignment", chosen.assignment.mode),
            ("planner", f"{chosen.planner.name}, at most {chosen.planner.time_limit_s:g} s"),
            *((f"  {key}", value) for key, value in chosen.planner.parameters.items()),
            ("policy", chosen.execution.policy.name),
            ("seed", chosen.seed),
        ]
        return summary(f"Scenario {self.name}", rows)

    def __repr__(self) -> str:
        chosen = self.file.scenario
        planner, policy = chosen.planner.name, chosen.execution.policy.name
        return f"<Scenario {self.name}: {_map_name(chosen)}, {chosen.robots.size} robots, {planner}, {policy}, seed {chosen.seed}>"


def places_of(changes: Section) -> dict[Place, Any]:
    """Places of changes in a scenario, with their values."""
    places: dict[Place, Any] = {}
    for key, value in changes.items():
        if isinstance(value, Site):
            places[key,] = value.choice.model_dump()
        elif isinstance(value, Mapping) and key in model.ScenarioModel.model_fields:
            places |= {(key, inner): plain(part) for inner, part in value.items()}
        elif key in SHORT and isinstance(value, str | Path | int):
            places[key, SHORT[key]] = plain(value)
        else:
            places[key,] = plain(value)
        if key == "planner" and ("planner", "name") in places:
            places.setdefault(("planner", "parameters"), {})
    return places


def dotted(place: Place) -> str:
    """A place as messages name it."""
    return ".".join(map(str, place))


def required(value: object, kind: type, call: str, hint: str) -> None:
    """Refuse an argument of another kind."""
    if not isinstance(value, kind):
        raise MrpSumoError(f"{call}: found {type(value).__name__}, expected {hint}")


def _map_name(chosen: model.ScenarioModel) -> str:
    return Path(chosen.map.file).name.split(".")[0]


def _type_name(group: robots.RobotGroup) -> str:
    return group.type if isinstance(group.type, str) else "custom"
