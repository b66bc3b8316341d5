"""Logs of shuttles that drive to and fro by the program's law of motion, with known figures."""

import numpy as np

from mrp_sumo.calibration.cruise import Scatter
from mrp_sumo.search._motion import stop_speed

STEP_S = 0.1
LENGTH_M = 14.0
SCATTER = Scatter(0.06, 3.0)


def factors(scatter, steps, rng):
    """Factors on the speed in successive steps, as `drive.world` draws them."""
    u, made = rng.normal() * scatter.noise, []
    for normal in rng.normal(size=steps):
        made.append(max(0.2, 1 - abs(u)))
        u += -u * STEP_S / scatter.tau_s + scatter.noise * np.sqrt(2 * STEP_S / scatter.tau_s) * normal
    return made


def shuttle_rows(rng, *, top=1.2, accel=0.6, decel=0.8, turn=1.0, scatter=SCATTER, sigma=0.02, trips=40, period_s=1.0):
    """Poses (t_s, x_m, y_m, yaw_rad) of one shuttle: a trip, a stand of some seconds, a turn, and the way back."""
    t, x, yaw, heading, forth = [0.0], [0.0], [0.0], 0.0, True
    for _ in range(trips):
        speed, route = 0.0, [0.0]
        for factor in factors(scatter, 600, rng):
            wanted = min(stop_speed(LENGTH_M - route[-1] - 0.001, decel, STEP_S), top * factor)
            speed = min(speed + accel * STEP_S, max(wanted, speed - decel * STEP_S))
            route.append(route[-1] + speed * STEP_S)
            if LENGTH_M - route[-1] < 0.0015:
                break
        x += (np.array(route) if forth else LENGTH_M - np.array(route)).tolist()
        yaw += [heading] * len(route)
        wait = int(rng.uniform(4, 12) / STEP_S)
        x += [x[-1]] * wait
        yaw += [heading] * wait
        steps = int(np.ceil(np.pi / (turn * STEP_S)))
        yaw += [heading + min(k * turn * STEP_S, np.pi) for k in range(1, steps + 1)]
        heading, forth = heading + np.pi, not forth
        x += [x[-1]] * steps
        rest = int(rng.uniform(4, 8) / STEP_S)
        x += [x[-1]] * rest
        yaw += [heading] * rest
    t = np.arange(len(x)) * STEP_S
    at = np.arange(rng.uniform(0, period_s), t[-1], period_s)
    noisy = [np.interp(at, t, values) + rng.normal(0, s, len(at)) for values, s in ((x, sigma), (np.zeros(len(x)), sigma), (yaw, 0.02))]
    return np.column_stack((at, *noisy))


def write_csv(path, rows, head="t_s,robot,x_m,y_m,yaw_rad", scale=1.0):
    """A CSV of poses by name of the vehicle."""
    lines = [head]
    for name, poses in rows.items():
        lines += [f"{t:.3f},{name},{x * scale:.4f},{y * scale:.4f},{yaw:.4f}" for t, x, y, yaw in poses]
    path.write_text("\n".join(lines) + "\n")
