"""Changes of a scenario that may help, written as users write them, and which of them are obvious.

    one_way: [v3, v17]      lanes along the shortest way from the first vertex to the second go in that direction only
    doubled: [v3, v17]      lanes along the shortest way between two vertices get a second track (of roadmaps)
    stations.pack: +1       one more place of a station, or one more station of a group, at the nearest vertex of the map that has no use
    robot: amr_600          and planner, policy, dispatcher: another one
    planner.parameters.w: 1.2    any other key of a scenario

Refuses names that are not known, each in one line.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.graph import NavGraph
from mrp_sumo.core.places import BETWEEN
from mrp_sumo.errors import MapError, MrpSumoError, nearest
from mrp_sumo.io.scenario.keys import unknown_key
from mrp_sumo.io.scenario.tasks import TasksChoice
from mrp_sumo.maps.yaml_text import Text, parse
from mrp_sumo.sizing.question import Question, Values
from mrp_sumo.sizing.reasons import Reasons

AUTO = "auto"
SHORT = {  # words for keys
    "robot": ("robots", "type"),
    "planner": ("planner", "name"),
    "policy": ("execution", "policy", "name"),
    "dispatcher": ("execution", "dispatcher", "name"),
    "one_way": ("execution", "one_way"),
    "doubled": ("discretisation", "doubled"),
}
BETWEEN_VERTICES = ("one_way", "doubled")
NUM_STATIONS = 3  # that are tried by themselves
OTHERS = {"planner": ("lacam", "lns2"), "dispatcher": ("hungarian", "nearest"), "policy": ("adg_switch",)}


def values_of_change(text: str, question: Question, nav: NavGraph) -> Values:
    """The values of a scenario that a change stands for. Raises MrpSumoError for what cannot be read, and for names that are not known."""
    option = f"--what-if '{text}'"
    key, colon, rest = text.partition(":")
    key = key.strip()
    try:
        value = parse(Text(Path(option), rest))
    except MapError:
        colon = ""
    if not colon or not key or value is None:
        raise MrpSumoError(f"{option}: expected a key and a value, such as 'planner: lacam' or 'stations.pack: +1'")
    if key.startswith("stations."):
        return _one_more(option, key.removeprefix("stations."), rest.strip(), question, nav)
    if key in BETWEEN_VERTICES:
        if not (isinstance(value, list) and len(value) == 2):
            raise MrpSumoError(f"{option}: expected two vertices, such as '{key}: [v3, v17]'")
        scenario = question.file.scenario
        now = scenario.execution.one_way if key == "one_way" else scenario.discretisation.doubled
        return {SHORT[key]: (option, [*map(list, now), [str(v) for v in value]])}
    place: tuple[str, ...] = SHORT.get(key) or tuple(key.split("."))
    if key not in SHORT and (fault := unknown_key(key)):
        raise MrpSumoError(f"{option}: {fault}")
    return {place: (option, value)}


def obvious(question: Question, reasons: Reasons) -> tuple[str, ...]:
    """Changes worth trying for a fleet: the busiest stations once more, the worst aisle otherwise, another planner, policy, dispatcher."""
    scenario, tasks = question.file.scenario, question.file.scenario.tasks
    assert tasks is not None
    named = dict.fromkeys(tasks.group_of.get(station.name, station.name) for station in reasons.stations)
    grown = [name for name in named if name in tasks.stations or name in tasks.groups]
    changes = [f"stations.{name}: +1" for name in grown[:NUM_STATIONS]]
    aisle = next((place for place in reasons.places if place.kind == "aisle"), None)
    if aisle:
        single = scenario.discretisation.kind != "grid" and scenario.discretisation.lanes == "single_track"
        ends = ", ".join(aisle.name.split(BETWEEN))
        changes += [f"{change}: [{ends}]" for change in BETWEEN_VERTICES if change == "one_way" or single]
    now = {
        "planner": scenario.planner.name,
        "policy": scenario.execution.policy.name,
        "dispatcher": scenario.execution.dispatcher.name or "nearest",
    }
    changes += [f"{word}: {next(o for o in others if o != now[word])}" for word, others in OTHERS.items() if set(others) != {now[word]}]
    return tuple(changes)


def _one_more(option: str, name: str, amount: str, question: Question, nav: NavGraph) -> Values:
    tasks = question.file.scenario.tasks
    if tasks is None:
        raise MrpSumoError(f"{option}: the scenario has no tasks, and no stations")
    if not (amount[:1] == "+" and amount[1:].isdigit() and int(amount[1:]) > 0):
        raise MrpSumoError(f"{option}: found {amount!r}, expected how many more, such as +1")
    if name not in tasks.stations and name not in tasks.groups:
        raise MrpSumoError(f"{option}: '{name}' is no station or group{nearest(name, [*tasks.stations, *tasks.groups])}")
    have = tasks.stations[name].places if name in tasks.stations else tasks.groups[name]
    more = _unused(tasks, nav, have, int(amount[1:]))
    if len(more) < int(amount[1:]):
        raise MrpSumoError(f"{option}: no vertex of the map is left for it near '{name}'")
    if name in tasks.stations:
        station = tasks.stations[name].model_dump()
        changed: dict[str, Any] = {"stations": {**tasks.model_dump()["stations"], name: {**station, "places": [*have, *more]}}}
    else:
        changed = {"groups": {**tasks.groups, name: [*have, *more]}}
    return {("tasks",): (option, changed)}


def _unused(tasks: TasksChoice, nav: NavGraph, have: Sequence[str], count: int) -> list[str]:
    """The vertices nearest to a station's that no station uses; dead ends first, where robots that are served stand in nobody's way."""
    used = {v for station in tasks.stations.values() for v in (*station.places, *station.queue)}
    used |= {member for members in tasks.groups.values() for member in members}
    at = [nav.vertex_of_name[v] for name in have for v in (tasks.stations[name].places if name in tasks.stations else [name])]
    away_m = np.hypot(*(nav.xy[:, None] - nav.xy[at]).transpose(2, 0, 1)).min(1)
    same = np.isin(nav.level, nav.level[at]) & (nav.component == nav.component[at[0]])
    order = np.lexsort((away_m, np.diff(nav.first) > 1))
    free = [v for v in order.tolist() if same[v] and nav.label(v) not in used and f"v{v}" not in used]
    return [nav.label(v) for v in free[:count]]
