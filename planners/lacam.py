"""LaCAM*: lazy constraints addition search, anytime.

Okumura, AAAI 2023, IJCAI 2023 and AAMAS 2024 (titles in `_lacam.py`). Searches configurations depth first; PIBT
proposes the next one, and constraints are added only where the search comes by again. Complete: finds a
solution or proves that there is none, given time and memory. Anytime, it goes on after the first solution and
converges to the least sum of loss.
"""

from dataclasses import dataclass
from time import perf_counter
from typing import ClassVar

import numpy as np

from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from planners import _lacam
from planners._lacam import Search
from planners._world import (
    SLICE_S,
    build_scratch,
    build_world,
    checked_deadline,
    small_problem,
    solved,
    sum_of_costs,
    timed_out,
    without_search,
)

CHANCE = 12  # purpose of the stream of chance


@dataclass(frozen=True)
class Lacam:
    """Plans by LaCAM; `anytime` makes it LaCAM*, which uses all its time unless it proves optimality."""

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "complete; eventually optimal in sum of loss when anytime"

    anytime: bool = False
    num_tries: int = 1  # configurations generated for one, the best is kept
    hindrance: bool = True  # prefer, among equally near vertices, those that fewer neighbours want
    memory_mb: int = 2000  # for the search; beyond it gives up, or improves only what it has

    def __post_init__(self) -> None:
        if self.num_tries < 1 or self.memory_mb < 1:
            raise PlanError("lacam: expected num_tries and memory_mb of 1 or more")

    def prepare(self) -> None:
        """Compile or load the kernels."""
        for packed in (False, True):
            self._plan(small_problem(), 60.0, packed)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """SOLVED, with the best plan found if anytime; INFEASIBLE with proof; TIMED_OUT."""
        return self._plan(problem, time_limit_s, None)

    def _plan(self, problem: Problem, time_limit_s: float, packed: bool | None) -> PlanResult:
        begin_s = perf_counter()
        deadline_s = checked_deadline(time_limit_s)
        built = build_world(problem, deadline_s, packed=packed)
        if built is None:
            return timed_out(begin_s, 0.0, "the time limit passed while distances were computed")
        world, steps = built
        known = without_search(problem, steps, begin_s)
        if known:
            return known
        lower_bound = float(steps.sum())
        scratch = build_scratch(world)
        rng = np.random.default_rng([problem.seed, CHANCE])
        base_order = np.argsort(-steps, kind="stable").astype(np.int32)
        to, best = np.empty(problem.num_robots, np.int32), np.empty(problem.num_robots, np.int32)
        search = _room(problem.num_robots, scratch.candidate.shape[1], nodes=256)
        _lacam.begin(world, search, problem.start.astype(np.int32), base_order, int(steps.sum()))
        at_once = 1
        while True:
            slice_s = perf_counter()
            if slice_s > deadline_s:
                return timed_out(begin_s, lower_bound, f"no solution within {time_limit_s:g} s", **_counters(search))
            before = search.count[_lacam.EXPANSIONS]
            state = _lacam.search_on(world, scratch, search, base_order, to, best, self.num_tries, self.hindrance, at_once, rng)
            if state == _lacam.REACHED:
                break
            if state == _lacam.EXHAUSTED:
                message = "the search has seen every configuration that can be reached"
                return PlanResult(
                    Status.INFEASIBLE,
                    planning_time_s=perf_counter() - begin_s,
                    lower_bound_steps=np.inf,
                    stats=_counters(search),
                    message=message,
                )
            if state == _lacam.FULL:
                larger = _larger(search, self.memory_mb)
                if larger is None:
                    return timed_out(begin_s, lower_bound, f"no solution within {self.memory_mb} MB", **_counters(search))
                search = larger
            done = search.count[_lacam.EXPANSIONS] - before
            at_once = max(1, int(done * SLICE_S / max(perf_counter() - slice_s, 1e-6)))
        path = _path(search)
        cost = sum_of_costs(path, world.goal)
        first = {"first_solution_time_s": perf_counter() - begin_s, "first_solution_cost": cost}
        return solved(problem, path, begin_s, lower_bound, cost=cost, **first, **_counters(search))


def _path(search: Search) -> np.ndarray:
    """[T, R] configurations from the start to the goal."""
    nodes = [search.count[_lacam.GOAL]]
    while search.parent[nodes[-1]] >= 0:
        nodes.append(search.parent[nodes[-1]])
    return search.config[nodes[::-1]]


def _counters(search: Search) -> dict[str, float]:
    return {"nodes": float(search.count[_lacam.NODES]), "expansions": float(search.count[_lacam.EXPANSIONS])}


def _room(num_robots: int, width: int, nodes: int) -> Search:
    """Memory for a number of nodes, and in proportion for the rest; `width` is the most candidates of a robot."""
    branches, edges, opened = nodes * (width + 2) + width, 3 * nodes, 4 * nodes
    return Search(
        config=np.empty((nodes, num_robots), np.int32),
        order=np.empty((nodes, num_robots), np.int32),
        **{name: np.empty(nodes, np.int64) for name in ("g", "h", "parent", "first_branch", "last_branch", "first_edge", "relax")},
        digest=np.empty(nodes, np.uint64),
        relaxing=np.empty(nodes, np.bool_),
        **{name: np.empty(branches, np.int64) for name in ("branch_parent", "branch_next")},
        **{name: np.empty(branches, np.int32) for name in ("branch_vertex", "branch_depth")},
        edge_to=np.empty(edges, np.int64),
        edge_cost=np.empty(edges, np.int32),
        edge_next=np.empty(edges, np.int64),
        slot=np.full(1 << (2 * nodes - 1).bit_length(), -1, np.int64),
        open=np.empty(opened, np.int64),
        count=np.zeros(6, np.int64),
    )


def _larger(search: Search, memory_mb: int) -> Search | None:
    """The same search with twice the room where room is short; None when that is more memory than allowed."""
    n = search.count
    num_nodes, num_robots = search.config.shape
    groups = {
        (n[_lacam.NODES], num_nodes): (
            "config",
            "order",
            "g",
            "h",
            "parent",
            "first_branch",
            "last_branch",
            "first_edge",
            "relax",
            "digest",
            "relaxing",
        ),
        (n[_lacam.BRANCHES], len(search.branch_next)): ("branch_parent", "branch_next", "branch_vertex", "branch_depth"),
        (n[_lacam.EDGES], len(search.edge_to)): ("edge_to", "edge_cost", "edge_next"),
        (n[_lacam.OPEN] + n[_lacam.NODES], len(search.open)): ("open",),
    }
    grown: dict[str, np.ndarray] = {}
    for (used, room), names in groups.items():
        if 4 * used < 3 * room:
            continue
        for name in names:
            old = getattr(search, name)
            if name in ("config", "order") and 2 * 2 * room * num_robots * 4 > memory_mb * 1_000_000:
                return None
            grown[name] = np.concatenate((old, np.empty_like(old)))
    if "config" in grown:
        grown["slot"] = np.empty(2 * len(search.slot), np.int64)
    larger = search._replace(**grown)
    if "config" in grown:
        _lacam.fill_slots(larger)
    return larger
