"""Motion from rest to rest as a closed form of time.

The executor and SUMO move robots in steps, with speeds of `mrp_sumo.search._motion`, up to a step away from this.
"""

from math import sqrt


def rest_to_rest_s(distance: float, top_speed: float, accel: float) -> float:
    """The least time in which something at rest moves so far, in metres or radians, if it speeds up and brakes at one rate."""
    peak = min(sqrt(accel * distance), top_speed)
    return 2 * peak / accel + (distance - peak * peak / accel) / peak if distance else 0.0
