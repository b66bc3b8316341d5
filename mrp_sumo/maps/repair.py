"""Repairs of a nav graph, on request: ends that missed, crossings without a vertex, lanes too short, pieces that hang loose.

Open-RMF repairs nothing, and neither does loading. Each step takes a graph and returns the repaired one
with a line for every change, so that the user can judge it. Lanes through lifts are left alone.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph, PlanGraph, Properties, nav_like
from mrp_sumo.core.near import pairs_within
from mrp_sumo.errors import MapError, count
from mrp_sumo.maps.check import FOUND_ON_GRAPHS, check_graph, crossings, near_misses
from mrp_sumo.maps.finding import ordered
from mrp_sumo.maps.map import Map

SAME_PLACE_M = 0.01  # crossings this close are one

Lane = tuple[int, int, float, float, Properties]  # tail, head, length_m (0: the straight distance), speed_mps, options


def repair(
    map_: Map,
    *,
    snap_m: float | None = None,
    split_at_crossings: bool = False,
    join_short_m: float | None = None,
    only_largest: bool = False,
) -> tuple[Map, tuple[str, ...]]:
    """A map with repaired graph, and what was changed. Raises MapError for a grid, and a distance that is not above 0.

    `snap_m` joins lane ends that lie within this distance of a vertex or lane they are not on; `split_at_crossings` gives lanes that cross
    a common vertex; `join_short_m` joins the ends of lanes shorter than this, where one of them is a mere bend or junction; `only_largest`
    keeps the largest connected piece.
    """
    steps: list[Callable[[NavGraph], tuple[NavGraph, list[str]]]] = [
        *([partial(snap, within_m=snap_m)] if snap_m is not None else []),
        *([split_crossings] if split_at_crossings else []),
        *([partial(join_short, shorter_than_m=join_short_m)] if join_short_m is not None else []),  # others may leave short pieces
        *([largest_component] if only_largest else []),
    ]
    if steps and isinstance(map_.nav, PlanGraph):
        raise MapError(f"{map_.path.name} is a grid: there is nothing to snap, split or join")
    nav, changes = map_.nav, list[str]()
    for step in steps:
        nav, done = step(nav)
        changes += done
    if not changes:
        return map_, ()
    others = tuple(finding for finding in map_.findings if finding.kind not in FOUND_ON_GRAPHS)
    return replace(map_, nav=nav, findings=ordered(others + check_graph(nav)), changes=(*map_.changes, *changes)), tuple(changes)


def snap(nav: NavGraph, within_m: float) -> tuple[NavGraph, list[str]]:
    """Merge vertices that are not connected and lie within `within_m` of each other, then split lanes at vertices that close to them.

    Of two vertices the first stays, with the options of both; a vertex beside a lane stays where it is
    and the lane goes through it.
    """
    if not 0 < within_m < np.inf:
        raise MapError(f"the snapping distance is {within_m} m, expected a number above 0")
    nav, changes = _merged(nav, within_m)
    flat, lane_of = _drawn(nav)
    at: dict[int, list[tuple[float, int]]] = {}
    for level in range(len(nav.level_names)):
        on = np.flatnonzero(nav.level[flat[:, 0]] == level)
        vertex, which, away, along = near_misses(nav.xy, flat[on], within_m)
        for v, k, d, s in zip(vertex.tolist(), on[which].tolist(), away.tolist(), along.tolist()):
            at.setdefault(k, []).append((s, v))
            a, b = flat[k].tolist()
            changes.append(f"lane {nav.label(a)} - {nav.label(b)} goes through {nav.label(v)} now, {d:.3f} m beside it")
    stops = {lane_of[k]: [v for _, v in sorted(places)] for k, places in at.items()}
    return (_split(nav, stops) if stops else nav), changes


def split_crossings(nav: NavGraph) -> tuple[NavGraph, list[str]]:
    """Put a vertex where lanes cross without one, and split them there."""
    flat, lane_of = _drawn(nav)
    places: list[FloatArray] = []
    levels: list[int] = []
    stops: dict[int, list[tuple[float, int]]] = {}
    changes = []
    for level in range(len(nav.level_names)):
        on = np.flatnonzero(nav.level[flat[:, 0]] == level)
        i, j, at = crossings(nav.xy, flat[on])
        for a, b, place in zip(on[i].tolist(), on[j].tolist(), at):
            near = [n for n, p in enumerate(places) if levels[n] == level and np.hypot(*(p - place)) < SAME_PLACE_M]
            if near:
                number = near[0]
            else:
                number = len(places)
                places.append(place)
                levels.append(level)
                changes.append(f"vertex {nav.num_vertices + number} at ({place[0]:.2f}, {place[1]:.2f}) joins lanes that cross there")
            for k in (a, b):
                along = float(np.hypot(*(place - nav.xy[flat[k, 0]])))
                if all(v != nav.num_vertices + number for _, v in stops.get(lane_of[k], [])):
                    stops.setdefault(lane_of[k], []).append((along, nav.num_vertices + number))
    if not places:
        return nav, []
    return _split(nav, {k: [v for _, v in sorted(on)] for k, on in stops.items()}, np.array(places), levels), changes


def join_short(nav: NavGraph, shorter_than_m: float) -> tuple[NavGraph, list[str]]:
    """Join the ends of lanes that are too short, the shortest first, until none is left that can be joined.

    Of its ends the one goes that has no name and no properties, and of two such the one with fewer neighbours; its other lanes
    end at the vertex that stays, so they move by less than `shorter_than_m`. A lane stays as it is where both ends have a name or
    properties, or where it has some itself (a door, a mutex group).
    """
    if not 0 < shorter_than_m < np.inf:
        raise MapError(f"the length below which lanes are joined is {shorter_than_m} m, expected a number above 0")
    changes: list[str] = []
    label = [nav.label(v) for v in range(nav.num_vertices)]  # numbers of the graph as it was drawn
    while (joinable := _joinable(nav, shorter_than_m)) is not None:
        stays, goes, length_m = joinable
        changes.append(f"lane {label[stays]} - {label[goes]}, {length_m:.3f} m long, joined in {label[stays]}")
        stand_in = np.arange(nav.num_vertices)
        stand_in[goes] = stays
        nav = _joined(nav, stand_in)
        del label[goes]
    return nav, changes


def _joinable(nav: NavGraph, shorter_than_m: float) -> tuple[int, int, float] | None:
    """The vertex that stays, the one that goes, and the length, of the shortest lane whose ends can be joined."""
    plain = [not name and not any(options.values()) for name, options in zip(nav.vertex_name, nav.vertex_options)]
    degree = np.bincount(nav.tail, minlength=nav.num_vertices) + np.bincount(nav.head, minlength=nav.num_vertices)
    short = np.flatnonzero(nav.length_m < shorter_than_m - 1e-9)
    for lane in short[np.argsort(nav.length_m[short], kind="stable")].tolist():
        a, b = int(nav.tail[lane]), int(nav.head[lane])
        both = [nav.lane_options[k] for k in (lane, int(nav.reverse[lane])) if k >= 0]
        own = any(value for options in both for key, value in options.items() if key != "is_bidirectional")
        ends = sorted((v for v in (a, b) if plain[v]), key=lambda v: (degree[v], -v))
        if ends and not own:
            return a + b - ends[0], ends[0], float(nav.length_m[lane])
    return None


def largest_component(nav: NavGraph) -> tuple[NavGraph, list[str]]:
    """Drop everything but the largest connected piece, levels joined by lifts."""
    keep = nav.component == 0
    if keep.all():
        return nav, []
    named = [nav.label(v) for v in np.flatnonzero(~keep).tolist() if nav.vertex_name[v]]
    shown = f", among them {', '.join(named[:5])}{', ...' if len(named) > 5 else ''}" if named else ""
    number = np.cumsum(keep) - 1
    lanes = [(int(number[a]), int(number[b]), *rest) for a, b, *rest in _lanes(nav) if keep[a] and keep[b]]
    largest = _rebuilt(nav, lanes, np.flatnonzero(keep))
    dropped = nav.num_components - 1
    return largest, [f"{count(dropped, 'smaller piece')} with {np.count_nonzero(~keep)} vertices dropped{shown}"]


def _merged(nav: NavGraph, within_m: float) -> tuple[NavGraph, list[str]]:
    target = np.arange(nav.num_vertices)
    changes = []
    driven = nav.driven
    for level in range(len(nav.level_names)):
        on = driven[nav.level[driven] == level]
        if len(on) < 2:
            continue
        close = on[pairs_within(nav.xy[on], within_m)]
        for a, b in sorted(close.tolist()):
            joined = nav.lane_between(a, b) >= 0 or nav.lane_between(b, a) >= 0
            if not joined and target[a] == a and target[b] == b:
                target[b] = a
                apart = float(np.hypot(*(nav.xy[a] - nav.xy[b])))
                changes.append(f"vertex {nav.label(b)} merged into {nav.label(a)}, {apart:.3f} m away")
    if not changes:
        return nav, []
    options, names = list(nav.vertex_options), list(nav.vertex_name)
    for b in np.flatnonzero(target != np.arange(nav.num_vertices)):
        a = int(target[b])
        options[a] = {**options[b], **options[a]}
        names[a] = names[a] or names[b]
    return _joined(replace(nav, vertex_name=tuple(names), vertex_options=tuple(options)), target), changes


def _joined(nav: NavGraph, stand_in: IntArray) -> NavGraph:
    """The graph with each vertex replaced by the one that stands for it [V]; lanes that move are as long as they are straight."""
    keep = stand_in == np.arange(nav.num_vertices)
    number = (np.cumsum(keep) - 1)[stand_in]
    lanes = [(int(number[a]), int(number[b]), long if keep[a] and keep[b] else 0.0, v, o) for a, b, long, v, o in _lanes(nav)]
    return _rebuilt(nav, lanes, np.flatnonzero(keep))


def _drawn(nav: NavGraph) -> tuple[IntArray, IntArray]:
    """[D, 2] ends of lanes, a lane and its reverse once and those of lifts left out; and [D] the lanes."""
    once = nav.is_once & ~nav.is_ride
    return np.stack([nav.tail[once], nav.head[once]], axis=1), np.flatnonzero(once)


def _split(nav: NavGraph, stops: Mapping[int, list[int]], new_xy: FloatArray | None = None, new_level: Iterable[int] = ()) -> NavGraph:
    """The graph with lanes led through vertices; `stops` by lane, in order, for the reverse lane too."""
    through = {int(k): on for k, on in stops.items()}
    through |= {int(nav.reverse[k]): on[::-1] for k, on in through.items() if nav.reverse[k] >= 0}
    lanes: list[Lane] = []
    for k, (a, b, long, limit, options) in enumerate(_lanes(nav)):
        if k not in through:
            lanes.append((a, b, long, limit, options))
            continue
        pieces = [a, *through[k], b]
        for n, (tail, head) in enumerate(pairwise(pieces)):
            own = dict(options)  # docking belongs to the ends of the lane only
            if n > 0:
                own.pop("undock_name", None)
            if n < len(pieces) - 2:
                own.pop("dock_name", None)
            lanes.append((tail, head, 0.0, limit, own))
    return _rebuilt(nav, lanes, np.arange(nav.num_vertices), new_xy, new_level)


def _lanes(nav: NavGraph) -> list[Lane]:
    return list(zip(nav.tail.tolist(), nav.head.tolist(), nav.length_m.tolist(), nav.speed_mps.tolist(), nav.lane_options))


def _rebuilt(
    nav: NavGraph, lanes: Iterable[Any], keep: IntArray, new_xy: FloatArray | None = None, new_level: Iterable[int] = ()
) -> NavGraph:
    """The graph with other lanes; of repeated ones the first stays, those of no length go."""
    new_xy = np.zeros((0, 2)) if new_xy is None else new_xy
    xy = np.concatenate([nav.xy[keep], new_xy])
    lane_of: dict[tuple[int, int], Lane] = {}
    for a, b, long, limit, options in lanes:
        long = long or float(np.hypot(*(xy[a] - xy[b])))
        if a != b and long > 0:
            lane_of.setdefault((a, b), (a, b, long, limit, options))
    return nav_like(
        nav,
        xy=xy,
        lanes=list(lane_of),
        level=np.concatenate([nav.level[keep], np.array(list(new_level), np.int64)]),
        vertex_name=[nav.vertex_name[v] for v in keep] + [""] * len(new_xy),
        vertex_options=[nav.vertex_options[v] for v in keep] + [{}] * len(new_xy),
        length_m=[lane[2] for lane in lane_of.values()],
        speed_mps=[lane[3] for lane in lane_of.values()],
        lane_options=[lane[4] for lane in lane_of.values()],
    )
