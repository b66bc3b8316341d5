"""Judges plans in seconds: can robots be at their visits at these times, and do their bodies keep apart? Knows no planner and no executor.

*Times.* A robot stands at a visit from its arrival to its departure, and at least as long as it has to turn there: from the heading of
its start, towards its next lane, to the heading of its goal. Where both are one and it need not turn, it drives through. In between, its
speed is from 0 to the lower of its own top speed and the lane's limit, and changes at most at its rates. Speeds at visits are intervals,
carried on from visit to visit and back. What robots do in steps of dt is within half a step of such a motion at the start of a run, and
they have arrived 2 mm before a vertex: so much is granted.

*Bodies.* The times of two visits do not say how a robot drives from one to the other. It is taken to be as far along as it can be at
every moment: it hurries, and waits short of the next vertex where it has time. That is what the executor does with what it holds.
On a long lane it may also wait where nobody at the vertex ahead, or on its other lanes, comes too close, and start from there as
late as its times allow, whichever keeps a pair apart. Two bodies are too close where the circles around them, and the larger of
their gaps, overlap by more than 1 cm. This is judged for each pair of robots, so that types may be mixed, and it covers vertices,
crossings, lanes side by side, meetings and overtaking.

*Groups.* A mutex group is held from when a robot sets out on a lane that is in it, or for a vertex that is, until it is a separation
beyond that vertex, or at its next visit.

The classical rules (who is at one vertex, or swaps) are those of `traffic.referee`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.csr import ranges
from mrp_sumo.core.fleet import Fleet, fleet_of
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, NavGraph, nav_graph, plan_graph
from mrp_sumo.core.grouping import grouped
from mrp_sumo.core.plan import Plan, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.metrics import _whereabouts as kernels
from mrp_sumo.traffic.resources import groups_of

TURNS_RAD = 0.2  # a lesser bend is driven through
ARRIVES_M = 0.003  # before a vertex a robot has arrived there
CLOSE_M = 0.01  # by which circles may overlap, since steps are not seconds
LEAST_S = 1e-6
ROOM = 4096  # meetings that are written down at first


@dataclass(frozen=True)
class Meeting:
    """Two robots, `robot` before `other` by number, too close to each other, or in one mutex group."""

    robot: int
    other: int
    vertex: int  # that `robot` is at or drives to
    other_vertex: int
    t_s: float  # when it begins
    distance_m: float  # the least, from centre to centre; NaN in a group
    group: str = ""


@dataclass(frozen=True)
class Drivability:
    """The judgement of whether robots can drive a plan at its own times."""

    faults: tuple[str, ...]  # times that no robot can keep, one line each
    meetings: tuple[Meeting, ...]  # by time; of each two robots and each visit of theirs the first

    @property
    def drivable(self) -> bool:
        return not self.faults and not self.meetings


class Pieces(NamedTuple):
    """P pieces of robots' ways, lanes and stays, for the kernels; N visits."""

    robot: IntArray  # [P]
    visit: IntArray  # [P] it stays at, or drives to
    moves: BoolArray  # [P]
    begin: FloatArray  # [P] s
    end: FloatArray  # [P]
    tail: FloatArray  # [P, 2] m
    head: FloatArray  # [P, 2]
    length: FloatArray  # [P] m, as the lane says
    top: FloatArray  # [P] m/s, 0 for stays
    short_of: FloatArray  # [P] where along the lane it may wait for the vertex, inf where nowhere
    level: IntArray  # [P]
    corner: IntArray  # [P, 2] lowest column and row of its cells
    early: FloatArray  # [N, 3, 6] the motion that is farthest along, on the lane to each visit
    late: FloatArray  # [N, 3, 6] and the one that is least far


@dataclass(frozen=True, eq=False)
class _Runs:
    """How N visits are reached and left."""

    lane: IntArray  # [N] to each visit, -1 for first ones
    length_m: FloatArray  # [N] of that lane, 1 for first visits
    top_mps: FloatArray  # [N] on it
    begin_s: FloatArray  # [N] when a robot sets out on it
    stands: BoolArray  # [N] at the visit
    leave_s: FloatArray  # [N] the visit, after turning there
    verdict: IntArray  # [N] of the kernels
    early: FloatArray  # [N, 3, 6] motions on the lane
    late: FloatArray


