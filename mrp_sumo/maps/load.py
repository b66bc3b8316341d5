"""Loading any map file: recognises the format by content and makes one `Map` of it.

Refuses formats it does not know, maps with nothing to drive on, and graphs and levels that do not exist.
"""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mrp_sumo.core.graph import NavGraph, nav_graph
from mrp_sumo.errors import MapError, nearest
from mrp_sumo.maps.building import Building
from mrp_sumo.maps.check import check_building
from mrp_sumo.maps.finding import Finding, RefusedMap, ordered
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.nav_graph import graph_of_document, nav_graph_documents, united_graph
from mrp_sumo.maps.rmf import building_of, is_building
from mrp_sumo.maps.yaml_text import Text, parse, read_text

__all__ = ["Finding", "Map", "load_map"]

GraphChoice = int | Literal["all"] | None

LEVEL_GAP_M = 5.0  # between levels that are laid side by side
REMEDY = {
    "no_lanes": "no lanes in any level: nothing to drive on ({})",
    "reference_level_without_measurement": "no measurement, coordinates would be pixels ({}): state the scale with --meters-per-pixel",
    "level_not_a_mapping": "{}, expected a mapping with vertices and lanes",
    "level_without_fiducials": "{}, so it cannot be placed: choose --level or add fiducials",
}


def load_map(path: Path, *, graph: GraphChoice = None, level: str | None = None, meters_per_pixel: float | None = None) -> Map:
    """Load a map.

    Parameters
    ----------
    path
        An RMF building or nav graph.
    graph
        Which graph of a building; "all" unites them as MRP-Bench does. By default the only or lowest one with lanes.
    level
        Which level; by default all that the graph is on, joined by lifts and laid side by side.
    meters_per_pixel
        Scale of a building's drawing, instead of its measurements.

    Raises
    ------
    MapError
        As the module and the format's reader refuse.
    """
    path = Path(path)
    source = read_text(path)
    document = parse(source)
    if is_building(document):
        return _from_building(building_of(document, source, meters_per_pixel), graph, level)
    if isinstance(document, Mapping) and "levels" in document:
        return _from_nav_graph(document, source, level)
    raise source.fault("not a map this program reads (RMF building, RMF nav graph)")


def map_name(path: Path) -> str:
    """The name a map goes by: its file's, without the suffixes."""
    return path.name.removesuffix(".yaml").removesuffix(".building").removesuffix(".nav")


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
    chosen = tuple(sorted(counts)) if graph == "all" else (min(counts) if graph is None else graph,)
    if chosen[0] not in counts:
        where = f"level '{level}' of " if level else ""
        graphs = ", ".join(f"{g} ({n} lanes)" for g, n in sorted(counts.items()))
        raise MapError(f"{where}{building.path.name} has no lane in graph {graph}; graphs with lanes: {graphs}")
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
        nav = graph_of_document(document, map_name(source.path), levels=levels, source=str(source.path))
    except MapError as error:
        raise source.fault(str(error)) from None
    if not nav.num_lanes:
        raise source.fault(f"no lanes: nothing to drive on ({nav.num_vertices} vertices)")
    shift = _side_by_side(nav, None)
    return Map(name=nav.name, path=source.path, nav=_joined_by_lifts(nav, shift, {}), documents={0: document}, level_shift_m=shift)


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
