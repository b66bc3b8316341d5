"""Cubic Bezier curves between two places that are left and reached in given courses."""

import math

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.graph import FloatArray

PIECE_RAD = 0.02  # between two places that are worked out
LEAST_PIECES = 4


def bezier_between(ends: FloatArray, begin_rad: float, turned_rad: float) -> FloatArray:
    """[N, 4] places along a curve from end to end [2, 2]: distance, x, y, course, without jumps.

    Between two places of a circle it is the arc, within 3e-4 of the radius for 90 degrees and 1e-8 for 15.
    """
    control = control_points(ends, begin_rad, turned_rad)
    legs = np.diff(control, axis=0)
    bends = np.abs(wrapped(np.diff(np.arctan2(legs[:, 1], legs[:, 0])))).sum()  # more than the curve turns, to one side and the other
    t = np.linspace(0.0, 1.0, max(LEAST_PIECES, math.ceil(bends / PIECE_RAD)) + 1)[:, None]
    xy = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3]) @ control
    along = np.hstack([(1 - t) ** 2, 2 * t * (1 - t), t**2]) @ legs
    course = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    course += begin_rad - course[0]
    at_m = np.append(0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))
    return np.column_stack([at_m, xy, course])


def control_points(ends: FloatArray, begin_rad: float, turned_rad: float) -> FloatArray:
    """[4, 2] of the curve."""
    chord_m, half = math.dist(*ends.tolist()), abs(turned_rad) / 2
    handle_m = chord_m * (math.tan(half / 2) * 2 / 3 / math.sin(half) if half > 1e-6 else 1 / 3)
    courses = np.array([begin_rad, begin_rad + turned_rad])
    out, into = handle_m * np.stack([np.cos(courses), np.sin(courses)], 1)
    return np.stack([ends[0], ends[0] + out, ends[1] - into, ends[1]])


def corners_of(fine: FloatArray, within_m: float) -> list[int]:
    """Those of samples [N, 2], ends included, between which straight pieces stay so close to all (Douglas and Peucker, 1973)."""
    corners, open_ = [0], [(0, len(fine) - 1)]
    while open_:
        a, b = open_.pop()
        chord = fine[b] - fine[a]
        off = fine[a + 1 : b] - fine[a]
        share = np.clip(off @ chord / max(float(chord @ chord), 1e-18), 0.0, 1.0)
        away = ((off - share[:, None] * chord) ** 2).sum(1)
        if b - a > 1 and away.max() > within_m**2:
            middle = a + 1 + int(away.argmax())
            open_ += [(middle, b), (a, middle)]
        else:
            corners.append(b)
    return corners
