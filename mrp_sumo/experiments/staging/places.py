"""Starts and goals of a scenario's robots: vertices by name or drawn, and how robots face there.

Refuses names the map does not have, goals that cannot be reached, headings that no lane has.
"""

from collections.abc import Sequence
from functools import cache, partial
from itertools import chain, islice, permutations

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, NavGraph, PlanGraph, frozen
from mrp_sumo.core.problem import Problem, graphs_of_kinds
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive.motion_plan import TURNS_RAD
from mrp_sumo.errors import PlanError, ScenarioError, nearest
from mrp_sumo.io.documents import Place
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.planning.costs import costs_of
from mrp_sumo.search.route import shortest_route
from mrp_sumo.traffic.courses import course_rad
from mrp_sumo.traffic.draw import draw_by_type, most_drawn, mrp_bench_draw, stands_of, uniform_draw
from mrp_sumo.traffic.turns import obstacle_to

WAYS = 50  # between places, on which a turn that cannot be made is looked for


def places(file: ScenarioFile, nav: NavGraph, graph: PlanGraph, model: RobotType, separation_m: float) -> tuple[IntArray, IntArray]:
    """Plan vertices of starts and goals of robots of one type, not assigned yet; with tasks, robots have no goals but their starts."""
    robots = file.scenario.robots
    start = None if robots.starts is None else looked_up(file, nav, graph, ("robots", "starts"), robots.starts[: robots.count])
    if file.scenario.tasks is not None:
        start = _drawn(file, graph, model, separation_m)[0] if start is None else start
        return start, start
    if start is not None and robots.goals is not None:
        fixed = file.scenario.assignment.mode == "fixed"
        goal = looked_up(file, nav, graph, ("robots", "goals"), robots.goals[: len(start)] if fixed else robots.goals)
        values, times = np.unique(goal, return_counts=True)
        if (times > 1).any():
            i, j = np.flatnonzero(goal == values[times > 1][0])[:2]
            raise ScenarioError(
                f"{file.at('robots', 'goals', int(j))}: '{robots.goals[j]}' is the goal of two robots, as '{robots.goals[i]}' is"
            )
        if fixed and len(goal) < len(start):
            raise ScenarioError(f"{file.at('robots', 'goals')}: {len(goal)} goals for {len(start)} robots with a fixed assignment")
        return start, goal
    assert robots.count is not None
    if robots.draw != "mrp_bench":
        return _drawn(file, graph, model, separation_m)
    with file.located("robots", "count"):
        start, goal = mrp_bench_draw(len(graph.vertex_of_station), robots.count, file.scenario.seed)
    return graph.vertex_of_station[start], graph.vertex_of_station[goal]


def places_by_type(
    file: ScenarioFile,
    nav: NavGraph,
    graph: PlanGraph,
    models: Sequence[RobotType],
    barred: BoolArray | None,
    kind: IntArray,
    separation_m: float,
) -> tuple[IntArray, IntArray]:
    """Plan vertices of starts and goals, group by group; those that are not named are drawn where the robots have room."""
    scenario, fixed = file.scenario, []
    for key in ("starts", "goals"):
        vertex = np.full(len(kind), -1)
        for k, group in enumerate(scenario.robots.groups):
            if names := getattr(group, key):
                vertex[kind == k] = looked_up(file, nav, graph, ("robots", "fleet", k, key), names)
        values, times = np.unique(vertex[vertex >= 0], return_counts=True)
        if (times > 1).any():
            raise ScenarioError(
                f"{file.at('robots', 'fleet')}: '{graph.known_as(int(values[times > 1][0]))}' is the {key[:-1]} of two robots"
            )
        fixed.append(vertex)
    types, anywhere = [*zip(models, graphs_of_kinds(graph, barred, len(models)))], scenario.robots.draw == "anywhere"
    with file.located("robots", "fleet"):
        given_start, given_goal = fixed
        start, goal = draw_by_type(types, kind, given_start, given_goal, scenario.seed, separation_m, anywhere=anywhere)
    return (start, start) if scenario.tasks is not None else (start, goal)


