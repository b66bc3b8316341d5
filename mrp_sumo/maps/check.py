"""Oddities of a building's nav graphs: pieces, near misses, crossings, lifts out of plumb, stations without a lane.

Everything is measured graph by graph on the graphs as drawn, levels joined by lifts. Distances in m.
"""

from collections import Counter

import numpy as np

from mrp_sumo.core.digraph import strong_components, weak_components
from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph
from mrp_sumo.errors import MapError, listed
from mrp_sumo.maps.boxes import boxes_of, overlapping
from mrp_sumo.maps.building import Building, Level
from mrp_sumo.maps.finding import MapFinding, Notes, RefusedMap

NEAR_MISS_M = 0.15  # closer to a lane, a vertex was probably meant to be on it
MISALIGNED_M = 0.1  # the fleet adapter refuses lift vertices further apart
SHORTEST_LANE_M = 1e-3
VERY_SLOW_MPS = 0.02  # below, a limit is probably a placeholder: a metre takes a minute
NEEDS_LANE = (
    "is_charger",
    "is_parking_spot",
    "is_holding_point",
    "is_passthrough_point",
    "spawn_robot_name",
    "spawn_robot_type",
    "dock_name",
    "pickup_dispenser",
    "dropoff_ingestor",
    "lift_cabin",
)

FOUND_ON_GRAPHS = frozenset({"t_junction_near_miss", "lanes_cross_without_vertex", "several_components", "not_strongly_connected"})


def check_building(building: Building) -> tuple[MapFinding, ...]:
    """The findings about the building's graphs."""
    notes = Notes()
    for level in building.levels.values():
        _note_stations(notes, level)
    lifts = {name: building.lift_of_vertex(level) for name, level in building.levels.items()}
    for graph in building.graphs:
        ends = {
            name: np.array([(x.start, x.end) for x in lv.lanes if x.graph == graph], np.int64).reshape(-1, 2)
            for name, lv in building.levels.items()
        }
        for name, level in building.levels.items():
            which = np.array([i for i, lane in enumerate(level.lanes) if lane.graph == graph], np.int64)
            if len(which):
                _note_duplicates(notes, level, graph, which, ends[name])
                for v, i, d, _ in zip(*near_misses(level.xy, ends[name], NEAR_MISS_M)):
                    notes.add("t_junction_near_miss", f"graph {graph} level {name} vertex {v} near lane {which[i]}: {d:.3f} m")
                for i, j, (x, y) in zip(*crossings(level.world_xy, ends[name])):
                    place = f"lanes {which[i]} and {which[j]} at ({x:.2f}, {y:.2f})"
                    notes.add("lanes_cross_without_vertex", f"graph {graph} level {name} {place}")
        _note_names(notes, building, graph, ends)
        _note_pieces(notes, building, graph, ends, lifts)
        _note_lifts(notes, building, graph, ends, lifts)
    return notes.findings()


def check_graph(nav: NavGraph) -> tuple[MapFinding, ...]:
    """The findings about a graph without a building, or after repairs; numbers are those of the graph's vertices."""
    notes = Notes()
    bend = nav.having("is_bend")
    for k, name in enumerate(nav.level_names):
        on = nav.is_once & ~nav.is_ride & (nav.level[nav.tail] == k)
        ends = np.stack([nav.tail[on], nav.head[on]], axis=1)

        def lane(i: int, ends: IntArray = ends) -> str:
            return f"{nav.label(ends[i, 0])} - {nav.label(ends[i, 1])}"

        for v, i, d, _ in zip(*near_misses(nav.xy, ends, NEAR_MISS_M)):
            if bend[v] or bend[ends[i]].any():
                continue  # curves come close where they merge
            notes.add("t_junction_near_miss", f"level {name} vertex {nav.label(v)} near lane {lane(i)}: {d:.3f} m")
        for i, j, (x, y) in zip(*crossings(nav.xy, ends)):
            notes.add("lanes_cross_without_vertex", f"level {name} lanes {lane(i)} and {lane(j)} at ({x:.2f}, {y:.2f})")
    for i in np.flatnonzero(nav.speed_mps < VERY_SLOW_MPS).tolist():
        notes.add("very_slow_lanes", f"from {nav.label(nav.tail[i])} to {nav.label(nav.head[i])}: {nav.speed_mps[i]:g} m/s")
    sizes = np.sort(np.unique(nav.component[nav.driven], return_counts=True)[1])[::-1]
    weak = len(sizes)
    if weak > 1:
        notes.add("several_components", f"sizes {listed(sizes.tolist(), 20)}", weak)
    strong = len(np.unique(strong_components(nav.num_vertices, nav.tail, nav.head)[nav.driven]))
    if strong > weak:
        notes.add("not_strongly_connected", f"{strong} strong, {weak} weak components")
    return notes.findings()


