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
from heapq import heappop, heappush
from itertools import count
from typing import ClassVar

from mrp_sumo.core.options import option
from planners.conflict_based.frame import Forest, OpenNodes, TreePlanner
from planners.conflict_based.tree import ConflictNode


@dataclass(frozen=True)
class Ecbs(TreePlanner):
    """Enhanced CBS: cost at most `w` times the optimum.

    Among nodes that cost at most w times the least lower bound, the one with the fewest conflicts is expanded.
    """

    w: float = option(1.2, "allowed cost as a multiple of the optimum, 1 or more")

    guarantee: ClassVar[str] = "w-bounded"
    supports: ClassVar[frozenset[str]] = frozenset({"effort", "window"})

    @property
    def factor(self) -> float:
        return self.w

    def open_nodes(self, forest: Forest) -> OpenNodes:
        return Focal(forest, self.w)


@dataclass(frozen=True)
class EcbsTa(Ecbs):
    """Enhanced CBS with task assignment: assigns and plans at once, at most `w` times the optimum."""

    assigns: ClassVar[bool] = True
    guarantee: ClassVar[str] = "w-bounded with assignment"
    supports: ClassVar[frozenset[str]] = frozenset()


class Focal:
    """OPEN by lower bound, FOCAL by number of conflicts: the fewest first among nodes that cost at most w times the least bound."""

    def __init__(self, forest: Forest, w: float) -> None:
        self.lower = 0.0
        self._forest, self._w = forest, w
        self._number = count()
        self._open: list[tuple[int, int]] = []  # (lower bound, serial) of all open nodes, and of closed ones not yet noticed
        self._focal: list[tuple[int, int, int, ConflictNode]] = []  # (conflicts, cost, serial, node)
        self._beyond: list[tuple[int, int, ConflictNode]] = []  # (cost, serial, node) of those that cost more
        self._closed: set[int] = set()
        self._root_expanded = False

    def select(self) -> ConflictNode | None:
        """See `OpenNodes`. A root is made when one was expanded, or when no node is within the bound."""
        if self._root_expanded and self._forest.next_cost is not None:
            self._plant()
        while True:
            self._forest.check_clock()
            while self._open and self._open[0][1] in self._closed:
                heappop(self._open)
            next_cost = self._forest.next_cost
            bounds = [float(self._open[0][0])] if self._open else []
            if next_cost is not None:
                bounds.append(next_cost)
            if not bounds:
                return None
            self.lower = max(self.lower, min(bounds))
            while self._beyond and self._beyond[0][0] <= self._w * self.lower + 1e-9:
                cost, serial, node = heappop(self._beyond)
                heappush(self._focal, (len(node.conflicts), cost, serial, node))
            if self._focal:
                _, _, serial, node = heappop(self._focal)
                self._closed.add(serial)
                self._root_expanded = node.depth == 0
                return node
            self._plant()

    def expand(self, node: ConflictNode) -> None:
        """See `OpenNodes`."""
        for child in node.tree.children(node, self._w, bypass=False):
            self._insert(child)

    def counters(self) -> dict[str, float]:
        """See `OpenNodes`."""
        return {}

    def _plant(self) -> None:
        if root := self._forest.plant(self._w):
            self._insert(root)

    def _insert(self, node: ConflictNode) -> None:
        serial = next(self._number)
        heappush(self._open, (node.bound, serial))
        heappush(self._beyond, (node.cost, serial, node))
