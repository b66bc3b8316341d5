"""Resources that robots must not share: vertices, zones where two places of the graph are closer than two robots may be, groups.

A place is a vertex or a track (the straight line of a lane, both directions; of one that is drawn as a curve, which vehicles follow, the
curve, too). Two places closer than the
fleet's separation R, neither an end of the other nor tracks that meet at a vertex, are a zone, with one robot at a
time. Tracks that meet are kept apart by their vertex: it is held until the robot is R away from every other track
there, R / sin(angle) along its own if they are straight and leave at an acute angle, and at most until the next vertex, which is
in a zone with that other track if it is still too close. Pairs of places keep their own zone, since merging
those that touch would swallow whole maps.

A mutex group is a set of places that only one robot at a time may be on, whatever the geometry: all vertices and lanes
whose option `mutex` (Open-RMF's) has one name, and vertices all of whose lanes belong to it. The cabin of a lift is one, too: what has
its name as option `cabin`. Rides in it are on no floor, so that they are near to nothing.

Robots of several types have a separation for each pair of types. A zone is then two places, and the types that need it at each: small
robots pass beside each other where a large one passes alone. At vertices, who leaves is far enough away for the largest.

Vehicles that change gear at a corner swing farther away from it than their radii count (`PlanGraph.beyond_m`): R is so much more there.

Together: a robot that holds the vertices and zones of its visits is R away from every other robot that holds its own.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.bezier import corners_of
from mrp_sumo.core.csr import ranges
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, NavGraph, PlanGraph, Properties, frozen
from mrp_sumo.core.near import pairs_within
from mrp_sumo.core.plan import Plan
from mrp_sumo.traffic.moves import MoveGraph
from mrp_sumo.traffic.passages import Needs

LEFT_M = 0.003  # before the lane's end a robot has left the vertex behind it at the latest
OF_CURVE_M = 0.01  # between a curve and its pieces; `RobotShape.aside_m`, which is for corners, has room for it


class Lines(NamedTuple):
    """P straight pieces of N places: one each, and those of curves beside it."""

    first: IntArray  # [N + 1] CSR
    piece: FloatArray  # [P, 2, 2] m, of tracks from their lower end
    share: FloatArray  # [P, 2] of the lane that is behind a robot where a piece begins and ends


@dataclass(frozen=True, eq=False)
class Resources:
    """Vertices, zones and groups of a graph with V vertices, L lanes, T tracks, Z zones and G groups, for robots of K types.

    Places are numbered: vertices 0 to V - 1, then tracks. Zone z is resource V + z, group g resource V + Z + g.
    """

    apart_m: FloatArray  # [K, K] least distance of two robots' centres, by type
    track: IntArray  # [L] of each lane
    ends: IntArray  # [T, 2] vertices of each track, the lower first
    leave_m: FloatArray  # [K, L] how far along a lane a robot frees its tail
    enter_m: FloatArray  # [K, L] how far before a lane's head a robot may stand while another holds the head
    zone: IntArray  # [Z, 2] places, the lower first; ascending
    zone_needs: BoolArray  # [Z, 2, K] the types that need a zone at either place
    group_name: tuple[str, ...]  # [G] ascending
    zones_first: IntArray  # [K (V + T) + 1] CSR: zones of each place for each type, type by type, and groups, numbered on from Z
    zones_of: IntArray
    lines: Lines  # of the places

    @property
    def num_zones(self) -> int:
        """Zones and groups."""
        return len(self.zone) + len(self.group_name)

    @property
    def num_vertices(self) -> int:
        return self.num_places - len(self.ends)

    @property
    def num_kinds(self) -> int:
        return len(self.apart_m)

    @property
    def num_places(self) -> int:
        return (len(self.zones_first) - 1) // self.num_kinds

    def zones_at(self, place: int, kind: int) -> IntArray:
        """Zones and groups of a place for a type of robots."""
        row = kind * self.num_places + place
        return self.zones_of[self.zones_first[row] : self.zones_first[row + 1]]

    @cached_property
    def groups_at(self) -> Mapping[int, frozenset[int]]:
        """The groups of each vertex that is in some; they are the same for all types."""
        count = np.diff(self.zones_first[: self.num_places + 1])
        place, zone = np.repeat(np.arange(self.num_places), count), self.zones_of[: self.zones_first[self.num_places]]
        groups: dict[int, set[int]] = {}
        for k in np.flatnonzero((zone >= len(self.zone)) & (place < self.num_vertices)).tolist():
            groups.setdefault(int(place[k]), set()).add(int(zone[k]) - len(self.zone))
        return {v: frozenset(of) for v, of in groups.items()}

    def on_lanes(self, lanes: BoolArray) -> "Resources":
        """The same resources, on a graph that has these lanes [L] only."""
        return replace(self, track=self.track[lanes], leave_m=self.leave_m[:, lanes], enter_m=self.enter_m[:, lanes])


def resources_of(graph: NavGraph, apart_m: float | FloatArray) -> Resources:
    """Resources of a graph for robots whose centres are at least `apart_m` apart, [K, K] by type. Levels do not meet."""
    apart = np.atleast_2d(np.asarray(apart_m, np.float64))
    return _resources_of(graph, len(apart), apart.tobytes())


@lru_cache(maxsize=2)  # retiming and driving ask for the same
def _resources_of(graph: NavGraph, num_kinds: int, apart: bytes) -> Resources:
    apart_m = np.frombuffer(apart, np.float64).reshape(num_kinds, num_kinds)
    if isinstance(graph, MoveGraph):
        return _of_states(graph, _resources_of(graph.base, num_kinds, apart))
    num_vertices = graph.num_vertices
    ends, track = np.unique(np.sort(np.stack([graph.tail, graph.head], 1), axis=1), axis=0, return_inverse=True)
    track = track.reshape(-1)
    on_floor = np.ones(len(ends), np.bool_)
    on_floor[track[graph.is_ride]] = False
    forward = graph.tail < graph.head
    leave, enter = np.zeros((2, num_kinds, graph.num_lanes))
    lines, beyond_m = _lines(graph, ends), _beyond_m(graph)
    curved = (np.diff(lines.first)[num_vertices:] > 1)[track]
    length_m, most_m = np.hypot(*(graph.xy[ends[:, 1]] - graph.xy[ends[:, 0]]).T), np.where(curved, graph.length_m - LEFT_M, np.inf)
    np.maximum.at(length_m, track[curved], graph.length_m[curved])
    for kind, separation in enumerate(apart_m.max(1)):
        at_low, at_high = _clearances(graph, ends, on_floor, float(separation) + beyond_m, lines, length_m)
        leave[kind] = np.minimum(np.where(forward, at_low[track], at_high[track]), most_m)
        enter[kind] = np.minimum(np.where(forward, at_high[track], at_low[track]), most_m)
    zone, zone_needs = _by_types(*_zones(graph, ends, on_floor, float(apart_m.max()), lines, beyond_m), apart_m)
    num_places = num_vertices + len(ends)
    group_name, grouped, group = _groups(graph, ends, track)
    place, which = [], []
    for kind in range(num_kinds):
        needed = zone_needs[:, :, kind].T.reshape(-1)
        place.append(kind * num_places + np.concatenate([zone.T.reshape(-1)[needed], grouped]))
        which.append(np.concatenate([np.tile(np.arange(len(zone)), 2)[needed], len(zone) + group]))
    at, of = np.concatenate(place), np.concatenate(which)
    order = np.lexsort((of, at))
    return Resources(
        apart_m=frozen(apart_m),
        track=frozen(track),
        ends=frozen(ends),
        leave_m=frozen(leave),
        enter_m=frozen(enter),
        zone=frozen(zone),
        zone_needs=frozen(zone_needs),
        group_name=group_name,
        zones_first=frozen(np.searchsorted(at[order], np.arange(num_kinds * num_places + 1)).astype(np.int64)),
        zones_of=frozen(of[order]),
        lines=lines,
    )


def _of_states(graph: MoveGraph, of_map: Resources) -> Resources:
    """The resources of a graph of moves: every vertex, zone and group of the map is a group of the states and moves that need it there."""
    base, num_kinds = graph.base, of_map.num_kinds
    ends, track = np.unique(np.sort(np.stack([graph.tail, graph.head], 1), axis=1), axis=0, return_inverse=True)
    track = track.reshape(-1)
    track_of = np.full(len(ends), -1)
    track_of[track] = base.num_vertices + of_map.track[graph.base_lane]
    of_place = np.concatenate([graph.place, track_of])  # [V' + T'] the place of the map
    behind = np.concatenate([graph.behind, np.full(len(ends), -1)])
    first, of = [np.zeros(1, np.int64)], []
    for kind in range(num_kinds):
        own = np.flatnonzero(of_place < base.num_vertices)
        parts = [(own, of_place[own])]
        for where in (of_place, behind):
            some = np.flatnonzero(where >= 0)
            begin = of_map.zones_first[kind * of_map.num_places + where[some]]
            count = np.diff(of_map.zones_first)[kind * of_map.num_places + where[some]]
            parts.append((np.repeat(some, count), base.num_vertices + of_map.zones_of[ranges(begin, count)]))
        parts.append((np.flatnonzero(behind >= 0), behind[behind >= 0]))
        pairs = np.unique(np.concatenate([at * (1 << 32) + group for at, group in parts]))
        first.append(first[-1][-1] + np.searchsorted(pairs >> 32, np.arange(1, len(of_place) + 1)))
        of.append(pairs & ((1 << 32) - 1))
    return Resources(
        apart_m=of_map.apart_m,
        track=frozen(track),
        ends=frozen(ends),
        leave_m=frozen(of_map.leave_m[:, graph.base_lane]),
        enter_m=frozen(of_map.enter_m[:, graph.base_lane]),
        zone=frozen(np.zeros((0, 2), np.int64)),
        zone_needs=frozen(np.zeros((0, 2, num_kinds), np.bool_)),
        group_name=(*(f"at {base.label(v)}" for v in range(base.num_vertices)), *map(str, range(len(of_map.zone))), *of_map.group_name),
        zones_first=frozen(np.concatenate(first).astype(np.int64)),
        zones_of=frozen(np.concatenate(of)),
        lines=of_map.lines,
    )


def needs_of(graph: NavGraph, plan: Plan, lane: IntArray, resources: Resources, kind: IntArray, behind: IntArray | None = None) -> Needs:
    """The needs of every visit: its vertex, the zones of its vertex and those of the track that leads to it.

    `lane` [N] is by which a visit is reached, -1 for first visits; `kind` [R] are types of the plan's robots; `behind` [N] vertices on
    which trailers stand then, -1: none; None: there are none.
    """
    num_visits, num_vertices = plan.num_visits, graph.num_vertices
    visit = np.arange(num_visits)
    moved = visit[lane >= 0]
    row = np.repeat(kind, np.diff(plan.first)) * resources.num_places
    parts = [(visit, plan.vertex, np.zeros(num_visits, np.bool_))]
    places = [(visit, row + plan.vertex, False), (moved, row[moved] + num_vertices + resources.track[lane[moved]], True)]
    if behind is not None:
        towing = visit[behind >= 0]
        parts.append((towing, behind[towing], np.zeros(len(towing), np.bool_)))
        places.append((towing, row[towing] + behind[towing], False))
    for some, place, only_lane in places:
        count = np.diff(resources.zones_first)[place]
        zones = resources.zones_of[ranges(resources.zones_first[place], count)]
        parts.append((np.repeat(some, count), num_vertices + zones, np.full(len(zones), only_lane)))
    of_visit, resource = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    on_lane = np.concatenate([part[2] for part in parts])
    order = np.lexsort((on_lane, resource, of_visit))
    of_visit, resource, on_lane = of_visit[order], resource[order], on_lane[order]
    first_of = np.ones(len(order), np.bool_)  # a visit needs a group once, though its lane and its vertex are in it
    first_of[1:] = (of_visit[1:] != of_visit[:-1]) | (resource[1:] != resource[:-1])
    of_visit, resource, on_lane = of_visit[first_of], resource[first_of], on_lane[first_of]
    return Needs(
        first=frozen(np.searchsorted(of_visit, np.arange(num_visits + 1)).astype(np.int64)),
        resource=frozen(resource),
        on_lane=frozen(on_lane),
        num_resources=num_vertices + resources.num_zones,
    )


class Course(NamedTuple):
    """N visits of a plan of R robots along their paths."""

    plan: Plan
    lane: IntArray  # [N] by which a visit is reached, -1 for first visits
    from_m: FloatArray  # [N] where that lane begins along its robot's path
    at_m: FloatArray  # [N] where the visit is
    stretch: FloatArray  # [L] how much longer a lane is on that path than in the graph: 1 but for lanes SUMO takes for longer
    kind: IntArray  # [R] types of the robots
    trailing_m: FloatArray | None = None  # [R] that trailers reach back beyond the circle of their robot; None: there are none


def left_after_m(graph: NavGraph, resources: Resources, course: Course, needs: Needs) -> FloatArray:
    """[M] how far along its path a robot has left what it needed, inf where it stays."""
    plan, lane, from_m, at_m, stretch, kind, trailing_m = course
    num_vertices = graph.num_vertices
    visit, resource = needs.visit, needs.resource
    onward = np.append(lane[1:], -1)[visit]  # lane by which the visit's vertex is left, -1: never
    used = np.where(needs.on_lane, lane[visit], onward)
    origin = np.where(needs.on_lane, from_m[visit], at_m[visit])
    after = np.full(len(visit), np.inf)
    shared = num_vertices + len(resources.zone)
    at_vertex = ((resource < num_vertices) | (resource >= shared) & ~needs.on_lane) & (used >= 0)
    of_visit = np.repeat(kind, np.diff(plan.first))[visit]
    after[at_vertex] = resources.leave_m[of_visit[at_vertex], used[at_vertex]]
    part = np.flatnonzero((resource >= num_vertices) & (resource < shared) & (used >= 0))
    pair = resources.zone[resource[part] - num_vertices]
    mine = np.where(needs.on_lane[part], num_vertices + resources.track[lane[visit[part]]], plan.vertex[visit[part]])
    second = (pair[:, 0] != mine).astype(np.int64)  # whether it is at the second place of the zone
    others = resources.zone_needs[resource[part] - num_vertices, 1 - second]  # [P, K] who needs it at the other
    beyond_m = np.append(_beyond_m(graph), np.zeros(len(resources.ends)))[pair].sum(1)
    radius_m = np.where(others, resources.apart_m[of_visit[part]], 0.0).max(1) + beyond_m
    along, back, other = num_vertices + resources.track[used[part]], graph.tail > graph.head, pair[np.arange(len(pair)), 1 - second]
    after[part] = _last_share(resources.lines, along, back[used[part]], other, radius_m) * graph.length_m[used[part]]
    if trailing_m is not None:
        held = ~needs.on_lane & (used >= 0)
        after[held] += np.repeat(trailing_m, np.diff(plan.first))[visit][held]
    limit = np.where(used >= 0, graph.length_m[used] - LEFT_M, np.inf)
    left: FloatArray = origin + np.minimum(after, limit) * np.where(used >= 0, stretch[used], 1.0)
    return left


def _beyond_m(graph: NavGraph) -> FloatArray:
    return graph.swing_m if isinstance(graph, PlanGraph) else np.zeros(graph.num_vertices)


def _lines(graph: NavGraph, ends: IntArray) -> Lines:
    piece = segments(graph, ends)
    straight = Lines(frozen(np.arange(len(piece) + 1)), frozen(piece), frozen(np.tile([0.0, 1.0], (len(piece), 1))))
    if not isinstance(graph, PlanGraph) or not graph.curves:
        return straight
    of, pieces, shares = [np.arange(len(piece))], [piece], [straight.share]
    for track, (a, b) in enumerate(ends.tolist()):
        for curve in _followed(graph, a, b):
            pieces.append(np.stack([curve[:-1, 1:], curve[1:, 1:]], 1))
            shares.append(np.stack([curve[:-1, 0], curve[1:, 0]], 1))
            of.append(np.full(len(curve) - 1, graph.num_vertices + track))
    place = np.concatenate(of)
    order, first = np.argsort(place, kind="stable"), np.append(0, np.cumsum(np.bincount(place)))
    return Lines(frozen(first), frozen(np.concatenate(pieces)[order]), frozen(np.concatenate(shares)[order]))


def _followed(graph: PlanGraph, a: int, b: int) -> list[FloatArray]:
    """[N, 3] the share of the lane that is behind a robot, x and y along the curves between two vertices, from the first of them."""
    curves: list[FloatArray] = []
    for tail, head in ((a, b), (b, a)):
        if (curve := graph.curves.get((tail, head))) is None or graph.lane_between(tail, head) < 0:
            continue
        line = np.column_stack([curve[:, 0] / curve[-1, 0], curve[:, 1:3]])
        line = line if tail == a else np.column_stack([1.0 - line[::-1, 0], line[::-1, 1:]])
        if not any(line.shape == other.shape and np.allclose(line, other, atol=1e-6) for other in curves):
            curves.append(line)
    return [line[corners_of(line[:, 1:], OF_CURVE_M)] for line in curves]


def segments(graph: NavGraph, ends: IntArray) -> FloatArray:
    """[V + T, 2, 2] the two ends of every place, m."""
    vertices = np.repeat(graph.xy[:, None, :], 2, axis=1)
    return np.concatenate([vertices, graph.xy[ends]])


def distance_m(a: FloatArray, b: FloatArray) -> FloatArray:
    """[N] distances of N pairs of segments [N, 2, 2]."""
    d = np.stack([_to_segment(a[:, 0], b), _to_segment(a[:, 1], b), _to_segment(b[:, 0], a), _to_segment(b[:, 1], a)]).min(0)
    da, db, between = a[:, 1] - a[:, 0], b[:, 1] - b[:, 0], b[:, 0] - a[:, 0]
    denominator = _cross(da, db)
    apart = np.abs(denominator) > 1e-12
    safe = np.where(apart, denominator, 1.0)
    s, t = _cross(between, db) / safe, _cross(between, da) / safe
    crossing = apart & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    return np.where(crossing, 0.0, d)


def _clearances(
    graph: NavGraph, ends: IntArray, on_floor: BoolArray, apart_m: FloatArray, lines: Lines, lane_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """[T] each, for the lower and the higher end of every track: from this far along it no other track at that vertex, nor the vertex, is
    closer than the separation there, `apart_m` [V]; at most its length less LEFT_M. Tracks that are not on a floor [T] are near to nothing.
    """
    num_tracks, xy = len(ends), graph.xy
    vertex = ends.T.reshape(-1)  # a half is a track seen from one of its ends
    along = xy[ends[:, 1]] - xy[ends[:, 0]]
    length = np.hypot(*along.T)
    direction = np.concatenate([along, -along]) / np.tile(length, 2)[:, None]
    order = np.argsort(vertex, kind="stable")
    first = np.searchsorted(vertex[order], np.arange(len(xy) + 1))
    degree = np.diff(first)[vertex]
    half = np.repeat(np.arange(2 * num_tracks), degree)
    other = order[ranges(first[vertex], degree)]
    meets = (half != other) & on_floor[half % num_tracks] & on_floor[other % num_tracks]
    half, other = half[meets], other[meets]
    separation = apart_m[vertex[half]]
    cos = (direction[half] * direction[other]).sum(1)
    sin = np.abs(_cross(direction[half], direction[other]))
    reach = length[other % num_tracks]  # how far the other track goes
    with np.errstate(divide="ignore", invalid="ignore"):
        beside = separation / sin  # beyond it, the other track's line is far enough
        beyond = reach * cos + np.sqrt(np.maximum(separation**2 - (reach * sin) ** 2, 0))  # beyond it, its end is
        clear = np.where(cos <= 0, separation, np.where(separation * cos <= reach * sin, beside, beyond))
    clearance_m = apart_m[vertex]
    np.maximum.at(clearance_m, half, clear)
    curved = np.diff(lines.first)[len(xy) :] > 1
    by_line = curved[half % num_tracks] | curved[other % num_tracks]
    bent = np.flatnonzero(np.tile(curved, 2))
    one = np.concatenate([half[by_line], bent])
    far = np.concatenate([len(xy) + other[by_line] % num_tracks, vertex[bent]])
    share = _last_share(lines, len(xy) + one % num_tracks, one >= num_tracks, far, apart_m[vertex[one]])
    np.maximum.at(clearance_m, one, share * lane_m[one % num_tracks])
    clearance_m = np.minimum(clearance_m, np.tile(lane_m, 2) - LEFT_M)
    return clearance_m[:num_tracks], clearance_m[num_tracks:]


def _zones(
    graph: NavGraph, ends: IntArray, on_floor: BoolArray, separation: float, lines: Lines, beyond_m: FloatArray
) -> tuple[IntArray, FloatArray]:
    """[P, 2] pairs of places closer than the separation that no vertex keeps apart, and [P] how far apart they are.

    Both less what robots need `beyond_m` [V] it at vertices.
    """
    num_vertices = graph.num_vertices
    if not len(ends):
        return np.zeros((0, 2), np.int64), np.zeros(0)
    piece, of = lines.piece, np.repeat(np.arange(len(lines.first) - 1), np.diff(lines.first))  # vertices have one piece each
    used = np.unique(ends[on_floor])
    # every piece is sampled in the middle of its parts, so that places closer than R have samples closer than `reach`
    length = np.hypot(*(piece[num_vertices:, 1] - piece[num_vertices:, 0]).T)
    parts = np.where(on_floor[of[num_vertices:] - num_vertices], np.maximum(1, np.ceil(length / (2 * separation)).astype(np.int64)), 0)
    owner = np.repeat(np.arange(len(parts)), parts)
    fraction = (ranges(0, parts) + 0.5) / parts[owner]
    sample = piece[num_vertices + owner, 0] + fraction[:, None] * (piece[num_vertices + owner, 1] - piece[num_vertices + owner, 0])
    half = float((length[parts > 0] / parts[parts > 0]).max(initial=0.0)) / 2
    point = np.concatenate([graph.xy[used], sample])
    owner = np.concatenate([used, num_vertices + owner])
    pair = pairs_within(point, separation + 2 * (half + float(beyond_m.max())))
    pair = np.sort(np.sort(owner[pair], axis=1) @ np.array([len(piece), 1]))
    pair = pair[np.diff(pair, prepend=-1) > 0]  # each once; np.unique takes ten times as long
    one, other = pair // len(piece), pair % len(piece)
    a, b = of[one], of[other]
    corner = np.stack([np.arange(num_vertices)] * 2, 1)
    corner = np.concatenate([corner, ends])
    meets = (corner[a][:, :, None] == corner[b][:, None, :]).any((1, 2))
    level = graph.level[corner[:, 0]]
    apart = ~meets & (level[a] == level[b])
    one, other = one[apart], other[apart]
    beyond_m = np.append(beyond_m, np.zeros(len(ends)))
    away_m = distance_m(piece[one], piece[other]) - (beyond_m[of[one]] + beyond_m[of[other]])
    close = away_m < separation - 1e-9
    key = of[one[close]] * (num_vertices + len(ends)) + of[other[close]]
    order = np.argsort(key, kind="stable")
    begin = np.flatnonzero(np.diff(key[order], prepend=-1))
    key = key[order][begin]
    pairs = np.stack([key // (num_vertices + len(ends)), key % (num_vertices + len(ends))], 1)
    return pairs, np.minimum.reduceat(away_m[close][order], begin) if len(begin) else np.zeros(0)


def _by_types(pair: IntArray, away_m: FloatArray, apart_m: FloatArray) -> tuple[IntArray, BoolArray]:
    """Zones of pairs of places [P, 2] that are so far apart [P]: [Z, 2] the places, and [Z, 2, K] the types that need the zone at each.

    Robots of two types exclude each other at two places that are closer than they may be. For each type at the first place, the zone is
    for all that it excludes at the second, and for all at the first that exclude at least these; so a place that excludes another has a
    zone with him, and nobody else has one.
    """
    excludes = away_m[:, None, None] < apart_m - 1e-9  # [P, K at the first place, K at the second]
    parts, first, second = [], [], []
    for kind in range(len(apart_m)):
        theirs = excludes[:, kind]
        known = np.zeros(len(pair), np.bool_)  # the zone of another type that excludes the same
        for other in range(kind):
            known |= (excludes[:, other] == theirs).all(1)
        new = np.flatnonzero(theirs.any(1) & ~known)
        parts.append(new)
        first.append((excludes[new] >= theirs[new][:, None]).all(2))
        second.append(theirs[new])
    which, needs = np.concatenate(parts), np.stack([np.concatenate(first), np.concatenate(second)], 1)
    order = np.argsort(which, kind="stable")
    return pair[which[order]], needs[order]


def groups_of(options: Properties) -> list[str]:
    """The names of the groups that a vertex or lane with these options is in."""
    names = [str(options["mutex"])] if options.get("mutex") else []
    return [*names, cabin_group(str(options["cabin"]))] if options.get("cabin") else names


def cabin_group(lift: str) -> str:
    return f"lift {lift}"


def _groups(graph: NavGraph, ends: IntArray, track: IntArray) -> tuple[tuple[str, ...], IntArray, IntArray]:
    at_vertex = [(name, v) for v, options in enumerate(graph.vertex_options) for name in groups_of(options)]
    on_track = {(name, int(track[lane])) for lane, options in enumerate(graph.lane_options) for name in groups_of(options)}
    names = tuple(sorted({name for name, _ in at_vertex} | {name for name, _ in on_track}))
    members: set[tuple[int, int]] = set()
    degree = np.bincount(ends.reshape(-1), minlength=graph.num_vertices)
    for g, name in enumerate(names):
        tracks = np.array(sorted(t for other, t in on_track if other == name), np.int64)
        inside = np.flatnonzero((np.bincount(ends[tracks].reshape(-1), minlength=graph.num_vertices) == degree) & (degree > 0))
        members.update((int(t) + graph.num_vertices, g) for t in tracks)
        members.update((v, g) for other, v in at_vertex if other == name)
        members.update((int(v), g) for v in inside)
    pairs = np.array(sorted(members), np.int64).reshape(-1, 2)
    return names, pairs[:, 0], pairs[:, 1]


def _last_share(lines: Lines, along: IntArray, back: BoolArray, other: IntArray, radius: FloatArray) -> FloatArray:
    """[N] the farthest share along each place, from its higher end where `back`, that is within a radius of the other; 0: nothing is."""
    if not len(along):
        return np.zeros(0)
    first, count = lines.first, np.diff(lines.first)
    pairs = count[along] * count[other]
    n = np.repeat(np.arange(len(along)), pairs)
    k = ranges(0, pairs)
    mine, theirs = first[along[n]] + k // count[other[n]], first[other[n]] + k % count[other[n]]
    piece, share = lines.piece[mine], lines.share[mine]
    piece = np.where(back[n][:, None, None], piece[:, ::-1], piece)
    share = np.where(back[n][:, None], 1.0 - share[:, ::-1], share)
    within = _last_within(piece, lines.piece[theirs], radius[n])
    last: FloatArray = np.maximum.reduceat(
        np.where(within > 0, share[:, 0] + within * (share[:, 1] - share[:, 0]), 0.0), np.cumsum(pairs) - pairs
    )
    return last


def _last_within(piece: FloatArray, target: FloatArray, radius: FloatArray) -> FloatArray:
    """[N] the farthest share along segments [N, 2, 2] that is closer than a radius [N] to the other segments, 0 if nothing is."""
    begin, along = piece[:, 0], piece[:, 1] - piece[:, 0]
    square = (along**2).sum(1)
    # what is close to a segment lies in discs around its ends and in a rectangle between them; all three together are
    # convex, so the lane leaves them where it leaves the last one
    leaves = np.zeros(len(piece))
    with np.errstate(divide="ignore", invalid="ignore"):
        for end in (0, 1):
            away = begin - target[:, end]
            half = (away * along).sum(1) / square
            root = np.sqrt(half**2 - ((away**2).sum(1) - radius**2) / square)  # NaN where the line misses the disc
            leaves = np.fmax(leaves, np.where(-half - root < 1.0, -half + root, 0.0))
        axis = target[:, 1] - target[:, 0]
        length = np.hypot(*axis.T)
        axis = axis / length[:, None]  # NaN for a vertex, which has no rectangle
        enters, exits = np.full(len(piece), -np.inf), np.full(len(piece), np.inf)
        for direction, low, high in ((axis, np.zeros(len(piece)), length), (np.stack([-axis[:, 1], axis[:, 0]], 1), -radius, radius)):
            place, pace = ((begin - target[:, 0]) * direction).sum(1), (along * direction).sum(1)
            one, two = (low - place) / pace, (high - place) / pace
            outside = (pace == 0) & ((place < low) | (place > high))
            parallel = (pace == 0) & ~outside
            enters = np.maximum(enters, np.where(parallel, -np.inf, np.where(outside, np.inf, np.minimum(one, two))))
            exits = np.minimum(exits, np.where(parallel, np.inf, np.maximum(one, two)))
        leaves = np.fmax(leaves, np.where((enters < exits) & (enters < 1.0), exits, 0.0))
    return np.clip(leaves, 0.0, 1.0)


def _to_segment(point: FloatArray, segment: FloatArray) -> FloatArray:
    """[N] distance of N points [N, 2] from N segments [N, 2, 2]."""
    along = segment[:, 1] - segment[:, 0]
    square = (along**2).sum(1)
    u = np.clip(((point - segment[:, 0]) * along).sum(1) / np.where(square > 0, square, 1.0), 0, 1)
    distance: FloatArray = np.hypot(*(point - segment[:, 0] - u[:, None] * along).T)
    return distance


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    product: FloatArray = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product
