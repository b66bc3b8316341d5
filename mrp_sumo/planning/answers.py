"""Answers that all planners share: goals out of reach, goals held twice or too close and robots that cannot pass each other,
before the search; memory that runs out, during it.

Refuses nothing: what cannot be solved is an INFEASIBLE result that names robot and goal.
"""

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter, process_time

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.outside import Outside
from mrp_sumo.planning.protocol import Planner
from mrp_sumo.planning.vehicles import on_map, on_moves
from mrp_sumo.search.distance import UNREACHABLE, steps_to_targets
from mrp_sumo.search.solvable import order_broken
from mrp_sumo.traffic.clashes import clashes_of
from mrp_sumo.traffic.moves import MoveGraph

MOST = {"threads": 256, "neighbourhood": 1000, "num_tries": 1000}  # of what takes memory, or time between looks at the clock


def impossible(problem: Problem, check_clock: Callable[[], None] | None = None) -> PlanResult | None:
    """INFEASIBLE for an assigned problem that needs no search to see that; None for others. Robots without a goal stay where they are.

    `check_clock` is called before every few goals; it may raise to give up.
    """
    if clash := goals_clash(problem):
        return clash
    label, name, target = problem.graph.label, problem.fleet.robot_name, problem.target
    steps = steps_to_targets(problem, check_clock)[np.arange(len(target)), problem.start]
    if (steps >= UNREACHABLE).any():
        robot = int(np.flatnonzero(steps >= UNREACHABLE)[0])
        return PlanResult(
            Status.INFEASIBLE,
            message=f"{name[robot]} cannot reach its goal '{label(target[robot])}' from '{label(problem.start[robot])}'",
        )
    return order_clash(problem)


def order_clash(problem: Problem) -> PlanResult | None:
    """INFEASIBLE where two robots of an assigned problem would have to pass each other on a line or ring; else None, as in a window."""
    if problem.window_steps:
        return None
    broken = order_broken(problem)
    if broken is None:
        return None
    a, b = (problem.fleet.robot_name[robot] for robot in broken)
    return PlanResult(Status.INFEASIBLE, message=f"{a} and {b} would have to pass each other where there is no room")


def goals_clash(problem: Problem) -> PlanResult | None:
    """INFEASIBLE where two robots have to end at one vertex, whoever is assigned what, or too close; None otherwise.

    In a window only robots that start too close to each other are.
    """
    if problem.window_steps:
        return _crowded(problem, problem.start, "start")
    label, name = problem.graph.label, problem.fleet.robot_name
    if not problem.is_assigned:
        values, count = np.unique(problem.goal, return_counts=True)
        if len(values) >= min(problem.num_robots, len(problem.goal)):
            return None
        a, b = np.flatnonzero(problem.goal == values[count > 1][0])[:2]
        return PlanResult(Status.INFEASIBLE, message=f"goals {a} and {b} are both '{label(int(problem.goal[a]))}'")
    values, count = np.unique(problem.target, return_counts=True)
    if not (count > 1).any():
        return _crowded(problem, problem.start, "start") or _crowded(problem, problem.target, "have to end")
    vertex = int(values[count > 1][0])
    a, b = np.flatnonzero(problem.target == vertex)[:2]
    return PlanResult(Status.INFEASIBLE, message=f"{name[a]} and {name[b]} both have to end at '{label(vertex)}'")


def _crowded(problem: Problem, vertex: IntArray, what: str) -> PlanResult | None:
    """INFEASIBLE where two robots that have to be drivable stand too close to each other at these vertices [R]; None otherwise."""
    clashes, spots = clashes_of(problem)
    at = spots.of[vertex]
    waiting = len(spots.head) + at
    robot_at = np.full(len(spots.place), -1)
    robot_at[at] = np.arange(problem.num_robots)
    for robot, (spot, begin, end) in enumerate(zip(at.tolist(), clashes.vertex_first[waiting], clashes.vertex_first[waiting + 1])):
        near = clashes.vertex[begin:end], spots.beside[spots.beside_first[spot] : spots.beside_first[spot + 1]], [spot]
        others = robot_at[np.concatenate(near)]
        others = others[(others >= 0) & (others != robot)]
        if len(others):
            pair = sorted((robot, int(others[0])))
            names = " and ".join(problem.fleet.robot_name[r] for r in pair)
            places = " and ".join(f"'{problem.graph.known_as(int(vertex[r]))}'" for r in pair)
            why = _why_crowded(problem, int(vertex[pair[0]]), int(vertex[pair[1]]))
            return PlanResult(Status.INFEASIBLE, message=f"{names} {what} at {places}, {why}")
    return None


