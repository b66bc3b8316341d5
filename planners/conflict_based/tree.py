"""The constraint tree that conflict-based planners search: nodes, and the kernels' tables behind them.

Kernels work in fixed room and say when it does not suffice; here it is made larger and the kernel called again.
The clock is looked at between kernel calls, and a search that takes long is broken off to look at it.
"""

from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import blake2b
from itertools import combinations, pairwise
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.graph import IntArray, PlanGraph
from mrp_sumo.core.plan import Status, side_by_side
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.answers import deadline_of
from mrp_sumo.search import _records as st
from mrp_sumo.search._conflicts import CONFLICT, MEET, SWAP
from mrp_sumo.search._constraints import EXPANSIONS
from mrp_sumo.search._space_time import ReplanEffort, TreeTables
from mrp_sumo.search.distance import distances
from mrp_sumo.search.entries import Entries, enter, entries_of
from mrp_sumo.search.solvable import unsolvable
from mrp_sumo.traffic.clashes import clashes_of
from mrp_sumo.traffic.moves import MoveGraph
from planners.conflict_based._cover import cover
from planners.conflict_based._nodes import all_rows, branch, same_path
from planners.conflict_based._pairs import IMPOSSIBLE, pair_weight
from planners.conflict_based._symmetry import choose
from planners.conflict_based.buffers import Buffers

FIRST_BUDGET = 100_000  # expansions of one low-level search before the clock is looked at
EXPANSIONS_PER_S = 3_000_000
PAIR_NODES = 64
NODE_BYTES = 500  # of a node besides its arrays
NODE_WORK = 300  # expansions that take as long as a node does besides its search, about
PATIENCE, MOST_PATIENCE = 30, 300  # low-level expansions a step of the path for the sake of others, more the harder the problem is
SPLITS_BEFORE_DOUBT = 300  # then a small problem is searched for whether it can be solved at all
SPLITS_BEFORE_LEARNING = 20  # easier problems do without
UNKNOWN_GAIN = ((0.0, 0.0), (0.0, 1.0), (0.5, 1.0))  # by rank, what splits on robots that nothing is known of are taken to raise f by
LEAST_GAIN, MOST_GAIN = 0.1, 8.0  # added to each of a split's two gains before they are multiplied; the most that counts of one
NO_CONFLICTS = np.empty(0, CONFLICT)


class OutOfReach(Exception):
    """The time limit or the memory limit is reached: how the search ends, and why."""

    def __init__(self, status: Status, why: str) -> None:
        super().__init__(why)
        self.status = status


class SearchLimits:
    """Limits of a search, from now on. Raises PlanError for a time that is not above 0."""

    def __init__(self, time_limit_s: float, memory_mb: int, effort: int = 0) -> None:
        """`effort` is in labels, see `Problem.effort`."""
        self.deadline_s = deadline_of(time_limit_s)  # on the clock of `process_time`
        self.effort, self._time_limit_s, self._memory_mb = effort, time_limit_s, memory_mb

    def check(self, num_bytes: int = 0) -> None:
        """Raise OutOfReach when the time is up, or the tables and nodes take more than is allowed."""
        if process_time() > self.deadline_s:
            raise OutOfReach(Status.TIMED_OUT, f"no plan within {self._time_limit_s:g} s")
        if num_bytes > self._memory_mb * 1_000_000:
            raise OutOfReach(Status.GAVE_UP, f"no plan within {self._memory_mb} MB")


@dataclass(slots=True, eq=False)
class ConflictNode:
    """A node of a tree: one record for each robot, and the conflicts of their paths."""

    tree: "Tree"
    records: IntArray  # [R]
    conflicts: np.ndarray  # [K] CONFLICT
    cost: int  # sum of the paths' costs
    bound: int  # sum of the paths' lower bounds
    h: int = 0  # admissible: what a solution below costs more than `cost` (w = 1) or `bound`
    looked_at: int = -1  # how many clusters were known when h was found; -1: h is the parent's
    depth: int = 0
    split_on: tuple[int, int] | None = None  # the robots whose conflict its children came from
    ring: list[tuple[int, int, int, int]] | None = None  # see `Tree.ring`; None: not looked for yet

    @property
    def f(self) -> int:
        return self.cost + self.h


