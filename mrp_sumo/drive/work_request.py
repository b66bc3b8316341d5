"""Requests for ways to the stops of tasks, and what robots have to do when they are on these ways.

Who comes to a station first is served first, unless orders differ in priority; others drive up behind (`drive.places`). Robots without
work stay where they are, unless somebody has to come there.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import dropwhile, pairwise
from types import MappingProxyType

import numpy as np

from mrp_sumo.core.graph import BoolArray, IntArray, frozen
from mrp_sumo.core.request import Request, with_stops_before
from mrp_sumo.core.task import NOBODY, Stop
from mrp_sumo.drive.crew import PATIENCE, Crew
from mrp_sumo.drive.robot_work import NONE, Leg, RobotWork, TourStop
from mrp_sumo.errors import PlugInError
from mrp_sumo.search.distance import distances

NO_TOURS: Mapping[int, Sequence[TourStop]] = MappingProxyType({})
STANDS_S = 60.0  # without a stop, after which nobody is let by: whoever can goes first


@dataclass(frozen=True, eq=False)
class WorkRequest(Request):
    """A request for ways to the stops of tasks."""

    assigned: Mapping[int, int] = field(default_factory=dict)  # tasks, by the robots that are to have them
    tours: Mapping[int, Sequence[TourStop]] = field(default_factory=dict)  # stops ahead, of robots that are to have several orders
    legs: Mapping[int, Sequence[Leg]] = field(default_factory=dict)  # stops on the ways of its robots
    waits: Mapping[int, int] = field(default_factory=dict)  # vertices where robots are to wait for a place
    loads: Mapping[int, int] = field(default_factory=dict)  # on board of robots on these ways
    at_once: frozenset[int] = frozenset()  # robots that may begin with what they are given as soon as they are done with what they have


def work_request(
    crew: Crew, now_s: float, closed: BoolArray, assigned: Mapping[int, int], tours: Mapping[int, Sequence[TourStop]] = NO_TOURS
) -> WorkRequest:
    """The request for the ways of all robots that are not at work. Raises PlugInError for a task that needs a robot of another type.

    `assigned` are tasks for robots that have none, or have one that they may pass on; it goes back to those that wait, if nobody is given
    it. `tours` are stops for robots that have room for more orders, after what they are committed to; with those that they have, in whole
    orders.
    """
    _check(crew, [*assigned.items(), *((r, task) for r, tour in tours.items() for task, _ in tour)])
    crew.is_changed = False
    committed = crew.ledger.committed
    start, site = np.array([vertices[-1] for vertices in committed], np.int64), crew.site
    crew.places.see(site, crew.ledger.behind if site.fleet.behind_m.any() else None)
    stays = np.array([robot.is_busy or robot.is_out for robot in crew.robots], np.bool_)
    robots, passed_on = np.flatnonzero(~stays), set(assigned.values())
    on_the_way: dict[int, list[Leg]] = {}  # stops that robots make on what they are committed to
    legs: dict[int, list[Leg]] = {}  # and on their new ways
    stop: dict[int, Stop] = {}
    for r in robots.tolist():
        if crew.robots[r].is_broken:  # who pushes it makes no stops
            on_the_way[r], legs[r] = [], []
            continue
        on_the_way[r], ahead = _after_committed(crew, crew.robots[r], committed[r])
        if r in tours:
            ahead = [each for each in tours[r] if each not in [leg[:2] for leg in on_the_way[r]]]
        elif r in assigned or (ahead and ahead[0][0] in passed_on):
            ahead = crew.stops_of(assigned[r]) if r in assigned else []
        legs[r] = []
        if ahead:
            legs[r] = _in_passing(crew, r, int(start[r]), ahead)
            task, nth = ahead[len(legs[r])]
            stop[r] = crew.tasks[task].stops[nth]
            legs[r].append(Leg(task, nth, NONE))
    aged = passed_over(crew, stop, now_s)
    turn = in_turn(crew, start, stop, {r: legs[r][-1].task for r in stop}, stays, aged)
    single = {r: legs[r] for r in stop if r not in tours}
    if swapped := older_first(crew, [r for r in turn if r in single], stop, single, assigned, aged):
        return work_request(crew, now_s, closed, {**assigned, **swapped}, tours)
    not_free = {r: full for r in stop if (full := crew.not_free(legs[r][-1].task, legs[r][-1].nth))}
    vertex, makes = crew.places.choose(start, stays, stop, turn, aged, not_free)
    via = [list(dropwhile(start[r].__eq__, (leg.vertex for leg in legs[r][:-1]))) for r in robots.tolist()]
    last = {r: legs[r].pop() for r in stop}
    comes = (vertex[robots] != start[robots]) | np.isin(robots, [r for r in stop if makes[r]])
    for r in stop:
        if makes[r]:
            legs[r].append(last[r]._replace(vertex=int(vertex[r])))
    request = WorkRequest(
        now_s=now_s,
        site=site,
        robot=frozen(robots),
        start=frozen(start[robots]),
        stop_first=np.arange(len(robots) + 1),
        stop=frozen(vertex[robots]),
        closed=closed.copy(),
        reason="tasks",
        end_heading_rad=crew.end_heading_rad(robots, vertex[robots], comes),
        there_s={r: crew.stop_s(r, last[r].task, last[r].nth) for r in stop if makes[r] and [leg.vertex for leg in legs[r]] == [start[r]]},
        assigned=dict(assigned),
        tours=dict(tours),
        legs={r: (*on_the_way[r], *legs[r]) for r in robots.tolist()},
        waits={r: int(vertex[r]) for r in stop if not makes[r]},
        loads=dict(enumerate(crew.loads_ahead.tolist())),
        at_once=frozenset(r for r in assigned if crew.robots[r].leaves or _is_just_done(crew, crew.robots[r])),
    )
    return with_stops_before(request, via)


def still_fits(crew: Crew, request: WorkRequest, moved: Collection[int]) -> bool:
    """True if those robots of a request that are sent on may still leave: a service may have begun, or a robot be lost, or have a load."""
    sent = [crew.robots[r] for r in request.robot.tolist() if r in moved]
    if crew.problem.fleet.loaded is not None and any(robot.loads != request.loads[robot.number] for robot in sent):
        return False
    return not any(_stays(crew, robot, request.now_s) for robot in sent)


def take_over(crew: Crew, request: WorkRequest, now_s: float) -> None:
    """Robots are on the ways that were asked for."""
    robots = crew.robots
    assigned = {r: k for r, k in request.assigned.items() if _may_take(crew, robots[r], k)}
    taken_back = {other for r, task in assigned.items() for other in (r, crew.orders.robot[task]) if other != NOBODY}
    freed = [crew.take_back(robots[r], now_s) for r in sorted(taken_back) if crew.may_pass_on(robots[r])]
    for r, task in assigned.items():
        _give(crew, robots[r], task, now_s, request)
    for r, tour in request.tours.items():
        _extend(crew, robots[r], tour, now_s, request)
    crew.is_changed |= len(assigned) < len(request.assigned) or any(crew.orders.robot[k] == NOBODY for k in freed)
    here = crew.ledger.visits.vertex[crew.ledger.visits.reached].tolist()
    for robot in (robots[r] for r in request.robot.tolist()):
        if robot.making is not None or robot.is_out:
            continue
        is_there = bool(robot.legs) and robot.legs[0].vertex == here[robot.number]  # but was to go on
        if robot.charges or robot.wait_at != NONE or is_there:  # nobody is served, or has a place, before the answer is there
            robot.earliest_s = max(robot.earliest_s, now_s)
        robot.legs = [leg for leg in request.legs[robot.number] if _is_ahead(robot, leg)]
        robot.wait_at = request.waits.get(robot.number, NONE) if robot.task != NONE else NONE
        robot.leaves = False
        crew.follow(robot, now_s)


def _check(crew: Crew, assigned: Iterable[tuple[int, int]]) -> None:
    """Refuse tasks for robots that cannot do them. Raises PlugInError."""
    if (wrong := next(((r, k) for r, k in assigned if not crew.can_do(r, k)), None)) is not None:
        name, needs = crew.problem.fleet.robot_name[wrong[0]], crew.tasks[wrong[1]]
        if needs.robot not in (NOBODY, wrong[0]):
            raise PlugInError(f"order '{needs.name}' is for {crew.problem.fleet.robot_name[needs.robot]}, not for {name}")
        if not crew.is_for(*wrong):
            if needs.load_kg > (most_kg := float(crew.problem.fleet.max_load_kg[wrong[0]])):
                raise PlugInError(f"order '{needs.name}' weighs {needs.load_kg:g} kg, {name} carries {most_kg:g} kg at most")
            raise PlugInError(f"order '{needs.name}' needs a robot of type '{needs.robot_type}', {name} is none")
        raise PlugInError(f"order '{needs.name}' is nothing for {name}, which has no room on the way")


def _after_committed(crew: Crew, robot: RobotWork, committed: Sequence[int]) -> tuple[list[Leg], list[TourStop]]:
    """Stops that a robot makes on what it is committed to; then those that it goes on with."""
    legs = list[Leg]()
    ahead = [*robot.tour, *(crew.stops_of(robot.then) if robot.then != NONE else ())]
    if robot.leaves and robot.making is not None:
        return legs, ahead[1:]
    at = 0
    for leg, next_stop in zip(robot.legs[: len(robot.legs) - (not robot.leaves)], ahead):
        if leg.vertex not in committed[at:] or leg[:2] != next_stop:
            break
        at = list(committed).index(leg.vertex, at)
        legs.append(leg)
    return legs, ahead[len(legs) :]


def _in_passing(crew: Crew, robot: int, at: int, ahead: Sequence[TourStop]) -> list[Leg]:
    """The first of some stops ahead of a robot at a vertex that it makes in passing, followed by another of the same task."""
    passed, left = list[Leg](), crew.ahead_steps
    for (task, nth), (following, _) in pairwise(ahead):
        places, station = crew.tasks[task].stops[nth].places, crew.tasks[task].stops[nth].station
        passes = station is None or (not station.holds and station.heading_rad is None)
        if left <= 0 or not passes or following != task or crew.stop_s(robot, task, nth) or len(places) > 1:
            break
        left -= int(distances(crew.problem.graph).to(places[0])[at])
        if left > 0:
            passed.append(Leg(task, nth, places[0]))
            at = places[0]
    return passed


def passed_over(crew: Crew, robots: Iterable[int], now_s: float) -> set[int]:
    """Robots that were passed over often on the way to their next stop; on the way to the one where they are counts no more.

    None where no stop has been made for long: a crowd may be standing because others make room for them.
    """
    if now_s - crew.made_s >= STANDS_S:
        return set()
    return {r for r in robots if crew.robots[r].num_before >= PATIENCE and crew.robots[r].making is None}


def in_turn(
    crew: Crew, start: IntArray, stops: Mapping[int, Stop], task: Mapping[int, int], stays: BoolArray, aged: Collection[int]
) -> list[int]:
    """Robots in the order in which they choose where to make their stops.

    Who came to its place first, then who was passed over often, then the most urgent; then who came first and waits; then who is nearest.
    Nobody comes before those who stand on its way there, but for those who set out when it waited already, if they can let it pass: beside
    its way or, on a ring, past it; behind it where it was passed over often.
    """
    places = crew.places
    stands = set(start[stays].tolist())
    away = {r: places.away(r, int(start[r]), stop) for r, stop in stops.items()}
    came_s = {r: crew.robots[r].since_s if r in aged else crew.robots[r].in_line_since_s for r in stops}
    is_there = {r: away[r] == 0 and crew.robots[r].in_line_since_s < np.inf for r in stops}
    wished = sorted(stops, key=lambda r: (not is_there[r], r not in aged, -crew.tasks[task[r]].priority, came_s[r], away[r], task[r]))
    order: list[int] = []
    for n, r in enumerate(wished):
        if r in order:
            continue
        nearer = [s for s in wished[n + 1 :] if s not in order and away[s] < away[r] and stops[s].places == stops[r].places]
        if nearer:
            route = places.route(r, int(start[r]), stops[r], stands)
            new = [s for s in nearer if r in aged or came_s[s] == np.inf]
            later = [s for s in new if _sets_out_s(crew, s, task[s]) > came_s[r]]
            ahead = [s for s in nearer if int(start[s]) in route]
            lets_pass = (any(places.can_let_pass(s, int(start[s]), route, stands, back=b) for b in {False, r in aged}) for s in ahead)
            stuck = [s for s, lets in zip(ahead, lets_pass) if s not in later or not lets]
            order += sorted(stuck, key=lambda s: away[s])
        order.append(r)
    return order


def older_first(
    crew: Crew,
    turn: Sequence[int],
    stops: Mapping[int, Stop],
    legs: Mapping[int, Sequence[Leg]],
    assigned: Mapping[int, int],
    aged: Collection[int],
) -> dict[int, int]:
    """Orders of two robots, each for the other: one that was passed over often has the older one, and the other goes before it.

    Where nobody can pass, as on a line, whoever is nearest has to serve all, the oldest first. Orders that are begun stay where they are.
    """

    def is_unbegun(r: int) -> bool:
        return len(legs[r]) == 1 and legs[r][0].nth == 0 and (r in assigned or crew.may_pass_on(crew.robots[r]))

    for n, r in enumerate(turn):
        if r in assigned or r not in aged or not is_unbegun(r):
            continue
        older = legs[r][0].task
        for s in (s for s in turn[:n] if stops[s].places == stops[r].places and is_unbegun(s)):
            newer = legs[s][0].task
            is_later = (crew.orders.released_s(older), older) < (crew.orders.released_s(newer), newer)
            is_urgent = crew.tasks[newer].priority > crew.tasks[older].priority
            if is_later and not is_urgent and crew.can_do(s, older) and crew.can_do(r, newer):
                return {s: older, r: newer}
    return {}


def _sets_out_s(crew: Crew, robot: int, task: int) -> float:
    """Since when a robot has been on the way to the stop of a task, inf: not yet."""
    return crew.robots[robot].since_s if crew.robots[robot].task == task else np.inf


def _is_just_done(crew: Crew, robot: RobotWork) -> bool:
    """True if a robot's last service ended since the look before, and what is asked for now takes effect now."""
    return not crew.settings.planning.budget_s and robot.over_s > crew.looks_s[0]


