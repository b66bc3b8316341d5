"""A new plan for all robots that can move, from the vertices they have been granted, around what stays.

Robots go on driving what they have been granted. One that can reach its goal no more stays where it is.
"""

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from time import process_time
from typing import Any, cast

import numpy as np

from mrp_sumo.core.graph import BoolArray, IntArray, NavGraph, frozen
from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem, Standing
from mrp_sumo.core.request import Request, a_stop_each, next_stops, one_shot, with_stops_before
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.reroute import Replan, Reroute
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.errors import MrpSumoError, PlanError, PlanningOverrun
from mrp_sumo.planning.answers import planned_by
from mrp_sumo.planning.protocol import Planner
from mrp_sumo.planning.vehicles import within_reach
from mrp_sumo.search.route import reach_m
from mrp_sumo.traffic.moves import STANDING, UNDER_WAY
from mrp_sumo.traffic.resources import Resources

EFFORT = 10_000_000  # labels that a planner may make for an answer of recovery
GUARD_S = 300.0  # of CPU time, after which a run is given up: far more than that effort takes


class LatePlanError(PlanError):
    """There is no plan within the effort."""


@dataclass(frozen=True)
class AnswerLimits:
    """Of an answer; the same on every machine."""

    effort: int = EFFORT  # labels, for planners that support it
    window_steps: int = 0  # see `Problem`, for planners that support it


@dataclass(frozen=True, eq=False)
class Situation:
    """Robots that can be given a new plan, and from where; R robots."""

    request: Request
    waits: BoolArray  # [R] who cannot: broken, or on a lane that it neither may drive to the end nor back
    back: BoolArray  # [R] who turns round on its lane first
    left_alone: frozenset[int]  # robots that wait on their lanes
    cut_off: tuple[int, ...]  # robots that cannot reach where their tasks end
    makes_way: bool  # whether some go elsewhere, since they would stand where another waits to come


def request_for(now_s: float, context: Surroundings, robots: Sequence[int], reason: str, stop: IntArray | None = None) -> Request:
    """The request for other ways of K robots, in any order, which is kept, from the last visits that they have been granted.

    `stop` [K] are the vertices that they are to reach, by default where their tasks end; `reason` is for people.
    """
    ledger, some = context.ledger, np.array(robots, np.int64)
    return Request(
        now_s=now_s,
        site=context.crew.site,
        robot=some,
        start=context.start[some],
        stop_first=np.arange(len(some) + 1),
        stop=ledger.end_of_tasks[some] if stop is None else stop,
        closed=context.closed.copy(),
        reason=reason,
    )


