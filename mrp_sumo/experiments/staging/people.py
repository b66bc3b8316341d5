"""From the `people:` of a scenario to who walks where: places on the map's free space, flows between them, and fields.

Refuses names that the map does not have, places without room, and maps on which there is nowhere to go, each in one line.
"""

import numpy as np

from mrp_sumo.core.graph import IntArray, NavGraph, PlanGraph
from mrp_sumo.core.stream import HOUR_S, Arrivals
from mrp_sumo.crowd.floor import BEFORE_LIFT_M, SNAP_M, Floor, floor_of
from mrp_sumo.crowd.model import Flow, LaneSpeeds, People, joint_places
from mrp_sumo.crowd.options import EVERYBODY
from mrp_sumo.errors import ScenarioError, nearest
from mrp_sumo.io.documents import Place
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.people import FlowChoice, PeopleChoice
from mrp_sumo.maps.map import Map

MOST_PLACES = 40  # that are drawn
DRAW = 50  # purpose of the stream of chance


def people_of(file: ScenarioFile, map_: Map, graph: PlanGraph) -> People | LaneSpeeds | None:
    """People who walk among the robots of a scenario; None where it has no people."""
    choice, seed = file.scenario.people, file.scenario.seed
    if choice is None:
        return None
    if choice.model == "lane_speeds":
        return LaneSpeeds(*choice.lane_speeds, seed)
    floor = floor_of(map_, graph, choice.corridor_m)
    if not floor.free.any():
        raise ScenarioError(f"{file.at('people')}: '{graph.name}' has no room for people: nowhere are 0.5 m free between walls")
    places, flows = _Places(file, map_.nav, floor), list[Flow]()
    drawn = _drawn(file, choice, places, seed)
    for i, each in enumerate(choice.flows or ()):
        flows.append(_flow(file, ("people", "flows", i), choice, each, places, drawn))
    if choice.rate_per_h is not None:
        flows.append(Flow(tuple(drawn), tuple(drawn), _arrivals(choice.rate_per_h, choice.profile, choice.clock_h)))
    people = People(
        floor=floor,
        place=np.array(places.cells, np.int64),
        count=choice.count or 0,
        flows=tuple(flow for flow in flows if flow.arrivals.rate_per_h > 0 and max(flow.arrivals.profile, default=1.0) > 0),
        groups=choice.groups or EVERYBODY,
        fields=choice.fields if choice.fields.active else None,
        seed=seed,
    )
    reachable = joint_places(people)
    if not any(reachable):
        raise ScenarioError(f"{file.at('people')}: nobody can walk anywhere on '{graph.name}': no two places are joined by free space")
    for i, flow in enumerate(flows):
        if not any(end in reachable[origin] for origin in flow.origins for end in flow.destinations):
            raise ScenarioError(f"{file.at('people', 'flows', i)}: no way leads from its origins to its destinations")
    return people


class _Places:
    """Places that have been named or drawn, each once."""

    def __init__(self, file: ScenarioFile, nav: NavGraph, floor: Floor) -> None:
        self.nav, self.floor, self.cells = nav, floor, list[int]()
        self._file, self._of_vertex = file, dict[int, int]()

    def named(self, place: Place, name: str) -> int:
        """The place at the vertex of a name."""
        vertex = self.nav.vertex_of_name.get(name)
        if vertex is None:
            known = [n for n in self.nav.vertex_name if n]
            raise ScenarioError(f"{self._file.at(*place)}: '{name}' is not a vertex of '{self.nav.name}'{nearest(name, known)}")
        v = self.at(vertex)
        if v < 0:
            raise ScenarioError(f"{self._file.at(*place)}: there is no room for people within a metre of '{name}'")
        return v

    def at(self, vertex: int) -> int:
        """The place at a vertex; -1 where there is no room."""
        if vertex not in self._of_vertex:
            cell = self.floor.place_at(self.nav.xy[vertex], BEFORE_LIFT_M if self.nav.vertex_options[vertex].get("lift") else SNAP_M)
            if cell < 0:
                return -1
            self._of_vertex[vertex] = len(self.cells)
            self.cells.append(cell)
        return self._of_vertex[vertex]


def _drawn(file: ScenarioFile, choice: PeopleChoice, places: _Places, seed: int) -> list[int]:
    """The places between which people walk where the scenario names none: those listed, else vertices with names, else any."""
    if choice.places is not None:
        return [places.named(("people", "places", i), name) for i, name in enumerate(choice.places)]
    if choice.flows is not None and all(flow.origin and flow.destination for flow in choice.flows):
        return []
    nav = places.nav
    named = [v for v in range(nav.num_vertices) if nav.vertex_name[v]]
    order: IntArray = np.random.default_rng([seed, DRAW]).permutation(named if len(named) > 1 else nav.num_vertices)
    vertices: list[int] = []
    for vertex in order.tolist():
        if len(vertices) == MOST_PLACES:
            break
        if (place := places.at(vertex)) >= 0:
            vertices.append(place)
    return vertices


def _flow(file: ScenarioFile, key: Place, choice: PeopleChoice, flow: FlowChoice, places: _Places, drawn: list[int]) -> Flow:
    def ends(field: str, names: list[str] | None) -> tuple[int, ...]:
        if names is None:
            return tuple(drawn)
        return tuple(places.named((*key, field, i), name) for i, name in enumerate(names))

    arrivals = _arrivals(flow.rate_per_h, choice.profile if flow.profile is None else flow.profile, choice.clock_h)
    return Flow(ends("origin", flow.origin), ends("destination", flow.destination), arrivals)


def _arrivals(rate_per_h: float, profile: list[float], clock_h: float) -> Arrivals:
    return Arrivals("poisson", rate_per_h, tuple(profile), clock_s=clock_h * HOUR_S)