def findings_of(error: MapError) -> tuple[MapFinding, ...]:
    """The findings for which a map was refused."""
    if isinstance(error, RefusedMap):
        return error.findings
    return (MapFinding("unreadable", "refuse", 1, (str(error),)),)


def near_misses(xy: FloatArray, ends: IntArray, within_m: float) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Vertices close to the interior of a lane they are not on, and not close to its ends: vertex, lane, distance, place along it in m.

    One entry a pair, by vertex, then lane.
    """
    vertices = np.unique(ends)
    a, b = xy[ends[:, 0]], xy[ends[:, 1]]
    lane, near = overlapping(boxes_of(a, b, within_m), np.tile(xy[vertices], 2))
    vertex = vertices[near]
    off = (ends[lane] != vertex[:, None]).all(axis=1)
    lane, vertex = lane[off], vertex[off]
    ab, ap = b[lane] - a[lane], xy[vertex] - a[lane]
    long = np.hypot(*ab.T)
    safe = np.maximum(long, 1e-12)
    along = (ab * ap).sum(axis=1) / safe
    away = np.abs(ab[:, 0] * ap[:, 1] - ab[:, 1] * ap[:, 0]) / safe
    hit = (along > 0) & (along < long) & (away < within_m)
    hit &= (np.hypot(*ap.T) > within_m) & (np.hypot(*(xy[vertex] - b[lane]).T) > within_m)
    order = np.flatnonzero(hit)[np.lexsort((lane[hit], vertex[hit]))]
    return vertex[order], lane[order], away[order], along[order]


def crossings(xy: FloatArray, ends: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs of lanes [2 arrays, ascending] that cross within both, without a common vertex, and where [N, 2]."""
    i, j, place = strokes_crossed(xy, ends, ends)
    apart = (i < j) & (ends[i][:, :, None] != ends[j][:, None, :]).all(axis=(1, 2))
    return i[apart], j[apart], place[apart]


