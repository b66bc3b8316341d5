"""LaCAM*: lazy constraints addition search, anytime.

Okumura, AAAI 2023, IJCAI 2023 and AAMAS 2024 (titles in `_lacam.py`). Searches configurations depth first; PIBT
proposes the next one, and constraints are added only where the search comes by again. Complete: finds a
solution or proves that there is none, given time and memory. Anytime, it goes on after the first solution and
converges to the least sum of loss.
"""

import math
from dataclasses import dataclass, replace
from functools import partial
from itertools import count, cycle
from time import process_time
from typing import ClassVar

import numpy as np

from mrp_sumo.core.options import option
from mrp_sumo.core.plan import PlanResult, Status, paths_of_plan, side_by_side
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.answers import require_least, unplanned, without_effort
from mrp_sumo.planning.registry import planner
from planners.configuration import _lacam, _pibt
from planners.configuration._flow import TrafficMap, observe, write_tolls
from planners.configuration._pibt_instance import SLACK_STEPS, PibtInstance, extend_all
from planners.configuration.guides import guide_of, is_room_for_flow, local_guidance, traffic_guide
from planners.neighbourhood._traffic import RepairTask
from planners.neighbourhood.refinement import (
    FOREVER,
    SPARE_STEPS,
    Refinement,
    first_paths,
    polishing_labels,
    prepare,
    room_bytes,
    task_on,
    threads_with_room,
)
from planners.world import SLICE_S, ByConfigurations, SearchStart, search_start, small_problem, sum_of_costs

CHANCE, CHANCE_OF_WAYS = 12, 16  # purposes of streams of chance
FEWEST_MOVES, MOST_MOVES = 1000, 2_500_000  # along shortest ways, and of ways in all rounds, with which easy paths are not the only ones
USED_UP = -1  # how a search ends whose effort is bounded, beside RUNNING, REACHED, EXHAUSTED and FULL
CLOSE = 1.01  # times its lower bound an easy path costs where a search led by ways is often cheaper
MOST_POLISHED = 4000  # robots; more are polished only if there is time for that
SEARCH_TURN_S, REFINEMENT_TURN_S, LONGEST_TURN_S = 0.05, 0.1, 2.0  # the shortest turns of an anytime search, and the longest
LABELS = 2  # of a low-level search, for each robot of an expanded configuration
SEARCHES_IN_WINDOW = 2  # one with local guidance, one without
WANDERED, MOST_FAILED = 3, 8  # times the longest way a path has where its search has wandered; searches in a row that find none shorter
DEAR = 2.0  # times its lower bound a plan costs after polishing for which paths are repaired, too
REPAIR_LABELS, MOST_REPAIR_LABELS = 500, 5_000_000  # for each two robots, four times that where a plan is dear; and at most
RESTARTS = 20  # orders in which robots are planned one after another, where there was no plan in a window


