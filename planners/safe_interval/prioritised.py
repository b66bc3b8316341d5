"""Prioritised planning: robots in an order, each by SIPP around those before it. Guarantee: valid, not complete.

Source: Erdmann, Lozano-Pérez, "On multiple moving objects", Algorithmica 1987; Silver, "Cooperative pathfinding",
AIIDE 2005; random restarts after Bennewitz, Burgard, Thrun, "Finding and optimizing solvable priority schemes", 2002.
The low level is SIPP (Phillips, Likhachev, ICRA 2011).
"""

from dataclasses import dataclass
from time import process_time
from typing import ClassVar

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import deadline_of, impossible, used_up, without_effort

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
        """See `Planner`."""
        from planners.safe_interval.reservations import prepare

        prepare(following=self.following)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`. GAVE_UP when all restarts are used up."""
        from planners.safe_interval.reservations import Reservations

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