def situation(now_s: float, context: Surroundings, stays: BoolArray, end: IntArray, *, makes_way: bool = False) -> Situation:
    """The question for a planner: robots that stay [R] keep what they have been granted and go nowhere, the others go to `end` [R].

    With `makes_way`, those that cannot go on where one waits on its lane to come go to the nearest vertex that is nobody's: who waits there
    bars the lane, and those whose ways it cuts off may be the ones that it waits for.
    """
    ledger, graph, grants = context.ledger, context.graph, context.state.grants
    visits, taken, joint = ledger.visits, context.state.holds.holder.copy(), ledger.joint
    start, back = visits.vertex[joint].copy(), np.zeros(len(stays), np.bool_)
    on_lane = grants.on_lane & (joint == visits.granted)
    for r in np.flatnonzero(joint != visits.granted).tolist():
        taken[context.of_vertex(r, int(start[r]))] = r
    held = taken.copy()  # by those who wait also where they are committed to come
    waits = stays | context.entering
    in_front: dict[int, int] = {}  # of those on each lane, who is to leave it first
    for r in sorted(np.flatnonzero(on_lane).tolist(), key=context.rest_of_lane_m):
        ahead = context.ahead(r)
        lane = int(visits.lane[ahead])
        if in_front.setdefault(lane, r) != r or waits[r]:
            waits[r] = True
            continue
        on, behind = context.of_lane(r, lane), context.of_vertex(r, int(start[r]))
        if ((taken[on] < 0) | (taken[on] == r)).all():
            taken[on], start[r] = r, visits.vertex[ahead]
        elif context.stands(r) and ((taken[behind] < 0) | (taken[behind] == r)).all():
            taken[behind], back[r] = r, True
        else:
            waits[r] = True
    alone = frozenset(np.flatnonzero(waits & on_lane).tolist())
    blocked = context.closed | lanes_needing(graph, ledger.resources, (held >= 0) & waits[held])
    for r in alone:
        lane = int(visits.lane[context.ahead(r)])
        blocked[[lane, *([int(graph.reverse[lane])] if graph.reverse[lane] >= 0 else [])]] = True
    standing = _standing(ledger, start, on_lane & ~waits)
    robots = np.flatnonzero(~waits)
    goal, cut_off = _goals(context.crew.site, robots, ~blocked, start[robots], end[robots])
    in_way = np.zeros(len(robots), np.bool_)
    if makes_way and alone:
        wanted = np.concatenate([context.of_lane(r, int(visits.lane[context.ahead(r)])) for r in sorted(alone)])
        in_way = np.isin(robots, context.state.holds.holder[wanted]) & (goal == start[robots]) & (end[robots] != start[robots])
        goal = _out_of_the_way(context.crew.site, robots, ~blocked, start[robots], goal, in_way)
    request = Request(
        now_s=now_s,
        site=context.crew.site,
        robot=robots,
        start=start[robots],
        stop_first=np.arange(len(robots) + 1),
        stop=goal,
        closed=blocked,
        reason="replan",
        since_s=frozen(context.crew.since_s[robots]),
        standing=None if standing is None else Standing(*(column[robots] for column in vars(standing).values())),
        end_heading_rad=context.crew.end_heading_rad(robots, goal, goal != start[robots]),
    )
    return Situation(request, waits, back, alone, tuple(int(robots[i]) for i in cut_off), bool(in_way.any()))


def _standing(ledger: Ledger, start: IntArray, on_lane: BoolArray) -> Standing | None:
    """How vehicles are at the vertices [R] from which they are to be sent on; those on lanes [R] come to the vertex ahead, if to any."""
    if not ledger.is_vehicle.any():
        return None
    standing, visits = ledger.standing, ledger.visits
    ahead = np.maximum(visits.next[visits.granted], 0)
    comes = on_lane & ledger.is_vehicle & (visits.vertex[ahead] == start)
    can_turn = ledger.come_m < visits.at_m[ahead] - ledger.room_to_turn_m(visits.lane[ahead])
    does = np.where(comes, np.where(can_turn, UNDER_WAY, STANDING), standing.does)
    lane, gear = np.where(comes, visits.lane[ahead], standing.lane), np.where(comes, visits.gear[ahead], standing.gear)
    return Standing(does, lane, gear, np.where(comes, -1, standing.came))


def planned(
    request: Request, begin_s: float, context: Surroundings, planner: str, parameters: Mapping[str, Any], limits: AnswerLimits
) -> Replan:
    """The answer of a planner to a request, from where robots are committed to be; it is to take effect at `begin_s`.

    Robots that the request leaves out stay where they are. Those that cannot reach their stops now, too, and those that have reached
    theirs, if the planner has them back later than their stops take. Raises PlanError when it finds no plan, and for a robot without stops.
    """
    a_stop_each(request)
    passes = limits.window_steps and "stops" in supports_of(planner, parameters)
    request = request if passes and not request.site.fleet.vehicle_of_kind else next_stops(request)  # vehicles stop in line with lanes
    stays = context.crew.busy | context.world.broken
    ways = _ways(request, begin_s, context, stays, planner, parameters, limits)
    sent_off = [r for r, takes_s in request.there_s.items() if r in ways.reroute and _back_after_s(ways.reroute[r]) > takes_s > 0]
    if sent_off:
        stays[sent_off] = True
        with suppress(PlanError):  # without another answer the first one stands
            ways = _ways(request, begin_s, context, stays, planner, parameters, limits)
    return ways


