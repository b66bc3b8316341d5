"""Courses of lanes, and lanes that are drawn as curves as vehicles follow them.

The fixed axle is on the curve, as it is on a straight lane. So a type can drive along it that turns as tightly as the curve does, whose
body touches no wall there. Others are kept away from the curve, and from the straight step between the lane's ends, on which robots are
that turn in place (`traffic.resources`).
"""

import math
from functools import lru_cache

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.graph import FloatArray, NavGraph, PlanGraph, frozen
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.core.wheel_path import SHARPEST_RAD, Curve, Route, bend_at, wheel_path
from mrp_sumo.traffic.sweeps import CLEAR_M, MovingBody, moved_along, point_distances, touches

TIGHT = 0.995  # share of its least radius at which a type still drives: curves are drawn with some error
SMOOTH_RAD = 0.01  # a bend within which a curve goes on in another lane, and a vehicle that stands is in line with one
SHARES = tuple(np.geomspace(1.0, 0.1, 24).tolist())  # of the room at a corner that are tried beside curves
NAMES = ("edge_id", "path")  # options with the names of lanes in files


@lru_cache(maxsize=16)
def course_rad(graph: PlanGraph) -> FloatArray:
    """[L, 2] directions in which lanes begin and end; vehicles face them, or away from them in reverse."""
    along = graph.xy[graph.head] - graph.xy[graph.tail]
    course = np.where(graph.is_ride, graph.heading_rad, np.arctan2(along[:, 1], along[:, 0]))
    both: FloatArray = np.stack([course, course], 1)
    for (tail, head), curve in graph.curves.items():
        if (lane := graph.lane_between(tail, head)) >= 0:
            both[lane] = curve[[0, -1], 3]
    return frozen(both)


@lru_cache(maxsize=16)
def curve_radius_m(graph: PlanGraph) -> FloatArray:
    """[L] of the tightest place of each lane, inf where it is straight."""
    radius = np.full(graph.num_lanes, np.inf)
    for (tail, head), curve in graph.curves.items():
        if (lane := graph.lane_between(tail, head)) >= 0:
            radius[lane] = _tightest_m(curve)
    return frozen(radius)


def curve_of(graph: PlanGraph, lane: int) -> Curve:
    """The curve of a lane; None where it is straight, and for -1."""
    return graph.curves.get((int(graph.tail[lane]), int(graph.head[lane]))) if lane >= 0 else None


@lru_cache(maxsize=4096)
def obstacle_on_curve(graph: PlanGraph, vehicle: RobotType, lane: int, gear: int) -> str:
    """The reason for which a type cannot drive along a lane that is a curve, in a gear; '' for none."""
    curve, loaded = curve_of(graph, lane), vehicle.with_load
    if curve is None:
        return ""
    name = f"the curve '{_name(graph, lane)}'"
    least_m, radius_m = vehicle.kinematics.least_radius_m, float(curve_radius_m(graph)[lane])
    if radius_m < TIGHT * least_m:
        needs, has = told_apart(least_m, radius_m)
        return f"{vehicle.name} needs {needs} m to drive {name} and it has {has} m"
    route, begin_m = _route(graph, loaded, [lane], gear)
    end_m = begin_m + float(graph.length_m[lane])
    path = wheel_path(route, loaded.kinematics.ahead_m, least_m)
    bodies = moved_along(loaded, path, begin_m, end_m)
    if touches(bodies, _walls_beside(graph, bodies)):
        return f"{vehicle.name} touches a wall on {name}"
    return ""


def clear_at(graph: PlanGraph, vehicle: RobotType, lane: int, onward: int, gear: int, reach_m: float) -> bool:
    """True if a type touches no wall where it goes from one lane to another, of which one is a curve; -1: it begins on the second."""
    lanes, ahead_m = [onward] if lane < 0 else [lane, onward], abs(vehicle.kinematics.ahead_m)
    route, at_m = _route(graph, vehicle, lanes, gear, reach_m)
    path = wheel_path(route, vehicle.kinematics.ahead_m, vehicle.kinematics.least_radius_m)
    at_m = at_m + (float(graph.length_m[lane]) if lane >= 0 else 0.0)
    bodies = moved_along(vehicle, path, at_m - (reach_m + ahead_m if lane >= 0 else 0.0), at_m + reach_m + ahead_m + vehicle.behind_m)
    return not touches(bodies, _walls_beside(graph, bodies))


