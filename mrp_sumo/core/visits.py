"""Visits as kernels and engines see them: arrays by ids that never change.

A visit is a robot's arrival at a vertex. A robot's visits are linked: `next` leads from each to the one after it, and is -1
at the end of what the robot has been given so far. Arrays may be longer than there are visits.
"""

from typing import NamedTuple

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray


class Visits(NamedTuple):
    """N visits of R robots on L lanes, [N] unless said. Distances are along the robot's way since its start, in m."""

    next: IntArray  # the robot's visit after this one, -1: none
    rank: IntArray  # how many visits of the robot come before it
    vertex: IntArray
    lane: IntArray  # by which it is reached, -1 for first visits
    from_m: FloatArray  # where that lane begins
    at_m: FloatArray  # where the vertex is
    heading_rad: FloatArray  # of that lane; for first visits that of the next
    turns: BoolArray  # whether the robot turns in place here before it goes on
    gear: IntArray  # of a vehicle on that lane, 0 forward, 1 backward
    tangent_m: FloatArray  # before the vertex and after it, where it cuts the corner by an arc; 0: it does not
    bend_m: FloatArray  # before the vertex and after it, within which the vehicle is on that arc
    bend_mps: FloatArray  # top speed there
    limit_mps: FloatArray  # top speed on that lane, inf: that of the robot
    arrive_s: FloatArray  # as planned
    depart_s: FloatArray  # as planned; later than `arrive_s` where the robot is to stand there
    earliest_s: FloatArray  # to leave
    due_s: FloatArray  # to arrive, where robots keep a pace; 0 elsewhere
    short_of_m: FloatArray  # where the robot may wait for this visit on its lane, inf: nowhere
    arrived_s: FloatArray  # when the robot came, NaN: not yet
    first: IntArray  # [R] each robot's first visit
    last: IntArray  # [R] and its last
    reached: IntArray  # [R] and the last that it has arrived at
    granted: IntArray  # [R] and the last that it may drive to
    reverse: IntArray  # [L] the opposite lane, -1: none
