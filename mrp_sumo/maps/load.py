"""Loading any map file: recognises the format by content and makes one `Map` of it.

Refuses formats it does not know, maps with nothing to drive on, and graphs and levels that do not exist.
"""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mrp_sumo.core.graph import BoolArray, NavGraph, PlanGraph, nav_graph
from mrp_sumo.errors import MapError, nearest
from mrp_sumo.maps.building import Building
from mrp_sumo.maps.cache import remembered
from mrp_sumo.maps.check import check_building, check_graph
from mrp_sumo.maps.finding import Finding, RefusedMap, ordered
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.movingai import is_grid, is_problem_set, map_of_problem_set, read_grid
from mrp_sumo.maps.readers.nav_graph import Misplaced, graph_of_document, origin_of_document, united_graph
from mrp_sumo.maps.readers.rmf.building_yaml import building_of, is_building
from mrp_sumo.maps.readers.rmf.generated_graph import nav_graph_documents
from mrp_sumo.maps.readers.ros_map import ROBOT_RADIUS_M, image_of, is_ros_map, read_ros_map
from mrp_sumo.maps.yaml_text import Text, parse, read_text

__all__ = ["Finding", "Map", "files_of", "load_map"]

GraphChoice = int | tuple[int, ...] | Literal["all"] | None

LARGE = 1_000_000  # characters; larger files are remembered
LEVEL_GAP_M = 5.0  # between levels that are laid side by side
REMEDY = {
    "no_lanes": "no lanes in any level: nothing to drive on ({})",
    "reference_level_without_measurement": "no measurement, coordinates would be pixels ({}): state the scale with --meters-per-pixel",
    "level_not_a_mapping": "{}, expected a mapping with vertices and lanes",
    "level_without_fiducials": "{}, so it cannot be placed: choose --level or add fiducials",
}


def load_map(
    path: Path,
    *,
    graph: GraphChoice = None,
    level: str | None = None,
    meters_per_pixel: float | None = None,
    cell_m: float = 0.4,
    robot_radius_m: float = ROBOT_RADIUS_M,
) -> Map:
    """Load a map.

    Parameters
    ----------
    path
        An RMF building or nav graph, a MovingAI grid or problem set, or a ROS occupancy map.
    graph
        Which graph of a building; several, or "all", are united as MRP-Bench does. By default the only or lowest one with lanes.
    level
        Which level; by default all that the graph is on, joined by lifts and laid side by side.
    meters_per_pixel
        Scale of a building's drawing, instead of its measurements.
    cell_m
        Side of the cells of a MovingAI grid, which has no unit, and of those laid over an occupancy map.
    robot_radius_m
        How much room a robot needs on an occupancy map.

    Raises
    ------
    MapError
        As the module and the format's reader refuse.
    """
    source = read_text(Path(path))
    if is_problem_set(source.text):
        source = read_text(map_of_problem_set(source))
    if is_grid(source.text):
        _only_for_buildings(source, graph, level, meters_per_pixel)
        return _from_grid(source, *read_grid(source, map_name(source.path), cell_m))
    if len(source.text) < LARGE:
        return _from_yaml(source, graph, level, meters_per_pixel, cell_m, robot_radius_m)
    choice = (str(source.path.resolve()), str(source.path), graph, level, meters_per_pixel, cell_m, robot_radius_m)
    content = f"{choice}\n{source.text}".encode()
    found = remembered("map", content, lambda: _from_yaml(source, graph, level, meters_per_pixel, cell_m, robot_radius_m))
    _read_only(found.nav)
    return found


def files_of(path: Path) -> tuple[Path, ...]:
    """The files that a map is read from: itself, the `.map` of a problem set, the image of an occupancy map.

    Raises
    ------
    MapError
        When one is missing, or the map is neither text nor YAML.
    """
    source = read_text(path)
    if is_problem_set(source.text):
        return path, map_of_problem_set(source)
    if is_grid(source.text) or len(source.text) >= LARGE or "image:" not in source.text:
        return (path,)
    document = parse(source)
    return (path, image_of(document, source)) if is_ros_map(document) else (path,)


