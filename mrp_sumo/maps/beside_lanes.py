"""Lanes beside motions: how near the next one is, the next that leads their way, and the next one-way lane that they go against."""

from typing import NamedTuple

import numpy as np

from mrp_sumo.core.csr import ranges
from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph
from mrp_sumo.maps.boxes import boxes_of, overlapping
from mrp_sumo.maps.clearance import point_distances

AGAINST = -0.3  # cosine of the angle between a motion and a lane from which the motion goes against it
SQUARE_M = 2.0  # side of the squares for which lanes are listed


class BesideLanes(NamedTuple):
    """Distances of N motions from the lanes next to them, in m; inf where none is within reach."""

    any_m: FloatArray
    along_m: FloatArray  # of those that do not lead about the opposite direction
    against_m: FloatArray  # of one-way lanes that lead about the opposite direction


def beside_lanes(
    nav: NavGraph, begin: FloatArray, end: FloatArray, within_m: float, level: IntArray | None = None, against: float = AGAINST
) -> BesideLanes:
    """Distances of straight motions [N, 2] m, from their middle, to the lanes of a map within some distance; rides in lifts are none.

    Only lanes on its level [N] are beside a motion; without levels, motions are on the plane on which these are laid out. `against` is the
    cosine of the angle to a lane from which a motion goes against it.
    """
    lanes = np.flatnonzero(~nav.is_ride)
    a, b = nav.xy[nav.tail[lanes]], nav.xy[nav.head[lanes]]
    one_way = nav.reverse[lanes] < 0
    step, middle = end - begin, (begin + end) / 2
    motion, lane = _near(middle, boxes_of(a, b, within_m))
    away_m = point_distances(middle[motion], a[lane], b[lane])
    near = away_m <= within_m + 1e-9
    if level is not None:
        near &= nav.level[nav.tail[lanes]][lane] == level[motion]
    motion, lane, away_m = motion[near], lane[near], away_m[near]
    long_m = np.hypot(*(b - a)[lane].T) * np.hypot(*step[motion].T)
    cosine = ((b - a)[lane] * step[motion]).sum(axis=1) / np.maximum(long_m, 1e-12)

    def least_m(of: "np.ndarray[tuple[int], np.dtype[np.bool_]]") -> FloatArray:
        least = np.full(len(step), np.inf)
        np.minimum.at(least, motion[of], away_m[of])
        return least

    every = np.ones(len(motion), np.bool_)
    return BesideLanes(least_m(every), least_m(cosine > -AGAINST), least_m((cosine < against) & one_way[lane]))


def _near(middle: FloatArray, boxes: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs of a place and a lane whose box is near it."""
    if not len(middle):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    square, of = np.unique(np.floor(middle / SQUARE_M).astype(np.int64), axis=0, return_inverse=True)
    i, lane = overlapping(np.concatenate([square * SQUARE_M, (square + 1) * SQUARE_M], axis=1), boxes)
    first = np.searchsorted(i, np.arange(len(square) + 1))
    count = np.diff(first)[of.ravel()]
    motion = np.repeat(np.arange(len(middle)), count)
    return motion, lane[ranges(first[:-1][of.ravel()], count)]
