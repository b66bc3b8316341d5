"""Names beside points on a page so that none overlaps another: greedy, in the order given, the best of sixteen places each.

A name that finds no place is left out: a few names that can be read say more than many on top of each other.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DIRECTIONS = np.array([(1, 0.35), (-1, 0.35), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)], np.float64)


def place_labels(anchor: Array, size: Array, lane: Array, wall: Array, page: Array, gap: float) -> Array:
    """[N, 2] the lower left of each label in a length such as points, NaN where there is no good place.

    `anchor` [N, 2] are the points that have names, the most important first, `size` [N, 2] those of labels, which stay on the `page`
    [2, 2] and a `gap` away from their points. A label should not cover strokes [S, 2, 2]: three lanes weigh more than any number of walls.
    """
    corner = np.full((len(anchor), 2), np.nan)
    reach = np.concatenate([DIRECTIONS, 2 * DIRECTIONS])
    placed_low, placed_high = np.zeros((0, 2)), np.zeros((0, 2))
    lane_box, wall_box = ((line.min(1), line.max(1)) for line in (lane, wall))
    for i, (point, extent) in enumerate(zip(anchor, size)):
        # whatever the direction, the label's near side is the gap away from the point
        low = point + reach * gap + (np.sign(np.round(reach)) - 1) / 2 * extent
        low[np.round(reach[:, 0]) == 0, 0] = point[0] - extent[0] / 2
        low[np.abs(reach[:, 1]) < 0.8, 1] = point[1] - extent[1] / 2
        high = low + extent
        cost = np.arange(len(reach)) * 0.02 + (np.arange(len(reach)) >= len(DIRECTIONS)) * 1.2
        cost = cost + 10.0 * ((low < page[0]) | (high > page[1])).any(1)
        cost += 10.0 * _overlap(low, high, placed_low, placed_high)
        cost += 1.5 * _overlap(low - 1, high + 1, anchor, anchor)
        cost += 0.5 * _covered(low, high, lane, *lane_box) + np.minimum(0.6 * _covered(low, high, wall, *wall_box), 1.2)
        best = int(np.argmin(cost))
        if cost[best] < 3:
            corner[i] = low[best]
            placed_low = np.vstack([placed_low, low[best]])
            placed_high = np.vstack([placed_high, high[best]])
    return corner


def _overlap(low: Array, high: Array, other_low: Array, other_high: Array) -> Array:
    """[C] how many of the other boxes each box overlaps."""
    (left, bottom), (right, top) = low.T[:, :, None], high.T[:, :, None]
    meets = (left < other_high[:, 0]) & (right > other_low[:, 0]) & (bottom < other_high[:, 1]) & (top > other_low[:, 1])
    count: Array = meets.sum(1).astype(np.float64)
    return count


def _covered(low: Array, high: Array, line: Array, line_low: Array, line_high: Array) -> Array:
    """[C] how many strokes each box crosses, given the strokes' own boxes (clipping after Liang and Barsky)."""
    (left, bottom), (right, top) = low.min(0), high.max(0)
    near = (line_low[:, 0] < right) & (line_low[:, 1] < top) & (line_high[:, 0] > left) & (line_high[:, 1] > bottom)
    if not near.any():
        return np.zeros(len(low))
    start, step = line[near, 0], line[near, 1] - line[near, 0]
    step = np.where(np.abs(step) < 1e-12, 1e-12, step)
    t0, t1 = (low[:, None] - start) / step, (high[:, None] - start) / step
    first, last = np.minimum(t0, t1), np.maximum(t0, t1)
    enter, leave = np.maximum(first[..., 0], first[..., 1]), np.minimum(last[..., 0], last[..., 1])
    count: Array = (np.maximum(enter, 0) < np.minimum(leave, 1)).sum(1).astype(np.float64)
    return count
