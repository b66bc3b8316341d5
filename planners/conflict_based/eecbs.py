"""Explicit estimation conflict-based search. Guarantee: sum of costs at most w times the optimum.

Source: Li, Ruml, Koenig, "EECBS: a bounded-suboptimal search for multi-agent path finding", AAAI 2021: nodes are
chosen by an estimate of the cost of a solution below them, learned while searching from what a step costs and
how many conflicts it ends (section 4); bypass, prioritised conflicts and symmetries on top (section 5). The WDG
heuristic, which needs shortest paths, serves the lower bound in a tree of its own: when nothing is cheap enough
to be chosen, a step of optimal CBS alternates with the paper's expansion of the node of least bound.

An addition to the paper, `incumbent`: when the tree has not answered within a few times the work of its root, a
plan is looked for by MAPF-LNS2 and large neighbourhood search too, in turns of counted work. The tree's lower bound
tells whether it is good enough: a plan of at most w times the bound is an answer, wherever it comes from.
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

LABELS = 2  # of the incumbent for each unit of the tree's work
ROOTS = 3  # the incumbent's first turn comes when the tree has done this many times the work of its root


@dataclass(frozen=True)
class Eecbs:
    """The planner of choice when nearly optimal is good enough."""

    w: float = 1.2
    symmetries: bool = True  # rectangles, corridors, targets
    bypass: bool = True
    following: bool = False  # following conflicts count too; there is no incumbent then
    memory_mb: int = 4000  # for tables and nodes; beyond it gives up
    incumbent: bool = True  # look for a plan by large neighbourhood search too; without, the search is the paper's alone

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "w-bounded"

    def __post_init__(self) -> None:
        if not 1 <= self.w < float("inf"):
            raise PlanError(f"w is {self.w}, expected a finite number of 1 or more")
        if self.memory_mb < 1:
            raise PlanError(f"memory_mb is {self.memory_mb}, expected 1 or more")

    def prepare(self) -> None:
        """See `Planner`."""
        from planners.conflict_based import _incumbent
        from planners.conflict_based._warm import warm

        warm(self)
        _incumbent.prepare()

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`."""
        from planners.conflict_based._incumbent import Incumbent
        from planners.conflict_based._tree import OutOfReach, Tree, limits

        began = perf_counter()
        limit = limits(time_limit_s, self.memory_mb)
        if refusal := impossible(problem):
            return refusal
        tree = Tree(problem, limit, following=self.following, symmetries=self.symmetries)
        nodes = _Open(self.w, _Bound(tree))
        nodes.lower = tree.least
        paths, from_incumbent, expanded = None, False, 0
        other = Incumbent(problem, tree.world.distance, limit.deadline) if self.incumbent and not self.following else None
        turn = 0  # work of the tree at which the incumbent's turn comes
        status, message = Status.SOLVED, ""
        try:
            if root := tree.root(self.w):
                nodes.insert(root)
            turn = max(ROOTS * tree.work, other.entry if other else 0)
            while True:
                tree.check_clock()
                if other and tree.work >= turn:
                    turn = 2 * tree.work
                    other.work(LABELS * tree.work, self.w * nodes.lower)
                node = nodes.select()
                if other and other.cost is not None and other.cost <= self.w * nodes.lower + 1e-9:
                    paths, from_incumbent = other.paths(), True
                    break
                if node is None:
                    status, message = Status.INFEASIBLE, "no plan exists: every way to end the conflicts fails"
                    break
                if not len(node.conflicts) and node.cost <= self.w * nodes.lower + 1e-9:
                    paths = tree.paths(node)
                    break
                expanded += 1
                children = tree.children(node, self.w, nodes.lower, bypass=self.bypass)
                nodes.learn(node, children)
                for child in children:
                    nodes.insert(child)
        except OutOfReach as reached:
            status, message = reached.status, str(reached)
        return PlanResult(
            status,
            plan=plan_of_paths(paths, problem.step_s) if paths is not None else None,
            planning_time_s=perf_counter() - began,
            lower_bound_steps=float(nodes.lower),
            stats={
                "expanded": expanded,
                "generated": tree.generated,
                "low_level_expansions": tree.expansions,
                "chosen_for_bound": nodes.chosen_for_bound,
                "from_incumbent": float(from_incumbent),
                **(other.counters() if other else {}),
            },
            message=message,
        )


