"""The graph of moves: what planners plan on where vehicles cannot turn in place.

Its vertices are states of a vehicle at a place of the map: the lane by which it came, and the gear. Its lanes are the moves between them,
each along one lane of the map. So a path in it is one that the vehicle can drive, and planners need not know what wheels it has. All
states at one place exclude each other, and what else the places exclude. Each type of robots has vertices of its own, so that none comes
upon another's; those that turn in place have the map's.

A vehicle under way may turn at the end of its lane (UNDER_WAY). One that stands there has missed the beginning of the arc: it goes
straight on or back (STANDING). One that has begun an arc is bound for a lane (BOUND), and one that has not moved yet faces as it will go
(ANYWHERE). Only the first kind is ever reached, the others are where paths begin.
"""

from dataclasses import dataclass, field, fields
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.digraph import strong_components
from mrp_sumo.core.fleet import Fleet, fleet_of
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, PlanGraph, frozen, nav_like, plan_graph
from mrp_sumo.core.problem import Problem, Standing
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import PlanError
from mrp_sumo.traffic.courses import course_rad
from mrp_sumo.traffic.turns import BACKWARD, FORWARD, MAY_STAND_RAD, NEVER, stands_bent, turns_of

UNDER_WAY, STANDING, BOUND, ANYWHERE = range(4)
MOST_PLACES = 256  # for which lengths of ways are kept


class States(NamedTuple):
    """Vertices of one type of robots, numbered from `begin`."""

    begin: int
    place: IntArray  # [S] vertex of the map
    behind: IntArray  # [S] vertex on which trailers stand there, -1: none
    at: IntArray  # [3, L, 2] vertex by what it does, its lane and gear, -1: none
    bound: IntArray  # [P] of types that tow: vertex on the arc of each turn, where the trailers are known, too; -1: none
    anywhere: IntArray  # [V] vertex from which a type that has not moved yet may go everywhere


@dataclass(frozen=True, eq=False, kw_only=True)
class MoveGraph(PlanGraph):
    """See the module. V' vertices, L' lanes, of a map with V and L."""

    base: PlanGraph
    place: IntArray  # [V'] vertex of the map
    behind: IntArray  # [V'] another that is held there, by trailers; -1: none
    base_lane: IntArray  # [L'] lane of the map
    states: tuple[States, ...]  # [K]
    types: tuple[RobotType, ...]  # [K]
    arrivals: dict[tuple[int, int], "EndStates"] = field(default_factory=dict)  # `arrivals_at` by type and place


_known: WeakKeyDictionary[PlanGraph, dict[tuple[object, ...], MoveGraph]] = WeakKeyDictionary()


def move_graph(graph: PlanGraph, fleet: Fleet, barred: BoolArray | None) -> MoveGraph:
    """The graph of moves of the types of a fleet on a map, with lanes [K, L] that are barred to some of them. Made once."""
    key = (fleet.types, b"" if barred is None else barred.tobytes())
    known = _known.setdefault(graph, {})
    if key not in known:
        known[key] = _made(graph, fleet.types, barred)
    return known[key]


def _made(graph: PlanGraph, types: tuple[RobotType, ...], barred: BoolArray | None) -> MoveGraph:
    states, tails, heads, lanes, speed, count = [], [], [], [], [], 0
    for kind, each in enumerate(types):
        free = np.ones(graph.num_lanes, np.bool_) if barred is None else ~barred[kind]
        mine, (tail, head, lane) = _of_vehicle(graph, each, free, count) if each.is_vehicle else _of_others(graph, free, count)
        states.append(mine)
        tails.append(tail)
        heads.append(head)
        lanes.append(lane)
        speed.append(np.minimum(graph.speed_mps, turns_of(graph, each).limit_mps)[lane] if each.is_vehicle else graph.speed_mps[lane])
        count += len(mine.place)
    place, lane = np.concatenate([mine.place for mine in states]), np.concatenate(lanes)
    moves = np.stack([np.concatenate(tails), np.concatenate(heads)], 1)
    nav = nav_like(
        graph,
        xy=graph.xy[place],
        lanes=moves,
        level=graph.level[place],
        vertex_name=[graph.label(v) for v in place.tolist()],
        vertex_options=[graph.vertex_options[v] for v in place.tolist()],
        length_m=graph.length_m[lane],
        speed_mps=np.concatenate(speed),
        lane_options=[graph.lane_options[k] for k in lane.tolist()],
    )
    made = plan_graph(nav, kind="roadmap", cell_m=graph.cell_m)
    return MoveGraph(
        **{each.name: getattr(made, each.name) for each in fields(PlanGraph)} | {"beyond_m": frozen(graph.swing_m[place])},
        base=graph,
        place=frozen(place),
        behind=frozen(np.concatenate([mine.behind for mine in states])),
        base_lane=frozen(lane[nav.source_lane]),
        states=tuple(states),
        types=types,
    )


