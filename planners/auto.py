"""A portfolio: planners asked one after another until one has a plan that is good enough, in an order that hangs on the problem.

Plans are compared by how many times their planner's lower bound they cost, steps with steps and seconds with seconds: near its bound a plan
is taken at once. In a window, robots that are planned one after another may all wait where a search for all at once gets them on: who does
not arrive costs the window and the steps that are left after it. Each planner may use an equal share of what is left of the time limit and
of the effort, LaCAM most of the time, so that there is always something left to fall back on. Searches that answer soon or hardly ever, and
those who are asked for a cheaper plan than there is, are bounded in work, too. Refuses portfolios of planners that are not there, and of
itself.
"""

import math
from dataclasses import dataclass, replace
from time import process_time
from typing import ClassVar

import numpy as np

from mrp_sumo.core.options import option
from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError, nearest
from mrp_sumo.planning.answers import as_supported, deadline_of
from mrp_sumo.planning.registry import planner, planner_names
from mrp_sumo.search.distance import steps_to_targets

NOT_IN_IT = ("auto", "external", "plan_file")  # nothing without a program or a file, nor itself
NEAR = 1.7  # times its lower bound a plan may cost to be taken at once
DEAR = 2.0  # times its lower bound a plan costs for which others look for a cheaper one thoroughly
AT_BOUND = 1.001  # likewise where nobody loses a step
THIN = 3.0  # vertices that a robot has for itself on average, from which on they are planned one after another in a window
FEW_IN_WINDOW = 30  # robots for whom a second planner is asked there, unless nobody loses a step
FEW, FEW_SLOW = 5, 20  # robots whose real motion is planned on grids, where ways of one length differ in turns; if they turn slowly
SLOW = 0.3  # of a step at least, that a quarter turn takes then
SOME = 200  # robots for whom a bounded search is tried first, and a second planner asked, to keep the cheaper plan
CLOSE = {"ecbs": {"w": 1.02}}  # parameters: with its default it answers hardly sooner or more often, and dearer
BOUNDED = {"pbs": 150_000, "ecbs": 40_000, "eecbs": 40_000}  # labels, of who is asked where there is no plan yet: 0.12 s, 0.01 s
QUICK, THOROUGH = 1000, 10_000  # labels a robot of those who are asked for a cheaper plan than there is; the latter in windows, too
COMPLETE, ITS_SHARE = "lacam", 0.5  # the planner that finds plans where others find none, and its share of the time that is left


@dataclass(frozen=True)
class Portfolio:
    """Planners to be asked, and why."""

    names: tuple[str, ...]  # in this order
    compared: int  # of the first so many the cheapest plan is taken; of the others the first
    why: str
    near: float = NEAR  # times its bound a plan may cost to be taken at once


