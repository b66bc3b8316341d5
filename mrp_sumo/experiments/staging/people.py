"""From the `people:` of a scenario to who walks where: places on the map's free space, flows between them, and fields.

Refuses names that the map does not have, places without room, and maps on which there is nowhere to go, each in one line.
"""

from dataclasses import replace
from itertools import islice

import numpy as np

from mrp_sumo.core.arrivals import HOUR_S, Arrivals
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import IntArray, NavGraph, PlanGraph
from mrp_sumo.crowd.floor import BEFORE_LIFT_M, SNAP_M, Floor, corridor_beside, floor_of
from mrp_sumo.crowd.model import Flow, People, joint_places
from mrp_sumo.crowd.options import EVERYBODY, Group
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.errors import ScenarioError
from mrp_sumo.experiments.staging.places import as_drawn
from mrp_sumo.io.documents import Place
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.people import PeopleChoice
from mrp_sumo.maps.map import Map

MOST_PLACES = 40  # that are drawn
DRAW = 50  # purpose of the stream of chance
IntPlaces = tuple[int, ...]


def with_people(settings: ExecutionSettings, file: ScenarioFile, map_: Map, graph: PlanGraph, fleet: Fleet) -> ExecutionSettings:
    """The settings with the people of a scenario, if it has some."""
    choice = file.scenario.people
    if choice is None:
        return settings
    if choice.model == "lane_speeds":
        return replace(settings, lane_speeds_mps=choice.lane_speeds)
    return replace(settings, people=_people(choice, file, map_, graph, fleet))


def _people(choice: PeopleChoice, file: ScenarioFile, map_: Map, graph: PlanGraph, fleet: Fleet) -> People:
    """People who walk among the robots."""
    seed = file.scenario.seed
    widest_m = max(each.with_load.beside_m for each in fleet.types)
    floor = floor_of(map_, graph, choice.corridor_m or corridor_beside(widest_m, choice.fields.side_m))
    if not floor.free.any():
        raise ScenarioError(f"{file.at('people')}: '{graph.name}' has no room for people: nowhere are 0.5 m free between walls")
    places = _Places(file, map_.nav, floor)
    drawn = _drawn(choice, places, seed)
    ends, flows = list[tuple[IntPlaces, IntPlaces]](), list[Flow]()
    for i, each in enumerate(choice.flows or ()):
        key = ("people", "flows", i)
        named = (("origin", each.origin), ("destination", each.destination))
        origins, destinations = (drawn if names is None else places.named((*key, end), names) for end, names in named)
        ends.append((origins, destinations))
        flows += _flow(origins, destinations, each.rate_per_h, choice.profile if each.profile is None else each.profile)
    if choice.rate_per_h is not None:
        ends.append((drawn, drawn))
        flows += _flow(drawn, drawn, choice.rate_per_h, choice.profile)
    people = People(
        floor=floor,
        place=np.array(places.cells, np.int64),
        count=choice.count or 0,
        flows=tuple(flows),
        clock_s=choice.clock_h * HOUR_S,
        groups=choice.groups or (EVERYBODY if choice.free_speed_mps is None else (Group(speed_mps=choice.free_speed_mps),)),
        fields=choice.fields if choice.fields.active else None,
        seed=seed,
    )
    reachable = joint_places(people)
    if not any(reachable):
        raise ScenarioError(f"{file.at('people')}: nobody can walk anywhere on '{graph.name}': no two places are joined by free space")
    for i, (origins, destinations) in enumerate(ends):
        if not any(end in reachable[origin] for origin in origins for end in destinations):
            raise ScenarioError(f"{file.at('people', 'flows', i)}: no way leads from its origins to its destinations")
    return people


class _Places:
    """Places that have been named or drawn, each once."""

    def __init__(self, file: ScenarioFile, nav: NavGraph, floor: Floor) -> None:
        self.nav, self.floor, self.cells = nav, floor, list[int]()
        self._file, self._of_vertex = file, dict[int, int]()

    def named(self, key: Place, names: list[str]) -> IntPlaces:
        places = tuple(self.at(vertex) for vertex in as_drawn(self._file, self.nav, key, names))
        for i, name in enumerate(names):
            if places[i] < 0:
                raise ScenarioError(f"{self._file.at(*key, i)}: there is no room for people within a metre of '{name}'")
        return places

    def at(self, vertex: int) -> int:
        """The place at a vertex; -1 where there is no room."""
        if vertex not in self._of_vertex:
            cell = self.floor.place_at(self.nav.xy[vertex], BEFORE_LIFT_M if self.nav.vertex_options[vertex].get("lift") else SNAP_M)
            if cell < 0:
                return -1
            self._of_vertex[vertex] = len(self.cells)
            self.cells.append(cell)
        return self._of_vertex[vertex]


def _drawn(choice: PeopleChoice, places: _Places, seed: int) -> IntPlaces:
    """The places between which people walk where the scenario names none: those listed, else vertices with names, else any."""
    if choice.places is not None:
        return places.named(("people", "places"), choice.places)
    if choice.flows is not None and all(flow.origin and flow.destination for flow in choice.flows):
        return ()
    nav = places.nav
    named = [v for v in range(nav.num_vertices) if nav.vertex_name[v]]
    order: IntArray = np.random.default_rng([seed, DRAW]).permutation(named if len(named) > 1 else nav.num_vertices)
    return tuple(islice((place for v in order.tolist() if (place := places.at(v)) >= 0), MOST_PLACES))


def _flow(origins: IntPlaces, destinations: IntPlaces, rate_per_h: float, profile: list[float]) -> list[Flow]:
    """People between places, if there are any at such a rate."""
    if not rate_per_h or not max(profile, default=1.0):
        return []
    return [Flow(origins, destinations, Arrivals(rate_per_h=rate_per_h, profile=tuple(profile)))]