def bend_beside_curve(graph: PlanGraph, vehicle: RobotType, lane: int, onward: int, room_m: float, least_m: float) -> tuple[float, float]:
    """Radius of the widest Bezier curve that cuts a corner, and how far from the corner it begins; NaN where none of `least_m` does."""
    bend, best = float(wrapped(course_rad(graph)[onward, 0] - course_rad(graph)[lane, 1])), (math.nan, math.nan)
    for share in SHARES if abs(bend) <= SHARPEST_RAD else ():
        reach_m = share * min(room_m, max(vehicle.length_m, vehicle.kinematics.least_radius_m))
        route, _ = _route(graph, vehicle, [lane, onward], 0, reach_m)
        arc = bend_at(route, len(route.at_m) - 3, bend)
        radius_m = _tightest_m(arc)
        leaves_m = float(np.hypot(*(arc[:, 1:3] - graph.xy[graph.tail[onward]]).T).min())
        if radius_m >= TIGHT * least_m and leaves_m <= vehicle.corner_m and not radius_m <= best[0]:
            best = max(radius_m, least_m), reach_m
    return best


def _route(graph: PlanGraph, vehicle: RobotType, lanes: list[int], gear: int, reach_m: float = 0.0) -> tuple[Route, float]:
    """A way along one lane or two, between which the corner is cut, and the distance at which the first of them begins.

    It comes straight, with trailers along the curve that leads there, and goes on straight.
    """
    before = _before(graph, lanes[0], 3 * vehicle.behind_m) if vehicle.trailers else []
    along, stub_m = [*before, *lanes], 2 * abs(vehicle.kinematics.ahead_m) + vehicle.behind_m + 1.0
    course = course_rad(graph)[along]
    curves = [curve_of(graph, lane) for lane in along]
    ends = np.array([[*graph.xy[graph.tail[along[0]]]], *graph.xy[graph.head[along]]])
    for k, curve in enumerate(curves):
        if curve is not None:
            ends[[k, k + 1]] = curve[[0, -1], 1:3]
    out, into = (stub_m * np.array([math.cos(angle), math.sin(angle)]) for angle in (course[0, 0], course[-1, 1]))
    at_m = np.cumsum([0.0, stub_m, *graph.length_m[along].tolist(), stub_m])
    tangent_m = np.zeros(len(at_m))
    tangent_m[-3] = reach_m if len(lanes) > 1 else 0.0
    courses = np.concatenate([[[course[0, 0]] * 2] * 2, course, [[course[-1, 1]] * 2]])
    xy = np.concatenate([[ends[0] - out], ends, [ends[-1] + into]])
    route = Route(at_m, xy, courses, np.full(len(at_m), gear), tangent_m, (None, None, *curves, None))
    return route, float(at_m[1 + len(before)])


def _before(graph: PlanGraph, lane: int, within_m: float) -> list[int]:
    """Lanes that lead smoothly to a lane, curves rather than others."""
    before: list[int] = []
    course, radius_m = course_rad(graph), curve_radius_m(graph)
    while within_m > 0:
        came = np.flatnonzero(graph.head == graph.tail[lane])
        came = came[np.abs(wrapped(course[came, 1] - course[lane, 0])) <= SMOOTH_RAD]
        if not len(came) or int(came[0]) in before:
            break
        lane = int(came[np.argmin(radius_m[came])])
        before.insert(0, lane)
        within_m -= float(graph.length_m[lane])
    return before


def _tightest_m(places: FloatArray) -> float:
    """The least radius of places [N, 4] whose last three columns are x, y and course."""
    moved_m, turned = np.hypot(*np.diff(places[:, 1:3], axis=0).T), np.abs(np.diff(places[:, 3]))
    return float(np.divide(moved_m, turned, out=np.full(len(turned), np.inf), where=turned > 0).min(initial=np.inf))


def _walls_beside(graph: PlanGraph, bodies: list[MovingBody]) -> FloatArray:
    """[W, 2, 2] walls that bodies come near to."""
    near = np.zeros(len(graph.walls), np.bool_)
    for body in bodies if len(graph.walls) else ():
        low, high = body.poses[:, :2].min(0), body.poses[:, :2].max(0)
        around_m = math.hypot(*(high - low)) / 2 + math.hypot(body.length_m, body.width_m) / 2 + CLEAR_M
        near |= point_distances((low + high) / 2, graph.walls) <= around_m
    walls: FloatArray = graph.walls[near]
    return walls


def told_apart(needs_m: float, has_m: float) -> tuple[str, str]:
    """Two lengths in as many digits as show that they differ."""
    digits = next((digits for digits in (2, 3, 4) if round(needs_m, digits) != round(has_m, digits)), 5)
    return f"{needs_m:.{digits}f}", f"{has_m:.{digits}f}"


def _name(graph: NavGraph, lane: int) -> str:
    """The name of a lane in its file, else those of its ends."""
    options = graph.lane_options[lane]
    named = next((str(options[key]) for key in NAMES if options.get(key)), "")
    return named or f"{graph.known_as(int(graph.tail[lane]))} -> {graph.known_as(int(graph.head[lane]))}"
