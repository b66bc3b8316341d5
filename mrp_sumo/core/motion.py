"""Motion of robots: straight runs, turns in place, starts and stops, as closed forms of time.

A robot accelerates and brakes at constant rates, never drives faster than its type can or a lane allows, and turns in place at a constant
rate. The executor and SUMO move robots in steps, with speeds of `mrp_sumo.search._motion`, up to a step away from these.
"""

import numpy as np

from mrp_sumo.core.graph import FloatArray


def run_time_s(
    distance_m: FloatArray,
    speed_mps: FloatArray,
    accel_mps2: FloatArray,
    decel_mps2: FloatArray,
    from_mps: FloatArray | float = 0.0,
    to_mps: FloatArray | float = 0.0,
) -> FloatArray:
    """The least time for straight runs.

    T = (p - v0) / a + (p - v1) / d + (D - (p^2 - v0^2) / 2a - (p^2 - v1^2) / 2d) / p, where the peak p is the lower of the top speed and
    sqrt((2 a d D + d v0^2 + a v1^2) / (a + d)), at which there is no time to cruise. All arguments broadcast.

    Parameters
    ----------
    distance_m
        D, 0 or more.
    speed_mps, accel_mps2, decel_mps2
        The top speed (the lower of the robot's and the lane's limit), a and d.
    from_mps, to_mps
        v0 and v1, up to the top speed.

    Returns
    -------
    T
        NaN where D is too short to get from v0 to v1.
    """
    a, d, v0, v1 = accel_mps2, decel_mps2, from_mps, to_mps
    peak = np.minimum(np.sqrt((2 * a * d * distance_m + d * np.square(v0) + a * np.square(v1)) / (a + d)), speed_mps)
    cruise_m = distance_m - (np.square(peak) - np.square(v0)) / (2 * a) - (np.square(peak) - np.square(v1)) / (2 * d)
    cruise_s = np.divide(cruise_m, peak, out=np.zeros(np.broadcast(cruise_m, peak).shape), where=np.greater(peak, 0))
    possible = peak >= np.maximum(v0, v1) * (1 - 1e-12)
    return np.where(possible, (peak - v0) / a + (peak - v1) / d + np.maximum(cruise_s, 0.0), np.nan)
