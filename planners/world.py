"""Beginnings and ends of PIBT, LaCAM and LNS2: distances, answers that need no search, paths that are easy to find, else a guide; plans."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from mmap import mmap
from time import process_time

import numpy as np

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import IntArray, PlanGraph, frozen, nav_graph, plan_graph
from mrp_sumo.core.options import option
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import check_time, deadline_of, goals_clash, order_clash, unplanned
from mrp_sumo.search.distance import UNREACHABLE, steps_to_targets
from mrp_sumo.traffic.clashes import clashes_of, with_beside
from planners.configuration._pibt_instance import SLACK_STEPS, Compass, PibtInstance, extend_all
from planners.configuration.guides import are_thin, guide_of

TABLE_CELLS = 10_000_000  # tables of steps larger than this are packed
WHOLE_CELLS = 100_000_000  # and larger than this are begun only about the robots' ways
TILE = 16  # side of a tile in steps: 256 vertices are one line of 64 bytes
SLICE_S = 0.02  # how long a kernel runs until the clock is read
FEW = 16  # vertices for each robot, from which on there is a way past the others, however long ways are
LONGEST_LOCAL = 126  # steps of a path of local guidance: its tables have a slot for each step and vertex


@dataclass(frozen=True)
class ByConfigurations:
    """Parameters that PIBT and LaCAM have in common: the moves that robots may make at once, and what guides them."""

    following: bool = option(
        False, "also forbid entering a vertex in the step in which another robot leaves it; `pibt` then rarely gets through crowds"
    )
    rotations: bool = option(True, "allow rings of robots that all move at once, where the policy can drive them")
    hindrance: bool = option(True, "among equally near vertices, prefer those that fewer neighbours want")
    ways: int = option(2, "guidance by ways: rounds, 0 for none")
    flow: int = option(1, "guidance by flow: rounds, 0 for none")
    local: int = option(14, "local guidance: steps ahead, at most 126, 0 for none")

    def __post_init__(self) -> None:
        if not 0 <= self.local <= LONGEST_LOCAL:
            raise PlanError(f"local is {self.local}, expected 0 to {LONGEST_LOCAL}")


EasyPaths = Callable[[Problem, PibtInstance, np.random.Generator, float], tuple[np.ndarray | None, int]]


@dataclass(frozen=True)
class SearchStart:
    """Beginning of a search."""

    request: Problem
    problem: Problem  # the same, or with its vertices renumbered
    original: IntArray | None  # [V] the number of each vertex in the request, None where they are the same
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
        window = self.request.window_steps
        path = path[: window + 1] if window else path
        path = path if self.original is None else np.take(self.original.astype(path.dtype), path.T).T
        return solved(self.request, path, self.begin_s, self.lower_bound, **stats)


def search_start(
    planner: ByConfigurations,
    problem: Problem,
    time_limit_s: float,
    chance: int,
    packed: bool | None,
    easy: EasyPaths | None = None,
) -> SearchStart | PlanResult:
    """Beginning of the search for a problem, or the result where none is needed or the time is up already.

    `chance` is the purpose of the stream of chance; `packed` is whether to pack distances, None to see for itself; `easy` looks for paths
    without collisions where robots use lanes little, until a time, see `first_paths`.
    """
    begin_s = process_time()
    deadline_s = deadline_of(time_limit_s)
    request, original = problem, None
    packed = is_large(problem) if packed is None else packed
    if packed and is_vast(problem):
        problem, original = tiled(problem)
    try:
        world, steps = build_world(problem, deadline_s, packed=packed, rules=planner)
    except TimeoutError:
        return unplanned(Status.TIMED_OUT, begin_s, "the time limit passed while distances were computed")
    known = without_search(request, steps, begin_s) or order_clash(request)
    if known:
        return known
    rng = np.random.default_rng([problem.seed, chance])
    path, labels = None, 0
    thin = are_thin(problem, steps) or FEW * problem.num_robots <= problem.graph.num_vertices
    if easy and planner.ways and thin and not problem.window_steps:
        path, labels = easy(problem, world, rng, 0.5 * (process_time() + deadline_s))
    guided = world
    if path is None and problem.num_robots > 1:
        guided = guide_of(problem, world, planner.ways, planner.flow, deadline_s, rng)
    return SearchStart(request, problem, original, world, guided, path, labels, steps, rng, begin_s, deadline_s)


def is_large(problem: Problem) -> bool:
    """True if tables of steps would take much memory, and distances can be packed instead.

    Later than otherwise in a window: who plans again and again has most of the tables from before.
    """
    most = WHOLE_CELLS if problem.window_steps else TABLE_CELLS
    return problem.num_robots * problem.graph.num_vertices > most and bool((problem.graph.reverse >= 0).all())


def is_vast(problem: Problem) -> bool:
    """True if it would take long to pack distances everywhere."""
    return problem.num_robots * problem.graph.num_vertices > WHOLE_CELLS


def tiled(problem: Problem) -> tuple[Problem, IntArray]:
    """The problem with vertices renumbered tile by tile, so that those near each other share lines of the processor's cache.

    Names are not renumbered: the graph is good for planning only. Also [V] the old number of each vertex.
    """
    graph = problem.graph
    unit = float(np.median(graph.length_m)) if graph.num_lanes else 1.0
    x, y = np.floor((graph.xy - graph.xy.min(axis=0)) / unit + 0.25).astype(np.int64).T
    original = np.lexsort((x, y, x // TILE, y // TILE)).astype(np.int64)
    number = np.empty(graph.num_vertices, np.int64)
    number[original] = np.arange(graph.num_vertices)
    tail, head = number[graph.tail], number[graph.head]
    lanes = np.lexsort((head, tail))
    place = np.empty(graph.num_lanes, np.int64)
    place[lanes] = np.arange(graph.num_lanes)
    reverse = np.where(graph.reverse >= 0, place[graph.reverse], -1)[lanes]
    renumbered = replace(
        graph,
        xy=frozen(graph.xy[original]),
        level=frozen(graph.level[original]),
        vertex_options=tuple(graph.vertex_options[v] for v in original.tolist()),
        tail=frozen(tail[lanes]),
        head=frozen(head[lanes]),
        length_m=frozen(graph.length_m[lanes]),
        reverse=frozen(reverse),
        lane_options=tuple(graph.lane_options[lane] for lane in lanes.tolist()),
    )
    return replace(problem, graph=renumbered, start=number[problem.start], goal=number[problem.goal]), original


def build_world(
    problem: Problem, deadline_s: float, *, packed: bool, rules: ByConfigurations = ByConfigurations()
) -> tuple[PibtInstance, IntArray]:
    """The instance and [R] steps from start to goal, -1 where there is no way; TimeoutError when the deadline (process_time) passes first.

    `packed` is whether to keep two bits a vertex, for which all lanes must have opposites; `rules` say which moves robots may make at once.
    """
    graph, target, (clashes, spots) = problem.graph, np.array(problem.target), clashes_of(problem)
    num_robots, num_vertices = problem.num_robots, graph.num_vertices
    shared = len(spots.place) < num_vertices
    steps, table = np.full(num_robots, -1, np.int64), frozen(np.zeros((1, 1), np.int32))
    compass = _compass(graph, num_robots) if packed else _compass(None, 1)
    if packed:
        at_once, slack = max(1, 2_000_000 // num_vertices), SLACK_STEPS if is_vast(problem) else num_vertices
        for a in range(0, num_robots, at_once):
            check_time(deadline_s)
            extend_all(compass, target, np.array(problem.start), a, min(a + at_once, num_robots), slack, steps)
    else:
        table = steps_to_targets(problem, partial(check_time, deadline_s))
        steps[:] = table[np.arange(num_robots), problem.start]
        steps[steps >= UNREACHABLE] = -1
    world = PibtInstance(
        first=graph.first,
        head=graph.head,
        goal=target,
        steps=steps,
        base_order=np.lexsort((-steps, *(() if problem.since_s is None else (problem.since_s,)))).astype(np.int32),
        table=table,
        packed=packed,
        compass=compass,
        two_way=not shared and _is_two_way(problem),
        guided=False,
        guide=np.zeros((1, 1), np.int32),
        toll=np.zeros(1, np.int64),
        path=np.zeros((0, 1), np.int32),
        following=rules.following,
        rotations=rules.rotations and clashes.rotations,
        hindrance=rules.hindrance,
        near=clashes.any,
        clashes=with_beside(clashes, spots),
        shared=shared,
        spot=spots.of,
        move=spots.move,
        spot_first=spots.first,
        spot_head=spots.head,
        spot_tail=spots.tail,
        back=spots.back,
    )
    return world, steps


def _is_two_way(problem: Problem) -> bool:
    """True if every lane that robots can come to has its opposite; those that leave a vertex where nobody may come do not count."""
    graph, comes = problem.graph, np.zeros(problem.graph.num_vertices, np.bool_)
    comes[graph.head] = comes[problem.start] = True
    return bool((graph.reverse >= 0)[comes[graph.tail]].all())


def _compass(graph: PlanGraph | None, num_robots: int) -> Compass:
    """Nothing known yet; without a graph, what stands where distances are in a table."""
    if graph is None:
        one = np.zeros(1, np.int32)
        return Compass(np.zeros((1, 1), np.uint8), one, one, one, np.zeros((1, 2), np.float32))
    longest = np.abs(graph.xy[graph.head] - graph.xy[graph.tail]).sum(1).max(initial=0)
    bound = np.array(graph.xy / longest if longest > 0 else graph.xy, np.float32)
    num_bytes = (graph.num_vertices + 3) // 4
    # zeros of which only what is written takes memory; numpy's own arrays are laid out in large pages, mostly empty ones here
    code = np.frombuffer(mmap(-1, num_robots * num_bytes), np.uint8).reshape(num_robots, num_bytes)
    return Compass(code, graph.first.astype(np.int32), graph.head.astype(np.int32), np.zeros(graph.num_vertices, np.int32), bound)


def without_search(problem: Problem, steps: IntArray, begin_s: float) -> PlanResult | None:
    """The result where none has to be searched for: goals that clash or are out of reach, or everybody at home already."""
    if clash := goals_clash(problem):
        return clash
    if (steps < 0).any():
        robot = int(np.flatnonzero(steps < 0)[0])
        graph = problem.graph
        places = f"'{graph.known_as(problem.target[robot])}' from '{graph.known_as(problem.start[robot])}'"
        message = f"{problem.fleet.robot_name[robot]} cannot reach its goal {places}"
        return unplanned(Status.INFEASIBLE, begin_s, message, math.inf)
    if not steps.any():
        return solved(problem, problem.start[None, :], begin_s, 0.0)
    return None


def solved(problem: Problem, path: np.ndarray, begin_s: float, lower_bound: float, **stats: float) -> PlanResult:
    """SOLVED with the plan of `path` [T, R]."""
    plan = plan_of_paths(list(np.ascontiguousarray(path.T)), problem.step_s)
    return PlanResult(Status.SOLVED, plan, planning_time_s=process_time() - begin_s, lower_bound_steps=lower_bound, stats=stats)


def sum_of_costs(path: np.ndarray, goal: IntArray) -> int:
    """Standard sum of costs of a path [T, R], with everybody at the goal [R] in the last row.

    It counts for each robot the last step at which it is not yet at its goal to stay.
    """
    away = path != goal
    last = len(path) - np.argmax(away[::-1], axis=0)
    return int(np.where(away.any(axis=0), last, 0).sum())


@cache
def small_problem() -> Problem:
    """Two robots that change places beside a siding: enough to compile every kernel."""
    lanes = [(0, 1), (1, 0), (1, 2), (2, 1), (1, 3), (3, 1)]
    nav = nav_graph(name="siding", xy=[[0, 0], [1, 0], [2, 0], [1, 1]], lanes=lanes)
    graph = plan_graph(nav, kind="roadmap", cell_m=1.0)
    fleet = fleet_of(RobotType("any", 0.1, 0.1, 1.0, 1.0, 1.0, 1.0), 2)
    return Problem(graph, fleet, np.array([0, 2]), np.array([2, 0]), np.array([0, 1]), 1.0)
