"""Prioritised planning: robots in an order, each by SIPP around those before it. Guarantee: valid, not complete.

Source: Erdmann, Lozano-Pérez, "On multiple moving objects", Algorithmica 1987; Silver, "Cooperative pathfinding",
AIIDE 2005; random restarts after Bennewitz, Burgard, Thrun, "Finding and optimizing solvable priority schemes", 2002.
The low level is SIPP (Phillips, Likhachev, ICRA 2011).
"""

from dataclasses import dataclass
from time import process_time
from typing import ClassVar

import numpy as np

from mrp_sumo.core.clashes import no_clashes
from mrp_sumo.core.graph import IntArray, frozen
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import deadline_of, impossible, used_up, without_effort
from mrp_sumo.search._records import OK, SCRATCH_FULL
from mrp_sumo.search._sipp import FOREVER, UnitLanes, find_path, new_intervals, reserve, reset, with_double_room
from mrp_sumo.search.distance import steps_to_targets
from mrp_sumo.traffic.clashes import clashes_of

ORDERS = 3  # purpose of the stream of chance


@dataclass(frozen=True)
class Prioritised:
    """Prioritised planning by SIPP, with random restarts.

    The first order is longest path first, in windows shortest path first and robots at their goals last;
    after a failure the robot that failed goes first, and every fourth order is random.
    """

    restarts: int = 1000  # further orders of the robots to try
    following: bool = False  # avoid following conflicts too: nobody enters a vertex in the step its holder leaves

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "valid, not complete"
    supports: ClassVar[frozenset[str]] = frozenset({"effort", "window", "reach"})

    def __post_init__(self) -> None:
        if self.restarts < 0:
            raise PlanError(f"restarts is {self.restarts}, expected 0 or more")

    def prepare(self) -> None:
        """See `Planner`: compile or load the kernels."""
        clashes = no_clashes(2, 1, rotations=True)
        intervals, scratch = new_intervals(2, 1, 16, clashes)
        reset(2, intervals)
        lanes = UnitLanes(frozen(np.array([0, 1, 1])), frozen(np.array([1])), clashes, self.following)
        path, distance = np.zeros(8, np.int64), frozen(np.array([1, 0], np.int32))
        find_path(lanes, distance, np.int64(0), np.int64(1), intervals, scratch, path)
        reserve(lanes, intervals, path, 2, np.int64(FOREVER))

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`. GAVE_UP when all restarts are used up."""
        began, deadline_s = process_time(), deadline_of(time_limit_s)
        if refusal := impossible(problem):
            return refusal
        reservations = Reservations(problem, following=self.following)
        lower_bound = float(reservations.least.sum())
        order = np.argsort(-reservations.least, kind="stable")
        if problem.window_steps:  # planned again and again: whoever is nearly there goes first, or robots would push each other away
            order = np.lexsort((reservations.least, reservations.least == 0))
        chance = np.random.default_rng([problem.seed, ORDERS])
        status, plan, attempt = Status.GAVE_UP, None, 0
        for attempt in range(1, self.restarts + 2):
            reservations.clear()
            paths: dict[int, IntArray] = {}
            for robot in order.tolist():
                path = reservations.plan(robot)
                if path is None:
                    break
                paths[robot] = path
                if process_time() > deadline_s:
                    break
            if len(paths) == problem.num_robots:
                status, plan = Status.SOLVED, plan_of_paths([paths[r] for r in range(problem.num_robots)], problem.step_s)
                break
            if process_time() > deadline_s:
                status = Status.TIMED_OUT
                break
            if used_up(problem, reservations.labels):
                return without_effort(problem, began, lower_bound, orders=float(attempt))
            failed_first = np.concatenate(([robot], order[order != robot]))
            order = chance.permutation(problem.num_robots) if attempt % 4 == 0 else failed_first
        return PlanResult(
            status,
            plan=plan,
            planning_time_s=process_time() - began,
            lower_bound_steps=lower_bound,
            stats={"orders": float(attempt), "lower_bound_steps": lower_bound},
            message="" if plan else f"none of {attempt} orders of the robots gave a plan",
        )


class Reservations:
    """Paths planned so far, as safe intervals, and the earliest path of one robot more around them. Buffers grow when full."""

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
            num_steps = min(length, self._window + 1) if self._window else length
            until = self._window or FOREVER
            if code == OK and reserve(self._lanes, self._intervals, self._path, num_steps, until):
                return self._path[:num_steps].copy()
            if code not in (OK, SCRATCH_FULL):
                return None
            self._grow()

    def _grow(self) -> None:
        """Twice the room, with the same intervals in use."""
        self._intervals, self._scratch = with_double_room(self._intervals, self._scratch)
        self._path = np.empty(2 * len(self._path), np.int64)
