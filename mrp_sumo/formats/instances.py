"""Problems from benchmark files: MovingAI `.map` with `.scen`, and libMultiRobotPlanning's YAML (grid or roadmap).

A step is one second and a cell one metre, since these formats have no units; robots are points. Cells are counted
from the upper left corner. Refuses robots that stand or go where nothing is free, more robots than the file has,
a `.scen` for a map of another size, and agents with different lists of potential goals.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import IntArray, PlanGraph, nav_graph, plan_graph
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import MapError, PlanError, nearest
from mrp_sumo.formats.peers import Cells, cells_of
from mrp_sumo.maps.grid import MAX_CELLS, grid_graph
from mrp_sumo.maps.readers.movingai import is_grid, occupancy, read_problem_set
from mrp_sumo.maps.yaml_text import Text, parse, read_text
from mrp_sumo.traffic.draw import uniform_draw

FARTHEST_M = 1e7  # of a vertex from the origin
POINT = RobotType("point", 0.2, 0.2, 1.0, 1.0, 1.0, 3.15, source="benchmark instances say nothing about robots")


@dataclass(frozen=True, eq=False)
class Instance:
    """A problem, and where its vertices lie on the file's grid."""

    problem: Problem
    cells: Cells | None  # None for a roadmap


def read_instance(map_path: Path, scen_path: Path | None = None, num_robots: int | None = None, seed: int = 0) -> Instance:
    """Read a problem: of a `.map` with the first rows of its `.scen`, or of a libMultiRobotPlanning YAML, which has its agents in it.

    Without a `.scen`, starts and goals are drawn in the largest component.
    Raises MrpSumoError as the module refuses, and as `Problem` does.
    """
    source = read_text(map_path)
    if num_robots is not None and num_robots < 0:
        raise PlanError(f"{num_robots} robots, expected 0 or more")
    if seed < 0:
        raise PlanError(f"the seed is {seed}, expected 0 or more")
    if not is_grid(source.text):
        if scen_path is not None:
            raise PlanError(f"{map_path.name} has its agents in it, but there is {scen_path.name} too")
        return _from_yaml(source, num_robots, seed)
    free = occupancy(source)
    graph = grid_graph(free, 1.0, (0.0, 0.0), name=map_path.stem, source=str(map_path))
    height, width = free.shape
    cells = _cells(graph)
    if scen_path is None:
        if num_robots is None:
            raise PlanError("the number of robots is missing: without a .scen they are drawn")
        start, goal = uniform_draw(graph, num_robots, seed)
        return Instance(_problem(graph, start, goal, seed), cells)
    rows = read_problem_set(read_text(scen_path))
    if (rows.width, rows.height) != (width, height):
        raise PlanError(f"{scen_path.name} is for a map of {rows.width} x {rows.height}, {map_path.name} has {width} x {height}")
    num_robots = _enough(len(rows.start), num_robots, scen_path.name)
    start = _vertices(rows.start[:num_robots], cells, scen_path.name, "starts at")
    goal = _vertices(rows.goal[:num_robots], cells, scen_path.name, "goes to")
    return Instance(_problem(graph, start, goal, seed), cells)


def problem_of_places(instance: Instance, places: list[list[Any]], name: str) -> Problem:
    """The problem on an instance's graph that paths of (column, row) or vertex names solve: from their first to their last places.

    Raises PlanError for a path without steps or with a place that is not a vertex, and for starts or goals that are not distinct.
    """
    graph, cells = instance.problem.graph, instance.cells
    ends = []
    for robot, path in enumerate(places):
        if not path:
            raise PlanError(f"{name}: robot_{robot} has no path")
        for place in (path[0], path[-1]):
            vertex = cells.vertex.get(place) if cells else graph.vertex_of_name.get(place)
            if vertex is None:
                raise PlanError(f"{name}: robot_{robot} is at {place}, which is not a vertex of '{graph.name}'")
            ends.append(vertex)
    start, goal = np.array(ends, np.int64).reshape(-1, 2).T
    return _problem(graph, start, goal, instance.problem.seed)


def _from_yaml(source: Text, num_robots: int | None, seed: int) -> Instance:
    document = parse(source)
    if not isinstance(document, Mapping) or not isinstance(document.get("agents"), list) or not {"map", "roadmap"} & document.keys():
        raise source.fault("neither a MovingAI map nor a libMultiRobotPlanning instance (map or roadmap, and agents)")
    agents = document["agents"]
    num_robots = _enough(len(agents), num_robots, source.path.name)
    for k, agent in enumerate(agents):
        if not isinstance(agent, Mapping) or "start" not in agent or not {"goal", "potentialGoals"} & agent.keys():
            raise source.fault(f"agents[{k}] has no start, or neither goal nor potentialGoals", "agents", k)
        if ("goal" in agent) != ("goal" in agents[0]):
            raise source.fault(f"agents[{k}] has {'a goal' if 'goal' in agent else 'no goal'}, unlike agents[0]", "agents", k)
    agents = agents[:num_robots]
    cells: Cells | None = None
    if "map" in document:
        graph, cells = _grid(source, document["map"])
    else:
        graph = _roadmap(source, document["roadmap"])

    def places(values: list[Any], what: str) -> IntArray:
        if cells is not None:
            return _vertices(_pairs(source, values, what), cells, source.path.name, what)
        return _named(source, values, graph, what)

    start = places([agent["start"] for agent in agents], "starts at")
    if agents and "goal" not in agents[0]:
        lists = [agent.get("potentialGoals") for agent in agents]
        if any(one != lists[0] for one in lists):
            raise source.fault("agents have different potentialGoals; only one list for all is understood", "agents")
        goal = places(list(lists[0]), "may go to")
        problem = Problem(graph, fleet_of(POINT, len(start)), start, goal, np.full(len(start), -1), 1.0, seed)
        return Instance(problem, cells)
    goal = places([agent.get("goal") for agent in agents], "goes to")
    return Instance(_problem(graph, start, goal, seed), cells)


