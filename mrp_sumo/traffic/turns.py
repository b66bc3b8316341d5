"""Turns of vehicles that cannot turn in place: from each lane to each that leaves its head, by which arc, and in which gear.

Where two lanes meet at a bend, the middle of the fixed axle cuts the corner along an arc of a circle, which touches both lanes at a
distance of R tan(bend / 2) from the corner, within the nearer half of either, so that no two arcs meet. The arc is as large as these
halves allow, begins within a length of the vehicle, and leaves the corner by no more than its type's `corner_m`.

A lane that is drawn as a curve is followed along it (`PlanGraph.curves`), where it is wide enough for the least radius. Where it meets
another lane at a bend, a Bezier curve takes the place of the arc.

A vehicle that may reverse changes gear where a lane leads straight back. One that comes backward to a corner also swings past it along
an arc of its least radius, away from the lane on which it is to leave, stops in line with that lane, and leaves forward: so forklifts
back out of a station. It does so wherever it can. One that comes forward does so before a lane that it has to drive backward: so they
back into a station.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, NavGraph, PlanGraph, frozen
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.core.wheel_path import SHARPEST_RAD, swing_beyond_m
from mrp_sumo.traffic.courses import SMOOTH_RAD, bend_beside_curve, clear_at, course_rad, curve_radius_m, obstacle_on_curve, told_apart
from mrp_sumo.traffic.sweeps import (
    CLEAR_M,
    TOUCH_M,
    Before,
    MovingBody,
    in_line,
    point_distances,
    radii,
    shift_to_clear,
    swept_at_corner,
    touches,
    widest,
)

FORWARD, BACKWARD, NEVER = 0, 1, -1  # gears
STRAIGHT_RAD = 1e-6
SHARP_RAD = np.pi - 1e-9  # of which the tangent is still a number
MAY_STAND_RAD = 0.2  # of a start's heading off a lane, and of lanes that lead straight back
OF_LANE = {"forward": FORWARD, "backward": BACKWARD}  # Open-RMF's option `orientation_constraint`


class Turns(NamedTuple):
    """P turns, by the lane on which one comes [L + 1] CSR and then by the lane on which one leaves."""

    first: IntArray  # [L + 1]
    onward: IntArray  # [P] lane on which one leaves
    bend_rad: FloatArray  # [P] counter-clockwise
    radius_m: FloatArray  # [P, 2] of the arc in either gear, inf where it is straight, NaN where there is none
    tangent_m: FloatArray  # [P, 2] from the corner to where that arc begins and ends; without one, what the least radius would take
    swings: BoolArray  # [P, 2] whether there is an arc after which it changes gear, by that in which it comes
    room_m: FloatArray  # [P] half of the shorter lane
    next_gear: IntArray  # [P, 2] gear in which one leaves, by that in which one comes; NEVER: one cannot
    may_stand: IntArray  # [P, 2] the same for a vehicle that stands at the corner
    gears: BoolArray  # [L, 2] in which one may come along each lane
    stands: BoolArray  # [L, 2] whether walls leave room to stand in line with a lane at its tail, and at its head
    limit_mps: FloatArray  # [L] on lanes that are curves, inf: on others

    def between(self, lane: int, onward: int) -> int:
        """The turn from a lane to one that leaves its head, -1: there is none."""
        a, b = int(self.first[lane]), int(self.first[lane + 1])
        at = np.flatnonzero(self.onward[a:b] == onward)
        return a + int(at[0]) if len(at) else -1

    def goes_on(self, lane: int, gear: int) -> bool:
        """True if a vehicle that stands at the end of a lane, by which it came in a gear, can drive on."""
        return bool((self.may_stand[self.first[lane] : self.first[lane + 1], gear] != NEVER).any())

    def first_gear(self, lane: int) -> int:
        """The gear in which one that has not moved yet drives along a lane: backward only where it has to."""
        return FORWARD if self.gears[lane, FORWARD] else BACKWARD


class _Corners(NamedTuple):
    """Room at P corners, by lanes and walls."""

    lane: IntArray  # [P]
    onward: IntArray  # [P]
    bend: FloatArray  # [P]
    room: FloatArray  # [P]
    radius: FloatArray  # [P, 2]
    reach: FloatArray  # [P] from the corner to where a Bezier curve begins and ends, NaN: it is an arc
    swings: BoolArray  # [P, 2]
    stood: BoolArray  # [P] whether one that stands there may come into line with the lane on which it leaves while it drives along it
    stands: BoolArray  # [L, 2]
    drives: BoolArray  # [L, 2] whether it can drive along the lane, which may be a curve, in either gear


@lru_cache(maxsize=16)
def turns_of(graph: PlanGraph, vehicle: RobotType) -> Turns:
    """All turns of a type on a graph."""
    room = _beside_walls(graph, vehicle, _on_lanes(graph, vehicle))
    lane, onward, sharp = room.lane, room.onward, np.abs(room.bend)
    allowed = (gears_of(graph, vehicle) > 0) & room.drives
    closed = graph.closed_to.get(vehicle.name, ())
    allowed[[lane for lane in (graph.lane_between(*ends) for ends in closed) if lane >= 0]] = False
    gears, next_gear = _gears(room, allowed)
    keep, change = np.array([FORWARD, BACKWARD]), np.array([BACKWARD, FORWARD])
    stands = (room.stands[lane, 1] & room.stood)[:, None]
    on = stands & (sharp <= SMOOTH_RAD)[:, None] & gears[onward]
    back = stands & (sharp >= np.pi - SMOOTH_RAD)[:, None] & room.swings & gears[onward][:, ::-1]
    may_stand = np.where(on, keep, np.where(back, change, NEVER))
    half, arc = np.tan(np.minimum(sharp, SHARP_RAD) / 2)[:, None], np.isfinite(room.radius)
    tangent = np.where(np.isinf(room.radius), 0.0, half * np.where(arc, room.radius, vehicle.kinematics.least_radius_m))
    tangent = np.where(np.isfinite(room.reach)[:, None] & arc, room.reach[:, None], tangent)
    first = np.append(0, np.cumsum(np.diff(graph.first)[graph.head]))
    limit = np.sqrt(vehicle.kinematics.lateral_mps2 * curve_radius_m(graph))
    arrays = (first, onward, room.bend, room.radius, tangent, room.swings, room.room, next_gear, may_stand, gears, room.stands, limit)
    return Turns(*map(frozen, arrays))


def _gears(room: "_Corners", allowed: BoolArray) -> tuple[BoolArray, IntArray]:
    """[L, 2] gears in which one may come along each lane, and [P, 2] in which one leaves it.

    Where a vehicle could stop neither in line with a lane at its end nor on an arc, there is no way along it.
    """
    lane, onward = room.lane, room.onward
    arc = np.where(np.isinf(room.radius), room.stands[lane, 1][:, None], np.isfinite(room.radius))
    while True:
        stays, changes = arc & allowed[onward], room.swings & allowed[onward][:, ::-1]
        forward = np.where(stays[:, 0], FORWARD, np.where(changes[:, 0], BACKWARD, NEVER))
        backward = np.where(changes[:, 1], FORWARD, np.where(stays[:, 1], BACKWARD, NEVER))
        next_gear, goes_on = np.stack([forward, backward], 1), np.zeros_like(allowed)
        np.logical_or.at(goes_on, lane, next_gear != NEVER)
        fewer = allowed & (goes_on | room.stands[:, 1:])
        if (fewer == allowed).all():
            return allowed, next_gear
        allowed = fewer


def _on_lanes(graph: PlanGraph, vehicle: RobotType) -> _Corners:
    """Room by lanes alone: arcs within their nearer halves."""
    course, wheels = course_rad(graph), vehicle.kinematics
    lane, onward = graph.onward
    bend = wrapped(course[onward, 0] - course[lane, 1])
    room, rides = np.minimum(graph.length_m[lane], graph.length_m[onward]) / 2, graph.is_ride[lane] | graph.is_ride[onward]
    sharp = np.minimum(np.abs(bend), SHARP_RAD)
    half, least_m, left = np.tan(sharp / 2), wheels.least_radius_m, np.pi - sharp
    with np.errstate(divide="ignore", invalid="ignore"):  # straight on
        leaves = vehicle.corner_m / (1 / np.cos(sharp / 2) - 1)
        widest_m = np.minimum(room, 2 * room - abs(wheels.ahead_m))  # the axle has left the corner where the middle comes to the next
        radius = np.minimum(np.minimum(widest_m / half, leaves), np.maximum(vehicle.length_m / half, least_m))
    radius = np.where(sharp <= STRAIGHT_RAD, np.inf, np.where(~rides & (radius >= least_m - 1e-9), radius, np.nan))
    swing_m = least_m / np.maximum(half, 1e-9)  # the heading changes by what the bend leaves of a half turn
    swings = (left <= SHARPEST_RAD) & (swing_m <= room - abs(wheels.ahead_m) + 1e-9) & (~rides | (left <= MAY_STAND_RAD)) & wheels.reverse
    reach, drives, curved = np.full(len(lane), np.nan), np.ones((graph.num_lanes, 2), np.bool_), curve_radius_m(graph) < np.inf
    for k in np.flatnonzero(curved[lane] | curved[onward]).tolist():
        swings[k] &= left[k] <= STRAIGHT_RAD
        is_smooth, ends = sharp[k] <= SMOOTH_RAD, (int(lane[k]), int(onward[k]))
        radius[k], reach[k] = (np.inf, np.nan) if is_smooth else bend_beside_curve(graph, vehicle, *ends, float(room[k]), least_m)
    for n in np.flatnonzero(curved).tolist():
        drives[n] = [not obstacle_on_curve(graph, vehicle, n, gear) for gear in (FORWARD, BACKWARD)]
    only_back = ~(gears_of(graph, vehicle)[onward, FORWARD] > 0)
    by_gear = np.stack([swings & ((left <= MAY_STAND_RAD) | only_back), swings], 1)
    free = np.ones(len(lane), np.bool_), np.ones((graph.num_lanes, 2), np.bool_)
    return _Corners(lane, onward, bend, room, np.stack([radius, radius], 1), reach, by_gear, *free, drives)


def _beside_walls(graph: PlanGraph, vehicle: RobotType, room: _Corners) -> _Corners:
    """The room that walls leave of it: the largest arcs that they allow."""
    if not len(graph.walls):
        return room
    radius, swings, stood, stands = room.radius.copy(), room.swings.copy(), room.stood.copy(), room.stands.copy()
    allowed, loaded = gears_of(graph, vehicle) > 0, vehicle.with_load
    body, reach_m = in_line(loaded), _reach_m(loaded, 0.0)
    curved = curve_radius_m(graph) < np.inf
    for lane in np.flatnonzero(~graph.is_ride & curved & room.drives.any(1)).tolist():
        gears = np.flatnonzero(allowed[lane] & room.drives[lane]).tolist()
        stands[lane, 0] = all(clear_at(graph, loaded, -1, lane, gear, 0.0) for gear in gears)
    for lane in np.flatnonzero(~graph.is_ride & ~curved).tolist():
        for end, v in enumerate((int(graph.tail[lane]), int(graph.head[lane]))):
            stands[lane, end] = not touches([body], _walls_at(graph, v, lane, reach_m), TOUCH_M)
    sharp = np.abs(room.bend)
    left = np.pi - sharp
    swings &= ((left > STRAIGHT_RAD) | stands[room.lane, 1])[:, None]  # straight back it goes from where it stands
    beside = curved[room.lane] | curved[room.onward]
    for k in np.flatnonzero(beside & ~np.isnan(room.radius[:, 0])).tolist():
        for gear in np.flatnonzero(allowed[room.lane[k]] & allowed[room.onward[k]]).tolist():
            if not clear_at(graph, loaded, int(room.lane[k]), int(room.onward[k]), gear, float(np.nan_to_num(room.reach[k]))):
                radius[k, gear], stood[k] = np.nan, False
    bent = ~beside & (sharp > STRAIGHT_RAD) & (left > STRAIGHT_RAD) & (np.isfinite(room.radius) | room.swings).any(1)
    for k in np.flatnonzero(bent).tolist():
        sweep = _Sweep(graph, loaded, room, k)
        for gear in np.flatnonzero(allowed[room.lane[k]]).tolist() if len(sweep.walls) else ():
            radius[k, gear] = sweep.widest_m(gear, float(radius[k, gear]))
            swings[k, gear] = swings[k, gear] and sweep.is_clear(sweep.swing(gear))
            stood[k] &= min(sharp[k], left[k]) > SMOOTH_RAD or sweep.is_clear(sweep.stood(gear))
    return room._replace(radius=radius, swings=swings, stood=stood, stands=stands)


class _Sweep:
    """Areas that a type sweeps with its load at one corner, in the frame of the lane to it."""

    def __init__(self, graph: PlanGraph, vehicle: RobotType, room: _Corners, turn: int) -> None:
        lane, onward = int(room.lane[turn]), int(room.onward[turn])
        self.vehicle, self.bend_rad, self.room_m = vehicle, float(room.bend[turn]), float(room.room[turn])
        self.lane_m, self.least_m = float(graph.length_m[onward]), vehicle.kinematics.least_radius_m
        self.before: list[Before | None] = [None]
        if vehicle.trailers:
            came = room.bend[(room.onward == lane) & np.isfinite(room.radius).any(1)]
            bends = {float(came.min(initial=0.0)), float(came.max(initial=0.0))} - {0.0}
            self.before += [Before(bend, float(graph.length_m[lane])) for bend in bends]
        within_m = _reach_m(vehicle, self.lane_m if vehicle.trailers else self.room_m)
        self.walls = _walls_at(graph, int(graph.head[lane]), lane, within_m)

    def widest_m(self, gear: int, most_m: float) -> float:
        """The largest radius of an arc, NaN where there is none."""
        return widest(self.least_m, most_m, lambda radius_m: self.is_clear(self.arc(gear, radius_m))) if math.isfinite(most_m) else most_m

    def is_clear(self, bodies: list[MovingBody]) -> bool:
        return not touches(bodies, self.walls)

    def arc(self, gear: int, radius_m: float) -> list[MovingBody]:
        tangent_m = radius_m * math.tan(abs(self.bend_rad) / 2)
        return [body for before in self.before for body in self._swept((gear, gear), tangent_m, before)]

    def swing(self, gear: int) -> list[MovingBody]:
        return self._swept((gear, 1 - gear), swing_m(self.vehicle, self.room_m, gear))

    def stood(self, gear: int) -> list[MovingBody]:
        return self._swept((gear, gear if abs(self.bend_rad) < 1 else 1 - gear), 0.0)

    def _swept(self, gears: tuple[int, int], tangent_m: float, before: Before | None = None) -> list[MovingBody]:
        return swept_at_corner(self.vehicle, self.bend_rad, gears, tangent_m, self.lane_m, before)


def _reach_m(vehicle: RobotType, tangent_m: float) -> float:
    """Distance from a corner within which walls matter."""
    return tangent_m + 2 * abs(vehicle.kinematics.ahead_m) + math.hypot(vehicle.length_m, vehicle.width_m) / 2 + vehicle.behind_m + CLEAR_M


def _walls_at(graph: PlanGraph, vertex: int, lane: int, within_m: float) -> FloatArray:
    """[W, 2, 2] the walls near a vertex, from there, with a lane leading east."""
    along = graph.xy[graph.head[lane]] - graph.xy[graph.tail[lane]]
    cos, sin = along / np.hypot(*along)
    near = graph.walls[point_distances(graph.xy[vertex], graph.walls) <= within_m]
    turned: FloatArray = (near - graph.xy[vertex]) @ np.array([[cos, -sin], [sin, cos]])
    return turned


def swing_m(vehicle: RobotType, room_m: float, gear: int) -> float:
    """Distance from a corner at which the stretches before and after a change of gear begin and end.

    The axle has the room, too: coming forward it is behind the middle, where it is the rear one.
    """
    ahead_m = vehicle.kinematics.ahead_m
    return room_m - max(0.0, ahead_m if gear == FORWARD else -ahead_m)


def with_swings(graph: PlanGraph, types: Sequence[RobotType]) -> PlanGraph:
    """The plan graph with the room that types need beyond their radii where they change gear at corners."""
    beyond_m = np.zeros(graph.num_vertices)
    for each in (each for each in types if each.is_vehicle and each.kinematics.reverse):
        turns, came = turns_of(graph, each), np.arange(graph.num_lanes).repeat(np.diff(turns_of(graph, each).first))
        left = np.pi - np.abs(turns.bend_rad)
        for gear in (FORWARD, BACKWARD):
            swings = (turns.next_gear[:, gear] == 1 - gear) & (left > STRAIGHT_RAD)
            for k in np.flatnonzero(swings).tolist():
                reach_m, v = swing_m(each, float(turns.room_m[k]), gear), graph.head[came[k]]
                beyond_m[v] = max(beyond_m[v], swing_beyond_m(each.turning, abs(float(turns.bend_rad[k])), gear, round(reach_m, 3)))
    return replace(graph, beyond_m=frozen(beyond_m)) if beyond_m.any() else graph


def stands_bent(turns: Turns, lane: int, gear: int) -> tuple[int, int] | None:
    """The lane, and the gear, for which a vehicle that stops at the end of a lane stops on the arc; None where it stops in line.

    It does so where it could not go on from the corner itself.
    """
    some = slice(int(turns.first[lane]), int(turns.first[lane + 1]))
    gears, onward = turns.next_gear[some, gear], turns.onward[some]
    if turns.goes_on(lane, gear) or not (gears != NEVER).any():
        return None
    k = int(np.argmin(np.where(gears != NEVER, np.abs(turns.bend_rad[some]), np.inf)))
    return int(onward[k]), int(gears[k])


@lru_cache(maxsize=16)
def gears_of(graph: NavGraph, vehicle: RobotType) -> IntArray:
    """[L, 2] 1 where a type may drive along a lane forward, and backward."""
    gears = np.array([_of_lane(graph, vehicle, lane) for lane in range(graph.num_lanes)], np.int64).reshape(-1, 2)
    if vehicle.kinematics.docking == "forks_first":
        gears[_left_open(graph, _into_dead_ends(graph)), FORWARD if vehicle.kinematics.fixed_axle == "rear" else BACKWARD] = 0
    return frozen(gears)


def idle_docking(graph: NavGraph, vehicle: RobotType) -> str:
    """The reason for which a type that is to dock with its forks first does so nowhere, in words; '' where it does, or is not to."""
    if vehicle.kinematics.docking != "forks_first":
        return ""
    lanes = _into_dead_ends(graph)
    if _left_open(graph, lanes):
        return ""
    why = "the map says in which gear its dead ends are driven" if lanes else "no place is at a dead end"
    return f"docking: forks_first of '{vehicle.name}' changes nothing, as {why}"


def _into_dead_ends(graph: NavGraph) -> list[int]:
    """Lanes that lead to places with one neighbour, from the last place before them that has more than two."""
    neighbours: list[set[int]] = [set() for _ in range(graph.num_vertices)]
    for tail, head in zip(graph.tail.tolist(), graph.head.tolist()):
        neighbours[tail].add(head)
        neighbours[head].add(tail)
    lanes = []
    for v, beside in enumerate(neighbours):
        if len(beside) != 1:
            continue
        head, tail = v, next(iter(beside))
        while True:
            lanes.append(graph.lane_between(tail, head))
            if len(neighbours[tail]) != 2:
                break
            head, tail = tail, next(iter(neighbours[tail] - {head}))
    return [lane for lane in lanes if lane >= 0]


def _left_open(graph: NavGraph, lanes: list[int]) -> list[int]:
    """Those of some lanes of which, and of whose reverse, the map does not say in which gear they are driven."""
    said = [OF_LANE.get(str(options.get("orientation_constraint"))) is not None for options in graph.lane_options]
    return [lane for lane in lanes if not said[lane] and not (graph.reverse[lane] >= 0 and said[graph.reverse[lane]])]


def _of_lane(graph: NavGraph, vehicle: RobotType, lane: int) -> tuple[bool, bool]:
    """True for forward and backward, where a type may drive so along a lane."""
    gear = OF_LANE.get(str(graph.lane_options[lane].get("orientation_constraint")))
    return gear != BACKWARD, gear != FORWARD and vehicle.kinematics.reverse


def obstacle_from(graph: PlanGraph, vehicle: RobotType, lane: int, gear: int) -> str:
    """The reason for which a type that stands at the end of a lane cannot leave it, in words; '' where it can."""
    if lane < 0 or turns_of(graph, vehicle).goes_on(lane, gear):
        return ""
    back, at = graph.known_as(int(graph.tail[lane])), graph.known_as(int(graph.head[lane]))
    return f"{vehicle.name} stands at '{at}' with its back to '{back}', and from a stand it can go straight on only, where no lane leads"


def obstacle_to(graph: PlanGraph, vehicle: RobotType, route: list[int]) -> str:
    """The first turn along a path of vertices that a type cannot make in any gear, in words; '' for none."""
    turns = turns_of(graph, vehicle)
    lanes = [graph.lane_between(a, b) for a, b in pairwise(route)]
    gears = {FORWARD, BACKWARD}
    for lane, onward in pairwise([-1, *lanes]):
        k = turns.between(lane, onward) if lane >= 0 else -1
        came, gears = (
            gears,
            {int(turns.next_gear[k, gear]) for gear in gears} - {NEVER} if k >= 0 else set(np.flatnonzero(turns.gears[onward]).tolist()),
        )
        if not gears:
            return _obstacle(graph, vehicle, k, lane, onward, came)
    return ""


def narrow_turns(graph: PlanGraph, vehicle: RobotType) -> tuple[str, ...]:
    """Lines on curves that a type cannot drive, and on turns that lanes have room for and walls have not, the sharpest at each place."""
    turns, wide = turns_of(graph, vehicle), turns_of(replace(graph, walls=graph.walls[:0]), vehicle)
    came = np.repeat(np.arange(graph.num_lanes), np.diff(turns.first))
    lines = [obstacle_on_curve(graph, vehicle, lane, FORWARD) for lane in np.flatnonzero(curve_radius_m(graph) < np.inf).tolist()]
    lost = (wide.next_gear != NEVER).any(1) & (turns.next_gear == NEVER).all(1) & (np.abs(turns.bend_rad) < np.pi - MAY_STAND_RAD)
    for v in np.unique(graph.tail[turns.onward[lost]]).tolist():
        here = np.flatnonzero(lost & (graph.tail[turns.onward] == v))
        k = int(here[np.abs(turns.bend_rad[here]).argmax()])
        gears = set(np.flatnonzero(wide.next_gear[k] != NEVER).tolist())
        line = _obstacle(graph, vehicle, k, int(came[k]), int(turns.onward[k]), gears)
        more = len(here) - 1
        lines.append(f"{line} (nor has it room for {more} more turn{'s' * (more > 1)} there)" if more else line)
    return tuple(dict.fromkeys(line for line in lines if line))


def _to_reverse(vehicle: RobotType) -> str:
    """What would let a type that drives forward only through, in words."""
    return "a way round, or a type without trailers, would do" if vehicle.trailers else "kinematics.reverse: true would do"


def _obstacle(graph: PlanGraph, vehicle: RobotType, turn: int, lane: int, onward: int, came: set[int]) -> str:
    """The reason for which a type does not leave one lane along another."""
    turns, name, loaded = turns_of(graph, vehicle), vehicle.name, vehicle.with_load
    tail, head = graph.known_as(int(graph.tail[onward])), graph.known_as(int(graph.head[onward]))
    if not gears_of(graph, vehicle)[onward].any():
        return f"{name} would have to reverse from '{tail}' to '{head}' ({_to_reverse(vehicle)})"
    if (int(graph.tail[onward]), int(graph.head[onward])) in graph.closed_to.get(name, ()):
        return f"{name} may not drive from '{tail}' to '{head}', or would not come back"
    curve = [obstacle_on_curve(graph, vehicle, onward, gear) for gear in np.flatnonzero(gears_of(graph, vehicle)[onward]).tolist()]
    if all(curve):
        return curve[0]
    if not turns.gears[onward].any():
        walls = _walls_at(graph, int(graph.head[onward]), onward, _reach_m(loaded, 0.0))
        needs_m, has_m = shift_to_clear([[in_line(loaded)]], walls, TOUCH_M)
        needs, has = told_apart(needs_m, has_m)
        return f"{name} needs {needs} m beside '{head}' to stand there, coming from '{tail}', and has {has} m to a wall"
    before = graph.known_as(int(graph.tail[lane]))
    if abs(turns.bend_rad[turn]) >= np.pi - MAY_STAND_RAD and not vehicle.kinematics.reverse:
        return f"{name} cannot reverse, from '{before}' to '{tail}' and back ({_to_reverse(vehicle)})"
    over = f"from '{before}' over '{tail}' to '{head}'"
    room, gear = _on_lanes(graph, vehicle), min(came)
    if np.isfinite(turns.radius_m[turn]).any() and not np.isnan(turns.radius_m[turn, gear]):
        return f"{name} would have to change gear {over}, where lanes are for one gear"
    beside_curve = (curve_radius_m(graph)[[lane, onward]] < np.inf).any()
    if beside_curve and not np.isnan(room.radius[turn, gear]):
        return f"{name} touches a wall where it turns {over}"
    if np.isnan(room.radius[turn, gear]) and not room.swings[turn, gear]:
        sharp, most = abs(float(turns.bend_rad[turn])), 2 * math.acos(1 / (1 + vehicle.corner_m / vehicle.kinematics.least_radius_m))
        if most < sharp and turns.tangent_m[turn, gear] <= turns.room_m[turn]:
            return f"{name} turns by {math.degrees(most):.0f} degrees at most, and it is {math.degrees(sharp):.0f} {over}"
        if beside_curve:
            has_m = bend_beside_curve(graph, vehicle, lane, onward, float(turns.room_m[turn]), 0.0)[0]
            needs, has = told_apart(vehicle.kinematics.least_radius_m, 0.0 if math.isnan(has_m) else has_m)
            return f"{name} needs a radius of {needs} m to turn {over}, where the widest curve has {has} m"
        needs_m, has_m = float(turns.tangent_m[turn, gear]), float(turns.room_m[turn])
        needs, has = told_apart(needs_m, has_m if needs_m > has_m else 2 * has_m - abs(vehicle.kinematics.ahead_m))
        return f"{name} needs {needs} m to turn {over} and has {has} m"
    sweep, most_m = _Sweep(graph, loaded, room, turn), float(room.radius[turn, gear])
    arcs = radii(sweep.least_m, most_m) if math.isfinite(most_m) else []
    sweeps = [sweep.swing(gear)] if room.swings[turn, gear] else [sweep.arc(gear, radius_m) for radius_m in arcs] or [[in_line(loaded)]]
    needs_m, has_m = shift_to_clear(sweeps, sweep.walls, CLEAR_M)
    needs, has = told_apart(needs_m, has_m)
    return f"{name} needs {needs} m beside '{tail}' to turn {over} and has {has} m to a wall"
