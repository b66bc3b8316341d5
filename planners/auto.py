"""A portfolio: planners asked one after another until one answers, the first chosen by what the problem is like.

All but the last may use a share of what is left of the time limit and of the effort, so that there is always something left to fall back
on. The first is bounded in work where it counts that: who answers hangs on the clock only where the limit is short. Refuses
portfolios of planners that are not there, and of itself.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from time import perf_counter
from typing import ClassVar

from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError, nearest
from mrp_sumo.planning.answers import as_supported, require_limit
from mrp_sumo.planning.registry import planner, planner_names

NOT_IN_IT = ("auto", "external", "plan_file")  # nothing without a program or a file, nor itself
THIN = 3.0  # vertices that a robot has for itself on average, from which on one after another finds its way in a window
FEW = 50  # robots whose real motion is planned


@dataclass(frozen=True)
class Auto:
    """The planner that fits the problem, and others where it finds no plan."""

    planners: tuple[str, ...] = ()  # in the order in which they are asked; empty: by what the problem is like
    share: float = 0.5  # of what is left of the time limit and the effort, for each but the last

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "valid, not complete"
    supports: ClassVar[frozenset[str]] = frozenset({"seconds", "effort", "types", "window"})

    def __post_init__(self) -> None:
        known = [name for name in planner_names() if name not in NOT_IN_IT]
        for name in self.planners:
            if name not in known:
                raise PlanError(f"auto: no planner '{name}' for a portfolio{nearest(name, known, limit=len(known))}")
        if not 0 < self.share < 1:
            raise PlanError(f"auto: share is {self.share}, expected a number between 0 and 1")

    def prepare(self) -> None:
        """Compile or load the kernels of all that may be asked."""
        for name in self.planners or ("prioritised", "continuous", "lacam", "pibt"):
            planner(name, {}).prepare()

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """The first plan that a planner finds; where none does, the answer of the last, and what the others said."""
        require_limit(time_limit_s)
        began = perf_counter()
        names, why = (self.planners, "as the scenario says") if self.planners else candidates(problem)
        refusals: list[str] = []
        effort = problem.effort
        for name, last in _with_last(names):
            left_s = time_limit_s - (perf_counter() - began)
            if left_s <= 0:
                break
            asked = planner(name, {})
            given = replace(problem, effort=_part(effort, 1.0 if last else self.share))
            supported = as_supported(asked, given)
            result = asked.plan(supported, left_s if last else self.share * left_s)
            effort -= given.effort
            by = "lacam" if result.stats.get("from_lacam") else name
            text = "; ".join((why, *refusals))
            if result.status is Status.SOLVED or (result.status is Status.INFEASIBLE and supported is given) or last:
                return replace(result, planning_time_s=perf_counter() - began, chosen=by, why=text)
            refusals.append(f"{name} {str(result.status).replace('_', ' ')}")
        message = f"no plan within {time_limit_s:g} s: {', '.join(refusals)}"
        return PlanResult(Status.TIMED_OUT, planning_time_s=perf_counter() - began, message=message)


def candidates(problem: Problem) -> tuple[tuple[str, ...], str]:
    """Who is asked, in this order, and why."""
    robots = problem.num_robots
    if problem.window_steps:
        if problem.graph.num_vertices >= THIN * robots:
            return ("prioritised", "lacam", "pibt"), "robots have room in the window"
        return ("lacam", "prioritised", "pibt"), "robots crowd"
    if problem.drivable and robots <= FEW:
        return ("continuous", "lacam"), f"few enough robots ({robots}) to plan their real motion"
    return ("lacam", "prioritised"), f"{robots} robots" if problem.drivable else "the plan's order need not be kept"


def _with_last(names: tuple[str, ...]) -> Iterator[tuple[str, bool]]:
    """Each name, and whether it is the last."""
    for k, name in enumerate(names, 1):
        yield name, k == len(names)


def _part(effort: int, share: float) -> int:
    """A share of the effort that is left; 0 where none is counted."""
    return max(1, int(share * effort)) if effort else 0
