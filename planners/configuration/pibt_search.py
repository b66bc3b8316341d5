"""PIBT over time, in attempts, until all robots are at their goals or the time is up."""

from time import process_time
from typing import Any

import numpy as np

from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.answers import unplanned, used_up, without_effort
from planners.configuration import _pibt
from planners.configuration.guides import local_guidance
from planners.configuration.search_start import SearchStart, search_start
from planners.world import SLICE_S, build_scratch

CHANCE = 11  # purpose of the stream of chance


def plan_by_pibt(pibt: Any, problem: Problem, time_limit_s: float, packed: bool | None) -> PlanResult:
    """See `Pibt.plan`.

    Parameters
    ----------
    pibt
        A `Pibt`, whose module imports this one.
    problem, time_limit_s
        As given to it.
    packed
        See `search_start`.
    """
    start = search_start(
        problem, time_limit_s, CHANCE, ways=pibt.ways, flow=pibt.flow, following=pibt.following, rotations=pibt.rotations, packed=packed
    )
    if isinstance(start, PlanResult):
        return start
    steps, rng, num_robots = start.steps, start.rng, problem.num_robots
    window = problem.window_steps
    max_steps = window or pibt.max_steps or int(min(max(1000, 20 * steps.max() + 10 * num_robots), 20_000))
    scratch = build_scratch(start.world)
    base_order = np.argsort(-steps, kind="stable")
    at_once = 1
    for attempt in range(1, pibt.num_attempts + 1):
        order = base_order.copy()
        local = local_guidance(start.problem, pibt.local if attempt % 2 else 0)  # it can keep the last ones from their goals, too
        scratch.onward[:] = -1
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
            t, home = _pibt.run(world, scratch, local, path, t, until, order, base_order, pibt.hindrance, rng)
            if home or t == window > 0:
                return start.solved(path[: t + 1], attempts=attempt)
            if used_up(problem, t * num_robots):
                return without_effort(problem, start.begin_s, start.lower_bound, attempts=attempt)
            at_once = max(1, int((t - last) * SLICE_S / max(process_time() - slice_s, 1e-6)))
    message = f"no solution in {pibt.num_attempts} attempts of {max_steps} steps each"
    return unplanned(Status.GAVE_UP, start.begin_s, message, start.lower_bound, attempts=pibt.num_attempts)


def steps_of_window(start: SearchStart, hindrance: bool, local: int) -> np.ndarray | None:
    """[T, R] the steps of a window, or fewer where all are at their goals sooner; None when the time is up.

    Parameters
    ----------
    start
        Of a problem with a window.
    hindrance, local
        See `Pibt`.
    """
    window, steps = start.given.window_steps, start.steps
    path = np.empty((window + 1, len(steps)), np.int32)
    path[0] = start.problem.start
    base_order = np.argsort(-steps, kind="stable")
    order = base_order.copy()
    scratch, guidance, t, home = build_scratch(start.world), local_guidance(start.problem, local), 0, False
    while t < window and not home:
        if process_time() > start.deadline_s:
            return None
        world, until = (start.guided, min(start.num_guided, window)) if t < start.num_guided else (start.world, window)
        t, home = _pibt.run(world, scratch, guidance, path, t, until, order, base_order, hindrance, start.rng)
    return path[: t + 1]
