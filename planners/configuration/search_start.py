"""How PIBT and LaCAM begin: distances, answers that need no search, paths without collisions where they are easy to find, else a guide."""

from collections.abc import Callable
from dataclasses import dataclass
from time import process_time

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.answers import deadline_of, order_clash, unplanned
from planners.configuration._pibt_instance import PibtInstance
from planners.configuration.guides import are_thin, guide_of
from planners.world import build_world, is_large, is_vast, solved, sum_of_costs, tiled, without_search

FEW = 16  # vertices for each robot, from which on there is a way past the others, however long ways are


@dataclass(frozen=True)
class SearchStart:
    """Where a search begins."""

    given: Problem
    problem: Problem  # the same, or with its vertices renumbered
    original: IntArray | None  # [V] the given number of each vertex, None where they are the same
    world: PibtInstance  # without a guide
    guided: PibtInstance  # with one, or the same
    path: np.ndarray | None  # [T, R] paths without collisions, where they were looked for and easy to find
    labels: int  # made to find them
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

        It keeps robots from each other on their long ways, and could keep the last ones from their goals.
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
    problem: Problem,
    time_limit_s: float,
    chance: int,
    *,
    ways: int,
    flow: int,
    following: bool,
    rotations: bool,
    packed: bool | None,
    easy: Callable[[Problem, PibtInstance, np.random.Generator, float], tuple[np.ndarray | None, int]] | None = None,
) -> SearchStart | PlanResult:
    """Where the search for a problem begins, or the result where none is needed or the time is up already.

    Parameters
    ----------
    problem, time_limit_s
        As given to the planner.
    chance
        Purpose of the stream of chance.
    ways, flow
        Rounds of giving robots ways of their own, where lanes are little used, and ways for the guide elsewhere; 0 for none.
    following, rotations
        See `PibtInstance`.
    packed
        Whether to pack distances; None to see for itself.
    easy
        Looks for paths without collisions where robots use lanes little, until a time: see `first_paths`; None for no such paths.
    """
    begin_s = process_time()
    deadline_s = deadline_of(time_limit_s)
    given, original = problem, None
    packed = is_large(problem) if packed is None else packed
    if packed and is_vast(problem):
        problem, original = tiled(problem)
    built = build_world(problem, deadline_s, packed=packed, following=following, rotations=rotations)
    if built is None:
        return unplanned(Status.TIMED_OUT, begin_s, "the time limit passed while distances were computed")
    world, steps = built
    known = without_search(given, steps, begin_s) or order_clash(given)
    if known:
        return known
    rng = np.random.default_rng([problem.seed, chance])
    path, labels = None, 0
    thin = are_thin(problem, steps) or FEW * problem.num_robots <= problem.graph.num_vertices
    if easy and ways and thin and not problem.window_steps:
        path, labels = easy(problem, world, rng, 0.5 * (process_time() + deadline_s))
    guided = guide_of(problem, world, ways, flow, deadline_s, rng) if path is None and problem.num_robots > 1 else world
    return SearchStart(given, problem, original, world, guided, path, labels, steps, rng, begin_s, deadline_s)
