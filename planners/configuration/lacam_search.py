"""The search of LaCAM: its memory, driven by the clock, and what improves its solutions."""

from dataclasses import replace
from functools import partial
from itertools import count, cycle
from time import process_time
from typing import Any

import numpy as np

from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.answers import unplanned, without_effort
from mrp_sumo.planning.registry import planner
from planners._compass import SLACK_STEPS, extend_all
from planners.configuration import _lacam, _traffic_map
from planners.configuration._lacam import LacamMemory
from planners.configuration._pibt_instance import PibtInstance
from planners.configuration.guides import is_room_for_flow, local_guidance, traffic_guide
from planners.configuration.pibt_search import steps_of_window
from planners.configuration.search_start import SearchStart, search_start
from planners.neighbourhood._traffic import RepairTask
from planners.neighbourhood.first_paths import first_paths
from planners.neighbourhood.refinement import FOREVER, SPARE_STEPS, Refinement, polishing_labels, room_bytes, task_on, threads_with_room
from planners.world import SLICE_S, build_scratch, sum_of_costs

CHANCE = 12  # purpose of the stream of chance
USED_UP = -1  # how a search ends whose effort is bounded, beside RUNNING, REACHED, EXHAUSTED and FULL
MOST_POLISHED = 4000  # robots; more are polished only if there is time for that
SEARCH_TURN_S, REFINEMENT_TURN_S, LONGEST_TURN_S = 0.05, 0.1, 2.0  # the shortest turns of an anytime search, and the longest
LABELS = 2  # of a low-level search, for each robot of an expanded configuration
SEARCHES_IN_WINDOW = 2  # one with local guidance, one without
RESTARTS = 20  # orders in which robots are planned one after another, where there was no plan in a window


def plan_by_lacam(lacam: Any, problem: Problem, time_limit_s: float, packed: bool | None) -> PlanResult:
    """See `Lacam.plan`.

    Parameters
    ----------
    lacam
        A `Lacam`, whose module imports this one.
    problem, time_limit_s
        As given to it.
    packed
        See `search_start`.
    """
    start = search_start(
        problem, time_limit_s, CHANCE, ways=lacam.ways, flow=lacam.flow, following=lacam.following, rotations=lacam.rotations,
        packed=packed, easy=partial(_easy_paths, lacam),
    )  # fmt: skip
    if isinstance(start, PlanResult):
        return start
    begin_s, deadline_s, lower_bound = start.begin_s, start.deadline_s, start.lower_bound
    search, state = (LacamSearch(lacam, start, 0), _lacam.REACHED) if start.path is not None else _first(lacam, start)
    if state != _lacam.REACHED and problem.window_steps and (plan := _in_window(lacam, start)) is not None:
        return plan
    if state == _lacam.EXHAUSTED:
        message = "the search has seen every configuration that can be reached"
        return unplanned(Status.INFEASIBLE, begin_s, message, np.inf, **search.counters())
    if state == USED_UP:
        return without_effort(problem, begin_s, lower_bound, **search.counters())
    if state != _lacam.REACHED:
        why = f"{time_limit_s:g} s" if state == _lacam.RUNNING else f"{lacam.memory_mb} MB"
        return unplanned(Status.TIMED_OUT, begin_s, f"no solution within {why}", lower_bound, **search.counters())
    path = search.path() if start.path is None else start.path
    cost = sum_of_costs(path, start.world.goal)
    stats = {"first_solution_time_s": process_time() - begin_s, "first_solution_cost": float(cost)}
    if lacam.traffic and cost > lower_bound and is_room_for_flow(problem) and not (problem.effort or problem.window_steps):
        path, cost = _searched_again(lacam, start, path, cost)
    tables = _task(start)
    task = tables if room_bytes(tables, len(path) + SPARE_STEPS) <= lacam.memory_mb * 1_000_000 else None
    polished = None
    if task and lacam.polish and cost > lower_bound and (problem.num_robots <= MOST_POLISHED or lacam.anytime):
        polished = _refinement(lacam, task, path, start)
        labels = polishing_labels(lacam.polish, problem.num_robots, problem.window_steps)
        if problem.effort:
            left = max(1, problem.effort - search.labels)
            labels = left if lacam.anytime else min(labels, left)
        polished.until(deadline_s - _to_write(path), most_labels=labels)
        path, cost = polished.path(), polished.cost
        stats |= {"polished_time_s": process_time() - begin_s, "polished_cost": float(cost)}
    if lacam.anytime and cost > lower_bound and not problem.effort:
        path = _improved(lacam, search, polished, task, path, start)
    stats |= search.counters()
    del search  # the plan may take as much memory
    return start.solved(path, **stats)


def _easy_paths(
    lacam: Any, problem: Problem, world: PibtInstance, rng: np.random.Generator, until_s: float
) -> tuple[np.ndarray | None, int]:
    """See `first_paths`."""
    kind = {"following": lacam.following, "rotations": lacam.rotations}
    return first_paths(task_on(problem, world), rng, until_s, **kind, effort=problem.effort, memory_mb=lacam.memory_mb)


