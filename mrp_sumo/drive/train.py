"""Poses of vehicles that cannot turn in place, and of what they tow, along their ways.

The middle of the fixed axle follows the lanes, and cuts corners along arcs (`traffic.turns`); a stretch of lanes of two tangents is driven
in the time that they take, though the arc is shorter. What is recorded is the middle of the body. Trailers follow by the closed form of
their axles, which do not slip (LaValle, Planning Algorithms, 13.1; Altafini, 2001).
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive._towed import follow
from mrp_sumo.traffic.turns import course_rad

if TYPE_CHECKING:
    from mrp_sumo.drive.ledger import Ledger

PIECE_RAD = 0.02  # of an arc between two places that are worked out


class Train:
    """One vehicle with its trailers, from sample to sample."""

    def __init__(self, vehicle: RobotType) -> None:
        self.vehicle = vehicle
        self._since_m = 0.0  # of the last sample
        self._yaw_rad = math.nan  # then
        self._towed_rad = np.zeros(0)  # [N] headings of trailers, then

    def poses(
        self, ledger: "Ledger", robot: int, s_m: FloatArray, at_m: FloatArray, xy: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Positions of the body's middle, yaws [T], and [N, T] angles of trailers to what is in front of them.

        Parameters
        ----------
        s_m
            [T] distances driven, ascending.
        at_m, xy
            [K] and [K, 2] where its way leads, see `listeners.way_of`.
        """
        vehicle, last_m = self.vehicle, float(s_m[-1])
        on_m, places, yaw = self._path(ledger, robot, at_m, xy)
        yaw_at = np.interp(s_m, on_m, yaw)
        x, y = (np.interp(s_m, on_m, places[:, k]) for k in (0, 1))
        angles = np.zeros((len(vehicle.trailers), len(s_m)))
        if vehicle.trailers:
            node_m = np.unique(np.concatenate([[self._since_m], s_m, on_m[(on_m > self._since_m) & (on_m < last_m)]]))
            node = np.stack([np.interp(node_m, on_m, column) for column in (places[:, 0], places[:, 1], yaw)], 1)
            begin = np.full(len(vehicle.trailers), yaw_at[0]) if not len(self._towed_rad) else self._towed_rad
            hitch, length = np.array([(each.hitch_m, each.length_m) for each in vehicle.trailers]).T
            towed = follow(node, hitch, length, np.asarray(begin, np.float64))
            self._towed_rad = towed[-1]
            heading = np.stack([yaw_at, *(np.interp(s_m, node_m, towed[:, k]) for k in range(len(hitch)))])
            angles = (heading[1:] - heading[:-1] + np.pi) % (2 * np.pi) - np.pi
        self._since_m, self._yaw_rad = last_m, float(yaw_at[-1])
        ahead = vehicle.kinematics.ahead_m
        return x + ahead * np.cos(yaw_at), y + ahead * np.sin(yaw_at), yaw_at, angles

    def _path(self, ledger: "Ledger", robot: int, at_m: FloatArray, xy: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Where the fixed axle is, and how the vehicle faces [K], at distances driven [K]."""
        visits, graph, ids = ledger.visits, ledger.graph, ledger.all_ids(robot)
        lane, gear, tangent, place_m = visits.lane[ids], visits.gear[ids], visits.tangent_m[ids], visits.at_m[ids]
        course = course_rad(graph)
        start = float(ledger.problem.heading_at_start[robot])
        facing = np.where(lane >= 0, course[lane] + np.pi * gear, start)
        if lane[0] < 0 and np.isnan(facing[0]):
            facing[0] = facing[1] if len(facing) > 1 else ledger.state.motion.yaw_rad[robot]
        facing = np.unwrap(facing)
        if not np.isnan(self._yaw_rad):
            now = float(np.interp(self._since_m, place_m, facing))
            facing += 2 * np.pi * round((self._yaw_rad - now) / (2 * np.pi))
        keep = ~np.isin(at_m, place_m[tangent > 0])
        parts = [(at_m[keep], xy[keep])]
        turned = [(place_m[tangent <= 0], facing[tangent <= 0])]
        following = np.append(facing[1:], facing[-1:])
        for k in np.flatnonzero(tangent > 0).tolist():
            bend, reach = float(following[k] - facing[k]), float(tangent[k])
            share = np.linspace(0.0, 1.0, max(2, math.ceil(abs(bend) / PIECE_RAD) + 1))
            on_m = place_m[k] - reach + 2 * reach * share
            along = course[lane[k]]
            radius = reach / math.tan(abs(bend) / 2) * math.copysign(1.0, bend)
            corner = graph.xy[visits.vertex[ids[k]]]
            begin = corner - reach * np.array([math.cos(along), math.sin(along)])
            centre = begin + radius * np.array([-math.sin(along), math.cos(along)])
            angle = along + bend * share
            parts.append((on_m, centre + radius * np.stack([np.sin(angle), -np.cos(angle)], 1)))
            turned.append((on_m, facing[k] + bend * share))
        small = (tangent <= 0) & (np.abs(following - facing) > 0)
        half_m = place_m[small] + (np.append(place_m[1:], place_m[-1:]) - place_m)[small] / 2
        turned.append((half_m, following[small]))  # where it stood at a small bend, it comes round on the lane
        on_m, places = _ordered(parts)
        yaw_m, yaw = _ordered(turned)
        both = np.union1d(on_m, yaw_m)
        at = np.stack([np.interp(both, on_m, places[:, k]) for k in (0, 1)], 1)
        return both, at, np.interp(both, yaw_m, yaw)


def _ordered(parts: "list[tuple[FloatArray, FloatArray]]") -> tuple[FloatArray, FloatArray]:
    """Parts of a function of distance as one, by distance."""
    on_m, values = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    order = np.argsort(on_m, kind="stable")
    return on_m[order], values[order]