Arcs = tuple[IntArray, IntArray, IntArray]  # tail, head, lane of the map


def _of_others(graph: PlanGraph, free: BoolArray, begin: int) -> tuple[States, Arcs]:
    """Robots that turn in place: the map's own vertices and lanes."""
    lanes = np.flatnonzero(free)
    place = np.arange(graph.num_vertices)
    states = States(begin, place, np.full(len(place), -1), np.zeros((3, 0, 2), np.int64), np.zeros(0, np.int64), begin + place)
    return states, (begin + graph.tail[lanes], begin + graph.head[lanes], lanes)


def _of_vehicle(graph: PlanGraph, vehicle: RobotType, free: BoolArray, begin: int) -> tuple[States, Arcs]:
    turns = turns_of(graph, vehicle)
    allowed = turns.gears  # states are there on lanes that are not free, too, moves are not
    lane, gear = np.nonzero(allowed)
    count, num_lanes = len(lane), graph.num_lanes
    at = np.full((3, num_lanes, 2), -1, np.int64)
    for does in (UNDER_WAY, STANDING, BOUND):
        at[does, lane, gear] = begin + does * count + np.arange(count)
    anywhere = begin + 3 * count + np.arange(graph.num_vertices)
    came = np.repeat(np.arange(num_lanes), np.diff(turns.first))
    on_arc = np.flatnonzero(turns.next_gear[:, FORWARD] == FORWARD) if vehicle.trailers else np.zeros(0, np.int64)
    bound = np.full(len(came), -1)
    bound[on_arc] = begin + 3 * count + graph.num_vertices + np.arange(len(on_arc))
    everywhere, corner = np.arange(graph.num_vertices), graph.head[came[on_arc]]
    place = np.concatenate([graph.head[lane], graph.head[lane], graph.tail[lane], everywhere, corner])
    behind = np.full(len(place), -1)
    if vehicle.trailers:
        behind[: 2 * count] = np.tile(graph.tail[lane], 2)
        behind[len(behind) - len(on_arc) :] = graph.tail[came[on_arc]]
    arcs = [(at[BOUND, lane, gear], at[UNDER_WAY, lane, gear], lane)]
    arcs.append((bound[on_arc], at[UNDER_WAY, turns.onward[on_arc], FORWARD], turns.onward[on_arc]))
    for g in (FORWARD, BACKWARD):  # one that has not moved yet goes backward only where it has to
        out = np.flatnonzero(allowed[:, g] & turns.stands[:, 0] & ((g == FORWARD) | ~allowed[:, FORWARD]))
        arcs.append((anywhere[graph.tail[out]], at[UNDER_WAY, out, g], out))
        for does, next_gear in ((UNDER_WAY, turns.next_gear[:, g]), (STANDING, turns.may_stand[:, g])):
            some = next_gear != NEVER
            onward = turns.onward[some]
            arcs.append((at[does, came[some], g], at[UNDER_WAY, onward, next_gear[some]], onward))
    tail, head, along = (np.concatenate([arc[k] for arc in arcs]) for k in range(3))
    real = (tail >= 0) & (head >= 0) & free[along]
    return States(begin, place, behind, at, bound, anywhere), (tail[real], head[real], along[real])


