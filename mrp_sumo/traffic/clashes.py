"""Moves that clash on a graph: the executor's zones and mutex groups, as planners in steps need them.

A plan without clashes and rotations can be driven in its order. In each step a robot holds what its visits need: the
places of its move. No two robots hold places of one zone or group in one step, so that where passages of a zone follow
each other, the second robot arrives at least a step after the first has left: waiting leads strictly forward in time. Only
a robot that enters a vertex in the step in which another leaves it waits for an arrival at the same time, and
those waits form a circle only where robots rotate. So the schedule of the plan (`traffic.schedule`) has no cycle.
"""

from weakref import WeakKeyDictionary

import numpy as np

from mrp_sumo.core.clashes import Clashes, Spots, lanes_in, no_clashes, vertices_alone
from mrp_sumo.core.csr import ranges
from mrp_sumo.core.graph import BoolArray, IntArray, NavGraph, PlanGraph, frozen
from mrp_sumo.core.problem import Problem
from mrp_sumo.traffic.moves import MoveGraph
from mrp_sumo.traffic.resources import Resources, groups_of, resources_of

NO_SEPARATION = -1.0  # stands for the rules of MAPF alone

_known: WeakKeyDictionary[NavGraph, dict[float, Clashes]] = WeakKeyDictionary()
_spots_known: WeakKeyDictionary[NavGraph, Spots] = WeakKeyDictionary()


def clashes_of(problem: Problem) -> tuple[Clashes, Spots]:
    """The clashes between spots that a plan for this problem must avoid, and the spots. Those of a graph are computed once.

    Only trailers have any where a plan need not be drivable in its order. As on the map, a robot may come to a spot in the step in which
    another leaves it.
    """
    return _on(problem.graph, problem.fleet.separation_m if problem.drivable else NO_SEPARATION), _spots_of(problem.graph)


def with_beside(clashes: Clashes, spots: Spots) -> Clashes:
    """The clashes with spots beside where a move ends, for planners that make no difference between the two."""
    if not len(spots.beside):
        return clashes
    end = np.concatenate([spots.head, np.arange(len(spots.place))])
    begin, number = spots.beside_first[end], np.diff(spots.beside_first)[end]
    vertex = np.insert(clashes.vertex, np.repeat(clashes.vertex_first[1:], number), spots.beside[ranges(begin, number)])
    return clashes._replace(vertex_first=frozen(clashes.vertex_first + np.append(0, np.cumsum(number))), vertex=frozen(vertex))


def _spots_of(graph: PlanGraph) -> Spots:
    if graph not in _spots_known:
        _spots_known[graph] = _spots(graph)
    return _spots_known[graph]


def _spots(graph: PlanGraph) -> Spots:
    if not isinstance(graph, MoveGraph):
        return vertices_alone(graph.first, graph.head, graph.tail, graph.reverse)
    count = graph.base.num_vertices + 1
    pairs, of = np.unique(graph.place * count + graph.behind + 1, return_inverse=True)
    ends, move = np.unique(of[graph.tail] * len(pairs) + of[graph.head], return_inverse=True)
    tail, head, place, spots = ends // len(pairs), ends % len(pairs), pairs // count, np.arange(len(pairs))
    first = np.searchsorted(tail, np.arange(len(pairs) + 1)).astype(np.int64)
    one, other = _joined(spots, place, place, spots, count)
    beside = _csr(one[one != other], other[one != other], len(pairs))
    entering, other_way = lanes_in(tail, head, len(pairs)), head * len(pairs) + tail
    back = np.minimum(np.searchsorted(ends, other_way), len(ends) - 1)
    back = frozen(np.where(ends[back] == other_way, back, -1))
    return Spots(frozen(of), frozen(move), frozen(first), frozen(head), frozen(tail), back, *entering, frozen(place), *beside)


