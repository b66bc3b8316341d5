"""LaCAM*: lazy constraints addition search, anytime.

Okumura, AAAI 2023, IJCAI 2023 and AAMAS 2024 (titles in `_lacam.py`). Searches configurations depth first; PIBT
proposes the next one, and constraints are added only where the search comes by again. Complete: finds a
solution or proves that there is none, given time and memory. Anytime, it goes on after the first solution and
converges to the least sum of loss.
"""

from dataclasses import dataclass, replace
from time import perf_counter
from typing import ClassVar

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import order_clash
from planners import _lacam, _lns
from planners._lacam import Search
from planners._lns import Task
from planners._pibt import World
from planners._refinement import Refinement, polishing_labels, task_of
from planners._world import (
    SLICE_S,
    build_scratch,
    build_world,
    checked_deadline,
    is_large,
    small_problem,
    solved,
    sum_of_costs,
    tiled,
    timed_out,
    without_search,
)

CHANCE = 12  # purpose of the stream of chance


@dataclass(frozen=True)
class Lacam:
    """Plans by LaCAM; `anytime` makes it LaCAM*, which uses all its time unless it proves optimality.

    Where tables allow, robots are given ways that scatter them (AAMAS 2024, section 4), and the first solution is
    polished by large neighbourhood search for a fixed amount of work; anytime, the rest of the time goes to both
    the search and the neighbourhoods.
    """

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "complete; eventually optimal in sum of loss when anytime"

    anytime: bool = False
    num_tries: int = 1  # configurations generated for one, the best is kept
    hindrance: bool = True  # prefer, among equally near vertices, those that fewer neighbours want
    scatter: int = 2  # rounds of planning ways that scatter robots, 0 for none
    scatter_margin: int = 2  # steps such a way may be longer than the shortest
    polish: int = 2500  # labels a robot that may be spent on making the first solution better, see `polishing_labels`; 0 for none
    neighbourhood: int = 4  # robots planned again at a time
    memory_mb: int = 2000  # for the search; beyond it gives up, or improves only what it has

    def __post_init__(self) -> None:
        for key in ("num_tries", "neighbourhood", "memory_mb"):
            if getattr(self, key) < 1:
                raise PlanError(f"lacam: {key} is {getattr(self, key)}, expected 1 or more")
        for key in ("scatter", "scatter_margin", "polish"):
            if getattr(self, key) < 0:
                raise PlanError(f"lacam: {key} is {getattr(self, key)}, expected 0 or more")

    def prepare(self) -> None:
        """Compile or load the kernels."""
        replace(self, scatter=2, polish=10, anytime=True)._plan(small_problem(), np.inf, False)
        self._plan(small_problem(), np.inf, True)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """SOLVED, with the best plan found if anytime; INFEASIBLE with proof; TIMED_OUT."""
        return self._plan(problem, time_limit_s, None)

    def _plan(self, problem: Problem, time_limit_s: float, packed: bool | None) -> PlanResult:
        begin_s = perf_counter()
        deadline_s = checked_deadline(time_limit_s)
        given, original = problem, None
        packed = is_large(problem) if packed is None else packed
        if packed:
            problem, original = tiled(problem)
        built = build_world(problem, deadline_s, packed=packed)
        if built is None:
            return timed_out(begin_s, 0.0, "the time limit passed while distances were computed")
        world, steps = built
        known = without_search(given, steps, begin_s) or (None if packed else order_clash(given))
        if known:
            return known
        lower_bound = float(steps.sum())
        rng = np.random.default_rng([problem.seed, CHANCE])
        task = None if world.packed else task_of(problem, world.table)
        if task and self.scatter:
            world = self._guided(world, task, steps, deadline_s, rng)
        hunt = _Hunt(self, problem, world, steps, rng)
        state = hunt.until(deadline_s, first=True)
        if state == _lacam.EXHAUSTED:
            message = "the search has seen every configuration that can be reached"
            return PlanResult(Status.INFEASIBLE, None, None, perf_counter() - begin_s, 0.0, np.inf, hunt.counters(), message)
        if state != _lacam.REACHED:
            why = f"{time_limit_s:g} s" if state == _lacam.RUNNING else f"{self.memory_mb} MB"
            return timed_out(begin_s, lower_bound, f"no solution within {why}", **hunt.counters())
        path = hunt.path()
        cost = sum_of_costs(path, world.goal)
        stats = {"first_solution_time_s": perf_counter() - begin_s, "first_solution_cost": cost}
        if task and self.polish:
            polished = Refinement(task, path, self.neighbourhood, rng)
            polished.until(deadline_s - _to_write(path), most_labels=polishing_labels(self.polish, problem.num_robots))
            path, cost = polished.path(), polished.cost
            stats |= {"polished_time_s": perf_counter() - begin_s, "polished_cost": cost}
        if self.anytime and cost > lower_bound:
            path = self._improved(hunt, task, path, lower_bound, deadline_s, rng)
        stats |= {"cost": sum_of_costs(path, world.goal), **hunt.counters()}
        return solved(given, path if original is None else original[path], begin_s, lower_bound, **stats)

    def _guided(self, world: World, task: Task, steps: IntArray, deadline_s: float, rng: np.random.Generator) -> World:
        """The world with a guide of ways that cross each other little."""
        num_robots, num_vertices = task.steps.shape
        horizon = (int(steps.max()) + self.scatter_margin + 2 + 31) // 32 * 32
        traffic, labels, _ = _lns.room_for(task, horizon, 1, with_hits=False)
        for turn in range(self.scatter):
            order = rng.permutation(num_robots)
            most = len(labels.vertex) if turn == 0 else 20 * int(steps.mean() + 10)
            for a in range(0, num_robots, 4):
                if perf_counter() > deadline_s:
                    return world
                _lns.scatter(task, traffic, labels, order, a, min(a + 4, num_robots), self.scatter_margin, most)
        guide = np.empty((num_robots, num_vertices), np.int32)
        _lns.write_guide(traffic, guide)
        return world._replace(guided=True, guide=guide)

    def _improved(
        self, hunt: "_Hunt", task: Task | None, path: np.ndarray, lower_bound: float, deadline_s: float, rng: np.random.Generator
    ) -> np.ndarray:
        """The best path at the deadline, or when none can be better."""
        refinement = Refinement(task, path, self.neighbourhood, rng) if task else None
        best = sum_of_costs(path, hunt.world.goal)
        told = 0
        searching = True
        deadline_s -= _to_write(path)
        while perf_counter() < deadline_s and best > lower_bound and (searching or refinement):
            now_s = perf_counter()
            if searching and refinement and told != best and len(path) < 4000:
                hunt.learn(refinement.path())
                told = best
            if searching:
                state = hunt.until(min(deadline_s, now_s + (0.25 if refinement else 10.0) * 0.2), first=False)
                if state == _lacam.REACHED:
                    found = hunt.path()
                    cost = sum_of_costs(found, hunt.world.goal)
                    if cost < best:
                        path, best = found, cost
                        refinement = Refinement(task, path, self.neighbourhood, rng) if task else None
                elif state == _lacam.EXHAUSTED:
                    break
                searching = state != _lacam.FULL
            if refinement:
                refinement.until(min(deadline_s, perf_counter() + 0.5))
                if refinement.cost < best:
                    path, best = refinement.path(), refinement.cost
        return path