def _from_yaml(
    source: Text, graph: GraphChoice, level: str | None, meters_per_pixel: float | None, cell_m: float, robot_radius_m: float
) -> Map:
    document = parse(source)
    if is_building(document):
        return _from_building(building_of(document, source, meters_per_pixel), graph, level)
    _only_for_buildings(source, graph, None, meters_per_pixel)
    if isinstance(document, Mapping) and "levels" in document:
        return _from_nav_graph(document, source, level)
    _only_for_buildings(source, None, level, None)
    if is_ros_map(document):
        return _from_grid(source, *read_ros_map(document, source, map_name(source.path), cell_m, robot_radius_m))
    raise source.fault("not a map this program reads (RMF building or nav graph, MovingAI .map or .scen, ROS map_server YAML)")


def _read_only(nav: NavGraph) -> None:
    """Pickling forgets that a graph's arrays must not be written to."""
    for value in vars(nav).values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)


def map_name(path: Path) -> str:
    """The name a map goes by: its file's, without the suffixes."""
    name = path.name
    for suffix in (".yaml", ".building", ".nav", ".map"):
        name = name.removesuffix(suffix)
    return name


def _from_building(building: Building, graph: GraphChoice, level: str | None) -> Map:
    building = replace(building, findings=ordered(building.findings + check_building(building)))
    _refuse(building, level)
    levels = _level_choice(building.levels, level, building.path.name)
    counts: dict[int, int] = {}
    for name in levels:
        for lane in building.levels[name].lanes:
            counts[lane.graph] = counts.get(lane.graph, 0) + 1
    if not counts:
        with_lanes = ", ".join(f"'{n}'" for n, lv in building.levels.items() if lv.lanes)
        raise MapError(f"{building.path.name}: level '{level}' has no lane; levels with lanes: {with_lanes}")
    if graph == "all":
        chosen = tuple(sorted(counts))
    elif graph is None:
        chosen = (min(counts),)
    else:
        chosen = (graph,) if isinstance(graph, int) else tuple(sorted(set(graph)))
    if missing := [g for g in chosen if g not in counts]:
        where = f"level '{level}' of " if level else ""
        graphs = ", ".join(f"{g} ({n} lanes)" for g, n in sorted(counts.items()))
        raise MapError(f"{where}{building.path.name} has no lane in graph {missing[0]}; graphs with lanes: {graphs}")
    documents = {g: d for g, d in nav_graph_documents(building).items() if g in chosen}
    name, source = map_name(building.path), str(building.path)
    if len(documents) == 1:
        nav = graph_of_document(documents[chosen[0]], name, levels=levels, origin_m=building.origin_m, source=source)
    else:
        nav = united_graph(documents.values(), name, levels=levels, origin_m=building.origin_m, source=source)
    shift = _side_by_side(nav, building)
    return Map(
        name=name,
        path=building.path,
        nav=_joined_by_lifts(nav, shift, {n: lv.elevation_m for n, lv in building.levels.items()}),
        building=building.moved(shift),
        findings=building.findings,
        graphs=tuple(building.graphs),
        chosen=chosen,
        documents=documents,
        origin_m=building.origin_m,
        level_shift_m=shift,
    )


def _from_nav_graph(document: Mapping[str, Any], source: Text, level: str | None) -> Map:
    levels = _level_choice(document["levels"] or {}, level, source.path.name)
    try:
        origin_m = origin_of_document(document)
        nav = graph_of_document(document, map_name(source.path), levels=levels, origin_m=origin_m, source=str(source.path))
    except Misplaced as fault:
        raise source.fault(str(fault), *fault.keys) from None
    if not nav.num_lanes:
        raise source.fault(f"no lanes: nothing to drive on ({nav.num_vertices} vertices)")
    shift = _side_by_side(nav, None)
    nav = _joined_by_lifts(nav, shift, {})
    return Map(
        name=nav.name, path=source.path, nav=nav, findings=check_graph(nav), documents={0: document}, origin_m=origin_m, level_shift_m=shift
    )


