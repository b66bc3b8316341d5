"""Distances that robots drove off the lanes of their map and against its one-ways, by where they were.

Knows the trajectory and the lanes as drawn; nothing of plans, planners and policies.
"""

from collections.abc import Iterator

import numpy as np

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import FloatArray, NavGraph, PlanGraph
from mrp_sumo.maps.beside_lanes import beside_lanes

ON_LANE_M = 0.3  # from the middle of a lane within which a robot is on it
OPPOSITE = -0.7  # cosine of the angle to a lane from which a robot goes against it: one that merely crosses it does not
NOISE_M = 1e-3  # by which another lane has to be nearer
SAMPLES = 200_000  # looked at together


def on_lane_m(track_apart_m: float) -> float:
    """Distance from a lane within which robots are on it, where its two tracks are so far apart."""
    return max(ON_LANE_M, track_apart_m / 2 + NOISE_M)


def lane_keeping(execution: Execution, nav: NavGraph, on_lane_m: float = ON_LANE_M) -> dict[str, float] | None:
    """Metres that all robots drove (`driven_m`), off the lanes of a map (`off_m`), and against its one-ways (`against_one_way_m`).

    None for a map that has no lanes, or none that are driven on; those through lifts do not count, nor do rides. Between samples robots
    are taken to move straight; each such motion counts where its middle is: off where all lanes are farther than `on_lane_m`, against a
    one-way that leads the opposite way within 45 degrees, where no lane is as near that leads about its own.
    """
    if isinstance(nav, PlanGraph) or nav.is_ride.all():
        return None
    driven_m = off_m = against_m = 0.0
    for begin, end in _motions(execution):
        long_m, lanes = np.hypot(*(end - begin).T), beside_lanes(nav, begin, end, on_lane_m, against=OPPOSITE)
        driven_m += float(long_m.sum())
        off_m += float(long_m[np.isinf(lanes.any_m)].sum())
        against_m += float(long_m[lanes.against_m < lanes.along_m - NOISE_M].sum())
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
