"""Causes of waiting in a run: for whom, and at which place in the end, robots stood.

Who stands behind a robot that stands waits for what that one waits for. So at every look a robot that stands is followed to the one that
is where it goes next, from there to the one where *that* one goes, and so on to the first that does not wait: one that is served (the
station binds), charged (the charger), or drives through (the place). A robot that stands before a free place waits for its station where
that is taken, for the planner where it has not set out since its last stop, for the aisle behind the place where somebody is in it who
is to come out there, and else for its turn at the place.

Where a robot goes next is read from where it went. Nothing is taken from plans, so that waiting which was planned counts as any other.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import FloatArray, IntArray, PlanGraph
from mrp_sumo.core.places import Places
from mrp_sumo.metrics.facilities import lift_use

LOOKS = 900  # of a run, at most
STOOD_M, STOOD_RAD = 0.02, 0.02  # moved and turned by less from a look to a second after it: a robot stands
IN_USE = 0.5  # share of the time for which the planner is at work, from which on robots at their last stops wait for it
NONE = -1
PLANNER = ("planner", "")
AISLES = ("aisle", "door")
Cause = tuple[str, str]  # kind and name


@dataclass(frozen=True)
class Pressed:
    """A place, station, lift or charger, or the planner, and what it costs."""

    waited_s: float  # robots, because of it
    share: float  # of the time for which all its places served somebody, or somebody stood because of it


@dataclass(frozen=True, eq=False)
class Look:
    """States of R robots at a look."""

    vertex: list[int]  # where they are
    towards: list[int]  # the next vertex that they went to, NONE: no other
    aim: list[int]  # the place of their next stop, NONE: none
    served: list[int]  # the stop that is being made, NONE: none
    last: list[int]  # the vertex of the stop before
    stands: list[bool]
    busy: list[bool]  # has a task
    place: list[int]
    onward: list[list[int]]  # [R, 2] the next two places that they went to, NONE: no other

    @cached_property
    def at(self) -> dict[int, int]:
        """The robot at each vertex that has one."""
        return {v: r for r, v in enumerate(self.vertex)}


def causes(
    execution: Execution, graph: PlanGraph, places: Places, since_s: float, planning_share: float, num_places: Mapping[Cause, int]
) -> dict[Cause, Pressed]:
    """Causes for which robots stood from a time on, in a run with tasks, and how much of that time each was pressed.

    `places` are what people call places of the graph that was driven on; `planning_share` is that of the time for which the planner was at
    work; `num_places` has those of stations, and to charge, those that nobody went to included.
    """
    stops, tasks = execution.stops, execution.tasks
    if stops is None or tasks is None or execution.sim_time_s <= since_s:
        return {}
    charges = ~tasks.is_order[stops.task] if len(stops.task) else np.zeros(0, np.bool_)
    name: list[Cause] = [("charger" if c else "station", s) for s, c in zip(stops.station, charges.tolist())]
    of_place = dict(zip(stops.vertex.tolist(), name))
    room = {cause: num_places.get(cause, num) for cause, num in Counter(of_place.values()).items()}
    t_s, look = _looks(execution, since_s)
    floor = _floor(graph, places)
    waited, pressed = defaultdict[Cause, int](int), defaultdict[Cause, set[int]](set)
    for k, row in enumerate(_looked_at(execution, graph, places, t_s, look)):
        served = Counter(name[s] for s in row.served if s != NONE)
        for cause, num_served in served.items():
            if num_served >= room[cause]:
                pressed[cause].add(k)
        for r in range(len(row.vertex)):
            if row.served[r] == NONE and row.stands[r] and row.busy[r]:
                cause = _cause(r, row, name, of_place, floor, planning_share)
                waited[cause] += 1
                pressed[cause].add(k)
    each_s = (execution.sim_time_s - since_s) / len(t_s)
    pressed_by = {cause: Pressed(waited[cause] * each_s, len(looks) / len(t_s)) for cause, looks in pressed.items()}
    for lift in lift_use(execution, graph, since_s):
        before = pressed_by.get(("lift", lift.name), Pressed(0.0, 0.0))
        pressed_by["lift", lift.name] = Pressed(before.waited_s, max(before.share, lift.busy_share))
    return pressed_by


@dataclass(frozen=True)
class _Floor:
    """Places, and which of them border on which."""

    places: Places
    beside: dict[int, set[int]]

    def cause(self, place: int) -> Cause:
        return self.places.kind[place], self.places.name[place]


def _floor(graph: PlanGraph, places: Places) -> _Floor:
    a, b = places.of_vertex[graph.tail], places.of_vertex[graph.head]
    beside = defaultdict[int, set[int]](set)
    for one, other in {*zip(a.tolist(), b.tolist())}:
        if one != other:
            beside[one].add(other)
            beside[other].add(one)
    return _Floor(places, dict(beside))


def _comes_out(r: int, look: Look, floor: _Floor, ahead: int) -> int:
    """The aisle that a robot before a free place is to enter, where somebody is in it who comes out towards that place; else NONE."""
    mouth = int(floor.places.of_vertex[ahead])
    aisle = next((p for p in look.onward[r] if p not in (NONE, mouth, look.place[r]) and floor.places.kind[p] in AISLES), NONE)
    ends = {p for p in floor.beside.get(aisle, ()) if floor.beside[p] == {aisle}}  # dead: who is there comes back
    near = {mouth, *floor.beside.get(mouth, ())} - {aisle}
    for other, place in enumerate(look.place):
        if other != r and place in {aisle, *ends}:
            out = next((p for p in look.onward[other] if p not in (aisle, NONE)), NONE)
            if out in near or out in ends or place in ends:
                return aisle
    return NONE


def _cause(r: int, look: Look, name: list[Cause], of_place: dict[int, Cause], floor: _Floor, planning_share: float) -> Cause:
    """What a robot that stands waits for in the end."""
    seen = {r}
    while True:
        ahead = look.towards[r] if look.towards[r] != NONE else look.aim[r]
        other = look.at.get(ahead, NONE)
        if other in (NONE, r):
            taken = look.at.get(look.aim[r], NONE)
            if taken not in (NONE, r) and look.served[taken] != NONE:
                return name[look.served[taken]]
            if ahead != NONE and ahead == look.aim[r] and ahead in of_place:
                return of_place[ahead]  # free for the moment: they change
            if look.vertex[r] == look.last[r] and planning_share >= IN_USE:
                return PLANNER
            if ahead != NONE and (aisle := _comes_out(r, look, floor, ahead)) != NONE:
                return floor.cause(aisle)
            return floor.cause(int(floor.places.of_vertex[look.vertex[r] if ahead == NONE else ahead]))
        if look.served[other] != NONE:
            return name[look.served[other]]
        if other in seen or not (look.stands[other] and look.busy[other]):
            if ahead in of_place:
                return of_place[ahead]
            return floor.cause(int(floor.places.of_vertex[ahead]))
        seen.add(other)
        r = other


def _looks(execution: Execution, since_s: float) -> tuple[FloatArray, IntArray]:
    """Times of looks [K], and samples of the trajectory at them, evenly spread; the last second is left out."""
    t = execution.t_s
    first, last = int(np.searchsorted(t, since_s)), max(int(np.searchsorted(t, execution.sim_time_s - 1.0)) - 1, 0)
    first = min(first, last)
    look = np.unique(np.linspace(first, last, min(LOOKS, last - first + 1)).astype(np.int64))
    return t[look], look


def _looked_at(execution: Execution, graph: PlanGraph, places: Places, t_s: FloatArray, look: IntArray) -> Iterator[Look]:
    from scipy.spatial import cKDTree

    stops, tasks = execution.stops, execution.tasks
    assert stops is not None and tasks is not None
    later = np.minimum(look + max(1, round(1.0 / execution.period_s)), len(execution.t_s) - 1)
    here = np.stack([execution.x_m[look], execution.y_m[look]], -1)
    then = np.stack([execution.x_m[later], execution.y_m[later]], -1)
    turned = np.abs(wrapped(execution.yaw_rad[later] - execution.yaw_rad[look]))
    stands = (np.hypot(*(then - here).transpose(2, 0, 1)) < STOOD_M) & (turned < STOOD_RAD)
    vertex = cKDTree(graph.xy).query(np.nan_to_num(here.reshape(-1, 2)))[1].reshape(here.shape[:2])
    towards = np.full(vertex.shape, NONE)
    for k in range(len(vertex) - 2, -1, -1):
        towards[k] = np.where(vertex[k + 1] != vertex[k], vertex[k + 1], towards[k + 1])
    towards = _one_lane_on(graph, vertex, towards)
    place = places.of_vertex[vertex]
    onward = np.full((*vertex.shape, 2), NONE)
    for k in range(len(vertex) - 2, -1, -1):
        moves = place[k + 1] != place[k]
        onward[k] = np.where(moves[:, None], np.stack([place[k + 1], onward[k + 1, :, 0]], 1), onward[k + 1])
    aim, served, last = (np.full(vertex.shape, NONE) for _ in range(3))
    busy = np.zeros(vertex.shape, np.bool_)
    columns = (stops.robot, stops.since_s, stops.begin_s, stops.end_s, stops.vertex)
    for s, (robot, since_s, begin_s, end_s, v) in enumerate(zip(*(column.tolist() for column in columns))):
        a, b, c = np.searchsorted(t_s, [since_s, begin_s, end_s])
        aim[a:b, robot], served[b:c, robot], last[c:, robot] = v, s, v
    for robot, assigned_s, done_s in zip(tasks.robot.tolist(), tasks.assigned_s.tolist(), tasks.done_s.tolist()):
        if robot >= 0 and np.isfinite(assigned_s):
            a, b = np.searchsorted(t_s, [assigned_s, done_s if np.isfinite(done_s) else np.inf])
            busy[a:b, robot] = True
    yield from (Look(*(column.tolist() for column in row)) for row in zip(vertex, towards, aim, served, last, stands, busy, place, onward))


def _one_lane_on(graph: PlanGraph, vertex: IntArray, towards: IntArray) -> IntArray:
    """[K, R] of the vertices one lane from where robots are, the one nearest to where they were seen next."""
    ahead = towards.copy()
    pairs = np.unique(np.stack([vertex.reshape(-1), towards.reshape(-1)], 1), axis=0)
    step: dict[tuple[int, int], int] = {}
    for v, w in pairs.tolist():
        ends = graph.head[graph.first[v] : graph.first[v + 1]]
        if w != NONE and len(ends):
            step[v, w] = int(ends[np.hypot(*(graph.xy[ends] - graph.xy[w]).T).argmin()])
    for (v, w), on in step.items():
        ahead[(vertex == v) & (towards == w)] = on
    return ahead