def _drawn(file: ScenarioFile, graph: PlanGraph, model: RobotType, separation_m: float) -> tuple[IntArray, IntArray]:
    robots, seed = file.scenario.robots, file.scenario.seed
    num_robots, anywhere = robots.count or 0, robots.draw == "anywhere"
    try:
        return uniform_draw(graph, num_robots, seed, separation_m, anywhere=anywhere, vehicle=model)
    except PlanError:
        fits = most_drawn(graph, seed, separation_m, anywhere=anywhere, vehicle=model)
    cures = [f"robots.count: {fits} fits"] if fits else []
    if not anywhere and (more := most_drawn(graph, seed, separation_m, anywhere=True, vehicle=model)) > fits:
        cures.append(f"robots.draw: anywhere lets {more} stand between stations, too")
    if model.is_vehicle and (obstacle := obstacle_between(graph, model, anywhere=anywhere)):
        cures.append(obstacle)
    if file.scenario.discretisation.clearance == "prune" and graph.num_components > 1:
        cures.append("smaller robots have more room beside walls")
    what = "vertices" if anywhere else "stations"
    turning = f" by turns that '{model.name}' can make" if model.is_vehicle else ""
    room = f", with {model.behind_m:.2f} m of a lane behind starts for trailers" if model.trailers else ""
    raise ScenarioError(
        f"{file.at('robots', 'count')}: {num_robots} robot{'s' * (num_robots != 1)}, but '{graph.name}' has {fits} {what} that reach each "
        f"other{turning} and on which robots may stand at once, {separation_m:.2f} m between centres{room}"
        + (f": {'; '.join(cures)}" if cures else "")
    )


def obstacle_between(graph: PlanGraph, model: RobotType, *, anywhere: bool = False) -> str:
    """The first turn, on ways between places of robots that turn in place, or there and back, that a type cannot make; '' for none."""
    station, free = stands_of(graph, anywhere=anywhere).goal.tolist(), np.ones(graph.num_lanes, np.bool_)
    route, ends = cache(partial(shortest_route, graph, free)), list(islice(permutations(station, 2), WAYS))
    there_and_back = ((route(a, b), route(b, a)) for a, b in ends)
    routes = chain(
        (there for a, b in ends if (there := route(a, b))), (there + back[1:] for there, back in there_and_back if there and back)
    )
    return next((obstacle for each in routes if (obstacle := obstacle_to(graph, model, each))), "")


def looked_up(file: ScenarioFile, nav: NavGraph, graph: PlanGraph, key: tuple[str | int, ...], names: Sequence[str]) -> IntArray:
    """[N] plan vertices by the names of stations."""
    return np.array(graph.vertex_of_station[as_drawn(file, nav, key, names)], np.int64)


def as_drawn(file: ScenarioFile, nav: NavGraph, key: tuple[str | int, ...], names: Sequence[str]) -> list[int]:
    """Vertices of the nav graph by their names."""
    faults, vertices = [], []
    for i, name in enumerate(names):
        vertex = nav.vertex_of_name.get(name)
        if vertex is None and (number := name.removeprefix("v")).isdecimal() and int(number) < nav.num_vertices:
            vertex = int(number) if nav.label(int(number)) == name else None  # of one without a name
        if vertex is None:
            known = [n for n in nav.vertex_name if n]
            faults.append(f"{file.at(*key, i)}: '{name}' is not a vertex of '{nav.name}'{nearest(name, known)}")
        else:
            vertices.append(vertex)
    if faults:
        raise ScenarioError(*faults)
    return vertices


def named_places(scenario: ScenarioModel) -> bool:
    """True if a scenario names starts and goals."""
    return scenario.robots.starts is not None or any(group.starts and group.goals for group in scenario.robots.fleet or ())


