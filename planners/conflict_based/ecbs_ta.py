"""Enhanced conflict-based search with task assignment. Guarantee: at most w times the optimum over all assignments.

Source: Hönig, Kiesel, Tinka, Durham, Ayanian, "Conflict-based search with optimal task assignment", AAMAS 2018,
section 4: the focal search of ECBS over a forest with a root for each assignment. The next-best assignment is
looked up when a root is expanded, or when nothing else is within the bound; until its root is made, its cost
alone takes part in the lower bound.
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


@dataclass(frozen=True)
class EcbsTa:
    """Assigns and plans at once, within w of the best."""

    w: float = 1.2
    symmetries: bool = True  # rectangles, corridors, targets
    following: bool = False  # following conflicts count too
    memory_mb: int = 4000  # for tables and nodes; beyond it gives up

    assigns: ClassVar[bool] = True
    guarantee: ClassVar[str] = "w-bounded with assignment"

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
        if clash := goals_clash(problem):
            return clash
        number = count()
        best, expanded, roots, lower = None, 0, 0, 0.0
        first: Tree | None = None
        by_bound: list[tuple[int, int]] = []
        focal: list[tuple[int, int, int, Node, Tree, Problem]] = []
        beyond: list[tuple[int, int, Node, Tree, Problem]] = []
        closed = set()

        def insert(node: Node, tree: Tree, assigned: Problem) -> None:
            serial = next(number)
            heappush(by_bound, (node.bound, serial))
            heappush(beyond, (node.cost, serial, node, tree, assigned))

        status, message = Status.SOLVED, ""
        try:
            matrix = cost_matrix(problem.graph, problem.start, problem.goal, "path", limit.check)
            ranked = ranked_assignments(matrix, limit.check)
            waiting = next(ranked, None)  # the assignment whose root comes next
            while True:
                limit.check()
                while by_bound and by_bound[0][1] in closed:
                    heappop(by_bound)
                if not by_bound and waiting is None:
                    status, message = Status.INFEASIBLE, "no plan exists for any assignment of the goals"
                    break
                lower = max(lower, min(([by_bound[0][0]] if by_bound else []) + ([waiting[0]] if waiting else [])))
                while beyond and beyond[0][0] <= self.w * lower + 1e-9:
                    cost, serial, node, tree, assigned = heappop(beyond)
                    heappush(focal, (len(node.conflicts), cost, serial, node, tree, assigned))
                root_expanded = False
                if focal:
                    _, _, serial, node, tree, assigned = heappop(focal)
                    closed.add(serial)
                    if not len(node.conflicts):
                        best = node, tree, assigned
                        break
                    expanded += 1
                    root_expanded = node.depth == 0
                    for child in tree.children(node, self.w, bypass=False):
                        insert(child, tree, assigned)
                if waiting and (root_expanded or not focal):
                    assigned = problem.assigned(waiting[1])
                    waiting = next(ranked, None)
                    if impossible(assigned) is None:
                        tree = Tree(assigned, limit, following=self.following, symmetries=self.symmetries, like=first)
                        first = first or tree
                        roots += 1
                        if root := tree.root(self.w):
                            insert(root, tree, assigned)
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
