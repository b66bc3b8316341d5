"""Open nodes best first, and clusters: robots that cost more together than the pairs of them show.

Source: Shen, Chen, Li, Cheema, Harabor, Stuckey, "Beyond pairwise reasoning in multi-agent path finding", ICAPS 2023. Where a split
leaves f as it is in a child, the two robots are searched for by themselves, in a tree of their own below the node; robots that the cheapest
paths found collide with join them, as in independence detection (Standley, AAAI 2010). Conflicts with others are not looked at, so that
the least f of its open nodes is a lower bound for these robots. It is remembered by their constraints, and counts wherever else in the tree
they have the same: what is apart is searched once, and not once for each state of everything else.
"""

from dataclasses import replace
from heapq import heappop, heappush
from itertools import count

from planners.conflict_based._pairs import IMPOSSIBLE
from planners.conflict_based.frame import Forest
from planners.conflict_based.tree import ConflictNode, Tree

MOST_ROBOTS = 8
MOST_NODES = 40  # expanded for a cluster: what it costs more is a lower bound where they do not suffice


class BestFirst:
    """OPEN: best first by f = g + h, g the cost and h the WDG heuristic, among equals the fewest conflicts.

    h is looked up when a node is taken out, which is put back where that makes it worse.
    """

    def __init__(self, forest: Forest, *, heuristic: bool, bypass: bool, disjoint: bool = False, learns: bool = True) -> None:
        """`learns` is whether splits of a hard problem are chosen by what others have gained, and clusters are looked for."""
        self.lower = 0.0
        self._forest = forest
        self._heuristic, self._bypass, self._disjoint, self._learns = heuristic, bypass, disjoint, heuristic and learns
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
        if self._learns and node.tree.is_hard:
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


def find_cluster(node: ConflictNode, *, bypass: bool) -> bool:
    """True if the robots that a node was split on, with others, cost more than was known; remembered then."""
    assert node.split_on is not None
    tree = node.tree
    with tree.passing_nodes():
        robots, weight = _grown(tree, node, node.split_on, bypass)
    if len(robots) < 3 or weight <= tree.heuristic(node, robots):
        return False
    tree.remember(node, tuple(sorted(robots)), weight)
    return True


def _grown(tree: Tree, node: ConflictNode, pair: tuple[int, int], bypass: bool) -> tuple[set[int], int]:
    """A cluster around two robots, and what it costs more than its paths at least."""
    robots, lower, num_expanded, number = set(pair), 0, 0, count()
    # (what the cluster costs more, at least, conflicts, newest first, node, for how many robots it was looked at)
    queue = [(0, 0, 0, replace(node), 0)]
    while queue and num_expanded < MOST_NODES:
        lower, num_conflicts, _, part, looked_at = heappop(queue)
        if looked_at < len(robots):
            more = tree.cost_of(part, robots) - tree.cost_of(node, robots) + tree.heuristic(part, robots)
            if more > lower:
                heappush(queue, (more, num_conflicts, -next(number), part, len(robots)))
                continue
        if len(tree.conflicts_within(part, robots)):
            num_expanded += 1
            children = tree.children(part, bypass=bypass, within=robots)
        else:
            others = tree.in_conflict_with(part, robots)
            if not others or len(robots) == MOST_ROBOTS:
                return robots, lower
            robots.add(max(set(others), key=lambda robot: (others.count(robot), -robot)))
            children = [part]
        for child in children:
            heappush(queue, (lower, len(child.conflicts), -next(number), child, 0))
    return robots, queue[0][0] if queue else IMPOSSIBLE
