"""Places that robots are to go to: those where their stops are made, where they wait for one, or where they are out of the others' way.

A robot for which no place is free, or which cannot come to one since somebody stands in between, drives up as near as it can and waits
there: at the station's places to wait, in their order, where it has some, else at the nearest vertex from which who is being served can
still get out and past it. Robots that rest where others have to pass are sent on (`drive.clearing`). All robots are sent to different
vertices, and no two to vertices that exclude each other, as planners see it: nearer than they may be, in one mutex group, or such that
neither can be reached while a robot is at the other. Trailers take the vertex before the last on the way.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache
from itertools import chain, combinations
from types import MappingProxyType

import numpy as np

from mrp_sumo.core.digraph import strong_components
from mrp_sumo.core.graph import BoolArray, IntArray, PlanGraph, with_lanes
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.task import Stop
from mrp_sumo.drive.clearing import cleared
from mrp_sumo.search._distance import reversed_lanes, steps_to
from mrp_sumo.search.distance import UNREACHABLE, Distances, StepArray, distances
from mrp_sumo.search.route import reach_m
from mrp_sumo.traffic.clashes import exclusive_vertices

NONE_HELD: Mapping[int, Collection[int]] = MappingProxyType({})
CROSSING = 3  # lanes from a vertex where two robots can change places


class RobotPlaces:
    """Places that the robots of a problem can go to."""

    def __init__(self, problem: Problem, parking: Sequence[int] = ()) -> None:
        """Robots without work go to `parking`, as far as there is room."""
        self._problem, self._parking, self._excludes = problem, parking, exclusive_vertices(problem)
        self._behind: IntArray | None = None
        self._outwards: dict[tuple[PlanGraph, int], tuple[int, ...]] = {}  # vertices by their distance from one
        self._dead_ends: dict[tuple[PlanGraph, int], tuple[int, ...]] = {}  # see `_dead_end`
        self._piece: dict[tuple[int, int], IntArray] = {}  # [V] strong components by type and start, -1: not reached from there

    def see(self, problem: Problem, behind: IntArray | None = None) -> None:
        """Robots are loaded as in this problem from now on; trailers stand on vertices `behind` [R], -1: none; None: nobody tows any."""
        self._problem, self._behind = problem, behind

    def away(self, robot: int, at: int, stop: Stop) -> int:
        """Steps from a vertex to the nearest place of a stop, `UNREACHABLE` where there is no way."""
        known = self._distances(robot)
        return min(int(known.to(v)[at]) for v in stop.places)

    def farthest(self, robot: int, stop: Stop) -> int:
        """Steps of the longest of the shortest ways to a stop."""
        steps = np.minimum.reduce([self._distances(robot).to(v) for v in stop.places])
        return int(steps[steps < UNREACHABLE].max(initial=0))

    def route(self, robot: int, at: int, stop: Stop, blocked: set[int]) -> list[int]:
        """The vertices of a shortest route from one to the nearest place of a stop, both included; just the first where there is none.

        It passes no `blocked` vertex unless every way does.
        """
        reach = self._reach(robot, at, blocked - {at})
        _, away, place = min((int(reach[v]), int(self._distances(robot).to(v)[at]), v) for v in stop.places)
        return self._way(robot, at, place, blocked) if away < UNREACHABLE else [at]

    def can_come(self, robot: int, at: int, stop: Stop, blocked: set[int]) -> bool:
        """True if a robot can come from a vertex to a place of a stop without passing some others."""
        reach = self._reach(robot, at, blocked - {at})
        return any(reach[v] < UNREACHABLE for v in stop.places)

    def can_let_pass(self, robot: int, at: int, route: Sequence[int], blocked: set[int], *, back: bool = False) -> bool:
        """True if a robot that stands on another's route can get off it without passing its end or some others.

        It passes the other one only if both may drive `back`, to a crossing of three lanes or more.
        """
        reach = self._reach(robot, at, blocked | ({route[-1]} if back else {route[0], route[-1]}))
        if back and not (np.diff(self._graph(robot).first)[reach < UNREACHABLE] >= CROSSING).any():
            return False
        reach[list({*route, *blocked})] = UNREACHABLE
        return bool((reach < UNREACHABLE).any())

    def has_room(self, robot: int, stops: Sequence[Stop]) -> bool:
        """True if a robot's type can come from its start to some stops, and from each of them to the others.

        It need not come back to its start: a vehicle may begin where it never turns round again.
        """
        if self._problem.barred is None:
            return True
        fleet, kind, start = self._problem.fleet, int(self._problem.fleet.kind[robot]), int(self._problem.start[robot])
        if (kind, start) not in self._piece:
            graph = self._problem.graph_of_kind[kind]
            barred = self._problem.barred
            if fleet.loaded is not None and fleet.is_by_load:  # on its way it is now loaded, now not
                graph = with_lanes(self._problem.graph, ~(barred[kind] & barred[int(fleet.loaded.kind[robot])]))
            reached = _steps(start, graph.first, graph.head) < UNREACHABLE
            self._piece[kind, start] = np.where(reached, strong_components(graph.num_vertices, graph.tail, graph.head), -1)
        piece = self._piece[kind, start]
        return bool(set.intersection(*({int(piece[v]) for v in stop.places} for stop in stops)) - {-1})

    def beside(self, stands: IntArray) -> list[int]:
        """Vertices, those clear of a robot on or between some others first; of these the nearest."""
        graph = self._problem.graph
        away_m = np.hypot(*(graph.xy[:, None] - graph.xy[stands][None]).transpose(2, 0, 1)).sum(1)
        away_m[list(self._closed_by(set(stands.tolist())))] = np.inf
        near: list[int] = np.argsort(away_m, kind="stable").tolist()
        return near

    def choose(
        self,
        start: IntArray,
        stays: BoolArray,
        stops: Mapping[int, Stop],
        turn: Iterable[int],
        aged: Collection[int] = (),
        not_free: Mapping[int, Collection[int]] = NONE_HELD,
    ) -> tuple[IntArray, BoolArray]:
        """[R] vertices where robots are to go, and whether they can make their stops there.

        `start` [R] is where their ways begin, `stays` [R] which stay there; `stops` has those to be made by robots, which choose in `turn`.

        Who leaves the place of a robot that is `aged`, passed over often, does not push it away, but steps aside where it can; and nobody
        is served at a place that is on every way of one: it would be shut in behind it. `not_free` are places where a robot cannot make its
        stop, because of what was set down there. One that cannot at any place waits where it is in nobody's way: others have to come there
        before.
        """
        vertex, makes = start.copy(), np.zeros(len(start), np.bool_)
        blocked, taken = set(start[stays].tolist()), set[int]()
        for r in np.flatnonzero(stays).tolist():
            taken |= self._held(r, int(start[r]), int(start[r]))
        waits: set[int] = set()  # vertices where somebody is to wait
        ways: list[tuple[Stop, list[int]]] = []  # of those who have a place
        lines: dict[tuple[int, ...], dict[int, set[int]]] = {}  # robots that wait for the same places; where each may not
        stuck: list[int] = []
        comes_out: list[tuple[set[int], list[int]]] = []  # places that would shut in one that was passed over often, and its way
        for r in turn:
            at, stop, closed = int(start[r]), stops[r], self._closed_by(taken)
            reach = self._reach(r, at, blocked)
            comes = next((a for a in aged if makes[a] and vertex[a] == at), None)
            if comes is not None and (aside := self._aside(r, at, stop, blocked, int(start[comes]), closed)) is not None:
                vertex[r] = aside
                taken |= self._held(r, at, aside)
                continue
            shuts_in = [route for doors, route in comes_out if not doors.isdisjoint(stop.places)]
            full = not_free.get(r, ())
            place = self._nearest(r, at, [v for v in stop.places if reach[v] < UNREACHABLE], closed.union(*shuts_in, full))
            past = _before(at, [route for other, route in ways if other.places == stop.places], reach).union(*shuts_in)
            if place is not None:
                vertex[r], makes[r] = place, True
                ways.append((stop, self._way(r, at, place, blocked)))
            elif set(stop.places).issubset(full) and not stop.queue:  # until others come there, whom it lets by
                stuck.append(r)
                continue
            elif (wait := self._where_to_wait(r, at, stops, taken | past, blocked, waits, reach)) is not None:
                vertex[r] = wait
                waits.add(wait)
                if wait not in stop.queue:
                    lines.setdefault(stop.places, {})[r] = past
            else:
                stuck.append(r)
                continue
            taken |= self._held(r, at, int(vertex[r]))
            if r in aged and (doors := self._doors(r, at, int(vertex[r]), stops, blocked)):
                comes_out.append((doors, self._way(r, at, int(vertex[r]), blocked)))
        for line in lines.values():
            self._keep_order(line, start, vertex)
        self._stay_behind({r: past for line in lines.values() for r, past in line.items()}, stops, start, vertex, blocked, taken)
        idle = [r for r in range(len(start)) if not stays[r] and r not in stops]
        parked = self._park(start, vertex, idle, taken)
        self._rest(start, vertex, [*stuck, *(r for r in idle if r not in parked)], blocked, taken)
        return vertex, makes

    def _doors(self, robot: int, at: int, to: int, stops: Mapping[int, Stop], blocked: set[int]) -> set[int]:
        """Places of other stops that are on every way of a robot."""
        places = {v for stop in stops.values() if stop.places != stops[robot].places for v in stop.places}
        on_way = places.intersection(self._way(robot, at, to, blocked)[1:-1])
        return {v for v in on_way if self._reach(robot, at, blocked | {v})[to] >= UNREACHABLE}

    def _park(self, start: IntArray, vertex: IntArray, idle: list[int], taken: set[int]) -> set[int]:
        """Send idle robots to the nearest places to park that are free; returns those that have one."""
        parked = set[int]()
        for r in idle:
            if self._parking and (spot := self._nearest(r, int(start[r]), self._parking, self._closed_by(taken))) is not None:
                vertex[r] = spot
                taken |= self._held(r, int(start[r]), spot)
                parked.add(r)
        return parked

    def _rest(self, start: IntArray, vertex: IntArray, rest: list[int], blocked: set[int], taken: set[int]) -> None:
        """Send robots without a place to where they are in nobody's way, those first that stand in the way of others."""
        stood_on = set(start.tolist())
        sent_on = self._sent_on(start, vertex, rest, blocked, taken)
        for r, v in sent_on.items():
            vertex[r] = v
            taken |= self._held(r, int(start[r]), v)
        for r in (r for r in rest if r not in sent_on):
            vertex[r] = self._resting_place(r, int(start[r]), taken, stood_on)
            taken |= self._held(r, int(start[r]), int(vertex[r]))

    def _aside(self, robot: int, at: int, stop: Stop, blocked: set[int], comes: int, closed: set[int]) -> int | None:
        """The vertex nearest to a robot that is none of the way of another that comes to where it is; None: its own way is none of it."""
        if comes not in self.route(robot, at, stop, blocked):
            return None
        reach = self._reach(robot, at, blocked | {comes})
        reach[list({at, *closed, *self._way(robot, comes, at)})] = UNREACHABLE
        near = np.argsort(reach, kind="stable")[: (reach < UNREACHABLE).sum()].tolist()
        return next((v for v in near if closed.isdisjoint(self._held(robot, at, v))), None)

    def _stay_behind(
        self,
        waiting: Mapping[int, set[int]],
        stops: Mapping[int, Stop],
        start: IntArray,
        vertex: IntArray,
        blocked: set[int],
        taken: set[int],
    ) -> None:
        """Have robots wait behind others that stand where they wait and cannot be passed: these would drive once round a one-way ring."""
        for r, past in waiting.items():
            at, own = int(start[r]), int(vertex[r])
            stand = {int(start[s]) for s in waiting if s != r and vertex[s] == start[s]}
            behind = self._reach(r, at, blocked | stand)
            if behind[own] < UNREACHABLE:
                continue
            held = self._held(r, at, own)
            wait = self._where_to_wait(r, at, stops, (taken - held) | past, blocked, stand, behind)
            if wait is not None:
                taken -= held
                taken |= self._held(r, at, wait)
                vertex[r] = wait

    def _keep_order(self, line: Mapping[int, set[int]], start: IntArray, vertex: IntArray) -> None:
        """Swap where robots of a line wait, so that none has to pass another.

        Two swap if one stands on the other's way, the sum of the squares of their steps falls, and neither then passes the other's place.
        """

        def squares(r: int, v: int) -> float:
            return float("inf") if v in line[r] else float(self._distances(r).to(v)[start[r]]) ** 2

        swapped = True
        while swapped:
            swapped = False
            for r, s in combinations(line, 2):
                one, other = int(vertex[r]), int(vertex[s])
                if squares(r, other) + squares(s, one) >= squares(r, one) + squares(s, other):
                    continue
                ways = [self._way(q, int(start[q]), v) for q, v in ((r, one), (s, other), (r, other), (s, one))]
                if (start[s] in ways[0] or start[r] in ways[1]) and one not in ways[2][1:] and other not in ways[3][1:]:
                    vertex[r], vertex[s], swapped = other, one, True

    def _distances(self, robot: int) -> Distances:
        return distances(self._graph(robot))

    def _graph(self, robot: int) -> PlanGraph:
        return self._problem.graph_of_kind[int(self._problem.fleet.kind[robot])]

    def _nearest(self, robot: int, at: int, choice: Sequence[int], taken: set[int]) -> int | None:
        """The nearest of some vertices that nobody has, None where none can be reached."""
        known = self._distances(robot)
        free = (v for v in choice if taken.isdisjoint(self._held(robot, at, v)))
        away, v = min(((int(known.to(v)[at]), v) for v in free), default=(UNREACHABLE, -1))
        return v if away < UNREACHABLE else None

    def _where_to_wait(
        self,
        robot: int,
        at: int,
        stops: Mapping[int, Stop],
        taken: set[int],
        blocked: set[int],
        waits: set[int],
        past: StepArray,
    ) -> int | None:
        """The first free place to wait of a stop's station; elsewhere the nearest vertex that leaves the way out open.

        `past` are the steps from the robot to each vertex without passing those that are blocked.

        It is one where others are to be served, or in a dead end that they have to come out of, only if there is no other. It is best
        behind those who wait already: on a one-way ring they would have to drive once round to let this one pass.
        """
        known, graph, stop = self._distances(robot), self._graph(robot), stops[robot]
        away, place = min((int(known.to(v)[at]), v) for v in stop.places)
        if away >= UNREACHABLE:
            return None
        behind, closed = self._reach(robot, at, blocked | waits - {at}) if waits else past, self._closed_by(taken)
        for v in stop.queue:
            if past[v] < UNREACHABLE and closed.isdisjoint(self._held(robot, at, v)):
                return v
        occupied, steps = self._occupied(robot, at, place, blocked), known.to(place)
        rank = 2 * steps.astype(np.int64)
        rank[at] -= 1  # of vertices that are as near, the one where it is
        wanted = np.zeros(graph.num_vertices, np.bool_)
        served = {v for other in stops.values() for v in other.places}
        wanted[list(self._closed_by(served.union(*(self._dead_end(graph, v) for v in served | blocked))))] = True
        for reach, may in ((behind, ~wanted), (past, ~wanted), (behind, wanted), (past, wanted)):
            there = (reach < UNREACHABLE) & (steps < UNREACHABLE) & may
            for v in np.argsort(np.where(there, rank, 2 * UNREACHABLE), kind="stable").tolist()[: there.sum()]:
                if v in stop.places or graph.vertex_options[v].get("is_passthrough_point"):
                    continue
                if closed.isdisjoint(self._held(robot, at, v)) and all(self._leaves_way_out(robot, p, v, waits) for p in occupied):
                    return int(v)
        return None

    def _dead_end(self, graph: PlanGraph, place: int) -> tuple[int, ...]:
        """The vertices between a place to which only one way leads and the first crossing on it."""

        def beside(v: int, behind: int) -> set[int]:
            return {*graph.head[graph.tail == v].tolist(), *graph.tail[graph.head == v].tolist()} - {behind, v}

        if (graph, place) not in self._dead_ends:
            route, ahead = [place], beside(place, -1)
            while len(ahead) == 1:
                route.append(ahead.pop())
                ahead = beside(route[-1], route[-2])
            self._dead_ends[graph, place] = tuple(route[1:-1])
        return self._dead_ends[graph, place]

    def _occupied(self, robot: int, at: int, place: int, blocked: set[int]) -> list[int]:
        """The place that a robot waits for, and the first blocked vertex on the shortest way there."""
        ahead = (v for v in self._way(robot, at, place)[1:] if v in blocked)
        return list(dict.fromkeys([place, *([first] if (first := next(ahead, None)) is not None else [])]))

    def _held(self, robot: int, at: int, v: int) -> set[int]:
        """Vertices that a robot takes where it stops: one, and of those that tow the one before on the way there, or where trailers are."""
        if self._behind is None or self._behind[robot] < 0 or self._distances(robot).to(v)[at] >= UNREACHABLE:
            return {v}
        return {v, int(self._behind[robot]) if v == at else self._way(robot, at, v)[-2]}

    def _closed_by(self, taken: set[int]) -> set[int]:
        """Some vertices, and those at which no robot may be while others are there."""
        return taken.union(*(self._excludes[v] for v in taken if v in self._excludes)) if self._excludes else taken

    def _leaves_way_out(self, robot: int, place: int, vertex: int, waits: set[int]) -> bool:
        """True if who is at a place can still get out, and clear of the way in, if a robot waits at a vertex and others at theirs.

        Getting out is not enough where it is a dead end: from there the rest of the floor must be in reach without the place.
        """
        if vertex == place:
            return False
        graph = self._graph(robot)
        out = self._reach(robot, place, waits | {vertex}) < UNREACHABLE
        out[self._way(robot, vertex, place)] = False
        back = _steps(vertex, *reversed_lanes(*_without(graph, {place}, tails=True)))
        return bool((out & (back < UNREACHABLE)).any())

    def _reach(self, robot: int, at: int, blocked: set[int]) -> StepArray:
        """[V] steps from a vertex to each other without passing some."""
        return _steps(at, *_without(self._graph(robot), blocked))

    def _way(self, robot: int, start: int, end: int, blocked: set[int] | None = None) -> list[int]:
        """The vertices of a shortest way, both ends included; it passes no `blocked` vertex unless every way does."""
        graph = self._graph(robot)
        route = _downhill(graph, start, end, self._distances(robot).to(end))
        if not blocked or blocked.isdisjoint(route[1:]):
            return route
        steps = _steps(end, *reversed_lanes(*_without(graph, blocked)))
        if steps[start] >= UNREACHABLE:
            return route
        steps[list(blocked - {start, end})] = UNREACHABLE
        return _downhill(graph, start, end, steps)

    def _sent_on(self, start: IntArray, vertex: IntArray, rest: Sequence[int], blocked: set[int], taken: set[int]) -> dict[int, int]:
        """Vertices, off the ways of others, of those who rest where there is no way round them."""
        goes = [r for r in np.flatnonzero(vertex != start).tolist() if self._distances(r).to(int(vertex[r]))[start[r]] < UNREACHABLE]
        idle = {r: int(start[r]) for r in rest}

        def is_on_way(robot: int, v: int) -> bool:
            steps, there = self._distances(robot).to(int(vertex[robot])), steps_there(robot)
            passes = any(int(there[u]) + int(steps[u]) == int(steps[start[robot]]) for u in self._closed_by({v}))
            return passes and not passable(robot, v)

        @cache
        def steps_there(robot: int) -> StepArray:
            return self._reach(robot, int(start[robot]), set())

        @cache
        def passable(robot: int, v: int) -> bool:
            return bool(self._reach(robot, int(start[robot]), blocked | self._closed_by({v}))[vertex[robot]] < UNREACHABLE)

        if not any(is_on_way(r, v) for r in goes for v in idle.values()):
            return {}
        graph = self._problem.for_any().graph
        ways = [self._way(r, int(start[r]), int(vertex[r])) for r in goes]
        return cleared(
            graph, ways, idle, blocked, self._closed_by(taken),
            near=lambda v, others: not self._excludes.get(v, frozenset()).isdisjoint(others),
            passable=lambda n, v: passable(goes[n], v),
        )  # fmt: skip

    def _resting_place(self, robot: int, at: int, taken: set[int], stood_on: set[int]) -> int:
        """The vertex nearest to where a robot is that nobody needs, where best nobody is."""
        closed = self._closed_by(taken)
        if closed.isdisjoint(self._held(robot, at, at)):
            return at
        graph = self._graph(robot)
        if (graph, at) not in self._outwards:
            away_m = reach_m(graph, np.ones(graph.num_lanes, np.bool_), np.array([at]))[0]
            self._outwards[graph, at] = tuple(np.argsort(away_m, kind="stable").tolist())
        free = (v for v in self._outwards[graph, at] if closed.isdisjoint(self._held(robot, at, v)))
        nearest = next(free, None)
        if nearest is None:
            return next(v for v in self._outwards[graph, at] if v not in taken)
        clear = (v for v in chain((nearest,), free) if not graph.vertex_options[v].get("is_passthrough_point"))
        return next((v for v in clear if v not in stood_on), nearest)


