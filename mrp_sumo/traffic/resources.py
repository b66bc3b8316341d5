"""What robots must not share: vertices, zones where two places of the graph are closer than two robots may be, groups.

A place is a vertex or a track (the straight line of a lane, both directions). Two places closer than the
fleet's separation R, neither an end of the other nor tracks that meet at a vertex, are a zone, with one robot at a
time. Tracks that meet are kept apart by their vertex: it is held until the robot is R away from every other track
there, R / sin(angle) along its own if they leave at an acute angle, and at most until the next vertex, which is
in a zone with that other track if it is still too close. Pairs of places keep their own zone, since merging
those that touch would swallow whole maps.

A mutex group is a set of places that only one robot at a time may be on, whatever the geometry: all vertices and lanes
whose option `mutex` (Open-RMF's) has one name, and vertices all of whose lanes belong to it. The cabin of a lift is one, too: what has
its name as option `cabin`. Rides in it are on no floor, so that they are near to nothing.

Together: a robot that holds the vertices and zones of its visits is R away from every other robot that holds its own.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, NavGraph, Options, frozen
from mrp_sumo.core.near import pairs_within
from mrp_sumo.core.plan import Plan
from mrp_sumo.traffic.passages import Needs

LEFT_M = 0.003  # before the lane's end a robot has left the vertex behind it at the latest


@dataclass(frozen=True, eq=False)
class Resources:
    """Vertices, zones and groups of a graph with V vertices, L lanes, T tracks, Z zones and G groups.

    Places are numbered: vertices 0 to V - 1, then tracks. Zone z is resource V + z, group g resource V + Z + g.
    """

    separation_m: float
    track: IntArray  # [L] of each lane
    ends: IntArray  # [T, 2] vertices of each track, the lower first
    leave_m: FloatArray  # [L] how far along a lane a robot frees its tail
    enter_m: FloatArray  # [L] how far before a lane's head a robot may stand while another holds the head
    zone: IntArray  # [Z, 2] places, the lower first; ascending
    group_name: tuple[str, ...]  # [G] ascending
    zones_first: IntArray  # [V + T + 1] CSR: zones of each place, and groups, numbered on from Z
    zones_of: IntArray

    @property
    def num_zones(self) -> int:
        """Zones and groups."""
        return len(self.zone) + len(self.group_name)


@lru_cache(maxsize=2)  # retiming and driving ask for the same
def resources_of(graph: NavGraph, separation_m: float) -> Resources:
    """Find them.

    Parameters
    ----------
    graph
        With straight lanes. Places on different levels do not meet.
    separation_m
        R, the least distance of two robots' centres.
    """
    num_vertices = graph.num_vertices
    ends, track = np.unique(np.sort(np.stack([graph.tail, graph.head], 1), axis=1), axis=0, return_inverse=True)
    track = track.reshape(-1)
    on_floor = np.ones(len(ends), np.bool_)
    on_floor[track[graph.is_ride]] = False
    at_low, at_high = _clearances(graph.xy, ends, on_floor, separation_m)
    forward = graph.tail < graph.head
    zone = _zones(graph, ends, on_floor, separation_m)
    num_places = num_vertices + len(ends)
    group_name, grouped, group = _groups(graph, ends, track)
    place = np.concatenate([zone.T.reshape(-1), grouped])
    which = np.concatenate([np.tile(np.arange(len(zone)), 2), len(zone) + group])
    order = np.lexsort((which, place))
    return Resources(
        separation_m=separation_m,
        track=frozen(track),
        ends=frozen(ends),
        leave_m=frozen(np.where(forward, at_low[track], at_high[track])),
        enter_m=frozen(np.where(forward, at_high[track], at_low[track])),
        zone=frozen(zone),
        group_name=group_name,
        zones_first=frozen(np.searchsorted(place[order], np.arange(num_places + 1)).astype(np.int64)),
        zones_of=frozen(which[order]),
    )


def needs_of(graph: NavGraph, plan: Plan, lane: IntArray, resources: Resources) -> Needs:
    """What every visit needs: its vertex, the zones of its vertex and those of the track that leads to it.

    Parameters
    ----------
    lane
        [N] by which a visit is reached, -1 for first visits.
    """
    num_visits, num_vertices = plan.num_visits, graph.num_vertices
    visit = np.arange(num_visits)
    moved = visit[lane >= 0]
    parts = [(visit, plan.vertex, np.zeros(num_visits, np.bool_))]
    for some, place, only_lane in ((visit, plan.vertex, False), (moved, num_vertices + resources.track[lane[moved]], True)):
        count = np.diff(resources.zones_first)[place]
        zones = resources.zones_of[_ranges(resources.zones_first[place], count)]
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


def left_after_m(
    graph: NavGraph,
    plan: Plan,
    lane: IntArray,
    from_m: FloatArray,
    at_m: FloatArray,
    stretch: FloatArray,
    needs: Needs,
    resources: Resources,
) -> FloatArray:
    """[M] how far along its path a robot has left what it needed, inf where it stays.

    Parameters
    ----------
    lane
        [N] by which a visit is reached, -1 for first visits.
    from_m, at_m
        [N] where that lane begins along its robot's path, and where the visit is.
    stretch
        [L] how much longer a lane is on that path than in the graph: 1 but for lanes SUMO takes for longer.
    """
    num_vertices = graph.num_vertices
    visit, resource = needs.visit, needs.resource
    onward = np.append(lane[1:], -1)[visit]  # lane by which the visit's vertex is left, -1: never
    used = np.where(needs.on_lane, lane[visit], onward)
    origin = np.where(needs.on_lane, from_m[visit], at_m[visit])
    after = np.full(len(visit), np.inf)
    shared = num_vertices + len(resources.zone)
    at_vertex = ((resource < num_vertices) | (resource >= shared) & ~needs.on_lane) & (used >= 0)
    after[at_vertex] = resources.leave_m[used[at_vertex]]
    part = np.flatnonzero((resource >= num_vertices) & (resource < shared) & (used >= 0))
    pair = resources.zone[resource[part] - num_vertices]
    mine = np.where(needs.on_lane[part], num_vertices + resources.track[lane[visit[part]]], plan.vertex[visit[part]])
    after[part] = _last_within(graph, resources, used[part], np.where(pair[:, 0] == mine, pair[:, 1], pair[:, 0]))
    limit = np.where(used >= 0, graph.length_m[used] - LEFT_M, np.inf)
    left: FloatArray = origin + np.minimum(after, limit) * np.where(used >= 0, stretch[used], 1.0)
    return left


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


def _clearances(xy: FloatArray, ends: IntArray, on_floor: BoolArray, separation: float) -> tuple[FloatArray, FloatArray]:
    """[T] each, for the lower and the higher end of every track: from this far along it no other track at that vertex, nor
    the vertex, is closer than the separation; at most its length less LEFT_M. Tracks that are not on a floor [T] are near to nothing.
    """
    num_tracks = len(ends)
    vertex = ends.T.reshape(-1)  # a half is a track seen from one of its ends
    along = xy[ends[:, 1]] - xy[ends[:, 0]]
    length = np.hypot(*along.T)
    direction = np.concatenate([along, -along]) / np.tile(length, 2)[:, None]
    order = np.argsort(vertex, kind="stable")
    first = np.searchsorted(vertex[order], np.arange(len(xy) + 1))
    degree = np.diff(first)[vertex]
    half = np.repeat(np.arange(2 * num_tracks), degree)
    other = order[_ranges(first[vertex], degree)]
    meets = (half != other) & on_floor[half % num_tracks] & on_floor[other % num_tracks]
    half, other = half[meets], other[meets]
    cos = (direction[half] * direction[other]).sum(1)
    sin = np.abs(_cross(direction[half], direction[other]))
    reach = length[other % num_tracks]  # how far the other track goes
    with np.errstate(divide="ignore", invalid="ignore"):
        beside = separation / sin  # beyond it, the other track's line is far enough
        beyond = reach * cos + np.sqrt(np.maximum(separation**2 - (reach * sin) ** 2, 0))  # beyond it, its end is
        clear = np.where(cos <= 0, separation, np.where(separation * cos <= reach * sin, beside, beyond))
    found = np.full(2 * num_tracks, separation)
    np.maximum.at(found, half, clear)
    found = np.minimum(found, np.tile(length, 2) - LEFT_M)
    return found[:num_tracks], found[num_tracks:]


def _zones(graph: NavGraph, ends: IntArray, on_floor: BoolArray, separation: float) -> IntArray:
    """[Z, 2] pairs of places closer than the separation that no vertex keeps apart."""
    num_vertices = graph.num_vertices
    if not len(ends):
        return np.zeros((0, 2), np.int64)
    place = segments(graph, ends)
    used = np.unique(ends[on_floor])
    # every track is sampled in the middle of its pieces, so that places closer than R have samples closer than `reach`
    length = np.hypot(*(place[num_vertices:, 1] - place[num_vertices:, 0]).T)
    pieces = np.where(on_floor, np.maximum(1, np.ceil(length / (2 * separation)).astype(np.int64)), 0)
    owner = np.repeat(np.arange(len(ends)), pieces)
    fraction = (_ranges(np.zeros(len(ends), np.int64), pieces) + 0.5) / pieces[owner]
    sample = place[num_vertices + owner, 0] + fraction[:, None] * (place[num_vertices + owner, 1] - place[num_vertices + owner, 0])
    half = float((length[on_floor] / pieces[on_floor]).max(initial=0.0)) / 2
    point = np.concatenate([graph.xy[used], sample])
    owner = np.concatenate([used, num_vertices + owner])
    pair = pairs_within(point, separation + 2 * half)
    pair = np.sort(np.sort(owner[pair], axis=1) @ np.array([len(place), 1]))
    pair = pair[np.diff(pair, prepend=-1) > 0]  # each once; np.unique takes ten times as long
    a, b = pair // len(place), pair % len(place)
    corner = np.stack([np.arange(num_vertices)] * 2, 1)
    corner = np.concatenate([corner, ends])
    meets = (corner[a][:, :, None] == corner[b][:, None, :]).any((1, 2))
    level = graph.level[corner[:, 0]]
    apart = ~meets & (level[a] == level[b])
    a, b = a[apart], b[apart]
    close = distance_m(place[a], place[b]) < separation - 1e-9
    return np.stack([a[close], b[close]], 1)


def groups_of(options: Options) -> list[str]:
    """The names of the groups that a vertex or lane with these options is in."""
    found = [str(options["mutex"])] if options.get("mutex") else []
    return [*found, cabin_group(str(options["cabin"]))] if options.get("cabin") else found


def cabin_group(lift: str) -> str:
    """The name of the group that the cabin of a lift is."""
    return f"lift {lift}"


def _groups(graph: NavGraph, ends: IntArray, track: IntArray) -> tuple[tuple[str, ...], IntArray, IntArray]:
    """Names of the mutex groups, and pairs of a place and the group it is in."""
    at_vertex = [(name, v) for v, options in enumerate(graph.vertex_options) for name in groups_of(options)]
    on_track = {(name, int(track[lane])) for lane, options in enumerate(graph.lane_options) for name in groups_of(options)}
    names = tuple(sorted({name for name, _ in at_vertex} | {name for name, _ in on_track}))
    found: set[tuple[int, int]] = set()
    degree = np.bincount(ends.reshape(-1), minlength=graph.num_vertices)
    for g, name in enumerate(names):
        tracks = np.array(sorted(t for other, t in on_track if other == name), np.int64)
        inside = np.flatnonzero((np.bincount(ends[tracks].reshape(-1), minlength=graph.num_vertices) == degree) & (degree > 0))
        found.update((int(t) + graph.num_vertices, g) for t in tracks)
        found.update((v, g) for other, v in at_vertex if other == name)
        found.update((int(v), g) for v in inside)
    pairs = np.array(sorted(found), np.int64).reshape(-1, 2)
    return names, pairs[:, 0], pairs[:, 1]


def _last_within(graph: NavGraph, resources: Resources, lane: IntArray, other: IntArray) -> FloatArray:
    """[N] the farthest along each lane that is closer than the separation to the other place, 0 if nothing is."""
    target, radius = segments(graph, resources.ends)[other], resources.separation_m
    begin, along = graph.xy[graph.tail[lane]], graph.xy[graph.head[lane]] - graph.xy[graph.tail[lane]]
    square = (along**2).sum(1)
    # what is close to a segment lies in discs around its ends and in a rectangle between them; all three together are
    # convex, so the lane leaves them where it leaves the last one
    leaves = np.zeros(len(lane))
    with np.errstate(divide="ignore", invalid="ignore"):
        for end in (0, 1):
            away = begin - target[:, end]
            half = (away * along).sum(1) / square
            root = np.sqrt(half**2 - ((away**2).sum(1) - radius**2) / square)  # NaN where the line misses the disc
            leaves = np.fmax(leaves, np.where(-half - root < 1.0, -half + root, 0.0))
        axis = target[:, 1] - target[:, 0]
        length = np.hypot(*axis.T)
        axis = axis / length[:, None]  # NaN for a vertex, which has no rectangle
        enters, exits = np.full(len(lane), -np.inf), np.full(len(lane), np.inf)
        for direction, low, high in ((axis, np.zeros(len(lane)), length), (np.stack([-axis[:, 1], axis[:, 0]], 1), -radius, radius)):
            place, pace = ((begin - target[:, 0]) * direction).sum(1), (along * direction).sum(1)
            one, two = (low - place) / pace, (high - place) / pace
            outside = (pace == 0) & ((place < low) | (place > high))
            parallel = (pace == 0) & ~outside
            enters = np.maximum(enters, np.where(parallel, -np.inf, np.where(outside, np.inf, np.minimum(one, two))))
            exits = np.minimum(exits, np.where(parallel, np.inf, np.maximum(one, two)))
        leaves = np.fmax(leaves, np.where((enters < exits) & (enters < 1.0), exits, 0.0))
    return np.clip(leaves, 0.0, 1.0) * graph.length_m[lane]


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


def _ranges(start: IntArray, count: IntArray) -> IntArray:
    """start[0], start[0] + 1, ... count[0] of them, then those of start[1], ..."""
    begin = np.cumsum(count) - count
    return np.arange(int(count.sum())) - np.repeat(begin - start, count)
