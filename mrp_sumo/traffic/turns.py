"""Turns of vehicles that cannot turn in place: from each lane to each that leaves its head, by which arc, and in which gear.

Where two lanes meet at a bend, the middle of the fixed axle cuts the corner along an arc of a circle, which touches both lanes at a
distance of R tan(bend / 2) from the corner, within the nearer half of either, so that no two arcs meet. The arc is as large as these
halves allow, begins within a length of the vehicle, and leaves the corner by no more than its type's `corner_m`.

A vehicle that may reverse changes gear where a lane leads straight back. One that comes backward to a corner also swings past it along
an arc of its least radius, away from the lane on which it is to leave, stops in line with that lane, and leaves forward: so forklifts
back out of a station. It does so wherever it can.
"""

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph, frozen
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.core.wheel_path import SHARPEST_RAD

FORWARD, BACKWARD, NEVER = 0, 1, -1  # gears
STRAIGHT_RAD = 1e-6
IN_LINE_RAD = 0.01  # within which a vehicle that stands is in line with a lane
MAY_STAND_RAD = 0.2  # of a start's heading off a lane, and of lanes that lead straight back
OF_LANE = {"forward": FORWARD, "backward": BACKWARD}  # Open-RMF's option `orientation_constraint`


class Turns(NamedTuple):
    """P turns, by the lane on which one comes [L + 1] CSR and then by the lane on which one leaves."""

    first: IntArray  # [L + 1]
    onward: IntArray  # [P] lane on which one leaves
    bend_rad: FloatArray  # [P] counter-clockwise
    radius_m: FloatArray  # [P] of the arc in one gear, inf where it is straight, NaN where there is none
    tangent_m: FloatArray  # [P] from the corner to where that arc begins and ends; without one, what the least radius would take
    swing_m: FloatArray  # [P] the same of the arc after which it changes gear; NaN where there is none
    room_m: FloatArray  # [P] half of the shorter lane
    next_gear: IntArray  # [P, 2] gear in which one leaves, by that in which one comes; NEVER: one cannot
    may_stand: IntArray  # [P, 2] the same for a vehicle that stands at the corner

    def between(self, lane: int, onward: int) -> int:
        """The turn from a lane to one that leaves its head, -1: there is none."""
        a, b = int(self.first[lane]), int(self.first[lane + 1])
        at = np.flatnonzero(self.onward[a:b] == onward)
        return a + int(at[0]) if len(at) else -1


@lru_cache(maxsize=16)
def turns_of(graph: NavGraph, vehicle: RobotType) -> Turns:
    """All turns of a type on a graph. Lanes are straight."""
    course, allowed, wheels = course_rad(graph), gears_of(graph, vehicle), vehicle.kinematics
    count = np.diff(graph.first)[graph.head]
    first = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    lane = np.repeat(np.arange(graph.num_lanes), count)
    onward = np.arange(int(count.sum())) - np.repeat(first[:-1] - graph.first[graph.head], count)
    bend = (course[onward] - course[lane] + np.pi) % (2 * np.pi) - np.pi
    room, rides = np.minimum(graph.length_m[lane], graph.length_m[onward]) / 2, graph.is_ride[lane] | graph.is_ride[onward]
    sharp = np.minimum(np.abs(bend), np.pi - 1e-9)
    half, least_m = np.tan(sharp / 2), wheels.least_radius_m
    with np.errstate(divide="ignore"):
        leaves = vehicle.corner_m / (1 / np.cos(sharp / 2) - 1)
        radius = np.minimum(np.minimum(room / half, leaves), np.maximum(vehicle.length_m / half, least_m))
    straight = sharp <= STRAIGHT_RAD
    arc = ~straight & ~rides & (radius >= least_m - 1e-9)
    swing = least_m / np.maximum(half, 1e-9)  # the heading changes by what the bend leaves of a half turn
    left = np.pi - sharp
    swings = (left <= SHARPEST_RAD) & (swing <= room - abs(wheels.ahead_m) + 1e-9) & (~rides | (left <= MAY_STAND_RAD)) & wheels.reverse
    stays, changes = ((straight | arc)[:, None] & (allowed[onward] > 0)), swings[:, None] & (allowed[onward][:, ::-1] > 0)
    changes[:, FORWARD] &= left <= MAY_STAND_RAD
    next_gear = np.stack(
        [
            np.where(stays[:, 0], FORWARD, np.where(changes[:, 0], BACKWARD, NEVER)),
            np.where(changes[:, 1], FORWARD, np.where(stays[:, 1], BACKWARD, NEVER)),
        ],
        axis=1,
    )
    gears = np.array([FORWARD, BACKWARD])
    on, back = ((sharp <= IN_LINE_RAD)[:, None] & (allowed[onward] > 0)), (left <= IN_LINE_RAD)[:, None] & changes
    may_stand = np.where(on, gears, np.where(back, 1 - gears, NEVER))
    radius = np.where(straight, np.inf, np.where(arc, radius, np.nan))
    tangent = np.where(straight, 0.0, np.where(arc, np.where(arc, radius, 0.0) * half, least_m * half))
    swing = np.where(swings, swing, np.nan)
    return Turns(*map(frozen, (first, onward, bend, radius, tangent, swing, room, next_gear, may_stand)))


