"""Conflict-based search with task assignment. Guarantee: optimal sum of costs over all assignments.

Source: Hönig, Kiesel, Tinka, Durham, Ayanian, "Conflict-based search with optimal task assignment", AAMAS 2018: a
forest, with a root for each assignment, the next-best one made when a root is taken. Here a root waits as the
cost of its assignment alone until it is taken. Within a tree as in `planners/conflict_based/cbs.py`.
"""

from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from time import perf_counter
from typing import ClassVar

from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import goals_clash, impossible
from mrp_sumo.planning.costs import cost_matrix
from mrp_sumo.planning.ranking import ranked_assignments

LAST = 1 << 30


@dataclass(frozen=True)
class CbsTa:
    """Assigns and plans at once."""

    heuristic: bool = True  # WDG: what pairs in conflict cost more
    symmetries: bool = True  # rectangles, corridors, targets
    bypass: bool = True
    following: bool = False  # following conflicts count too
    memory_mb: int = 4000  # for tables and nodes; beyond it gives up

    assigns: ClassVar[bool] = True
    guarantee: ClassVar[str] = "optimal with assignment"

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
        if clash := goals_clash(problem):
            return clash
        number = count()
        best, expanded, roots, lower = None, 0, 0, 0.0
        first: Tree | None = None
        # (f, conflicts, serial, node, its tree, its assignment); a root to be made comes last among equals and has no node
        open_nodes: list[tuple[float, int, int, Node | None, Tree | None, Problem | None]] = []

        def insert(node: Node, tree: Tree, assigned: Problem) -> None:
            heappush(open_nodes, (node.f, len(node.conflicts), -next(number), node, tree, assigned))

        def await_next() -> None:
            if following := next(ranked, None):
                heappush(open_nodes, (following[0], LAST, -next(number), None, None, problem.assigned(following[1])))

        status, message = Status.SOLVED, ""
        try:
            cost = cost_matrix(problem.graph, problem.start, problem.goal, "path", limit.check)
            ranked = ranked_assignments(cost, limit.check)
            await_next()
            while open_nodes:
                f, _, _, node, tree, assigned = heappop(open_nodes)
                lower = max(lower, f)
                if node is None:
                    limit.check()
                    await_next()
                    if impossible(assigned) is None:
                        tree = Tree(assigned, limit, following=self.following, symmetries=self.symmetries, like=first)
                        first = first or tree
                        roots += 1
                        if root := tree.root():
                            insert(root, tree, assigned)
                    continue
                tree.check_clock()
                if not len(node.conflicts):
                    best = node, tree, assigned
                    break
                if self.heuristic and not node.looked_at:
                    node.looked_at = True
                    node.h = max(node.h, tree.heuristic(node))
                    if node.f > f:
                        insert(node, tree, assigned)
                        continue
                expanded += 1
                for child in tree.children(node, bypass=self.bypass):
                    child.h = max(0, node.f - child.cost)
                    insert(child, tree, assigned)
            if best is None:
                status, message = Status.INFEASIBLE, "no plan exists for any assignment of the goals"
        except OutOfReach as reached:
            status, message = reached.status, str(reached)
        return PlanResult(
            status,
            plan=plan_of_paths(best[1].paths(best[0]), problem.step_s) if best else None,
            goal_of=best[2].goal_of if best else None,
            planning_time_s=perf_counter() - began,
            lower_bound_steps=float(lower),
            stats={"expanded": expanded, "roots": roots, "low_level_expansions": first.expansions if first else 0},
            message=message,
        )
