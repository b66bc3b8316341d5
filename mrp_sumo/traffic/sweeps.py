"""Areas that vehicles sweep at corners, held against the walls beside them.

A body moves from pose to pose of the path that it will drive. It is looked at in the middle of each move; where that leaves open whether it
touches a wall on the way, the move is halved. Trailers follow the axle in front of them, from where the turn before has left them.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray, frozen
from mrp_sumo.core.robot_type import RobotShape
from mrp_sumo.core.wheel_path import Route, Turning, WheelPath, wheel_path

CLEAR_M = 0.005  # kept from walls on turns: a run's samples are joined by straight moves, which cut arcs by 1 to 4 mm
FINE_M = 5e-4  # within which it is known whether a body touches a wall
TOUCH_M = 1e-6
TOWED_M = 0.02  # moves in which trailers are followed
RADII, HALVINGS = 8, 5  # between the largest radius and the least one that are tried


class MovingBody(NamedTuple):
    """A rectangle that moves: of a vehicle with its load, or of a trailer."""

    poses: FloatArray  # [K, 3] x, y, yaw of its middle
    length_m: float
    width_m: float


class Before(NamedTuple):
    """The turn before the one that is looked at."""

    bend_rad: float
    length_m: float  # of the lane between the two


def touches(bodies: Iterable[MovingBody], walls: FloatArray, clear_m: float = CLEAR_M) -> bool:
    """True if one of the bodies comes nearer than this to a wall of [W, 2, 2]."""
    return any(_touches(body, walls, clear_m) for body in bodies)


def _touches(body: MovingBody, walls: FloatArray, clear_m: float) -> bool:
    move = np.diff(body.poses, axis=0)
    radius_m, moved_m, turned = math.hypot(body.length_m, body.width_m) / 2, np.hypot(move[:, 0], move[:, 1]), np.abs(move[:, 2])
    k, wall = np.nonzero(_may_touch(body, walls, clear_m))
    share, part = np.full(len(k), 0.5), 1.0
    while len(k):
        poses, straight = body.poses[k] + share[:, None] * move[k], turned[k] == 0.0  # then it sweeps a longer rectangle
        long_m = body.length_m / 2 + np.where(straight, moved_m[k] * part / 2, 0.0)
        away_m = rectangle_distances(poses, long_m, body.width_m / 2, walls[wall])
        if (away_m <= clear_m).any():
            return True
        reach_m = np.where(straight, 0.0, moved_m[k] + radius_m * turned[k]) * part / 2  # by which no point moves farther than this
        unsure = away_m <= clear_m + reach_m
        if unsure.any() and (reach_m[unsure] <= FINE_M).any():
            return True
        k, wall, share, part = np.tile(k[unsure], 2), np.tile(wall[unsure], 2), share[unsure], part / 2
        share = np.concatenate([share - part / 2, share + part / 2])
    return False


def _may_touch(body: MovingBody, walls: FloatArray, clear_m: float) -> BoolArray:
    """[K - 1, W] whether a circle around a body comes near a wall on each of its moves."""
    move = np.diff(body.poses[:, :2], axis=0)
    radius_m, moved_m = math.hypot(body.length_m, body.width_m) / 2, np.hypot(move[:, 0], move[:, 1])
    from_wall = point_distances((body.poses[:-1, :2] + move / 2)[:, None], walls[None])
    near: BoolArray = from_wall <= radius_m + clear_m + moved_m[:, None] / 2
    return near


def rectangle_distances(poses: FloatArray, half_length: FloatArray | float, half_width: float, walls: FloatArray) -> FloatArray:
    """[N] distances of rectangles at poses [N, 3] from a wall each, [N, 2, 2]; 0 where they meet."""
    cos, sin, off = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None], walls - poses[:, None, :2]
    ends = np.stack([cos * off[..., 0] + sin * off[..., 1], cos * off[..., 1] - sin * off[..., 0]], 2)  # [N, 2, 2] in the rectangle's frame
    half = np.stack(np.broadcast_arrays(half_length, half_width), -1) * np.ones((len(poses), 1))
    along = ends[:, 1] - ends[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        enter, leave = (-np.sign(along) * half - ends[:, 0]) / along, (np.sign(along) * half - ends[:, 0]) / along
    level, within = along == 0, np.abs(ends[:, 0]) <= half
    enter, leave = np.where(level, np.where(within, -np.inf, np.inf), enter), np.where(level, np.where(within, np.inf, -np.inf), leave)
    meets = np.maximum(enter.max(1), 0.0) <= np.minimum(leave.min(1), 1.0)
    outside = np.maximum(np.abs(ends) - half[:, None], 0.0)
    corners = half[:, None] * np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
    nearest = np.minimum(np.hypot(outside[..., 0], outside[..., 1]).min(1), point_distances(corners, ends[:, None]).min(1))
    away: FloatArray = np.where(meets, 0.0, nearest)
    return away


def point_distances(points: FloatArray, walls: FloatArray) -> FloatArray:
    """Distances of points [..., 2] from walls [..., 2, 2]."""
    along, off = walls[..., 1, :] - walls[..., 0, :], points - walls[..., 0, :]
    share = np.clip((off * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-18), 0.0, 1.0)
    rest = off - share[..., None] * along
    away: FloatArray = np.hypot(rest[..., 0], rest[..., 1])
    return away


def swept_at_corner(
    vehicle: RobotShape, bend_rad: float, gears: tuple[int, int], tangent_m: float, lane_m: float, before: Before | None = None
) -> list[MovingBody]:
    """Bodies of a loaded vehicle and its trailers that turn at a corner. It is at the origin, and the lane to it leads east.

    The vehicle comes and leaves in these gears. The arc, or the swing, begins `tangent_m` from the corner; 0: it stands there first.
    `lane_m` is the length of the lane on which it leaves; `before` is, of vehicles with trailers, the turn that they come from.
    """
    if vehicle.trailers:
        return _train(vehicle, bend_rad, tangent_m, lane_m, before)
    return [MovingBody(_turning(vehicle.turning, bend_rad, gears, tangent_m, lane_m), vehicle.length_m, vehicle.width_m)]


@lru_cache(maxsize=4096)
def _turning(vehicle: Turning, bend_rad: float, gears: tuple[int, int], tangent_m: float, lane_m: float) -> FloatArray:
    """[K, 3] poses of a body from the first to the last in which it is not in line with a lane."""
    straight_m = 2 * (tangent_m + abs(vehicle.ahead_m)) + 1.0  # in which the axle comes to the corner and away from it
    legs_m = np.array([straight_m, straight_m] if tangent_m > 0 else [straight_m, lane_m, straight_m])  # who stood comes round on the lane
    at_m = np.append(0.0, np.cumsum(legs_m))
    along = (at_m[1:] - straight_m)[:, None] * np.array([(math.cos(bend_rad), math.sin(bend_rad))])
    course = np.array([0.0, 0.0, *[bend_rad] * (len(legs_m) - 1)])
    gear = np.array([gears[0], gears[0], *[gears[1]] * (len(legs_m) - 1)])
    tangent = np.array([0.0, tangent_m, *[0.0] * (len(legs_m) - 1)])
    xy = np.concatenate([[(-straight_m, 0.0)], along])
    route = Route(at_m, xy, np.stack([course, course], 1), gear, tangent, (None,) * len(at_m))
    path = wheel_path(route, vehicle.ahead_m, vehicle.least_radius_m)
    turned = np.flatnonzero(np.diff(path.yaw_rad) != 0)
    begin, end = int(turned[0]), int(turned[-1]) + 2
    if gears[0] != gears[1]:  # it goes on straight to where it stops
        end = max(end, int(np.searchsorted(path.on_m, straight_m + 1e-9, "right")))
    return frozen(np.column_stack([path.axle + vehicle.ahead_m * _rays(path.yaw_rad), path.yaw_rad])[begin:end])


@lru_cache(maxsize=256)
def _train(vehicle: RobotShape, bend_rad: float, tangent_m: float, lane_m: float, before: Before | None) -> list[MovingBody]:
    """A vehicle and its trailers from the beginning of an arc to the end of the lane after it."""
    turning, before = vehicle.turning, before or Before(0.0, vehicle.behind_m + tangent_m)
    course = np.cumsum([0.0, before.bend_rad, bend_rad])
    length_m = np.array([before.length_m, before.length_m, lane_m])
    legs = length_m[:, None] * np.stack([np.cos(course), np.sin(course)], 1)
    xy = np.concatenate([np.zeros((1, 2)), np.cumsum(legs, 0)])
    least_m = turning.least_radius_m * math.tan(abs(before.bend_rad) / 2)
    at_m = np.append(0.0, np.cumsum(length_m))
    courses = np.repeat(np.append(course[:1], course)[:, None], 2, 1)
    route = Route(at_m, xy, courses, np.zeros(4, np.int64), np.array([0.0, least_m, tangent_m, 0.0]), (None,) * 4)
    path = wheel_path(route, turning.ahead_m, turning.least_radius_m)
    back = np.array([[math.cos(course[1]), -math.sin(course[1])], [math.sin(course[1]), math.cos(course[1])]])
    return [
        body._replace(poses=np.column_stack([(body.poses[:, :2] - xy[2]) @ back, body.poses[:, 2] - course[1]]))
        for body in moved_along(vehicle, path, float(at_m[2]) - tangent_m - abs(turning.ahead_m), math.inf)
    ]


def moved_along(vehicle: RobotShape, path: WheelPath, begin_m: float, end_m: float) -> list[MovingBody]:
    """A vehicle and its trailers, which are in line at the path's beginning, on a part of it."""
    on_m = path.on_m
    if vehicle.trailers:
        on_m = np.unique(np.concatenate([on_m, np.arange(on_m[0], on_m[-1], TOWED_M)]))
    x, y, yaw = (np.interp(on_m, path.on_m, column) for column in (*path.axle.T, path.yaw_rad))
    axle = np.stack([x, y], 1)
    bodies = [(axle + vehicle.turning.ahead_m * _rays(yaw), yaw, vehicle.length_m, vehicle.width_m)]
    for trailer in vehicle.trailers:
        hitch = axle - trailer.hitch_m * _rays(yaw)
        yaw = _followed(hitch, trailer.length_m, float(yaw[0]))
        axle = hitch - trailer.length_m * _rays(yaw)
        bodies.append((axle, yaw, trailer.body_m or trailer.length_m, trailer.width_m or vehicle.width_m))
    part = slice(int(np.searchsorted(on_m, begin_m)), int(np.searchsorted(on_m, end_m, "right")) + 1)
    return [MovingBody(np.column_stack([middle, facing])[part], length, width) for middle, facing, length, width in bodies]


