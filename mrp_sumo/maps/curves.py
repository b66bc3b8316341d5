"""Curved lanes as chains of straight pieces: NURBS as LIF and VDA 5050 have them, and Bezier curves, which are NURBS too.

A piece is nowhere further than 1 cm from the curve. Piegl and Tiller, The NURBS Book, algorithm A2.2 for the basis.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np

from mrp_sumo.core.graph import FloatArray

TOLERANCE_M = 0.01
SAMPLE_M = 0.05  # between samples of a curve, about
MAX_SAMPLES = 4096
SPARE = 0.8  # of the tolerance, for what lies between samples


def bezier_knots(degree: int, pieces: int = 1) -> tuple[float, ...]:
    """The knots with which a NURBS of (degree * pieces + 1) control points is that many Bezier curves, end to end."""
    inner = [k / pieces for k in range(1, pieces) for _ in range(degree)]
    return (0.0,) * (degree + 1) + tuple(inner) + (1.0,) * (degree + 1)


def fault_of_curve(degree: float, knots: Sequence[float], num_points: int) -> str:
    """Fault of a NURBS, in words; '' for none."""
    if degree != int(degree) or not 1 <= degree <= 9:
        return f"degree {degree:g}, expected 1 to 9"
    if num_points < degree + 1:
        return f"{num_points} control points, expected at least {int(degree) + 1} for degree {degree:g}"
    if len(knots) != num_points + degree + 1:
        return f"{len(knots)} knots, expected {num_points + int(degree) + 1} for {num_points} control points of degree {degree:g}"
    if any(a > b for a, b in pairwise(knots)):
        return "knots that descend"
    if not knots[int(degree)] < knots[num_points]:
        return "knots without any length between them"
    return ""


def flattened(degree: int, knots: Sequence[float], points: FloatArray, weights: FloatArray | None = None) -> FloatArray:
    """A polyline [N, 2] along a NURBS, ends included, nowhere further than 1 cm from it.

    Parameters
    ----------
    degree, knots
        Without fault; see `fault_of_curve`.
    points
        [P, 2] control points, in m.
    weights
        [P] above 0; all alike by default.
    """
    if degree == 1:
        return points[_corners(points, SPARE * TOLERANCE_M)]
    span = points[1:] - points[:-1]
    length_m = float(np.hypot(span[:, 0], span[:, 1]).sum())
    samples = 1 << max(3, math.ceil(math.log2(max(min(length_m / SAMPLE_M, MAX_SAMPLES), 1.0))))
    basis = _basis(degree, tuple(knots), len(points), samples)
    if weights is None:
        fine = basis @ points
    else:
        shares = basis * weights
        fine = (shares @ points) / shares.sum(1, keepdims=True)
    return fine[_corners(fine, SPARE * TOLERANCE_M)]


def _corners(fine: FloatArray, within_m: float) -> list[int]:
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


@lru_cache(maxsize=256)
def _basis(degree: int, knots: tuple[float, ...], num_points: int, samples: int) -> FloatArray:
    """[samples + 1, P] the basis functions at even parameters."""
    at = np.linspace(knots[degree], knots[num_points], samples + 1)
    u = np.array(knots)
    last = int(np.searchsorted(u, u[num_points], "left")) - 1  # the last span that is not empty, so that the end is in it
    span = np.clip(np.searchsorted(u, at, "right") - 1, degree, last)
    basis = np.zeros((samples + 1, num_points))
    rows = np.arange(samples + 1)
    values = np.zeros((samples + 1, degree + 1))
    values[:, 0] = 1.0
    for j in range(1, degree + 1):
        saved = np.zeros(samples + 1)
        for r in range(j):
            right, left = u[span + r + 1] - at, at - u[span + 1 - j + r]
            whole = right + left
            part = np.where(whole > 0, values[:, r] / np.where(whole > 0, whole, 1.0), 0.0)
            values[:, r] = saved + right * part
            saved = left * part
        values[:, j] = saved
    for j in range(degree + 1):
        np.add.at(basis, (rows, span - degree + j), values[:, j])
    return basis
