"""How far robots drove off the lanes of their map and against its one-ways, told from where they were.

Knows the trajectory and the lanes as drawn; nothing of plans, planners and policies.
"""

from collections.abc import Iterator

import numpy as np

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph, PlanGraph
from mrp_sumo.maps.boxes import overlapping
from mrp_sumo.maps.clearance import point_distances

ON_LANE_M = 0.3  # from the middle of a lane within which a robot is on it
AGAINST = -0.3  # cosine of the angle between a motion and a lane from which the motion goes against it
NOISE_M = 1e-3  # by which another lane has to be nearer
SAMPLES = 200_000  # looked at together
SQUARE_M = 2.0  # side of the squares for which lanes are listed


def on_lane_m(track_apart_m: float) -> float:
    """How far from a lane robots are on it whose two tracks are so far apart."""
    return max(ON_LANE_M, track_apart_m / 2 + NOISE_M)


def lane_keeping(execution: Execution, nav: NavGraph, on_lane_m: float = ON_LANE_M) -> dict[str, float] | None:
    """Metres off lanes, and against one-ways; None for a map that has no lanes, or none that are driven on.

    Between samples robots are taken to move straight; each such motion counts where its middle is. It goes against a one-way that
    leads about the opposite way, where no lane is as near that leads about its own.

    Parameters
    ----------
    execution
        T samples of R robots.
    nav
        The map's lanes as drawn. Those through lifts do not count, nor do rides.
    on_lane_m
        How far from all lanes robots are off them.

    Returns
    -------
    dict
        `driven_m`, `off_m` and `against_one_way_m`, of all robots together.
    """
    lanes = np.flatnonzero(~nav.is_ride)
    if isinstance(nav, PlanGraph) or not len(lanes):
        return None
    a, b = nav.xy[nav.tail[lanes]], nav.xy[nav.head[lanes]]
    one_way = nav.reverse[lanes] < 0
    boxes = np.concatenate([np.minimum(a, b) - on_lane_m, np.maximum(a, b) + on_lane_m], axis=1)
    driven_m = off_m = against_m = 0.0
    for begin, end in _motions(execution):
        step = end - begin
        long_m, middle = np.hypot(*step.T), (begin + end) / 2
        motion, lane = _near(middle, boxes)
        away_m = point_distances(middle[motion], a[lane], b[lane])
        near = away_m <= on_lane_m + 1e-9
        motion, lane, away_m = motion[near], lane[near], away_m[near]
        along = ((b - a)[lane] * step[motion]).sum(axis=1) / np.maximum(np.hypot(*(b - a)[lane].T) * long_m[motion], 1e-12)
        on, with_m, opposite_m = np.zeros(len(step), np.bool_), np.full(len(step), np.inf), np.full(len(step), np.inf)
        on[motion] = True
        np.minimum.at(with_m, motion[along > -AGAINST], away_m[along > -AGAINST])
        opposite = (along < AGAINST) & one_way[lane]
        np.minimum.at(opposite_m, motion[opposite], away_m[opposite])
        driven_m += float(long_m.sum())
        off_m += float(long_m[~on].sum())
        against_m += float(long_m[opposite_m < with_m - NOISE_M].sum())
    return {"driven_m": round(driven_m, 3), "off_m": round(off_m, 3), "against_one_way_m": round(against_m, 3)}


def _motions(execution: Execution) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Where motions between samples begin and end, [N, 2] each; of those that go anywhere, on one level."""
    num_samples, num_robots = execution.x_m.shape
    rows = max(SAMPLES // max(num_robots, 1), 1)
    for first in range(0, num_samples - 1, rows):
        last = min(first + rows, num_samples - 1) + 1
        xy = np.stack([execution.x_m[first:last], execution.y_m[first:last]], axis=2).astype(np.float64)
        goes = (xy[1:] != xy[:-1]).any(axis=2) & np.isfinite(xy[1:] - xy[:-1]).all(axis=2)
        if execution.level is not None:
            level = execution.level[first:last]
            goes &= level[1:] == level[:-1]
        yield xy[:-1][goes], xy[1:][goes]


def _near(middle: FloatArray, boxes: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs of a place and a lane whose box is near it."""
    if not len(middle):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    square, of = np.unique(np.floor(middle / SQUARE_M).astype(np.int64), axis=0, return_inverse=True)
    i, lane = overlapping(np.concatenate([square * SQUARE_M, (square + 1) * SQUARE_M], axis=1), boxes)
    first = np.searchsorted(i, np.arange(len(square) + 1))
    count = np.diff(first)[of.ravel()]
    motion = np.repeat(np.arange(len(middle)), count)
    at = np.repeat(first[:-1][of.ravel()], count) + np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return motion, lane[at]