def standing_at_starts(problem: Problem) -> Standing:
    """States in which vehicles stand at their starts, by their headings. Trailers stand on the lane behind, which nobody else's back is on.

    Raises PlanError where no lane leads as a vehicle faces, or none behind it has room for its trailers.
    """
    num_robots, fleet = problem.num_robots, problem.fleet
    nowhere = np.full(num_robots, -1)
    standing = Standing(np.full(num_robots, ANYWHERE), nowhere.copy(), np.zeros(num_robots, np.int64), nowhere)
    if not fleet.vehicle_of_kind:
        return standing
    course, taken, behind_m, heading = course_rad(problem.graph), set(problem.start.tolist()), fleet.behind_m, problem.heading_at_start
    for r in np.flatnonzero(fleet.is_vehicle).tolist():
        if behind_m[r] > 0:
            lane = _with_room_behind(problem, r, course, taken)
            taken.add(int(problem.graph.tail[lane]))
            standing.does[r], standing.lane[r] = STANDING, lane
        elif not np.isnan(heading[r]):
            standing.does[r], standing.lane[r], standing.gear[r] = _facing(problem, r, course)
    return standing


def _with_room_behind(problem: Problem, robot: int, course: FloatArray, taken: set[int]) -> int:
    """The lane on which the trailers of a robot stand, of several the one from which it can go straight on."""
    graph, start, heading = problem.graph, int(problem.start[robot]), problem.heading_at_start[robot]
    behind_m, came = float(problem.fleet.behind_m[robot]), np.flatnonzero(graph.head == start)
    if not np.isnan(heading):
        came = came[off_rad(course[came, 1], heading) <= MAY_STAND_RAD]
    free = [lane for lane in came.tolist() if int(graph.tail[lane]) not in taken and graph.length_m[lane] >= behind_m]
    if not free:
        place = f"{problem.fleet.robot_name[robot]} starts at '{graph.known_as(start)}'"
        raise PlanError(f"{place}, where no free lane behind it has {behind_m:.2f} m for its trailers")
    turns = turns_of(graph, problem.fleet.types[int(problem.fleet.kind[robot])])
    return min(free, key=lambda lane: not turns.goes_on(lane, FORWARD))


def _facing(problem: Problem, robot: int, course: FloatArray) -> tuple[int, int, int]:
    """What a vehicle does at its start with its heading, as if it had come so or were to go so: state, lane and gear.

    If it can go on so, that is.
    """
    graph, v, heading = problem.graph, int(problem.start[robot]), float(problem.heading_at_start[robot])
    turns = turns_of(graph, problem.fleet.types[int(problem.fleet.kind[robot])])
    faces, along = f"{problem.fleet.robot_name[robot]} faces {np.degrees(heading):.0f} degrees at '{graph.known_as(v)}'", False
    states: list[tuple[bool, int, int, int]] = []
    for gear in (FORWARD, BACKWARD):
        off = off_rad(course, heading + gear * np.pi)
        for does, end in ((STANDING, graph.head), (BOUND, graph.tail)):
            at_end = int(does == STANDING)
            lanes = (end == v) & (off[:, at_end] <= MAY_STAND_RAD) & turns.gears[:, gear]
            along |= bool(lanes.any())
            faces_so = np.flatnonzero(lanes & turns.stands[:, at_end]).tolist()
            states += [(does == STANDING and not turns.goes_on(lane, gear), does, lane, gear) for lane in faces_so]
    if states:
        _, does, lane, gear = min(states, key=lambda each: each[0])
        return does, lane, gear
    raise PlanError(f"{faces}, where " + ("it touches a wall" if along else "no lane leads that way or back"))


def off_rad(course: FloatArray, heading: float) -> FloatArray:
    """[N] by how much directions differ from a heading."""
    return np.abs(wrapped(course - heading))


