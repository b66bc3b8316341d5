"""Pairs of boxes that overlap: the broad phase of every geometric check, in time about linear in the number of boxes."""

import numpy as np

from mrp_sumo.core.csr import ranges
from mrp_sumo.core.graph import FloatArray, IntArray

CELLS_PER_BOX = 8  # how finely boxes are rasterised, on average at most


def overlapping(a: FloatArray, b: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs (i, j), ascending, of a box of a [N, 4] and a box of b [M, 4] that overlap or touch: x low, y low, x high, y high."""
    empty = np.zeros(0, np.int64)
    if not len(a) or not len(b):
        return empty, empty
    low = np.minimum(a[:, :2].min(axis=0), b[:, :2].min(axis=0))
    span = np.maximum(np.maximum(a[:, 2:].max(axis=0), b[:, 2:].max(axis=0)) - low, 1e-9)
    cell = max(float(np.sqrt(span[0] * span[1] / (len(a) + len(b)))), float(span.max()) / 30_000)
    while True:  # coarser until boxes cover few cells
        sizes = [_spans(boxes, low, cell) for boxes in (a, b)]
        if sum(int((s[1] * s[3]).sum()) for s in sizes) <= CELLS_PER_BOX * (len(a) + len(b)):
            break
        cell *= 1.5
        if cell > 2 * span.max():
            break
    columns = int(span[0] / cell) + 2
    keys_a, owner_a = _cells(sizes[0], columns)
    keys_b, owner_b = _cells(sizes[1], columns)
    order = np.argsort(keys_b, kind="stable")
    keys_b, owner_b = keys_b[order], owner_b[order]
    first, last = np.searchsorted(keys_b, keys_a, "left"), np.searchsorted(keys_b, keys_a, "right")
    i, j = np.repeat(owner_a, last - first), owner_b[ranges(first, last - first)]
    hit = (a[i, 0] <= b[j, 2]) & (b[j, 0] <= a[i, 2]) & (a[i, 1] <= b[j, 3]) & (b[j, 1] <= a[i, 3])
    pair = np.unique(i[hit] * np.int64(len(b)) + j[hit])  # boxes that meet in several cells count once
    return pair // len(b), pair % len(b)


def boxes_of(a: FloatArray, b: FloatArray, margin: float = 0.0) -> FloatArray:
    """[N, 4] boxes around segments from a to b [N, 2], and a margin."""
    return np.concatenate([np.minimum(a, b) - margin, np.maximum(a, b) + margin], axis=1)


def _spans(boxes: FloatArray, low: FloatArray, cell: float) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """First column, columns, first row, rows that each box covers."""
    at = np.floor((boxes - np.tile(low, 2)) / cell).astype(np.int64)
    return at[:, 0], at[:, 2] - at[:, 0] + 1, at[:, 1], at[:, 3] - at[:, 1] + 1


def _cells(spans: tuple[IntArray, IntArray, IntArray, IntArray], columns: int) -> tuple[IntArray, IntArray]:
    """Every (cell, box) that meet, as two arrays."""
    x, width, y, height = spans
    count = width * height
    owner = np.repeat(np.arange(len(x)), count)
    k = ranges(0, count)
    return (y[owner] + k // width[owner]) * columns + x[owner] + k % width[owner], owner
