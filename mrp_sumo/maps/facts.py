"""The key facts of a map, for people to compare and machines to read."""

from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph, PlanGraph
from mrp_sumo.maps.grid import grid_facts, too_large
from mrp_sumo.maps.map import Map


def facts(map_: Map, cell_m: float = 0.4) -> dict[str, Any]:
    """Key facts of the chosen graphs of a map.

    `levels` and `graphs` are those of the file with lanes. `vertices` counts a vertex once for every
    graph, `edges` counts a lane and its reverse once, without those through lifts. `components` counts
    the connected pieces that have lanes, levels joined by lifts. `extent_m` and `lane_extent_m` are
    [width, height] of lanes with walls and of lanes alone; of several levels, as they are laid side by
    side. `grid` are the counts of the paper's grid, None for several levels and for more cells than are of use.
    `warnings` are all findings.
    """
    nav, driven = map_.nav, driven_vertices(map_.nav)
    return {
        "levels": driven_levels(nav),
        "graphs": list(map_.graphs),
        "vertices": nav.num_vertices,
        "edges": nav.num_edges - num_lift_lanes(nav) // 2,
        "components": num_driven_components(nav),
        "extent_m": extent_m(map_),
        "lane_extent_m": _extent(nav.xy[driven]),
        "warnings": [finding.document() for finding in map_.findings],
        "grid": _grid(map_, cell_m),
    }


def driven_vertices(nav: NavGraph) -> IntArray:
    """Vertices that have lanes, ascending."""
    return np.unique(np.concatenate([nav.tail, nav.head]))


def driven_levels(nav: NavGraph) -> list[str]:
    """Levels with vertices that have lanes."""
    driven = driven_vertices(nav)
    return [name for k, name in enumerate(nav.level_names) if (nav.level[driven] == k).any()]


def num_driven_components(nav: NavGraph) -> int:
    """Connected pieces that have lanes, levels joined by lifts."""
    return len(np.unique(nav.component[driven_vertices(nav)]))


def extent_m(map_: Map) -> list[float]:
    """Width and height of lanes with walls; of several levels, as they are laid side by side."""
    nav = map_.nav
    walls = [map_.building.levels[name].wall_xy.reshape(-1, 2) for name in driven_levels(nav)] if map_.building else []
    return _extent(np.concatenate([nav.xy[driven_vertices(nav)], *walls]))


def num_lift_lanes(nav: NavGraph) -> int:
    """Lanes that lifts stand for, each direction once."""
    return sum("lift" in options for options in nav.lane_options)


def _extent(xy: FloatArray) -> list[float]:
    return [round(float(side), 3) for side in np.ptp(xy, axis=0)] if len(xy) else [0.0, 0.0]


def _grid(map_: Map, cell_m: float) -> dict[str, Any] | None:
    nav = map_.nav
    if isinstance(nav, PlanGraph) and map_.free is not None:
        (height, width), free = map_.free.shape, int(np.count_nonzero(map_.free))
        return {
            "cell_m": nav.cell_m,
            "width": width,
            "height": height,
            "total": map_.free.size,
            "free": free,
            "blocked": map_.free.size - free,
        }
    if len(np.unique(nav.level)) > 1 or too_large(nav, cell_m):
        return None
    return grid_facts(nav, cell_m)
