"""What constraint trees keep of each robot: its constraints and the path found under them.

A *record* is one robot's set of constraints and its path. Records form chains: a record adds rows to those of
its parent. Room is fixed; appending reports when it does not suffice.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.core.clashes import Clashes
from mrp_sumo.search._kernel import kernel

FOREVER = 1 << 30
OK, NO_PATH, STORE_FULL, SCRATCH_FULL, TOO_LATE, OUT_OF_BUDGET = 0, 1, 2, 3, 4, 5  # what searches return

# columns of Store.meta
PARENT, ROW0, ROW1, ORIGIN, PATH0, COST, BOUND, MDD0, ROBOT = 0, 1, 2, 3, 4, 5, 6, 7, 8
# kinds of rows: (kind, vertex, tail, from step, to step)
RANGE, EDGE, MIN_COST, MAX_COST, MUST = 0, 1, 2, 3, 4
# entries of Store.used
RECORDS, ROWS, PATH, LEVELS, MEMBERS = 0, 1, 2, 3, 4


class SearchInstance(NamedTuple):
    """What does not change: V vertices, L lanes, R robots, G goals."""

    first: np.ndarray  # [V + 1] int64, lanes that leave a vertex
    head: np.ndarray  # [L] int64
    first_in: np.ndarray  # [V + 1] int64, lanes that enter a vertex
    tail_in: np.ndarray  # [L] int64
    distance: np.ndarray  # [G, V] int32 steps to each goal
    row: np.ndarray  # [R] int64, the row of `distance` of each robot
    start: np.ndarray  # [R] int64
    goal: np.ndarray  # [R] int64
    column: np.ndarray  # [V] int64 cell coordinates on a 4-connected grid; empty on other graphs
    line: np.ndarray  # [V] int64
    following: bool  # whether following conflicts count
    tail: np.ndarray  # [L] int64
    clashes: Clashes


class Store(NamedTuple):
    """Records and their pools; only ever appended to (or cut off at the end)."""

    meta: np.ndarray  # [N, 9] int64
    rows: np.ndarray  # [C, 5] int32 constraints
    path: np.ndarray  # [P] int32 vertices by step
    level: np.ndarray  # [M] int64, where each level of an MDD begins in `member`
    member: np.ndarray  # [Q] int32 vertices
    used: np.ndarray  # [5] int64


@kernel(allocates=False)
def place(store, record, step):
    """The vertex of a record's robot at a step."""
    return np.int64(store.path[store.meta[record, PATH0] + min(step, store.meta[record, COST])])


@kernel
def add_row(store, kind, vertex, tail, from_step, to_step):
    """Append a constraint; False when there is no room."""
    k = store.used[ROWS]
    if k >= len(store.rows):
        return False
    store.rows[k, 0] = kind
    store.rows[k, 1] = vertex
    store.rows[k, 2] = tail
    store.rows[k, 3] = from_step
    store.rows[k, 4] = to_step
    store.used[ROWS] = k + 1
    return True


@kernel
def add_record(store, parent, robot, row0, row1):
    """Append a record without path; -1 when there is no room."""
    k = store.used[RECORDS]
    if k >= len(store.meta):
        return -1
    store.used[RECORDS] = k + 1
    meta = store.meta[k]
    meta[PARENT], meta[ROW0], meta[ROW1], meta[ORIGIN] = parent, row0, row1, k
    meta[PATH0], meta[COST], meta[BOUND], meta[MDD0], meta[ROBOT] = 0, 0, 0, -1, robot
    return k
