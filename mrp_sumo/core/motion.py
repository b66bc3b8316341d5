"""Motion of robots: straight runs, turns in place, starts and stops, as closed forms of time.

A robot accelerates and brakes at constant rates, never drives faster than its type can or a lane allows, and turns in place at a constant
rate. `Profile` is one run, from rest to rest over lanes with limits of their own. The executor and SUMO move robots in steps,
with speeds of `mrp_sumo.search._motion`, up to a step away from these.
"""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, frozen

SHORTEST_S = 1e-9  # of a phase


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


@dataclass(frozen=True, eq=False)
class Profile:
    """Speed over time of one run, in P phases of constant acceleration."""

    t_s: FloatArray  # [P + 1] when phases begin, and the last ends; from 0
    at_m: FloatArray  # [P + 1] where
    speed_mps: FloatArray  # [P + 1] how fast

    @property
    def end_s(self) -> float:
        return float(self.t_s[-1])


def run_profile(length_m: FloatArray, limit_mps: FloatArray, speed_mps: float, accel_mps2: float, decel_mps2: float) -> Profile:
    """The fastest run from rest to rest over K lanes, one after the other.

    The speed at a lane's end is the most that both lanes' limits, accelerating from the start and braking to the stop allow; between two
    ends a robot accelerates, cruises and brakes.

    Parameters
    ----------
    length_m
        [K] above 0.
    limit_mps
        [K] of the lanes, inf without one.
    """
    top = np.minimum(limit_mps, speed_mps)
    square = np.concatenate([[0.0], np.square(np.minimum(top[:-1], top[1:])), [0.0]])  # [K + 1] of speeds at lanes' ends
    for k, length in enumerate(length_m.tolist()):
        square[k + 1] = min(square[k + 1], square[k] + 2 * accel_mps2 * length)
    for k, length in reversed(list(enumerate(length_m.tolist()))):
        square[k] = min(square[k], square[k + 1] + 2 * decel_mps2 * length)
    enters, leaves = square[:-1], square[1:]
    free = (2 * accel_mps2 * decel_mps2 * length_m + decel_mps2 * enters + accel_mps2 * leaves) / (accel_mps2 + decel_mps2)
    peak = np.minimum(np.square(top), free)
    speeds_up_m, brakes_m = (peak - enters) / (2 * accel_mps2), (peak - leaves) / (2 * decel_mps2)
    cruises_m = np.maximum(length_m - speeds_up_m - brakes_m, 0.0)
    peak, low, high = np.sqrt(peak), np.sqrt(enters), np.sqrt(leaves)
    phase_s = np.stack([(peak - low) / accel_mps2, cruises_m / peak, (peak - high) / decel_mps2], 1).reshape(-1)
    phase_m = np.stack([speeds_up_m, cruises_m, brakes_m], 1).reshape(-1)
    speed = np.append(0.0, np.stack([peak, peak, high], 1).reshape(-1))
    keep = phase_s > SHORTEST_S
    return Profile(
        t_s=frozen(np.append(0.0, np.cumsum(phase_s[keep]))),
        at_m=frozen(np.append(0.0, np.cumsum(phase_m[keep]))),
        speed_mps=frozen(np.append(0.0, speed[1:][keep])),
    )


def speed_mps(profile: Profile, t_s: FloatArray) -> FloatArray:
    """Speed of a robot `t_s` after it set out."""
    p, since = _phase(profile.t_s, t_s)
    return profile.speed_mps[p] + _rates(profile)[p] * since


def time_s(profile: Profile, at_m: FloatArray) -> FloatArray:
    """Times at which a robot comes to places along its run; inf for places beyond its end."""
    at_m = np.asarray(at_m, np.float64)
    p, along = _phase(profile.at_m, at_m)
    speed, rate = profile.speed_mps[p], _rates(profile)[p]
    then = np.sqrt(np.maximum(np.square(speed) + 2 * rate * along, 0.0))
    pace = speed + then  # of which half is the mean speed
    t_s = profile.t_s[p] + np.divide(2 * along, pace, out=np.zeros(along.shape), where=pace > 0)
    return np.where(at_m > profile.at_m[-1] + 1e-9, np.inf, t_s)


def _phase(begins: FloatArray, at: FloatArray) -> tuple[IntArray, FloatArray]:
    """The phase in which each value lies, and how far in it."""
    at = np.clip(at, 0.0, begins[-1])
    p = np.clip(np.searchsorted(begins, at, side="right") - 1, 0, len(begins) - 2)
    return p, at - begins[p]


def _rates(profile: Profile) -> FloatArray:
    """[P] accelerations."""
    rates: FloatArray = np.diff(profile.speed_mps) / np.diff(profile.t_s)
    return rates