class _Bound:
    """A lower bound by conflict-based search with shortest paths and WDG, a node a call."""

    def __init__(self, tree) -> None:
        self._like = tree
        self._number = count()
        self._tree, self._open = None, []
        self.lower = 0

    def improve(self) -> None:
        """Expand the node of least cost; the next one's is a lower bound of all solutions."""
        if self._tree is None:
            self._tree = self._like.again()
            if root := self._tree.root():
                self._insert(root)
        while self._open:
            f, _, _, node = self._open[0]
            self.lower = max(self.lower, f)
            if not len(node.conflicts):
                return
            heappop(self._open)
            if not node.looked_at:
                node.looked_at = True
                node.h = max(node.h, self._tree.heuristic(node))
                self._insert(node)
                continue
            for child in self._tree.children(node):
                child.h = max(0, node.f - child.cost)
                self._insert(child)
            return

    def _insert(self, node) -> None:
        heappush(self._open, (node.f, len(node.conflicts), -next(self._number), node))


class _Open:
    """The open nodes in the paper's three orders: CLEANUP by bound, OPEN by estimate, FOCAL by number of conflicts."""

    def __init__(self, w: float, bound: _Bound) -> None:
        self.w = w
        self._bound = bound
        self.lower = 0
        self.chosen_for_bound = 0
        self._number = count()
        self._cleanup, self._open, self._beyond, self._focal = [], [], [], []
        self._closed = set()
        self._num_steps, self._distance_error, self._cost_error = 0, 0.0, 0.0

    def insert(self, node) -> None:
        """Add a node; its estimate is made with what is known now."""
        serial = next(self._number)
        distance = len(node.conflicts)
        estimate = node.cost + distance * self._cost_of_a_conflict()
        estimate = max(estimate, node.bound + node.h)
        heappush(self._cleanup, (node.bound + node.h, distance, serial, node))
        heappush(self._open, (estimate, distance, serial, node))
        heappush(self._beyond, (estimate, distance, serial, node))

    def select(self):
        """Take the next node to expand (section 4.1), None when there is none."""
        for heap in (self._cleanup, self._open):
            while heap and heap[0][2] in self._closed:
                heappop(heap)
        if not self._cleanup:
            return None
        self.lower = max(self.lower, self._cleanup[0][0], self._bound.lower)
        limit = self.w * self.lower + 1e-9
        reach = self.w * self._open[0][0] + 1e-9
        while self._beyond and self._beyond[0][0] <= reach:
            estimate, distance, serial, node = heappop(self._beyond)
            if serial not in self._closed:
                heappush(self._focal, (distance, estimate, serial, node))
        while self._focal and (self._focal[0][2] in self._closed or self._focal[0][1] > reach):
            distance, estimate, serial, node = heappop(self._focal)
            if serial not in self._closed:
                heappush(self._beyond, (estimate, distance, serial, node))
        if not (self._focal and self._focal[0][3].cost <= limit) and self._open[0][3].cost > limit:
            self._bound.improve()
            self.lower = max(self.lower, self._bound.lower)
            limit = self.w * self.lower + 1e-9
        if self._focal and self._focal[0][3].cost <= limit:
            _, _, serial, node = heappop(self._focal)
        elif self._open[0][3].cost <= limit:
            _, _, serial, node = heappop(self._open)
        else:
            _, _, serial, node = heappop(self._cleanup)
            self.chosen_for_bound += 1
        self._closed.add(serial)
        return node

    def learn(self, node, children) -> None:
        """One-step errors from a node to its best child (section 4.2)."""
        if not children:
            return
        best = min(children, key=lambda c: (c.cost + len(c.conflicts), len(c.conflicts)))
        self._num_steps += 1
        self._distance_error += (len(best.conflicts) - (len(node.conflicts) - 1) - self._distance_error) / self._num_steps
        self._cost_error += (best.cost - node.cost - self._cost_error) / self._num_steps

    def _cost_of_a_conflict(self) -> float:
        if self._distance_error >= 1:
            return max(0.0, self._cost_error) * 100
        return max(0.0, self._cost_error) / (1 - self._distance_error)
