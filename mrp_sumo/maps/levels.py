"""Levels of a map: which are chosen, and how those that are driven on are laid out on one plane and joined by their lifts."""

from collections.abc import Mapping, Sequence
from itertools import permutations
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray, NavGraph, nav_like
from mrp_sumo.errors import ChoiceError, nearest
from mrp_sumo.maps.building import Building, Lift
from mrp_sumo.maps.lifts import LEAST_TRAVEL_M, Shift, ride_of

LEVEL_GAP_M = 5.0  # between levels on the plane
SCREEN = 1.5  # its width by its height
STOREY_M = 3.0  # where a map says nothing of heights


def level_choice(levels: Any, level: str | None, file: str) -> list[str]:
    """Names of the chosen levels: all by default."""
    names = [str(name) for name in levels] if isinstance(levels, Mapping) else []
    if level is not None and level not in names:
        raise ChoiceError(f"{file} has no level '{level}'{nearest(level, names)}")
    return names if level is None else [level]


def laid_out(nav: NavGraph, building: Building | None) -> dict[str, tuple[float, float]]:
    """Shift of each level, so that those the graph is on do not overlap; nothing for one level.

    They lie in rows, the first where it is drawn, in as many columns as show them largest on a screen; moved by whole metres.
    """
    driven = [k for k in range(len(nav.level_names)) if (nav.level == k).any()]
    if len(driven) < 2:
        return {}
    low, high = np.array([_extent(nav, k, building) for k in driven]).transpose(1, 0, 2)
    size = high - low + LEVEL_GAP_M + 1  # a metre for what is rounded
    num_columns = min(range(1, len(driven) + 1), key=lambda columns: _side_m(size, columns))
    row, column = np.divmod(np.arange(len(driven)), num_columns)
    right, down = (edges[k] for edges, k in zip(_edges(size, num_columns), (column, row)))
    by = np.stack([np.ceil(low[0, 0] + right - low[:, 0]), np.floor(high[0, 1] - down - high[:, 1])], 1)
    by = by + 0.0  # never -0
    by[0] = 0.0
    return {nav.level_names[k]: (x, y) for k, (x, y) in zip(driven, by.tolist())}


def _extent(nav: NavGraph, level: int, building: Building | None) -> tuple[FloatArray, FloatArray]:
    """Lower left and upper right corner of a level as it is drawn, in m."""
    xy = nav.xy[nav.level == level]
    if building is not None:
        xy = np.concatenate([xy, building.levels[nav.level_names[level]].wall_xy.reshape(-1, 2)])
    return xy.min(0), xy.max(0)


def _side_m(size: FloatArray, num_columns: int) -> float:
    """Height of the screen of the form `SCREEN` that holds levels of these sizes [K, 2] in so many columns."""
    right, down = _edges(size, num_columns)
    return float(max(right[-1] / SCREEN, down[-1]))


def _edges(size: FloatArray, num_columns: int) -> tuple[FloatArray, FloatArray]:
    """[C + 1] and [R + 1] where columns, and rows, of levels of these sizes [K, 2] begin, and the last ends."""
    row, column = np.divmod(np.arange(len(size)), num_columns)
    widths = [size[column == c, 0].max() for c in range(num_columns)]
    heights = [size[row == r, 1].max() for r in range(row[-1] + 1)]
    return np.cumsum([0.0, *widths]), np.cumsum([0.0, *heights])


def shifts_of(level_names: Sequence[str], shift: Shift) -> FloatArray:
    """[K, 2] how far each level is moved, in m."""
    return np.array([shift.get(name, (0.0, 0.0)) for name in level_names]).reshape(-1, 2)


def joined_by_lifts(nav: NavGraph, shift: Shift, elevation_m: Mapping[str, float], lifts: Mapping[str, Lift]) -> NavGraph:
    """The graph with levels laid out, and lanes between all stops of each lift, as long as it travels."""
    if not shift:
        return nav
    xy = nav.xy + shifts_of(nav.level_names, shift)[nav.level]
    driven = set(np.concatenate([nav.tail, nav.head]).tolist())
    stops: dict[str, dict[int, int]] = {}  # lift -> level -> the vertex in it, one with lanes if there is one
    for v in sorted(range(nav.num_vertices), key=lambda v: v not in driven):
        if lift := nav.vertex_options[v].get("lift"):
            stops.setdefault(lift, {}).setdefault(int(nav.level[v]), v)
    height = [elevation_m.get(name, STOREY_M * k) for k, name in enumerate(nav.level_names)]
    pairs: list[tuple[int, int]] = []
    length, options = [], []
    for lift, at in stops.items():
        for one, other in permutations(sorted(at, key=lambda level: (height[level], level)), 2):
            travel_m = abs(height[other] - height[one])
            pairs.append((at[one], at[other]))
            length.append(max(travel_m, LEAST_TRAVEL_M))
            options.append(ride_of(lift, lifts.get(lift), (nav.level_names[one], nav.level_names[other]), travel_m))
    order = np.argsort(nav.source_lane)
    return nav_like(
        nav,
        xy=xy,
        lanes=np.concatenate([np.stack([nav.tail, nav.head], axis=1)[order], np.array(pairs, np.int64).reshape(-1, 2)]),
        length_m=np.concatenate([nav.length_m[order], length]),
        speed_mps=np.concatenate([nav.speed_mps[order], np.full(len(pairs), np.inf)]),
        lane_options=[*(nav.lane_options[k] for k in order), *options],
    )
