"""PIBT: priority inheritance with backtracking, one step at a time, without looking ahead.

Okumura, Machida, Défago, Tamura, "Priority inheritance with backtracking for iterative multi-agent path finding",
AIJ 2022, with the swap operation of Okumura, "Improving LaCAM", IJCAI 2023. In each step robots choose their next
vertices in order of priority. A robot that wants a vertex where another one stands pushes it: the other inherits the
priority and chooses first. If it finds nothing, the first one tries its next candidate.

The kernels of `_pibt.py` take less than a microsecond per robot and step; `tests/plain_pibt.py` is the algorithm in plain
Python, to read and to copy, and chooses the same. PIBT guarantees nothing for one-shot problems, since robots may push each
other about for ever: the planner gives up at a step limit, and tries again with other random choices.
"""

from dataclasses import dataclass, replace
from time import process_time
from typing import ClassVar

import numpy as np

from mrp_sumo.core.options import option
from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.answers import require_least, unplanned, used_up, without_effort
from planners.configuration import _pibt
from planners.configuration.guides import local_guidance
from planners.world import SLICE_S, ByConfigurations, search_start, small_problem

CHANCE = 11  # purpose of the stream of chance


@dataclass(frozen=True)
class Pibt(ByConfigurations):
    """PIBT: fast, incomplete, no bound on the cost."""

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "valid, not complete"
    supports: ClassVar[frozenset[str]] = frozenset({"effort", "window"})

    max_steps: int = option(0, "steps of an attempt; 0: 20 times the longest path plus 10 a robot, 1,000 to 20,000")
    num_attempts: int = option(10, "attempts with other random choices")

    def __post_init__(self) -> None:
        super().__post_init__()
        require_least(self, max_steps=0, ways=0, flow=0, num_attempts=1)

    def prepare(self) -> None:
        """Compile or load the kernels."""
        for ways, packed in ((1, False), (0, False), (0, True)):
            replace(self, ways=ways, flow=1)._plan(small_problem(), np.inf, packed)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """SOLVED, GAVE_UP when all attempts ran into the step limit, TIMED_OUT; INFEASIBLE only for goals out of reach."""
        return self._plan(problem, time_limit_s, None)

    def _plan(self, problem: Problem, time_limit_s: float, packed: bool | None) -> PlanResult:
        start = search_start(self, problem, time_limit_s, CHANCE, packed)
        if isinstance(start, PlanResult):
            return start
        steps, num_robots = start.steps, problem.num_robots
        window = problem.window_steps
        max_steps = window or self.max_steps or int(min(max(1000, 20 * steps.max() + 10 * num_robots), 20_000))
        scratch, at_once = _pibt.room_for_step(start.world), 1
        for attempt in range(1, self.num_attempts + 1):
            order = start.world.base_order.copy()
            local = local_guidance(start.world, self.local if attempt % 2 else 0)  # it can keep the last ones from their goals, too
            room = _pibt.PibtRoom(scratch._replace(onward=np.full(num_robots, -1, np.int64)), local)
            path = np.empty((min(max_steps, 2 * int(steps.max()) + 64) + 1, num_robots), np.int32)
            path[0] = start.problem.start
            t = 0
            while t < max_steps:
                if process_time() > start.deadline_s:
                    return unplanned(
                        Status.TIMED_OUT, start.begin_s, f"no solution within {time_limit_s:g} s", start.lower_bound, attempts=attempt
                    )
                if t == len(path) - 1:
                    path = np.concatenate((path, np.empty((min(len(path), max_steps + 1 - len(path)), num_robots), np.int32)))
                slice_s = process_time()
                last = t
                world, until = (start.guided, start.num_guided) if t < start.num_guided else (start.world, max_steps)
                until = min(t + at_once, len(path) - 1, until)
                t, home = _pibt.run(world, room, path, t, until, order, start.rng)
                if home or t == window > 0:
                    return start.solved(path[: t + 1], attempts=attempt)
                if used_up(problem, t * num_robots):
                    return without_effort(problem, start.begin_s, start.lower_bound, attempts=attempt)
                at_once = max(1, int((t - last) * SLICE_S / max(process_time() - slice_s, 1e-6)))
        message = f"no solution in {self.num_attempts} attempts of {max_steps} steps each"
        return unplanned(Status.GAVE_UP, start.begin_s, message, start.lower_bound, attempts=self.num_attempts)
