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


@kernel
def steps_of_turn(angle_rad, turn_rad):
    """Steps of a turn in place, at `turn_rad` a step. Lesser bends are driven through; an angle that is not known (NaN) is none."""
    angle = abs((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
    return turn_steps(angle, turn_rad, 1.0) if angle > STRAIGHT_RAD else 0


@kernel
def steps_of_last_turn(angle_rad, turn_rad):
    """The same at a goal, where a robot turns to the very heading."""
    angle = abs((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
    return turn_steps(angle, turn_rad, 1.0) if angle > 0.0 else 0


@kernel
def steps_of_turns(first, head, heading_rad, turn_first, turn_rad, out):
    """Of turns from each lane to each that leaves its head."""
    for lane in range(len(head)):
        v = head[lane]
        for following in range(first[v], first[v + 1]):
            out[turn_first[lane] + following - first[v]] = steps_of_turn(heading_rad[following] - heading_rad[lane], turn_rad)


@kernel
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


@kernel(allocates=True)
def lay_course(course):
    """Positions after 0, 1, ... steps from rest, and the speed of the step that follows, until the ray's end is passed."""
    dist, dt, num = course.end_m, course.dt, len(course.end_m)
    s_out, v_out = np.empty(64), np.empty(64)
    s, v, n, here = -MARGIN_M, 0.0, 0, 0
    while n == 0 or s_out[n - 1] <= dist[num - 1] + v * dt:
        while here < num - 1 and s >= dist[here]:
            here += 1
        v = next_speed(course, s, v, here, num)
        if n == len(s_out):
            s_out, v_out = np.concatenate((s_out, np.empty(n))), np.concatenate((v_out, np.empty(n)))
        s_out[n], v_out[n] = s, v
        n += 1
        s += v * dt
    return s_out[:n], v_out[:n]


@kernel(allocates=True)
def lay_tails(course, s_in, v_in):
    """Of each run: the step before which it brakes, the step after which it has arrived, and its positions from the first to the second.

    Parameters
    ----------
    course
        The ray.
    s_in, v_in
        Positions and speeds, see `lay_course`.

    Returns
    -------
    brake, time, first, tail
        [K] the steps, and where the positions of each run begin in `tail`.
    """
    dist, decel, dt = course.end_m, course.decel_mps2, course.dt
    brake, time, first = np.empty(len(dist), np.int64), np.empty(len(dist), np.int64), np.empty(len(dist), np.int64)
    tail, n, used = np.empty(64), 0, 0
    for k in range(len(dist)):
        free = dist[k] - MARGIN_M
        while stop_speed(free - s_in[n], decel, dt) >= v_in[n] - 1e-9:
            n += 1
        brake[k], first[k] = n, used
        s, v, m = s_in[n], v_in[n - 1] if n > 0 else 0.0, n
        here = k
        while here > 0 and s < dist[here - 1]:
            here -= 1
        while True:
            if used == len(tail):
                tail = np.concatenate((tail, np.empty(used)))
            tail[used] = s
            used += 1
            if s >= dist[k] - ARRIVED_M:
                break
            while here < k and s >= dist[here]:
                here += 1
            v = min(stop_speed(free - s, decel, dt), next_speed(course, s, v, here, k + 1))
            s += v * dt
            m += 1
        time[k] = m
    return brake, time, first, tail[:used].copy()