def exclusive_vertices(problem: Problem) -> dict[int, frozenset[int]]:
    """Vertices at which no robot may stand while another is at one, by that one; those that exclude no others are left out.

    Nor may it where neither comes to its vertex once the other is at its own, as where the last lane passes too near an end of an aisle.
    """
    graph, clashes = problem.graph, _on(problem.graph, problem.fleet.separation_m)
    count, num_lanes, first = graph.num_vertices, graph.num_lanes, clashes.vertex_first
    one, other = np.repeat(np.arange(count), np.diff(first[num_lanes:])), clashes.vertex[first[num_lanes] :]
    lane, near = np.repeat(np.arange(num_lanes), np.diff(first[: num_lanes + 1])), clashes.vertex[: first[num_lanes]]
    elsewhere = (near != graph.tail[lane]) & (near != graph.head[lane])
    pair, times = np.unique(graph.head[lane[elsewhere]] * count + near[elsewhere], return_counts=True)
    between, lanes = set(zip(graph.tail.tolist(), graph.head.tolist())), np.bincount(graph.head, minlength=count).tolist()
    from_elsewhere = {(v, u): lanes[v] - ((u, v) in between) for v, u in zip(*(side.tolist() for side in np.divmod(pair, count)))}
    shut = {at for at, n in zip(from_elsewhere, times.tolist()) if n == from_elsewhere[at]}  # v, where nobody comes while a robot is at u
    never = [(v, u) for v, u in shut if (u, v) in shut or (lanes[u] == 1 and (v, u) in between)]
    excludes: dict[int, set[int]] = {}
    for v, u in [*zip(one.tolist(), other.tolist()), *never, *((u, v) for v, u in never)]:
        if u != v:
            excludes.setdefault(v, set()).add(u)
    return {v: frozenset(others) for v, others in excludes.items()}


def _on(graph: PlanGraph, separation_m: float) -> Clashes:
    known = _known.setdefault(graph, {})
    if separation_m not in known:
        if isinstance(graph, MoveGraph):
            known[separation_m] = _between_spots(graph, _spots_of(graph), _on(graph.base, separation_m))
        elif separation_m == NO_SEPARATION:
            known[separation_m] = no_clashes(graph.num_vertices, graph.num_lanes, rotations=True)
        else:
            known[separation_m] = _clashes(graph, separation_m)
    return known[separation_m]


