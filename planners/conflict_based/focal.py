"""The order of ECBS and ECBS-TA: focal search, the fewest conflicts first among nodes that cost at most w times the lower bound."""

from heapq import heappop, heappush
from itertools import count

from planners.conflict_based.frame import Forest
from planners.conflict_based.tree import ConflictNode


class Focal:
    """OPEN by lower bound, FOCAL by number of conflicts."""

    def __init__(self, forest: Forest, w: float) -> None:
        self.lower = 0.0
        self._forest, self._w = forest, w
        self._number = count()
        self._open: list[tuple[int, int]] = []  # (lower bound, serial) of all open nodes, and of closed ones not yet noticed
        self._focal: list[
            tuple[int, int, int, ConflictNode]
        ] = []  # (conflicts, cost, serial, node) of those that cost at most w times the bound
        self._beyond: list[tuple[int, int, ConflictNode]] = []  # (cost, serial, node) of the others
        self._closed: set[int] = set()
        self._root_expanded = False

    def select(self) -> ConflictNode | None:
        """See `Order`. A root is made when one was expanded, or when no node is within the bound."""
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
        """See `Order`."""
        for child in node.tree.children(node, self._w, bypass=False):
            self._insert(child)

    def counters(self) -> dict[str, float]:
        """See `Order`."""
        return {}

    def _plant(self) -> None:
        if root := self._forest.plant(self._w):
            self._insert(root)

    def _insert(self, node: ConflictNode) -> None:
        serial = next(self._number)
        heappush(self._open, (node.bound, serial))
        heappush(self._beyond, (node.cost, serial, node))
