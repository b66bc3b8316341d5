"""PIBT: priority inheritance with backtracking, one step at a time, without looking ahead.

Okumura, Machida, Défago, Tamura, "Priority inheritance with backtracking for iterative multi-agent path
finding", AIJ 2022, with the swap operation of Okumura, IJCAI 2023. Takes well under a microsecond a robot and
step. Guarantees nothing for one-shot problems: robots may push each other about for ever, so it gives up at a
step limit and begins again with other chances until the time is up.
"""

from dataclasses import dataclass
from time import perf_counter
from typing import ClassVar

import numpy as np

from mrp_sumo.core.plan import PlanResult
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import order_clash
from planners import _pibt
from planners._world import (
    SLICE_S,
    build_scratch,
    build_world,
    checked_deadline,
    gave_up,
    is_large,
    small_problem,
    solved,
    sum_of_costs,
    tiled,
    timed_out,
    without_search,
)

CHANCE = 11  # purpose of the stream of chance


@dataclass(frozen=True)
class Pibt:
    """Plans by PIBT; incomplete, no bound on the cost."""

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "valid, not complete"

    max_steps: int = 0  # give up an attempt after so many steps; 0: 20 x the longest way + 10 x robots, 1,000 to 20,000
    num_attempts: int = 10
    hindrance: bool = True  # prefer, among equally near vertices, those that fewer neighbours want

    def __post_init__(self) -> None:
        if self.max_steps < 0 or self.num_attempts < 1:
            raise PlanError("pibt: expected max_steps of 0 or more and num_attempts of 1 or more")

    def prepare(self) -> None:
        """Compile or load the kernels."""
        for packed in (False, True):
            self._plan(small_problem(), np.inf, packed)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """SOLVED, GAVE_UP when all attempts ran into the step limit, TIMED_OUT; INFEASIBLE only for goals out of reach."""
        return self._plan(problem, time_limit_s, None)

    def _plan(self, problem: Problem, time_limit_s: float, packed: bool | None) -> PlanResult:
        begin_s = perf_counter()
        deadline_s = checked_deadline(time_limit_s)
        given, original = problem, None
        packed = is_large(problem) if packed is None else packed
        if packed:
            problem, original = tiled(problem)
        built = build_world(problem, deadline_s, packed=packed)
        if built is None:
            return timed_out(begin_s, 0.0, "the time limit passed while distances were computed")
        world, steps = built
        known = without_search(given, steps, begin_s) or (None if packed else order_clash(given))
        if known:
            return known
        lower_bound = float(steps.sum())
        max_steps = self.max_steps or int(min(max(1000, 20 * steps.max() + 10 * problem.num_robots), 20_000))
        scratch = build_scratch(world)
        rng = np.random.default_rng([problem.seed, CHANCE])
        base_order = np.argsort(-steps, kind="stable")
        at_once = 1
        for attempt in range(1, self.num_attempts + 1):
            order = base_order.copy()
            path = np.empty((min(max_steps, 2 * int(steps.max()) + 64) + 1, problem.num_robots), np.int32)
            path[0] = problem.start
            t = 0
            while t < max_steps:
                if perf_counter() > deadline_s:
                    return timed_out(begin_s, lower_bound, f"no solution within {time_limit_s:g} s", attempts=attempt)
                if t == len(path) - 1:
                    path = np.concatenate((path, np.empty((min(len(path), max_steps + 1 - len(path)), problem.num_robots), np.int32)))
                slice_s = perf_counter()
                last = t
                t, home = _pibt.run(world, scratch, path, t, min(t + at_once, len(path) - 1), order, base_order, self.hindrance, rng)
                if home:
                    path = path[: t + 1]
                    cost = sum_of_costs(path, world.goal)
                    path = path if original is None else original[path]
                    return solved(given, path, begin_s, lower_bound, attempts=attempt, cost=cost)
                at_once = max(1, int((t - last) * SLICE_S / max(perf_counter() - slice_s, 1e-6)))
        message = f"no solution in {self.num_attempts} attempts of {max_steps} steps each"
        return gave_up(begin_s, lower_bound, message, attempts=self.num_attempts)
