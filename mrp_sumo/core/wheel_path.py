"""Paths of vehicles that cannot turn in place: where their fixed axle is, and how they face, while they drive along lanes.

The middle of the body is where that of a robot is which turns in place: on the lane, and at the vertex where it stands. The fixed axle is
`ahead_m` behind it and follows the lanes, on curves as they are drawn. At corners it follows an arc that touches both lanes, `tangent_m`
from the corner. Where the gear changes at a corner, the axle swings along an arc of its least radius until the vehicle is in line with the
lane on which it will leave, and stops there (`traffic.turns`).

Distances are those along lanes, corners and all: a stretch of two tangents is driven in the time that they take, though its arc is shorter.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.bezier import PIECE_RAD, bezier_between
from mrp_sumo.core.graph import FloatArray, IntArray

STRAIGHT_RAD = 1e-6
SHARPEST_RAD = 1.75  # of bends

Curve = FloatArray | None  # of a lane, as `PlanGraph.curves` has it; None: it is straight


@dataclass(frozen=True, eq=False)
class Route:
    """Visits along a way, as the ledger has them, [N]; the first may be a start, to which no lane leads."""

    at_m: FloatArray
    xy: FloatArray  # [N, 2]
    course_rad: FloatArray  # [N, 2] of the lane to each, where it begins and ends; of a start in which the vehicle faces
    gear: IntArray  # in which it comes
    tangent_m: FloatArray  # of the arc or swing at each, 0: none
    curve: tuple[Curve, ...]  # of the lane to each


@dataclass(frozen=True, eq=False)
class WheelPath:
    """K places along a way, by distance."""

    on_m: FloatArray  # [K]
    axle: FloatArray  # [K, 2]
    yaw_rad: FloatArray  # [K] without jumps


def wheel_path(route: Route, ahead_m: float, least_radius_m: float) -> WheelPath:
    """The path of a fixed axle whose vehicle's middle is `ahead_m` before it, and whose least radius is given."""
    facing = _facing(route)
    gears = np.append(route.gear[1:], route.gear[-1:])
    changes = np.flatnonzero(gears != route.gear)
    ends = [0, *changes.tolist(), len(route.at_m) - 1]
    parts = [_in_gear(route, begin, end, facing, ahead_m) for begin, end in pairwise(ends)]
    swings = changes[route.tangent_m[changes] > 0].tolist()
    parts += [_swing(route, k, float(facing[k + 1, 0] - facing[k, 1]), float(facing[k, 1]), (ahead_m, least_radius_m)) for k in swings]
    on_m, axle, yaw = (np.concatenate([part[n] for part in parts]) for n in range(3))
    order = np.argsort(on_m, kind="stable")
    return WheelPath(on_m[order], axle[order], yaw[order])


def _facing(route: Route) -> FloatArray:
    """[N, 2] how the vehicle faces where the lane to each visit begins and ends, without jumps."""
    turned = np.array([0.0 if curve is None else curve[-1, 3] - curve[0, 3] for curve in route.curve])
    faces = route.course_rad + np.pi * route.gear[:, None]
    bends = wrapped(faces[1:, 0] - faces[:-1, 1])
    end = faces[0, 1] + np.append(0.0, np.cumsum(bends + turned[1:]))
    return np.stack([end - turned, end], 1)


