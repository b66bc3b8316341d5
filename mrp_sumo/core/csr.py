"""Rows that are stored end to end (CSR)."""

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]


def ranges(start: IntArray | int, count: IntArray) -> IntArray:
    """Numbers start[0], start[0] + 1, ... count[0] of them, then those of start[1], ...; of one start for all rows, from it in each."""
    numbers: IntArray = np.arange(int(count.sum())) + np.repeat(start - np.cumsum(count) + count, count)
    return numbers
