"""Explicit estimation conflict-based search. Guarantee: sum of costs at most w times the optimum.

Source: Li, Ruml, Koenig, "EECBS: a bounded-suboptimal search for multi-agent path finding", AAAI 2021: nodes are
chosen by an estimate of the cost of a solution below them, learned while searching from what a step costs and
how many conflicts it ends (section 4); bypass, prioritised conflicts and symmetries on top (section 5). The WDG
heuristic, which needs shortest paths, serves the lower bound in a tree of its own: when nothing is cheap enough
to be chosen, a step of optimal CBS alternates with the paper's expansion of the node of least bound.

An addition to the paper, `incumbent`: when the tree has not answered within several times the work of its root, a
plan is looked for by MAPF-LNS2 too, in turns of counted work. Once it costs at most w times the tree's lower bound, the
tree has as much work again for an answer of its own, while large neighbourhood search betters the plan; it is the answer
when that time is over, or as soon as it costs no more than the node that the tree would expand.
"""

from dataclasses import dataclass
from typing import ClassVar

from mrp_sumo.core.plan import PlanResult
from mrp_sumo.core.problem import Problem
from planners.parameters import check_tree


@dataclass(frozen=True)
class Eecbs:
    """Explicit estimation CBS: the planner of choice when nearly optimal is good enough."""

    w: float = 1.2  # how many times the optimum a plan may cost
    symmetries: bool = True  # rectangles, corridors, targets
    bypass: bool = True  # take a path with fewer conflicts, within the bound, instead of splitting
    following: bool = False  # following conflicts count too; there is no incumbent then
    memory_mb: int = 4000  # for tables and nodes; beyond it gives up
    incumbent: bool = True  # look for a plan by large neighbourhood search too; without, the search is the paper's alone

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "w-bounded"
    supports: ClassVar[frozenset[str]] = frozenset({"effort"})

    def __post_init__(self) -> None:
        check_tree(self.memory_mb, self.w)

    def prepare(self) -> None:
        """See `Planner`."""
        from planners.conflict_based.warm import warm
        from planners.neighbourhood.refinement import prepare

        warm(self)
        prepare(1)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`."""
        from planners.conflict_based.explicit_estimation import ExplicitEstimation
        from planners.conflict_based.frame import search

        return search(
            self,
            problem,
            time_limit_s,
            lambda forest: ExplicitEstimation(forest, self.w, bypass=self.bypass, incumbent=self.incumbent and not self.following),
            w=self.w,
        )
