"""A valid plan found beside a search that proves a bound: MAPF-LNS2 until there is one, then large neighbourhood search.

Works in slices measured in labels made, not in time, so that the same seed gives the same plans. Gives up where its
tables would be too large, and where a robot has no path within its horizon.
"""

from collections.abc import Iterator
from time import process_time

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.problem import Problem
from planners.neighbourhood._traffic import path_of
from planners.neighbourhood.refinement import Refinement, Repair, first_order, is_roomy, polishing_labels, room_bytes, task_of
from planners.world import sum_of_costs

CHANCE = 14  # purpose of the stream of chance
NEIGHBOURHOOD = 8  # robots planned again at a time while there are collisions, half of it afterwards
POLISH = 2500  # labels a robot, see `polishing_labels`, that are spent on a plan before it is an answer
AT_ONCE = 4  # neighbourhoods between looks at the work done
LABELS_AT_ONCE = 10_000
CELLS_A_LABEL = 4
MOST_BYTES = 1 << 30


class Incumbent:
    """The best valid plan so far."""

    def __init__(self, problem: Problem, table: np.ndarray, deadline_s: float) -> None:
        """`table` [R, V] is the steps to each robot's goal."""
        self.cost: int | None = None  # sum of costs in steps, None without a plan
        self.labels = 0  # work done
        self.entry = (
            _horizon(problem, table) * problem.graph.num_vertices // CELLS_A_LABEL
        )  # labels that take as long as laying out the tables
        self._deadline_s, self._first = deadline_s, 0
        labels = polishing_labels(POLISH, problem.num_robots, problem.window_steps)
        self._polish = min(labels, problem.effort) if problem.effort else labels
        self._path = np.empty((0, problem.num_robots), np.int32)
        self._refinement: Refinement | None = None
        self._progress = self._search(problem, table)

    def work(self, labels: int, enough: float) -> None:
        """Go on until so many labels have been made in all, or the plan costs at most `enough`, or the deadline (process_time).

        A call that has nothing left to try returns at once.
        """
        while self.labels < labels and process_time() < self._deadline_s and not (self.cost is not None and self.cost <= enough):
            made = next(self._progress, None)
            if made is None:
                return
            self.labels += made

    def polish(self) -> None:
        """Better the plan until as much work has been spent on that as by MAPF-LNS2; call it when there is a plan."""
        self.work(self._first + self._polish, 0.0)

    def counters(self) -> dict[str, float]:
        """For the result's statistics."""
        return {"incumbent_labels": float(self.labels)} | ({"incumbent_cost": float(self.cost)} if self.cost is not None else {})

    def paths(self) -> list[IntArray]:
        """[R] the vertex of each robot at each step; call it when there is a plan."""
        path = self._refinement.path() if self._refinement else self._path
        return list(np.ascontiguousarray(path.T, np.int64))

    def _search(self, problem: Problem, table: np.ndarray) -> Iterator[int]:
        """Labels made, again and again."""
        steps = table[np.arange(problem.num_robots), problem.start].astype(np.int64)
        horizon = _horizon(problem, table)
        task = task_of(problem, table)
        if room_bytes(task, horizon) > MOST_BYTES:
            return
        rng = np.random.default_rng([problem.seed, CHANCE])
        paths, before = Repair(task, horizon, NEIGHBOURHOOD), 0
        clear = is_roomy(task)
        for robot in first_order(task, rng):
            if not paths.plan(np.array([robot]), clear=clear):
                return
            yield paths.labels - before
            before = paths.labels
        pairs = paths.num_pairs()
        while pairs:
            pairs = paths.repair(pairs, AT_ONCE, rng)
            yield paths.labels - before
            before = paths.labels
        self._path = path_of(paths.traffic.at, paths.traffic.end)
        self.cost, self._first = sum_of_costs(self._path, task.goal), self.labels
        del paths
        self._refinement = refinement = Refinement(task, self._path, NEIGHBOURHOOD // 2, rng)
        made = 0
        while self.cost > int(steps.sum()):
            made += LABELS_AT_ONCE
            refinement.until(self._deadline_s, most_labels=made)
            self.cost = refinement.cost
            yield LABELS_AT_ONCE


def _horizon(problem: Problem, table: np.ndarray) -> int:
    """Steps to plan for: twice the longest way, and some."""
    longest = int(table[np.arange(problem.num_robots), problem.start].max(initial=0))
    return (2 * longest + 128 + problem.num_robots // 2 + 31) // 32 * 32
