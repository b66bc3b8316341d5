"""Kernels that lay out straight runs in simulation steps: when each lane's end must be free, and where the robot is after each step.

A ray is a lane with all that follow straight on. All runs from rest along a ray begin alike: a robot that is to stop at the end of its
k-th lane brakes at the very step before which it would have had to be let on to the next lane. So a ray has one course of positions,
and each of its runs a tail of its own.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._motion import approach_speed, stop_speed, turn_steps

MARGIN_M = 0.001  # a robot is stopped this far before the end of what it may drive
STRAIGHT_RAD = 0.2  # lesser bends are driven through
ARRIVED_M = 0.002  # and has arrived this close to it


class DrivenRay(NamedTuple):
    """A ray of K lanes, and who drives along it."""

    end_m: np.ndarray  # [K] where each lane ends
    limit_mps: np.ndarray  # [K]
    top_mps: float
    accel_mps2: float
    decel_mps2: float
    dt: float  # s


@kernel(allocates=False)
def steps_of_turn(angle_rad, turn_rad):
    """Steps of a turn in place, at `turn_rad` a step. Lesser bends are driven through; an angle that is not known (NaN) is none."""
    angle = abs((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
    return turn_steps(angle, turn_rad, 1.0) if angle > STRAIGHT_RAD else 0


@kernel(allocates=False)
def steps_of_last_turn(angle_rad, turn_rad):
    """The same at a goal, where a robot turns to the very heading."""
    angle = abs((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
    return turn_steps(angle, turn_rad, 1.0) if angle > 0.0 else 0


@kernel(allocates=False)
def steps_of_turns(first, head, heading_rad, turn_first, turn_rad, out):
    """Of turns from each lane to each that leaves its head."""
    for lane in range(len(head)):
        v = head[lane]
        for following in range(first[v], first[v + 1]):
            out[turn_first[lane] + following - first[v]] = steps_of_turn(heading_rad[following] - heading_rad[lane], turn_rad)


@kernel(allocates=False)
def next_speed(course, s, v, here, num):
    """Speed in the next step where nothing ends: acceleration, top speed, the limit of this lane and those ahead, of `num` lanes."""
    dist, limit, top, accel, decel, dt = course
    v = min(v + accel * dt, min(top, limit[here]))
    reach = v * v / (2.0 * decel) + 2.0 * v * dt
    for k in range(here + 1, num):
        if dist[k - 1] - s > reach:
            break
        if limit[k] < v:
            v = min(v, approach_speed(dist[k - 1] - s, limit[k], decel, dt))
    return v


@kernel(allocates=False)
def lay_course(course, s_out, v_out):
    """Positions after 0, 1, ... steps from rest, and the speed of the step that follows, until the ray's end is passed.

    Returns how many, or -1 where there is no room for them.
    """
    dist, dt, num = course.end_m, course.dt, len(course.end_m)
    s, v, n, here = -MARGIN_M, 0.0, 0, 0
    while n < len(s_out):
        while here < num - 1 and s >= dist[here]:
            here += 1
        v = next_speed(course, s, v, here, num)
        s_out[n] = s
        v_out[n] = v
        n += 1
        if s > dist[num - 1] + v * dt:
            return n
        s += v * dt
    return -1


@kernel(allocates=False)
def lay_tails(course, s_in, v_in, brake, time, tail_first, tail_s):
    """Of each run: the step before which it brakes, the step after which it has arrived, and its positions from the first to the second.

    Returns how many positions there are, or -1 where there is no room for them.
    """
    dist, decel, dt = course.end_m, course.decel_mps2, course.dt
    n, used = 0, 0
    for k in range(len(dist)):
        free = dist[k] - MARGIN_M
        while stop_speed(free - s_in[n], decel, dt) >= v_in[n] - 1e-9:
            n += 1
        brake[k] = n
        tail_first[k] = used
        s, v, m = s_in[n], v_in[n - 1] if n > 0 else 0.0, n
        here = k
        while here > 0 and s < dist[here - 1]:
            here -= 1
        while s < dist[k] - ARRIVED_M:
            while here < k and s >= dist[here]:
                here += 1
            if used >= len(tail_s) - 1:
                return -1
            tail_s[used] = s
            used += 1
            v = min(stop_speed(free - s, decel, dt), next_speed(course, s, v, here, k + 1))
            s += v * dt
            m += 1
        tail_s[used] = s
        used += 1
        time[k] = m
    return used
