"""Whole runs of a robot in steps, from the speeds of `mrp_sumo.search._motion`: what SUMO has to do, too."""

import numpy as np

from mrp_sumo.search._motion import approach_speed, stop_speed

STANDS_MPS = 1e-9  # a lower speed is none


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
    return stepped_way(np.array([distance_m]), np.array([np.inf]), distance_m, speed_mps, accel_mps2, decel_mps2, dt, out_s)


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


def first_step_at(run_s, num_steps, at_m):
    """The step after which a robot on a run is at `at_m` or beyond: 0 where it begins there, `num_steps` + 1 if never."""
    if at_m <= 0.0:
        return 0
    return np.searchsorted(run_s[:num_steps], at_m) + 1


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
