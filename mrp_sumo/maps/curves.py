"""Curved lanes as chains of straight pieces: NURBS as LIF and VDA 5050 have them, and Bezier curves, which are NURBS too.

A piece is nowhere further than 1 cm from the curve, whose directions the bends between pieces keep: a Bezier curve between two bends in
these directions is the curve, to a hundredth of a millimetre where it is an arc. Piegl and Tiller, The NURBS Book, algorithm A2.2 for
the basis.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.bezier import bezier_between, control_points, corners_of
from mrp_sumo.core.graph import FloatArray, NavGraph

TANGENT, BEFORE, AFTER = COURSES = ("tangent_rad", "tangent_before_rad", "tangent_after_rad")  # options of a curve's bends
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


class Line(NamedTuple):
    """A polyline along a curve, ends included, nowhere further than 1 cm from it."""

    xy: FloatArray  # [N, 2] m
    course_rad: FloatArray | None = None  # [N] of the curve there; None: what is drawn is the polyline itself

    def courses_at(self, bend: int) -> dict[str, float]:
        """Options of a bend: the course of the curve there, and at the line's ends of the bends beside them."""
        if self.course_rad is None:
            return {}
        at = {TANGENT: bend, BEFORE: 0 if bend == 1 else -1, AFTER: bend + 1 if bend == len(self.xy) - 2 else -1}
        return {name: float(self.course_rad[k]) for name, k in at.items() if k >= 0}

    @property
    def back(self) -> "Line":
        """The same in the other direction."""
        return Line(self.xy[::-1], None if self.course_rad is None else wrapped(self.course_rad[::-1] + np.pi))


def flattened(degree: int, knots: Sequence[float], points: FloatArray, weights: FloatArray | None = None) -> Line:
    """The line along a NURBS without fault (`fault_of_curve`) of control points [P, 2] m; weights [P] above 0 are alike by default."""
    if degree == 1:
        return Line(points[corners_of(points, SPARE * TOLERANCE_M)])
    span = points[1:] - points[:-1]
    length_m = float(np.hypot(span[:, 0], span[:, 1]).sum())
    samples = 1 << max(3, math.ceil(math.log2(max(min(length_m / SAMPLE_M, MAX_SAMPLES), 1.0))))
    basis = _basis(degree, tuple(knots), len(points), samples)
    if weights is None:
        fine = basis @ points
    else:
        shares = basis * weights
        fine = (shares @ points) / shares.sum(1, keepdims=True)
    corners = corners_of(fine, SPARE * TOLERANCE_M)
    weighted = np.column_stack([points, np.ones(len(points))]) * (np.ones(len(points)) if weights is None else weights)[:, None]
    return Line(fine[corners], _courses(degree, knots, weighted, fine)[corners])


def _courses(degree: int, knots: Sequence[float], weighted: FloatArray, fine: FloatArray) -> FloatArray:
    """[S] directions of a NURBS at samples of it, by its derivative; where that is 0, by the samples beside it."""
    u, count = np.array(knots), len(weighted)
    span = (u[degree + 1 : degree + count] - u[1:count])[:, None]
    slope = np.divide(degree * np.diff(weighted, axis=0), span, out=np.zeros((count - 1, 3)), where=span > 0)
    place = _basis(degree, tuple(knots), count, len(fine) - 1) @ weighted
    change = _basis(degree - 1, tuple(knots[1:-1]), count - 1, len(fine) - 1) @ slope
    along = change[:, :2] * place[:, 2:] - place[:, :2] * change[:, 2:]
    beside = fine[np.minimum(np.arange(len(fine)) + 1, len(fine) - 1)] - fine[np.maximum(np.arange(len(fine)) - 1, 0)]
    along = np.where(np.hypot(*along.T)[:, None] > 1e-9, along, beside)
    course: FloatArray = np.arctan2(along[:, 1], along[:, 0])
    return course


def traced(nav: NavGraph, chain: Sequence[int]) -> FloatArray | None:
    """[N, 4] places along the curve that a chain of lanes was drawn as: distance along the lanes, x, y, course. None: they are drawn so."""
    parts: list[FloatArray] = []
    at_m = 0.0
    for lane in chain:
        tail, head = int(nav.tail[lane]), int(nav.head[lane])
        ends, courses = nav.xy[[tail, head]], _courses_of(nav, tail, head)
        if courses is None:
            return None
        part = bezier_between(ends, courses[0], float(wrapped(np.array(courses[1] - courses[0]))))
        part[:, 0] = at_m + part[:, 0] * float(nav.length_m[lane]) / part[-1, 0]
        at_m += float(nav.length_m[lane])
        parts.append(part if not parts else part[1:])
    places = np.concatenate(parts)
    places[:, 3] = np.unwrap(places[:, 3])
    return places


def nurbs_of(nav: NavGraph, chain: Sequence[int], xy: FloatArray) -> tuple[int, list[float], FloatArray]:
    """Degree, knots and control points [P, 2] of the line along a chain of lanes between places [V, 2]."""
    vertices = [int(nav.tail[chain[0]]), *nav.head[list(chain)].tolist()]
    courses = [_courses_of(nav, *ends) for ends in pairwise(vertices)]
    if None in courses:
        return 1, [0.0, *np.linspace(0.0, 1.0, len(vertices)).tolist(), 1.0], xy[vertices]
    turned = [float(wrapped(np.array(both[1] - both[0]))) for both in courses if both]
    pieces = [control_points(xy[list(ends)], both[0], by)[:3] for ends, both, by in zip(pairwise(vertices), courses, turned) if both]
    return 3, list(bezier_knots(3, len(pieces))), np.concatenate([*pieces, xy[vertices[-1:]]])


def _courses_of(nav: NavGraph, tail: int, head: int) -> tuple[float, float] | None:
    """Courses of a curve at the ends of one of its pieces, along the piece."""
    chord = nav.xy[head] - nav.xy[tail]
    along: list[tuple[int, float, float | None]] = []  # bend, course, course beyond it where it has another
    for bend, beside in ((tail, AFTER), (head, BEFORE)):
        options = nav.vertex_options[bend]
        if TANGENT not in options:
            continue
        own = float(options[TANGENT])
        is_back = chord @ (math.cos(own), math.sin(own)) < 0  # the lane leads against the curve as it was drawn
        other = options.get({AFTER: BEFORE, BEFORE: AFTER}[beside] if is_back else beside)
        along.append((bend, own + np.pi * is_back, None if other is None else float(other) + np.pi * is_back))
    if len(along) == 2:
        return along[0][1], along[1][1]
    for bend, own, other in along:
        if other is not None:
            return (own, other) if bend == tail else (other, own)
    return None


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