def _first(lacam: Any, start: SearchStart) -> "tuple[LacamSearch, int]":
    """A search that has reached the goal, or why none has: EXHAUSTED, FULL, RUNNING, USED_UP.

    Where it wanders about it restarts with other random choices, each time after twice as many expansions, so that it
    stays complete; every other time without local guidance, which may be what keeps it there.
    """
    expansions, done, effort = 200 + 10 * start.num_guided, 0, start.given.effort
    most = max(1, effort // (LABELS * len(start.steps))) if effort else FOREVER
    windows = cycle((lacam.local, 0))
    for searches in count(1):
        search = LacamSearch(lacam, start, next(windows))
        state = search.until(start.deadline_s, first=True, expansions=min(expansions, most - done))
        done += search.expansions
        search.labels = start.labels + LABELS * len(start.steps) * done
        if state != _lacam.RUNNING or process_time() >= start.deadline_s:
            return search, state
        if done >= most or (start.given.window_steps and searches == SEARCHES_IN_WINDOW):
            return search, USED_UP
        expansions *= 2
    raise AssertionError("searches end")


def _in_window(lacam: Any, start: SearchStart) -> PlanResult | None:
    """A plan for a window beyond which there is none, or none was found: that of robots one after another, else of PIBT's steps."""
    prioritised = planner("prioritised", {"restarts": RESTARTS, "following": lacam.following})
    by_turns = prioritised.plan(start.given, max(1e-3, start.deadline_s - process_time()))
    if by_turns.status is Status.SOLVED:
        return replace(by_turns, planning_time_s=process_time() - start.begin_s)
    path = steps_of_window(start, lacam.hindrance, lacam.local)
    return None if path is None else start.solved(path)


def _searched_again(lacam: Any, start: SearchStart, path: np.ndarray, cost: int) -> tuple[np.ndarray, int]:
    """The cheapest of the solution and of further ones, each guided by the traffic in all before."""
    num_lanes = start.problem.graph.num_lanes
    traffic = _traffic_map.TrafficMap(np.zeros(num_lanes, np.int64), np.zeros(num_lanes, np.int64))
    found = path
    for _ in range(lacam.traffic):
        _traffic_map.observe(start.world, traffic, found)
        toll = np.empty(num_lanes, np.int64)
        _traffic_map.write_tolls(traffic, toll)
        guide = traffic_guide(start.problem, toll, start.deadline_s)
        if guide is None:
            break
        guided = start.guided._replace(guided=True, guide=guide, toll=toll)
        search = LacamSearch(lacam, replace(start, guided=guided), lacam.local)
        if search.until(start.deadline_s, first=True, expansions=2 * len(path)) != _lacam.REACHED:
            break
        found = search.path()
        if (found_cost := sum_of_costs(found, start.world.goal)) < cost:
            path, cost = found, found_cost
    return path, cost


def _task(start: SearchStart) -> RepairTask:
    """What to refine paths on. Codes may be known about other vertices than the start, where a robot was driven away."""
    problem, world = start.problem, start.world
    if world.packed and start.path is None:
        at, again = np.array(problem.start), np.empty(problem.num_robots, np.int64)
        extend_all(
            world.first_packed, world.head_packed, world.goal, at, 0, len(at), world.code, world.queue, world.bound, SLACK_STEPS, again
        )
    return task_on(problem, world)


def _refinement(lacam: Any, task: RepairTask, path: np.ndarray, start: SearchStart) -> Refinement:
    kind = {"following": lacam.following, "rotations": lacam.rotations, "window": start.given.window_steps, "bandit": lacam.bandit}
    threads = threads_with_room(lacam.threads, task, path, lacam.memory_mb, 0)
    return Refinement(task, path, lacam.neighbourhood, start.rng, threads=threads, **kind)


def _improved(
    lacam: Any, search: "LacamSearch", refinement: Refinement | None, task: RepairTask | None, path: np.ndarray, start: SearchStart
) -> np.ndarray:
    """The best path at the deadline, or when none can be better.

    Search and refinement take turns. A turn with a gain is followed by one twice as long, one without by one half as long: on large
    instances the search rarely gains, and on small ones there comes a time when only the search does.
    """
    lower_bound, goal = start.lower_bound, search.world.goal
    if refinement is None and task:
        refinement = _refinement(lacam, task, path, start)
    best, learned, searching = sum_of_costs(path, goal), 0, True
    search_s, refine_s = SEARCH_TURN_S if refinement else LONGEST_TURN_S, REFINEMENT_TURN_S
    deadline_s = start.deadline_s - _to_write(path)
    while (now_s := process_time()) < deadline_s and best > lower_bound and (searching or refinement):
        if searching:
            if refinement and learned != best and len(path) < 4000:
                search.learn(refinement.path())
                learned = best
            state = search.until(min(deadline_s, now_s + search_s), first=False)
            if state == _lacam.EXHAUSTED:
                break
            cost = sum_of_costs(search.path(), goal) if state == _lacam.REACHED else best
            if refinement:
                search_s = _turn_after(search_s, SEARCH_TURN_S, gained=cost < best)
            if cost < best:
                path, best = search.path(), cost
                refinement = _refinement(lacam, task, path, start) if task else None
            searching = state != _lacam.FULL
        if refinement:
            refinement.until(min(deadline_s, process_time() + refine_s))
            refine_s = _turn_after(refine_s, REFINEMENT_TURN_S, gained=refinement.cost < best)
            if refinement.cost < best:
                path, best = refinement.path(), refinement.cost
    return path


def _turn_after(turn_s: float, least_s: float, *, gained: bool) -> float:
    return min(2 * turn_s, LONGEST_TURN_S) if gained else max(turn_s / 2, least_s)


def _to_write(path: np.ndarray) -> float:
    """Seconds, about, that it takes to make a plan of a path."""
    return 0.01 + 1e-7 * path.size


class LacamSearch:
    """LaCAM's search, as it stands."""

    def __init__(self, settings: Any, start: SearchStart, window: int) -> None:
        self.world, self.scratch = start.world, build_scratch(start.world)
        self._settings, self._rng, self._guided, self._num_guided = settings, start.rng, start.guided, start.num_guided
        num_robots = len(start.steps)
        self._base_order = np.argsort(-start.steps, kind="stable").astype(np.int32)
        self._local = local_guidance(start.problem, window)
        self._to, self._best = np.empty(num_robots, np.int32), np.empty(num_robots, np.int32)
        self._memory = _memory(num_robots, self.scratch.candidate.shape[1], nodes=256)
        self._at_once = 1
        self.labels = start.labels  # what has been done to get here
        _lacam.begin(self.world, self._memory, start.problem.start.astype(np.int32), self._base_order, int(start.steps.sum()))

    def until(self, deadline_s: float, *, first: bool, expansions: int = FOREVER) -> int:
        """Search until the deadline or so many expansions in all.

        REACHED at the first solution, or at the end if a better one was found; else RUNNING, EXHAUSTED, FULL.
        """
        given = self._settings
        better = False
        while (slice_s := process_time()) < deadline_s and (before := int(self._memory.count[_lacam.EXPANSIONS])) < expansions:
            world, most = (self._guided, self._num_guided) if before < self._num_guided else (self.world, expansions)
            state: int = _lacam.search_on(
                world, self.scratch, self._local, self._memory, self._base_order, self._to, self._best,
                given.num_tries, given.hindrance, min(self._at_once, most - before), self._rng,
            )  # fmt: skip
            if state == _lacam.REACHED and first:
                return state
            if state == _lacam.EXHAUSTED:
                return _lacam.REACHED if better else state
            if state == _lacam.FULL and not self._grow():
                return _lacam.REACHED if better else state
            better = better or state == _lacam.REACHED
            done = self._memory.count[_lacam.EXPANSIONS] - before
            self._at_once = max(1, int(done * SLICE_S / max(process_time() - slice_s, 1e-6)))
        return _lacam.REACHED if better else _lacam.RUNNING

    def learn(self, path: np.ndarray) -> None:
        """Make a solution found elsewhere part of the search."""
        while not _lacam.insert_path(self.world, self.scratch, self._memory, path, self._base_order):
            if not self._grow():
                return

    def path(self) -> np.ndarray:
        """[T, R] configurations from the start to the goal."""
        memory = self._memory
        nodes = [memory.count[_lacam.GOAL]]
        while memory.parent[nodes[-1]] >= 0:
            nodes.append(memory.parent[nodes[-1]])
        return memory.config[nodes[::-1]]

    @property
    def expansions(self) -> int:
        return int(self._memory.count[_lacam.EXPANSIONS])

    def counters(self) -> dict[str, float]:
        """For the result's statistics."""
        count = self._memory.count
        return {"nodes": float(count[_lacam.NODES]), "expansions": float(count[_lacam.EXPANSIONS])}

    def _grow(self) -> bool:
        larger = _larger(self._memory, self._settings.memory_mb)
        if larger is not None:
            self._memory = larger
        return larger is not None


def _memory(num_robots: int, width: int, nodes: int) -> LacamMemory:
    """Memory for a number of nodes, and in proportion for the rest; `width` is the most candidates of a robot."""
    branches, edges, opened = nodes * (width + 2) + width, 3 * nodes, 4 * nodes
    return LacamMemory(
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


def prepare_to_grow() -> None:
    """Compile or load what is needed when memory is short."""
    _lacam.fill_slots(_memory(1, 1, nodes=1))


def _larger(search: LacamMemory, memory_mb: int) -> LacamMemory | None:
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
            grown[name] = np.empty((2 * len(old), *old.shape[1:]), old.dtype)  # what is not written takes no memory
            grown[name][: len(old)] = old
    if "config" in grown:
        grown["slot"] = np.empty(2 * len(search.slot), np.int64)
    larger = search._replace(**grown)
    if "config" in grown:
        _lacam.fill_slots(larger)
    return larger
