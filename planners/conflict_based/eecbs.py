"""Explicit estimation conflict-based search. Guarantee: sum of costs at most w times the optimum.

Source: Li, Ruml, Koenig, "EECBS: a bounded-suboptimal search for multi-agent path finding", AAAI 2021: nodes are
chosen by an estimate of the cost of a solution below them, learned while searching from what a step costs and
how many conflicts it ends (section 4); bypass, prioritised conflicts and symmetries on top (section 5). The WDG
heuristic, which needs shortest paths, serves the lower bound in a tree of its own: when nothing is cheap enough
to be chosen, a step of optimal CBS alternates with the paper's expansion of the node of least bound.

An addition to the paper, `incumbent`: when the tree has not answered within several times the work of its root, a
plan is looked for by MAPF-LNS2 too, in turns of counted work. Once it costs at most w times the tree's lower bound, the
tree has as much work again for an answer of its own, while large neighbourhood search betters the plan; it is the answer
when that time is over, or as soon as it costs no more than the node that the tree would expand; in either case it is polished before.
"""

from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from typing import ClassVar

from mrp_sumo.core.options import option
from planners.conflict_based.best_first import BestFirst
from planners.conflict_based.frame import Forest, OpenNodes, Paths, TreePlanner
from planners.conflict_based.incumbent import Incumbent
from planners.conflict_based.tree import ConflictNode, OutOfReach
from planners.neighbourhood.refinement import prepare

LABELS = 2  # of the incumbent for each unit of the tree's work
ROOTS = 8  # the incumbent's first turn comes when the tree has done this many times the work of its root
PATIENCE = 1  # an incumbent that would do is the answer when the tree has done so many times the work that both did until then
TURNS = 1.1  # until then both do so many times their work, by turns


@dataclass(frozen=True)
class Eecbs(TreePlanner):
    """Explicit estimation CBS: the planner of choice when nearly optimal is good enough."""

    w: float = option(1.2, "allowed cost as a multiple of the optimum, 1 or more")
    bypass: bool = option(True, "replace a node's path by one with fewer conflicts instead of splitting")
    incumbent: bool = option(
        True, "also look for a plan by large neighbourhood search; without, or with `following`, the search is the paper's alone"
    )

    guarantee: ClassVar[str] = "w-bounded"
    supports: ClassVar[frozenset[str]] = frozenset({"effort"})

    @property
    def factor(self) -> float:
        return self.w

    def open_nodes(self, forest: Forest) -> OpenNodes:
        return ExplicitEstimation(forest, self.w, bypass=self.bypass, incumbent=self.incumbent and not self.following)

    def prepare(self) -> None:
        super().prepare()
        prepare(1)


