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

CHANCE = 11  # purpose of the stream of chance


@dataclass(frozen=True)
class Pibt:
    """Plans by PIBT; incomplete, no bound on the cost."""

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "valid, not complete"

    following: bool = False  # avoid following conflicts too: nobody enters a vertex in the step its holder leaves
    rotations: bool = True  # rings of robots may move at once
    max_steps: int = 0  # give up an attempt after so many steps; 0: 20 x the longest way + 10 x robots, 1,000 to 20,000
    num_attempts: int = 10
    hindrance: bool = True  # prefer, among equally near vertices, those that fewer neighbours want
    flow: int = 1  # rounds of giving ways that do not run against each other, for a guide; 0 for none

    def __post_init__(self) -> None:
        if self.max_steps < 0 or self.num_attempts < 1 or self.flow < 0:
            raise PlanError("pibt: expected max_steps and flow of 0 or more and num_attempts of 1 or more")

    def prepare(self) -> None:
        """Compile or load the kernels."""
        from planners._world import small_problem

        for packed in (False, True):
            self._plan(small_problem(), np.inf, packed)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """SOLVED, GAVE_UP when all attempts ran into the step limit, TIMED_OUT; INFEASIBLE only for goals out of reach."""
        return self._plan(problem, time_limit_s, None)

    def _plan(self, problem: Problem, time_limit_s: float, packed: bool | None) -> PlanResult:
        from planners._world import SLICE_S, build_scratch, gave_up, timed_out
        from planners.configuration import _pibt
        from planners.configuration._search_start import search_start

        start = search_start(
            problem, time_limit_s, CHANCE, flow=self.flow, following=self.following, rotations=self.rotations, packed=packed
        )
        if isinstance(start, PlanResult):
            return start
        steps, rng, num_robots = start.steps, start.rng, problem.num_robots
        max_steps = self.max_steps or int(min(max(1000, 20 * steps.max() + 10 * num_robots), 20_000))
        scratch = build_scratch(start.world)
        base_order = np.argsort(-steps, kind="stable")
        at_once = 1
        for attempt in range(1, self.num_attempts + 1):
            order = base_order.copy()
            path = np.empty((min(max_steps, 2 * int(steps.max()) + 64) + 1, num_robots), np.int32)
            path[0] = start.problem.start
            t = 0
            while t < max_steps:
                if perf_counter() > start.deadline_s:
                    return timed_out(start.begin_s, start.lower_bound, f"no solution within {time_limit_s:g} s", attempts=attempt)
                if t == len(path) - 1:
                    path = np.concatenate((path, np.empty((min(len(path), max_steps + 1 - len(path)), num_robots), np.int32)))
                slice_s = perf_counter()
                last = t
                world, until = (start.guided, start.num_guided) if t < start.num_guided else (start.world, max_steps)
                until = min(t + at_once, len(path) - 1, until)
                t, home = _pibt.run(world, scratch, path, t, until, order, base_order, self.hindrance, rng)
                if home:
                    return start.solved(path[: t + 1], attempts=attempt)
                at_once = max(1, int((t - last) * SLICE_S / max(perf_counter() - slice_s, 1e-6)))
        message = f"no solution in {self.num_attempts} attempts of {max_steps} steps each"
        return gave_up(start.begin_s, start.lower_bound, message, attempts=self.num_attempts)
