"""Priority-based search: which of two robots in conflict goes first is branched on, depth first.

Robots move as they do, around each other's resources (see `continuous` for ways, times and resources), or, in a window, in unit steps by
all stops that they have ahead. Each takes the earliest way around those above it; two robots in conflict without a priority between them
are a branching. Guarantee: drivable, not complete, though it finds plans that no fixed order of robots has.

Source: Ma, Harabor, Stuckey, Li, Koenig, "Searching with consistent prioritization for multi-agent path finding", AAAI 2019.
"""

from dataclasses import dataclass, replace
from time import process_time
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from mrp_sumo.core.options import option
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import deadline_of, impossible

if TYPE_CHECKING:
    from planners.safe_interval.window_motion import WindowSteps

WINDOW_NODES, NODES_A_ROBOT = 1000, 20  # of the tree, in windows: four to ten times as many as those have that end with a plan


@dataclass(frozen=True)
class Pbs:
    """Priority-based search with the robots' real motion."""

    max_nodes: int = option(20_000, "nodes of the search tree at most")
    step_length_s: float = option(0.1, "step of the simulation that drives the plan")

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "drivable, not complete"
    supports: ClassVar[frozenset[str]] = frozenset({"seconds", "effort", "types", "window", "stops"})

    def __post_init__(self) -> None:
        if self.max_nodes < 1:
            raise PlanError(f"max_nodes is {self.max_nodes}, expected 1 or more")
        if not 0.001 <= self.step_length_s <= 1.0:
            raise PlanError(f"step_length_s is {self.step_length_s}, expected 0.001 to 1")

    def prepare(self) -> None:
        """Compile or load the kernels."""
        from planners.safe_interval.priority_tree import branched_on
        from planners.safe_interval.real_motion import PrioritisedRuns
        from planners.safe_interval.window_motion import WindowSteps
        from planners.world import small_problem

        nobody = np.zeros((2, 2), np.bool_)
        runs, steps = PrioritisedRuns(small_problem(), self.step_length_s), WindowSteps(replace(small_problem(), window_steps=4))
        branched_on((0, 1), runs.alone(), nobody, runs.replanned)
        runs.branched(runs.alone(), nobody)
        runs.plan(runs.alone())
        paths = steps.alone()
        assert paths is not None
        steps.branched(paths, nobody)
        steps.plan(paths)
        steps.mended(np.inf)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`. GAVE_UP when the tree is searched, or has `max_nodes`."""
        from planners.safe_interval.priority_tree import search
        from planners.safe_interval.real_motion import PrioritisedRuns
        from planners.safe_interval.window_motion import WindowSteps

        began, deadline_s = process_time(), deadline_of(time_limit_s)
        if refusal := impossible(problem):
            return refusal
        if not problem.num_robots:
            return PlanResult(Status.SOLVED, plan_of_paths([], problem.step_s), planning_time_s=process_time() - began)
        if problem.window_steps:
            tree = replace(problem, effort=-(-problem.effort // 2))  # the other half is for mending
            steps = WindowSteps(problem.for_any())
            result = search(steps, tree, began, deadline_s, min(self.max_nodes, WINDOW_NODES + NODES_A_ROBOT * problem.num_robots))
            return result if result.plan is not None else _mended(steps, problem, result, began, deadline_s)
        return search(PrioritisedRuns(problem, self.step_length_s), problem, began, deadline_s, self.max_nodes)


def _mended(steps: "WindowSteps", problem: Problem, tree: PlanResult, began: float, deadline_s: float) -> PlanResult:
    """A plan for a window in which no order of the tree has one, or the result of the tree where nobody can get on."""
    paths = steps.mended(deadline_s) or steps.waited()
    stats = {**tree.stats, **steps.counters()}
    if paths is None:
        message = f"no plan within an effort of {problem.effort} labels" if problem.effort else tree.message
        return replace(tree, planning_time_s=process_time() - began, stats=stats, message=message)
    plan, costs = steps.plan(paths)
    stats |= {"mended": 1.0, **steps.counters(), **costs}
    return replace(tree, status=Status.SOLVED, plan=plan, planning_time_s=process_time() - began, stats=stats, message="")
