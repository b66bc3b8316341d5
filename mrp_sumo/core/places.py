"""Places of a building as people name them: stations and crossings of the map, the aisles between them, doors and lifts.

Vertices of the plan graph are sorted into these, so that what happens at cells is reported by place. A map that is a grid of cells
itself has no names: its places are squares of cells.
"""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph, PlanGraph, frozen

BETWEEN = " \N{EN DASH} "  # the ends of an aisle, in its name
SQUARE = 5  # cells along a side of a square
NEAR = 1.01  # cells from a vertex of the map within which a cell belongs to it


@dataclass(frozen=True, eq=False)
class Places:
    """P places, and which of them each of V vertices of the plan graph belongs to."""

    name: tuple[str, ...]  # [P]
    kind: tuple[str, ...]  # [P] 'crossing', 'aisle', 'door', 'lift' or 'area'
    of_vertex: IntArray  # [V]


def places_of(graph: PlanGraph, nav: NavGraph) -> Places:
    """The places of a map, by the nearest vertex, or lane between vertices, of what was drawn."""
    if nav.num_vertices == graph.num_vertices:
        return _squares(graph)
    to_vertex = np.where(graph.level[:, None] == nav.level, np.hypot(*(graph.xy[:, None] - nav.xy).transpose(2, 0, 1)), np.inf)
    vertex, away_m = to_vertex.argmin(1), to_vertex.min(1)
    lanes = np.flatnonzero(nav.is_once)
    lane = lanes[_nearest_lane(graph.xy, nav.xy[nav.tail[lanes]], nav.xy[nav.head[lanes]])] if len(lanes) else np.zeros(len(vertex), int)
    at_vertex = (away_m <= NEAR * graph.cell_m) | (len(lanes) == 0)
    stop: dict[object, int] = {}  # of each lift, the first; all of them are one place
    first = np.array([stop.setdefault(options.get("lift") or v, v) for v, options in enumerate(nav.vertex_options)], np.int64)
    numbers, of_vertex = np.unique(np.where(at_vertex, first[vertex], nav.num_vertices + lane), return_inverse=True)
    name, kind = zip(*(_named(nav, k) for k in numbers.tolist()))
    return Places(name, kind, frozen(of_vertex.reshape(-1).astype(np.int64)))


def beside(nav: NavGraph, name: str) -> str:
    """The nearest vertex of the map with a name, and how far it is from a crossing or an aisle without one; '' of other places."""
    ends = [nav.vertex_of_name[end] for end in name.split(BETWEEN) if end in nav.vertex_of_name]
    named = np.array([v for v in range(nav.num_vertices) if nav.known_as(v) != f"v{v}"], np.int64)
    if not ends or not set(ends).isdisjoint(named.tolist()):
        return ""
    named = named[nav.level[named] == nav.level[ends[0]]]
    if not len(named):
        return ""
    away_m = np.hypot(*(nav.xy[named] - nav.xy[ends].mean(0)).T)
    return f"{away_m.min():.1f} m from {nav.known_as(int(named[away_m.argmin()]))}"


def _squares(graph: PlanGraph) -> Places:
    side = SQUARE * graph.cell_m
    cell = np.floor((graph.xy - graph.xy.min(0)) / side + 1e-9).astype(np.int64)
    square, of_vertex = np.unique(cell, axis=0, return_inverse=True)
    low = graph.xy.min(0) + square * side
    names = tuple(f"x {x:.0f} to {x + side:.0f} m, y {y:.0f} to {y + side:.0f} m" for x, y in low.tolist())
    return Places(names, ("area",) * len(names), frozen(of_vertex.reshape(-1).astype(np.int64)))


def _nearest_lane(xy: FloatArray, start: FloatArray, end: FloatArray) -> IntArray:
    """[V] the nearest of the straight lanes from `start` to `end`."""
    along = end - start
    share = np.clip(((xy[:, None] - start) * along).sum(2) / (along**2).sum(1), 0, 1)
    foot = start + share[..., None] * along
    nearest: IntArray = np.hypot(*(xy[:, None] - foot).transpose(2, 0, 1)).argmin(1)
    return nearest


def _named(nav: NavGraph, number: int) -> tuple[str, str]:
    """Name and kind of the place that is a vertex, or, numbered after these, a lane."""
    if number < nav.num_vertices:
        lift = nav.vertex_options[number].get("lift")
        return (str(lift), "lift") if lift else (nav.known_as(number), "crossing")
    lane = number - nav.num_vertices
    ends = nav.known_as(int(nav.tail[lane])) + BETWEEN + nav.known_as(int(nav.head[lane]))
    door = nav.lane_options[lane].get("door_name")
    return (str(door), "door") if door else (ends, "aisle")