@dataclass(frozen=True)
class _Cells:
    """Squares in which bodies are looked for."""

    side_m: float
    reach_m: float  # bodies this close share one


def judge_in_seconds(problem: Problem, plan: Plan, step_length_s: float = 0.1) -> Drivability:
    """Judge the times of a plan without faults (`traffic.referee.judge`), whose every move has a lane; who has to go where is no matter.

    Robots take up new speeds in steps of `step_length_s`.
    """
    if not plan.num_visits:
        return Drivability((), ())
    runs = _runs(problem, plan, step_length_s)
    apart, kind = problem.fleet.apart_m, problem.fleet.kind
    cells = _Cells(max(float(apart.max()), float(np.median(runs.length_m))), float(apart.max()))
    pieces = _pieces(problem, plan, runs, cells)
    meetings_ = _too_close(plan, pieces, apart - CLOSE_M, kind, cells)
    meetings_ += _in_groups(problem, plan, runs, pieces, step_length_s)
    faults = [_fault(problem, plan, k, int(runs.verdict[k])) for k in np.flatnonzero(runs.verdict).tolist()]
    faults += _last_turns(problem, plan)
    return Drivability(tuple(faults), tuple(sorted(meetings_, key=lambda m: (m.t_s, m.robot, m.other))))


def prepare() -> None:
    """Get the kernels compiled or loaded: judge two robots on a lane that is in a mutex group."""
    lanes, options = [(0, 1), (1, 0)], [{"mutex": "lane"}] * 2
    graph = nav_graph(name="lane", xy=[(0, 0), (9, 0)], lanes=lanes, lane_options=options, vertex_options=[{"mutex": "end"}] * 2)
    fleet = fleet_of(RobotType("dot", 0.1, 0.1, 1.0, 1.0, 1.0, 1.0), 2)
    two = np.array([0, 1])
    judge_in_seconds(
        Problem(plan_graph(graph, kind="roadmap", cell_m=9.0), fleet, two, two[::-1], two, 9.0), plan_of_paths([[0, 1], [1, 0]], 9.0)
    )


def describe_meeting(meeting: Meeting, problem: Problem) -> str:
    """In words, such as 'robot_1 and robot_4 come 0.21 m close, to 'v3' and at 'dock', at 12.3 s'."""
    names, label = problem.fleet.robot_name, problem.graph.label
    both = f"{names[meeting.robot]} and {names[meeting.other]}"
    places = f"'{label(meeting.vertex)}' and '{label(meeting.other_vertex)}'"
    if meeting.group:
        return f"{both} are both in mutex group '{meeting.group}', at or on the way to {places}, at {meeting.t_s:.2f} s"
    return f"{both} come {meeting.distance_m:.3f} m close, at or on the way to {places}, at {meeting.t_s:.2f} s"


def _runs(problem: Problem, plan: Plan, step_length_s: float) -> _Runs:
    """Lanes, turns and stays, and what motions the times of visits leave."""
    graph, fleet, robot, num_visits = problem.graph, problem.fleet, plan.robot, plan.num_visits
    lane, heading = _lanes(graph, plan)
    heading[plan.first[:-1]] = problem.heading_at_start
    turn_s = _turns_s(plan, heading, np.where(fleet.is_vehicle, np.inf, fleet.turn_rate_rad_s))  # vehicles turn as they drive
    leave_s = np.maximum(plan.depart_s, plan.arrive_s + turn_s)
    stands = (plan.depart_s > plan.arrive_s + LEAST_S) | (turn_s > 0)
    stands[plan.first[:-1]] = True
    begin_s = np.append(0.0, np.where(stands, leave_s - step_length_s / 2, plan.arrive_s)[:-1])
    length_m = np.where(lane >= 0, graph.length_m[lane], 1.0)
    top_mps = np.minimum(np.where(lane >= 0, graph.speed_mps[lane], np.inf), fleet.max_speed_mps[robot])
    accel, decel = fleet.accel_mps2, fleet.decel_mps2
    jumps = np.minimum(accel * step_length_s, fleet.max_speed_mps) + np.minimum(decel * step_length_s, fleet.max_speed_mps)
    slack = ARRIVES_M + jumps * step_length_s / 8  # a polygon through the middles of steps is this close to the steps
    stop = decel * step_length_s + np.sqrt(2 * decel * ARRIVES_M)
    speeds = kernels.Speeds(np.zeros(num_visits), np.zeros(num_visits), np.zeros(num_visits, np.int64))
    early, late = np.zeros((num_visits, 3, 6)), np.zeros((num_visits, 3, 6))
    rides = kernels.Rides(plan.first, begin_s, plan.arrive_s, stands, length_m, top_mps)
    limits = kernels.RideLimits(accel, decel, slack, stop)
    kernels.find_speeds(rides, limits, speeds)
    kernels.motions(rides, limits, speeds, early, late)
    return _Runs(lane, length_m, top_mps, begin_s, stands, leave_s, speeds.verdict, early, late)


