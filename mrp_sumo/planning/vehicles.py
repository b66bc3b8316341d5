"""Problems of vehicles that cannot turn in place, as planners are asked: on the graph of their moves (`traffic.moves`).

Every start becomes the state in which the vehicle stands there, every goal the nearest state in which it can come there; the plan comes
back on the map's vertices. Planners need not know of it.
"""

from dataclasses import replace

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, frozen
from mrp_sumo.core.plan import Plan, PlanResult
from mrp_sumo.core.problem import Problem, Standing
from mrp_sumo.errors import PlanError
from mrp_sumo.search.distance import UNREACHABLE, Distances, StepArray, distances
from mrp_sumo.search.route import shortest_route
from mrp_sumo.traffic.courses import course_rad
from mrp_sumo.traffic.moves import ANYWHERE, BOUND, STANDING, MoveGraph, arrivals_at, move_graph, off_rad, standing_at_starts
from mrp_sumo.traffic.turns import MAY_STAND_RAD, obstacle_from, obstacle_to, stands_bent, turns_of


def on_moves(problem: Problem) -> Problem:
    """The problem on the graph of moves. Raises PlanError where a vehicle cannot start as it is to, or make the turns on its way."""
    if not problem.is_assigned:
        raise PlanError("vehicles that cannot turn in place need a goal each before it is planned (assignment.mode: fixed or optimal)")
    graph = move_graph(problem.graph, problem.fleet, problem.barred)
    standing = standing_at_starts(problem) if problem.standing is None else problem.standing
    start, target, goal = _starts(problem, graph, standing), problem.target, np.zeros(problem.num_robots, np.int64)
    taken = np.zeros(problem.graph.num_vertices, np.bool_)
    taken[target] = True
    heading, steps = problem.heading_at_target, _steps_past_goals(graph, start, taken)
    is_vehicle = problem.fleet.is_vehicle
    for r, (at, place, kind) in enumerate(zip(start.tolist(), target.tolist(), problem.fleet.kind.tolist())):
        stays = graph.place[at] == place and (np.isnan(heading[r]) or _faces(problem, standing, r, float(heading[r])))
        is_first = is_vehicle[r] and (problem.standing is None or standing.does[r] == ANYWHERE)  # into that it comes no more
        if stays and not (is_first and _is_passed(graph, start, target, r)):
            goal[r] = at
        elif is_vehicle[r]:
            goal[r] = _goal(graph, kind, at, place, float(heading[r]), (taken, steps[r]))
        else:
            goal[r] = graph.states[kind].begin + place
        if goal[r] < 0:
            reached = graph.place[_steps_past_goals(graph, start[[r]], np.zeros_like(taken))[0] < UNREACHABLE]
            raise PlanError(_why_not(problem, standing, r, len(np.unique(reached))))
        if graph.behind[goal[r]] >= 0:
            taken[graph.behind[goal[r]]] = True
    return replace(
        problem,
        graph=graph,
        start=frozen(start),
        goal=frozen(goal),
        goal_of=np.arange(problem.num_robots),
        barred=None,
        via=(),
        start_heading_rad=None,
        goal_heading_rad=None,
        goal_kind=None,
        standing=None,
    )


def within_reach(problem: Problem) -> Problem:
    """The problem in which vehicles stay where they start if none of their moves bring them to their goals, or others stay there."""
    if not problem.fleet.vehicle_of_kind:
        return problem
    graph = move_graph(problem.graph, problem.fleet, problem.barred)
    start = _starts(problem, graph, standing_at_starts(problem) if problem.standing is None else problem.standing)
    target, heading, kind = problem.target.copy(), problem.heading_at_target.copy(), problem.fleet.kind
    for r in np.flatnonzero(problem.fleet.is_vehicle & (target != problem.start)).tolist():
        if not np.isfinite(_lengths_m(graph, int(kind[r]), int(start[r]), int(target[r]), float(heading[r]))).any():
            target[r] = problem.start[r]
    stay = target != problem.target
    if not stay.any():
        return problem
    while (taken := ~stay & (target != problem.start) & np.isin(target, problem.start[stay])).any():
        stay |= taken
        target[taken] = problem.start[taken]
    heading[stay] = np.nan
    return replace(problem, goal=target, goal_of=np.arange(problem.num_robots), goal_heading_rad=heading, goal_kind=None)


def on_map(result: PlanResult, graph: MoveGraph) -> PlanResult:
    """A result on the graph of moves as one on the map. What is proved there of costs holds for these states alone."""
    plan = result.plan
    return replace(result, plan=None if plan is None else _on_map(plan, graph), goal_of=None, lower_bound_steps=0.0)


def _on_map(plan: Plan, graph: MoveGraph) -> Plan:
    in_steps = None if plan.in_steps is None else _on_map(plan.in_steps, graph)
    return replace(plan, vertex=frozen(graph.place[plan.vertex]), in_steps=in_steps)