class Tree:
    """Makes nodes of one problem with one assignment; several may share their buffers."""

    def __init__(
        self, problem: Problem, limits: SearchLimits, *, following: bool = False, symmetries: bool = True, like: "Tree | None" = None
    ) -> None:
        tables = distances(problem.graph)
        target = problem.target
        column, line = (like.instance.column, like.instance.line) if like else _cells(problem.graph)
        clashes, spots = clashes_of(problem)
        self.instance: st.SearchInstance = st.SearchInstance(
            tables.first,
            tables.head,
            tables.first_in,
            tables.tail_in,
            tables.to_all(target, limits.check),
            np.array(problem.start, np.int64),
            np.array(target, np.int64),
            column,
            line,
            following,
            clashes,
            spots,
        )
        self._entries: Entries = like._entries if like else entries_of((*self.instance, *clashes, *spots))
        self.limits = limits
        self._window = problem.window_steps  # later conflicts are none; 0: all are
        self.symmetries = symmetries and not self._window  # their constraints reach beyond
        self.num_robots = problem.num_robots
        longest = int(self.instance.distance[np.arange(problem.num_robots), problem.start].max(initial=0))
        self._buffers: Buffers = (
            like._buffers if like else Buffers(problem.graph.num_vertices, len(spots.place), problem.num_robots, 2 * longest + 64)
        )
        self._weights: dict[tuple[int, int], int] = like._weights if like else {}
        # two robots -> clusters with both -> what these cost more than their paths at least, by what stands for their constraints
        self._clusters: dict[tuple[int, int], dict[tuple[int, ...], dict[tuple[int, ...], int]]] = like._clusters if like else {}
        self._gain: dict[
            tuple[int, int], tuple[float, float]
        ] = {}  # of two robots, what splits on their conflicts raised f by lately, the lower child first
        # (robot, goal, its constraints) -> the first record with them: what is known of that one serves all others, in every tree
        self._alike: dict[tuple[int, int, bytes], int] = like._alike if like else {}
        self.num_clusters = 0  # that were found so far
        self.generated = 0
        self.problem, self._num_split, self._unsolvable = problem, 0, False

    @property
    def least(self) -> int:
        """Sum of the costs of the shortest ways: a lower bound before there is a node."""
        return int(self.instance.distance[np.arange(self.num_robots), self.instance.start].sum())

    @property
    def expansions(self) -> int:
        """Low-level expansions so far."""
        return int(self._buffers.scratch.number[EXPANSIONS])

    @property
    def work(self) -> int:
        """Work done, counted in low-level expansions, or about as much work of other kinds."""
        return self.expansions + NODE_WORK * self._buffers.generated

    def root(self, w: float = 1.0) -> ConflictNode | None:
        """The node without constraints: each robot's path, disturbing those before it least. None when there is none."""
        node = ConflictNode(self, np.full(self.num_robots, -1, np.int64), NO_CONFLICTS, 0, 0)
        for robot in range(self.num_robots):
            child = self._branch(node, robot, 0, 0, w)
            if child is None:
                return None
            node = child
        node.depth = 0
        return node

    def choose(self, node: ConflictNode, w: float = 1.0, within: set[int] | None = None) -> int:
        """The row of the conflict to split on; of those between some robots, if wanted."""
        rows = self.conflicts_within(node, within) if within else None
        conflicts = node.conflicts if rows is None else node.conflicts[rows]

        def call(buffers: Buffers, _: int) -> Any:
            tables = self.instance, buffers.store, buffers.scratch
            return enter(self._entries, choose, *tables, node.records, conflicts, self.symmetries, self.symmetries and w == 1)

        chosen = self._most_promising(conflicts, int(self._with_room(call)[1]))
        if rows is None:
            return chosen
        node.conflicts[rows] = conflicts  # with the splits found
        return int(rows[chosen])

    def conflicts_within(self, node: ConflictNode, robots: set[int]) -> IntArray:
        """The rows of the conflicts between some robots."""
        return np.flatnonzero(self._sides(node, robots).all(axis=1))

    def in_conflict_with(self, node: ConflictNode, robots: set[int]) -> list[int]:
        """For each conflict of some robots with another one, that one."""
        sides = self._sides(node, robots)
        beside = sides[:, 0] != sides[:, 1]
        pairs: list[int] = _pairs_of(node.conflicts[beside])[~sides[beside]].tolist()
        return pairs

    def _sides(self, node: ConflictNode, robots: set[int]) -> NDArray[np.bool_]:
        """[K, 2] whether the one, and the other, robot of each conflict is one of some robots."""
        inside = np.zeros(self.num_robots, np.bool_)
        inside[list(robots)] = True
        return inside[_pairs_of(node.conflicts)]

    def _most_promising(self, conflicts: np.ndarray, chosen: int) -> int:
        """The conflict whose splits promise to raise f most, by what those on its robots raised it so far; `chosen` where none is known."""
        if not self._gain:
            return chosen
        one, other, rank = conflicts["one"].tolist(), conflicts["other"].tolist(), (conflicts["priority"] >> 2).tolist()
        best = self._promise(one[chosen], other[chosen], rank[chosen]) + 1e-9
        for k in range(len(one)):
            promise = self._promise(one[k], other[k], rank[k])
            if promise > best:
                best, chosen = promise + 1e-9, k
        return chosen

    def _promise(self, one: int, other: int, rank: int) -> float:
        """The product of what the two children raised f by, as in branching by pseudo-costs (Achterberg, Koch, Martin, ORL 2005).

        A split one of whose children is never the best adds no node to the tree, so that it comes before those that double it.
        """
        less, more = self._gain.get((one, other) if one < other else (other, one), UNKNOWN_GAIN[rank])
        return (less + LEAST_GAIN) * (min(more, MOST_GAIN) + LEAST_GAIN) + 0.001 * rank

    def learn(self, node: ConflictNode, children: list[ConflictNode]) -> None:
        """Look at children right away, and remember how much f rises where the robots of the split are split on."""
        for child in children:
            self.look_at(child)
            child.h = max(child.h, node.f - child.cost)
        if node.split_on is not None:
            gains = sorted([child.f - node.f for child in children] + [MOST_GAIN] * (2 - len(children)))
            known = self._gain.get(node.split_on, gains)
            self._gain[node.split_on] = (known[0] + gains[0]) / 2, (known[1] + gains[1]) / 2

    @property
    def is_hard(self) -> bool:
        """True if so many splits have not been enough that it pays to learn from each."""
        return self._num_split > SPLITS_BEFORE_LEARNING

    def split(self, node: ConflictNode, chosen: int, w: float = 1.0, disjoint: bool = False) -> list[ConflictNode]:
        """The children: one side's constraints each."""
        row = node.conflicts[chosen]
        if disjoint and row["priority"] % 4 == 0 and row["kind"] in (MEET, SWAP):
            return self._split_disjoint(node, row, w)
        sides = (("one", "a0", "a1"), ("other", "b0", "b1"))
        return self._branches(node, [tuple(int(row[key]) for key in side) for side in sides], w)

    def children(
        self,
        node: ConflictNode,
        w: float = 1.0,
        lower: float | None = None,
        *,
        bypass: bool = True,
        disjoint: bool = False,
        within: set[int] | None = None,
    ) -> list[ConflictNode]:
        """Split a node with conflicts, or a ring, on the best one, unless a child shows a way to end it within the bounds: then the node
        gets its path, and another one is looked for (bypass).

        `w` and `lower` are the factor and the tree's lower bound; without, a bypass may not cost more than the node. `within` are robots:
        split on a conflict between two of them. No children at all where the problem turns out to have no solution: that is looked for when
        many splits have not helped.
        """
        if not len(node.conflicts):
            return self._split_ring(node, w)
        self._num_split += within is None  # those of clusters are no sign of how hard the problem is
        if within is None and self._num_split == SPLITS_BEFORE_DOUBT and not self._window:
            self._unsolvable = unsolvable(self.problem, self.instance.clashes, self.instance.spots, bool(self.instance.following))
        if self._unsolvable:
            return []
        while True:
            chosen = self.choose(node, w, within)
            node.split_on = _pair(node.conflicts[chosen])
            children = self.split(node, chosen, w, disjoint)
            if not bypass or disjoint:
                return children
            better = [c for c in children if len(c.conflicts) < len(node.conflicts) and self._may_adopt(node, c, w, lower)]
            if not better:
                return children
            self.adopt(node, min(better, key=lambda c: len(c.conflicts)))
            if not len(self.conflicts_within(node, within) if within else node.conflicts):
                return [node]

    def ring(self, node: ConflictNode) -> list[tuple[int, int, int, int]]:
        """Robots of a node without conflicts that rotate where they must not, each with its move between spots and the step it leads to."""
        if node.ring is None:
            end = self._window + 1 if self._window else None
            paths, spots = [self.instance.spots.of[path[:end]] for path in self.paths(node)], self.instance.spots
            ring = [] if self.instance.clashes.rotations else first_ring([spots.place[path] for path in paths])
            node.ring = [(robot, int(paths[robot][step - 1]), int(paths[robot][step]), step) for robot, _, _, step in ring]
        return node.ring

    def _split_ring(self, node: ConflictNode, w: float) -> list[ConflictNode]:
        """A child for each robot of a ring, in which that one does not go along: one of them does not in any plan."""
        ring = self.ring(node)
        return self._branches(node, ((robot, *self._rows([(st.EDGE, head, tail, step, step)])) for robot, tail, head, step in ring), w)

    def adopt(self, node: ConflictNode, child: ConflictNode) -> None:
        """Bypass: give the node its child's paths, without the child's constraints."""
        robot = int(np.flatnonzero(node.records != child.records)[0])
        old, new = int(node.records[robot]), int(child.records[robot])
        record = self._record(old, robot, new, old, 0, 0)
        store = self._buffers.store
        node.cost += int(store.meta["cost"][record] - store.meta["cost"][old])
        node.records = node.records.copy()
        node.records[robot] = record
        node.bound = self._bound(node.records)
        node.conflicts = child.conflicts
        node.conflicts["priority"][(_pairs_of(node.conflicts) == robot).any(axis=1)] = -1

    def _may_adopt(self, node: ConflictNode, child: ConflictNode, w: float, lower: float | None) -> bool:
        """True if the node stays within the bounds, its robots' and the tree's, with its child's paths."""
        if lower is None:
            return child.cost == node.cost
        robot = int(np.flatnonzero(node.records != child.records)[0])
        meta = self._buffers.store.meta
        cost, bound = meta["cost"][child.records[robot]], meta["bound"][node.records[robot]]
        return bool(child.cost <= w * lower + 1e-9 and cost <= w * bound + 1e-9)

    def heuristic(self, node: ConflictNode, within: set[int] | None = None) -> int:
        """WDG: what the pairs in conflict, and the clusters known, cost more than their paths at least; of some robots, if wanted."""
        if self._unsolvable:
            return 0
        records = node.records.tolist()
        alike = self._buffers.store.meta["origin"][node.records].tolist()  # stands for a robot's constraints
        groups: dict[tuple[int, ...], int] = {}
        conflicts = node.conflicts if within is None else node.conflicts[self.conflicts_within(node, within)]
        for pair in sorted({(one, other) if one < other else (other, one) for one, other in _pairs_of(conflicts).tolist()}):
            key = (alike[pair[0]], alike[pair[1]])
            weight = self._weights.get(key)
            if weight is None:
                weight = self._weights[key] = self._pair_weight(records[pair[0]], records[pair[1]])
            if weight >= IMPOSSIBLE:
                return weight
            if weight:
                groups[pair] = weight
            for robots, known in self._clusters.get(pair, {}).items():
                if robots not in groups and (not within or within.issuperset(robots)):
                    weight = known.get(tuple([alike[robot] for robot in robots]))
                    if weight:
                        groups[robots] = weight
        if len(groups) < 2:
            return next(iter(groups.values()), 0)
        number: dict[int, int] = {}
        member = [number.setdefault(robot, len(number)) for robots in groups for robot in robots]
        first = np.cumsum([0, *map(len, groups)])
        return int(cover(len(number), first, np.array(member), np.array(list(groups.values()))))

    def look_at(self, node: ConflictNode) -> None:
        """Find a node's h with what is known now."""
        if node.looked_at < self.num_clusters:
            node.h = max(node.h, self.heuristic(node))
            node.looked_at = self.num_clusters

    @contextmanager
    def passing_nodes(self) -> Iterator[None]:
        """Give back what the nodes take that are made meanwhile."""
        before = self._buffers.node_bytes
        yield
        self._buffers.node_bytes = before

    def remember(self, node: ConflictNode, robots: tuple[int, ...], weight: int) -> None:
        """That these robots, in order, cost at least so much more than their paths where they have a node's constraints."""
        known = self._clusters.setdefault((robots[0], robots[1]), {}).setdefault(robots, {})
        for pair in combinations(robots, 2):
            self._clusters.setdefault(pair, {})[robots] = known
        self.num_clusters += 1
        known[tuple(self._buffers.store.meta["origin"][node.records[list(robots)]].tolist())] = weight

    def cost_of(self, node: ConflictNode, robots: Collection[int]) -> int:
        """Sum of the costs of the paths of some robots."""
        return int(self._buffers.store.meta["cost"][node.records[list(robots)]].sum())

    def paths(self, node: ConflictNode) -> list[IntArray]:
        """[R] the vertex of each robot at each step."""
        store = self._buffers.store
        paths = []
        for record in node.records:
            begin, cost = store.meta["path0"][record], store.meta["cost"][record]
            paths.append(store.path["vertex"][begin : begin + cost + 1].astype(np.int64))
        return paths

    def check_clock(self) -> None:
        """Raise OutOfReach when the time is up, memory runs short, or the effort is used up."""
        self.limits.check(self._buffers.num_bytes)
        if 0 < self.limits.effort <= self.work:
            raise OutOfReach(Status.TIMED_OUT, f"no plan within an effort of {self.limits.effort} labels")

    def _branches(self, node: ConflictNode, sides: Iterable[tuple[int, ...]], w: float) -> list[ConflictNode]:
        """A child for each robot and rows of its constraints, but where it has no path."""
        children = [self._branch(node, robot, row0, row1, w) for robot, row0, row1 in sides]
        return [child for child in children if child is not None]

    def _branch(self, node: ConflictNode, robot: int, row0: int, row1: int, w: float) -> ConflictNode | None:
        store = self._buffers.store
        old = int(node.records[robot])
        lower = int(store.meta["bound"][old]) if old >= 0 else 0
        patience = min(PATIENCE + self._num_split, MOST_PATIENCE)
        made = self._replanned(node, robot, (row0, row1), ReplanEffort(w, lower, patience, FIRST_BUDGET))
        self.generated += 1
        self._buffers.generated += 1
        if made is None:
            return None
        record, conflicts = made
        if self._window:
            conflicts = conflicts[conflicts["step"] <= self._window]
        self._buffers.node_bytes += conflicts.nbytes + node.records.nbytes + NODE_BYTES
        store = self._buffers.store
        self._share(record, robot)
        records = node.records.copy()
        records[robot] = record
        cost = node.cost + int(store.meta["cost"][record]) - (int(store.meta["cost"][old]) if old >= 0 else 0)
        return ConflictNode(self, records, conflicts, cost, self._bound(records), depth=node.depth + 1)

    def _bound(self, records: IntArray) -> int:
        """Sum of the lower bounds: computed again, since building an MDD may raise a record's."""
        return int(self._buffers.store.meta["bound"][records[records >= 0]].sum())

    def _split_disjoint(self, node: ConflictNode, row: np.void, w: float) -> list[ConflictNode]:
        """One child where a robot is not there then, one where it is and nobody else (Li et al., ICAPS 2019)."""
        one, other = int(row["one"]), int(row["other"])
        children = [self._branch(node, one, int(row["a0"]), int(row["a1"]), w)]
        at, step, tail = int(row["at"]), int(row["step"]), int(row["tail"])
        swap = row["kind"] == SWAP
        must = self._rows([(st.MUST, at, -1, step, step)] + ([(st.MUST, tail, -1, step - 1, step - 1)] if swap else []))
        barred = [(st.RANGE, at, -1, step, step)]
        if swap:
            barred += [(st.RANGE, tail, -1, step - 1, step - 1), (st.EDGE, tail, at, step, step)]
        bar = self._rows(barred)
        record = self._record(int(node.records[one]), one, int(node.records[one]), -1, *must)
        child: ConflictNode | None = ConflictNode(self, node.records.copy(), node.conflicts, node.cost, node.bound, depth=node.depth + 1)
        assert child is not None
        child.records[one] = record
        breaks = []
        for robot in range(self.num_robots):
            if robot == one:
                continue
            here, before = self._place(node, robot, step), self._place(node, robot, step - 1)
            if here == at or (swap and (before == tail or (before == at and here == tail))):
                breaks.append(robot)
            else:
                child.records[robot] = self._record(int(node.records[robot]), robot, int(node.records[robot]), -1, *bar)
        assert other in breaks
        for robot in breaks:
            if child is not None:
                child = self._branch(child, robot, *bar, w)
        children.append(child)
        for made in children:
            if made is not None:
                made.depth = node.depth + 1
        return [made for made in children if made is not None]

    def _place(self, node: ConflictNode, robot: int, step: int) -> int:
        return int(st.spot_at(self._buffers.store, int(node.records[robot]), step))

    def _rows(self, rows: list[tuple[int, int, int, int, int]]) -> tuple[int, int]:
        store = self._buffers.store
        while store.used[st.ROWS] + len(rows) > len(store.rows):
            self._buffers.grow_store()
            store = self._buffers.store
        begin = int(store.used[st.ROWS])
        store.rows[begin : begin + len(rows)] = rows
        store.used[st.ROWS] += len(rows)
        return begin, begin + len(rows)

    def _record(self, parent: int, robot: int, path_of: int, like: int, row0: int, row1: int) -> int:
        while (record := int(same_path(self._buffers.store, parent, robot, path_of, like, row0, row1))) < 0:
            self._buffers.grow_store()
        if like < 0:
            self._share(record, robot)
        return record

    def _share(self, record: int, robot: int) -> None:
        """Let a new record have the MDD, and the pairs' weights, of an earlier one with the same constraints."""
        meta = self._buffers.store.meta
        rows = all_rows(self._buffers.store, record)
        text, width = rows.tobytes(), rows.itemsize
        different = sorted({text[k : k + width] for k in range(0, len(text), width)})
        key = (robot, int(self.instance.goal[robot]), blake2b(b"".join(different), digest_size=16).digest())
        first = self._alike.setdefault(key, record)
        if first != record:
            meta["origin"][record], meta["mdd0"][record] = first, meta["mdd0"][first]
            meta["bound"][record] = max(meta["bound"][record], min(meta["bound"][first], meta["cost"][record]))

    def _pair_weight(self, one: int, other: int) -> int:
        def call(buffers: Buffers, budget: int) -> Any:
            tables = TreeTables(self.instance, buffers.store, buffers.pair, buffers.scratch)
            return enter(self._entries, pair_weight, tables, one, other, PAIR_NODES, budget)

        return int(self._with_room(call)[1])

    def _replanned(self, node: ConflictNode, robot: int, rows: tuple[int, int], effort: ReplanEffort) -> tuple[int, np.ndarray] | None:
        """The robot's new record, and the conflicts of the node with it; None where it has no path."""

        def call(buffers: Buffers, budget: int) -> Any:
            tables = TreeTables(self.instance, buffers.store, buffers.occupancy, buffers.scratch)
            limits = effort._replace(budget=budget)
            return enter(self._entries, branch, tables, node.records, node.conflicts, robot, rows, limits)

        code, record, conflicts = self._with_room(call)
        return (record, conflicts) if code == st.OK else None

    def _with_room(self, call: Callable[[Buffers, int], Any]) -> Any:
        """What a kernel answers that is called again with more room, or a larger budget of expansions, as long as it asks for that."""
        budget, buffers = FIRST_BUDGET, self._buffers
        while True:
            self.check_clock()
            answer = call(buffers, budget)
            if answer[0] in (st.OK, st.NO_PATH):
                return answer
            if answer[0] == st.STORE_FULL:
                buffers.grow_store()
            elif answer[0] == st.SCRATCH_FULL:
                buffers.grow_scratch()
            elif answer[0] == st.TOO_LATE:
                buffers.grow_horizon()
            else:
                self.limits.check()
                left = self.limits.deadline_s - process_time()
                budget = max(1000, int(min(4 * budget, left * EXPANSIONS_PER_S)))