def _ways(
    request: Request,
    begin_s: float,
    context: Surroundings,
    stays: BoolArray,
    planner: str,
    parameters: Mapping[str, Any],
    limits: AnswerLimits,
) -> Replan:
    """As `planned`, with robots [R] that stay."""
    left_out, end = np.ones(context.ledger.num_robots, np.bool_), context.ledger.end_of_tasks.copy()
    left_out[request.robot], end[request.robot] = False, request.end

    def situated(*, makes_way: bool) -> Situation:
        standing = situation(begin_s, context, left_out | stays, end, makes_way=makes_way)
        if len(request.stop) == len(request.robot):
            return standing
        via = dict(zip(request.robot.tolist(), request.via))
        reached = zip(standing.request.robot.tolist(), standing.request.stop.tolist())
        passed = [via.get(r, ()) if goal == end[r] else () for r, goal in reached]
        return replace(standing, request=with_stops_before(standing.request, passed))

    standing = situated(makes_way=True)
    try:
        answer = replan(standing, context, planner, parameters, limits)
    except PlanError:
        if not standing.makes_way:
            raise
        answer = replan(situated(makes_way=False), context, planner, parameters, limits)
    ends = dict(zip(request.robot.tolist(), request.end.tolist()))
    return replace(answer, reason=request.reason, text="", ends=ends)


def _back_after_s(route: Reroute) -> float:
    """How long a robot is away from a place that its way leaves and comes back to."""
    if not len(route.vertex):
        return 0.0
    return float(route.arrive_s[-1] - (route.arrive_s[0] if route.vertex[0] == route.vertex[-1] else route.leave_s))


def supports_of(planner: str, parameters: Mapping[str, Any]) -> Collection[str]:
    """Features that a registered planner supports."""
    from mrp_sumo.planning.registry import planner as make

    return cast(Collection[str], getattr(make(planner, parameters), "supports", ()))


def replan(standing: Situation, context: Surroundings, planner: str, parameters: Mapping[str, Any], limits: AnswerLimits) -> Replan:
    """Ask a planner. Raises PlanError when it finds no plan, and PlanningOverrun when it takes so long that the run is given up."""
    request, visits = standing.request, context.ledger.visits
    on_lane = context.state.grants.on_lane & (context.ledger.joint == visits.granted)
    now_s, result = request.now_s, answer(request, planner, parameters, limits) if len(request.robot) else None
    plan, by = (None, planner) if result is None else (result.plan, result.chosen or planner)
    ways = {}
    for r in range(len(standing.waits)):
        if standing.waits[r]:
            if r in standing.left_alone:
                ahead = context.ahead(r)
                ways[r] = Reroute(visits.vertex[ahead : ahead + 1].copy(), np.array([now_s]), np.array([np.inf]), now_s)
            else:
                ways[r] = Reroute(np.zeros(0, np.int64), np.zeros(0), np.zeros(0), np.inf)
            continue
        assert plan is not None
        i = int(np.searchsorted(request.robot, r))
        part = slice(plan.first[i], plan.first[i + 1])
        vertex, arrive_s, depart_s = plan.vertex[part], plan.arrive_s[part] + now_s, plan.depart_s[part] + now_s
        if on_lane[r]:
            ways[r] = Reroute(vertex, arrive_s, depart_s, now_s - 1.0, bool(standing.back[r]))
        else:
            ways[r] = Reroute(vertex[1:], arrive_s[1:], depart_s[1:], float(depart_s[0]))
    text = f"{by} planned anew"
    if standing.cut_off:
        names = [context.ledger.problem.fleet.robot_name[r] for r in standing.cut_off]
        text += f"; without a way to their goals: {', '.join(names[:5])}{', ...' if len(names) > 5 else ''}"
    return Replan(ways, "replan", text, reordered=True, left_alone=standing.left_alone, planner=by)