def require_reachable(file: ScenarioFile, problem: Problem) -> None:
    """Named starts and goals that can never meet are a mistake in the file, not a hard problem."""
    reach = np.isfinite(costs_of(problem, "path"))
    label, name = problem.graph.label, problem.fleet.robot_name
    if file.scenario.assignment.mode == "fixed":
        reach = reach[:, : problem.num_robots] & np.eye(problem.num_robots, dtype=bool)
    for robot in np.flatnonzero(~reach.any(1)) if len(problem.goal) >= problem.num_robots else ():
        raise ScenarioError(
            f"{file.at('robots', 'starts', int(robot))}: {name[robot]} cannot reach "
            + (f"its goal '{label(problem.goal[robot])}'" if file.scenario.assignment.mode == "fixed" else "any goal")
            + f" from '{label(problem.start[robot])}'"
        )
    for goal in np.flatnonzero(~reach.any(0)) if len(problem.goal) <= problem.num_robots else ():
        raise ScenarioError(f"{file.at('robots', 'goals', int(goal))}: no robot can reach '{label(problem.goal[goal])}'")


def headings(degrees: float | list[float | None] | None, count: int) -> FloatArray | None:
    """[N] in radians, NaN where none is given; None where none are."""
    if degrees is None:
        return None
    each = degrees[:count] if isinstance(degrees, list) else [degrees] * count
    return frozen(np.radians(np.array([np.nan if heading is None else heading for heading in each], np.float64)))


def goal_headings(scenario: ScenarioModel, graph: PlanGraph, goal: IntArray, is_vehicle: bool) -> FloatArray | None:
    """[G] as the scenario says, else as the map does, where robots can face so without turning aside from all lanes."""
    if scenario.robots.goal_heading_deg is not None or scenario.tasks is not None:
        return headings(scenario.robots.goal_heading_deg, len(goal))
    theta_rad = np.array([float(graph.vertex_options[v].get("theta_rad", np.nan)) for v in goal.tolist()])
    for i in np.flatnonzero(~np.isnan(theta_rad)).tolist():
        if not _along_a_lane(graph, int(goal[i]), theta_rad[i], is_vehicle):
            theta_rad[i] = np.nan
    return None if np.isnan(theta_rad).all() else frozen(theta_rad)


def require_headings(file: ScenarioFile, problem: Problem) -> None:
    """Robots stay at a goal along one of its lanes, as they came or turned round; a heading between these is a mistake."""
    graph, wanted, degrees = problem.graph, problem.goal_heading_rad, file.scenario.robots.goal_heading_deg
    if wanted is None or degrees is None:
        return
    for goal in np.flatnonzero(~np.isnan(wanted)).tolist():
        v = problem.goal[goal]
        if _along_a_lane(graph, int(v), float(wanted[goal]), bool(problem.fleet.vehicle_of_kind)):
            continue
        there = graph.heading_rad[(graph.head == v) | (graph.tail == v)]
        place: Place = ("robots", "goal_heading_deg", goal) if isinstance(degrees, list) else ("robots", "goal_heading_deg")
        fitting = ", ".join(f"{angle:g}" for angle in np.unique(np.round(np.degrees(there), 1) % 360))
        raise ScenarioError(
            f"{file.at(*place)}: found {np.degrees(wanted[goal]):g}, but no lane leads to '{graph.known_as(int(v))}' or away from it in "
            f"that heading, expected one of {fitting}"
        )


def _along_a_lane(graph: PlanGraph, vertex: int, heading_rad: float, is_vehicle: bool) -> bool:
    """True if robots at a vertex face so on a lane that leads to it or away from it; vehicles on curves as these end and begin."""
    into, out = graph.head == vertex, graph.tail == vertex
    there = graph.heading_rad[into | out]
    if is_vehicle and graph.curves:
        course = course_rad(graph)
        there = np.concatenate([course[into, 1], course[out, 0]])
    return bool((np.abs(wrapped(there - heading_rad)) <= TURNS_RAD).any())
