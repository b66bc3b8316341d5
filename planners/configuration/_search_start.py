"""How PIBT and LaCAM begin: distances, answers that need no search, and a guide where there is room for one."""

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.plan import PlanResult
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.answers import order_clash
from planners._world import build_world, checked_deadline, is_large, solved, sum_of_costs, tiled, timed_out, without_search
from planners.configuration import _flow
from planners.configuration._flow import Flow
from planners.configuration._pibt_instance import PibtInstance

GUIDE_CELLS = 40_000_000  # robots times vertices; guides larger than this take too long
LONGEST_WAY = 4096  # lanes of a way that count in the flow


@dataclass(frozen=True)
class SearchStart:
    """Where a search begins."""

    given: Problem
    problem: Problem  # the same, or with its vertices renumbered
    original: IntArray | None  # [V] the given number of each vertex, None where they are the same
    world: PibtInstance  # without a guide
    guided: PibtInstance  # with one, or the same
    steps: IntArray  # [R] from start to goal
    rng: np.random.Generator
    begin_s: float
    deadline_s: float

    @property
    def lower_bound(self) -> float:
        return float(self.steps.sum())

    @property
    def num_guided(self) -> int:
        """Steps after which the guide has done its work: the longest way.

        It keeps robots from each other on their long ways, and would keep the last ones from their goals.
        """
        return int(self.steps.max())

    def solved(self, path: np.ndarray, **stats: float) -> PlanResult:
        """SOLVED with the plan of `path` [T, R], in the problem's own numbers."""
        stats = {"cost": float(sum_of_costs(path, self.world.goal))} | stats
        path = path if self.original is None else self.original[path]
        window = self.given.window_steps
        path = path[: window + 1] if window else path
        return solved(self.given, path, self.begin_s, self.lower_bound, **stats)


def search_start(
    problem: Problem, time_limit_s: float, chance: int, *, flow: int, following: bool, rotations: bool, packed: bool | None
) -> SearchStart | PlanResult:
    """Where the search for a problem begins, or the result where none is needed or the time is up already.

    Parameters
    ----------
    problem, time_limit_s
        As given to the planner.
    chance
        Purpose of the stream of chance.
    flow
        Rounds of giving ways for the guide, 0 for none.
    following, rotations
        See `PibtInstance`.
    packed
        Whether to pack distances; None to see for itself.
    """
    begin_s = perf_counter()
    deadline_s = checked_deadline(time_limit_s)
    given, original = problem, None
    packed = is_large(problem) if packed is None else packed
    if packed:
        problem, original = tiled(problem)
    built = build_world(problem, deadline_s, packed=packed, following=following, rotations=rotations)
    if built is None:
        return timed_out(begin_s, 0.0, "the time limit passed while distances were computed")
    world, steps = built
    known = without_search(given, steps, begin_s) or (None if packed else order_clash(given))
    if known:
        return known
    rng = np.random.default_rng([problem.seed, chance])
    guide = None
    if flow and not packed and problem.num_robots > 1 and problem.num_robots * problem.graph.num_vertices <= GUIDE_CELLS:
        guide = _guide(problem, flow, deadline_s, rng)
    guided = world if guide is None else world._replace(guided=True, guide=guide)
    return SearchStart(given, problem, original, world, guided, steps, rng, begin_s, deadline_s)


def _guide(problem: Problem, rounds: int, deadline_s: float, rng: np.random.Generator) -> np.ndarray | None:
    """[R, V] int32 what is left to each goal, see `_flow`; None when the deadline passes."""
    graph, num_robots = problem.graph, problem.num_robots
    start, goal = np.array(problem.start), np.array(problem.target)
    num_lanes, num_vertices = graph.num_lanes, graph.num_vertices
    flow = Flow(
        first=graph.first,
        head=graph.head,
        reverse=graph.reverse,
        first_in=np.concatenate(([0], np.cumsum(np.bincount(graph.head, minlength=num_vertices)))),
        entering=np.argsort(graph.head, kind="stable"),
        tail=graph.tail,
        cost=np.full(num_lanes, _flow.STEP, np.int64),
        num=np.zeros(num_lanes, np.int64),
        way=np.empty((num_robots, min(num_vertices, LONGEST_WAY)), np.int32),
        length=np.zeros(num_robots, np.int64),
        bucket=np.empty(_flow.MOST + 1, np.int64),
        entry_vertex=np.empty(num_lanes + 1, np.int64),
        entry_next=np.empty(num_lanes + 1, np.int64),
        left=np.empty(num_vertices, np.int32),
    )
    at_once = max(1, 200_000 // num_vertices)
    for _ in range(rounds):
        order = rng.permutation(num_robots)
        for a in range(0, num_robots, at_once):
            if perf_counter() > deadline_s:
                return None
            _flow.give_ways(flow, start, goal, order, a, min(a + at_once, num_robots))
    guide = np.empty((num_robots, num_vertices), np.int32)
    for a in range(0, num_robots, at_once):
        if perf_counter() > deadline_s:
            return None
        _flow.write_guide(flow, goal, guide, a, min(a + at_once, num_robots))
    return guide