@dataclass(frozen=True)
class Lacam(ByConfigurations):
    """LaCAM; with `anytime` LaCAM*, which uses all its time unless it proves optimality.

    Where robots use the map thinly, the first solution is one of prioritised planning, see `first_paths`; where its paths are hardly longer
    than shortest ones, or of a search as elsewhere, whichever costs less. Elsewhere robots are guided by ways of their own where lanes are
    little used, see `_ways`, and else, where tables allow, by the traffic flow at first, see `_flow`; before each step, they are led round
    each other by local guidance, see `_local_guidance`.
    Where it wanders about, paths that may cross each other are repaired, as `lns2` does it, and taken if they cost less.
    Where tables allow, the first solution is polished by large neighbourhood search, see `Refinement.polish`; anytime, the rest of the time
    goes to both the search and the neighbourhoods.
    """

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "complete; eventually optimal in sum of loss when anytime"
    supports: ClassVar[frozenset[str]] = frozenset({"effort", "window"})

    anytime: bool = option(False, "spend the rest of the time limit on lowering the cost")
    num_tries: int = option(1, "configurations generated at a time, of which the best is kept")
    traffic: int = option(0, "guidance by traffic: further solutions, guided by those before, 0 for none")
    polish: int = option(
        1800,
        "labels a robot spent on improving the first plan, and more while half of them gains 1 %, 0 for none; "
        "more than 4,000 robots are polished only with `anytime`",
    )
    neighbourhood: int = option(4, "robots replanned at a time")
    memory_mb: int = option(2000, "limit for tables and nodes; beyond it a planner gives up or keeps the plan it has")
    threads: int = option(1, "refiners that improve a plan together; as many as fit into `memory_mb`")
    bandit: bool = option(False, "improve around late robots where that has helped (ADDRESS)")

    def __post_init__(self) -> None:
        super().__post_init__()
        require_least(self, num_tries=1, neighbourhood=1, memory_mb=1, threads=1, ways=0, flow=0, traffic=0, polish=0)

    def prepare(self) -> None:
        """Compile or load the kernels."""
        short = replace(self, traffic=min(self.traffic, 1), polish=min(self.polish, 10))  # nothing ends it but that it is done
        replace(short, ways=0, flow=1, polish=10)._plan(small_problem(), math.inf, False)
        replace(short, ways=1, flow=0, polish=0)._plan(small_problem(), math.inf, False)
        replace(short, ways=0, flow=0, traffic=1, polish=0)._plan(small_problem(), math.inf, False)
        short._plan(small_problem(), math.inf, True)
        start = search_start(self, small_problem(), math.inf, CHANCE, False, partial(_easy_paths, self))
        assert not isinstance(start, PlanResult)
        search, *_ = _first(self, start)  # as when anytime, but for the turns of a tenth of a second
        search.learn(_refinement(self, _task(start), search.path(), start).path())
        prepare(self.threads)
        _lacam.fill_slots(_lacam.room_for_nodes(1, 1, nodes=1))  # needed when memory is short

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """SOLVED, with the best plan found if anytime; INFEASIBLE with proof; TIMED_OUT."""
        return self._plan(problem, time_limit_s, None)

    def _plan(self, problem: Problem, time_limit_s: float, packed: bool | None) -> PlanResult:
        start = search_start(self, problem, time_limit_s, CHANCE, packed, partial(_easy_paths, self))
        if isinstance(start, PlanResult):
            return start
        begin_s, deadline_s, lower_bound = start.begin_s, start.deadline_s, start.lower_bound
        start = _with_cheaper_path(self, start)
        search, state, path = _first(self, start)
        if state != _lacam.REACHED and problem.window_steps and (plan := _in_window(self, start)) is not None:
            return plan
        if state == _lacam.EXHAUSTED:
            message = "the search has seen every configuration that can be reached"
            return unplanned(Status.INFEASIBLE, begin_s, message, np.inf, **search.counters())
        if state == USED_UP:
            return without_effort(problem, begin_s, lower_bound, **search.counters())
        if path is None:
            why = f"{time_limit_s:g} s" if state == _lacam.RUNNING else f"{self.memory_mb} MB"
            return unplanned(Status.TIMED_OUT, begin_s, f"no solution within {why}", lower_bound, **search.counters())
        cost = sum_of_costs(path, start.world.goal)
        stats = {"first_solution_time_s": process_time() - begin_s, "first_solution_cost": float(cost)}
        if self.traffic and cost > lower_bound and is_room_for_flow(problem) and not (problem.effort or problem.window_steps):
            path, cost = _searched_again(self, start, path, cost)
        tables = _task(start)
        task = tables if room_bytes(tables, len(path) + SPARE_STEPS) <= self.memory_mb * 1_000_000 else None
        polished = None
        if task and self.polish and cost > lower_bound and (problem.num_robots <= MOST_POLISHED or self.anytime):
            polished = _refinement(self, task, path, start)
            labels = polishing_labels(self.polish, problem.num_robots, problem.window_steps)
            left = max(1, problem.effort - search.labels) if problem.effort else 0
            if self.anytime:
                polished.until(deadline_s - _to_write(path), most_labels=left or labels)
            else:
                polished.polish(deadline_s - _to_write(path), labels, left or FOREVER)
            path, cost = polished.path(), polished.cost
            stats |= {"polished_time_s": process_time() - begin_s, "polished_cost": float(cost)}
        if cost > DEAR * lower_bound and not problem.window_steps:
            repaired = _repaired(self, start, search, 4, self.polish)
            if repaired is not None and (repaired_cost := sum_of_costs(repaired, start.world.goal)) < cost:
                path, cost, polished = repaired, repaired_cost, None
        if self.anytime and cost > lower_bound and not problem.effort:
            path = _improved(self, search, polished, task, path, start)
        stats |= search.counters()
        del search  # the plan may take as much memory
        return start.solved(path, **stats)


def _easy_paths(
    lacam: Lacam, problem: Problem, world: PibtInstance, rng: np.random.Generator, until_s: float
) -> tuple[np.ndarray | None, int]:
    """See `first_paths`."""
    return first_paths(task_on(problem, world), rng, until_s, problem.effort, lacam.memory_mb)


