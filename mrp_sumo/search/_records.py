"""Records that constraint trees keep of each robot: its constraints and the path found under them.

A *record* is one robot's set of constraints and its path. Records form chains: a record adds rows to those of
its parent. Room is fixed; appending reports when it does not suffice.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.core.clashes import Clashes, Spots
from mrp_sumo.search._kernel import kernel

FOREVER = 1 << 30
OK, NO_PATH, STORE_FULL, SCRATCH_FULL, TOO_LATE, OUT_OF_BUDGET = 0, 1, 2, 3, 4, 5  # what searches return

RANGE, EDGE, MIN_COST, MUST = 0, 1, 2, 3  # kinds of constraints
CONSTRAINT = np.dtype((np.record, [(name, np.int32) for name in ("kind", "spot", "tail", "begin", "end")]))  # steps, both included
VISIT = np.dtype((np.record, [(name, np.int32) for name in ("vertex", "spot")]))
# parent: the record before in its chain, -1 for none; row0, row1: the constraints that it adds; origin: the first record with the same
# constraints; path0, cost: its path; bound: on its cost; mdd0: where the levels of its MDD begin, -1: not built yet
RECORD = np.dtype(
    (np.record, [(name, np.int64) for name in ("parent", "row0", "row1", "origin", "path0", "cost", "bound", "mdd0", "robot")])
)
# entries of Store.used
RECORDS, ROWS, PATH, LEVELS, MEMBERS = 0, 1, 2, 3, 4


class SearchInstance(NamedTuple):
    """Search instance, which does not change: V vertices, L lanes, R robots."""

    first: np.ndarray  # [V + 1] int64, lanes that leave a vertex
    head: np.ndarray  # [L] int64
    first_in: np.ndarray  # [V + 1] int64, lanes that enter a vertex
    tail_in: np.ndarray  # [L] int64
    distance: np.ndarray  # [R, V] int32 steps to each robot's goal
    start: np.ndarray  # [R] int64
    goal: np.ndarray  # [R] int64
    column: np.ndarray  # [V] int64 cell coordinates on a 4-connected grid; empty on other graphs
    line: np.ndarray  # [V] int64
    following: bool  # whether following conflicts count
    clashes: Clashes  # between spots
    spots: Spots


class Store(NamedTuple):
    """Records and their pools; only ever appended to (or cut off at the end)."""

    meta: np.ndarray  # [N] RECORD
    rows: np.ndarray  # [C] CONSTRAINT
    path: np.ndarray  # [P] VISIT by step
    level: np.ndarray  # [M] int64, where each level of an MDD begins in `member`
    member: np.ndarray  # [Q] int32 vertices
    used: np.ndarray  # [5] int64


@kernel
def spot_at(store, record, step):
    """The spot of a record's robot at a step."""
    return np.int64(store.path[store.meta[record].path0 + min(step, store.meta[record].cost)].spot)


@kernel
def add_row(store, kind, spot, tail, from_step, to_step):
    """Append a constraint; False when there is no room."""
    k = store.used[ROWS]
    if k >= len(store.rows):
        return False
    store.rows[k].kind = kind
    store.rows[k].spot = spot
    store.rows[k].tail = tail
    store.rows[k].begin = from_step
    store.rows[k].end = to_step
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
    meta.parent, meta.row0, meta.row1, meta.origin = parent, row0, row1, k
    meta.path0, meta.cost, meta.bound, meta.mdd0, meta.robot = 0, 0, 0, -1, robot
    return k
