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

from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from planners._world import SLICE_S, build_scratch, small_problem, sum_of_costs, timed_out
from planners.configuration import _lacam
from planners.configuration._lacam import Search
from planners.configuration._opening import Opening, opened
from planners.neighbourhood._refinement import FOREVER, SPARE_STEPS, Refinement, polishing_labels, room_bytes, task_of
from planners.neighbourhood._traffic import Task

CHANCE = 12  # purpose of the stream of chance


@dataclass(frozen=True)
class Lacam:
    """Plans by LaCAM; `anytime` makes it LaCAM*, which uses all its time unless it proves optimality.

    Where tables allow, robots are guided by the traffic flow at first, see `_flow`, and the first solution is polished by
    large neighbourhood search for a fixed amount of work; anytime, the rest of the time goes to both the search and
    the neighbourhoods.
    """

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "complete; eventually optimal in sum of loss when anytime"

    anytime: bool = False
    following: bool = False  # avoid following conflicts too: nobody enters a vertex in the step its holder leaves
    rotations: bool = True  # rings of robots may move at once
    num_tries: int = 1  # configurations generated for one, the best is kept
    hindrance: bool = True  # prefer, among equally near vertices, those that fewer neighbours want
    flow: int = 1  # rounds of giving ways that do not run against each other, for a guide; 0 for none
    polish: int = 1800  # labels a robot that may be spent on making the first solution better, see `polishing_labels`; 0 for none
    neighbourhood: int = 4  # robots planned again at a time
    memory_mb: int = 2000  # for the search, and for neighbourhoods; beyond it gives up, or keeps what it has

    def __post_init__(self) -> None:
        for key in ("num_tries", "neighbourhood", "memory_mb"):
            if getattr(self, key) < 1:
                raise PlanError(f"lacam: {key} is {getattr(self, key)}, expected 1 or more")
        for key in ("flow", "polish"):
            if getattr(self, key) < 0:
                raise PlanError(f"lacam: {key} is {getattr(self, key)}, expected 0 or more")

    def prepare(self) -> None:
        """Compile or load the kernels."""
        replace(self, flow=1, polish=10, anytime=True)._plan(small_problem(), np.inf, False)
        self._plan(small_problem(), np.inf, True)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """SOLVED, with the best plan found if anytime; INFEASIBLE with proof; TIMED_OUT."""
        return self._plan(problem, time_limit_s, None)

    def _plan(self, problem: Problem, time_limit_s: float, packed: bool | None) -> PlanResult:
        opening = opened(problem, time_limit_s, CHANCE, flow=self.flow, following=self.following, rotations=self.rotations, packed=packed)
        if isinstance(opening, PlanResult):
            return opening
        begin_s, deadline_s, lower_bound = opening.begin_s, opening.deadline_s, opening.lower_bound
        hunt, state = self._first(opening)
        if state == _lacam.EXHAUSTED:
            message = "the search has seen every configuration that can be reached"
            return PlanResult(Status.INFEASIBLE, None, None, perf_counter() - begin_s, 0.0, np.inf, hunt.counters(), message)
        if state != _lacam.REACHED:
            why = f"{time_limit_s:g} s" if state == _lacam.RUNNING else f"{self.memory_mb} MB"
            return timed_out(begin_s, lower_bound, f"no solution within {why}", **hunt.counters())
        path = hunt.path()
        cost = sum_of_costs(path, opening.world.goal)
        stats = {"first_solution_time_s": perf_counter() - begin_s, "first_solution_cost": float(cost)}
        task = None if opening.world.packed else task_of(opening.problem, opening.world.table)
        if task and room_bytes(task, len(path) + SPARE_STEPS) > self.memory_mb * 1_000_000:
            task = None
        if task and self.polish and cost > lower_bound:
            polished = self._refinement(task, path, opening)
            polished.until(deadline_s - _to_write(path), most_labels=polishing_labels(self.polish, problem.num_robots))
            path, cost = polished.path(), polished.cost
            stats |= {"polished_time_s": perf_counter() - begin_s, "polished_cost": float(cost)}
        if self.anytime and cost > lower_bound:
            path = self._improved(hunt, task, path, opening)
        return opening.solved(path, **stats, **hunt.counters())

    def _first(self, opening: Opening) -> "tuple[_Hunt, int]":
        """A search that has reached the goal, or why none has: EXHAUSTED, FULL, RUNNING.

        Where it wanders about it begins anew with other chances, each time after twice as many expansions, so that it
        stays complete.
        """
        expansions = 200 + 10 * opening.num_guided
        while True:
            hunt = _Hunt(self, opening)
            state = hunt.until(opening.deadline_s, first=True, expansions=expansions)
            if state != _lacam.RUNNING or perf_counter() >= opening.deadline_s:
                return hunt, state
            expansions *= 2

    def _refinement(self, task: Task, path: np.ndarray, opening: Opening) -> Refinement:
        return Refinement(task, path, self.neighbourhood, opening.rng, following=self.following, rotations=self.rotations)

    def _improved(self, hunt: "_Hunt", task: Task | None, path: np.ndarray, opening: Opening) -> np.ndarray:
        """The best path at the deadline, or when none can be better."""
        lower_bound, deadline_s = opening.lower_bound, opening.deadline_s
        refinement = self._refinement(task, path, opening) if task else None
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
                        refinement = self._refinement(task, path, opening) if task else None
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

    def __init__(self, settings: Lacam, opening: Opening) -> None:
        self.world, self.scratch = opening.world, build_scratch(opening.world)
        self._settings, self._rng, self._guided, self._num_guided = settings, opening.rng, opening.guided, opening.num_guided
        num_robots = len(opening.steps)
        self._base_order = np.argsort(-opening.steps, kind="stable").astype(np.int32)
        self._to, self._best = np.empty(num_robots, np.int32), np.empty(num_robots, np.int32)
        self._search = _room(num_robots, self.scratch.candidate.shape[1], nodes=256)
        self._at_once = 1
        _lacam.begin(self.world, self._search, opening.problem.start.astype(np.int32), self._base_order, int(opening.steps.sum()))

    def until(self, deadline_s: float, *, first: bool, expansions: int = FOREVER) -> int:
        """Search until the deadline or so many expansions in all.

        REACHED at the first solution, or at the end if a better one was found; else RUNNING, EXHAUSTED, FULL.
        """
        given = self._settings
        better = False
        while (slice_s := perf_counter()) < deadline_s and (before := int(self._search.count[_lacam.EXPANSIONS])) < expansions:
            world, most = (self._guided, self._num_guided) if before < self._num_guided else (self.world, expansions)
            state = _lacam.search_on(
                world, self.scratch, self._search, self._base_order, self._to, self._best,
                given.num_tries, given.hindrance, min(self._at_once, most - before), self._rng,
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
