"""The buffers that the kernels of a constraint tree work in, made larger where they do not suffice."""

from typing import Any

import numpy as np

from mrp_sumo.search._constraints import EXPANSIONS, RULE, SEARCH_STATE, ConstraintScratch
from mrp_sumo.search._occupancy import WORD, Occupancy, empty_occupancy
from mrp_sumo.search._records import CONSTRAINT, RECORD, VISIT, Store

DELAYS = 256  # distinct states of a vertex, at first
MOST_VISITED = 1 << 24  # states of all vertices, at first


class Buffers:
    """Tables by what makes them too small; what is in the store stays, the rest is reallocated when it grows."""

    def __init__(self, num_vertices: int, num_spots: int, num_robots: int, horizon: int) -> None:
        self._num_vertices, self._num_spots, self._num_robots, self._horizon = (
            num_vertices,
            num_spots,
            num_robots,
            -(-horizon // WORD) * WORD,
        )
        self.store = Store(
            np.empty(4096, RECORD),
            np.empty(1 << 14, CONSTRAINT),
            np.empty(1 << 18, VISIT),
            np.empty(1 << 16, np.int64),
            np.empty(1 << 18, np.int32),
            np.zeros(5, np.int64),
        )
        self.generated = 0  # nodes, of all trees
        self.node_bytes = 0  # what these took when they were made
        self._states = 1 << 16
        self._members = 1 << 16
        self._visited = max(num_vertices, min(DELAYS * num_vertices, MOST_VISITED))
        self._number = np.zeros(4, np.int64)
        self._pair: Occupancy | None = None
        self._by_horizon()

    @property
    def pair(self) -> Occupancy:
        """For two robots alone; not all problems need it."""
        if self._pair is None:
            self._pair = empty_occupancy(self._num_spots, self._num_robots, self._horizon)
            self._measure()
        return self._pair

    @property
    def num_bytes(self) -> int:
        """Bytes that tables and nodes take."""
        return self._table_bytes + self.node_bytes

    def grow_store(self) -> None:
        """Twice the room in every pool that is a quarter full."""
        *pools, used = self.store
        self.store = Store._make([*(_longer(pool) if 4 * used[k] > len(pool) else pool for k, pool in enumerate(pools)), used])
        self._measure()

    def grow_scratch(self) -> None:
        """Twice the room for searches and MDDs."""
        self._states *= 2
        self._members *= 2
        self._visited *= 2
        self._make_scratch()

    def grow_horizon(self) -> None:
        """Twice as many steps."""
        self._horizon *= 2
        self._by_horizon()

    def _by_horizon(self) -> None:
        self.occupancy = empty_occupancy(self._num_spots, self._num_robots, self._horizon)
        self._pair = None
        self._make_scratch()

    def _make_scratch(self) -> None:
        num_vertices, num_spots, horizon = self._num_vertices, self._num_spots, self._horizon
        self._number[:] = [0, self._number[EXPANSIONS], 0, 0]
        reach = np.zeros(num_vertices, np.int32)
        read = reach.view()  # not a copy
        read.setflags(write=False)
        self.scratch = ConstraintScratch(
            np.zeros(num_spots, np.int32),
            np.zeros(num_spots, np.int32),
            np.empty(max(1024, self._states >> 4), RULE),
            np.zeros(horizon, np.int64),
            np.zeros(self._visited, np.int32),
            np.empty(self._states, SEARCH_STATE),
            np.full(self._states, -1, np.int32),
            np.empty(horizon + 1, np.int32),
            np.zeros(num_vertices, np.int64),
            np.zeros(num_vertices, np.int64),
            reach,
            read,
            np.zeros(4 * horizon, np.int64),
            np.empty(self._members, np.int32),
            self._number,
            np.zeros(3, np.int64),
        )
        self._measure()

    def _measure(self) -> None:
        tables = (*self.store, *self.scratch, *self.occupancy, *(self._pair or ()))
        self._table_bytes: int = sum(table.nbytes for table in tables if isinstance(table, np.ndarray))


def _longer(array: Any) -> Any:
    longer = np.empty(2 * len(array), array.dtype)
    longer[: len(array)] = array
    return longer
