"""What all conflict-based planners share: constraint trees, the loop, the clock, the result. A planner's own file is its order of nodes.

The trees are a forest with a root for each assignment, from the cheapest up (Hoenig et al., AAMAS 2018); where goals are
assigned already it is a single tree. The next root is made when an order asks for it; until then its cost is a lower bound
of all that it leads to.
"""

from collections.abc import Callable, Iterator
from time import process_time
from typing import Protocol

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.answers import goals_clash, impossible
from mrp_sumo.planning.costs import costs_of
from mrp_sumo.planning.ranking import ranked_assignments
from planners.conflict_based.tree import ConflictNode, OutOfReach, SearchLimits, Tree, limits

Paths = list[IntArray]  # [R] the vertex of each robot at each step


class Forest:
    """The trees of a problem; they share their tables."""

    def __init__(self, problem: Problem, limits: SearchLimits, *, assigns: bool, following: bool, symmetries: bool) -> None:
        self.problem, self.limits, self.assigns = problem, limits, assigns
        self.num_roots = 0
        self._following, self._symmetries = following, symmetries
        self.first: Tree | None = None if assigns else self._tree(problem)
        self._assignments = self._ranked() if assigns else iter([(float(self.tree.least), problem)])
        self._next: tuple[float, Problem] | None = None
        self._asked = False

    @property
    def tree(self) -> Tree:
        """The first tree; there is one from the start where goals are assigned."""
        assert self.first is not None
        return self.first

    @property
    def next_cost(self) -> float | None:
        """What the cheapest assignment without a root costs, whatever robots stand in each other's way; None when all have one."""
        if not self._asked:
            self._next, self._asked = next(self._assignments, None), True
        return None if self._next is None else self._next[0]

    def plant(self, w: float = 1.0) -> ConflictNode | None:
        """The root of the next assignment; None where it has none. See `Tree.root` for w."""
        assert self._next is not None
        problem = self._next[1]
        self._next = next(self._assignments, None)
        if self.assigns:
            if impossible(problem, self.limits.check) is not None:
                return None
            tree = self._tree(problem)
            self.first = self.first or tree
        else:
            tree = self.tree
        self.num_roots += 1
        return tree.root(w)

    def check_clock(self) -> None:
        """Raise OutOfReach when the time is up or memory runs short."""
        if self.first is None:
            self.limits.check()
        else:
            self.first.check_clock()

    def _tree(self, problem: Problem) -> Tree:
        return Tree(problem, self.limits, following=self._following, symmetries=self._symmetries, like=getattr(self, "first", None))

    def _ranked(self) -> Iterator[tuple[float, Problem]]:
        problem = self.problem
        cost = costs_of(problem, "path", self.limits.check)
        for total, goal_of in ranked_assignments(cost, self.limits.check):
            yield total, problem.assigned(goal_of)


class OpenNodes(Protocol):
    """The open nodes of a forest, in a planner's order."""

    lower: float  # steps; no solution costs less

    def select(self) -> ConflictNode | Paths | None:
        """Take out the node that comes next; None when there is none, the paths of a plan where one was found elsewhere."""

    def expand(self, node: ConflictNode) -> None:
        """Split a node and insert its children."""

    def counters(self) -> dict[str, float]:
        """What the order adds to the result's statistics."""


class Face(Protocol):
    """What the search asks of a planner: the parameters that all have."""

    @property
    def assigns(self) -> bool: ...

    @property
    def following(self) -> bool: ...

    @property
    def symmetries(self) -> bool: ...

    @property
    def memory_mb(self) -> int: ...


def search(planner: Face, problem: Problem, time_limit_s: float, order_of: Callable[[Forest], OpenNodes], *, w: float = 1.0) -> PlanResult:
    """Expand nodes in a planner's order, until one without conflicts costs at most w times the lower bound.

    Parameters
    ----------
    planner
        Who asks; where it `assigns` and goals are not assigned, every assignment of them will do.
    problem, time_limit_s
        As `Planner.plan` takes them; in a window, only conflicts within it are resolved.
    order_of
        The order of a forest's nodes.
    w
        The factor.
    """
    began = process_time()
    assigns = planner.assigns and not problem.is_assigned  # goals that are given are kept
    limit = limits(time_limit_s, planner.memory_mb, problem.effort)
    try:
        if refusal := goals_clash(problem) if assigns else impossible(problem, limit.check):
            return refusal
        forest = Forest(problem, limit, assigns=assigns, following=planner.following, symmetries=planner.symmetries)
    except OutOfReach as reached:
        return PlanResult(reached.status, planning_time_s=process_time() - began, message=str(reached))
    order = order_of(forest)
    expanded = 0
    paths: Paths | None = None
    goal_of: IntArray | None = None
    status, message = Status.SOLVED, ""
    try:
        while paths is None:
            node = order.select()
            if node is None:
                why = "for any assignment of the goals" if assigns else ": every way to end the conflicts fails"
                status, message = Status.INFEASIBLE, f"no plan exists{' ' if assigns else ''}{why}"
                break
            if isinstance(node, list):
                paths = node
            elif not len(node.conflicts) and node.cost <= w * order.lower + 1e-9 and not node.tree.ring(node):
                paths, goal_of = node.tree.paths(node), node.tree.problem.goal_of
            else:
                expanded += 1
                order.expand(node)
    except OutOfReach as reached:
        status, message = reached.status, str(reached)
    if paths is not None and problem.window_steps:
        paths = [path[: problem.window_steps + 1] for path in paths]  # beyond, robots are not kept apart
    first = forest.first
    counted = {"roots": forest.num_roots} if assigns else {"generated": forest.tree.generated}
    return PlanResult(
        status,
        plan=plan_of_paths(paths, problem.step_s) if paths is not None else None,
        goal_of=goal_of if assigns else None,
        planning_time_s=process_time() - began,
        lower_bound_steps=float(order.lower),
        stats={"expanded": expanded, **counted, "low_level_expansions": first.expansions if first else 0, **order.counters()},
        message=message,
    )
