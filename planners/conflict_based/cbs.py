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
from typing import ClassVar

from mrp_sumo.core.options import option
from planners.conflict_based.best_first import BestFirst
from planners.conflict_based.frame import Forest, OpenNodes, TreePlanner


@dataclass(frozen=True)
class CbsTa(TreePlanner):
    """Conflict-based search with task assignment: assigns and plans at once."""

    heuristic: bool = option(True, "WDG heuristic: what each pair of conflicting robots will cost more")
    bypass: bool = option(True, "replace a node's path by one with fewer conflicts instead of splitting")

    assigns: ClassVar[bool] = True
    guarantee: ClassVar[str] = "optimal with assignment"

    def open_nodes(self, forest: Forest) -> OpenNodes:
        return BestFirst(forest, heuristic=self.heuristic, bypass=self.bypass)


@dataclass(frozen=True)
class Cbs(CbsTa):
    """Conflict-based search, with improvements that can be switched off.

    Nodes are expanded best first by cost plus heuristic; each expansion splits on a conflict.
    """

    disjoint: bool = option(False, "split into a constraint that forbids and one that demands; mostly a larger tree")

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "optimal"
    supports: ClassVar[frozenset[str]] = frozenset({"effort"})

    def open_nodes(self, forest: Forest) -> OpenNodes:
        return BestFirst(forest, heuristic=self.heuristic, bypass=self.bypass, disjoint=self.disjoint)