def _followed(hitch: FloatArray, length_m: float, begin_rad: float) -> FloatArray:
    """[K] headings of what is drawn by its hitch [K, 2], exactly where that moves straight."""
    yaw = np.empty(len(hitch))
    yaw[0] = begin_rad
    moves = np.diff(hitch, axis=0)
    for k, (moved, course) in enumerate(zip(np.hypot(*moves.T).tolist(), np.arctan2(moves[:, 1], moves[:, 0]).tolist())):
        off = math.remainder(yaw[k] - course, 2 * math.pi)
        turned = off - 2 * math.atan(math.tan(off / 2) * math.exp(-moved / length_m))
        yaw[k + 1] = yaw[k] - turned
    return yaw


def _rays(angle: FloatArray) -> FloatArray:
    return np.stack([np.cos(angle), np.sin(angle)], 1)


def in_line(vehicle: RobotShape) -> MovingBody:
    """The body of a vehicle that stands in line with a lane, at the origin."""
    return MovingBody(np.zeros((2, 3)), vehicle.length_m, vehicle.width_m)


def radii(least: float, most: float) -> list[float]:
    """Of arcs that are tried, the largest first."""
    return [float(radius) for radius in np.geomspace(max(most, least), least, RADII if most > least * (1 + 1e-6) else 1)]


