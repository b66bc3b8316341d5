"""Large neighbourhood search over the paths of a problem, driven by the clock or by the work done."""

from time import perf_counter

import numpy as np

from mrp_sumo.core.problem import Problem
from planners import _lns
from planners._lns import Task
from planners._world import SLICE_S

SPARE_STEPS = 8  # room beyond the longest path
FOREVER = 1 << 62
MOST_AT_ONCE = 1 << 20  # neighbourhoods until the clock is read


def task_of(problem: Problem, table: np.ndarray) -> Task:
    """The problem as arrays; `table` [R, V] is the steps to each robot's goal."""
    graph = problem.graph
    return Task(graph.first, graph.head, graph.reverse, np.array(problem.start), np.array(problem.target), table)


def polishing_labels(a_robot: int, num_robots: int) -> int:
    """How many labels may be made: so many a robot for 100 robots or fewer, more in proportion to the root of their number.

    The work is bounded by labels and not by time so that the same seed gives the same plan.
    """
    return int(a_robot * num_robots * max(1.0, num_robots / 100) ** 0.5)


class Refinement:
    """Paths without collisions that get shorter."""

    def __init__(self, task: Task, path: np.ndarray, size: int, rng: np.random.Generator) -> None:
        """`path` is [T, R], everybody at the goal in the last row; `size` robots are planned again at a time."""
        self._task, self._size, self._rng = task, size, rng
        self._traffic, self._labels, self._hood = _lns.traffic_of(task, path, size, SPARE_STEPS)
        self._at_once = 1
        self._least = int(task.steps[np.arange(len(task.goal)), task.start].sum())

    @property
    def cost(self) -> int:
        """Sum of costs in steps."""
        return int(self._traffic.end.sum())

    def until(self, deadline_s: float, *, most_labels: int = FOREVER) -> None:
        """Go on until the deadline (perf_counter), until so many labels have been made since the beginning, or nothing is left to gain."""
        while self.cost > self._least and self._labels.stamp[1] < most_labels and (slice_s := perf_counter()) < deadline_s:
            _lns.improve(self._task, self._traffic, self._labels, self._hood, self._size, self._at_once, most_labels, self._rng)
            pace = SLICE_S / max(perf_counter() - slice_s, 1e-6)
            self._at_once = max(1, min(MOST_AT_ONCE, int(self._at_once * min(pace, 2.0))))

    def path(self) -> np.ndarray:
        """[T, R], up to the last arrival."""
        return self._traffic.at[: int(self._traffic.end.max()) + 1].copy()
