"""The paths planned so far, and the earliest path of one robot more around them (SIPP)."""

import numpy as np

from mrp_sumo.core.clashes import no_clashes
from mrp_sumo.core.graph import IntArray, frozen
from mrp_sumo.core.problem import Problem
from mrp_sumo.search._records import OK, SCRATCH_FULL
from mrp_sumo.search._sipp import FOREVER, UnitLanes, find_path, new_intervals, reserve, reset, with_double_room
from mrp_sumo.search.distance import steps_to_targets
from mrp_sumo.traffic.clashes import clashes_of


class Reservations:
    """Safe intervals of a problem's graph; the buffers grow where they do not suffice."""

    def __init__(self, problem: Problem, *, following: bool) -> None:
        """`following` is whether a vertex must be free for a step before it is entered."""
        self._window = problem.window_steps
        self._table, self._start, self._goal = steps_to_targets(problem), problem.start, problem.target
        self._lanes = UnitLanes(problem.graph.first, problem.graph.head, clashes_of(problem), following)
        self._num_vertices = problem.graph.num_vertices
        self.least = self._table[np.arange(problem.num_robots), problem.start]  # [R] steps of each robot's shortest path
        room = 4 * (self._num_vertices + int(self.least.sum()) + 64)
        self._intervals, self._scratch = new_intervals(self._num_vertices, problem.graph.num_lanes, room, self._lanes.clashes)
        self._path = np.empty(2 * self._num_vertices + int(self.least.max(initial=0)) + 64, np.int64)
        self.labels = 0  # of all searches, each counted as one for each vertex

    def clear(self) -> None:
        """Drop all paths."""
        reset(self._num_vertices, self._intervals)

    def plan(self, robot: int) -> IntArray | None:
        """[T] the robot's earliest path around those reserved, in a window as far as that goes; None where there is none.

        It is reserved itself from now on, in a window until that ends.
        """
        self.labels += self._num_vertices
        while True:
            ends = self._start[robot], self._goal[robot]
            code, length = find_path(self._lanes, self._table[robot], *ends, self._intervals, self._scratch, self._path)
            kept = min(length, self._window + 1) if self._window else length
            until = self._window or FOREVER
            if code == OK and reserve(self._lanes, self._intervals, self._path, kept, until):
                return self._path[:kept].copy()
            if code not in (OK, SCRATCH_FULL):
                return None
            self._grow()

    def _grow(self) -> None:
        """Twice the room, with the same intervals in use."""
        self._intervals, self._scratch = with_double_room(self._intervals, self._scratch)
        self._path = np.empty(2 * len(self._path), np.int64)


def prepare(*, following: bool) -> None:
    """Compile or load the kernels."""
    clashes = no_clashes(2, 1, rotations=True)
    intervals, scratch = new_intervals(2, 1, 16, clashes)
    reset(2, intervals)
    path = np.zeros(8, np.int64)
    lanes, distance = UnitLanes(frozen(np.array([0, 1, 1])), frozen(np.array([1])), clashes, following), frozen(np.array([1, 0], np.int32))
    find_path(lanes, distance, np.int64(0), np.int64(1), intervals, scratch, path)
    reserve(lanes, intervals, path, 2, np.int64(FOREVER))
