"""Prioritised planning: robots in an order, each by SIPP around those before it. Guarantee: valid, not complete.

Source: Erdmann, Lozano-Pérez, "On multiple moving objects", Algorithmica 1987; Silver, "Cooperative pathfinding",
AIIDE 2005; random restarts after Bennewitz, Burgard, Thrun, "Finding and optimizing solvable priority schemes", 2002.
The low level is SIPP (Phillips, Likhachev, ICRA 2011).
"""

from dataclasses import dataclass
from time import perf_counter
from typing import Any, ClassVar

import numpy as np

from mrp_sumo.core.graph import IntArray, frozen
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import impossible, require_limit
from mrp_sumo.search.distance import distances

ORDERS = 3  # purpose of the stream of chance


@dataclass(frozen=True)
class Prioritised:
    """Prioritised planning by SIPP, with random restarts.

    The first order is longest path first; after a failure the robot that failed goes first, and every fourth order is random.
    """

    restarts: int = 1000  # further orders of the robots to try
    following: bool = False  # avoid following conflicts too: nobody enters a vertex in the step its holder leaves

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "valid, not complete"

    def __post_init__(self) -> None:
        if self.restarts < 0:
            raise PlanError(f"restarts is {self.restarts}, expected 0 or more")

    def prepare(self) -> None:
        """See `Planner`."""
        from mrp_sumo.search._sipp import find_path, new_intervals, reserve, reset

        intervals, scratch = new_intervals(2, 16)
        reset(2, intervals)
        path = np.zeros(8, np.int64)
        lanes, distance = (frozen(np.array([0, 1, 1])), frozen(np.array([1]))), frozen(np.array([1, 0], np.int32))
        find_path(*lanes, distance, np.int64(0), np.int64(1), self.following, intervals, scratch, path)
        reserve(intervals, path, 2)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`. GAVE_UP when all restarts are used up."""
        from mrp_sumo.search._sipp import FOUND, FULL, find_path, new_intervals, reserve, reset

        require_limit(time_limit_s)
        began = perf_counter()
        if refusal := impossible(problem):
            return refusal
        tables = distances(problem.graph)
        num_vertices, num_robots = problem.graph.num_vertices, problem.num_robots
        table = tables.to_all(problem.target)
        alone = table[np.arange(num_robots), problem.start]
        target = problem.target
        chance = np.random.default_rng([problem.seed, ORDERS])
        order = np.argsort(-alone, kind="stable")
        room = 4 * (num_vertices + int(alone.sum()) + 64)
        intervals, scratch = new_intervals(num_vertices, room)
        path = np.empty(2 * num_vertices + int(alone.max(initial=0)) + 64, np.int64)
        stats = {"orders": 0.0, "lower_bound_steps": float(alone.sum())}
        status = Status.GAVE_UP
        for attempt in range(self.restarts + 1):
            stats["orders"] = attempt + 1.0
            reset(num_vertices, intervals)
            paths: dict[int, IntArray] = {}
            for robot in order.tolist():
                code, length = find_path(
                    tables.first, tables.head, table[robot], problem.start[robot], target[robot], self.following, intervals, scratch, path
                )
                while code == FULL or (code == FOUND and not reserve(intervals, path, length)):
                    intervals, scratch, path = _doubled(intervals, scratch, path)
                    code, length = find_path(
                        tables.first,
                        tables.head,
                        table[robot],
                        problem.start[robot],
                        target[robot],
                        self.following,
                        intervals,
                        scratch,
                        path,
                    )
                if code != FOUND:
                    break
                paths[robot] = path[:length].copy()
                if perf_counter() - began > time_limit_s:
                    break
            if len(paths) == num_robots:
                return PlanResult(
                    Status.SOLVED,
                    plan=plan_of_paths([paths[r] for r in range(num_robots)], problem.step_s),
                    planning_time_s=perf_counter() - began,
                    lower_bound_steps=float(alone.sum()),
                    stats=stats,
                )
            if perf_counter() - began > time_limit_s:
                status = Status.TIMED_OUT
                break
            failed_first = np.concatenate(([robot], order[order != robot]))
            order = chance.permutation(num_robots) if attempt % 4 == 3 else failed_first
        return PlanResult(
            status,
            planning_time_s=perf_counter() - began,
            lower_bound_steps=float(alone.sum()),
            stats=stats,
            message=f"none of {int(stats['orders'])} orders of the robots gave a plan",
        )


def _doubled(intervals: Any, scratch: Any, path: IntArray) -> Any:
    """Twice the length, with the same intervals in use."""
    longer = [type(group)(*(_longer(a) if len(a) > 1 else a for a in group)) for group in (intervals, scratch)]
    return longer[0], longer[1], _longer(path)


def _longer(array: Any) -> Any:
    return np.concatenate([array, np.zeros_like(array)])