def _from_grid(source: Text, nav: PlanGraph, free: BoolArray) -> Map:
    pieces = tuple(finding for finding in check_graph(nav) if finding.kind == "several_components")
    return Map(name=nav.name, path=source.path, nav=nav, findings=pieces, free=free)


def _only_for_buildings(source: Text, graph: GraphChoice, level: str | None, meters_per_pixel: float | None) -> None:
    for what, given in (("graph", graph), ("level", level), ("scale in metres per pixel", meters_per_pixel)):
        if given is not None and not (what == "graph" and given in (0, "all")):
            raise source.fault(f"this kind of map has no {what} to choose")


def _refuse(building: Building, level: str | None) -> None:
    for finding in building.findings:
        if finding.severity == "refuse":
            if finding.kind == "level_without_fiducials" and level is not None:
                continue  # levels are not put together
            message = REMEDY[finding.kind].format(finding.details[0])
            raise RefusedMap(f"{building.path.name}: {message}", building.findings)


def _level_choice(levels: Any, level: str | None, file: str) -> list[str]:
    names = [str(name) for name in levels] if isinstance(levels, Mapping) else []
    if level is not None and level not in names:
        raise MapError(f"{file} has no level '{level}'{nearest(level, names)}")
    return names if level is None else [level]


def _side_by_side(nav: NavGraph, building: Building | None) -> dict[str, tuple[float, float]]:
    """How far to move each level so that those the graph is on do not overlap; nothing for one level."""
    driven = [k for k in range(len(nav.level_names)) if (nav.level == k).any()]
    shift: dict[str, tuple[float, float]] = {}
    if len(driven) < 2:
        return shift
    end = None
    for k in driven:
        name = nav.level_names[k]
        x = nav.xy[nav.level == k, 0]
        if building is not None:
            x = np.concatenate([x, building.levels[name].wall_xy[..., 0].ravel()])
        by = 0.0 if end is None else float(np.ceil(end + LEVEL_GAP_M - x.min()))
        shift[name] = (by, 0.0)
        end = x.max() + by
    return shift


def _joined_by_lifts(nav: NavGraph, shift: Mapping[str, tuple[float, float]], elevation_m: Mapping[str, float]) -> NavGraph:
    """The graph with levels laid side by side, and lanes between the stops of each lift, as long as it is high."""
    if not shift:
        return nav
    xy = nav.xy + np.array([shift.get(name, (0.0, 0.0)) for name in nav.level_names])[nav.level]
    stops: dict[str, dict[int, int]] = {}  # lift -> level -> the vertex in it
    for v, options in enumerate(nav.vertex_options):
        if options.get("lift"):
            stops.setdefault(options["lift"], {}).setdefault(int(nav.level[v]), v)
    height = [elevation_m.get(name, 3.0 * k) for k, name in enumerate(nav.level_names)]
    pairs: list[tuple[int, int]] = []
    length, options = [], []
    for lift, at in stops.items():
        served = sorted(at, key=lambda level: (height[level], level))
        for low, high in pairwise(served):
            pairs += [(at[low], at[high]), (at[high], at[low])]
            length += [max(height[high] - height[low], 1.0)] * 2
            options += [{"lift": lift}] * 2
    order = np.argsort(nav.source_lane)
    return nav_graph(
        name=nav.name,
        xy=xy,
        lanes=np.concatenate([np.stack([nav.tail, nav.head], axis=1)[order], np.array(pairs, np.int64).reshape(-1, 2)]),
        level_names=nav.level_names,
        level=nav.level,
        vertex_name=nav.vertex_name,
        vertex_options=nav.vertex_options,
        length_m=np.concatenate([nav.length_m[order], length]),
        speed_mps=np.concatenate([nav.speed_mps[order], np.full(len(pairs), np.inf)]),
        lane_options=[*(nav.lane_options[k] for k in order), *options],
        source=nav.source,
    )