def _first(lacam: Lacam, start: SearchStart) -> tuple["LacamSearch", int, np.ndarray | None]:
    """A search, how it ended (REACHED, EXHAUSTED, FULL, RUNNING or USED_UP), and the path to the goals where there is one.

    Where it wanders about, paths are repaired instead. Where that does not help, it restarts with other random choices, each time after
    twice as many expansions, so that it stays complete; every other time without local guidance, which may be what keeps it there.
    """
    if start.path is not None:
        return LacamSearch(lacam, start, 0), _lacam.REACHED, start.path
    expansions, done, effort, window = 200 + 10 * start.num_guided, 0, start.request.effort, start.request.window_steps
    most = max(1, effort // (LABELS * len(start.steps))) if effort else FOREVER
    windows = cycle((lacam.local, 0))
    for searches in count(1):
        search = LacamSearch(lacam, start, next(windows))
        state = search.until(start.deadline_s, first=True, expansions=min(expansions, most - done))
        done += search.expansions
        search.labels = start.labels + LABELS * len(start.steps) * done
        path = search.path() if state == _lacam.REACHED else None
        if state == _lacam.RUNNING and searches == 1 and not window:
            path = _repaired(lacam, start, search, 1, polish=0)
            state = _lacam.RUNNING if path is None else _lacam.REACHED
        if state != _lacam.RUNNING or process_time() >= start.deadline_s:
            return search, state, path if path is None or effort or window else _sooner(lacam, start, path)
        if done >= most or (window and searches == SEARCHES_IN_WINDOW):
            return search, USED_UP, None
        expansions *= 2
    raise AssertionError("searches end")


def _repaired(lacam: Lacam, start: SearchStart, search: "LacamSearch", times: int, polish: int) -> np.ndarray | None:
    """[T, R] paths that collided at first, see `lns2`; None where none are found with so many times the labels."""
    problem = start.request
    effort = min(times * REPAIR_LABELS * problem.num_robots**2, MOST_REPAIR_LABELS)
    if start.original is not None:
        return None  # too many robots or vertices for tables of them
    if problem.effort:
        effort = min(effort, max(1, (problem.effort - search.labels) // 2))
        search.labels += effort
    lns2 = planner("lns2", {"following": lacam.following, "rotations": lacam.rotations, "memory_mb": lacam.memory_mb, "polish": polish})
    result = lns2.plan(replace(problem, effort=effort), max(1e-3, 0.5 * (start.deadline_s - process_time())))
    if result.plan is None:
        return None
    return side_by_side(paths_of_plan(result.plan, problem.step_s)).astype(np.int32)


def _with_cheaper_path(lacam: Lacam, start: SearchStart) -> SearchStart:
    """The start with the path of a search led by ways, as PIBT's is, where that costs less than an easy one that is close to the bound."""
    path, least = start.path, int(start.steps.sum())
    if path is None or start.request.effort or least < FEWEST_MOVES or lacam.ways * least > MOST_MOVES:
        return start
    if not least < sum_of_costs(path, start.world.goal) < CLOSE * least:
        return start
    rng = np.random.default_rng([start.request.seed, CHANCE_OF_WAYS])
    guided = guide_of(start.problem, start.world, lacam.ways, 0, start.deadline_s, rng)
    search = LacamSearch(lacam, replace(start, guided=guided, rng=rng), lacam.local)
    if search.until(start.deadline_s, first=True, expansions=2 * len(path)) != _lacam.REACHED:
        return start
    return replace(start, path=min(path, search.path(), key=partial(sum_of_costs, goal=start.world.goal)))


def _sooner(lacam: Lacam, start: SearchStart, path: np.ndarray) -> np.ndarray:
    """[T, R] the path; where its search has wandered about, a cheaper one of others that expand no more than the best path has steps."""
    failed, windows = 0, cycle((lacam.local, 0))
    while failed < MOST_FAILED and len(path) > WANDERED * start.num_guided:
        search = LacamSearch(lacam, start, next(windows))
        reached = search.until(start.deadline_s, first=True, expansions=len(path)) == _lacam.REACHED
        best = min(path, search.path(), key=partial(sum_of_costs, goal=start.world.goal)) if reached else path
        path, failed = best, failed + 1 if best is path else 0
    return path


def _in_window(lacam: Lacam, start: SearchStart) -> PlanResult | None:
    """A plan for a window beyond which there is none, or none was found: that of robots one after another, else of PIBT's steps."""
    prioritised = planner("prioritised", {"restarts": RESTARTS, "following": lacam.following})
    by_turns = prioritised.plan(start.request, max(1e-3, start.deadline_s - process_time()))
    if by_turns.status is Status.SOLVED:
        return replace(by_turns, planning_time_s=process_time() - start.begin_s)
    path = _steps_of_window(start, lacam.local)
    return None if path is None else start.solved(path)


def _steps_of_window(start: SearchStart, local: int) -> np.ndarray | None:
    """[T, R] PIBT's steps through a window, or fewer where all are at their goals sooner; None when the time is up."""
    window, order = start.request.window_steps, start.world.base_order.copy()
    path = np.empty((window + 1, len(start.steps)), np.int32)
    path[0] = start.problem.start
    room, t, home = _pibt.PibtRoom(_pibt.room_for_step(start.world), local_guidance(start.world, local)), 0, False
    while t < window and not home:
        if process_time() > start.deadline_s:
            return None
        world, until = (start.guided, min(start.num_guided, window)) if t < start.num_guided else (start.world, window)
        t, home = _pibt.run(world, room, path, t, until, order, start.rng)
    return path[: t + 1]


def _searched_again(lacam: Lacam, start: SearchStart, path: np.ndarray, cost: int) -> tuple[np.ndarray, int]:
    """The cheapest of the solution and of further ones, each guided by the traffic in all before."""
    num_lanes = start.problem.graph.num_lanes
    traffic = TrafficMap(np.zeros(num_lanes, np.int64), np.zeros(num_lanes, np.int64))
    other = path
    for _ in range(lacam.traffic):
        observe(start.world, traffic, other)
        toll = np.empty(num_lanes, np.int64)
        write_tolls(traffic, toll)
        try:
            guide = traffic_guide(start.problem, toll, start.deadline_s)
        except TimeoutError:
            break
        guided = start.guided._replace(guided=True, guide=guide, toll=toll)
        search = LacamSearch(lacam, replace(start, guided=guided), lacam.local)
        if search.until(start.deadline_s, first=True, expansions=2 * len(path)) != _lacam.REACHED:
            break
        other = search.path()
        if (other_cost := sum_of_costs(other, start.world.goal)) < cost:
            path, cost = other, other_cost
    return path, cost


def _task(start: SearchStart) -> RepairTask:
    """What to refine paths on. Codes may be known about other vertices than the start, where a robot was driven away."""
    problem, world = start.problem, start.world
    if world.packed:
        at, again = np.array(problem.start), np.empty(problem.num_robots, np.int64)
        extend_all(world.compass, world.goal, at, 0, len(at), SLACK_STEPS, again)
    return task_on(problem, world)


def _refinement(lacam: Lacam, task: RepairTask, path: np.ndarray, start: SearchStart) -> Refinement:
    threads = threads_with_room(lacam.threads, task, path, lacam.memory_mb, 0)
    return Refinement(task, path, lacam.neighbourhood, start.rng, threads=threads, bandit=lacam.bandit)


def _improved(
    lacam: Lacam, search: "LacamSearch", refinement: Refinement | None, task: RepairTask | None, path: np.ndarray, start: SearchStart
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

    def __init__(self, settings: Lacam, start: SearchStart, window: int) -> None:
        self.world = start.world
        self._room = _pibt.PibtRoom(_pibt.room_for_step(start.world), local_guidance(start.world, window))
        self._settings, self._rng, self._guided, self._num_guided = settings, start.rng, start.guided, start.num_guided
        self._memory = _lacam.room_for_nodes(len(start.steps), self._room.step.candidate.shape[1], nodes=256)
        self._at_once = 1
        self.labels = start.labels  # what has been done to get here
        _lacam.begin(self.world, self._memory, start.problem.start.astype(np.int32), int(start.steps.sum()))

    def until(self, deadline_s: float, *, first: bool, expansions: int = FOREVER) -> int:
        """Search until the deadline or so many expansions in all.

        REACHED at the first solution, or at the end if a better one was found; else RUNNING, EXHAUSTED, FULL.
        """
        better = False
        while (slice_s := process_time()) < deadline_s and (before := int(self._memory.count[_lacam.EXPANSIONS])) < expansions:
            world, most = (self._guided, self._num_guided) if before < self._num_guided else (self.world, expansions)
            iterations = min(self._at_once, most - before)
            state: int = _lacam.search_on(world, self._room, self._memory, self._settings.num_tries, iterations, self._rng)
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
        while not _lacam.insert_path(self.world, self._room.step, self._memory, path):
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
        larger = _lacam.larger_room(self._memory, self._settings.memory_mb)
        if larger is not None:
            self._memory = larger
        return larger is not None