def _between_spots(graph: MoveGraph, spots: Spots, of_map: Clashes) -> Clashes:
    """The clashes of the spots of a graph of moves: those at places that exclude each other on the map, where trailers are, too.

    Those at the places of a move are left to planners, but for trailers there, and so are robots that change places.
    """
    base, place, tail, head = graph.base, spots.place, spots.tail, spots.head
    behind_of, base_lane = np.empty(len(place), np.int64), np.empty(len(head), np.int64)
    behind_of[spots.of], base_lane[spots.move] = graph.behind, graph.base_lane
    count, tows = base.num_vertices, np.flatnonzero(behind_of >= 0)
    held, spot = np.concatenate([place, behind_of[tows]]), np.concatenate([np.arange(len(place)), tows])  # places, and who is there
    by_held, by_lane = np.argsort(held, kind="stable"), np.argsort(base_lane, kind="stable")
    num_spots, num_lanes = len(place), len(base_lane)
    num_moves = num_lanes + num_spots
    all_moves = np.arange(num_moves)
    of_base = np.concatenate([base_lane, base.num_lanes + place])  # [M] the same move on the map
    ends = np.concatenate([np.stack([tail, head]), np.tile(np.arange(num_spots), (2, 1))], 1)  # [2, M] spots
    behind = behind_of[ends]  # [2, M]
    parts = [(all_moves, place[ends[0]]), (all_moves, place[ends[1]])]
    parts += [(all_moves[mine >= 0], mine[mine >= 0]) for mine in behind]
    moves = [of_base, *(np.where(mine >= 0, base.num_lanes + mine, -1) for mine in behind)]
    lanes = []
    for move in moves:  # what the map says of the move, and of trailers that wait behind it
        some = np.flatnonzero(move >= 0)
        begin, number = of_map.vertex_first[move[some]], np.diff(of_map.vertex_first)[move[some]]
        parts.append((np.repeat(some, number), of_map.vertex[ranges(begin, number)]))
        begin, number = of_map.lane_first[move[some]], np.diff(of_map.lane_first)[move[some]]
        lanes.append(np.stack([np.repeat(some, number), of_map.lane[ranges(begin, number)]]))
    pairs = np.unique(np.concatenate([one * count + at for one, at in parts]))
    move, vertex = _joined(pairs // count, pairs % count, held[by_held], spot[by_held], count)
    grouped = np.isin(pairs, np.concatenate([one * count + at for one, at in parts[2:]]))  # excluded beyond the rules of MAPF
    there = np.bincount(held, minlength=count)[pairs % count]
    keep = np.repeat(grouped, there) | (place[vertex] != np.repeat(pairs % count, there))
    move, vertex = np.divmod(np.unique(move[keep] * num_spots + vertex[keep]), num_spots)  # one may hold two of the places
    vertex_first, vertex = _csr(move, vertex, num_moves)
    back = base.reverse[base_lane]
    lanes.append(np.stack([np.flatnonzero(back >= 0), back[back >= 0]]))
    on, lane = np.unique(np.concatenate(lanes, 1), axis=1)
    on, lane = _joined(on, lane, base_lane[by_lane], by_lane, base.num_lanes)
    swaps = (ends[0][on] == head[lane]) & (ends[1][on] == tail[lane])
    lane_first, lane = _csr(on[~swaps], lane[~swaps], num_moves)
    any_clash = bool(len(vertex) or len(lane) or len(spots.beside))
    return Clashes(vertex_first, vertex, lane_first, lane, any_clash, of_map.rotations)


def _clashes(graph: PlanGraph, separation_m: float) -> Clashes:
    grouped = any(options and groups_of(options) for options in (*graph.vertex_options, *graph.lane_options))
    if graph.kind == "grid" and separation_m <= graph.cell_m + 1e-9 and not grouped:
        return no_clashes(graph.num_vertices, graph.num_lanes, rotations=False)
    return _of_moves(graph, resources_of(graph, separation_m))


def _of_moves(graph: NavGraph, resources: Resources) -> Clashes:
    """What each move excludes, from the pairs of places that exclude each other."""
    num_vertices, num_lanes = graph.num_vertices, graph.num_lanes
    num_places, num_moves = num_vertices + len(resources.ends), num_lanes + num_vertices
    one, other = _exclusive_places(resources, num_vertices)
    lanes = np.arange(num_lanes)
    move = np.concatenate([lanes, lanes, lanes, num_lanes + np.arange(num_vertices)])
    place = np.concatenate([graph.tail, graph.head, num_vertices + resources.track, np.arange(num_vertices)])
    near, far = _joined(move, place, one, other, num_places)
    pairs = np.unique(near * num_places + far)
    move, place = pairs // num_places, pairs % num_places
    at_vertex = place < num_vertices
    vertex_first, vertex = _csr(move[at_vertex], place[at_vertex], num_moves)
    by_track = np.argsort(resources.track, kind="stable")
    on, lane = _joined(move[~at_vertex], place[~at_vertex] - num_vertices, resources.track[by_track], by_track, len(resources.ends))
    known = move[at_vertex] * num_vertices + place[at_vertex]  # ascending
    keep = ~(_contains(known, on * num_vertices + graph.tail[lane]) | _contains(known, on * num_vertices + graph.head[lane]))
    lane_first, lane = _csr(on[keep], lane[keep], num_moves)
    return Clashes(vertex_first, vertex, lane_first, lane, bool(len(vertex) or len(lane)), False)


def _exclusive_places(resources: Resources, num_vertices: int) -> tuple[IntArray, IntArray]:
    """Pairs of places, both ways round and by the first, that two robots must not hold at once; a vertex in a group also with itself."""
    num_zones = len(resources.zone)
    place = np.repeat(np.arange(len(resources.zones_first) - 1), np.diff(resources.zones_first))
    order = np.argsort(resources.zones_of, kind="stable")
    one, other = _joined(place, resources.zones_of, resources.zones_of[order], place[order], num_zones + len(resources.group_name))
    resource = np.repeat(resources.zones_of, np.bincount(resources.zones_of)[resources.zones_of]) if len(place) else place
    keep = (one != other) | (resource >= num_zones) & (one < num_vertices)
    one, other = one[keep], other[keep]
    order = np.lexsort((other, one))
    return one[order], other[order]


def _joined(left: IntArray, key: IntArray, other_key: IntArray, right: IntArray, num_keys: int) -> tuple[IntArray, IntArray]:
    """Pairs of `left` and `right` with one key; `other_key`, of `right`, is ascending."""
    first = np.searchsorted(other_key, np.arange(num_keys + 1))
    count = np.diff(first)[key]
    return np.repeat(left, count), right[ranges(first[key], count)]


def _csr(row: IntArray, value: IntArray, num_rows: int) -> tuple[IntArray, IntArray]:
    order = np.lexsort((value, row))
    return frozen(np.searchsorted(row[order], np.arange(num_rows + 1)).astype(np.int64)), frozen(value[order])


def _contains(sorted_keys: IntArray, wanted: IntArray) -> BoolArray:
    at = np.minimum(np.searchsorted(sorted_keys, wanted), max(len(sorted_keys) - 1, 0))
    return sorted_keys[at] == wanted if len(sorted_keys) else np.zeros(len(wanted), np.bool_)
