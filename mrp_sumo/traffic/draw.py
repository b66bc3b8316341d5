"""Starts and goals drawn from a seed: as MRP-Bench draws them, and uniformly.

Refuses to draw more robots than there are vertices to stand on, or may stand at once.
"""

import random
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.digraph import strong_components
from mrp_sumo.core.graph import IntArray, PlanGraph
from mrp_sumo.core.near import pairs_within
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import PlanError
from mrp_sumo.traffic.moves import round_trips
from mrp_sumo.traffic.resources import groups_of, resources_of

Name = tuple[str, int]  # of what robots share: a vertex, a mutex group, a pair of stations that are too near
Behind = dict[int, list[int]]  # by vertex, of types that tow: those on one of which trailers stand then
STARTS, GOALS = 1, 2  # purposes of the streams of chance


def mrp_bench_draw(num_vertices: int, num_robots: int, seed: int) -> tuple[IntArray, IntArray]:
    """The draw of MRP-Bench: `random.sample` after `random.seed(seed)` for starts, `seed + 1` for goals.

    [R] vertices of the nav graph each, in the order of its files, distinct within each; goals are not assigned yet. Two vertices may share
    a cell of the plan graph, and start and goal may lie in different components. Raises PlanError when there are fewer vertices than
    robots.
    """
    _enough(num_vertices, num_robots, "vertices")
    start = random.Random(seed).sample(range(num_vertices), num_robots)
    goal = random.Random(seed + 1).sample(range(num_vertices), num_robots)
    return np.array(start, np.int64), np.array(goal, np.int64)


class Stands(NamedTuple):
    """Vertices on which robots of one type may be drawn; from each start they reach each goal."""

    start: IntArray
    goal: IntArray
    behind: tuple[Behind, Behind] = ({}, {})  # at starts and at goals


def uniform_draw(
    graph: PlanGraph, num_robots: int, seed: int, separation_m: float = 0.0, *, anywhere: bool = False, vehicle: RobotType | None = None
) -> tuple[IntArray, IntArray]:
    """Starts and goals [R] uniformly among the stations of the strongly connected component with most of them, distinct within each.

    Stations are the vertices that stand for those of the nav graph, on a grid map every cell; with `anywhere` all vertices of the plan
    graph are drawn from. Every drawn start reaches every drawn goal, along one-way lanes too; a vehicle that cannot turn in place can make
    the turns between them. No two starts, and no two goals, are in one mutex group or nearer to each other than the separation: a station
    that is, to one drawn before, is passed over. None is in a lift. A robot may start at its goal. Raises PlanError when the component has
    fewer stations than robots, or fewer that robots may stand on at once.
    """
    what = "vertices" if anywhere else "stations"
    stands = stands_of(graph, anywhere=anywhere, vehicle=vehicle)
    _enough(min(len(stands.start), len(stands.goal)), num_robots, f"{what} that reach each other")
    none = np.full(num_robots, -1)
    apart = f"{what} on which robots may stand at once, one for each mutex group and none too near to another"
    return _draw(graph, [stands], np.zeros(num_robots, np.int64), (none, none), seed, separation_m, apart)


def most_drawn(graph: PlanGraph, seed: int, separation_m: float = 0.0, *, anywhere: bool = False, vehicle: RobotType | None = None) -> int:
    """The largest number of robots that `uniform_draw` can draw; the parameters are its own."""
    stands = stands_of(graph, anywhere=anywhere, vehicle=vehicle)
    shared = shared_at(graph, np.union1d(stands.start, stands.goal), separation_m)
    streams = ((STARTS, stands.start), (GOALS, stands.goal))
    orders = ((np.random.default_rng([seed, purpose]).permutation(vertices), purpose) for purpose, vertices in streams)
    return min(len(_first_apart(order, stands, purpose, shared, set(), len(order))) for order, purpose in orders)


def stands_of(graph: PlanGraph, *, anywhere: bool = False, vehicle: RobotType | None = None) -> Stands:
    """Vertices on which robots are drawn: the stations, or all vertices, in the component with most stations, but none in a lift.

    Of a vehicle that cannot turn in place the component is one of its moves, and starts are such that it comes there.
    """
    may_stand = ~graph.having("is_passthrough_point")
    if graph.is_ride.any():  # who stands at a lift keeps others from it
        may_stand &= ~graph.having("cabin")
    station = np.unique(graph.vertex_of_station[graph.vertex_of_station >= 0])
    station, everywhere = station[may_stand[station]], np.flatnonzero(may_stand)
    if vehicle is None or not vehicle.is_vehicle:
        piece = main_piece(graph, station if len(station) else everywhere)
        if anywhere and len(piece):  # where the work is, though another component may have longer lanes
            component = strong_components(graph.num_vertices, graph.tail, graph.head)
            piece = everywhere[component[everywhere] == component[piece[0]]]
        return Stands(piece, piece)
    station = everywhere if anywhere else station
    trips = round_trips(graph, vehicle, station)
    start, goal = station[trips.begins[station]], station[trips.is_on[station]]
    if not vehicle.trailers:
        return Stands(start, goal)
    came = {v: np.unique(graph.tail[trips.lanes & (graph.head == v)]).tolist() for v in goal.tolist()}
    return Stands(start, goal, ({v: [int(trips.behind[v])] for v in start.tolist()}, came))


