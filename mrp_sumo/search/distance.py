"""Distance tables: steps from every vertex to a goal, along the lanes' directions.

One table a goal, searched backwards, built when first asked for and shared by all who plan on the graph.
"""

from collections.abc import Callable
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.graph import IntArray, NavGraph, frozen
from mrp_sumo.core.problem import Problem
from mrp_sumo.search._distance import UNREACHABLE, reversed_lanes, steps_to

__all__ = ["UNREACHABLE", "Distances", "distances"]

StepArray = NDArray[np.int32]

TABLES_AT_ONCE = 8  # made between two looks at the clock
KEPT_BYTES = 512 << 20  # tables beyond this are handed out, but not kept


class Distances:
    """The distance tables of one graph. Get the shared one by `distances(graph)`."""

    def __init__(self, first: IntArray, head: IntArray) -> None:
        self.first = first  # [V + 1] lanes that leave a vertex
        self.head = head  # [L]
        self.first_in, self.tail_in = reversed_lanes(first, head)  # [V + 1], [L] tails of the lanes that enter
        self._table: dict[int, StepArray] = {}

    def to(self, goal: int) -> StepArray:
        """[V] steps from each vertex to `goal`, `UNREACHABLE` where there is no way; read-only."""
        table = self._table.get(goal)
        return self.to_all(np.array([goal], np.int64))[0] if table is None else table

    def to_all(self, goals: IntArray, check: Callable[[], None] | None = None) -> StepArray:
        """[G, V] steps from each vertex to each goal; read-only. `check` is called before every few tables that are made, and may raise."""
        tables: StepArray = np.empty((len(goals), len(self.first) - 1), np.int32)
        queue = np.empty(len(self.first) - 1, np.int64)
        most = KEPT_BYTES // (4 * (len(self.first) - 1))
        for k, goal in enumerate(np.asarray(goals).tolist()):
            if check is not None and k % TABLES_AT_ONCE == 0:
                check()
            if goal in self._table:
                tables[k] = self._table[goal]
                continue
            table = tables[k]
            steps_to(goal, self.first_in, self.tail_in, table, queue)
            table.setflags(write=False)
            if len(self._table) < most:
                self._table[goal] = table
        tables.setflags(write=False)
        return tables


def prepare() -> None:
    """Compile or load the search, so that the first table takes no longer than the next."""
    Distances(frozen(np.array([0, 1, 1], np.int64)), frozen(np.array([1], np.int64))).to(1)


def steps_to_targets(problem: Problem, check: Callable[[], None] | None = None) -> StepArray:
    """[R, V] steps from each vertex to each robot's goal on the lanes of its type; read-only. See `Distances.to_all` for `check`."""
    target, kind = problem.target, problem.fleet.kind
    if problem.barred is None:
        return distances(problem.graph).to_all(target, check)
    table = np.empty((problem.num_robots, problem.graph.num_vertices), np.int32)
    for k in np.unique(kind).tolist():
        table[kind == k] = distances(problem.graph_of_kind[k]).to_all(target[kind == k], check)
    return frozen(table)


_shared: WeakKeyDictionary[NavGraph, Distances] = WeakKeyDictionary()


def distances(graph: NavGraph) -> Distances:
    """The tables of this graph, shared by all callers for as long as the graph lives."""
    shared = _shared.get(graph)
    if shared is None:
        shared = _shared[graph] = Distances(graph.first, graph.head)
    return shared
