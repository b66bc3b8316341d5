"""Poses of vehicles that cannot turn in place, and of what they tow, from sample to sample.

The fixed axle is where `core.wheel_path` says. Trailers follow by the closed form of their axles, which do not slip (LaValle, Planning
Algorithms, 13.1; Altafini, 2001).
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.core.wheel_path import Route, wheel_path
from mrp_sumo.drive._towed import follow
from mrp_sumo.traffic.courses import course_rad, curve_of
from mrp_sumo.traffic.turns import stands_bent, turns_of

if TYPE_CHECKING:
    from mrp_sumo.drive.ledger import Ledger


BEFORE = 3  # visits: the path between the first two is another without what comes before them


class Trains:
    """The vehicles of a fleet that cannot turn in place, from sample to sample."""

    def __init__(self, fleet: Fleet) -> None:
        types = fleet.vehicle_of_kind
        vehicles = [(r, types[k]) for r, k in enumerate(fleet.kind.tolist())] if types else []
        self.of_robot = {r: Train(vehicle) for r, vehicle in vehicles if vehicle is not None}
        count = max((len(train.vehicle.trailers) for train in self.of_robot.values()), default=0)
        self.columns = tuple(f"hitch_{k + 1}_rad" for k in range(count))  # angles of trailers

    def place(self, ledger: "Ledger", s_m: FloatArray, x: FloatArray, y: FloatArray, yaw: FloatArray) -> dict[str, FloatArray]:
        """Put vehicles where they are after distances [T, R], and return the angles of trailers by column; x, y, yaw [T, R] are changed."""
        angles = np.zeros((len(self.columns), *s_m.shape))
        for r, train in self.of_robot.items() if len(s_m) else ():
            x[:, r], y[:, r], yaw[:, r], own = train.poses(ledger, r, s_m[:, r])
            angles[: len(own), :, r] = own
        return dict(zip(self.columns, angles))


class Train:
    """One vehicle with its trailers, from sample to sample."""

    def __init__(self, vehicle: RobotType) -> None:
        self.vehicle = vehicle
        self._since_m = 0.0  # of the last sample
        self._yaw_rad = math.nan  # then
        self._towed_rad = np.zeros(0)  # [N] headings of trailers, then
        self._known: tuple[tuple[int, int], tuple[FloatArray, FloatArray, FloatArray]] | None = None  # path by visits

    def poses(self, ledger: "Ledger", robot: int, s_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Positions of the body's middle, yaws [T], and [N, T] angles of trailers to what is in front of them; `s_m` [T] is driven."""
        vehicle, last_m = self.vehicle, float(s_m[-1])
        on_m, places, yaw = self._path(ledger, robot)
        yaw_at = np.interp(s_m, on_m, yaw)
        x, y = (np.interp(s_m, on_m, places[:, k]) for k in (0, 1))
        angles = np.zeros((len(vehicle.trailers), len(s_m)))
        if vehicle.trailers:
            node_m = np.unique(np.concatenate([[self._since_m], s_m, on_m[(on_m > self._since_m) & (on_m < last_m)]]))
            towed = self._drawn(node_m, (on_m, places, yaw), float(yaw_at[0]))
            heading = np.stack([yaw_at, *(np.interp(s_m, node_m, column) for column in towed.T)])
            angles = wrapped(heading[1:] - heading[:-1])
        self._since_m, self._yaw_rad = last_m, float(yaw_at[-1])
        ahead = vehicle.kinematics.ahead_m
        return x + ahead * np.cos(yaw_at), y + ahead * np.sin(yaw_at), yaw_at, angles

    def bodies(self, ledger: "Ledger", robot: int, s_m: float) -> list[tuple[float, float, float]]:
        """Position of the middle, and yaw, of the vehicle and of each trailer, where it has driven so far now."""
        visits, since_m, self._since_m = ledger.visits, self._since_m, s_m
        key = int(visits.reached[robot]), int(visits.last[robot])
        if self._known is None or self._known[0] != key:
            self._known = key, self._path(ledger, robot)
        on_m, axle, yaw = self._known[1]
        x, y, facing = (float(np.interp(s_m, on_m, column)) for column in (*axle.T, yaw))
        ahead = self.vehicle.kinematics.ahead_m
        bodies = [(x + ahead * math.cos(facing), y + ahead * math.sin(facing), facing)]
        if self.vehicle.trailers:
            node_m = np.unique(np.concatenate([[since_m, s_m], on_m[(on_m > since_m) & (on_m < s_m)]]))
            towed = self._drawn(node_m, self._known[1], facing)[-1].tolist()
            for trailer, behind in zip(self.vehicle.trailers, towed):
                x -= trailer.hitch_m * math.cos(facing) + trailer.length_m * math.cos(behind)
                y -= trailer.hitch_m * math.sin(facing) + trailer.length_m * math.sin(behind)
                facing = behind
                bodies.append((x, y, facing))
        return bodies

    def _drawn(self, node_m: FloatArray, path: tuple[FloatArray, FloatArray, FloatArray], begin_rad: float) -> FloatArray:
        """[K, N] headings of trailers after distances driven since the last, at first that of the vehicle."""
        on_m, axle, yaw = path
        node = np.stack([np.interp(node_m, on_m, column) for column in (*axle.T, yaw)], 1)
        hitch, length = np.array([(each.hitch_m, each.length_m) for each in self.vehicle.trailers]).T
        begin = self._towed_rad if len(self._towed_rad) else np.full(len(hitch), begin_rad)
        towed: FloatArray = follow(node, hitch, length, np.asarray(begin, np.float64))
        self._towed_rad = towed[-1]
        return towed

    def _path(self, ledger: "Ledger", robot: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Where the fixed axle is, and how the vehicle faces [K], at distances driven [K]."""
        visits, graph, ids = ledger.visits, ledger.graph, ledger.all_ids(robot)
        since_m = self._since_m - 2 * abs(self.vehicle.kinematics.ahead_m) - 1.0  # what is farther behind decides nothing
        ids = ids[max(int(np.searchsorted(visits.at_m[ids], since_m)) - BEFORE, 0) :]
        lane, gear = visits.lane[ids], visits.gear[ids].copy()
        course = np.where(lane[:, None] >= 0, course_rad(graph)[lane], float(ledger.problem.heading_at_start[robot]))
        if lane[0] < 0 and np.isnan(course[0, 0]):
            course[0] = course[1, 0] if len(ids) > 1 else ledger.state.motion.yaw_rad[robot]
            gear[0] = gear[1] if len(ids) > 1 else 0
        wheels, at_m, xy, tangent_m = self.vehicle.kinematics, visits.at_m[ids], graph.xy[visits.vertex[ids]], visits.tangent_m[ids]
        if tangent_m[-1] > 0 and (ahead := stands_bent(turns_of(graph, self.vehicle), int(lane[-1]), int(gear[-1]))) is not None:
            at_m = np.append(at_m, at_m[-1] + graph.length_m[ahead[0]])
            xy = np.concatenate([xy, graph.xy[graph.head[ahead[0]]][None]])
            course, lane = np.concatenate([course, course_rad(graph)[[ahead[0]]]]), np.append(lane, ahead[0])
            gear, tangent_m = np.append(gear, ahead[1]), np.append(tangent_m, 0.0)
        route = Route(at_m, xy, course, gear, tangent_m, tuple(curve_of(graph, each) for each in lane.tolist()))
        path = wheel_path(route, wheels.ahead_m, wheels.least_radius_m)
        on_m, axle, yaw = path.on_m, path.axle, path.yaw_rad
        if not np.isnan(self._yaw_rad):
            yaw = yaw + 2 * np.pi * round((self._yaw_rad - float(np.interp(self._since_m, on_m, yaw))) / (2 * np.pi))
        return on_m, axle, yaw
