"""Tables over rows and steps: every cell has its slot, or, where that would take too much memory, only cells in use have one.

Sparse tables are hashed: slots lie at the number of a cell, mixed, or behind it (Knuth, The Art of Computer Programming, volume 3,
section 6.4: linear probing, algorithm R for deletion).
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel

MOST_CELLS = 1 << 22  # of a table in which every cell has its slot


class RowOccupancy(NamedTuple):
    """How many robots there are on each row at each of T steps, over K slots."""

    key: np.ndarray  # [K] int64 number of the cell and 1, 0 of an empty slot; [0] where every cell has its slot
    num: np.ndarray  # [K] uint8
    who: np.ndarray  # [K] int32 one of them; [1] where nobody asks
    steps: int  # T


@kernel(allocates=False)
def home(key, mask):
    """Where the slot of a cell is looked for first."""
    return (((key ^ (key >> 17)) & 0x7FFFFFFF) * 0x9E3779B1 >> 20) & mask


@kernel(allocates=False)
def _found(keys, key):
    """The slot of a cell among hashed ones, -1 where it has none."""
    mask = len(keys) - 1
    k = home(key, mask)
    while keys[k] != 0:
        if keys[k] == key + 1:
            return k
        k = (k + 1) & mask
    return np.int64(-1)


@kernel(allocates=False)
def _made(keys, num, key):
    """The slot of a cell among hashed ones, made where it has none."""
    mask = len(keys) - 1
    k = home(key, mask)
    while keys[k] != 0 and keys[k] != key + 1:
        k = (k + 1) & mask
    if keys[k] == 0:
        keys[k] = key + 1
        num[k] = 0
    return k


@kernel(allocates=False)
def _emptied(keys, num, who, k):
    """Empty a slot, and move up those behind it that would not be found any more."""
    mask = len(keys) - 1
    behind = (k + 1) & mask
    while keys[behind] != 0:
        if (behind - home(keys[behind] - 1, mask)) & mask >= (behind - k) & mask:
            keys[k], num[k] = keys[behind], num[behind]
            if len(who) > 1:
                who[k] = who[behind]
            k = behind
        behind = (behind + 1) & mask
    keys[k] = 0


@kernel(inline="always")
def slot_of(cells, row, t):
    """The slot of a cell, -1 where nobody is."""
    key = np.int64(row) * cells.steps + t
    return key if len(cells.key) == 0 else _found(cells.key, key)


@kernel(inline="always")
def num_in(cells, row, t):
    """How many robots there are in a cell."""
    k = slot_of(cells, row, t)
    return np.int64(cells.num[k]) if k >= 0 else np.int64(0)


@kernel(inline="always")
def anyone_in(cells, row, t):
    """One of the robots in a cell, -1 where there is none."""
    k = slot_of(cells, row, t)
    return np.int64(cells.who[k]) if k >= 0 and cells.num[k] > 0 else np.int64(-1)


@kernel(inline="always")
def enter(cells, row, t):
    """One robot more in a cell; its slot."""
    key = np.int64(row) * cells.steps + t
    k = key if len(cells.key) == 0 else _made(cells.key, cells.num, key)
    cells.num[k] += 1
    return k


@kernel(inline="always")
def leave(cells, row, t):
    """One robot fewer in a cell; how many are left."""
    k = slot_of(cells, row, t)
    cells.num[k] -= 1
    left = np.int64(cells.num[k])
    if left == 0 and len(cells.key) > 0:
        _emptied(cells.key, cells.num, cells.who, k)
    return left


def cells_of(num_rows: int, num_steps: int, most: int, *, with_who: bool) -> RowOccupancy:
    """Empty cells, of which at most so many are in use at a time."""
    sparse = is_sparse(num_rows, num_steps)
    num_slots = slots_for(most) if sparse else num_rows * num_steps
    key = np.zeros(num_slots if sparse else 0, np.int64)
    return RowOccupancy(key, np.zeros(num_slots, np.uint8), np.zeros(num_slots if with_who else 1, np.int32), num_steps)


def is_sparse(num_rows: int, num_steps: int) -> bool:
    """Whether only cells in use have a slot."""
    return num_rows * num_steps > MOST_CELLS


def slots_for(most: int) -> int:
    """A power of two, of which so many are at most two thirds."""
    return 1 << max(4, int(np.ceil(np.log2(1.5 * most))))
