"""Names in a scenario: its map, types of robots and plug-ins. Refuses those that are not there, before anything large is loaded."""

from dataclasses import replace

from mrp_sumo.core.robot_type import RobotShape, RobotType, scaled
from mrp_sumo.io.documents import Place
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.programs import plug_ins_of
from mrp_sumo.io.scenario.robots import robot_type
from mrp_sumo.maps.catalogue import bundled_folder, find_map
from mrp_sumo.plugins.registry import find


def require_known(file: ScenarioFile) -> None:
    """Refuse names of no map, no type of robots and no plug-in. Raises MrpSumoError: one line, with the nearest right name."""
    with file.located("map"):
        find_map(file.scenario.map.file, file.folder)
    robot_types(file)
    for place, kind, name in plug_ins_of(file.scenario):
        with file.located(*(place[:-1] if kind in ("policies", "dispatchers") else place)):  # which are mostly written as a word
            find(kind, name, file.folder)


def robot_types(file: ScenarioFile) -> tuple[RobotType, ...]:
    """The type of each group of robots; those that are written out are told apart by their numbers."""
    groups, models = file.scenario.robots.groups, []
    for i, group in enumerate(groups):
        with file.located(*type_at(file, i)):
            model = scaled(robot_type(group.type, bundled_folder("robots"), file.folder), file.scenario.robots.factor)
        models.append(replace(model, name=f"custom_{i}") if isinstance(group.type, RobotShape) and len(groups) > 1 else model)
    return tuple(models)


def type_at(file: ScenarioFile, kind: int) -> Place:
    """Key under which a scenario says the type of its robots, or of a group of them."""
    return ("robots", "type") if file.scenario.robots.fleet is None else ("robots", "fleet", kind, "type")
