"""Enhanced conflict-based search. Guarantee: sum of costs at most w times the optimum.

Source: Barer, Sharon, Stern, Felner, "Suboptimal variants of the conflict-based search algorithm for the multi-agent
pathfinding problem", SoCS 2014: focal search on both levels, guided by the number of conflicts. Splits are chosen
as in CBS (prioritised conflicts, symmetries; see `planners/conflict_based/cbs.py`).

With task assignment: Hönig, Kiesel, Tinka, Durham, Ayanian, "Conflict-based search with optimal task assignment", AAMAS 2018,
section 4: the focal search of ECBS over a forest with a root for each assignment. The next-best assignment is
looked up when a root is expanded, or when nothing else is within the bound; until its root is made, its cost
alone takes part in the lower bound.
"""

from dataclasses import dataclass
from typing import ClassVar

from mrp_sumo.core.plan import PlanResult
from mrp_sumo.core.problem import Problem
from planners.parameters import check_tree


@dataclass(frozen=True)
class Ecbs:
    """Enhanced CBS: cost at most `w` times the optimum.

    Among nodes that cost at most w times the least lower bound, the one with the fewest conflicts is expanded.
    """

    w: float = 1.2  # how many times the optimum a plan may cost
    symmetries: bool = True  # rectangles, corridors, targets
    following: bool = False  # following conflicts count too
    memory_mb: int = 4000  # for tables and nodes; beyond it gives up

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "w-bounded"
    supports: ClassVar[frozenset[str]] = frozenset({"effort", "window"})

    def __post_init__(self) -> None:
        check_tree(self.memory_mb, self.w)

    def prepare(self) -> None:
        """See `Planner`."""
        from planners.conflict_based.warm import warm

        warm(self)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`."""
        from planners.conflict_based.focal import Focal
        from planners.conflict_based.frame import search

        return search(self, problem, time_limit_s, lambda forest: Focal(forest, self.w), w=self.w)


@dataclass(frozen=True)
class EcbsTa:
    """Enhanced CBS with task assignment: assigns and plans at once, at most `w` times the optimum."""

    w: float = 1.2  # how many times the optimum a plan may cost
    symmetries: bool = True  # rectangles, corridors, targets
    following: bool = False  # following conflicts count too
    memory_mb: int = 4000  # for tables and nodes; beyond it gives up

    assigns: ClassVar[bool] = True
    guarantee: ClassVar[str] = "w-bounded with assignment"

    def __post_init__(self) -> None:
        check_tree(self.memory_mb, self.w)

    def prepare(self) -> None:
        """See `Planner`."""
        from planners.conflict_based.warm import warm

        warm(self)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`."""
        from planners.conflict_based.focal import Focal
        from planners.conflict_based.frame import search

        return search(self, problem, time_limit_s, lambda forest: Focal(forest, self.w), w=self.w)