def widest(least: float, most: float, is_clear: Callable[[float], bool]) -> float:
    """The largest radius from the least one to the most that is clear, about; NaN where none is."""
    tried = math.inf
    for radius in radii(least, most):
        if is_clear(radius):
            for _ in range(HALVINGS if tried < math.inf else 0):
                radius, tried = (between, tried) if is_clear(between := (radius + tried) / 2) else (radius, between)
            return radius
        tried = radius
    return math.nan


def shift_to_clear(sweeps: Sequence[list[MovingBody]], walls: FloatArray, clear_m: float) -> tuple[float, float]:
    """Distances from the origin at which the wall that blocks the least blocked sweep would have to be, and is."""
    needs = []
    for bodies in sweeps:
        near = walls[np.any([_may_touch(body, walls, clear_m).any(0) for body in bodies], axis=0)]
        blocked = [_needed(bodies, wall, clear_m) for wall in near if touches(bodies, wall[None], clear_m)]
        needs.append(max(blocked, key=lambda each: each[0] - each[1], default=(0.0, 0.0)))
    return min(needs, key=lambda each: each[0] - each[1])


def _needed(bodies: list[MovingBody], wall: FloatArray, clear_m: float) -> tuple[float, float]:
    """Distances from the origin at which a wall would have to be, moved straight away, and is."""
    along = wall[1] - wall[0]
    nearest = wall[0] + np.clip(-(wall[0] @ along) / max(float(along @ along), 1e-18), 0.0, 1.0) * along
    has_m = float(np.hypot(*nearest))
    away = nearest / has_m if has_m > 1e-9 else np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    low, high = 0.0, 1.0
    while touches(bodies, (wall + high * away)[None], clear_m):
        low, high = high, 2 * high
    while high - low > 1e-3:
        half = (low + high) / 2
        low, high = (half, high) if touches(bodies, (wall + half * away)[None], clear_m) else (low, half)
    return has_m + high, has_m