def _faces(problem: Problem, standing: Standing, robot: int, heading: float) -> bool:
    """True if a vehicle is at its start in a heading, or stands there without one."""
    does, lane, gear = int(standing.does[robot]), int(standing.lane[robot]), int(standing.gear[robot])
    if does == ANYWHERE:
        return True
    vehicle = problem.fleet.types[int(problem.fleet.kind[robot])]
    bent = does == BOUND or stands_bent(turns_of(problem.graph, vehicle), lane, gear) is not None
    return not bent and bool(off_rad(course_rad(problem.graph)[[lane], 1], heading + np.pi * gear)[0] <= MAY_STAND_RAD)


def _starts(problem: Problem, graph: MoveGraph, standing: Standing) -> IntArray:
    """[R] vertices of the graph of moves."""
    start = np.empty(problem.num_robots, np.int64)
    for r, kind in enumerate(problem.fleet.kind.tolist()):
        states, v, does = graph.states[kind], int(problem.start[r]), int(standing.does[r])
        if does == BOUND and standing.came[r] >= 0 and problem.fleet.types[kind].trailers:
            turns = turns_of(problem.graph, problem.fleet.types[kind])
            start[r] = states.bound[turns.between(int(standing.came[r]), int(standing.lane[r]))]
        else:
            start[r] = states.anywhere[v] if does == ANYWHERE else states.at[does, standing.lane[r], standing.gear[r]]
    return start


def _steps_past_goals(graph: MoveGraph, start: IntArray, taken: BoolArray) -> StepArray:
    """[R, V'] steps from each start to all states, on paths that lead over no goal that is taken [V]."""
    lanes, through = distances(graph), ~taken[graph.place]
    through[start] = True
    keep = through[lanes.tail_in]
    return Distances(np.concatenate([[0], np.cumsum(keep)])[lanes.first_in], lanes.tail_in[keep]).to_all(start)


def _is_passed(graph: MoveGraph, start: IntArray, target: IntArray, robot: int) -> bool:
    """True if another has no path to its goal [R] but over the place of a robot."""
    others, taken = np.arange(len(start)) != robot, np.zeros(graph.base.num_vertices, np.bool_)
    taken[target[robot]] = True
    reached = _steps_past_goals(graph, start[others], taken) < UNREACHABLE
    return not (reached & (graph.place == target[others, None])).any(1).all()


def _goal(graph: MoveGraph, kind: int, at: int, place: int, heading: float, others: tuple[BoolArray, StepArray]) -> int:
    """The nearest state in which a vehicle of a type can come to its goal, -1: none.

    Rather one in which it can leave again, to which it does not come from a goal that is taken [V], or at least not over one: others may
    stand there by then. There is a path over none where it has steps [V'].
    """
    arrivals, (taken, steps) = arrivals_at(graph, kind, place), others
    length_m = _lengths_m(graph, kind, at, place, heading)
    can_come = np.isfinite(length_m)
    if not can_come.any():
        return -1
    rank = np.where(can_come, 4 * ~arrivals.leaves + 2 * taken[arrivals.tail] + (steps[arrivals.state] >= UNREACHABLE), 8)
    return int(arrivals.state[np.lexsort((length_m, rank))[0]])


def _lengths_m(graph: MoveGraph, kind: int, at: int, place: int, heading: float) -> FloatArray:
    """[A] lengths of the ways from a state to those in which a vehicle of a type comes to a place; inf: none, or in another heading."""
    arrivals = arrivals_at(graph, kind, place)
    if np.isnan(heading):
        return arrivals.length_m[:, at]
    return np.where(off_rad(arrivals.heading_rad, heading) <= MAY_STAND_RAD, arrivals.length_m[:, at], np.inf)


def _why_not(problem: Problem, standing: Standing, robot: int, num_reached: int) -> str:
    """Why a vehicle cannot reach its goal, by how it stands and the shortest path of a robot that turns in place."""
    base, fleet = problem.graph, problem.fleet
    kind, start, goal = int(fleet.kind[robot]), int(problem.start[robot]), int(problem.target[robot])
    free = np.ones(base.num_lanes, np.bool_) if problem.barred is None else ~problem.barred[kind]
    text = f"{fleet.robot_name[robot]} cannot reach its goal '{base.known_as(goal)}' from '{base.known_as(start)}'"
    route = shortest_route(base, free, start, goal)
    obstacle = obstacle_from(base, fleet.types[kind], *(int(column[robot]) for column in (standing.lane, standing.gear)))
    if standing.does[robot] != STANDING or not obstacle:
        obstacle = obstacle_to(base, fleet.types[kind], route) if route else ""
    places = len(np.union1d(base.tail[free], base.head[free]))
    return f"{text}: {obstacle or f'by moves that it can make it comes to {num_reached} of {places} places only'}"