@dataclass(frozen=True)
class Auto:
    """The planner that fits the problem, and others where it finds no plan."""

    planners: tuple[str, ...] = option(
        (), "planners to try, in order; each may use an equal share of the time and effort that are left. None: by the problem"
    )

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "valid, not complete"
    supports: ClassVar[frozenset[str]] = frozenset({"seconds", "effort", "types", "window"})

    def __post_init__(self) -> None:
        known = [name for name in planner_names() if name not in NOT_IN_IT] if self.planners else []
        for name in self.planners:
            if name not in known:
                raise PlanError(f"no planner '{name}' for a portfolio{nearest(name, known, limit=len(known))}")

    def prepare(self) -> None:
        """Compile or load the kernels of all that may be asked; of `continuous`, which is seldom asked, when it is."""
        for name in self.planners or ("prioritised", "pbs", "ecbs", "lacam", "eecbs", "lns2", "pibt"):
            planner(name, {}).prepare()

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """The best plan of those that are compared; where there is none, the answer of the last, and what the others said."""
        began, until_s = process_time(), deadline_of(time_limit_s)
        portfolio = Portfolio(self.planners, 1, "as the scenario says") if self.planners else portfolio_for(problem)
        best: tuple[str, PlanResult] | None = None
        refusals: list[str] = []
        effort = problem.effort
        for k, name in enumerate(portfolio.names, 1):
            if best and name in BOUNDED:
                continue
            num_left = len(portfolio.names) - k + 1
            part = max(1, effort // num_left) if effort else 0
            cheaper = problem.num_robots * (THOROUGH if problem.window_steps or (best and _above_bound(best[1], problem) > DEAR) else QUICK)
            most = 0 if self.planners else BOUNDED.get(name, cheaper if best else 0)
            part = min(part, most) or most or part
            effort -= min(effort, part)
            share = ITS_SHARE if name == COMPLETE and num_left > 1 and not self.planners else 1 / num_left
            parameters = {} if self.planners else CLOSE.get(name, {})
            result, proves = _answer(name, parameters, replace(problem, effort=part), until_s, share)
            best = _cheaper(best, name, result, problem)
            is_last = proves or num_left == 1 or until_s - process_time() <= 0.01 * time_limit_s
            if is_last or (best and (k >= portfolio.compared or _above_bound(best[1], problem) <= portfolio.near)):
                if best and portfolio.compared > 1 and _above_bound(best[1], problem) > NEAR and "prioritised" not in portfolio.names[:k]:
                    last = replace(problem, effort=max(1, min(effort, cheaper)) if problem.effort else cheaper)
                    best = _cheaper(best, "prioritised", _answer("prioritised", {}, last, until_s, 1.0)[0], problem)
                by, chosen = best or (name, result)
                by = "lacam" if chosen.stats.get("from_lacam") else by
                why = "; ".join((portfolio.why, *refusals))
                return replace(chosen, planning_time_s=process_time() - began, chosen=by, why=why)
            if result.status is not Status.SOLVED:
                refusals.append(f"{name} {str(result.status).replace('_', ' ')}")
        raise AssertionError("the last answer ends the search")


def _cheaper(best: tuple[str, PlanResult] | None, name: str, result: PlanResult, problem: Problem) -> tuple[str, PlanResult] | None:
    """The best answer so far and who gave it, or this one if it is a plan that costs less beside its bound."""
    if result.status is Status.SOLVED and (best is None or _above_bound(result, problem) < _above_bound(best[1], problem)):
        return name, result
    return best


def _answer(name: str, parameters: dict[str, float], problem: Problem, until_s: float, share: float) -> tuple[PlanResult, bool]:
    """An answer within a share of what is left of the time, and whether it proves that there is no plan."""
    left_s = max(until_s - process_time(), 1e-9)  # the clock went on since it was looked at last
    chosen = planner(name, parameters)
    if name == "continuous":
        chosen.prepare()  # outside of the time that is left to it
    supported = as_supported(chosen, problem)
    result = chosen.plan(supported, left_s * share)
    return result, result.status is Status.INFEASIBLE and supported is problem


def portfolio_for(problem: Problem) -> Portfolio:
    """Planners to be asked about a problem."""
    robots = problem.num_robots
    if problem.window_steps:
        if problem.graph.num_vertices >= THIN * robots:
            compared = 2 if robots <= FEW_IN_WINDOW else 1
            return Portfolio(("prioritised", "lacam", "pibt"), compared, "robots have room in the window", AT_BOUND)
        return Portfolio(("lacam", "prioritised", "pibt"), 1, "robots crowd")
    turn_slowly = bool((math.pi / 2 >= SLOW * problem.step_s * problem.fleet.turn_rate_rad_s).all())
    if problem.drivable and problem.graph.kind == "grid" and robots <= (FEW_SLOW if turn_slowly else FEW):
        why = f"few enough robots ({robots}) on a grid to plan their real motion"
        return Portfolio(("pbs", "ecbs", "lacam", "eecbs", "lns2", "continuous"), 1, why)
    if robots <= SOME:
        others = ("continuous",) if problem.drivable else ("prioritised",)
        return Portfolio(("ecbs", "lacam", "eecbs", "lns2", *others), 4, f"few enough robots ({robots}) to try a bounded search first")
    return Portfolio(("lacam", "lns2", "prioritised"), 1, f"many robots ({robots})")


def _above_bound(result: PlanResult, problem: Problem) -> float:
    """How many times the planner's lower bound a plan costs, both in the unit of its planner."""
    assert result.plan is not None
    bound_s = result.stats.get("lower_bound_s", result.lower_bound_steps * problem.step_s)
    cost_s = float(result.plan.end_s.sum())
    if problem.window_steps:
        left = steps_to_targets(problem)[np.arange(problem.num_robots), result.plan.vertex[result.plan.first[1:] - 1]]
        cost_s = float(np.where(left > 0, (problem.window_steps + left) * problem.step_s, result.plan.end_s).sum())
    return cost_s / bound_s if bound_s > 0 else 1.0 if cost_s <= 0 else float("inf")