class RoundTrips(NamedTuple):
    """The round trips of one type on a map: places to which it can come again and again."""

    is_on: BoolArray  # [V] places on them
    begins: BoolArray  # [V] places from which it comes on them, having moved nowhere yet
    behind: IntArray  # [V] vertex on which trailers stand at such a beginning, -1: none
    lanes: BoolArray  # [L] that lead on from a place on them to the next


def round_trips(graph: PlanGraph, vehicle: RobotType, among: IntArray) -> RoundTrips:
    """Those of a type that cannot turn in place, alone, of several the ones that pass most of some places."""
    moves = move_graph(graph, fleet_of(vehicle, 1), None)
    states, num_places = moves.states[0], graph.num_vertices
    component = strong_components(moves.num_vertices, moves.tail, moves.head)
    under_way = np.unique(states.at[UNDER_WAY][states.at[UNDER_WAY] >= 0])
    visited = np.unique(np.stack([component[under_way], states.place[under_way]], 1)[np.isin(states.place[under_way], among)], axis=0)
    if not len(visited):
        nowhere = np.zeros(num_places, np.bool_)
        return RoundTrips(nowhere, nowhere, np.full(num_places, -1), np.zeros(graph.num_lanes, np.bool_))
    on = component == np.bincount(visited[:, 0]).argmax()
    leads = on.copy()
    while (more := leads[moves.head] & ~leads[moves.tail]).any():
        leads[moves.tail[more]] = True
    is_on, begins, behind = np.zeros(num_places, np.bool_), leads[states.anywhere], np.full(num_places, -1)
    is_on[states.place[on]] = True
    if vehicle.trailers:
        stands = states.at[STANDING, :, FORWARD]
        begins[:] = False
        for lane in np.flatnonzero((stands >= 0) & leads[stands] & (graph.length_m >= vehicle.behind_m)).tolist():
            v = int(graph.head[lane])
            if not begins[v]:
                begins[v], behind[v] = True, int(graph.tail[lane])
    lanes = np.zeros(graph.num_lanes, np.bool_)
    lanes[moves.base_lane[on[moves.tail] & on[moves.head]]] = True
    return RoundTrips(is_on, begins, behind, lanes)


class EndStates(NamedTuple):
    """A states in which a type comes to a place."""

    state: IntArray  # [A]
    length_m: FloatArray  # [A, V'] to each from every vertex, inf: no way
    tail: IntArray  # [A] vertices of the map from which one comes
    leaves: BoolArray  # [A] whether one can go on from there
    heading_rad: FloatArray  # [A] in which the vehicle stands then, NaN: on an arc


def arrivals_at(graph: MoveGraph, kind: int, place: int) -> EndStates:
    """States in which a type of robots comes to a place, and how far it is to each. Those of a few hundred places are kept."""
    if (kind, place) not in graph.arrivals:
        if len(graph.arrivals) >= MOST_PLACES:
            graph.arrivals.pop(next(iter(graph.arrivals)))
        graph.arrivals[kind, place] = _arrivals(graph, kind, place)
    return graph.arrivals[kind, place]


def _arrivals(graph: MoveGraph, kind: int, place: int) -> EndStates:
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    states = graph.states[kind]
    ends = states.begin + np.flatnonzero(states.place == place)
    ends = ends[np.isin(ends, graph.head)]
    back = csr_array((graph.length_m, (graph.head, graph.tail)), shape=(graph.num_vertices,) * 2)
    length_m = dijkstra(back, indices=ends) if len(ends) else np.zeros((0, graph.num_vertices))
    into = np.array([np.flatnonzero(graph.head == end)[0] for end in ends.tolist()], np.int64)
    lane, backward = graph.base_lane[into], np.isin(ends, states.at[UNDER_WAY, :, BACKWARD])
    heading = course_rad(graph.base)[lane, 1] + np.pi * backward
    turns = turns_of(graph.base, graph.types[kind])
    bent = [stands_bent(turns, on, gear) is not None for on, gear in zip(lane.tolist(), backward.astype(np.int64).tolist())]
    heading[np.array(bent, np.bool_)] = np.nan
    return EndStates(ends, length_m, graph.base.tail[lane], np.isin(ends, graph.tail), heading)