def _pairs_of(conflicts: np.ndarray) -> NDArray[np.int32]:
    """[K, 2] the robots of each conflict."""
    return conflicts.view(np.int32).reshape(-1, CONFLICT.itemsize // 4)[:, :2]


def _pair(row: np.void) -> tuple[int, int]:
    """The robots of a conflict, in order."""
    one, other = int(row["one"]), int(row["other"])
    return (one, other) if one < other else (other, one)


def first_ring(paths: list[IntArray]) -> list[tuple[int, int, int, int]]:
    """The first robots that rotate, as in `Tree.ring`, on paths [R] without conflicts: vertices by step; none: []."""
    for step, (here, there) in enumerate(pairwise(side_by_side(paths)), 1):
        moving = np.flatnonzero(here != there)
        behind = dict(zip(here[moving].tolist(), moving.tolist()))  # who leaves a vertex
        onward = {robot: behind[v] for robot, v in zip(moving.tolist(), there[moving].tolist()) if v in behind}
        while ended := [robot for robot, other in onward.items() if other not in onward]:
            for robot in ended:
                del onward[robot]
        if onward:
            ring = [min(onward)]
            while (other := onward[ring[-1]]) != ring[0]:
                ring.append(other)
            return [(robot, int(here[robot]), int(there[robot]), step) for robot in ring]
    return []


def _cells(graph: PlanGraph) -> tuple[IntArray, IntArray]:
    """[V] column and line of each vertex where the graph is a 4-connected grid, else nothing."""
    nothing = np.zeros(0, np.int64), np.zeros(0, np.int64)
    if not graph.num_lanes or not graph.cell_m > 0 or isinstance(graph, MoveGraph):  # states of a place share its cell
        return nothing
    cell = (graph.xy - graph.xy.min(axis=0)) / graph.cell_m
    whole = np.rint(cell).astype(np.int64)
    place = np.sort(whole[:, 0] * (whole[:, 1].max() + 1) + whole[:, 1])
    if np.abs(cell - whole).max() > 1e-3 or (place[1:] == place[:-1]).any():
        return nothing
    if (np.abs(whole[graph.tail] - whole[graph.head]).sum(axis=1) != 1).any() or (graph.level != graph.level[0]).any():
        return nothing
    return np.ascontiguousarray(whole[:, 0]), np.ascontiguousarray(whole[:, 1])
