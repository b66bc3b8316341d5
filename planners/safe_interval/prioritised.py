"""Prioritised planning: robots in an order, each by SIPP around those before it. Guarantee: valid, not complete.

Source: Erdmann, Lozano-Pérez, "On multiple moving objects", Algorithmica 1987; Silver, "Cooperative pathfinding",
AIIDE 2005; random restarts after Bennewitz, Burgard, Thrun, "Finding and optimizing solvable priority schemes", 2002.
The low level is SIPP (Phillips, Likhachev, ICRA 2011), as that of `lns2` where nobody may be crossed.
"""

from dataclasses import dataclass
from time import process_time
from typing import ClassVar

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.options import option
from mrp_sumo.core.plan import Plan, PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import deadline_of, impossible, used_up, without_effort
from mrp_sumo.search.distance import UNREACHABLE, steps_to_targets
from planners.neighbourhood._sipps import plan_apart, room_for_labels
from planners.neighbourhood._traffic import WORD, empty_traffic, hold_starts
from planners.neighbourhood.refinement import room_bytes, task_of
from planners.world import small_problem

ORDERS = 3  # purpose of the stream of chance
SPARE = 64  # steps beyond the longest shortest way
MOST_CELLS = 1 << 18  # of a vertex and a step, in tables that are made anew for each request
MOST_BYTES = 2_000_000_000  # of tables over more steps
VERTICES_AT_ONCE = 100_000  # searched at most between two looks at the clock


@dataclass(frozen=True)
class Prioritised:
    """Prioritised planning by SIPP, with random restarts.

    The first order is longest path first, in windows shortest path first and robots at their goals last;
    after a failure the robot that failed goes first, and every fourth order is random.
    """

    restarts: int = option(1000, "further orders of the robots to try")
    following: bool = option(False, "also forbid entering a vertex in the step in which another robot leaves it")

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "valid, not complete"
    supports: ClassVar[frozenset[str]] = frozenset({"effort", "window", "reach"})

    def __post_init__(self) -> None:
        if self.restarts < 0:
            raise PlanError(f"restarts is {self.restarts}, expected 0 or more")

    def prepare(self) -> None:
        """See `Planner`: compile or load the kernels."""
        Reservations(small_problem(), following=self.following).plan(np.arange(2), np.inf)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`. GAVE_UP when all restarts are used up."""
        began, deadline_s = process_time(), deadline_of(time_limit_s)
        if refusal := impossible(problem):
            return refusal
        reservations = Reservations(problem, following=self.following)
        least = reservations.least
        order = np.argsort(-least, kind="stable")
        if problem.window_steps:  # planned again and again: whoever is nearly there goes first, or robots would push each other away
            order = np.lexsort((least, least == 0))
        chance, lower_bound = np.random.default_rng([problem.seed, ORDERS]), float(least.sum())
        status, plan, attempt = Status.GAVE_UP, None, 0
        for attempt in range(1, self.restarts + 2):
            planned = reservations.plan(order, deadline_s)
            if planned == problem.num_robots:
                status, plan = Status.SOLVED, reservations.as_plan()
                break
            if process_time() > deadline_s:
                status = Status.TIMED_OUT
                break
            if used_up(problem, reservations.labels):
                return without_effort(problem, began, lower_bound, orders=float(attempt))
            failed_first = np.concatenate(([order[planned]], np.delete(order, planned)))
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
    """Paths of robots that are planned one after another, each the earliest around those before it; in windows, until the window ends."""

    def __init__(self, problem: Problem, *, following: bool) -> None:
        """`following` is whether a vertex must be free for a step before it is entered."""
        table, num_vertices = steps_to_targets(problem), problem.graph.num_vertices
        longest = int(table.max(where=table < UNREACHABLE, initial=0))
        self._problem, self._task = problem, task_of(problem, table, following=following)
        self.least = self._task.least  # [R] steps of each robot's shortest path
        # steps to the goal at most, once those who are to stand do; beyond a window nobody is in the way
        self._detour = longest if problem.window_steps else min(num_vertices, 2 * longest + SPARE)
        self._at_once = max(1, VERTICES_AT_ONCE // num_vertices)  # robots
        self._labels = 0  # before there was more room
        self._make_room(problem.window_steps + longest + 1 if problem.window_steps else int(self.least.max(initial=0)) + SPARE)

    @property
    def labels(self) -> int:
        """Of all searches."""
        return self._labels + int(self._room.stamp[1])

    def plan(self, order: IntArray, deadline_s: float) -> int:
        """Plan robots in an order instead of those before, until one has no path, or to a time on the clock of `process_time`; how many."""
        while True:
            self._traffic = empty_traffic(self._task, self._horizon)
            if self._task.following:
                hold_starts(self._traffic)
            planned = new = 0
            while planned < len(order) and process_time() <= deadline_s:
                robots = order[planned : planned + self._at_once]
                new = plan_apart(self._traffic, self._room, robots)
                planned += new
                if new < len(robots):
                    break
            settled = self._problem.window_steps or int(self._traffic.end.max(initial=0))
            enough = planned == len(order) or process_time() > deadline_s or self._horizon > settled + self._detour
            if enough or room_bytes(self._task, 2 * self._horizon) > MOST_BYTES:
                return planned
            self._labels = self.labels
            self._make_room(2 * self._horizon)

    def as_plan(self) -> Plan:
        """The paths of all, in a window as far as that goes."""
        steps = self._problem.window_steps + 1 if self._problem.window_steps else None
        return plan_of_paths(list(self._traffic.at[:, :steps]), self._problem.step_s)

    def _make_room(self, horizon: int) -> None:
        """For paths of so many steps or some more."""
        self._horizon = -(-horizon // WORD) * WORD
        graph = self._problem.graph
        self._room = room_for_labels(graph.num_vertices, graph.num_lanes, self._horizon, cells=MOST_CELLS)
