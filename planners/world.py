"""The arrays that PIBT, LaCAM and LNS2 plan on, made from a problem, and the answers that need no search."""

import math
from dataclasses import replace
from functools import cache
from mmap import mmap
from time import process_time

import numpy as np

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import IntArray, PlanGraph, frozen, nav_graph, plan_graph
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.planning.answers import goals_clash, unplanned
from mrp_sumo.search.distance import UNREACHABLE, steps_to_targets
from mrp_sumo.traffic.clashes import clashes_of
from planners._compass import SLACK_STEPS, extend_all
from planners.configuration._pibt_instance import PibtInstance, PibtScratch

TABLE_CELLS = 10_000_000  # tables of steps larger than this are packed
WHOLE_CELLS = 100_000_000  # and larger than this are begun only about the robots' ways
TILE = 16  # side of a tile in steps: 256 vertices are one line of 64 bytes
MOVES_A_LANE = 2.25  # along shortest ways, from which on there is no way past the others
SLICE_S = 0.02  # how long a kernel runs until the clock is read


def is_large(problem: Problem) -> bool:
    """Whether tables of steps would take much memory, and distances can be packed instead.

    Later than otherwise in a window: who plans again and again has most of the tables from before.
    """
    most = WHOLE_CELLS if problem.window_steps else TABLE_CELLS
    return problem.num_robots * problem.graph.num_vertices > most and bool((problem.graph.reverse >= 0).all())


def is_vast(problem: Problem) -> bool:
    """Whether it would take long to pack distances everywhere."""
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
    problem: Problem, deadline_s: float, *, packed: bool, following: bool = False, rotations: bool = True
) -> tuple[PibtInstance, IntArray] | None:
    """The instance and [R] steps from start to goal, -1 where there is no way; None when the deadline passes first.

    Parameters
    ----------
    problem
        With an assignment.
    deadline_s
        On the clock of `process_time`.
    packed
        Whether to keep two bits a vertex; all lanes must have opposites.
    following, rotations
        See PibtInstance.
    """
    graph, target, clashes = problem.graph, np.array(problem.target), clashes_of(problem)
    num_robots, num_vertices = problem.num_robots, graph.num_vertices
    two_way = bool((graph.reverse >= 0).all())
    steps = np.full(num_robots, -1, np.int64)
    table = frozen(np.zeros((1, 1), np.int32))
    code = _unwritten(num_robots, (num_vertices + 3) // 4) if packed else np.zeros((1, 1), np.uint8)
    first_packed = graph.first.astype(np.int32) if packed else np.zeros(1, np.int32)
    head_packed = graph.head.astype(np.int32) if packed else np.zeros(1, np.int32)
    queue = np.zeros(num_vertices if packed else 1, np.int32)
    bound = _bound(graph) if packed else np.zeros((1, 2), np.float32)
    if packed:
        at_once, slack = max(1, 2_000_000 // num_vertices), SLACK_STEPS if is_vast(problem) else num_vertices
        for a in range(0, num_robots, at_once):
            if process_time() > deadline_s:
                return None
            b = min(a + at_once, num_robots)
            extend_all(first_packed, head_packed, target, np.array(problem.start), a, b, code, queue, bound, slack, steps)
    else:
        found = steps_table(problem, deadline_s)
        if found is None:
            return None
        table = found
        steps[:] = table[np.arange(num_robots), problem.start]
        steps[steps >= UNREACHABLE] = -1
    world = PibtInstance(
        first=graph.first,
        head=graph.head,
        tail=graph.tail,
        goal=target,
        steps=steps,
        table=table,
        packed=packed,
        code=code,
        first_packed=first_packed,
        head_packed=head_packed,
        queue=queue,
        bound=bound,
        two_way=two_way,
        guided=False,
        guide=np.zeros((1, 1), np.int32),
        toll=np.zeros(1, np.int64),
        way=np.zeros((0, 1), np.int32),
        following=following,
        rotations=rotations and clashes.rotations,
        near=clashes.any,
        clashes=clashes,
    )
    return world, steps


def _unwritten(num_rows: int, num_columns: int) -> np.ndarray:
    """[N, M] zeros of which only what is written takes memory; numpy's own arrays are laid out in large pages, mostly empty ones here."""
    return np.frombuffer(mmap(-1, num_rows * num_columns), np.uint8).reshape(num_rows, num_columns)


def steps_table(problem: Problem, deadline_s: float) -> np.ndarray | None:
    """[R, V] int32 steps from each vertex to each robot's goal, read-only; None when the deadline passes first."""

    def check() -> None:
        if process_time() > deadline_s:
            raise TimeoutError

    try:
        return steps_to_targets(problem, check)
    except TimeoutError:
        return None


def build_scratch(world: PibtInstance) -> PibtScratch:
    """Room for PIBT's steps."""
    num_vertices, num_robots = len(world.first) - 1, len(world.goal)
    width = int(np.diff(world.first).max(initial=0)) + 1
    return PibtScratch(
        now=np.full(num_vertices, -1, np.int64),
        next=np.full(num_vertices, -1, np.int64),
        wished=np.full(num_vertices if world.near else 1, -1, np.int64),
        onward=np.full(num_robots, -1, np.int64),
        wish=np.full(num_robots, -1, np.int64),
        stack=np.zeros(num_robots + 1, np.int64),
        choice=np.zeros(num_robots, np.int64),
        candidate=np.zeros((num_robots, width), np.int64),
        num=np.zeros(num_robots, np.int64),
        partner=np.zeros(num_robots, np.int64),
        key=np.zeros(width, np.float64),
    )


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
    """Standard sum of costs in steps: for each robot the last step at which it is not yet at its goal to stay.

    Parameters
    ----------
    path
        [T, R], everybody at the goal in the last row.
    goal
        [R]
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


def _bound(graph: PlanGraph) -> np.ndarray:
    """[V, 2] float32 coordinates scaled such that every lane is at most 1 long by the sum of absolute differences."""
    longest = np.abs(graph.xy[graph.head] - graph.xy[graph.tail]).sum(1).max(initial=0)
    return np.array(graph.xy / longest if longest > 0 else graph.xy, np.float32)
