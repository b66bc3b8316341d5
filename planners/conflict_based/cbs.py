"""Conflict-based search. Guarantee: optimal sum of costs.

Sources: Sharon, Stern, Felner, Sturtevant, "Conflict-based search for optimal multi-agent pathfinding", AIJ 2015;
prioritised conflicts and bypass: Boyarski et al., "ICBS", IJCAI 2015; the WDG heuristic: Li et al., IJCAI 2019;
symmetries: Li et al., AIJ 2021; disjoint splitting: Li et al., ICAPS 2019.
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
class Cbs:
    """Best first by cost plus heuristic; each expansion splits on a conflict. Options switch the improvements off."""

    heuristic: bool = True  # WDG: what pairs in conflict cost more
    symmetries: bool = True  # rectangles, corridors, targets
    bypass: bool = True
    disjoint: bool = False
    following: bool = False  # following conflicts count too
    memory_mb: int = 4000  # for tables and nodes; beyond it gives up

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "optimal"

    def __post_init__(self) -> None:
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
        open_nodes: list[tuple[int, int, int, Node]] = []

        def insert(node: Node) -> None:
            heappush(open_nodes, (node.f, len(node.conflicts), -next(number), node))

        status, message = Status.SOLVED, ""
        try:
            if root := tree.root():
                lower = max(lower, root.cost)
                insert(root)
            while open_nodes:
                tree.check_clock()
                f, _, _, node = heappop(open_nodes)
                lower = max(lower, f)
                if not len(node.conflicts):
                    best = node
                    break
                if self.heuristic and not node.looked_at:
                    node.looked_at = True
                    node.h = max(node.h, tree.heuristic(node))
                    if node.f > f:
                        insert(node)
                        continue
                expanded += 1
                for child in tree.children(node, bypass=self.bypass, disjoint=self.disjoint):
                    child.h = max(0, node.f - child.cost)
                    insert(child)
            if best is None:
                status, message = Status.INFEASIBLE, "no plan exists: every way to end the conflicts fails"
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