def _lanes(graph: NavGraph, plan: Plan) -> tuple[IntArray, FloatArray]:
    """[N] the lane to each visit, -1 for first visits, and its heading."""
    known = {(a, b): k for k, (a, b) in enumerate(zip(graph.tail.tolist(), graph.head.tolist()))}
    begins = set(plan.first[:-1].tolist())
    vertex = plan.vertex.tolist()
    lane = np.array([-1 if k in begins else known[vertex[k - 1], v] for k, v in enumerate(vertex)], np.int64)
    return lane, np.where(lane >= 0, graph.heading_rad[lane], np.nan)


def _turns_s(plan: Plan, heading: FloatArray, turn_rate_rad_s: FloatArray) -> FloatArray:
    """[N] how long a robot turns at each visit before it drives on. Where its heading is NaN it need not turn."""
    bend = np.append(heading[1:] - heading[:-1], np.nan)
    bend = np.abs(wrapped(bend))
    bend[np.isnan(bend) | (bend <= TURNS_RAD)] = 0.0
    bend[plan.first[1:] - 1] = 0.0
    turns: FloatArray = bend / turn_rate_rad_s[plan.robot]
    return turns


def _last_turns(problem: Problem, plan: Plan) -> list[str]:
    """What is wrong with the turns in place at goals that have headings.

    Robots may arrive while they still turn through a lesser bend, so that the heading of either of the last two lanes will do.
    """
    if problem.goal_heading_rad is None:
        return []
    wanted = {v: a for v, a in zip(problem.goal.tolist(), problem.goal_heading_rad.tolist()) if not np.isnan(a)}
    heading, faults = _lanes(problem.graph, plan)[1], []
    heading[plan.first[:-1]] = problem.heading_at_start
    for r, (begin, end, vertex) in enumerate(zip(plan.first[:-1].tolist(), plan.first[1:].tolist(), plan.last_vertex.tolist())):
        if vertex not in wanted:
            continue
        before = heading[max(begin, end - 2) : end]
        driven_through = len(before) < 2 or abs(wrapped(before[1] - before[0])) <= TURNS_RAD
        left = np.abs(wrapped(wanted[vertex] - (before if driven_through else before[-1:])))
        need_s = float(np.nanmin(np.append(left, np.inf))) / float(problem.fleet.turn_rate_rad_s[r])
        found_s = float(plan.end_s[r] - plan.arrive_s[end - 1])
        if need_s < np.inf and found_s < need_s - LEAST_S:
            name, label, there_s = problem.fleet.robot_name[r], problem.graph.known_as(vertex), float(plan.arrive_s[end - 1])
            faults.append(f"{name} arrives at '{label}' at {there_s:.2f} s and cannot have turned there by {plan.end_s[r]:.2f} s")
    return faults


def _fault(problem: Problem, plan: Plan, visit: int, verdict: int) -> str:
    label, name = problem.graph.label, problem.fleet.robot_name[plan.robot[visit]]
    a, b = label(int(plan.vertex[visit - 1])), label(int(plan.vertex[visit]))
    if verdict == kernels.TOO_EARLY:
        return f"{name} leaves '{a}' at {plan.depart_s[visit - 1]:.2f} s and cannot be at '{b}' as early as {plan.arrive_s[visit]:.2f} s"
    return f"{name} passes '{a}' at {plan.depart_s[visit - 1]:.2f} s too fast to come to '{b}' as late as {plan.arrive_s[visit]:.2f} s"


