"""Scenario files read and checked, and changed by the command line."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mrp_sumo.core.disturbances import Disturbances
from mrp_sumo.errors import ScenarioError
from mrp_sumo.files.reading import shortened
from mrp_sumo.io.columns import put
from mrp_sumo.io.documents import Document, Place, read_document, validated
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.model import ScenarioModel, folder_name
from mrp_sumo.io.scenario.programs import programs_of, trust_programs
from mrp_sumo.io.scenario.robots import Robots, non_default, robot_type
from mrp_sumo.maps.catalogue import bundled_folder
from mrp_sumo.plugins.trust import trust


def read_scenario(path: Path, overrides: Mapping[Place, tuple[str, Any]] | None = None) -> ScenarioFile:
    """Read and check a scenario file. Raises ScenarioError: one line a fault, with file and line.

    `overrides` has what the command line says instead: place -> (option, value), such as `{("planner", "name"): ("--planner", "cbs")}`.
    Naming another planner drops the parameters of the one before.
    """
    document = read_document(path)
    if isinstance(document.content, dict) and "base" in document.content and "map" not in document.content:
        raise ScenarioError(f"{shortened(path)}: a suite, expected a scenario, with `map` and `robots`; see `mrp-sumo batch`")
    if isinstance(document.content, dict) and document.content.keys() >= {"status", "scenario", "metrics"}:
        raise ScenarioError(f"{shortened(path)}: the result of a run, expected a scenario; `mrp-sumo reproduce` makes the run again")
    scenario = validated(document, ScenarioModel, with_set(document.content, path.parent))
    if not scenario.name:
        try:
            scenario = scenario.model_copy(update={"name": folder_name(path.stem)})
        except ValueError as error:
            raise ScenarioError(f"{shortened(path)}: the file's name is the run's: {error}") from None
    return changed(ScenarioFile(scenario, document, {}), overrides or {})


def with_set(content: Any, folder: Path) -> Any:
    """A scenario's document whose disturbances are those of a file, where it names one in the place of a set.

    Raises ScenarioError for a flaw in that file, with its line.
    """
    execution: Any = content.get("execution") if isinstance(content, dict) else None
    named: Any = execution.get("disturbances") if isinstance(execution, dict) else None
    name = named.get("name") if isinstance(named, dict) else named
    if not isinstance(name, str) or not name.endswith((".yaml", ".yml")):
        return content
    document = read_document(folder / name)
    validated(document, Disturbances)
    own = {key: value for key, value in named.items() if key != "name"} if isinstance(named, dict) else {}
    return {**content, "execution": {**execution, "disturbances": {**document.content, **own}}}


def scenario_of(values: Mapping[str, Any], folder: Path, name: str) -> ScenarioFile:
    """Check a scenario that is not in a file. The programs that it names are trusted: the caller names them.

    Raises ScenarioError: one line a fault.
    """
    document = Document(folder / "scenario", dict(values), {})
    scenario = validated(document, ScenarioModel, with_set(document.content, folder))
    file = ScenarioFile(scenario if scenario.name else scenario.model_copy(update={"name": name}), document, {})
    trust_programs(file)
    return file


def changed(file: ScenarioFile, overrides: Mapping[Place, tuple[str, Any]]) -> ScenarioFile:
    """The scenario with other values. The programs that these name are trusted: the user names them.

    Raises ScenarioError: one line a fault, with the option that is to blame.
    """
    if not overrides:
        return file
    options = {place: option for place, option in file.options.items() if not any(place[:k] in overrides for k in range(len(place)))}
    options |= {place: option for place, (option, _) in overrides.items()}
    data = file.scenario.model_dump(exclude={"name"})  # which may be a file's, with any character
    if file.scenario.tasks is not None:
        del data["robots"]["goals"]  # robots have none but their starts, which may be others now
    for place, (_, value) in overrides.items():
        set_key(data, place, value, file.document.path.parent)
    scenario = validated(file.document, ScenarioModel, with_set(data, file.document.path.parent), options=options)
    if not scenario.name:
        scenario = scenario.model_copy(update={"name": file.scenario.name})
    result = ScenarioFile(scenario, file.document, options)
    before = {program for _, program in programs_of(file)}
    for place, program in programs_of(result):
        whole = place[:-1] in overrides and not isinstance(overrides[place[:-1]][1], Mapping)  # a short form, a list
        if whole or place in overrides or program not in before:  # not what stays of a section that is changed in part
            trust(program)
    return result


def set_key(data: dict[str, Any], place: Place, value: Any, beside: Path) -> None:
    """Set a key of a scenario in `data`, see `put`; a figure of a robot type that is named is set in the type written out.

    Raises ScenarioError for an unknown type and a flawed file, which may stand in the folder `beside`.
    """
    robots = data.get("robots")
    if place[0] == "robots" and len(place) > 1 and isinstance(robots, int):
        robots = data["robots"] = {"count": robots}
    if place[:2] == ("robots", "type") and len(place) > 2 and isinstance(robots, Mapping):
        named = robots.get("type", Robots.model_fields["type"].default)
        if isinstance(named, str):
            data["robots"] = {**robots, "type": non_default(robot_type(named, bundled_folder("robots"), beside))}
    put(data, place, value)
