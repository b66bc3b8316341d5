"""The frame of all conflict-based planners: parameters, constraint trees, the loop, the result. A planner's own file is its order of nodes.

The trees are a forest with a root for each assignment, from the cheapest up (Hoenig et al., AAMAS 2018); where goals are
assigned already it is a single tree. The next root is made when an order asks for it; until then its cost is a lower bound
of all that it leads to.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from time import process_time
from typing import ClassVar, Protocol

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.options import option
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import goals_clash, impossible
from mrp_sumo.planning.costs import costs_of
from mrp_sumo.search.solvable import unsolvable
from planners.conflict_based._cover import cover
from planners.conflict_based.tree import ConflictNode, OutOfReach, SearchLimits, Tree
from planners.world import small_problem

Paths = list[IntArray]  # [R] the vertex of each robot at each step


class Forest:
    """The trees of a problem; they share their tables."""

    def __init__(
        self, problem: Problem, limits: SearchLimits, *, assigns: bool, following: bool, symmetries: bool, like: Tree | None = None
    ) -> None:
        """`like` is a tree whose tables they are to share, too."""
        self.problem, self.limits, self.assigns = problem, limits, assigns
        self.num_roots = 0
        self._following, self._symmetries = following, symmetries
        self.first: Tree | None = None if assigns else self._tree(problem, like)
        self._assignments = self._ranked() if assigns else iter([(float(self.tree.least), problem)])
        self._next: tuple[float, Problem] | None = None
        self._asked = False

    @property
    def tree(self) -> Tree:
        """The first tree; there is one from the start where goals are assigned."""
        assert self.first is not None
        return self.first

    def again(self) -> "Forest":
        """Another one of the same problem with its assignment, in the same room."""
        following, symmetries = self._following, self._symmetries
        return Forest(self.problem, self.limits, assigns=False, following=following, symmetries=symmetries, like=self.tree)

    @property
    def next_cost(self) -> float | None:
        """Cost of the cheapest assignment without a root, whatever robots stand in each other's way; None when all have one."""
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
            tree = self._tree(problem, self.first)
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

    def _tree(self, problem: Problem, like: Tree | None) -> Tree:
        return Tree(problem, self.limits, following=self._following, symmetries=self._symmetries, like=like)

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
        """Statistics that the order adds to the result."""