def _pieces(problem: Problem, plan: Plan, runs: _Runs, cells: _Cells) -> Pieces:
    """Lanes first, in the order of their visits, then stays."""
    graph, robot = problem.graph, plan.robot
    # a robot in a lift is on no floor
    moves, stays = np.flatnonzero((runs.lane >= 0) & ~graph.is_ride[runs.lane]), np.flatnonzero(runs.stands)
    visit = np.concatenate([moves, stays])
    is_lane = np.arange(len(visit)) < len(moves)
    head = graph.xy[plan.vertex[visit]]
    tail = np.where(is_lane[:, None], graph.xy[plan.vertex[np.maximum(visit - 1, 0)]], head)
    last_s = float(plan.arrive_s.max()) + 1.0
    length_m = runs.length_m[visit]
    room_m = _room_m(graph, runs.lane[visit], np.flatnonzero(is_lane & (length_m > 2 * cells.reach_m)), cells.reach_m)
    return Pieces(
        robot=robot[visit],
        visit=visit,
        moves=is_lane,
        begin=np.where(is_lane, runs.begin_s[visit], plan.arrive_s[visit]),
        end=np.minimum(np.where(is_lane, plan.arrive_s[visit], runs.leave_s[visit]), last_s),
        tail=tail,
        head=head,
        length=length_m,
        top=np.where(is_lane, runs.top_mps[visit], 0.0),
        short_of=np.where(length_m > cells.reach_m + room_m, length_m - room_m, np.inf),
        level=graph.level[plan.vertex[visit]],
        corner=np.floor((np.minimum(tail, head) - cells.reach_m / 2) / cells.side_m).astype(np.int64),
        early=runs.early,
        late=runs.late,
    )


def _room_m(graph: NavGraph, lane: IntArray, long: IntArray, reach_m: float) -> FloatArray:
    """[P] how far before its head a robot on some long lanes is out of reach of the head and of all other lanes there; inf on others."""
    room_m = np.full(len(lane), np.inf)
    by_head = np.argsort(graph.head, kind="stable")
    into = np.searchsorted(graph.head[by_head], np.arange(graph.num_vertices + 1))
    backwards = graph.xy[graph.tail] - graph.xy[graph.head]
    room: dict[int, float] = {}
    for k in np.unique(lane[long]).tolist():
        v = int(graph.head[k])
        out, incoming = np.arange(graph.first[v], graph.first[v + 1]), by_head[into[v] : into[v + 1]]
        away = np.concatenate([-backwards[out], backwards[incoming[incoming != k]]])  # [A, 2] along all lanes there, from the head
        length, mine = np.hypot(*away.T), backwards[k] / np.hypot(*backwards[k])
        along, aside = away @ mine / length, np.abs(away @ [-mine[1], mine[0]]) / length  # cosine and sine of the angles between
        other = ~((along > 0) & (aside < 1e-9))  # not the opposite of this lane
        along, aside, length = along[other], aside[other], length[other]
        past_end = length * along + np.sqrt(np.maximum(reach_m**2 - (length * aside) ** 2, 0.0))
        beside = np.divide(reach_m, aside, out=np.full(len(aside), np.inf), where=aside > 0)
        clear = np.where(along <= 0, reach_m, np.where(beside * along <= length, beside, past_end))
        room[k] = float(clear.max(initial=reach_m))
    room_m[long] = [room[k] for k in lane[long].tolist()]
    return room_m


def _too_close(plan: Plan, pieces: Pieces, apart: FloatArray, kind: IntArray, cells: _Cells) -> list[Meeting]:
    order, cell = _in_cells(pieces, cells)
    room = ROOM
    while True:
        pairs, seen = np.zeros((room, 2), np.int64), np.zeros((room, 2))
        count = kernels.meetings(order, cell, pieces, apart, kind, pairs, seen)
        if count <= room:
            break
        room = count
    first: dict[tuple[int, int, int, int], Meeting] = {}
    for (e, f), (t_s, distance_m) in zip(pairs[:count].tolist(), seen[:count].tolist()):
        e, f = (e, f) if pieces.robot[e] < pieces.robot[f] else (f, e)
        a, b = int(plan.vertex[pieces.visit[e]]), int(plan.vertex[pieces.visit[f]])
        key = int(pieces.robot[e]), int(pieces.robot[f]), int(pieces.visit[e]), int(pieces.visit[f])
        if key not in first or t_s < first[key].t_s:
            first[key] = Meeting(key[0], key[1], a, b, t_s, distance_m)
    return list(first.values())


