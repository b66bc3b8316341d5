"""The order in which robots pass, derived from a plan: an order at every resource, proven to be executable.

A resource is a vertex, or a zone where robots could touch without meeting at a vertex. Robots that
keep the order at every resource execute the plan without deadlock however late each of them is, since
waiting is acyclic. Refuses plans whose order is cyclic (swaps, overtaking on a lane, rotations
without a gap) and plans that lead a robot past one that stays for ever.

The order is that of the action dependency graph of Hoenig, Kiesel, Tinka, Durham and Ayanian,
"Persistent and robust execution of MAPF schedules in warehouses", RA-L 2019, with resources for vertices.
"""

import numpy as np

from mrp_sumo.core.digraph import has_cycle, strong_components
from mrp_sumo.core.graph import BoolArray, IntArray
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.traffic.passages import Needs, Schedule, joined, order_of, vertex_needs, waiting_arcs, waits
from mrp_sumo.traffic.reorder import reordered


def schedule_of(problem: Problem, plan: Plan, needs: Needs | None = None) -> Schedule:
    """The plan's order at every resource. Time and memory are linear in the needs, but for sorting.

    Raises PlanError when no execution can keep the order: names robots and vertices.
    """
    needs = needs if needs is not None else vertex_needs(plan, problem.graph.num_vertices)
    schedule = order_of(plan, needs)
    fault = _fault(problem, plan, schedule)
    if fault:
        schedule = reordered(plan, schedule, problem.graph.num_vertices)
        fault = _fault(problem, plan, schedule)
    if fault:
        raise PlanError(fault)
    return joined(schedule)


def check_order(problem: Problem, plan: Plan, schedule: Schedule) -> None:
    """Refuse an order that nobody can keep, by whomever. Raises PlanError: naming robots and vertices."""
    if fault := _fault(problem, plan, schedule):
        raise PlanError(fault)


def _fault(problem: Problem, plan: Plan, schedule: Schedule) -> str:
    """What to say of an order that leads past somebody who stays, or in which somebody waits for himself; else ''."""
    after, left_at = waits(schedule)
    stays = left_at == plan.num_visits
    if stays.any():
        return _about_staying(problem, plan, schedule.last_visit[after - 1][stays], schedule.visit[after][stays])
    cycle = waiting_cycle(plan, schedule)
    return _about_cycle(problem, plan, cycle) if len(cycle) else ""


def waiting_cycle(plan: Plan, schedule: Schedule) -> IntArray:
    """Visits each of which has to wait for the next, the last for the first; none if the order can be kept.

    Of all circles with the earliest visit that is in one, the shortest: it explains best. Waiting goes along two kinds of
    arcs between visits: a robot's visits one after the other; and where a passage of i is directly before one of j, j's first
    visit waits for the visit at whose arrival i has left.
    """
    source, target = waiting_arcs(plan, schedule)
    if not has_cycle(plan.num_visits, source, target):
        return np.zeros(0, np.int64)
    component = strong_components(plan.num_visits, source, target)
    size = np.bincount(component)
    inside: BoolArray = (component[source] == component[target]) & (size[component[source]] > 1)
    source, target = source[inside], target[inside]
    import networkx as nx  # slow to load, and seldom needed

    waits_for = nx.DiGraph(zip(target.tolist(), source.tolist()))
    earliest = int(target[np.argmin(plan.arrive_s[target])])
    back = min((nx.shortest_path(waits_for, visit, earliest) for visit in waits_for[earliest]), key=len)
    return np.array([earliest, *back[:-1]], np.int64)


def _about_staying(problem: Problem, plan: Plan, leaves: IntArray, waits: IntArray) -> str:
    k = int(np.argmin(plan.arrive_s[waits]))
    i, j = plan.robot[leaves[k]], plan.robot[waits[k]]
    names, graph, at, to = problem.fleet.robot_name, problem.graph, plan.vertex[leaves[k]], plan.vertex[waits[k]]
    place = "there" if at == to else f"within reach of it, to '{graph.known_as(int(to))}'"
    return (
        f"{names[i]} stays at '{graph.known_as(int(at))}' from {plan.arrive_s[leaves[k]]:g} s on, "
        f"and {names[j]} has to pass {place} at {plan.arrive_s[waits[k]]:g} s"
    )


def _about_cycle(problem: Problem, plan: Plan, cycle: IntArray) -> str:
    names: list[tuple[int, str]] = []
    for visit in cycle.tolist():
        robot = int(plan.robot[visit])
        if not names or robot != names[-1][0]:
            names.append((robot, f"{problem.fleet.robot_name[robot]} at '{problem.graph.known_as(int(plan.vertex[visit]))}'"))
    if len(names) > 1 and names[0][0] == names[-1][0]:
        names.pop()
    shown = [name for _, name in names]
    listed = " waits for ".join(shown[:6] + (["..."] if len(shown) > 6 else []) + shown[:1])
    return f"the plan's order of passages is cyclic: {listed}{_how_to_avoid(problem, plan, cycle)}"


def _how_to_avoid(problem: Problem, plan: Plan, cycle: IntArray) -> str:
    """Robots that rotate, each to where the next stands, need a planner that does not do that."""
    robots = [int(plan.robot[visit]) for visit in cycle]
    onward = [int(plan.vertex[k + 1]) if k + 1 < plan.first[r + 1] else -1 for k, r in zip(cycle.tolist(), robots)]
    stands = {int(plan.vertex[k]) for k in cycle}
    if len(set(robots)) > 1 and sum(v in stands for v in onward) >= len(set(robots)):
        return "; they rotate, which the planner's parameters rotations: false or following: true avoid, where it has them"
    return ""
