"""Kernels of motion in steps: the speeds at which a robot drives in the executor and in SUMO, which move it once each step.

In a step of dt a robot takes up its next speed at once and drives it for the whole step (Euler's method, SUMO's default): the highest
that its acceleration, its top speed, the limit of its lane, limits ahead and its stop allow. `mrp_sumo.core.motion` has the closed forms.
"""

import numpy as np

from mrp_sumo.search._kernel import kernel

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
def turn_steps(angle_rad, turn_rate_rad_s, dt):
    """Number of steps that a turn in place takes."""
    most = turn_rate_rad_s * dt
    return np.int64(max(0.0, np.ceil((abs(angle_rad) - TURNED_RAD) / most)))