def strokes_crossed(xy: FloatArray, lanes: IntArray, strokes: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Lanes that cross a stroke (a wall, a door, another lane) within both: lane, stroke, place [N, 2]; of ends [L, 2] and [S, 2]."""
    (a, b), (c, d) = ((xy[ends[:, 0]], xy[ends[:, 1]]) for ends in (lanes, strokes))
    i, j = overlapping(boxes_of(a, b), boxes_of(c, d))
    r, s, q = b[i] - a[i], d[j] - c[j], c[j] - a[i]
    det = r[:, 0] * s[:, 1] - r[:, 1] * s[:, 0]
    safe = np.where(det == 0, 1.0, det)
    t, u = (q[:, 0] * s[:, 1] - q[:, 1] * s[:, 0]) / safe, (q[:, 0] * r[:, 1] - q[:, 1] * r[:, 0]) / safe
    hit = (det != 0) & (t > 0) & (t < 1) & (u > 0) & (u < 1)
    return i[hit], j[hit], a[i[hit]] + t[hit, None] * r[hit]


def _note_stations(notes: Notes, level: Level) -> None:
    on_lane = set(level.lane_vertices.tolist())
    for v, options in enumerate(level.vertex_options):
        if options and v not in on_lane:
            wants = [key for key in NEEDS_LANE if key in options]  # false ones too: somebody meant the vertex for robots
            if wants:
                named = f" '{level.vertex_name[v]}'" if level.vertex_name[v] != "" else ""
                notes.add("robot_vertex_off_lanes", f"level {level.name} vertex {v}{named}: {', '.join(wants)}")


def _note_duplicates(notes: Notes, level: Level, graph: int, which: IntArray, ends: IntArray) -> None:
    pairs: dict[tuple[int, int], list[int]] = {}
    for i, (a, b) in zip(which.tolist(), ends.tolist()):
        if a == b or np.hypot(*(level.xy[a] - level.xy[b])) < SHORTEST_LANE_M:
            notes.add("lane_without_length", f"graph {graph} level {level.name} lane {i} from vertex {a} to {b}")
        else:
            pairs.setdefault((min(a, b), max(a, b)), []).append(i)
    for (a, b), lanes in pairs.items():
        if len(lanes) > 1:
            notes.add("duplicate_lanes", f"graph {graph} level {level.name}: lanes {', '.join(map(str, lanes))} join vertices {a} and {b}")


def _note_names(notes: Notes, building: Building, graph: int, ends: dict[str, IntArray]) -> None:
    """Names that Open-RMF's fleet adapter would refuse; here the later vertices get a number."""
    labels = (level.vertex_name[v] for name, level in building.levels.items() for v in np.unique(ends[name]).tolist())
    for label, times in Counter(str(label) for label in labels if label != "").items():
        if times > 1:
            notes.add("name_twice_in_graph", f"graph {graph}: '{label}' names {times} vertices")


def _note_pieces(notes: Notes, building: Building, graph: int, ends: dict[str, IntArray], lifts: dict[str, dict[int, str]]) -> None:
    """Weak and strong components of a graph over all levels."""
    base = dict(zip(building.levels, np.cumsum([0] + [len(lv.xy) for lv in building.levels.values()]).tolist()))
    tail, head = [], []
    for name, level in building.levels.items():
        both = np.array([lane.is_bidirectional for lane in level.lanes if lane.graph == graph], np.bool_)
        a, b = (ends[name] + base[name]).T
        tail += [a, b[both]]
        head += [b, a[both]]
    used = np.unique(np.concatenate(tail + head))
    stop: dict[str, int] = {}
    for name in building.levels:
        for v in np.unique(ends[name]).tolist():
            if lift := lifts[name].get(v):
                other = stop.setdefault(lift, v + base[name])
                tail += [[v + base[name], other]]
                head += [[other, v + base[name]]]
    tails, heads = (np.searchsorted(used, np.concatenate(x)) for x in (tail, head))
    sizes = sorted(np.bincount(weak_components(len(used), tails, heads)).tolist(), reverse=True)
    weak, strong = len(sizes), int(strong_components(len(used), tails, heads).max(initial=-1)) + 1
    if weak > 1:
        notes.add("several_components", f"graph {graph}: sizes {listed(sizes, 20)}", weak)
    if strong > weak:
        notes.add("not_strongly_connected", f"graph {graph}: {strong} strong, {weak} weak components")


def _note_lifts(notes: Notes, building: Building, graph: int, ends: dict[str, IntArray], lifts: dict[str, dict[int, str]]) -> None:
    places: dict[str, list[FloatArray]] = {}
    for name, level in building.levels.items():
        for v in np.unique(ends[name]).tolist():
            if lift := lifts[name].get(v):
                places.setdefault(lift, []).append(level.world_xy[v])
            cabin = level.vertex_options[v].get("lift_cabin")
            if cabin and cabin != lift:
                inside = f"inside '{lift}'" if lift else "in no lift"
                notes.add("lift_cabin_mismatch", f"graph {graph} level {name} vertex {v}: lift_cabin {cabin}, {inside}")
    for lift, at in places.items():
        xy = np.array(at)
        apart = float(np.hypot(*(xy[:, None] - xy[None]).T).max())
        if apart > MISALIGNED_M:
            notes.add("lift_vertices_misaligned", f"graph {graph} lift {lift}: {apart:.3f} m")