class ExplicitEstimation:
    """CLEANUP by lower bound, OPEN by estimated cost, FOCAL by number of conflicts (section 4); and now and then the incumbent's turn."""

    def __init__(self, forest: Forest, w: float, *, bypass: bool, incumbent: bool) -> None:
        tree = forest.tree
        self.lower = float(tree.least)
        self.chosen_for_bound = 0
        self.from_incumbent = False
        self._forest, self._tree, self._w, self._bypass = forest, tree, w, bypass
        self._bound: BestFirst | None = None  # a search with shortest paths and WDG, which raises the lower bound
        self._is_bound_best = False  # no more than it has been raised
        self._incumbent = Incumbent(forest.problem, tree.instance.distance, forest.limits.deadline_s) if incumbent else None
        self._turn = 0.0  # work of the tree at which the incumbent's turn comes
        self._until = 0  # work of the tree at which the incumbent is the answer; 0 as long as it would not do
        self._number = count()
        self._cleanup: list[tuple[int, int, int, ConflictNode]] = []  # (f, conflicts, serial, node)
        self._open: list[tuple[float, int, int, ConflictNode]] = []  # (f^, conflicts, serial, node)
        self._beyond: list[tuple[float, int, int, ConflictNode]] = []  # those of OPEN that are not in FOCAL
        self._focal: list[tuple[int, float, int, ConflictNode]] = []  # (conflicts, f^, serial, node) with f^ <= w best f^
        self._closed: set[int] = set()
        self._num_steps, self._distance_error, self._cost_error = 0, 0.0, 0.0  # mean one-step errors

    def select(self) -> ConflictNode | Paths | None:
        """See `OpenNodes`."""
        incumbent, tree = self._incumbent, self._tree
        if self._forest.next_cost is not None:
            if root := self._forest.plant(self._w):
                self._insert(root)
            self._turn = max(ROOTS * tree.work, incumbent.entry if incumbent else 0)
        is_over = self._is_over()
        if not is_over:
            tree.check_clock()
        if incumbent and tree.work >= self._turn:
            self._take_turn(incumbent)
        node = self._take_best()
        if (
            incumbent
            and incumbent.cost is not None
            and self._would_do(incumbent)
            and (is_over or node is None or incumbent.cost <= node.cost)
        ):
            incumbent.polish()
            self.from_incumbent = True
            return incumbent.paths()
        return node

    def _take_turn(self, incumbent: Incumbent) -> None:
        """Let the incumbent work: until it would do, then on its cost, too."""
        work = self._tree.work
        if not self._until:
            self._turn = 2 * work
            incumbent.work(LABELS * work, self._w * self.lower)
        if self._would_do(incumbent):
            self._until = self._until or PATIENCE * (work + incumbent.labels // LABELS)
            self._turn = TURNS * work
            incumbent.work(int(TURNS * incumbent.labels), 0.0)

    def _would_do(self, incumbent: Incumbent) -> bool:
        """True if the incumbent's plan is an answer."""
        return incumbent.cost is not None and incumbent.cost <= self._w * self.lower + 1e-9

    def _is_over(self) -> bool:
        """True if there is an incumbent that would do, and the tree has had its time."""
        if not (self._until and self._incumbent and self._would_do(self._incumbent)):
            return False
        try:
            self._tree.check_clock()
        except OutOfReach:
            return True
        return self._tree.work >= self._until

    def expand(self, node: ConflictNode) -> None:
        """See `OpenNodes`."""
        try:
            children = self._tree.children(node, self._w, self.lower, bypass=self._bypass)
        except OutOfReach:
            if self._incumbent and self._would_do(self._incumbent):
                self._until = self._until or 1
                return
            raise
        self._learn(node, children)
        for child in children:
            self._insert(child)

    def counters(self) -> dict[str, float]:
        """For the result's statistics."""
        counted = {"chosen_for_bound": self.chosen_for_bound, "from_incumbent": float(self.from_incumbent)}
        return counted | (self._incumbent.counters() if self._incumbent else {})

    def _insert(self, node: ConflictNode) -> None:
        """Add a node; its estimate is made with what is known now."""
        serial, conflicts = next(self._number), len(node.conflicts)
        estimate = max(node.cost + conflicts * self._cost_of_a_conflict(), node.bound + node.h)
        heappush(self._cleanup, (node.bound + node.h, conflicts, serial, node))
        heappush(self._open, (estimate, conflicts, serial, node))
        heappush(self._beyond, (estimate, conflicts, serial, node))

    def _take_best(self) -> ConflictNode | None:
        """Take the next node to expand (section 4.1), None when there is none."""
        while self._cleanup and self._cleanup[0][2] in self._closed:
            heappop(self._cleanup)
        while self._open and self._open[0][2] in self._closed:
            heappop(self._open)
        if not self._cleanup:
            return None
        self.lower = max(self.lower, self._cleanup[0][0])
        limit = self._w * self.lower + 1e-9
        reach = self._w * self._open[0][0] + 1e-9
        self._move_within(reach)
        if not (self._focal and self._focal[0][3].cost <= limit) and self._open[0][3].cost > limit:
            self._raise_bound()
            limit = self._w * self.lower + 1e-9
        if self._focal and self._focal[0][3].cost <= limit:
            _, _, serial, node = heappop(self._focal)
        elif self._open[0][3].cost <= limit:
            _, _, serial, node = heappop(self._open)
        else:
            _, _, serial, node = heappop(self._cleanup)
            self.chosen_for_bound += 1
        self._closed.add(serial)
        return node

    def _raise_bound(self) -> None:
        """Expand the node of least cost of a search by conflict-based search: the next one's is a lower bound of all solutions."""
        if self._is_bound_best:
            return
        if self._bound is None:
            self._bound = BestFirst(self._forest.again(), heuristic=True, bypass=True, learns=False)
        node = self._bound.select()
        self.lower = max(self.lower, self._bound.lower)
        self._is_bound_best = node is None or not (len(node.conflicts) or node.tree.ring(node))
        if node is not None and not self._is_bound_best:
            self._bound.expand(node)

    def _move_within(self, reach: float) -> None:
        """Let FOCAL hold the open nodes with estimates up to `reach`."""
        while self._beyond and self._beyond[0][0] <= reach:
            estimate, conflicts, serial, node = heappop(self._beyond)
            if serial not in self._closed:
                heappush(self._focal, (conflicts, estimate, serial, node))
        while self._focal and (self._focal[0][2] in self._closed or self._focal[0][1] > reach):
            conflicts, estimate, serial, node = heappop(self._focal)
            if serial not in self._closed:
                heappush(self._beyond, (estimate, conflicts, serial, node))

    def _learn(self, node: ConflictNode, children: list[ConflictNode]) -> None:
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