def _in_gear(route: Route, begin: int, end: int, facing: FloatArray, ahead_m: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places between two changes of gear, without what swings take of it."""
    at = route.at_m
    gear = int(route.gear[min(begin + 1, end)])
    shift = -ahead_m if gear == 0 else ahead_m  # of the axle along the lanes
    first = begin if begin == end else begin + 1
    off = 0.0 if route.tangent_m[begin] > 0 else float(facing[begin, 1] - facing[first, 0])  # it comes round on the lane
    far = abs(ahead_m) + 1.0
    here, out = _on_lane(route, first, at[[begin]]) if begin < end else (route.xy[[begin]], route.course_rad[begin, 1:])
    before = here - far * _ray(float(out[0]))
    nodes = [(np.array([at[begin] - far, at[begin]]), np.concatenate([before, here]), np.full(2, facing[first, 0] + off))]
    for k in range(begin + 1, end + 1):
        low = float(at[k - 1] + (route.tangent_m[k - 1] if k > begin + 1 else 0.0))
        high = float(at[k] - (route.tangent_m[k] if k < end else 0.0))
        nodes.append(_along_lane(route, k, (low, high), float(facing[k, 0]), off))
        if k == end:
            continue
        off = 0.0
        if (reach := float(route.tangent_m[k])) > 0:
            arc = bend_at(route, k, float(facing[k + 1, 0] - facing[k, 1]))
            nodes.append((at[k] - reach + 2 * reach * arc[:, 0], arc[:, 1:3], facing[k, 1] + (arc[:, 3] - route.course_rad[k, 1])))
        else:
            off = float(facing[k, 1] - facing[k + 1, 0])
    there, into = _on_lane(route, end, at[[end]]) if begin < end else (here, out)
    beyond = there + far * _ray(float(into[0]))
    nodes.append((np.array([at[end], at[end] + far]), np.concatenate([there, beyond]), np.full(2, facing[end, 1])))
    path_m, places, yaw = (np.concatenate([node[n] for node in nodes]) for n in range(3))
    low = at[begin] + (route.tangent_m[begin] if begin and route.gear[begin] != gear else 0.0)
    high = at[end] - (route.tangent_m[end] if _changes(route, end) else 0.0)
    inside = path_m[(path_m - shift > low) & (path_m - shift < high)]
    where = np.concatenate([[low + shift], inside, [max(high, low) + shift]])
    axle = np.stack([np.interp(where, path_m, places[:, n]) for n in (0, 1)], 1)
    return where - shift, axle, np.interp(where, path_m, yaw)


def _along_lane(route: Route, k: int, part_m: tuple[float, float], facing: float, off: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places along the lane to a visit, and how the vehicle faces; in the lane's first half it comes into line from `off`."""
    begin_m, length_m, curve = float(route.at_m[k - 1]), float(route.at_m[k] - route.at_m[k - 1]), route.curve[k]
    inner = np.array([0.5] if off else []) if curve is None else curve[:, 0] / curve[-1, 0]
    at_m = begin_m + length_m * inner
    at_m = np.concatenate([part_m[:1], at_m[(at_m > part_m[0]) & (at_m < part_m[1])], part_m[1:]])
    places, course = _on_lane(route, k, at_m)
    comes = np.maximum(np.round(1 - 2 * (at_m - begin_m) / max(length_m, 1e-9), 9), 0.0)
    return at_m, places, facing + (course - route.course_rad[k, 0]) + off * comes


def _on_lane(route: Route, k: int, at_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """[N, 2] places on the lane to a visit at distances [N] along the way, and the lane's courses there [N]."""
    begin, end = route.xy[k - 1], route.xy[k]
    share = (at_m - route.at_m[k - 1]) / max(float(route.at_m[k] - route.at_m[k - 1]), 1e-9)
    if (curve := route.curve[k]) is None:
        return begin + share[:, None] * (end - begin), np.full(len(at_m), route.course_rad[k, 0])
    x, y, course = (np.interp(share * curve[-1, 0], curve[:, 0], curve[:, n]) for n in (1, 2, 3))
    return np.stack([x, y], 1), course - curve[0, 3] + route.course_rad[k, 0]


def bend_at(route: Route, k: int, bend_rad: float) -> FloatArray:
    """[N, 4] places on the arc that cuts a corner: share of the way, x, y, course. Beside curves it is a Bezier curve."""
    reach = float(route.tangent_m[k])
    if route.curve[k] is None and route.curve[k + 1] is None:
        arc = _arc(route.xy[k], float(route.course_rad[k, 1]), bend_rad, reach)
        share = np.linspace(0.0, 1.0, len(arc))
        return np.column_stack([share, arc, route.course_rad[k, 1] + bend_rad * share])
    (begin, out), (end, into) = _on_lane(route, k, route.at_m[[k]] - reach), _on_lane(route, k + 1, route.at_m[[k]] + reach)
    turned = bend_rad + float(route.course_rad[k, 1] - out[0] + into[0] - route.course_rad[k + 1, 0])
    arc = bezier_between(np.concatenate([begin, end]), float(out[0]), turned)
    arc[:, 0] /= arc[-1, 0]
    return arc


def _changes(route: Route, k: int) -> bool:
    """True where the gear changes after a visit."""
    return k + 1 < len(route.gear) and bool(route.gear[k + 1] != route.gear[k])


def _swing(route: Route, k: int, bend: float, facing: float, size: tuple[float, float]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The stretch before a corner at which the gear changes, and the one after it."""
    (ahead_m, least_m), corner, reach = size, route.xy[k], float(route.tangent_m[k])
    along, out = float(route.course_rad[k, 1]), float(route.course_rad[k + 1, 0])
    before_m = ahead_m if route.gear[k] == 0 else -ahead_m  # how far the axle is behind the middle, as it moves
    after_m = -before_m
    tangent_m = least_m * math.tan(abs(bend) / 2)
    stop_m = max(tangent_m, after_m)
    arc = _arc(corner, along, bend, tangent_m)
    curve = np.concatenate([[corner - (reach + before_m) * _ray(along)], arc, [corner - stop_m * _ray(out)]])
    yaw = np.concatenate([[facing], facing + bend * np.linspace(0.0, 1.0, len(arc)), [facing + bend]])
    length_m = np.append(0.0, np.cumsum(np.hypot(*np.diff(curve, axis=0).T)))
    on_m = route.at_m[k] - reach + reach * length_m / max(float(length_m[-1]), 1e-9)
    end = corner + (reach - after_m) * _ray(out)
    return np.append(on_m, route.at_m[k] + reach), np.concatenate([curve, [end]]), np.append(yaw, facing + bend)


def swing_stretch(reach_m: float, bend_rad: float, gear: int, ahead_m: float, least_radius_m: float) -> float:
    """Length of the axle's path before or after a corner where the gear changes, as a multiple of that of the lanes."""
    before_m = ahead_m if gear == 0 else -ahead_m
    tangent_m = least_radius_m * math.tan(abs(bend_rad) / 2)
    stop_m = max(tangent_m, -before_m)
    into = (reach_m + before_m - tangent_m) + least_radius_m * abs(bend_rad) + stop_m - tangent_m
    return max(into, stop_m + reach_m + before_m) / reach_m


def _ray(angle_rad: float) -> FloatArray:
    return np.array([math.cos(angle_rad), math.sin(angle_rad)])


def _arc(corner: FloatArray, along_rad: float, bend_rad: float, tangent_m: float) -> FloatArray:
    """[N, 2] an arc that touches the lane to a corner so far before it, and bends; where it does not bend, the corner."""
    if abs(bend_rad) < STRAIGHT_RAD:
        return corner[None]
    radius = tangent_m / math.tan(abs(bend_rad) / 2) * math.copysign(1.0, bend_rad)
    centre = corner - tangent_m * _ray(along_rad) + radius * _ray(along_rad + math.pi / 2)
    angle = along_rad + bend_rad * np.linspace(0.0, 1.0, max(2, math.ceil(abs(bend_rad) / PIECE_RAD) + 1))
    return np.asarray(centre + radius * np.stack([np.sin(angle), -np.cos(angle)], 1))


@dataclass(frozen=True)
class Turning:
    """Figures of a vehicle that decide what it sweeps at corners."""

    ahead_m: float
    least_radius_m: float
    corner_m: float  # by which the fixed axle may leave a corner
    reverse: bool
    length_m: float


@lru_cache(maxsize=64)
def most_aside_m(vehicle: Turning) -> float:
    """Distance of the middle of a body, on arcs at most, from where that of a robot would be that turns in place."""
    return max(float(_off_m(vehicle, *arc).max()) for arc in _arcs(vehicle))


@lru_cache(maxsize=4096)
def swing_beyond_m(vehicle: Turning, bend_rad: float, gear: int, reach_m: float) -> float:
    """Distance from a corner of the middle of a body that changes gear there, where it is farther than on arcs from where a robot would be
    that turns in place; at most, and less what arcs take.
    """
    aside_m, corner = most_aside_m(vehicle), _corner(vehicle, bend_rad, (gear, 1 - gear), reach_m, 2 * (reach_m + abs(vehicle.ahead_m)))
    away_m = np.hypot(*_middle(corner[1], vehicle.ahead_m).T)
    return max(0.0, float(away_m.max(where=_off_m(vehicle, *corner) > aside_m, initial=0.0)) - aside_m)


def _off_m(vehicle: Turning, route: Route, path: WheelPath) -> FloatArray:
    """[K] distances of the middle of a body from where that of a robot would be that turns in place."""
    nominal = np.stack([np.interp(path.on_m, route.at_m, route.xy[:, n]) for n in (0, 1)], 1)
    off: FloatArray = np.hypot(*(_middle(path, vehicle.ahead_m) - nominal).T)
    return off


def _arcs(vehicle: Turning) -> Iterator[tuple[Route, WheelPath]]:
    """Paths round corners at the origin, by the tightest and the widest arcs."""
    least_m = vehicle.least_radius_m
    for bend in np.linspace(0.1, SHARPEST_RAD, 12).tolist():
        half, ahead = math.tan(bend / 2), abs(vehicle.ahead_m)
        widest = max(least_m, min(vehicle.corner_m / (1 / math.cos(bend / 2) - 1), vehicle.length_m / half))
        for tangent in {widest * half, least_m * half}:
            for gear in (0, 1) if vehicle.reverse else (0,):
                yield _corner(vehicle, bend, (gear, gear), tangent, 4 * (tangent + ahead))


def _corner(vehicle: Turning, bend: float, gears: tuple[int, int], tangent_m: float, lane_m: float) -> tuple[Route, WheelPath]:
    xy = np.array([[-lane_m, 0.0], [0.0, 0.0], lane_m * _ray(bend)])
    gear = np.array([gears[0], *gears])
    course = np.repeat([[0.0], [0.0], [bend]], 2, 1)
    route = Route(np.array([0.0, lane_m, 2 * lane_m]), xy, course, gear, np.array([0.0, tangent_m, 0.0]), (None,) * 3)
    return route, wheel_path(route, vehicle.ahead_m, vehicle.least_radius_m)


def _middle(path: WheelPath, ahead_m: float) -> FloatArray:
    return path.axle + ahead_m * np.stack([np.cos(path.yaw_rad), np.sin(path.yaw_rad)], 1)