def draw_by_type(
    types: Sequence[tuple[RobotType, PlanGraph]],
    kind: IntArray,
    start: IntArray,
    goal: IntArray,
    seed: int,
    separation_m: float,
    *,
    anywhere: bool = False,
) -> tuple[IntArray, IntArray]:
    """Starts and goals of robots of K types, each type on a graph of its own lanes; those that are given stay, -1 is drawn.

    As `uniform_draw`: every drawn start of a type reaches every drawn goal of that type. The separation is that of the two largest robots.
    Types with the fewest stations choose first. Raises PlanError when a type has fewer stations than robots, or fewer that robots may stand
    on at once.
    """
    what = "vertices" if anywhere else "stations"
    stands = [stands_of(graph, anywhere=anywhere, vehicle=each) for each, graph in types]
    beside = f"{what} on which robots of that type may stand at once, beside all others"
    return _draw(types[0][1], stands, kind, (start, goal), seed, separation_m, beside)


def main_piece(graph: PlanGraph, among: IntArray | None = None) -> IntArray:
    """Vertices, of all or among some, in the strongly connected component that has most of them."""
    vertices = np.arange(graph.num_vertices) if among is None else among
    if not len(vertices):
        return vertices
    piece = strong_components(graph.num_vertices, graph.tail, graph.head)[vertices]
    largest: IntArray = vertices[piece == np.bincount(piece).argmax()]
    return largest


def _draw(
    graph: PlanGraph, stands: Sequence[Stands], kind: IntArray, places: tuple[IntArray, IntArray], seed: int, separation_m: float, what: str
) -> tuple[IntArray, IntArray]:
    """Starts and goals of robots of these kinds, -1 where they are not given; raises PlanError where there are too few of `what`."""
    some = np.unique(np.concatenate([*(vertices for each in stands for vertices in each[:2]), *(named[named >= 0] for named in places)]))
    shared, drawn = shared_at(graph, some, separation_m), []
    for purpose, named in zip((STARTS, GOALS), places):
        chosen, taken, rng = named.astype(np.int64), set[Name](), np.random.default_rng([seed, purpose])
        for v in named[named >= 0].tolist():
            taken |= {*shared.get(v, ()), ("vertex", v)}
        for k in sorted(np.unique(kind).tolist(), key=lambda k: len(stands[k].start)):
            robots = np.flatnonzero((kind == k) & (named < 0))
            if len(robots):
                order = rng.permutation(stands[k][purpose - STARTS])
                drawable = _first_apart(order, stands[k], purpose, shared, taken, len(robots))
                _enough(len(drawable), len(robots), what)
                chosen[robots] = drawable
        drawn.append(chosen)
    return drawn[0], drawn[1]


def shared_at(graph: PlanGraph, station: IntArray, separation_m: float) -> dict[int, set[Name]]:
    """Names of what each station shares with others: its mutex groups, and pairs of stations that are too near; most share nothing."""
    shared: dict[int, set[Name]] = {}
    if any(groups_of(options) for options in (*graph.vertex_options, *graph.lane_options)):
        groups_at = resources_of(graph, separation_m).groups_at
        shared = {v: {("group", group) for group in groups_at[v]} for v in station.tolist() if v in groups_at}
    near, beyond_m = np.zeros((0, 2), np.int64), graph.swing_m[station]
    if separation_m > 0:
        near = pairs_within(graph.xy[station], separation_m + 2 * float(beyond_m.max(initial=0.0)) - 1e-9)
    away_m = np.hypot(*(graph.xy[station[near[:, 0]]] - graph.xy[station[near[:, 1]]]).T)
    near = near[away_m < separation_m + beyond_m[near].sum(1) - 1e-9] if graph.swing_m.any() else near
    for pair, (a, b) in enumerate(station[near].tolist()):
        if graph.level[a] == graph.level[b]:
            for v in (a, b):
                shared.setdefault(v, set()).add(("near", pair))
    return shared


def _first_apart(order: IntArray, stands: Stands, purpose: int, shared: dict[int, set[Name]], taken: set[Name], limit: int) -> IntArray:
    """The first stations in an order that share nothing with each other and what is taken, up to a limit; what they share is taken then."""
    behind = stands.behind[purpose - STARTS]
    chosen: list[int] = []
    for v in order.tolist():
        if len(chosen) == limit:
            break
        own = {*shared.get(v, ()), ("vertex", v)}
        room = next((u for u in behind.get(v, [v]) if ("vertex", u) not in taken), None)
        if room is not None and taken.isdisjoint(own):
            taken |= {*own, ("vertex", room)}
            chosen.append(v)
    return np.array(chosen, np.int64)


def _enough(available: int, num_robots: int, what: str) -> None:
    if num_robots < 0:
        raise PlanError(f"cannot draw {num_robots} robots, expected 0 or more")
    if num_robots > available:
        raise PlanError(f"cannot draw {num_robots} robots: there are {available} {what}, of which each is drawn once")
