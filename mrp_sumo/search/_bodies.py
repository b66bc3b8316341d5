"""One Euler step of all bodies, as SUMO takes it."""

from mrp_sumo.search._kernel import kernel


@kernel
def move_bodies(dt, wanted_mps, accel, decel, limit_mps, speed, s_m):
    """Let bodies take one step towards the speeds they are to have, within their limits.

    As SUMO's: the speed changes first, then the body moves on by it (semi-implicit Euler).

    Parameters
    ----------
    dt
        s.
    wanted_mps, accel, decel
        [R] speeds commanded, and limits.
    limit_mps
        [R] of the lane that each robot is on.
    speed, s_m
        [R] written: speeds, and distances driven.
    """
    for r in range(len(s_m)):
        if wanted_mps[r] == 0.0 and speed[r] == 0.0:
            continue
        v = min(wanted_mps[r], speed[r] + accel[r] * dt, limit_mps[r])
        v = max(v, speed[r] - decel[r] * dt, 0.0)
        speed[r] = v
        s_m[r] += v * dt