def _before(at: int, routes: Sequence[Sequence[int]], reach: StepArray) -> set[int]:
    """Vertices on the ways of others where a robot would be before them, and in their way; all of a way on which it stands.

    `reach` are its steps to each vertex.
    """
    return {v for route in routes for n, v in enumerate(route) if at in route or reach[v] <= n}


def _steps(at: int, first: IntArray, head: IntArray) -> StepArray:
    """[V] steps from a vertex to each other over some lanes."""
    steps, queue = np.empty(len(first) - 1, np.int32), np.empty(len(first) - 1, np.int64)
    steps_to(at, first, head, steps, queue)
    return steps


def _downhill(graph: PlanGraph, start: int, end: int, steps: StepArray) -> list[int]:
    """The vertices of a way on which the steps to its end become fewer, both ends included."""
    route = [start]
    while route[-1] != end:
        v = route[-1]
        route.append(min(graph.head[graph.first[v] : graph.first[v + 1]].tolist(), key=lambda u: (int(steps[u]), u)))
    return route


def _without(graph: PlanGraph, vertices: set[int], *, tails: bool = False) -> tuple[IntArray, IntArray]:
    """[V + 1], [L'] the lanes that do not lead to some vertices, nor, with `tails`, from them."""
    if not vertices:
        return graph.first, graph.head
    barred = np.zeros(graph.num_vertices, np.bool_)
    barred[list(vertices)] = True
    open_lanes = ~(barred[graph.head] | barred[graph.tail]) if tails else ~barred[graph.head]
    count = np.bincount(graph.tail[open_lanes], minlength=graph.num_vertices)
    return np.concatenate([[0], np.cumsum(count)]).astype(np.int64), graph.head[open_lanes]
