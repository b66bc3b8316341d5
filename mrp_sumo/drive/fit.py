"""Refuses what no execution could survive, before SUMO starts, one line each.

A plan that is not for this problem or leaves the lanes; robots that do not fit the cells; starts within
reach of each other or in one mutex group.
"""

import numpy as np

from mrp_sumo.core.near import pairs_within
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.motion_plan import lanes_along
from mrp_sumo.errors import ExecutionError
from mrp_sumo.traffic.resources import Resources, resources_of


def resources_for(problem: Problem, plan: Plan) -> Resources:
    """Resources that robots must not share, if they can drive the plan. Raises ExecutionError when they cannot."""
    check_lanes(problem, plan)
    check_room(problem)
    resources = resources_of(problem.graph, problem.fleet.apart_m)
    check_groups(problem, resources)
    return resources


def check_lanes(problem: Problem, plan: Plan) -> None:
    """Refuse a plan for other robots, one that begins elsewhere, and one that jumps between vertices without a lane."""
    graph, names = problem.graph, problem.fleet.robot_name
    if plan.num_robots != problem.num_robots:
        raise ExecutionError(f"the plan has {plan.num_robots} robots, the problem {problem.num_robots}")
    begin = plan.first[:-1]
    elsewhere = np.flatnonzero(plan.vertex[begin] != problem.start)
    if len(elsewhere):
        r = int(elsewhere[0])
        begins_at, expected = graph.known_as(int(plan.vertex[begin[r]])), graph.known_as(int(problem.start[r]))
        raise ExecutionError(f"the plan of {names[r]} begins at '{begins_at}', expected its start '{expected}'")
    missing = lanes_along(graph, plan)[1]
    if missing.any():
        k = int(np.flatnonzero(missing)[0])
        r, tail, head = int(plan.robot[k]), int(plan.vertex[k - 1]), int(plan.vertex[k])
        raise ExecutionError(
            f"the plan of {names[r]} goes from '{graph.known_as(tail)}' to '{graph.known_as(head)}', where there is no lane"
        )


def check_room(problem: Problem) -> None:
    """Refuse robots that do not fit the cells beside others, stand where no lane is, or start within reach of each other."""
    graph, fleet = problem.graph, problem.fleet
    separation = fleet.separation_m
    if not problem.num_robots:
        raise ExecutionError("there are no robots to execute a plan with")
    if problem.num_robots > 1 and separation > graph.cell_m + 1e-9:
        raise ExecutionError(
            f"the robots do not fit: with their gap they need {separation:.3f} m from centre to centre, "
            f"and cells of '{graph.name}' are {graph.cell_m:g} m"
        )
    served = np.zeros(graph.num_vertices, np.bool_)
    served[graph.tail] = served[graph.head] = True
    stranded = np.flatnonzero(~served[problem.start])
    if len(stranded):
        r = int(stranded[0])
        raise ExecutionError(f"{fleet.robot_name[r]} starts at '{graph.known_as(int(problem.start[r]))}', which has no lane")
    where, beyond_m = graph.xy[problem.start], graph.swing_m[problem.start]
    pairs = pairs_within(where, separation + 2 * float(beyond_m.max()) - 1e-9)
    pairs = pairs[graph.level[problem.start[pairs[:, 0]]] == graph.level[problem.start[pairs[:, 1]]]]
    apart_m, needed_m = np.hypot(*(where[pairs[:, 0]] - where[pairs[:, 1]]).T), fleet.apart_m[tuple(fleet.kind[pairs].T)]
    needed_m = needed_m + beyond_m[pairs].sum(1)
    pairs = pairs[apart_m < needed_m - 1e-9]
    if len(pairs):
        i, j = sorted(pairs.tolist())[0]
        apart, separation = float(np.hypot(*(where[i] - where[j]))), float(fleet.apart_m[fleet.kind[i], fleet.kind[j]])
        separation += float(beyond_m[[i, j]].sum())
        raise ExecutionError(
            f"{fleet.robot_name[i]} and {fleet.robot_name[j]} start {apart:.3f} m apart, at '{graph.known_as(int(problem.start[i]))}' "
            f"and '{graph.known_as(int(problem.start[j]))}', expected {separation:.3f} m or more"
        )


def check_groups(problem: Problem, resources: Resources) -> None:
    """Refuse two robots that start in one mutex group."""
    inside: dict[int, int] = {}
    for r, vertex in enumerate(problem.start.tolist()):
        for group in sorted(resources.groups_at.get(vertex, ())):
            if (other := inside.setdefault(group, r)) != r:
                names, name = problem.fleet.robot_name, resources.group_name[group]
                raise ExecutionError(f"{names[other]} and {names[r]} both start in mutex group '{name}', where one robot at a time may be")