def answer(request: Request, planner: str, parameters: Mapping[str, Any], limits: AnswerLimits) -> PlanResult:
    """The answer of a registered planner to a request, with a plan in seconds since it was made.

    Raises PlanError when there is none; LatePlanError where the effort did not suffice. Raises PlanningOverrun when it takes so long that
    the run is given up: no plan depends on the clock.
    """
    from mrp_sumo.planning.registry import planner as make

    try:
        method = make(planner, parameters)
        window = limits.window_steps if "window" in getattr(method, "supports", ()) else 0
        # it is driven in its order where that can be kept
        problem = within_reach(replace(one_shot(request), drivable=True, window_steps=window, effort=limits.effort))
        _prepare(method)
        began = process_time()
        result = planned_by(method, problem, GUARD_S)
    except MrpSumoError as error:
        raise PlanError(f"{planner}: {error}") from error
    killed = result.status is Status.TIMED_OUT and result.planning_time_s >= GUARD_S  # in a process of its own
    if killed or process_time() - began >= GUARD_S:
        raise PlanningOverrun(
            f"planner '{planner}' worked for more than {GUARD_S:g} s on the plan from {request.now_s:g} s on; "
            "what it finds by then depends on the machine, so the run ends here"
        )
    if result.plan is None or result.status not in (Status.SOLVED, Status.TIMED_OUT):
        kind = LatePlanError if result.status is Status.TIMED_OUT else PlanError
        raise kind(f"{planner} found no plan{': ' + result.message if result.message else ''}")
    return result


def _prepare(method: Planner) -> None:
    """Get a planner ready: ours once in a process, since their kernels stay compiled; others have processes of their own."""
    from mrp_sumo.planning.outside import OutsidePlanner

    if isinstance(method, OutsidePlanner):
        method.prepare()
    else:
        _prepare_once(method)  # type: ignore[arg-type]  # a frozen dataclass


@cache
def _prepare_once(method: Planner) -> None:
    method.prepare()


def lanes_needing(graph: NavGraph, resources: Resources, resource: BoolArray) -> BoolArray:
    """[L] lanes for which a robot, of whatever type, needs one of these resources [Q]."""
    num_vertices = graph.num_vertices
    zones = resource[num_vertices:]
    place = np.zeros(resources.num_places, np.bool_)
    place[:num_vertices] = resource[:num_vertices]
    of_place = np.repeat(np.tile(np.arange(len(place)), resources.num_kinds), np.diff(resources.zones_first))
    np.logical_or.at(place, of_place, zones[resources.zones_of])
    needing: BoolArray = place[graph.head] | place[num_vertices + resources.track]
    return needing


def _goals(problem: Problem, robots: IntArray, open_: BoolArray, start: IntArray, target: IntArray) -> tuple[IntArray, Sequence[int]]:
    """[K] targets that some robots can reach over open lanes, or the start, and who has to stay there."""
    goal, kind = start.copy(), problem.fleet.kind[robots]
    for k in np.unique(kind).tolist():
        mine = np.flatnonzero(kind == k)
        reach = reach_m(problem.graph, _open_to(problem, open_, k), start[mine])
        reaches = np.isfinite(reach[np.arange(len(mine)), target[mine]])
        goal[mine[reaches]] = target[mine[reaches]]
    while True:  # who stays may stand on another's goal: that one stays too
        values, count = np.unique(goal, return_counts=True)
        contested = np.isin(goal, values[count > 1]) & (goal != start)
        if not contested.any():
            return goal, np.flatnonzero(goal != target).tolist()
        goal[contested] = start[contested]


def _open_to(problem: Problem, open_: BoolArray, kind: int) -> BoolArray:
    """[L] open lanes that are not barred to a type."""
    return open_ if problem.barred is None else open_ & ~problem.barred[kind]


def _out_of_the_way(problem: Problem, robots: IntArray, open_: BoolArray, start: IntArray, goal: IntArray, in_way: BoolArray) -> IntArray:
    """[K] goals of some robots, those in the way at the nearest vertex that is nobody's start or goal, if there is one."""
    goal = goal.copy()
    for i in np.flatnonzero(in_way).tolist():
        away_m = reach_m(problem.graph, _open_to(problem, open_, int(problem.fleet.kind[robots[i]])), start[[i]])[0]
        away_m[np.concatenate([start, goal])] = np.inf
        if np.isfinite(away_m).any():
            goal[i] = int(away_m.argmin())
    return goal
