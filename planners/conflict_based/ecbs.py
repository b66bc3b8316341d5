"""Enhanced conflict-based search. Guarantee: sum of costs at most w times the optimum.

Source: Barer, Sharon, Stern, Felner, "Suboptimal variants of the conflict-based search algorithm for the multi-agent
pathfinding problem", SoCS 2014: focal search on both levels, guided by the number of conflicts. Splits are chosen
as in CBS (prioritised conflicts, symmetries; see `planners/conflict_based/cbs.py`).
"""

from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from time import perf_counter
from typing import ClassVar

from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import impossible


@dataclass(frozen=True)
class Ecbs:
    """Among nodes that cost at most w times the least lower bound, the one with the fewest conflicts is expanded."""

    w: float = 1.2
    symmetries: bool = True  # rectangles, corridors, targets
    following: bool = False  # following conflicts count too
    memory_mb: int = 4000  # for tables and nodes; beyond it gives up

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "w-bounded"

    def __post_init__(self) -> None:
        if not 1 <= self.w < float("inf"):
            raise PlanError(f"w is {self.w}, expected a finite number of 1 or more")
        if self.memory_mb < 1:
            raise PlanError(f"memory_mb is {self.memory_mb}, expected 1 or more")

    def prepare(self) -> None:
        """See `Planner`."""
        from planners.conflict_based._warm import warm

        warm(self)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`."""
        from planners.conflict_based._tree import Node, OutOfReach, Tree, limits

        began = perf_counter()
        limit = limits(time_limit_s, self.memory_mb)
        if refusal := impossible(problem):
            return refusal
        number = count()
        best, expanded = None, 0
        tree = Tree(problem, limit, following=self.following, symmetries=self.symmetries)
        lower = tree.least
        by_bound: list[tuple[int, int, Node]] = []  # all open nodes, and closed ones not yet noticed
        focal: list[tuple[int, int, int, Node]] = []  # those that cost at most w times the least bound
        beyond: list[tuple[int, int, Node]] = []  # the others
        closed = set()

        def insert(node: Node) -> None:
            serial = next(number)
            heappush(by_bound, (node.bound, serial, node))
            heappush(beyond, (node.cost, serial, node))

        status, message = Status.SOLVED, ""
        try:
            if root := tree.root(self.w):
                lower = max(lower, root.bound)
                insert(root)
            while True:
                tree.check_clock()
                while by_bound and by_bound[0][1] in closed:
                    heappop(by_bound)
                if not by_bound:
                    status, message = Status.INFEASIBLE, "no plan exists: every way to end the conflicts fails"
                    break
                lower = max(lower, by_bound[0][0])
                while beyond and beyond[0][0] <= self.w * lower + 1e-9:
                    cost, serial, node = heappop(beyond)
                    heappush(focal, (len(node.conflicts), cost, serial, node))
                _, _, serial, node = heappop(focal)
                closed.add(serial)
                if not len(node.conflicts):
                    best = node
                    break
                expanded += 1
                for child in tree.children(node, self.w, bypass=False):
                    insert(child)
        except OutOfReach as reached:
            status, message = reached.status, str(reached)
        return PlanResult(
            status,
            plan=plan_of_paths(tree.paths(best), problem.step_s) if best else None,
            planning_time_s=perf_counter() - began,
            lower_bound_steps=float(lower),
            stats={"expanded": expanded, "generated": tree.generated, "low_level_expansions": tree.expansions},
            message=message,
        )
