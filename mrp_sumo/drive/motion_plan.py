"""A plan made ready to be driven: where along its way a robot makes each visit, turns, waits, and leaves what it needed.

Pure: plan in, arrays out. `drive.ledger` keeps them under ids that never change.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, NavGraph, PlanGraph, frozen
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.core.wheel_path import STRAIGHT_RAD, swing_stretch
from mrp_sumo.engines.sumo.network import SHORTEST_M
from mrp_sumo.traffic.courses import course_rad
from mrp_sumo.traffic.passages import Needs
from mrp_sumo.traffic.resources import Course, Resources, left_after_m, needs_of
from mrp_sumo.traffic.turns import BACKWARD, NEVER, Turns, stands_bent, swing_m, turns_of

Vehicles = Sequence[RobotType | None]

TURNS_RAD = 0.2  # a bend beyond this is turned in place, a lesser one while driving
STANDING_ROOM_M = 0.004  # the least stretch of a lane on which a robot may wait


@dataclass(frozen=True, eq=False)
class Departure:
    """From where K robots set out on the visits of a plan; the first visit of each robot there is where it stands or has to pass."""

    at_m: FloatArray  # [K] of that visit along the robot's way
    heading_rad: FloatArray  # [K] when it leaves it, NaN: that of its first lane
    lane: IntArray  # [K] by which it comes to it, -1: none
    back_lane: IntArray  # [K] the lane on which a robot that turned round drives back to that visit's vertex, -1: none
    back_m: FloatArray  # [K] and how far
    gear: IntArray  # [K] of vehicles that come to that visit
    behind: IntArray  # [K] vertex on which trailers stand then, -1: none
    may_turn: BoolArray  # [K] whether vehicles are far enough from that visit to cut the corner there, or do so already

    @staticmethod
    def at_rest(heading_rad: FloatArray, behind: IntArray) -> "Departure":
        """Robots that have not driven yet, with trailers on the vertices behind them [K], -1: none."""
        num_robots = len(heading_rad)
        none, nowhere = np.zeros(num_robots), np.full(num_robots, -1)
        return Departure(none, heading_rad, nowhere, nowhere, none, np.zeros(num_robots, np.int64), behind, np.zeros(num_robots, np.bool_))


@dataclass(frozen=True, eq=False)
class MotionPlan:
    """N visits with M needs, in the order of the plan."""

    plan: Plan
    lane: IntArray  # [N]
    from_m: FloatArray  # [N]
    at_m: FloatArray  # [N]
    heading_rad: FloatArray  # [N]
    turns: BoolArray  # [N]
    gear: IntArray  # [N] see `Visits`
    tangent_m: FloatArray  # [N]
    bend_m: FloatArray  # [N]
    bend_mps: FloatArray  # [N]
    limit_mps: FloatArray  # [N]
    short_of_m: FloatArray  # [N]
    needs: Needs
    left_at_m: FloatArray  # [M] along the robot's way where a need ends, inf: never


def motion_plan(
    graph: PlanGraph, resources: Resources, plan: Plan, departure: Departure, needless: IntArray, kind: IntArray, vehicles: Vehicles
) -> MotionPlan:
    """Lay out a plan of K robots, every move of which has a lane, along their ways.

    `needless` are robots whose last visit needs nothing, since they will not be granted it; `kind` [K] are the robots' types, and
    `vehicles` [T] those of the types that cannot turn in place, empty where there are none.
    """
    lane, _ = lanes_along(graph, plan)
    begin, last = plan.first[:-1], plan.first[1:] - 1
    back = np.flatnonzero(departure.back_lane >= 0)
    lane[begin[back] + 1] = departure.back_lane[back]
    moved = lane >= 0
    driven = np.round(np.maximum(graph.length_m, SHORTEST_M), 6)  # [L] as the network has it
    stretch = driven / graph.length_m
    length = np.where(moved, driven[lane], 0.0)
    length[begin[back] + 1] = 2 * departure.back_m[back]  # there and back
    at_m = np.repeat(departure.at_m, np.diff(plan.first)) + _along(plan.first, length)
    from_m = np.append(0.0, at_m[:-1])
    from_m[begin[back] + 1] = (at_m - np.where(moved, driven[lane], 0.0))[begin[back] + 1]
    heading = np.where(moved, graph.heading_rad[lane], 0.0)
    onward = np.where(begin < last, heading[np.minimum(begin + 1, last)], 0.0)
    heading[begin] = np.where(np.isnan(departure.heading_rad), onward, departure.heading_rad)
    turns = np.zeros(plan.num_visits, np.bool_)
    turns[:-1] = np.abs(wrapped(heading[1:] - heading[:-1])) > TURNS_RAD
    turns[last] = False
    behind, trailing_m = _behind(plan, departure, kind, vehicles)
    course = Course(plan, lane, from_m, at_m, stretch, kind, trailing_m)
    gear, tangent, bend_m, bend_mps, limit = _bends(graph, course, departure, vehicles, heading, turns)
    needs = needs_of(graph, plan, lane, resources, kind, behind)
    left_at = left_after_m(graph, resources, course, needs)
    if len(needless):
        needed = ~np.isin(needs.visit, last[needless])
        first = np.searchsorted(needs.visit[needed], np.arange(plan.num_visits + 1)).astype(np.int64)
        needs, left_at = Needs(frozen(first), needs.resource[needed], needs.on_lane[needed], needs.num_resources), left_at[needed]
    short_of = _short_of(resources, course)
    return MotionPlan(plan, lane, from_m, at_m, heading, turns, gear, tangent, bend_m, bend_mps, limit, short_of, needs, left_at)


def _bends(
    graph: PlanGraph, course: Course, departure: Departure, vehicles: Vehicles, heading: FloatArray, turns: BoolArray
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """[N] of vehicles gears, arcs and top speeds. Writes `heading`, in which they drive, and `turns`, where they change gear."""
    plan, lane, kind = course.plan, course.lane, course.kind
    gear, tangent, bend_m = np.zeros(len(lane), np.int64), np.zeros(len(lane)), np.zeros(len(lane))
    bend_mps, limit = np.full(len(lane), np.inf), np.where(lane >= 0, graph.speed_mps[lane], np.inf)
    ends_rad = course_rad(graph)[:, 1] if vehicles else heading
    for i, k in enumerate(kind.tolist() if vehicles else ()):
        vehicle, part = vehicles[k], slice(int(plan.first[i]), int(plan.first[i + 1]))
        if vehicle is None:
            continue
        mine = lane[part]
        heading[part] = np.append(heading[part.start], ends_rad[mine[1:]])
        table, wheels = turns_of(graph, vehicle), vehicle.kinematics
        limit[part] = np.where(mine >= 0, np.minimum(limit[part], table.limit_mps[mine]), limit[part])
        gear[part.start] = departure.gear[i]
        for n in range(len(mine) - 1):
            k, onward, now = part.start + n, int(mine[n + 1]), int(gear[part.start + n])
            came = int(mine[n]) if n else int(departure.lane[i])
            turn = table.between(came, onward) if came >= 0 else -1
            stands = not n and not departure.may_turn[i]
            gear[k + 1] = (
                _next_gear(table, turn, now, stands=stands) if turn >= 0 else _first_gear(graph, vehicle, onward, float(heading[k]), now)
            )
            turns[k] = gear[k + 1] != now
            if turn >= 0 and not stands:
                tangent[k], bend_m[k], bend_mps[k] = _bend(table, turn, vehicle, now, changes=bool(turns[k]))
                if not bend_m[k] and (slow_mps := float(table.limit_mps[[came, onward]].min())) < math.inf:  # the axle is on a curve still
                    bend_m[k], bend_mps[k] = abs(wheels.ahead_m), slow_mps
        turns[part.stop - 1] = False
        came, last = int(mine[-1]) if len(mine) > 1 else int(departure.lane[i]), int(gear[part.stop - 1])
        may_end_bent = came >= 0 and (len(mine) > 1 or departure.may_turn[i])
        if may_end_bent and (ahead := stands_bent(table, came, last)) is not None:
            bent = _bend(table, table.between(came, ahead[0]), vehicle, last, changes=ahead[1] != last)
            tangent[part.stop - 1], bend_m[part.stop - 1], bend_mps[part.stop - 1] = bent
        if wheels.reverse_mps is not None:
            limit[part] = np.where(gear[part] == BACKWARD, np.minimum(limit[part], wheels.reverse_mps), limit[part])
    return gear, tangent, bend_m, bend_mps, limit


def _bend(table: Turns, turn: int, vehicle: RobotType, gear: int, *, changes: bool) -> tuple[float, float, float]:
    """Tangent of the arc or swing of a turn, how far from the corner it may be on it, and its top speed there."""
    wheels, sharp = vehicle.kinematics, abs(float(table.bend_rad[turn]))
    if changes:
        if math.pi - sharp <= STRAIGHT_RAD:
            return 0.0, 0.0, math.inf
        room_m, least_m = swing_m(vehicle, float(table.room_m[turn]), gear), wheels.least_radius_m
        stretch = swing_stretch(room_m, math.pi - sharp, gear, wheels.ahead_m, least_m)
        return room_m, room_m, min(vehicle.with_load.max_speed_mps / stretch, math.sqrt(wheels.lateral_mps2 * least_m))
    radius_m, tangent_m = float(table.radius_m[turn, gear]), float(table.tangent_m[turn, gear])
    if not math.isfinite(radius_m):
        return 0.0, 0.0, math.inf
    return tangent_m, tangent_m + abs(wheels.ahead_m), math.sqrt(wheels.lateral_mps2 * radius_m)


def _next_gear(table: Turns, turn: int, gear: int, *, stands: bool) -> int:
    """The gear in which a vehicle leaves a corner; the one that it has, where it cannot."""
    ahead = int((table.may_stand if stands else table.next_gear)[turn, gear])
    return gear if ahead == NEVER else ahead


def _first_gear(graph: PlanGraph, vehicle: RobotType, onward: int, heading_rad: float, gear: int) -> int:
    """The gear in which a vehicle that has not moved yet leaves its start."""
    turns = turns_of(graph, vehicle)
    if not turns.gears[onward].all():
        return turns.first_gear(onward)
    return gear if math.cos(course_rad(graph)[onward, 0] - heading_rad) >= 0 else 1 - gear


def _behind(plan: Plan, departure: Departure, kind: IntArray, vehicles: Vehicles) -> tuple[IntArray | None, FloatArray | None]:
    """[N] vertices on which trailers stand while a robot is at a visit, -1: none; and [K] how far they reach behind the robot's circle.
    None: nobody tows.
    """
    tows = [each is not None and each.behind_m > 0 for each in vehicles]
    if not any(tows):
        return None, None
    trailing_m = np.array([max(each.behind_m - each.radius_m, 0.0) if each is not None and each.behind_m else 0.0 for each in vehicles])
    behind = np.where(np.repeat(np.array(tows)[kind], np.diff(plan.first)), np.append(-1, plan.vertex[:-1]), -1)
    behind[plan.first[:-1]] = departure.behind
    return behind, trailing_m[kind]


def lanes_along(graph: NavGraph, plan: Plan) -> tuple[IntArray, BoolArray]:
    """[N] the lane by which each visit is reached, -1 for first visits, and whether there is none where there should be one."""
    begin = plan.first[:-1]
    tail, head = np.append(-1, plan.vertex[:-1]), plan.vertex
    key = graph.tail * graph.num_vertices + graph.head
    lane = np.searchsorted(key, tail * graph.num_vertices + head)
    lane[begin] = -1
    missing = np.ones(len(lane), np.bool_)
    within = (lane >= 0) & (lane < len(key))
    missing[within] = (graph.tail[lane[within]] != tail[within]) | (graph.head[lane[within]] != head[within])
    missing[begin] = False
    return lane, missing


def _along(first: IntArray, length: FloatArray) -> FloatArray:
    """[N] sums of lengths, from 0 for each robot."""
    total = np.cumsum(length)
    return total - np.repeat(total[first[:-1]], np.diff(first))


def _short_of(resources: Resources, course: Course) -> FloatArray:
    """[N] how far a robot may drive towards a vertex that is not free: clear of it and of the vertex behind. inf where a
    lane has no such place, or is in a zone.
    """
    lane, stretch, kind = course.lane, course.stretch, np.repeat(course.kind, np.diff(course.plan.first))
    num_vertices = resources.num_places - len(resources.ends)
    in_zone = np.diff(resources.zones_first)[kind * resources.num_places + num_vertices + resources.track[lane]] > 0
    stop = course.at_m - (resources.enter_m * stretch)[kind, lane]
    behind = course.from_m + (resources.leave_m * stretch)[kind, lane]
    return np.where((lane >= 0) & ~in_zone & (stop > behind + STANDING_ROOM_M), stop, np.inf)