def stands_bent(turns: Turns, lane: int, gear: int) -> tuple[int, int] | None:
    """The lane, and the gear, for which a vehicle that stops at the end of a lane stops on the arc; None where it stops in line.

    It does so where it could not go on from the corner itself.
    """
    some = slice(int(turns.first[lane]), int(turns.first[lane + 1]))
    gears, onward = turns.next_gear[some, gear], turns.onward[some]
    if (turns.may_stand[some, gear] != NEVER).any() or not (gears != NEVER).any():
        return None
    k = int(np.argmin(np.where(gears != NEVER, np.abs(turns.bend_rad[some]), np.inf)))
    return int(onward[k]), int(gears[k])


@lru_cache(maxsize=16)
def course_rad(graph: NavGraph) -> FloatArray:
    """[L] direction in which lanes lead; vehicles face it, or away from it in reverse."""
    along = graph.xy[graph.head] - graph.xy[graph.tail]
    course: FloatArray = np.arctan2(along[:, 1], along[:, 0])
    return frozen(np.where(graph.is_ride, graph.heading_rad, course))


@lru_cache(maxsize=16)
def gears_of(graph: NavGraph, vehicle: RobotType) -> IntArray:
    """[L, 2] 1 where a type may drive along a lane forward, and backward."""
    return frozen(np.array([_of_lane(graph, vehicle, lane) for lane in range(graph.num_lanes)], np.int64).reshape(-1, 2))


def _of_lane(graph: NavGraph, vehicle: RobotType, lane: int) -> tuple[bool, bool]:
    """True for forward and backward, where a type may drive so along a lane."""
    gear = OF_LANE.get(str(graph.lane_options[lane].get("orientation_constraint")))
    return gear != BACKWARD, gear != FORWARD and vehicle.kinematics.reverse


def obstacle_to(graph: NavGraph, vehicle: RobotType, route: list[int]) -> str:
    """The first turn along a path of vertices that a type cannot make in any gear, in words; '' for none."""
    turns, allowed = turns_of(graph, vehicle), gears_of(graph, vehicle)
    lanes = [graph.lane_between(a, b) for a, b in pairwise(route)]
    gears = {FORWARD, BACKWARD}
    for lane, onward in pairwise([-1, *lanes]):
        tail, head = int(graph.tail[onward]), int(graph.head[onward])
        onto = f"from '{graph.known_as(tail)}' to '{graph.known_as(head)}'"
        if not allowed[onward].any():
            return f"{vehicle.name} would have to reverse {onto} (kinematics.reverse: true would do)"
        k = turns.between(lane, onward) if lane >= 0 else -1
        gears = {int(turns.next_gear[k, gear]) for gear in gears} - {NEVER} if k >= 0 else {g for g in gears if allowed[onward, g]}
        if gears:
            continue
        before = graph.known_as(int(graph.tail[lane]))
        if abs(turns.bend_rad[k]) >= np.pi - MAY_STAND_RAD and not vehicle.kinematics.reverse:
            return (
                f"{vehicle.name} cannot reverse, from '{before}' to '{graph.known_as(tail)}' and back (kinematics.reverse: true would do)"
            )
        over = f"from '{before}' over '{graph.known_as(tail)}' to '{graph.known_as(head)}'"
        if turns.tangent_m[k] <= turns.room_m[k] and np.isfinite(turns.radius_m[k]):
            return f"{vehicle.name} would have to change gear {over}, where lanes are for one gear"
        return f"{vehicle.name} needs {turns.tangent_m[k]:.2f} m to turn {over} and has {turns.room_m[k]:.2f} m"
    return ""