def _why_crowded(problem: Problem, a: int, b: int) -> str:
    """Why no two robots may be at two vertices at once."""
    graph = problem.graph
    apart_m, needs_m = float(np.hypot(*(graph.xy[a] - graph.xy[b]))), problem.fleet.separation_m + float(graph.swing_m[[a, b]].sum())
    if apart_m < needs_m:
        return f"{apart_m:.3f} m apart, where they need {needs_m:.3f} m"
    if isinstance(graph, MoveGraph):
        both = {int(graph.place[a]), int(graph.behind[a])} & {int(graph.place[b]), int(graph.behind[b])} - {-1}
        if both:
            return f"and '{graph.base.known_as(both.pop())}' would be taken twice, by trailers"
    return "in one mutex group"


def answer_of(chosen: Planner, problem: Problem, time_limit_s: float) -> PlanResult:
    """The result of a planner, with the times that it took unless it runs in a process of its own; GAVE_UP where it runs out of memory."""
    began, cpu_began = perf_counter(), process_time()
    try:
        result = planned_by(chosen, problem, time_limit_s)
    except MemoryError:
        time_s = perf_counter() - began
        result = PlanResult(Status.GAVE_UP, planning_time_s=time_s, message=f"no memory left after {time_s:.3g} s")
    if result.planning_cpu_s is not None or isinstance(chosen, Outside):
        return result
    return replace(result, planning_time_s=perf_counter() - began, planning_cpu_s=process_time() - cpu_began)


def planned_by(chosen: Planner, problem: Problem, time_limit_s: float) -> PlanResult:
    """The answer of a planner to a problem as it supports it, and vehicles as they can move."""
    if not problem.fleet.vehicle_of_kind:
        return chosen.plan(as_supported(chosen, problem), time_limit_s)
    try:
        moves = on_moves(problem)
    except PlanError as error:
        return PlanResult(Status.INFEASIBLE, message=str(error))
    graph = moves.graph
    assert isinstance(graph, MoveGraph)
    return on_map(chosen.plan(moves, time_limit_s), graph)


def as_supported(chosen: Planner, problem: Problem) -> Problem:
    """The problem as a planner is asked: on lanes for all, unless it plans with those of each type (`supports` has 'types'), or
    keeps each robot where it can still reach its goal on the lanes of its type ('reach').
    """
    supports = getattr(chosen, "supports", ())
    return problem if "types" in supports else problem.for_reach() if "reach" in supports else problem.for_any()


def used_up(problem: Problem, labels: float) -> bool:
    """True if so many labels are all the effort that a problem allows."""
    return 0 < problem.effort <= labels


def without_effort(problem: Problem, began: float, lower_bound_steps: float = 0.0, **stats: float) -> PlanResult:
    """TIMED_OUT: the effort is used up; see `unplanned`."""
    return unplanned(Status.TIMED_OUT, began, f"no plan within an effort of {problem.effort} labels", lower_bound_steps, **stats)


def unplanned(status: Status, began: float, message: str, lower_bound_steps: float = 0.0, **stats: float) -> PlanResult:
    """A result without a plan; `began` is on the clock of `process_time`."""
    return PlanResult(status, planning_time_s=process_time() - began, lower_bound_steps=lower_bound_steps, stats=stats, message=message)


def deadline_of(time_limit_s: float) -> float:
    """The end of a time limit that begins now, on the clock of `process_time`. Raises PlanError when the limit is not above 0, or NaN."""
    if not time_limit_s > 0:
        raise PlanError(f"the time limit is {time_limit_s:g} s, expected a number above 0")
    return process_time() + time_limit_s


def require_least(planner: object, **least: int) -> None:
    """Refuse parameters below these values, and above those of MOST. Raises PlanError."""
    for key, low in least.items():
        value, high = getattr(planner, key), MOST.get(key)
        if value < low or (high is not None and value > high):
            raise PlanError(f"{key} is {value}, expected {low} {'or more' if high is None else f'to {high}'}")


def check_time(deadline_s: float) -> None:
    """Raise TimeoutError after a deadline on the clock of `process_time`."""
    if process_time() > deadline_s:
        raise TimeoutError