@dataclass(frozen=True)
class TreePlanner(ABC):
    """A planner that expands the nodes of constraint trees, in an order of its own."""

    symmetries: bool = option(True, "resolve rectangle, corridor and target conflicts by one split each")
    following: bool = option(False, "also forbid entering a vertex in the step in which another robot leaves it")
    memory_mb: int = option(4000, "limit for tables and nodes; beyond it a planner gives up or keeps the plan it has")

    assigns: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not 1 <= self.factor < math.inf:
            raise PlanError(f"w is {self.factor}, expected a finite number of 1 or more")
        if self.memory_mb < 1:
            raise PlanError(f"memory_mb is {self.memory_mb}, expected 1 or more")

    @property
    def factor(self) -> float:
        """Factor on the optimum that a plan may cost."""
        return 1.0

    @abstractmethod
    def open_nodes(self, forest: Forest) -> OpenNodes:
        """The open nodes of a forest, in this planner's order."""

    def prepare(self) -> None:
        """Compile or load the kernels: plan a swap beside a siding, and take every step of a tree on it."""
        problem = small_problem()
        self.plan(problem, math.inf)
        tree = Tree(problem, SearchLimits(math.inf, 1000))
        root = tree.root()
        assert root is not None
        tree.heuristic(root)
        chosen = tree.choose(root)
        children = tree.split(root, chosen)
        tree.split(root, chosen, disjoint=True)
        tree.adopt(root, children[0])
        cover(3, np.array([0, 2, 4]), np.array([0, 1, 1, 2]), np.array([1, 1]))
        unsolvable(problem, tree.instance.clashes, tree.instance.spots)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """Expand nodes in order, until one without conflicts costs at most `factor` times the lower bound.

        Where it `assigns` and goals are not assigned, every assignment of them will do; in a window, only conflicts within it are resolved.
        """
        began = process_time()
        assigns = self.assigns and not problem.is_assigned  # goals that are given are kept
        limit = SearchLimits(time_limit_s, self.memory_mb, problem.effort)
        try:
            if refusal := goals_clash(problem) if assigns else impossible(problem, limit.check):
                return refusal
            forest = Forest(problem, limit, assigns=assigns, following=self.following, symmetries=self.symmetries)
        except OutOfReach as reached:
            return PlanResult(reached.status, planning_time_s=process_time() - began, message=str(reached))
        nodes, expanded = self.open_nodes(forest), 0
        paths: Paths | None = None
        goal_of: IntArray | None = None
        status, message = Status.SOLVED, ""
        try:
            while paths is None:
                node = nodes.select()
                if node is None:
                    why = "for any assignment of the goals" if assigns else ": every way to end the conflicts fails"
                    status, message = Status.INFEASIBLE, f"no plan exists{' ' if assigns else ''}{why}"
                    break
                if isinstance(node, list):
                    paths = node
                elif not len(node.conflicts) and node.cost <= self.factor * nodes.lower + 1e-9 and not node.tree.ring(node):
                    paths, goal_of = node.tree.paths(node), node.tree.problem.goal_of
                else:
                    expanded += 1
                    nodes.expand(node)
        except OutOfReach as reached:
            status, message = reached.status, str(reached)
        if paths is not None and problem.window_steps:
            paths = [path[: problem.window_steps + 1] for path in paths]  # beyond, robots are not kept apart
        counted = {"roots": forest.num_roots} if assigns else {"generated": forest.tree.generated}
        low_level = forest.first.expansions if forest.first else 0
        return PlanResult(
            status,
            plan=plan_of_paths(paths, problem.step_s) if paths is not None else None,
            goal_of=goal_of if assigns else None,
            planning_time_s=process_time() - began,
            lower_bound_steps=float(nodes.lower),
            stats={"expanded": expanded, **counted, "low_level_expansions": low_level, **nodes.counters()},
            message=message,
        )


def ranked_assignments(cost: FloatArray, check_clock: Callable[[], None] = lambda: None) -> Iterator[tuple[float, IntArray]]:
    """All assignments that serve min(R, G) goals, cheapest first: the sum, and [R] the goal of each robot, -1 for none.

    `cost` is [R, G], inf where a robot cannot reach a goal; `check_clock` is called now and then, and may raise to give up.

    Source: Murty, "An algorithm for ranking all the assignments in order of increasing cost", Operations Research 1968: the assignments
    other than the best are partitioned by the first robot that differs, and each part's best is the next candidate.
    """
    from scipy.optimize import linear_sum_assignment

    num_robots, num_goals = cost.shape
    spare = np.zeros((num_robots, max(0, num_robots - num_goals)))  # goals that stand for none
    square = np.hstack([np.asarray(cost, np.float64), spare])
    finite = np.isfinite(square)
    never = float(np.abs(square[finite]).max(initial=0) + 1) * (num_robots + 1)
    square = np.where(finite, square, never)
    robots = np.arange(num_robots)
    number = 0
    queue: list[tuple[float, int, IntArray, FloatArray, int]] = []

    def consider(matrix: FloatArray, fixed: int) -> None:
        nonlocal number
        choice = linear_sum_assignment(matrix)[1]
        chosen = matrix[robots, choice]
        if (chosen < never).all():
            number += 1
            heappush(queue, (float(chosen.sum()), number, choice, matrix, fixed))

    check_clock()
    consider(square, 0)
    seen: set[bytes] = set()
    while queue:
        total, _, choice, matrix, fixed = heappop(queue)
        goal_of = np.where(choice < num_goals, choice, -1).astype(np.int64)
        if goal_of.tobytes() not in seen:  # they differ in which spare goal a robot without a goal has
            seen.add(goal_of.tobytes())
            yield total, goal_of
        rest = matrix
        for robot in range(fixed, num_robots):
            check_clock()
            part = rest.copy()
            part[robot, choice[robot]] = never
            consider(part, robot)
            rest = rest.copy()  # from here on the robot keeps its goal
            before = rest[robot, choice[robot]]
            rest[robot] = never
            rest[:, choice[robot]] = never
            rest[robot, choice[robot]] = before