def _to_write(path: np.ndarray) -> float:
    """Seconds, about, that it takes to make a plan of a path."""
    return 0.01 + 1e-7 * path.size


class _Hunt:
    """LaCAM's search, as it stands."""

    def __init__(self, settings: Lacam, problem: Problem, world: World, steps: IntArray, rng: np.random.Generator) -> None:
        self.world, self.scratch = world, build_scratch(world)
        self._settings, self._rng = settings, rng
        self._base_order = np.argsort(-steps, kind="stable").astype(np.int32)
        self._to, self._best = np.empty(problem.num_robots, np.int32), np.empty(problem.num_robots, np.int32)
        self._search = _room(problem.num_robots, self.scratch.candidate.shape[1], nodes=256)
        self._at_once = 1
        _lacam.begin(world, self._search, problem.start.astype(np.int32), self._base_order, int(steps.sum()))

    def until(self, deadline_s: float, *, first: bool) -> int:
        """Search: REACHED at the first solution, or at the deadline if a better one was found; else RUNNING, EXHAUSTED, FULL."""
        given = self._settings
        better = False
        while (slice_s := perf_counter()) < deadline_s:
            before = self._search.count[_lacam.EXPANSIONS]
            state = _lacam.search_on(
                self.world, self.scratch, self._search, self._base_order, self._to, self._best,
                given.num_tries, given.hindrance, self._at_once, self._rng,
            )  # fmt: skip
            if state == _lacam.REACHED and first:
                return state
            if state == _lacam.EXHAUSTED:
                return _lacam.REACHED if better else state
            if state == _lacam.FULL and not self._grow():
                return _lacam.REACHED if better else state
            better = better or state == _lacam.REACHED
            done = self._search.count[_lacam.EXPANSIONS] - before
            self._at_once = max(1, int(done * SLICE_S / max(perf_counter() - slice_s, 1e-6)))
        return _lacam.REACHED if better else _lacam.RUNNING

    def learn(self, path: np.ndarray) -> None:
        """Make a solution found elsewhere part of the search."""
        while not _lacam.insert_path(self.world, self.scratch, self._search, path, self._base_order):
            if not self._grow():
                return

    def path(self) -> np.ndarray:
        """[T, R] configurations from the start to the goal."""
        search = self._search
        nodes = [search.count[_lacam.GOAL]]
        while search.parent[nodes[-1]] >= 0:
            nodes.append(search.parent[nodes[-1]])
        return search.config[nodes[::-1]]

    def counters(self) -> dict[str, float]:
        """For the result's statistics."""
        count = self._search.count
        return {"nodes": float(count[_lacam.NODES]), "expansions": float(count[_lacam.EXPANSIONS])}

    def _grow(self) -> bool:
        larger = _larger(self._search, self._settings.memory_mb)
        if larger is not None:
            self._search = larger
        return larger is not None


def _room(num_robots: int, width: int, nodes: int) -> Search:
    """Memory for a number of nodes, and in proportion for the rest; `width` is the most candidates of a robot."""
    branches, edges, opened = nodes * (width + 2) + width, 3 * nodes, 4 * nodes
    return Search(
        config=np.empty((nodes, num_robots), np.int32),
        order=np.empty((nodes, num_robots), np.int32),
        **{
            name: np.empty(nodes, np.int64) for name in ("g", "h", "parent", "digest", "first_branch", "last_branch", "first_edge", "relax")
        },
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
