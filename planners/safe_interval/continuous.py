"""Planning in continuous time with the robots' real motion: prioritised planning over straight runs, then large neighbourhood search.

A robot turns in place, drives a run of any number of lanes at full profile, and waits at rest; plans are times that the executor keeps
to the step (policy `adg_timed`). Each robot takes the earliest way around those before it by safe interval planning, which is optimal
among plans of such runs. Guarantee: drivable, not complete.

Sources: Erdmann, Lozano-Pérez, "On multiple moving objects", Algorithmica 1987; Phillips, Likhachev, "SIPP", ICRA 2011; Yan, Li, "MASS",
2024, for runs between stationary states; raising robots that fail after Bennewitz, Burgard, Thrun, 2002; Li et al., "Anytime multi-agent
path finding via large neighborhood search", IJCAI 2021.
"""

from dataclasses import dataclass, replace
from time import process_time
from typing import ClassVar

import numpy as np

from mrp_sumo.core.options import option
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import deadline_of, impossible, require_least
from mrp_sumo.planning.registry import planner

CHANCE = 12  # purpose of the stream of chance
ORDERS = 16  # of the robots that are tried
MOST_FIRST = 400_000  # entries that searches for the first solution look at, before lacam is asked
MOST_POLISH = 700_000  # and for better ones, however many robots there are
SHARE = 0.5  # of the time limit, for the first solution


@dataclass(frozen=True)
class Continuous:
    """Prioritised planning with the robots' real motion, then large neighbourhood search.

    Those with the shortest ways plan first; a robot that finds no way is raised above those that are in its way. Crowds that have no
    ways one by one, or not soon, get the plan of `lacam`, in steps, in windows through the window: its order is what robots can keep.
    """

    anytime: bool = option(False, "spend the rest of the time limit on lowering the cost")
    neighbourhood: int = option(3, "robots replanned at a time")
    polish: int = option(150, "entries for each pair of robots spent at most on improving the first plan, 0 for none")
    step_length_s: float = option(0.1, "step of the simulation that drives the plan")

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "drivable, not complete"
    supports: ClassVar[frozenset[str]] = frozenset({"seconds", "effort", "types", "window"})

    def __post_init__(self) -> None:
        require_least(self, neighbourhood=1, polish=0)
        if not 0.001 <= self.step_length_s <= 1.0:
            raise PlanError(f"step_length_s is {self.step_length_s}, expected 0.001 to 1")

    def prepare(self) -> None:
        """Compile or load the kernels."""
        from planners.safe_interval.first_ways import first_ways
        from planners.safe_interval.improvement import Improvement
        from planners.safe_interval.timetable import Timetable
        from planners.world import small_problem

        timetable = Timetable(small_problem(), self.step_length_s)
        for robot in range(timetable.num_robots):
            timetable.look_back(robot)
        while not first_ways(timetable, np.arange(2), 100, np.inf, MOST_FIRST):
            pass
        Improvement(timetable, 2, np.random.default_rng(0)).until(np.inf, 500)
        timetable.plan()
        planner("lacam", {}).prepare()

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`. GAVE_UP when all orders have been tried, and lacam has no plan either."""
        from planners.safe_interval.first_ways import first_ways
        from planners.safe_interval.improvement import Improvement
        from planners.safe_interval.timetable import Timetable

        began, deadline_s = process_time(), deadline_of(time_limit_s)
        single_until_s = deadline_s if problem.effort else began + SHARE * time_limit_s  # a bounded effort knows no clock
        if refusal := impossible(problem):
            return refusal
        if not problem.num_robots:
            return PlanResult(Status.SOLVED, plan_of_paths([], problem.step_s), planning_time_s=process_time() - began)
        timetable = Timetable(problem, self.step_length_s)
        for robot in range(problem.num_robots):
            timetable.look_back(robot)
            if process_time() > single_until_s:
                return _of_lacam(problem, began, time_limit_s, timetable.work)
        most = min(MOST_FIRST, problem.effort // 2) if problem.effort else MOST_FIRST
        rng = np.random.default_rng([problem.seed, CHANCE])
        by_length = np.argsort(timetable.alone, kind="stable")
        for k in range(ORDERS):
            order = by_length if k % 2 == 0 else by_length[::-1] if k == 1 else rng.permutation(problem.num_robots)
            if first_ways(timetable, order, (k + 1) * 2 * timetable.steps_of_a_lane, single_until_s, most):
                break
            if process_time() > single_until_s or timetable.work > most:
                return _of_lacam(problem, began, time_limit_s, timetable.work)
        else:
            return _of_lacam(problem, began, time_limit_s, timetable.work)
        stats = {
            "first_solution_time_s": process_time() - began,
            "first_solution_cost_s": float(timetable.steps.sum() * self.step_length_s),
            "lower_bound_s": float(timetable.alone.sum() * self.step_length_s),
        }
        if self.polish or self.anytime:
            improvement = Improvement(timetable, self.neighbourhood, rng)
            polish = min(self.polish * problem.num_robots * (problem.num_robots - 1) // 2, MOST_POLISH)
            work = np.iinfo(np.int64).max if self.anytime else polish
            if problem.effort:
                work = min(work, max(0, problem.effort - timetable.work))
            improvement.until(deadline_s - 0.02, work)
            stats["neighbourhoods"] = float(improvement.tries)
        least_s = np.maximum(timetable.alone - 1, 0).sum() * self.step_length_s  # arrivals are within a step
        return PlanResult(
            Status.SOLVED,
            plan=timetable.plan(),
            planning_time_s=process_time() - began,
            lower_bound_steps=float(least_s / problem.step_s),
            stats=stats | {"cost_s": float(timetable.steps.sum() * self.step_length_s), "entries": float(timetable.work)},
        )


def _of_lacam(problem: Problem, began: float, time_limit_s: float, work: int) -> PlanResult:
    """A plan in steps for robots that found no ways one by one, drivable in its order."""
    left_s = time_limit_s - (process_time() - began)
    if left_s <= 0:
        return PlanResult(Status.TIMED_OUT, planning_time_s=process_time() - began, message=f"no plan within {time_limit_s:g} s")
    left = max(1, problem.effort - work) if problem.effort else 0
    result = planner("lacam", {}).plan(replace(problem.for_any(), drivable=True, effort=left), left_s)
    message = f"robots found no ways one by one; lacam: {result.message}" if result.plan is None else ""
    of_fewer_lanes = result.status is Status.INFEASIBLE and problem.barred is not None
    return PlanResult(
        Status.GAVE_UP if of_fewer_lanes else result.status,
        plan=result.plan,
        planning_time_s=process_time() - began,
        stats={**result.stats, "from_lacam": 1.0},
        message=message,
    )
