"""The dispatcher `bundle`: robots carry several orders at once, as many as the `capacity` of their type.

Cheapest insertion: each order that waits, the most urgent and then the oldest first, goes where the sum of the times at which orders will
be done grows least, over all robots with room for one more and all places in their tours; its stops in their order. What a robot has it
keeps, and the stop that it is on its way to comes next. For insertion into tours see Jaw, Odoni, Psaraftis and Wilson, "A heuristic
algorithm for the multi-vehicle advance request dial-a-ride problem with time windows", Transportation Research B 20, 1986.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

from mrp_sumo.core.options import option
from mrp_sumo.core.request import Request
from mrp_sumo.drive.dispatchers.estimates import FAR_S, free
from mrp_sumo.drive.reroute import Replan
from mrp_sumo.drive.robot_work import NONE, RobotWork, TourStop
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.drive.work_request import work_request
from mrp_sumo.search.distance import UNREACHABLE, distances


@dataclass(frozen=True)
class Bundle:
    """Each order joins the tour of a robot with room for it, where it adds least to the sum of the times at which orders are done."""

    most: int = option(30, "orders looked at together, the most urgent and oldest that wait")

    def finished(self, now_s: float, context: Surroundings) -> bool:
        """See Dispatcher."""
        return context.crew.all_done

    def due(self, now_s: float, context: Surroundings) -> Iterable[Request]:
        """See Dispatcher."""
        if context.crew.is_changed:
            yield work_request(context.crew, now_s, context.closed, {}, tours(context, now_s, self.most))

    def answer(self, request: Request, context: Surroundings) -> Replan | None:
        """See Dispatcher."""
        return context.plan(request)


@dataclass
class _Tour:
    """Stops ahead of a robot that can be given more."""

    robot: int
    at: int  # vertex where they begin
    ready_s: float  # until then
    fixed: int  # stops that come first whatever is inserted
    room: int  # orders more
    stops: list[TourStop]
    sum_s: float = 0.0  # of the times at which its orders will be done
    is_new: bool = False


def tours(context: Surroundings, now_s: float, most: int) -> dict[int, list[TourStop]]:
    """New stops ahead, of robots that are to have more orders."""
    crew = context.crew
    idle = set(free(context))
    able = [tour for robot in crew.robots if (tour := _tour_of(context, robot, idle, now_s)) is not None]
    for tour in able:
        tour.sum_s = _sum_s(context, tour, tour.stops)
    for task in crew.unassigned[:most]:
        best: tuple[float, _Tour, list[TourStop], float] | None = None
        for tour in able:
            if tour.room <= 0 or not crew.can_do(tour.robot, task):
                continue
            for stops in _with(tour, crew.stops_of(task)):
                sum_s = _sum_s(context, tour, stops)
                if sum_s < FAR_S and (best is None or sum_s - tour.sum_s < best[0] - 1e-9):
                    best = sum_s - tour.sum_s, tour, stops, sum_s
        if best is not None:
            chosen = best[1]
            chosen.stops, chosen.sum_s, chosen.room, chosen.is_new = *best[2:], chosen.room - 1, True
    return {tour.robot: tour.stops for tour in able if tour.is_new}


def _tour_of(context: Surroundings, robot: RobotWork, idle: set[int], now_s: float) -> _Tour | None:
    """The tour of a robot that can be given an order, be it one of those that are `idle`; None for others."""
    crew, capacity = context.crew, context.ledger.problem.fleet.capacity
    start = int(context.start[robot.number])
    most = 1 if capacity is None else int(capacity[robot.number])
    if robot.number in idle and robot.then == NONE:
        return _Tour(robot.number, start, 0.0, 0, most, [])
    if not crew.has_room_for_more(robot) or robot.then != NONE:
        return None
    stops = list(robot.tour)
    if robot.leaves and robot.making is not None:
        stops = stops[1:]
        return _Tour(robot.number, start, 0.0, 0, most - len({task for task, _ in stops}), stops)
    ready_s = 0.0 if robot.making is None else robot.making.end_s - now_s
    fixed = max(1, len(robot.legs) + (robot.making is not None))
    return _Tour(robot.number, start, ready_s, fixed, most - len(robot.orders), stops)


def _with(tour: _Tour, new: Sequence[TourStop]) -> Iterable[list[TourStop]]:
    """The tour with the stops of one order more: the first at any place, the others together at any after it."""
    places = range(min(tour.fixed, len(tour.stops)), len(tour.stops) + 1)
    for i, j in combinations_with_replacement(places, 2) if len(new) > 1 else ((i, i) for i in places):
        yield [*tour.stops[:i], new[0], *tour.stops[i:j], *new[1:], *tour.stops[j:]]


def _sum_s(context: Surroundings, tour: _Tour, stops: Sequence[TourStop]) -> float:
    """Sum of the times at which the orders of a tour are done, as if nobody else were on its way; at least `FAR_S` where one cannot be."""
    steps, step_s, crew = distances(context.graph), context.ledger.problem.step_s, context.crew
    at, now_s, total_s = tour.at, tour.ready_s, 0.0
    making = crew.robots[tour.robot].making
    for n, (task, nth) in enumerate(stops):
        is_made = n == 0 and making is not None and tour.fixed > 0
        if not is_made:
            away, at = min((int(steps.to(v)[at]), v) for v in crew.tasks[task].stops[nth].places)
            if away >= UNREACHABLE:
                return FAR_S
            now_s += away * step_s + crew.stop_s(tour.robot, task, nth)
        if nth == len(crew.tasks[task].stops) - 1:
            total_s += now_s
    return min(total_s, FAR_S)
