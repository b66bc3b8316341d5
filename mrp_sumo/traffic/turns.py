"""Turns of vehicles that cannot turn in place: from each lane to each that leaves its head, by which arc, or with a change of gear.

Where two lanes meet at a bend, the middle of the fixed axle cuts the corner along an arc of a circle, which touches both lanes at a
distance of R tan(bend / 2) from the corner, within the nearer half of either, so that no two arcs meet. The arc is as large as these
halves allow, and leaves the corner by no more than its type's `corner_m`. A vehicle that may reverse changes gear where a lane leads back.
"""

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph, frozen
from mrp_sumo.core.robot_type import RobotType

STRAIGHT, ARC, BACK, IMPOSSIBLE = range(4)
STRAIGHT_RAD = 1e-6
TURNS_RAD = 0.2  # from straight back, within which a lane leads back
LARGEST_M = 50.0  # arcs of a larger radius are no straighter
FORWARD, BACKWARD = 0, 1  # gears
OF_LANE = {"forward": FORWARD, "backward": BACKWARD}  # Open-RMF's option `orientation_constraint`


class Turns(NamedTuple):
    """P turns, by the lane on which one comes [L + 1] CSR and then by the lane on which one leaves."""

    first: IntArray  # [L + 1]
    onward: IntArray  # [P] lane on which one leaves
    bend_rad: FloatArray  # [P] counter-clockwise
    kind: IntArray  # [P] STRAIGHT, ARC, BACK or IMPOSSIBLE
    radius_m: FloatArray  # [P] of the arc, inf where there is none
    tangent_m: FloatArray  # [P] from the corner to where the arc begins and ends; of IMPOSSIBLE ones what the least radius takes
    room_m: FloatArray  # [P] half of the shorter lane

    def between(self, lane: int, onward: int) -> int:
        """The turn from a lane to one that leaves its head, -1: there is none."""
        a, b = int(self.first[lane]), int(self.first[lane + 1])
        at = np.flatnonzero(self.onward[a:b] == onward)
        return a + int(at[0]) if len(at) else -1


@lru_cache(maxsize=16)
def turns_of(graph: NavGraph, vehicle: RobotType) -> Turns:
    """All turns of a type on a graph. Lanes are straight."""
    course = course_rad(graph)
    count = np.diff(graph.first)[graph.head]
    first = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    lane = np.repeat(np.arange(graph.num_lanes), count)
    onward = np.arange(int(count.sum())) - np.repeat(first[:-1] - graph.first[graph.head], count)
    bend = (course[onward] - course[lane] + np.pi) % (2 * np.pi) - np.pi
    sharp, room = np.abs(bend), np.minimum(graph.length_m[lane], graph.length_m[onward]) / 2
    half = np.tan(np.minimum(sharp, np.pi - 1e-9) / 2)
    least_m = vehicle.kinematics.least_radius_m
    with np.errstate(divide="ignore"):
        leaves = vehicle.corner_m / (1 / np.cos(np.minimum(sharp, np.pi - 1e-9) / 2) - 1)
        radius = np.minimum(np.minimum(room / half, leaves), LARGEST_M)
    kind = np.where(sharp <= STRAIGHT_RAD, STRAIGHT, np.where(sharp >= np.pi - TURNS_RAD, BACK, ARC))
    rides = graph.is_ride[lane] | graph.is_ride[onward]
    kind[(kind == ARC) & (radius < least_m - 1e-9) | (kind == ARC) & rides] = IMPOSSIBLE
    kind[(kind == BACK) & (not vehicle.kinematics.reverse)] = IMPOSSIBLE
    radius = np.where(kind == ARC, radius, np.inf)
    tangent = np.where(kind == ARC, np.where(kind == ARC, radius, 0.0) * half, np.where(kind == IMPOSSIBLE, least_m * half, 0.0))
    return Turns(*map(frozen, (first, onward, bend, kind, radius, tangent, room)))


def course_rad(graph: NavGraph) -> FloatArray:
    """[L] direction in which lanes lead; vehicles face it, or away from it in reverse."""
    along = graph.xy[graph.head] - graph.xy[graph.tail]
    course: FloatArray = np.arctan2(along[:, 1], along[:, 0])
    return np.where(graph.is_ride, graph.heading_rad, course)


def gears_of(graph: NavGraph, vehicle: RobotType) -> IntArray:
    """[L, 2] 1 where a type may drive along a lane forward, and backward."""
    allowed = np.ones((graph.num_lanes, 2), np.int64)
    allowed[:, BACKWARD] = vehicle.kinematics.reverse
    for lane, options in enumerate(graph.lane_options):
        if (gear := OF_LANE.get(str(options.get("orientation_constraint")))) is not None:
            allowed[lane, 1 - gear] = 0
    return allowed


def obstacle_to(graph: NavGraph, vehicle: RobotType, route: list[int]) -> str:
    """The first turn along a path of vertices that a type cannot make, in words; '' for none."""
    turns, lanes = turns_of(graph, vehicle), [graph.lane_between(a, b) for a, b in pairwise(route)]
    for lane, onward in pairwise(lanes):
        k = turns.between(lane, onward)
        if k >= 0 and turns.kind[k] == IMPOSSIBLE:
            tail, corner, head = (graph.known_as(v) for v in (int(graph.tail[lane]), int(graph.head[lane]), int(graph.head[onward])))
            if abs(turns.bend_rad[k]) >= np.pi - TURNS_RAD:
                return f"{vehicle.name} cannot reverse, from '{tail}' to '{corner}' and back (kinematics.reverse: true would do)"
            return (
                f"{vehicle.name} needs {turns.tangent_m[k]:.2f} m to turn from '{tail}' over '{corner}' to '{head}' "
                f"and has {turns.room_m[k]:.2f} m"
            )
    return ""
