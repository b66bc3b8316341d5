"""Points near each other, without the seconds and megabytes that importing a library of spatial trees takes."""

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.csr import ranges

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def pairs_within(xy: FloatArray, distance_m: float) -> IntArray:
    """[P, 2] pairs of points [N, 2] m that are at most `distance_m`, above 0, apart, the lower first, in no order.

    They are looked for in square cells of this side.
    """
    column, row = np.floor((xy - xy.min(axis=0, initial=np.inf)) / distance_m).astype(np.int64).T
    width = int(column.max(initial=0)) + 3
    key = row * width + column
    order = np.argsort(key, kind="stable")
    key = key[order]
    place = np.arange(len(key))
    here = place + 1, np.searchsorted(key, key + 1, "right")  # onward in its own cell, and the next one of the row
    above = np.searchsorted(key, key + width - 1, "left"), np.searchsorted(key, key + width + 1, "right")
    one, other = [], []
    for begin, end in (here, above):
        count = end - begin
        one.append(np.repeat(place, count))
        other.append(ranges(begin, count))
    pairs = order[np.stack([np.concatenate(one), np.concatenate(other)], axis=1)]
    apart = xy[pairs[:, 0]] - xy[pairs[:, 1]]
    near: IntArray = np.sort(pairs[(apart**2).sum(axis=1) <= distance_m**2], axis=1)
    return near


def least_distance_m(xy: FloatArray) -> float:
    """The least distance between two of the points [N, 2], inf where there are not two."""
    xy = xy[np.argsort(xy[:, 0])]
    least = np.inf  # squared
    for k in range(1, len(xy)):  # each point and the k-th after it, until even along x all are farther apart
        apart = xy[k:] - xy[:-k]
        if apart[:, 0].min() ** 2 >= least:
            break
        least = min(least, float((apart**2).sum(axis=1).min()))
    return float(np.sqrt(least))
