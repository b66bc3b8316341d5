"""The key facts of a map, for people to compare and machines to read."""

from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray, NavGraph
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
    nav = map_.nav
    is_of_no_use = map_.free is None and bool(len(np.unique(nav.level)) > 1 or too_large(nav, cell_m))
    return {
        "levels": driven_levels(nav),
        "graphs": list(map_.graphs),
        "vertices": nav.num_vertices,
        "edges": num_drawn_edges(nav),
        "components": num_driven_components(nav),
        "extent_m": extent_m(map_),
        "lane_extent_m": _extent(nav.xy[nav.driven]),
        "warnings": [finding.document() for finding in map_.findings],
        "grid": None if is_of_no_use else grid_facts(nav, cell_m, map_.free),
    }


def driven_levels(nav: NavGraph) -> list[str]:
    """Levels with vertices that have lanes."""
    return [name for k, name in enumerate(nav.level_names) if (nav.level[nav.driven] == k).any()]


def num_drawn_edges(nav: NavGraph) -> int:
    """A lane and its reverse counted once, without rides in lifts."""
    return int(np.count_nonzero(nav.is_once & ~nav.is_ride))


def num_driven_components(nav: NavGraph) -> int:
    """Connected pieces that have lanes, levels joined by lifts."""
    return len(np.unique(nav.component[nav.driven]))


def extent_m(map_: Map) -> list[float]:
    """Width and height of lanes with walls; of several levels, as they are laid side by side."""
    nav = map_.nav
    walls = [map_.building.levels[name].wall_xy.reshape(-1, 2) for name in driven_levels(nav)] if map_.building else []
    return _extent(np.concatenate([nav.xy[nav.driven], *walls]))


def _extent(xy: FloatArray) -> list[float]:
    return [round(float(side), 3) for side in np.ptp(xy, axis=0)] if len(xy) else [0.0, 0.0]
