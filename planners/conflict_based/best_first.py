"""The order of CBS and CBS-TA: best first by f = g + h, g the node's cost and h the WDG heuristic, among equals the fewest conflicts."""

from heapq import heappop, heappush
from itertools import count

from planners.conflict_based.clusters import find_cluster
from planners.conflict_based.frame import Forest
from planners.conflict_based.tree import ConflictNode


class BestFirst:
    """OPEN of the paper; h is looked up when a node is taken out, which is put back where that makes it worse."""

    def __init__(self, forest: Forest, *, heuristic: bool, bypass: bool, disjoint: bool = False) -> None:
        self.lower = 0.0
        self._forest = forest
        self._heuristic, self._bypass, self._disjoint = heuristic, bypass, disjoint
        self._number = count()
        self._open: list[tuple[int, int, int, ConflictNode]] = []  # (f, conflicts, newest first, node)

    def select(self) -> ConflictNode | None:
        """See `Order`. A root is made when no node is better than its assignment."""
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
        """See `Order`. No solution below a child costs less than below its parent."""
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
        """See `Order`."""
        return {}

    def _insert(self, node: ConflictNode) -> None:
        heappush(self._open, (node.f, len(node.conflicts), -next(self._number), node))