def _grid(source: Text, grid: Any) -> tuple[PlanGraph, Cells]:
    size = grid.get("dimensions") if isinstance(grid, Mapping) else None
    if (
        not isinstance(size, list)
        or len(size) != 2
        or not all(type(n) is int and 0 < n < 100_000 for n in size)
        or math.prod(size) > MAX_CELLS
    ):
        raise source.fault(f"map.dimensions is {size!r:.40}, expected [width, height] of at most {MAX_CELLS:.0e} cells", "map")
    width, height = size
    free = np.ones((height, width), np.bool_)
    blocked = _pairs(source, grid.get("obstacles") or [], "map.obstacles has")
    if len(blocked):
        if (blocked < 0).any() or (blocked >= [width, height]).any():
            raise source.fault(f"map.obstacles has a cell outside {width} x {height}", "map", "obstacles")
        free[height - 1 - blocked[:, 1], blocked[:, 0]] = False
    graph = grid_graph(free, 1.0, (0.0, 0.0), name=source.path.stem, source=str(source.path))
    return graph, _cells(graph)


def _roadmap(source: Text, roadmap: Any) -> PlanGraph:
    vertices = roadmap.get("vertices") if isinstance(roadmap, Mapping) else None
    edges = roadmap.get("edges") if isinstance(roadmap, Mapping) else None
    if not isinstance(vertices, Mapping) or not isinstance(edges, list):
        raise source.fault("roadmap has no vertices (a mapping of names to [x, y]), or no edges (a list of pairs)", "roadmap")
    number = {str(name): v for v, name in enumerate(vertices)}
    xy = _floats(source, list(vertices.values()))
    lanes: dict[tuple[int, int], None] = {}
    for k, edge in enumerate(edges):
        if not isinstance(edge, list) or len(edge) != 2 or not {str(e) for e in edge} <= number.keys():
            raise source.fault(f"roadmap.edges[{k}] is {edge!r:.60}, expected two names of vertices", "roadmap", "edges", k)
        a, b = (number[str(e)] for e in edge)
        lanes[a, b] = None
        if roadmap.get("undirected", True):
            lanes[b, a] = None
    ends = np.array([lane for lane in lanes if lane[0] != lane[1]], np.int64).reshape(-1, 2)  # a lane to itself only says: may wait
    length = np.hypot(*(xy[ends[:, 1]] - xy[ends[:, 0]]).T) if len(ends) else np.zeros(0)
    nav = nav_graph(
        name=source.path.stem,
        xy=xy,
        lanes=ends,
        vertex_name=tuple(number),
        length_m=np.where(length > 0, length, 1.0),
        source=str(source.path),
    )
    cell_m = float(np.median(nav.length_m)) if nav.num_lanes else 1.0
    return plan_graph(nav, kind="roadmap", cell_m=cell_m, vertex_of_station=np.arange(len(xy)))


def _cells(graph: PlanGraph) -> Cells:
    cells = cells_of(graph)
    if cells is None:
        raise MapError(f"{graph.name}: no free cell")
    return cells


def _problem(graph: PlanGraph, start: IntArray, goal: IntArray, seed: int) -> Problem:
    return Problem(graph, fleet_of(POINT, len(start)), start, goal, np.arange(len(start)), 1.0, seed)


def _enough(available: int, wanted: int | None, name: str) -> int:
    if wanted is not None and wanted > available:
        raise PlanError(f"{name} has {available} robots, {wanted} are wanted")
    return available if wanted is None else wanted


def _vertices(places: IntArray, cells: Cells, name: str, what: str) -> IntArray:
    vertices = [cells.vertex.get((int(x), int(y)), -1) for x, y in places]
    if -1 in vertices:
        k = vertices.index(-1)
        x, y = (int(c) for c in places[k])
        state = "blocked" if 0 <= x < cells.width and 0 <= y < cells.height else "off the map"
        raise PlanError(f"{name}: robot_{k} {what} cell ({x}, {y}), which is {state}")
    return np.array(vertices, np.int64)


def _named(source: Text, values: list[Any], graph: PlanGraph, what: str) -> IntArray:
    for k, value in enumerate(values):
        if str(value) not in graph.vertex_of_name:
            raise source.fault(f"robot_{k} {what} '{value}', which is not a vertex{nearest(str(value), graph.vertex_of_name)}")
    return np.array([graph.vertex_of_name[str(value)] for value in values], np.int64)


def _pairs(source: Text, values: Any, what: str) -> IntArray:
    if not isinstance(values, list):
        raise source.fault(f"{what} {values!r:.40}, expected a list of [x, y]")
    for k, value in enumerate(values):
        if not isinstance(value, list) or len(value) != 2 or not all(type(n) is int and abs(n) < 2**31 for n in value):
            raise source.fault(f"{what} {value!r:.40} at position {k}, expected [x, y]")
    return np.array(values, np.int64).reshape(-1, 2)


def _floats(source: Text, values: list[Any]) -> Any:
    for k, value in enumerate(values):
        if not isinstance(value, list) or len(value) != 2 or not all(isinstance(n, int | float) and abs(n) < FARTHEST_M for n in value):
            raise source.fault(f"roadmap.vertices has {value!r:.40} at position {k}, expected [x, y]", "roadmap", "vertices")
    return np.array(values, np.float64).reshape(-1, 2)
