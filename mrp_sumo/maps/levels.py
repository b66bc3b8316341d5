"""Levels of a map: which are chosen, and how those that are driven on are laid side by side and joined by their lifts."""

from collections.abc import Mapping, Sequence
from itertools import permutations
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray, NavGraph, nav_graph
from mrp_sumo.errors import MapError, nearest
from mrp_sumo.maps.building import Building, Lift
from mrp_sumo.maps.lifts import LEAST_TRAVEL_M, Shift, ride_of

LEVEL_GAP_M = 5.0  # between levels that are laid side by side
STOREY_M = 3.0  # where a map says nothing of heights


def level_choice(levels: Any, level: str | None, file: str) -> list[str]:
    """Names of the chosen levels: all by default."""
    names = [str(name) for name in levels] if isinstance(levels, Mapping) else []
    if level is not None and level not in names:
        raise MapError(f"{file} has no level '{level}'{nearest(level, names)}")
    return names if level is None else [level]


def side_by_side(nav: NavGraph, building: Building | None) -> dict[str, tuple[float, float]]:
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


def shifts_of(level_names: Sequence[str], shift: Shift) -> FloatArray:
    """[K, 2] how far each level is moved, in m."""
    return np.array([shift.get(name, (0.0, 0.0)) for name in level_names]).reshape(-1, 2)


def joined_by_lifts(nav: NavGraph, shift: Shift, elevation_m: Mapping[str, float], lifts: Mapping[str, Lift]) -> NavGraph:
    """The graph with levels laid side by side, and lanes between all stops of each lift, as long as it travels."""
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
