"""Conflict-based search. Guarantee: optimal sum of costs.

Sources: Sharon, Stern, Felner, Sturtevant, "Conflict-based search for optimal multi-agent pathfinding", AIJ 2015;
prioritised conflicts and bypass: Boyarski et al., "ICBS", IJCAI 2015; the WDG heuristic: Li et al., IJCAI 2019;
symmetries: Li et al., AIJ 2021, and mutex propagation: Zhang et al., AIJ 2022; disjoint splitting: Li et al., ICAPS 2019;
an order of splits that minds f: Boyarski et al., "f-aware conflict prioritization & improved heuristics for conflict-based search",
AAAI 2021, here by pseudo-costs; clusters: Shen et al., "Beyond pairwise reasoning in multi-agent path finding", ICAPS 2023.

With task assignment: Hönig, Kiesel, Tinka, Durham, Ayanian, "Conflict-based search with optimal task assignment", AAMAS 2018: a
forest, with a root for each assignment, the next-best one made when a root is taken. Here a root waits as the
cost of its assignment alone until it is taken.
"""

from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from typing import ClassVar

from planners.conflict_based.clusters import find_cluster
from planners.conflict_based.frame import Forest, OpenNodes, TreePlanner
from planners.conflict_based.tree import ConflictNode


@dataclass(frozen=True)
class CbsTa(TreePlanner):
    """Conflict-based search with task assignment: assigns and plans at once."""

    heuristic: bool = True  # WDG, weighted pairwise dependencies: what each pair in conflict will cost more
    bypass: bool = True  # take a path of equal cost with fewer conflicts instead of splitting

    assigns: ClassVar[bool] = True
    guarantee: ClassVar[str] = "optimal with assignment"

    def open_nodes(self, forest: Forest) -> OpenNodes:
        """See `TreePlanner`."""
        return BestFirst(forest, heuristic=self.heuristic, bypass=self.bypass)


@dataclass(frozen=True)
class Cbs(CbsTa):
    """Conflict-based search, with improvements that can be switched off.

    Nodes are expanded best first by cost plus heuristic; each expansion splits on a conflict.
    """

    disjoint: bool = False  # split into a constraint that forbids and one that demands, for one robot

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "optimal"
    supports: ClassVar[frozenset[str]] = frozenset({"effort"})

    def open_nodes(self, forest: Forest) -> OpenNodes:
        """See `TreePlanner`."""
        return BestFirst(forest, heuristic=self.heuristic, bypass=self.bypass, disjoint=self.disjoint)


class BestFirst:
    """OPEN: best first by f = g + h, g the cost and h the WDG heuristic, among equals the fewest conflicts.

    h is looked up when a node is taken out, which is put back where that makes it worse.
    """

    def __init__(self, forest: Forest, *, heuristic: bool, bypass: bool, disjoint: bool = False) -> None:
        self.lower = 0.0
        self._forest = forest
        self._heuristic, self._bypass, self._disjoint = heuristic, bypass, disjoint
        self._number = count()
        self._open: list[tuple[int, int, int, ConflictNode]] = []  # (f, conflicts, newest first, node)

    def select(self) -> ConflictNode | None:
        """See `OpenNodes`. A root is made when no node is better than its assignment."""
        while True:
            self._forest.check_clock()
            next_cost = self._forest.next_cost
            if next_cost is not None and (not self._open or self._open[0][0] > next_cost):
                self.lower = max(self.lower, next_cost)
                if root := self._forest.plant():
                    self._insert(root)
                continue
            if not self._open:
                return None
            f, _, _, node = heappop(self._open)
            self.lower = max(self.lower, float(f))
            if not self._heuristic or not len(node.conflicts):
                return node
            node.tree.look_at(node)
            if node.f <= f:
                return node
            self._insert(node)

    def expand(self, node: ConflictNode) -> None:
        """See `OpenNodes`. No solution below a child costs less than below its parent."""
        children = node.tree.children(node, bypass=self._bypass, disjoint=self._disjoint)
        if self._heuristic and node.tree.is_hard:
            node.tree.learn(node, children)
            stays = node.split_on is not None and any(child.f == node.f for child in children)
            if stays and find_cluster(node, bypass=self._bypass):
                node.tree.look_at(node)
        for child in children:
            child.h = max(child.h, node.f - child.cost)
            self._insert(child)

    def counters(self) -> dict[str, float]:
        """See `OpenNodes`."""
        return {}

    def _insert(self, node: ConflictNode) -> None:
        heappush(self._open, (node.f, len(node.conflicts), -next(self._number), node))