def _in_cells(pieces: Pieces, cells: _Cells) -> tuple[IntArray, IntArray]:
    """[E] pieces, and [E, 2] the cells that they are in, by cell and then by when they begin. Pieces within reach share a cell."""
    upper = np.floor((np.maximum(pieces.tail, pieces.head) + cells.reach_m / 2) / cells.side_m).astype(np.int64)
    span = upper - pieces.corner + 1
    count = span.prod(1)
    piece = np.repeat(np.arange(len(count)), count)
    within = ranges(0, count)
    cell = pieces.corner[piece] + np.stack([within % span[piece, 0], within // span[piece, 0]], 1)
    order = np.lexsort((pieces.begin[piece], cell[:, 1], cell[:, 0]))
    return piece[order], np.ascontiguousarray(cell[order])


def _in_groups(problem: Problem, plan: Plan, runs: _Runs, pieces: Pieces, step_length_s: float) -> list[Meeting]:
    """Robots that are in one group at a time."""
    of_vertex, of_lane = _groups(problem.graph)
    if not of_vertex and not of_lane:
        return []
    stays = _stays(problem.fleet, plan, runs, pieces, of_vertex, of_lane)
    held = grouped((group, (begin_s, end_s, int(plan.robot[visit]), visit)) for group, begin_s, end_s, visit in stays)
    meetings_: dict[tuple[int, int, str], Meeting] = {}
    for group, times in held.items():
        times.sort()
        for i, (_, end_s, robot, visit) in enumerate(times):
            for begin, _, other, other_visit in times[i + 1 :]:
                if begin >= end_s - step_length_s:
                    break
                if other != robot:
                    (a, v), (b, w) = sorted([(robot, int(plan.vertex[visit])), (other, int(plan.vertex[other_visit]))])
                    meetings_.setdefault((a, b, group), Meeting(a, b, v, w, begin, np.nan, group))
    return list(meetings_.values())


def _groups(graph: NavGraph) -> tuple[dict[int, set[str]], dict[int, set[str]]]:
    """Groups of vertices and of lanes; both lanes of a pair, and vertices all of whose lanes are in a group, are in it."""
    of_lane: dict[int, set[str]] = {}
    for k, options in enumerate(graph.lane_options):
        for each in (k, int(graph.reverse[k])) if (names := groups_of(options)) else ():
            of_lane.setdefault(each, set()).update(names)
    of_lane.pop(-1, None)
    of_vertex = {v: set(names) for v, options in enumerate(graph.vertex_options) if (names := groups_of(options))}
    if of_lane:
        for v in np.unique(graph.head[list(of_lane)]).tolist():
            lanes = np.flatnonzero((graph.tail == v) | (graph.head == v)).tolist()
            of_vertex.setdefault(v, set()).update(set.intersection(*(of_lane.get(k, set()) for k in lanes)))
    return of_vertex, of_lane


def _stays(
    fleet: Fleet, plan: Plan, runs: _Runs, pieces: Pieces, of_vertex: dict[int, set[str]], of_lane: dict[int, set[str]]
) -> Iterator[tuple[str, float, float, int]]:
    """(group, from when, until when, visit), of every visit to a vertex of a group and over a lane of one."""
    short_of = np.full(plan.num_visits, np.inf)
    short_of[pieces.visit[pieces.moves]] = pieces.short_of[pieces.moves]
    is_last = np.zeros(plan.num_visits, np.bool_)
    is_last[plan.first[1:] - 1] = True
    separation = (2 * fleet.radius_m + fleet.gap_m)[plan.robot]
    for k, (vertex, lane) in enumerate(zip(plan.vertex.tolist(), runs.lane.tolist())):
        begin_s = float(runs.begin_s[k]) if lane >= 0 else -np.inf
        for group in of_lane.get(lane, ()):
            yield group, begin_s, float(plan.arrive_s[k]), k
        if not (groups := of_vertex.get(vertex)):
            continue
        if np.isfinite(short_of[k]):
            begin_s = kernels.first_at(runs.late[k], short_of[k])
        end_s = np.inf if is_last[k] else kernels.first_at(runs.early[k + 1], min(separation[k], runs.length_m[k + 1]))
        for group in groups:
            yield group, begin_s, end_s, k
