"""Kernels of motion in steps: exactly what a robot does in the executor and in SUMO, which move it once each step.

In a step of dt a robot takes up its next speed at once and drives it for the whole step (Euler's method, SUMO's default): the highest
that its acceleration, its top speed, the limit of its lane, limits ahead and its stop allow. `mrp_sumo.core.motion` has the closed forms.
"""

import numpy as np

from mrp_sumo.search._kernel import kernel

STANDS_MPS = 1e-9  # a lower speed is none
TURNED_RAD = 1e-9  # what is left of a turn that a last step does on top of its own


@kernel
def stop_speed(free_m, decel_mps2, dt):
    """The highest speed for the next step that still allows a stop within `free_m` at `decel_mps2`.

    Exact for SUMO's Euler steps: speed v = n b + x (0 <= x < b = decel dt) needs (n+1) x dt + b dt n (n+1) / 2.
    """
    if free_m <= 0.0:
        return 0.0
    b = decel_mps2 * dt
    n = np.floor((np.sqrt(1.0 + 8.0 * free_m / (b * dt)) - 1.0) / 2.0)
    return n * b + (free_m - b * dt * n * (n + 1.0) / 2.0) / ((n + 1.0) * dt)


@kernel
def approach_speed(free_m, limit_mps, decel_mps2, dt):
    """The highest speed for the next step with which a robot, braking at `decel_mps2`, has slowed to `limit_mps` within `free_m`.

    As SUMO does before a lane with a lower limit: n steps of braking from w + n b + x to w + b + x and one at w + x, or at w where
    that step ends beyond.
    """
    w = limit_mps
    if free_m < w * dt:
        return w
    b = decel_mps2 * dt
    half = 0.5 + w / b
    n = np.floor(np.sqrt(half * half + 2.0 * free_m / (b * dt)) - half)
    left = free_m - b * dt * n * (n + 1.0) / 2.0 - (n + 1.0) * w * dt
    return w + n * b + max(0.0, left) / ((n + 1.0) * dt)


@kernel
def stepped_run(distance_m, speed_mps, accel_mps2, decel_mps2, dt, out_s):
    """A straight run from rest to rest, nothing in the way.

    Parameters
    ----------
    distance_m
        From where the robot stands to where it stops. The executor's robots stop `MARGIN_M` before the end of what they may drive, so
        that the first run is shorter by that than the way between its vertices, and all later ones are as long.
    speed_mps
        The lower of the robot's top speed and the lanes' limit.
    out_s
        Positions after each step, as many as there is room for.

    Returns
    -------
    int
        Number of steps until the robot stands, also where it is more than `out_s` has room for.
    """
    s, v, num_steps = 0.0, 0.0, 0
    while True:
        v = min(min(stop_speed(distance_m - s, decel_mps2, dt), v + accel_mps2 * dt), speed_mps)
        if v < STANDS_MPS:
            return num_steps
        s += v * dt
        if num_steps < len(out_s):
            out_s[num_steps] = s
        num_steps += 1


@kernel
def stepped_way(end_m, limit_mps, distance_m, speed_mps, accel_mps2, decel_mps2, dt, out_s):
    """As `stepped_run`, over K lanes with speed limits of their own.

    Parameters
    ----------
    end_m
        [K] where each lane ends, ascending. The robot begins at 0, on the first.
    limit_mps
        [K] of each lane, inf without one.
    distance_m
        Where it stops, on the last lane.
    """
    s, v, num_steps, here = 0.0, 0.0, 0, 0
    while True:
        while here < len(end_m) - 1 and s >= end_m[here]:
            here += 1
        v = min(min(stop_speed(distance_m - s, decel_mps2, dt), v + accel_mps2 * dt), min(speed_mps, limit_mps[here]))
        reach_m = v * v / (2.0 * decel_mps2) + 2.0 * v * dt  # limits farther away do not matter yet
        for k in range(here + 1, len(end_m)):
            if end_m[k - 1] - s > reach_m:
                break
            if limit_mps[k] < v:
                v = min(v, approach_speed(end_m[k - 1] - s, limit_mps[k], decel_mps2, dt))
        if v < STANDS_MPS:
            return num_steps
        s += v * dt
        if num_steps < len(out_s):
            out_s[num_steps] = s
        num_steps += 1


@kernel
def first_step_at(run_s, num_steps, at_m):
    """The step after which a robot on a run is at `at_m` or beyond: 0 where it begins there, `num_steps` + 1 if never."""
    if at_m <= 0.0:
        return 0
    return np.searchsorted(run_s[:num_steps], at_m) + 1


@kernel
def taken_step(run_s, num_steps, until_m, decel_mps2, dt):
    """How many steps a robot can make of a run when it may drive up to `until_m` only, before it has to go slower.

    After so many steps the next stretch of its way has to be free. 0: the robot cannot even set out as it wants to.
    """
    s = 0.0
    for k in range(num_steps):
        if stop_speed(until_m - s, decel_mps2, dt) < (run_s[k] - s) / dt - 1e-7:
            return k
        s = run_s[k]
    return num_steps


@kernel
def turn_steps(angle_rad, turn_rate_rad_s, dt):
    """Number of steps that a turn in place takes."""
    most = turn_rate_rad_s * dt
    return np.int64(max(0.0, np.ceil((abs(angle_rad) - TURNED_RAD) / most)))
