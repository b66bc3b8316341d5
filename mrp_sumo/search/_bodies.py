"""One Euler step of all bodies, as SUMO takes it."""

import numpy as np

from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._motion import approach_speed

TIE_M = 1e-9  # engines round otherwise: who has come this near to a place has passed it


@kernel
def lane_limits(dt, decel, visits, speed, s_m, cap_mps):
    """The highest speeds for the next step that lanes and bends allow: those that each robot is on, and slower ones ahead.

    Parameters
    ----------
    dt
        s.
    decel
        [R] m/s2.
    visits
        See `core.visits`.
    speed, s_m
        [R] speeds, and distances driven.
    cap_mps
        [R] written.
    """
    next_visit, at_m, lane, limit_mps, bend_m = visits.next, visits.at_m, visits.lane, visits.limit_mps, visits.bend_m
    for r in range(len(s_m)):
        k = visits.reached[r]
        bend = visits.bend_mps[k] if s_m[r] < at_m[k] + bend_m[k] - TIE_M else np.inf  # it has not left the arc
        if lane[k] < 0 or s_m[r] >= at_m[k] - TIE_M:  # else it has arrived, but is still on the lane to there
            k = next_visit[k]
        if k < 0:
            cap_mps[r] = np.inf
            continue
        cap = min(limit_mps[k], bend)
        reach_m = speed[r] * speed[r] / (2.0 * decel[r]) + 3.0 * (speed[r] + decel[r] * dt) * dt  # limits farther away do not matter yet
        while k >= 0 and at_m[k] - bend_m[k] - s_m[r] <= reach_m:  # the last may be on an arc, too
            if visits.bend_mps[k] < cap:
                cap = min(cap, approach_speed(max(0.0, at_m[k] - bend_m[k] - s_m[r]), visits.bend_mps[k], decel[r], dt))
            ahead = next_visit[k]
            if ahead >= 0 and limit_mps[ahead] < cap:
                cap = min(cap, approach_speed(at_m[k] - s_m[r], limit_mps[ahead], decel[r], dt))
            k = ahead
        cap_mps[r] = cap


@kernel
def move_bodies(dt, wanted_mps, accel, decel, cap_mps, speed, s_m):
    """Let bodies take one step towards the speeds they are to have, within their limits.

    As SUMO's: the speed changes first, then the body moves on by it (semi-implicit Euler).

    Parameters
    ----------
    dt
        s.
    wanted_mps, accel, decel
        [R] speeds commanded, and limits.
    cap_mps
        [R] what lanes allow.
    speed, s_m
        [R] written: speeds, and distances driven.
    """
    for r in range(len(s_m)):
        if wanted_mps[r] == 0.0 and speed[r] == 0.0:
            continue
        v = min(wanted_mps[r], speed[r] + accel[r] * dt, cap_mps[r])
        v = max(v, speed[r] - decel[r] * dt, 0.0)
        speed[r] = v
        s_m[r] += v * dt