def _stays(crew: Crew, robot: RobotWork, since_s: float) -> bool:
    """True if a robot is out, or at a stop; if its service is short and began after a time, it may be leaving already."""
    return robot.is_busy or robot.is_out or (robot.making is not None and robot.making.begin_s > since_s)


def _may_take(crew: Crew, robot: RobotWork, task: int) -> bool:
    """True if a robot may still be given a task: both may have come to a first stop since it was decided, or be gone."""
    holder = crew.orders.robot[task]
    if (
        robot.is_down
        or robot.is_called
        or not (task in crew.orders.waiting or (holder != NOBODY and crew.may_pass_on(crew.robots[holder])))
    ):
        return False
    return robot.task == NONE or (robot.number in crew.free and robot.then == NONE) or crew.may_pass_on(robot)


def _give(crew: Crew, robot: RobotWork, task: int, now_s: float, request: WorkRequest) -> None:
    """A robot has a task, or will have it when it comes to the last stop of the one it has."""
    orders = crew.orders
    if robot.task != NONE:
        robot.then = task
        orders.assign(task, robot.number, now_s)
        return
    at_once = robot.number in request.at_once
    since_s = max(robot.over_s, orders.released_s(task)) if at_once else request.now_s
    orders.assign(task, robot.number, since_s)
    crew.give(robot, task, since_s, since_s if at_once else now_s)


def _extend(crew: Crew, robot: RobotWork, tour: Sequence[TourStop], now_s: float, request: WorkRequest) -> None:
    """A robot has more orders, as far as they still wait; stops that it has made meanwhile are none any more."""
    if robot.is_out or robot.charges:
        crew.is_changed = True
        return
    new = [task for task in dict.fromkeys(task for task, _ in tour) if task in crew.orders.waiting]
    first = robot.tour[:1] if robot.making else []
    rest = [each for each in tour if (each in robot.tour or each[0] in new) and each not in first]
    crew.is_changed |= any(nth == 0 and task not in (*new, *robot.orders) for task, nth in tour)  # somebody else has it
    if robot.task == NONE and rest:
        _give(crew, robot, rest[0][0], now_s, request)
    for task in new:
        if task not in robot.orders:
            crew.orders.assign(task, robot.number, now_s)
    robot.tour = [*(each for each in robot.tour if each not in rest), *rest]  # the stop that it makes first


def _is_ahead(robot: RobotWork, leg: Leg) -> bool:
    """True if a stop is still to be made."""
    return leg.task == robot.then or leg[:2] in robot.tour
